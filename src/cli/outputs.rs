//! Output files of a command that are also its input: an error before anything is written.
//!
//! Files are compared by device and inode, so that other paths and links to a file count as well.

use std::ffi::OsString;
use std::fs::{Metadata, metadata};
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use clap::{Arg, ArgMatches, Command};

use super::CliError;

/// Commands, and their options that name a file to write.
const OUTPUTS: [(&[&str], &str); 9] = [
    (&["import", "export", "from", "record", "link"], "out"),
    (&["learn", "describe"], "output"),
    (&["from"], "test"),
    (&["run"], "junit"),
    (&["run"], "trace_calls"),
    (&["up"], "case"),
    (&["ui"], "save"),
    (&["diff"], "picture"),
    (&["fuzz"], "coverage_runtime"),
];
/// The file that a command reads from a result folder.
const CAPTURE: &str = "capture.pcapng";
/// Commands whose `--out` names a folder, and files in it that they write and read as well. `run`
/// is not one of them: it writes the same case again.
const FOLDERS: [(&str, &[&str]); 2] = [("shrink", &["case.toml", CAPTURE]), ("replay", &[CAPTURE])];

/// Rejects an output file that is also an input of the command.
pub(super) fn check(command: &Command, matches: &ArgMatches) -> Result<(), CliError> {
    let Some((name, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let Some(command) = command.find_subcommand(name) else {
        return Ok(());
    };
    let is_output = |arg: &&Arg| {
        let id = arg.get_id().as_str();
        let mut rows = OUTPUTS.iter();
        rows.any(|(commands, option)| commands.contains(&name) && *option == id)
    };
    for output in command.get_arguments().filter(is_output) {
        for path in values(matches, output) {
            refuse_input(command, matches, output, Path::new(&path))?;
        }
    }
    let folder = FOLDERS.iter().find(|(command, _)| *command == name);
    // Without a program `replay` writes no files.
    let folder = folder.filter(|_| name != "replay" || is_given(matches, "exec"));
    if let Some(((_, files), output)) = folder.zip(argument(command, "out")) {
        for dir in values(matches, output) {
            for path in files.iter().map(|file| Path::new(&dir).join(file)) {
                refuse_input(command, matches, output, &path)?;
            }
        }
    }
    check(command, matches)
}

/// Rejects `path`, which `output` names, if another argument names it as well.
fn refuse_input(
    command: &Command,
    matches: &ArgMatches,
    output: &Arg,
    path: &Path,
) -> Result<(), CliError> {
    let inputs = command
        .get_arguments()
        .filter(|arg| arg.get_id() != output.get_id());
    let mut inputs = inputs.flat_map(|arg| values(matches, arg));
    match inputs.any(|input| is_same(Path::new(&input), path)) {
        true => Err(CliError::Usage(format!(
            "{} is an input of this command; choose another name with {}",
            path.display(),
            shown(output)
        ))),
        false => Ok(()),
    }
}

fn argument<'a>(command: &'a Command, id: &str) -> Option<&'a Arg> {
    command.get_arguments().find(|arg| arg.get_id() == id)
}

fn is_given(matches: &ArgMatches, id: &str) -> bool {
    matches.try_get_raw(id).is_ok_and(|values| values.is_some())
}

/// The values of an argument; none for a flag.
fn values(matches: &ArgMatches, arg: &Arg) -> Vec<OsString> {
    let id = arg.get_id().as_str();
    let given = matches.try_get_raw(id).ok().flatten();
    given.map_or_else(Vec::new, |all| all.map(ToOwned::to_owned).collect())
}

/// Whether `output` is the existing file `input`, or the capture in the result folder `input`.
fn is_same(input: &Path, output: &Path) -> bool {
    let file = |path: &Path| metadata(path).ok().filter(Metadata::is_file);
    let Some(output) = file(output) else {
        return false;
    };
    let capture = input.join(CAPTURE);
    let mut inputs = [input, &*capture].into_iter().filter_map(file);
    inputs.any(|input| (input.dev(), input.ino()) == (output.dev(), output.ino()))
}

/// An option as it is written, the short form if there is one.
fn shown(arg: &Arg) -> String {
    match (arg.get_short(), arg.get_long()) {
        (Some(short), _) => format!("-{short}"),
        (None, Some(long)) => format!("--{long}"),
        (None, None) => arg.get_id().to_string(),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory as _;

    use super::*;
    use crate::cli::Cli;

    /// Adds each option whose value is a file and whose help says that it is written.
    fn written(command: &Command, found: &mut BTreeSet<(String, String)>) {
        for arg in command.get_arguments().filter(|arg| !arg.is_positional()) {
            let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
            let help = help.to_lowercase();
            let names = arg.get_value_names().unwrap_or_default();
            let is_file = names
                .iter()
                .any(|name| matches!(name.as_str(), "FILE" | "PNG"));
            if is_file && (help.contains("write") || help.starts_with("file for")) {
                let pair = [command.get_name(), arg.get_id().as_str()].map(str::to_owned);
                found.insert(pair.into());
            }
        }
        for inner in command.get_subcommands() {
            written(inner, found);
        }
    }

    /// `up --capture` renames an existing file.
    #[test]
    fn the_table_has_every_option_of_a_file_to_write() {
        let mut found = BTreeSet::new();
        written(&Cli::command(), &mut found);
        let pair = |command: &str, option: &str| (command.to_owned(), option.to_owned());
        found.remove(&pair("up", "capture"));
        let rows = OUTPUTS.iter();
        let rows = rows.flat_map(|(all, option)| all.iter().map(|one| pair(one, option)));
        let listed: BTreeSet<_> = rows.collect();
        // The page is an optional feature.
        let is_built = |(command, _): &(String, String)| cfg!(feature = "ui") || command != "ui";
        let listed: BTreeSet<_> = listed.into_iter().filter(is_built).collect();
        assert_eq!(listed, found);
    }
}
