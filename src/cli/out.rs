//! Standard output of the commands. A reader who has seen enough, such as `head -1`, ends no
//! command: what follows is not written, and work and exit code stay what they are.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether somebody was told that standard output cannot be written.
static TOLD: AtomicBool = AtomicBool::new(false);

/// Writes `text`. Other errors than a closed pipe, a full disk for one, are told once.
pub(super) fn write(text: Arguments<'_>) {
    match io::stdout().lock().write_fmt(text) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            if !TOLD.swap(true, Ordering::Relaxed) {
                eprintln!("cannot write to standard output: {error}");
            }
        }
        _ => {}
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
