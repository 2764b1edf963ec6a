//! Arguments -> configuration -> run -> exit code.

use clap::{CommandFactory as _, Parser, Subcommand};
use ipslam::config::ConfigError;
use say::say;
use std::process::ExitCode;

mod backend;
mod bench;
mod configuration;
mod convert;
mod dataset;
mod devices;
mod eval;
mod help;
mod interrupt;
mod localize;
mod log;
mod output;
mod progress;
mod recording;
mod replay;
#[cfg(feature = "record")]
mod replay_semantic;
mod run;
mod say;
mod semantic;
mod simulate;
mod summary;
mod truth;
mod view;
mod visual_inertial;
mod workload;

const EXIT_CODES: &str = "Exit codes:
  0    all went well
  1    something failed; what could be written was written, and each failure is reported
  2    wrong usage: an option or a value of the configuration cannot be
  130  interrupted; what was done until then was written";

const FAILED: u8 = 1;
const WRONG_USAGE: u8 = 2;

#[derive(Parser)]
#[command(version, about, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    #[command(after_help = EXIT_CODES)]
    Run(Box<run::RunArgs>),
    #[command(after_help = EXIT_CODES)]
    Localize(Box<localize::LocalizeArgs>),
    #[command(after_help = EXIT_CODES)]
    Semantic(semantic::SemanticArgs),
    #[command(after_help = EXIT_CODES)]
    Replay(Box<replay::ReplayArgs>),
    #[command(after_help = EXIT_CODES)]
    View(view::ViewArgs),
    #[command(after_help = EXIT_CODES)]
    Eval(eval::EvalArgs),
    #[command(after_help = EXIT_CODES)]
    Simulate(simulate::SimulateArgs),
    #[command(after_help = EXIT_CODES)]
    Devices(devices::DevicesArgs),
    #[command(after_help = EXIT_CODES)]
    Bench(bench::BenchArgs),
    Convert(convert::ConvertArgs),
    Completions(help::CompletionsArgs),
    Man(help::ManArgs),
}

/// Runs the command line.
pub fn main() -> ExitCode {
    // Graphics drivers complain on stderr where a session has no such folder, which is none of the user's business.
    if cfg!(target_os = "linux") && std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("XDG_RUNTIME_DIR", std::env::temp_dir()) };
    }
    // A device that panics is reported as an error.
    let default_hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !ipslam::gpu::is_guarded() {
            default_hook(panic);
        }
    }));
    let errors = match Cli::parse().command {
        Command::Run(args) => run::run(&args).unwrap_or_else(|error| vec![error]),
        Command::Localize(args) => localize::localize(&args).unwrap_or_else(|error| vec![error]),
        Command::Semantic(args) => semantic::semantic(&args).unwrap_or_else(|error| vec![error]),
        Command::Replay(args) => replay::replay(&args).unwrap_or_else(|error| vec![error]),
        Command::View(args) => view::view(&args).err().into_iter().collect(),
        Command::Eval(args) => eval::eval(&args).err().into_iter().collect(),
        Command::Simulate(args) => simulate::simulate(&args).err().into_iter().collect(),
        Command::Devices(args) => devices::devices(&args).unwrap_or_else(|error| vec![error]),
        Command::Bench(args) => bench::bench(&args).unwrap_or_else(|error| vec![error]),
        Command::Convert(args) => convert::convert(&args).err().into_iter().collect(),
        Command::Completions(args) => help::completions(&args, Cli::command()).err().into_iter().collect(),
        Command::Man(args) => help::man(&args, Cli::command()).err().into_iter().collect(),
    };
    for error in &errors {
        say!("error: {}", with_causes(error));
    }
    match &errors[..] {
        [] if interrupt::happened() => interrupt::EXIT_CODE.into(),
        [] => ExitCode::SUCCESS,
        [error, ..] if error.is::<ConfigError>() => WRONG_USAGE.into(),
        _ => FAILED.into(),
    }
}

/// An error and its causes, but for those that it tells itself.
fn with_causes(error: &anyhow::Error) -> String {
    error
        .chain()
        .skip(1)
        .map(ToString::to_string)
        .fold(error.to_string(), |text, cause| if text.contains(&cause) { text } else { format!("{text}: {cause}") })
}
