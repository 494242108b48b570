//! Output of the commands. A reader that closes early, such as `head -1`, ends no command: the rest
//! is not written, and work and exit code stay the same. On a full disk the command finishes its
//! work, but does not exit with 0.
//!
//! With `--json` standard output carries one object, the command's result; human-readable lines go
//! to standard error. On a terminal, verdicts in these lines are coloured.

use core::fmt::Arguments;
use core::sync::atomic::{AtomicBool, Ordering};
use std::borrow::Cow;
use std::env;
use std::io::{self, ErrorKind, IsTerminal as _, Write};
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use serde_json::Value;

use super::answer::Text;
use super::{CliError, Verdict};

/// Whether the failure of standard output was reported.
static TOLD: AtomicBool = AtomicBool::new(false);
/// Whether standard output is reserved for the object of `--json`.
static JSON: AtomicBool = AtomicBool::new(false);
/// Whether verdicts are coloured.
static COLOURED: AtomicBool = AtomicBool::new(false);
/// The result of the command, for `--json`.
static ANSWER: Mutex<Option<Value>> = Mutex::new(None);

/// Sets destination and colours of human-readable lines, before any is written.
pub(super) fn begin(json: bool) {
    JSON.store(json, Ordering::Relaxed);
    let is_set = |name| env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = env::var_os("TERM").is_some_and(|term| term == "dumb");
    let coloured = !json && io::stdout().is_terminal() && !is_set("NO_COLOR") && !is_dumb;
    COLOURED.store(coloured, Ordering::Relaxed);
}

/// Whether the command was given `--json`.
pub(super) fn is_json() -> bool {
    JSON.load(Ordering::Relaxed)
}

/// Sets the result of the command, which `--json` prints at the end.
pub(super) fn answer(answer: &impl Serialize) {
    if is_json() {
        let value = serde_json::to_value(answer).expect("plain data with string keys");
        let before = ANSWER
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .replace(value);
        debug_assert!(before.is_none(), "a command has one result");
    }
}

/// The value given to [`answer`].
pub(super) fn take_answer() -> Option<Value> {
    let mut answer = ANSWER.lock().unwrap_or_else(PoisonError::into_inner);
    answer.take()
}

/// Writes to standard output. A reader that closes early is no error.
///
/// # Errors
/// Errors of the operating system.
pub(super) fn write_all(text: &[u8]) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(()),
    }
}

/// Prints text that is the command's result; `what` names it.
///
/// # Errors
/// If it cannot be written. A reader that closes early is no error.
pub(super) fn write_text(what: &str, text: &[u8]) -> Result<Verdict, CliError> {
    if is_json() {
        let text = String::from_utf8_lossy(text).into_owned();
        answer(&Text { text });
        return Ok(Verdict::Pass);
    }
    write_all(text).map_err(|error| CliError::write(what, error))?;
    Ok(Verdict::Pass)
}

/// Writes `text` to standard output. Errors other than a closed pipe, such as a full disk, are
/// reported once.
pub(super) fn write(text: Arguments<'_>) {
    let written = match (is_json(), COLOURED.load(Ordering::Relaxed)) {
        (true, _) => return write_err(text),
        (false, true) => {
            let text = text.to_string();
            io::stdout().lock().write_all(painted(&text).as_bytes())
        }
        (false, false) => io::stdout().lock().write_fmt(text),
    };
    let failed = written
        .err()
        .filter(|error| error.kind() != ErrorKind::BrokenPipe);
    if let Some(error) = failed
        && !TOLD.swap(true, Ordering::Relaxed)
    {
        // The macro of the standard library would panic if standard error is full too.
        write_err(format_args!("cannot write to standard output: {error}\n"));
    }
}

/// Whether a write to standard output failed for another reason than a closed pipe.
pub(super) fn is_incomplete() -> bool {
    TOLD.load(Ordering::Relaxed)
}

/// Writes `text` to standard error. A failure to write is ignored.
pub(super) fn write_err(text: Arguments<'_>) {
    let _ = io::stderr().lock().write_fmt(text);
}

/// Verdict words at the beginning of a line, and their colours.
const PAINT: [(&str, &str); 5] = [
    ("PASS", "\x1b[1;32m"),
    ("FAIL", "\x1b[1;31m"),
    ("ok", "\x1b[32m"),
    ("DIVERGENCE", "\x1b[1;31m"),
    ("--", "\x1b[33m"),
];

/// `text` with its verdicts coloured, line by line.
fn painted(text: &str) -> Cow<'_, str> {
    let mut out = String::new();
    for line in text.split_inclusive('\n') {
        let word = line.trim_start_matches(' ');
        let is_it = |(verdict, _): &&(&str, &str)| {
            let rest = word.strip_prefix(verdict);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', '\n']))
        };
        match PAINT.iter().find(is_it) {
            Some((verdict, colour)) => {
                let (blanks, rest) = (&line[..line.len() - word.len()], &word[verdict.len()..]);
                out += &format!("{blanks}{colour}{verdict}\x1b[0m{rest}");
            }
            None => out += line,
        }
    }
    Cow::Owned(out)
}

/// Like the standard library's macro, but does not panic on a closed pipe.
macro_rules! print {
    ($($text:tt)*) => { $crate::cli::out::write(format_args!($($text)*)) };
}

/// As `print`, with a line end.
macro_rules! println {
    () => { $crate::cli::out::write(format_args!("\n")) };
    ($($text:tt)*) => {
        $crate::cli::out::write(format_args!("{}\n", format_args!($($text)*)))
    };
}

/// Like the standard library's macro, but does not panic on a closed pipe.
macro_rules! eprintln {
    () => { $crate::cli::out::write_err(format_args!("\n")) };
    ($($text:tt)*) => {
        $crate::cli::out::write_err(format_args!("{}\n", format_args!($($text)*)))
    };
}

#[cfg(test)]
mod tests {
    use super::painted;

    /// SGR 1;32 is bold green, 1;31 bold red, 32 green, 0 the end of it (ECMA-48).
    #[test]
    fn only_the_verdict_at_the_beginning_of_a_line_is_coloured() {
        assert_eq!(
            painted("PASS a\n  ok   b\n  FAIL c: PASS\n"),
            "\x1b[1;32mPASS\x1b[0m a\n  \x1b[32mok\x1b[0m   b\n  \x1b[1;31mFAIL\x1b[0m c: PASS\n"
        );
        for plain in ["PASSED x\n", "  a PASS\n", "okay\n", "", "\n"] {
            assert_eq!(painted(plain), plain);
        }
    }
}
