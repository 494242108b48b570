//! Progress of long work on a terminal, with the remaining time. Files and pipes get none.

use core::time::Duration;
use std::io::{self, IsTerminal as _};

/// Whether standard error is a terminal.
pub(super) fn is_watched() -> bool {
    io::stderr().is_terminal()
}

/// Minimum share of finished work for an estimate of the remaining time.
const SHARE_MIN: f64 = 0.02;

/// `, about 12 s left`, for work of which `share` (0 to 1) took `elapsed`; empty while it is too
/// early for an estimate.
pub(super) fn left(elapsed: Duration, share: f64) -> String {
    if !(SHARE_MIN..1.0).contains(&share) {
        return String::new();
    }
    let left_s = elapsed.as_secs_f64() * (1.0 - share) / share;
    let shown = match left_s {
        ..90.0 => format!("{left_s:.0} s"),
        ..5400.0 => format!("{:.0} min", left_s / 60.0),
        _ => format!("{:.1} h", left_s / 3600.0),
    };
    format!(", about {shown} left")
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::left;

    /// A quarter took 10 s, so the other three quarters take 30 s.
    #[test]
    fn the_rest_takes_as_long_as_what_is_done() {
        let after = |seconds, share| left(Duration::from_secs(seconds), share);
        assert_eq!(after(10, 0.25), ", about 30 s left");
        assert_eq!(after(600, 0.5), ", about 10 min left");
        assert_eq!(after(3600, 0.2), ", about 4.0 h left");
        assert_eq!(after(10, 0.019), "");
        assert_eq!(after(10, 1.0), "");
        assert_eq!(after(10, f64::NAN), "");
    }
}
