use std::path::PathBuf;

use clap::{Args, CommandFactory as _};
use clap_mangen::Man;

use super::{Cli, CliError, Verdict, out};
use crate::show::folder::Folder;

/// Print the manual page, or write one for each command into a folder.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig man ~/.local/share/man/man1     # then: man hilrig, man hilrig-run\n  \
    hilrig man | man -l -")]
pub(super) struct ManArgs {
    /// Folder for hilrig.1, hilrig-run.1 and so on [default: print hilrig.1]
    #[arg(value_name = "DIR")]
    dir: Option<PathBuf>,
}

pub(super) fn run(args: &ManArgs) -> Result<Verdict, CliError> {
    let mut command = Cli::command();
    // Adds the global options to all commands, as for `--help`.
    command.build();
    let Some(dir) = &args.dir else {
        return out::write_text("the page", &page(command)?);
    };
    let folder = Folder::at(dir)?;
    let mut files = Vec::new();
    put(&folder, command, &mut files)?;
    let (count, dir) = (files.len(), dir.display());
    println!("{count} pages in {dir}");
    out::answer(&super::answer::Files { files });
    Ok(Verdict::Pass)
}

/// Writes the pages of `command` and of all its subcommands.
fn put(folder: &Folder, command: clap::Command, files: &mut Vec<String>) -> Result<(), CliError> {
    for below in command.get_subcommands() {
        if below.get_name() != "help" {
            put(folder, below.clone(), files)?;
        }
    }
    // In a built command this is the full name with hyphens: hilrig-map-diff.
    let name = command.get_display_name().unwrap_or(command.get_name());
    let file = format!("{name}.1");
    folder.put(&file, page(command)?)?;
    files.push(file);
    Ok(())
}

fn page(command: clap::Command) -> Result<Vec<u8>, CliError> {
    let mut page = Vec::new();
    let rendered = Man::new(command).render(&mut page);
    rendered.map_err(|error| CliError::write("the page", error))?;
    Ok(page)
}
