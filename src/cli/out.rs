//! Standard output of the commands. A reader who has seen enough, such as `head -1`, ends no
//! command: what follows is not written, and work and exit code stay what they are.

use core::fmt::Arguments;
use core::sync::atomic::{AtomicBool, Ordering};
use std::io::{self, ErrorKind, Write as _};

/// Whether somebody was told that standard output cannot be written.
static TOLD: AtomicBool = AtomicBool::new(false);

/// Writes `text`. Other errors than a closed pipe, a full disk for one, are told once.
pub(super) fn write(text: Arguments<'_>) {
    let written = io::stdout().lock().write_fmt(text);
    let failed = written
        .err()
        .filter(|error| error.kind() != ErrorKind::BrokenPipe);
    if let Some(error) = failed
        && !TOLD.swap(true, Ordering::Relaxed)
    {
        eprintln!("cannot write to standard output: {error}");
    }
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
