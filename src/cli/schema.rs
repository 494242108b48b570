use std::io::{self, Write as _};

use clap::Args;

use super::{CliError, Verdict};
use crate::realtime::control;
use crate::scenario::schema;

/// Print the JSON Schema of a scenario file.
///
/// It is derived from what reads the file: every table and key, the settings of each kind of
/// device, the keys of each kind of fault. Editors complete and check scenarios with it.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig schema > scenario.schema.json       # for an editor\n  \
    hilrig schema --markdown                   # the reference, docs/scenario.md\n  \
    hilrig schema --control                    # requests to the control socket\n\n\
    Exit codes: 0 printed, 2 the output cannot be written.")]
pub(super) struct SchemaArgs {
    /// Print the reference for people instead
    #[arg(long)]
    markdown: bool,
    /// Print the JSON Schema of a request to the control socket, see docs/control.md
    #[arg(long, conflicts_with = "markdown")]
    control: bool,
}

pub(super) fn run(args: &SchemaArgs) -> Result<Verdict, CliError> {
    let schema = match args.control {
        true => control::json_schema(),
        false => schema::json_schema(),
    };
    let text = if args.markdown {
        schema::reference(&schema)
    } else {
        format!("{schema:#}\n")
    };
    match io::stdout().write_all(text.as_bytes()) {
        // Whoever reads no further has what was wanted.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(CliError::write("the schema", error))
        }
        _ => Ok(Verdict::Pass),
    }
}
