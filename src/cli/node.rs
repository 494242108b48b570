use std::path::Path;

use clap::{Args, Subcommand};
use nodes::conform::{Finding, Mark, findings};
use nodes::{NodeDevice, NodePort, NodeSpec, line_of};

use super::answer::{NodeChecked, NodePart};
use super::{CliError, Verdict, out};
use crate::run::check::{Check, Status};
use crate::scenario::Scenario;

/// Work with node programs: processes that implement a device or the program under test.
#[derive(Debug, Args)]
pub(super) struct NodeArgs {
    #[command(subcommand)]
    command: NodeCommand,
}

#[derive(Debug, Subcommand)]
enum NodeCommand {
    Check(CheckArgs),
}

/// Test whether a program keeps the contract of node programs.
///
/// The command starts the program several times and acts as the rig. It sends the greeting, an
/// unknown version, bytes and line events, requests in pieces, faults, requests to save and load,
/// and the end. Each printed line is the result for one part of the contract, see docs/nodes.md.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig node check 'python3 scale.py'\n  \
    hilrig node check ./scale --send 'SI\\r\\n' --send 'Z\\r\\n' --settings '{\"load_g\": 100}'\n  \
    hilrig node check bench.toml --device scale --send 'SI\\r\\n'   # as the scenario starts it\n\n\
    Exit codes: 0 the program keeps the contract, 1 it does not, 2 usage or set-up.")]
struct CheckArgs {
    /// Shell command that starts the program, or a scenario with it
    #[arg(value_name = "CMD|SCENARIO")]
    command: String,
    /// The scenario's device that the program implements [default: the only one]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Port of the program, with its rate and coding; may be given several times
    /// [default: uart:9600:8N1]
    #[arg(long, value_name = "NAME:RATE[:8N1]")]
    port: Vec<String>,
    /// Bytes that the other end sends, with \r, \n, \t, \0, \\ and \xNN; may be given several times
    #[arg(long, value_name = "TEXT")]
    send: Vec<String>,
    /// Settings for the program, as in a scenario
    #[arg(long, value_name = "JSON")]
    settings: Option<String>,
}

pub(super) fn run(args: &NodeArgs) -> Result<Verdict, CliError> {
    let NodeCommand::Check(args) = &args.command;
    let spec = spec_of(args)?;
    let sent = args.send.iter().map(|text| bytes_of(text));
    let sent = sent.collect::<Result<Vec<_>, _>>()?;
    let found = findings(&spec, &sent);
    for Finding { name, mark, detail } in &found {
        let check = match mark {
            Mark::Pass => Check::new(name, true, detail),
            Mark::Fail => Check::new(name, false, detail),
            Mark::NotOffered => Check::not_observed(name, detail),
        };
        println!("{check}");
    }
    let passes = found.iter().all(|finding| finding.mark != Mark::Fail);
    let status = |mark| match mark {
        Mark::Pass => Status::Pass,
        Mark::Fail => Status::Fail,
        Mark::NotOffered => Status::NotObserved,
    };
    out::answer(&NodeChecked {
        verdict: Status::of(passes),
        parts: found
            .into_iter()
            .map(|finding| NodePart {
                name: finding.name.to_owned(),
                status: status(finding.mark),
                detail: finding.detail,
            })
            .collect(),
    });
    Ok(if passes { Verdict::Pass } else { Verdict::Fail })
}

fn spec_of(args: &CheckArgs) -> Result<NodeSpec, CliError> {
    let mut spec = match is_scenario(&args.command) {
        true => of_scenario(args)?,
        false => NodeSpec::new("node", &args.command),
    };
    if let Some(text) = &args.settings {
        spec.settings = serde_json::from_str(text).map_err(|error| {
            CliError::Usage(format!("--settings: is not a JSON object: {error}"))
        })?;
    }
    if !args.port.is_empty() {
        let ports = args.port.iter().map(|port| port_of(port));
        spec.ports = ports.collect::<Result<_, _>>()?;
    }
    if spec.ports.is_empty() {
        spec.ports = vec![port_of("uart:9600")?];
    }
    Ok(spec)
}

/// Whether the argument is the path of a scenario. The last word of a command may be the name of
/// such a file, e.g. `python3 meter.py meter.toml`.
fn is_scenario(command: &str) -> bool {
    let is_one_word = !command.contains(char::is_whitespace);
    command.ends_with(".toml") && (is_one_word || Path::new(command).is_file())
}

