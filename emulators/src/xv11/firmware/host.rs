//! Input from the host: only the sequence that opens the console has an effect.

use protocols::Instant;

use super::{Firmware, Phase};
use crate::xv11::Xv11;

const ESC: u8 = 0x1B;
/// Maximum number of bytes shown with a violation.
const SHOWN_BYTES: usize = 64;

impl Xv11 {
    pub(in crate::xv11) fn host_bytes(&mut self, now: Instant, bytes: &[u8]) {
        if matches!(self.firmware.phase, Phase::Off | Phase::Console) {
            return;
        }
        for &byte in bytes {
            self.firmware.escapes = if byte == ESC {
                self.firmware.escapes + 1
            } else {
                0
            };
            if self.firmware.escapes == 3 {
                self.open_console(now, "three ESC");
                return;
            }
        }
        if bytes.iter().any(|&byte| byte != ESC) {
            let detail = format!("{} bytes; the sensor takes no request", bytes.len());
            let shown = &bytes[..bytes.len().min(SHOWN_BYTES)];
            self.log.violation(now, "host-bytes", detail, shown);
        }
    }

    /// Opens the console, which ends the stream. Its answers are not known, and only a power cycle
    /// ends it.
    pub(in crate::xv11) fn open_console(&mut self, now: Instant, by: &str) {
        if matches!(self.firmware.phase, Phase::Off | Phase::Console) {
            return;
        }
        self.uart.reset(now);
        self.uart.print(now, "\n\r#");
        self.firmware = Firmware {
            phase: Phase::Console,
            ..Firmware::new()
        };
        self.log
            .note(now, "console", format!("console opened by {by}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xv11::{Config, State};

    /// A sensor after these pieces of bytes: its state and the violations, each with the bytes that
    /// it shows.
    fn after(pieces: &[&[u8]]) -> (State, Vec<(String, usize)>) {
        let mut lidar = Xv11::new("lidar", 1, Config::default());
        for (second, piece) in (1..).zip(pieces) {
            lidar.host_bytes(Instant::from_secs(second), piece);
        }
        let events = lidar.log.take().into_iter();
        let violations = events.filter(|event| event.rule == "host-bytes");
        let told = violations.map(|event| (event.detail, event.bytes.len()));
        (lidar.state(), told.collect())
    }

    /// Three in a row, in however many pieces, and no other byte between them.
    #[test]
    fn three_escapes_open_the_console() {
        assert_eq!(after(&[&[ESC; 3]]), (State::Console, vec![]));
        assert_eq!(after(&[&[ESC], &[ESC], &[ESC]]), (State::Console, vec![]));
        assert_eq!(after(&[&[ESC; 2]]), (State::Boot, vec![]));
        let one = || ("1 bytes; the sensor takes no request".to_owned(), 1);
        let torn = after(&[&[ESC; 2], b"x", &[ESC; 2]]);
        assert_eq!(torn, (State::Boot, vec![one()]));
        // A console takes all bytes.
        assert_eq!(after(&[&[ESC; 3], b"help"]), (State::Console, vec![]));
    }

    #[test]
    fn a_violation_shows_64_bytes_at_most() {
        let told = |len: usize| after(&[&vec![b'x'; len]]).1;
        let expected = |len: usize, shown: usize| {
            vec![(format!("{len} bytes; the sensor takes no request"), shown)]
        };
        assert_eq!(told(64), expected(64, 64));
        assert_eq!(told(65), expected(65, 64));
    }
}
