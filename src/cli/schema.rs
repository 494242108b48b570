use clap::Args;

use super::{CliError, Verdict, answer, out};
use crate::realtime::control;
use crate::scenario::schema;

/// Print the JSON Schema of a scenario file, or of a device description.
///
/// It is derived from the parser's types: every table and key, the settings of each kind of
/// device, the keys of each kind of fault. Editors use it to complete and check scenarios.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig schema > scenario.schema.json       # for an editor\n  \
    hilrig schema --markdown                   # the reference, docs/scenario.md\n  \
    hilrig schema --device > device.schema.json  # of descriptions, see docs/own-device.md\n  \
    hilrig schema --control                    # requests to the control socket\n  \
    hilrig schema --output                     # what --json prints\n\n\
    Exit codes: 0 printed, 2 the output cannot be written.")]
pub(super) struct SchemaArgs {
    /// Print the human-readable reference instead
    #[arg(long)]
    markdown: bool,
    /// Print the JSON Schema of a request to the control socket, see docs/control.md
    #[arg(long, conflicts_with = "markdown")]
    control: bool,
    /// Print the JSON Schema of a command's output with --json
    #[arg(long, conflicts_with_all = ["markdown", "control"])]
    output: bool,
    /// Print the JSON Schema of a device description
    #[arg(long, conflicts_with_all = ["markdown", "control", "output"])]
    device: bool,
}

pub(super) fn run(args: &SchemaArgs) -> Result<Verdict, CliError> {
    let schema = match () {
        () if args.control => control::json_schema(),
        () if args.output => answer::json_schema(),
        () if args.device => description::json_schema().to_value(),
        () => schema::json_schema(),
    };
    let text = if args.markdown {
        schema::reference(&schema)
    } else {
        format!("{schema:#}\n")
    };
    out::write_text("the schema", text.as_bytes())
}
