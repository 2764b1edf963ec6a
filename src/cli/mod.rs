//! Arguments -> configuration -> run -> exit code.

mod eval;
mod simulate;

/// Runs the command line.
pub fn main() -> std::process::ExitCode {
    std::process::ExitCode::SUCCESS
}
