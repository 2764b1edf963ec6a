//! What the program says. A reader that has gone (`2>/dev/full`, `| head`, an ssh that died) is no reason to end a run, so
//! nothing here fails.

/// A line on stderr.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($text)*);
    }};
}

/// A line on stdout.
macro_rules! print_line {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($text)*);
    }};
}

pub(super) use {print_line, say};
