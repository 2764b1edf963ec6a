//! The `ipslam` command: arguments in, exit code out.

fn main() -> std::process::ExitCode {
    // Graphics drivers complain on stderr where a session has no such folder, which is none of the user's business.
    if cfg!(target_os = "linux") && std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("XDG_RUNTIME_DIR", std::env::temp_dir()) };
    }
    ipslam::cli::main(std::env::args_os()).into()
}
