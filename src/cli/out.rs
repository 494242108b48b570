//! What the commands say. A reader that closes early, such as `head -1`, ends no command: what
//! follows is not written, and work and exit code stay what they are. On a full disk the work is
//! done as well, but the command does not exit with 0.
//!
//! With `--json` standard output carries one object, what the command came to; lines for people go
//! to standard error then. On a terminal the verdicts among those lines are coloured.

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
/// Whether standard output is for the object of `--json` alone.
static JSON: AtomicBool = AtomicBool::new(false);
/// Whether verdicts are coloured.
static COLOURED: AtomicBool = AtomicBool::new(false);
/// What the command came to, for `--json`.
static ANSWER: Mutex<Option<Value>> = Mutex::new(None);

/// Decides where lines for people go and how they look, before any is written.
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

/// Sets what the command came to, which `--json` prints in the end.
pub(super) fn answer(answer: &impl Serialize) {
    if is_json() {
        let value = serde_json::to_value(answer).expect("plain data with string keys");
        *ANSWER.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
    }
}

/// What [`answer`] was given.
pub(super) fn take_answer() -> Option<Value> {
    let mut answer = ANSWER.lock().unwrap_or_else(PoisonError::into_inner);
    answer.take()
}

/// Writes to standard output. A reader that closes early is no error.
///
/// # Errors
/// What the system says.
pub(super) fn write_all(text: &[u8]) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(()),
    }
}

/// Prints text that is itself what a command came to; `what` names it.
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

/// Writes `text` to standard output. Other errors than a closed pipe, a full disk for one, are
/// told once.
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
        // The library's own macro would panic if standard error is as full.
        write_err(format_args!("cannot write to standard output: {error}\n"));
    }
}

/// Whether something could not be written to standard output, for another reason than that its
/// reader has seen enough.
pub(super) fn is_incomplete() -> bool {
    TOLD.load(Ordering::Relaxed)
}

/// Writes `text` to standard error. A failure to write is ignored.
pub(super) fn write_err(text: Arguments<'_>) {
    let _ = io::stderr().lock().write_fmt(text);
}

/// Words at the beginning of a line that are a verdict, and their colours.
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

/// As that of the standard library, which panics if the reader is gone.
macro_rules! print {
    ($($text:tt)*) => { $crate::cli::out::write(format_args!($($text)*)) };
}

/// The same with the line's end.
macro_rules! println {
    () => { $crate::cli::out::write(format_args!("\n")) };
    ($($text:tt)*) => {
        $crate::cli::out::write(format_args!("{}\n", format_args!($($text)*)))
    };
}

/// As that of the standard library, which panics if the reader is gone.
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
