//! Pauses of a line that end a partial frame, by the times of a capture.

use core::time::Duration;

use protocols::{Instant, LineConfig};

use crate::Section;
use engine::codec::{Codec, Pause};

/// Pause within a frame that the clock of an operating system can show where the line had none: an
/// FTDI adapter hands on its bytes every 16 ms, and a busy computer reads them late.
pub const JITTER: Duration = Duration::from_millis(50);

/// Whether the times of a capture are exact: those of a run in virtual time.
pub fn is_exact(sections: &[Section]) -> bool {
    let fact = |key| sections.first().and_then(|section| section.fact(key));
    fact("clock") == Some("virtual") && fact("imported").is_none()
}

/// The judgement of pauses. Without a capture, its times count as exact.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pauses {
    has_jitter: bool,
}

impl Pauses {
    /// The judgement for a capture with these sections.
    pub fn of(sections: &[Section]) -> Self {
        Self {
            has_jitter: !is_exact(sections),
        }
    }

    /// Maximum pause within a frame of `codec`. `is_turned` tells that the other end has sent since
    /// the last byte: a pause may then be the only end of a frame of unknown length.
    pub fn limit(self, codec: Option<&Codec>, is_turned: bool) -> Duration {
        let Some(codec) = codec else {
            return engine::codec::IDLE;
        };
        let is_tolerant = match codec.pause() {
            Pause::Discards => true,
            Pause::EndsUnknown => !is_turned,
            Pause::Ends => false,
        };
        match self.has_jitter && is_tolerant {
            true => codec.idle().max(JITTER),
            false => codec.idle(),
        }
    }

    /// Pause between `last` and the first of `len` bytes. `at` is the time of the last of these
    /// bytes, so the bytes themselves need a part of the time between.
    pub fn between(last: Instant, at: Instant, len: usize, line: LineConfig) -> Duration {
        let own = match line.baud {
            // The rate is unknown.
            0 | 1 => Duration::ZERO,
            _ => line.bytes_time(len as u64),
        };
        (at - last).saturating_sub(own)
    }
}
