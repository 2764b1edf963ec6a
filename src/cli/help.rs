//! `ipslam completions` and `ipslam man`: what shells and manuals want to know of the command line.

use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use std::io::Write as _;

/// Prints completions of options and values for a shell.
#[derive(Debug, clap::Args)]
#[command(after_help = "For bash, say: ipslam completions bash > ~/.local/share/bash-completion/completions/ipslam")]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the manual page, the commands' own pages after it.
#[derive(Debug, clap::Args)]
#[command(after_help = "To read it: ipslam man | man -l -")]
pub struct ManArgs {}

/// Prints the completions.
pub fn completions(args: &CompletionsArgs, mut command: Command) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "ipslam", &mut script);
    Ok(std::io::stdout().write_all(&script)?)
}

/// Prints the manual.
pub fn man(_: &ManArgs, mut command: Command) -> anyhow::Result<()> {
    // Named in full, `ipslam run`.
    command.build();
    let mut pages = Vec::new();
    Man::new(command.clone()).render(&mut pages)?;
    for subcommand in command.get_subcommands().filter(|subcommand| subcommand.get_name() != "help") {
        Man::new(subcommand.clone()).render(&mut pages)?;
    }
    Ok(std::io::stdout().write_all(&pages)?)
}
