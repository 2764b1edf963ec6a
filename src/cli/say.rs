//! What the program says. A reader that has gone (`2>/dev/full`, `| head`, an ssh that died) is no reason to end a run, so
//! nothing here fails.

/// A line on stderr.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), "{}", $crate::cli::say::harmless(&format!($($text)*)));
    }};
}

/// A line on stdout.
macro_rules! print_line {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), "{}", $crate::cli::say::harmless(&format!($($text)*)));
    }};
}

pub(super) use {print_line, say};

/// A text whose control characters do nothing: names of logs and topics are input, and a terminal executes control characters.
pub fn harmless(text: &str) -> String {
    let mut harmless = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '\n' | '\t' => harmless.push(character),
            control if control.is_control() => harmless.extend(control.escape_default()),
            other => harmless.push(other),
        }
    }
    harmless
}

#[cfg(test)]
mod tests {
    use super::harmless;

    #[test]
    fn control_characters_do_nothing() {
        assert_eq!(harmless("a\u{1b}]0;owned\u{7}b\u{9b}31m\tc\nd\r"), "a\\u{1b}]0;owned\\u{7}b\\u{9b}31m\tc\nd\\r");
        assert_eq!(harmless("Größe 3 m²"), "Größe 3 m²");
    }
}
