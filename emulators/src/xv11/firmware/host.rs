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
