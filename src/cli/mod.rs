//! Arguments -> configuration -> run -> exit code.

#![allow(rustdoc::broken_intra_doc_links, reason = "help texts have units in brackets")]

use clap::{CommandFactory as _, Parser, Subcommand};
use ipslam::config::ConfigError;
use say::say;
use std::ffi::OsString;
use std::sync::Once;

mod backend;
mod bench;
mod benchmark;
mod configuration;
mod continued;
mod convert;
mod dataset;
mod degrade;
mod detections;
mod devices;
mod eval;
mod help;
mod interrupt;
mod known_map;
#[cfg(feature = "live")]
mod live;
mod localize;
mod log;
mod output;
#[cfg(feature = "images")]
mod pictures;
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
mod threads;
mod truth;
mod view;
mod visual_inertial;
mod workload;

const EXIT_CODES: &str = "Exit codes:
  0    all went well
  1    something failed; what could be written was written, and each failure is reported
  2    wrong usage: an option or a value of the configuration cannot be
  130  interrupted; what was done until then was written";

/// What was asked for cannot be.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct UsageError(String);

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
    #[cfg(feature = "live")]
    #[command(after_help = EXIT_CODES)]
    Live(Box<live::LiveArgs>),
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
    Degrade(degrade::DegradeArgs),
    #[command(after_help = EXIT_CODES)]
    Devices(devices::DevicesArgs),
    #[command(after_help = EXIT_CODES)]
    Bench(bench::BenchArgs),
    #[command(after_help = EXIT_CODES)]
    Benchmark(benchmark::BenchmarkArgs),
    Convert(convert::ConvertArgs),
    Config(configuration::ExplainArgs),
    Completions(help::CompletionsArgs),
    Man(help::ManArgs),
}

/// Runs the command line, its first word the program's name; prints what it has to say and returns the exit code.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let command = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli.command,
        Err(error) => {
            // A reader that has gone is no reason to fail.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(FAILED);
        }
    };
    let (code, errors) = execute(command);
    errors.iter().for_each(|error| say!("error: {error}"));
    code
}

/// The same for a program that goes on after it.
///
/// # Errors
/// The errors that the program would have printed.
pub fn call(arguments: impl IntoIterator<Item = OsString>) -> Result<(), String> {
    let cli = Cli::try_parse_from(arguments).map_err(|error| error.to_string())?;
    match execute(cli.command) {
        (0, _) => Ok(()),
        (interrupt::EXIT_CODE, errors) if errors.is_empty() => Err("interrupted".to_owned()),
        (_, errors) => Err(errors.join("; ")),
    }
}

/// Exit code and errors of a command.
fn execute(command: Command) -> (u8, Vec<String>) {
    // A device that panics is reported as an error.
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let default_hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !ipslam::gpu::is_guarded() {
                default_hook(panic);
            }
        }));
    });
    let errors = match command {
        Command::Run(args) => run::run(&args).unwrap_or_else(|error| vec![error]),
        Command::Localize(args) => localize::localize(&args).unwrap_or_else(|error| vec![error]),
        #[cfg(feature = "live")]
        Command::Live(args) => live::live(&args).unwrap_or_else(|error| vec![error]),
        Command::Semantic(args) => semantic::semantic(&args).unwrap_or_else(|error| vec![error]),
        Command::Replay(args) => replay::replay(&args).unwrap_or_else(|error| vec![error]),
        Command::View(args) => view::view(&args).err().into_iter().collect(),
        Command::Eval(args) => eval::eval(&args).err().into_iter().collect(),
        Command::Simulate(args) => simulate::simulate(&args).err().into_iter().collect(),
        Command::Degrade(args) => degrade::degrade(&args).err().into_iter().collect(),
        Command::Devices(args) => devices::devices(&args).unwrap_or_else(|error| vec![error]),
        Command::Bench(args) => bench::bench(&args).unwrap_or_else(|error| vec![error]),
        Command::Benchmark(args) => benchmark::benchmark(&args).unwrap_or_else(|error| vec![error]),
        Command::Convert(args) => convert::convert(&args).err().into_iter().collect(),
        Command::Config(args) => configuration::explain(&args).err().into_iter().collect(),
        Command::Completions(args) => help::completions(&args, Cli::command()).err().into_iter().collect(),
        Command::Man(args) => help::man(&args, Cli::command()).err().into_iter().collect(),
    };
    let code = match &errors[..] {
        [] if interrupt::happened() => interrupt::EXIT_CODE,
        [] => 0,
        [error, ..] if error.is::<ConfigError>() || error.is::<UsageError>() => WRONG_USAGE,
        _ => FAILED,
    };
    interrupt::forget();
    (code, errors.iter().map(with_causes).collect())
}

/// An error and its causes, except those whose text it already contains.
fn with_causes(error: &anyhow::Error) -> String {
    error
        .chain()
        .skip(1)
        .map(ToString::to_string)
        .fold(error.to_string(), |text, cause| if text.contains(&cause) { text } else { format!("{text}: {cause}") })
}