/// The program of a scenario's device.
fn of_scenario(args: &CheckArgs) -> Result<NodeSpec, CliError> {
    let (scenario, source) = Scenario::read(Path::new(&args.command))?;
    let mut found = Vec::new();
    for (name, device) in &scenario.device {
        let built = device.build(name, scenario.seed, &source)?;
        let device: &dyn core::any::Any = built.device.as_ref();
        if let Some(node) = device.downcast_ref::<NodeDevice>() {
            found.push((name, node.spec().clone()));
        }
    }
    let known: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
    let known = match &known[..] {
        [] => "none".to_owned(),
        known => known.join(", "),
    };
    let is_it = |name: &String| args.device.as_ref().is_none_or(|wanted| wanted == name);
    let mut fitting = found.into_iter().filter(|(name, _)| is_it(name));
    match (fitting.next(), fitting.next()) {
        (Some((_, spec)), None) => Ok(spec),
        (None, _) => Err(CliError::Usage(format!(
            "--device: the scenario has no such device that a program plays, expected one of: \
             {known}"
        ))),
        _ => Err(CliError::Usage(format!(
            "--device is missing, expected one of: {known}"
        ))),
    }
}

fn port_of(text: &str) -> Result<NodePort, CliError> {
    let mut parts = text.split(':');
    let name = parts.next().unwrap_or_default();
    let rate = parts.next().and_then(|rate| rate.parse().ok());
    let format = parts.next().unwrap_or("8N1");
    let line = rate.and_then(|rate| line_of(rate, format));
    let wrong = || {
        CliError::Usage(format!(
            "--port: is \"{text}\", expected a name and a rate, e.g. uart:9600 or uart:9600:7E1"
        ))
    };
    let is_whole = parts.next().is_none() && !name.is_empty();
    let line = line.filter(|_| is_whole).ok_or_else(wrong)?;
    Ok(NodePort::uart(name, line))
}

/// The bytes of a text with escapes.
fn bytes_of(text: &str) -> Result<Vec<u8>, CliError> {
    let wrong = || {
        let expected = "expected \\r, \\n, \\t, \\0, \\\\ or \\x and two hexadecimal digits";
        CliError::Usage(format!(
            "--send: \"{text}\" has an unknown escape, {expected}"
        ))
    };
    let mut bytes = Vec::new();
    let mut letters = text.chars();
    while let Some(letter) = letters.next() {
        if letter != '\\' {
            let mut room = [0; 4];
            bytes.extend_from_slice(letter.encode_utf8(&mut room).as_bytes());
            continue;
        }
        bytes.push(match letters.next() {
            Some('r') => b'\r',
            Some('n') => b'\n',
            Some('t') => b'\t',
            Some('0') => 0,
            Some('\\') => b'\\',
            Some('x') => {
                let mut digit = || letters.next()?.to_digit(16);
                let byte = digit().zip(digit()).map(|(high, low)| high << 4 | low);
                byte.and_then(|byte| byte.try_into().ok())
                    .ok_or_else(wrong)?
            }
            _ => return Err(wrong()),
        });
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_the_bytes_that_they_name() {
        let bytes = bytes_of(r"SI\r\n\x02\xFF\\\0").expect("all are known");
        assert_eq!(bytes, b"SI\r\n\x02\xff\\\0");
        for wrong in [r"\q", r"\x1", r"\xZZ", r"\x+1", r"\x é", "end\\"] {
            let error = bytes_of(wrong).expect_err(wrong).to_string();
            assert!(error.contains("unknown escape"), "{error}");
        }
    }

    #[test]
    fn a_command_that_ends_with_a_file_is_no_scenario() {
        assert!(is_scenario("bench.toml"));
        for command in [
            "python3 meter.py meter.toml",
            "./meter",
            "bench.toml --fast",
        ] {
            assert!(!is_scenario(command), "{command}");
        }
    }

    #[test]
    fn a_port_has_a_name_a_rate_and_a_coding() {
        let port = port_of("uart:4800:7E1").expect("sound");
        assert_eq!((port.name.as_str(), port.line.baud), ("uart", 4_800));
        for wrong in [
            "",
            "uart",
            ":9600",
            "uart:fast",
            "uart:9600:9N1",
            "a:1:8N1:x",
        ] {
            assert!(port_of(wrong).is_err(), "{wrong}");
        }
    }
}
