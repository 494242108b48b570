use clap::{Args, CommandFactory as _};
use clap_complete::{Shell, generate};

use super::{Cli, CliError, Verdict, out};

/// Print the completions of all commands and options for a shell.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig completions bash > ~/.local/share/bash-completion/completions/hilrig\n  \
    hilrig completions zsh > ~/.zfunc/_hilrig          # a folder of $fpath\n  \
    hilrig completions fish > ~/.config/fish/completions/hilrig.fish")]
pub(super) struct CompletionsArgs {
    /// Name of the shell
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

pub(super) fn run(args: &CompletionsArgs) -> Result<Verdict, CliError> {
    let mut script = Vec::new();
    generate(args.shell, &mut Cli::command(), "hilrig", &mut script);
    out::write_text("the completions", &script)
}
