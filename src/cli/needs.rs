//! Options that have no effect without another one: each is an error.
//!
//! `clap` checks `requires` as well, but not if the needed option contradicts another one that is
//! given: with `shrink --while CMD`, the options of `--exec` would be accepted and ignored.

use clap::parser::ValueSource;
use clap::{ArgMatches, Command};

use super::CliError;

/// Options that need another one.
struct Needs {
    /// Names of the commands.
    commands: &'static [&'static str],
    options: &'static [&'static str],
    needed: &'static str,
}

const WITH_PROGRAM: [&str; 6] = ["run", "campaign", "shrink", "replay", "from", "check"];
/// Commands that run firmware and node programs.
const IN_LOCKSTEP: [&str; 3] = ["run", "campaign", "shrink"];
const NEEDS: [Needs; 24] = [
    Needs {
        commands: &WITH_PROGRAM,
        options: &OF_EXEC,
        needed: "exec",
    },
    Needs {
        commands: &["debug"],
        options: &OF_EXEC,
        needed: "exec",
    },
    Needs {
        commands: &WITH_PROGRAM,
        options: &["call_cost", "spin_max", "schedule", "cpu"],
        needed: "is_virtual",
    },
    Needs {
        commands: &["run"],
        options: &["check", "trace_calls", "control"],
        needed: "is_virtual",
    },
    Needs {
        commands: &["run", "fuzz"],
        options: &["dir"],
        needed: "exec",
    },
    Needs {
        commands: &["run"],
        options: &["gdb"],
        needed: "firmware",
    },
    Needs {
        commands: &IN_LOCKSTEP,
        options: &["board", "wire", "firmware_may_idle", "firmware_may_reset"],
        needed: "firmware",
    },
    Needs {
        commands: &IN_LOCKSTEP,
        options: &["node_may_idle"],
        needed: "node",
    },
    Needs {
        commands: &IN_LOCKSTEP,
        options: &["firmware"],
        needed: "board",
    },
    Needs {
        commands: &["fidelity"],
        options: &["against", "capture", "profile", "seed"],
        needed: "device",
    },
    Needs {
        commands: &["fidelity"],
        options: &["link", "slack"],
        needed: "capture",
    },
    Needs {
        commands: &["fuzz"],
        options: &["start", "is_virtual", "baud", "shrink"],
        needed: "exec",
    },
    Needs {
        commands: &["fuzz"],
        options: &["vary", "profile"],
        needed: "scenario",
    },
    Needs {
        commands: &["fuzz"],
        options: &["port", "address"],
        needed: "description",
    },
    Needs {
        commands: &["fuzz"],
        options: &["rate", "writes"],
        needed: "port",
    },
    Needs {
        commands: &["new"],
        options: &["from"],
        needed: "device",
    },
    Needs {
        commands: &["replay"],
        options: &["out"],
        needed: "exec",
    },
    Needs {
        commands: &["from", "shrink"],
        options: &["sound"],
        needed: "exec",
    },
    Needs {
        commands: &["campaign"],
        options: &["defects", "markdown"],
        needed: "mutants",
    },
    Needs {
        commands: &["campaign"],
        options: &["shards"],
        needed: "shard",
    },
    Needs {
        commands: &["experiment"],
        options: &["rows", "planted"],
        needed: "all",
    },
    Needs {
        commands: &["decode"],
        options: &["duration"],
        needed: "follow",
    },
    Needs {
        commands: &["up"],
        options: &["capture_max_mb", "capture_files"],
        needed: "capture",
    },
    Needs {
        commands: &["ui"],
        options: &["robot", "baud"],
        needed: "pc",
    },
];
/// Options of a program that `--exec` starts.
const OF_EXEC: [&str; 6] = [
    "exec_wait",
    "exec_may_end",
    "exec_may_idle",
    "exec_needs",
    "exec_no_lines",
    "is_virtual",
];

