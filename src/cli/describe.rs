use std::path::PathBuf;

use clap::Args;

use super::answer::Files;
use super::{CliError, Verdict, described, out};

/// Print the reference page of a described device.
///
/// It shows the line, the frames as diagrams, each message with its fields, the registers, the
/// device's behaviour and its faults. The page is made only from the description.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig describe modbus-meter                        # Markdown\n  \
    hilrig describe meter.toml --html -o meter.html     # one file for a browser\n\n\
    Exit codes: 0 printed, 2 the description is wrong or the output cannot be written.")]
pub(super) struct DescribeArgs {
    /// Description: one that comes with the tool, by its name, or a file that ends with .toml
    #[arg(value_name = "NAME|FILE")]
    description: String,
    /// Print Markdown, the default
    #[arg(long, conflicts_with = "html")]
    markdown: bool,
    /// Print one self-contained HTML file
    #[arg(long)]
    html: bool,
    /// Write the page to this file
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub(super) fn run(args: &DescribeArgs) -> Result<Verdict, CliError> {
    let description = described::load("describe", &args.description)?;
    let page = match args.html {
        true => description.html(),
        false => description.markdown(),
    };
    let Some(path) = &args.output else {
        return out::write_text("the page", page.as_bytes());
    };
    let shown = path.display();
    safefs::write(path, &page)
        .map_err(|error| CliError::write(format!("--output {shown}"), error))?;
    println!("{shown}");
    out::answer(&Files {
        files: vec![shown.to_string()],
    });
    Ok(Verdict::Pass)
}
