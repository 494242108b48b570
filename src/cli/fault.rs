use core::time::Duration;
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::{Map, Value};

use super::answer::Faults;
use super::{CliError, Verdict, out};
use crate::realtime::control;

/// Add faults to a rig that runs in real time, list them, end them.
///
/// A fault has the same keys as in a scenario. It acts immediately unless its keys give a time.
/// The case that the rig writes at its end includes the fault.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig fault --dir /tmp/robot add link=base direction=to-device kind=cut\n  \
    hilrig fault --dir /tmp/robot add link=lidar direction=to-master kind=flip rate=0.001\n  \
    hilrig fault --dir /tmp/robot list\n  \
    hilrig fault --dir /tmp/robot end 0")]
pub(super) struct FaultArgs {
    /// Directory of the rig's ports
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Add a fault, and print its number
    Add {
        /// Keys of the fault as in a scenario
        #[arg(required = true, value_name = "KEY=VALUE")]
        keys: Vec<String>,
    },
    /// Print all faults, one JSON object a line
    List,
    /// End a fault now
    End {
        /// Its number
        #[arg(value_name = "N")]
        id: u64,
    },
}

/// Maximum time for the rig's answer.
const PATIENCE: Duration = Duration::from_secs(10);

pub(super) fn run(args: &FaultArgs) -> Result<Verdict, CliError> {
    let request = match &args.verb {
        Verb::Add { keys } => serde_json::json!({ "do": "add", "fault": fault(keys)? }),
        Verb::List => serde_json::json!({ "do": "list" }),
        Verb::End { id } => serde_json::json!({ "do": "end", "id": id }),
    };
    let dir = args.dir.display();
    let answer = ask(args, &request).map_err(|error| {
        let expected = "expected a directory of `hilrig up`";
        CliError::Usage(format!(
            "--dir {dir}: no rig answers here, {expected}: {error}"
        ))
    })?;
    if answer["ok"] != true {
        let (key, message) = (&answer["key"], &answer["message"]);
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        return Err(CliError::Usage(format!("{}: {}", text(key), text(message))));
    }
    out::answer(&Faults {
        id: answer["id"].as_u64(),
        faults: answer["faults"].as_array().cloned(),
    });
    match &args.verb {
        Verb::List => {
            let faults = answer["faults"].as_array();
            faults
                .into_iter()
                .flatten()
                .for_each(|fault| println!("{fault}"));
        }
        Verb::Add { .. } => println!("{}", answer["id"]),
        Verb::End { .. } => {}
    }
    Ok(Verdict::Pass)
}

fn ask(args: &FaultArgs, request: &Value) -> io::Result<Value> {
    let mut stream = UnixStream::connect(args.dir.join(control::NAME))?;
    stream.set_read_timeout(Some(PATIENCE))?;
    writeln!(stream, "{request}")?;
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line)?;
    Ok(serde_json::from_str(&line)?)
}

/// Parses a value as in a scenario, or as text if it is not valid TOML: `rate=0.1`, `kind=cut`.
pub(super) fn fault(keys: &[String]) -> Result<Map<String, Value>, CliError> {
    let mut fault = Map::new();
    for pair in keys {
        let Some((key, value)) = pair.split_once('=') else {
            let expected = "expected KEY=VALUE such as kind=cut";
            return Err(CliError::Usage(format!("\"{pair}\": {expected}")));
        };
        let table: Option<toml::Table> = toml::from_str(&format!("value = {value}")).ok();
        let value = table
            .and_then(|table| serde_json::to_value(table.get("value")?).ok())
            .unwrap_or_else(|| value.into());
        if fault.insert(key.to_owned(), value).is_some() {
            return Err(CliError::Usage(format!(
                "{key}: is given twice, expected once"
            )));
        }
    }
    Ok(fault)
}