/// Rejects an option of the command line whose needed option is missing.
pub(super) fn check(command: &Command, matches: &ArgMatches) -> Result<(), CliError> {
    let Some((name, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let Some(command) = command.find_subcommand(name) else {
        return Ok(());
    };
    for row in NEEDS.iter().filter(|row| row.commands.contains(&name)) {
        let mut options = row.options.iter();
        let given = options.find(|option| is_given(matches, option));
        if let Some(option) = given.filter(|_| !is_given(matches, row.needed)) {
            let [option, needed] = [option, row.needed].map(|id| shown(command, id));
            let text =
                format!("{option}: has no effect without {needed}; expected both of them, or none");
            return Err(CliError::Usage(text));
        }
    }
    check(command, matches)
}

fn is_given(matches: &ArgMatches, id: &str) -> bool {
    matches.ids().any(|it| it.as_str() == id)
        && matches.value_source(id) == Some(ValueSource::CommandLine)
}

/// An option as it is written.
fn shown(command: &Command, id: &str) -> String {
    let mut all = command.get_arguments();
    let found = all
        .find(|it| it.get_id() == id)
        .and_then(|it| it.get_long());
    found.map_or_else(|| id.to_owned(), |long| format!("--{long}"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory as _;

    use super::*;
    use crate::cli::Cli;

    /// Command, option and needed option.
    type Pair = (String, String, String);

    /// The same pairs in `clap`, which prints them only in its text for debugging.
    fn declared(command: &Command, pairs: &mut BTreeSet<Pair>) {
        for argument in command.get_arguments() {
            let text = format!("{argument:?}");
            let required = text.split("requires: [").nth(1);
            let required = required.and_then(|rest| rest.split(']').next());
            for part in required.unwrap_or_default().split("IsPresent, \"").skip(1) {
                let needed = part.split('"').next().unwrap_or_default();
                let option = argument.get_id().as_str().to_owned();
                pairs.insert((command.get_name().to_owned(), option, needed.to_owned()));
            }
        }
        for inner in command.get_subcommands() {
            declared(inner, pairs);
        }
    }

    /// Adds the names of all options of `command` and its subcommands, and the options that their
    /// help mentions.
    fn mentioned(command: &Command, known: &mut BTreeSet<String>, named: &mut Vec<[String; 2]>) {
        let mut texts = vec![command.get_about(), command.get_long_about()];
        texts.extend([command.get_after_help(), command.get_after_long_help()]);
        for argument in command.get_arguments() {
            known.extend(argument.get_long().map(str::to_owned));
            texts.extend([argument.get_help(), argument.get_long_help()]);
        }
        for text in texts.into_iter().flatten().map(ToString::to_string) {
            let mut parts = text.split("--");
            let before = parts.next().unwrap_or_default().chars().last();
            let mut is_word = before.is_none_or(|last| !last.is_alphanumeric());
            for part in parts {
                let is_of_name =
                    |c: &char| c.is_ascii_lowercase() || c.is_ascii_digit() || *c == '-';
                let name: String = part.chars().take_while(is_of_name).collect();
                if is_word && !name.is_empty() {
                    named.push([command.get_name().to_owned(), name]);
                }
                is_word = part
                    .chars()
                    .last()
                    .is_none_or(|last| !last.is_alphanumeric());
            }
        }
        for inner in command.get_subcommands() {
            mentioned(inner, known, named);
        }
    }

    /// Options of every command, and of the programs of users in examples.
    const FOREIGN: [&str; 4] = ["help", "version", "ports", "crashes"];

    #[test]
    fn help_names_options_that_exist() {
        let (mut known, mut named) = (BTreeSet::new(), Vec::new());
        mentioned(&Cli::command(), &mut known, &mut named);
        assert!(named.len() > 100, "{named:?}");
        named.retain(|[_, name]| !known.contains(name) && !FOREIGN.contains(&&**name));
        assert_eq!(named, [[""; 2]; 0]);
    }

    #[test]
    fn the_table_has_every_option_that_needs_another_one() {
        let mut expected = BTreeSet::new();
        declared(&Cli::command(), &mut expected);
        let listed = NEEDS.iter().flat_map(|row| {
            row.commands.iter().flat_map(|command| {
                row.options.iter().map(|option| {
                    let words = [*command, option, row.needed];
                    let [command, option, needed] = words.map(str::to_owned);
                    (command, option, needed)
                })
            })
        });
        assert_eq!(listed.collect::<BTreeSet<Pair>>(), expected);
        assert!(expected.len() > 60, "{expected:?}");
    }

    /// Message of `clap` for a missing required option.
    const BY_CLAP: &str = "error: the following required arguments were not provided";

    /// Options whose needed one contradicts another option, so that `clap` does not ask for it; the
    /// last ones are complete.
    #[test]
    fn an_option_without_its_needed_one_is_refused() {
        for (words, expected) in [
            (
                "shrink c.toml --while x --virtual",
                Some("--virtual: has no effect without --exec"),
            ),
            (
                "shrink c.toml --while x --exec-may-idle",
                Some("--exec-may-idle: has no effect"),
            ),
            ("shrink c.toml --while x --cpu 20", Some(BY_CLAP)),
            (
                "replay c.pcapng --dir d --exec-needs a",
                Some("--exec-needs: has no effect"),
            ),
            ("replay c.pcapng --to a=b --schedule 3", Some(BY_CLAP)),
            (
                "replay c.pcapng --step --out o",
                Some("--out: has no effect without --exec"),
            ),
            (
                "run s.toml --exec x --exec-no-lines --cpu 20",
                Some("--cpu: has no effect without"),
            ),
            (
                "run s.toml --exec x --exec-no-lines --check",
                Some("--check: has no effect"),
            ),
            (
                "run s.toml --exec x --exec-no-lines --call-cost 2us",
                Some("--call-cost: has no "),
            ),
            (
                "campaign s.toml --mutants --exec-may-end",
                Some("--exec-may-end: has no effect"),
            ),
            (
                "campaign s.toml --mutants --shards 3",
                Some("--shards: has no effect without"),
            ),
            (
                "fuzz --dut-dir d --start 3s",
                Some("--start: has no effect without --exec"),
            ),
            (
                "fuzz --dut-dir d --virtual",
                Some("--virtual: has no effect without --exec"),
            ),
            (
                "case from c.pcapng --exec x --exec-no-lines --spin-max 3s",
                Some("--spin-max: has"),
            ),
            ("shrink c.toml --while x", None),
            ("run s.toml --exec x --virtual --cpu 20 --check", None),
            (
                "debug s.toml --exec x --cpu 20 --schedule 3 --spin-max 3s",
                None,
            ),
        ] {
            let command = Cli::command();
            let words = core::iter::once("hilrig").chain(words.split(' '));
            let words: Vec<&str> = words.collect();
            let told = match command.clone().try_get_matches_from(&words) {
                Ok(matches) => check(&command, &matches).err().map(|it| it.to_string()),
                Err(error) => Some(error.to_string()),
            };
            let is_as_expected = match (&told, expected) {
                (Some(told), Some(expected)) => told.starts_with(expected),
                (told, expected) => told.is_none() && expected.is_none(),
            };
            assert!(is_as_expected, "{words:?}: {told:?}");
        }
    }
}
