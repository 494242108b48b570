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

#[cfg(test)]
mod tests {
    use super::*;
    use engine::codec;

    fn section(about: &str) -> Section {
        Section {
            about: about.to_owned(),
            ..Section::default()
        }
    }

    /// Times are exact if the first section is of a run in virtual time, and not imported.
    #[test]
    fn only_virtual_time_is_exact() {
        for (abouts, expected) in [
            (&["clock=virtual"][..], true),
            (&["clock=unix"], false),
            (&["clock=virtual\nimported=hex"], false),
            (&["robot=x"], false),
            (&["clock=unix", "clock=virtual"], false),
            (&["clock=virtual", "clock=unix"], true),
            (&[], false),
        ] {
            let sections: Vec<Section> = abouts.iter().map(|about| section(about)).collect();
            assert_eq!(is_exact(&sections), expected, "{abouts:?}");
        }
    }

    /// 50 ms, by a clock that is not exact, for a protocol whose bytes tell the length.
    #[test]
    fn a_pause_of_the_clock_is_allowed_in_a_frame_of_known_length() {
        let exact = Pauses::of(&[section("clock=virtual")]);
        let other = Pauses::of(&[]);
        assert_eq!(other.limit(None, false), codec::IDLE);
        let codec = &codec::RPLIDAR;
        assert_eq!(codec.pause(), Pause::Discards);
        assert_eq!(exact.limit(Some(codec), false), codec.idle());
        for is_turned in [false, true] {
            let limit = other.limit(Some(codec), is_turned);
            assert_eq!(limit, codec.idle().max(JITTER));
        }
    }

    /// At 10,000 baud a byte takes a millisecond. At an unknown rate it takes no time.
    #[test]
    fn bytes_take_a_part_of_the_time_before_them() {
        let between = |baud| {
            let [last, at] = [10, 15].map(Instant::from_millis);
            Pauses::between(last, at, 3, LineConfig::new_8n1(baud)).as_micros()
        };
        assert_eq!([0, 1, 10_000, 1_000].map(between), [5_000, 5_000, 2_000, 0]);
        // At 2 baud three bytes take 15 s.
        assert_eq!(between(2), 0);
    }
}
