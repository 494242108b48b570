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
    use engine::rig::line::Direction;
    use engine::scenario::device::description::codec_of;

    use super::*;
    use crate::decode::transcript::Transcript;
    use crate::{Interface, Kind, Record};

    fn codec(name: &str, framing: &str) -> &'static Codec {
        let text = format!(
            "name = \"{name}\"\nabout = \"a meter\"\nline = {{ baud = 9600 }}\n\
             frame = {{ {framing} }}\n\
             message = [{{ name = \"value\", from = \"device\", fields = \
             [{{ type = \"u8\", value = 1 }}, {{ type = \"u16be\", name = \"x\", calc = \"1\" }}] }}]\n\
             every = [{{ period = \"1s\", send = [\"value\"] }}]\n"
        );
        let none = |_: &str| Err("no file".to_owned());
        let description = ::description::Description::parse("own.toml", &text, &none);
        codec_of(&description.expect("a sound description"))
    }

    /// Number of frames in two records with this pause between.
    fn frames(codec: &'static Codec, clock: &str, millis: u64, bytes: [&[u8]; 2]) -> usize {
        let section = Section {
            about: format!("clock={clock}"),
            ..Section::default()
        };
        let mut transcript = Transcript::new(Some(codec)).pausing(Pauses::of(&[section]));
        let link = Interface::new("x", 9_600);
        for (at, bytes) in [10, 10 + millis].into_iter().zip(bytes) {
            let record = Record {
                link: 0,
                sequence: None,
                at: Instant::from_millis(at),
                direction: Direction::ToMaster,
                kind: Kind::Data,
                bytes: bytes.to_vec().into(),
                sent: None,
                pieces: Vec::new(),
                comment: String::new(),
            };
            transcript.record(&record, &link);
        }
        let all = transcript.finish();
        all.filter(|one| one.said.to_string().contains("value"))
            .count()
    }

    /// An FTDI adapter delivers a frame of 4 bytes in two records 16 ms apart. The bytes tell its
    /// length, so it is one frame, except by an exact clock or after a long silence. Where only a
    /// silence ends a frame, it remains the end.
    #[test]
    fn a_pause_of_an_adapter_does_not_cut_a_frame() {
        let halves: [&[u8]; 2] = [&[1, 0], &[5, 6]];
        let fixed = codec(
            "fixed-meter",
            "idle = \"4ms\", size = 4, checksum = \"sum8\"",
        );
        assert_eq!(frames(fixed, "unix", 16, halves), 1);
        assert_eq!(frames(fixed, "unix", 2_000, halves), 0);
        assert_eq!(frames(fixed, "virtual", 16, halves), 0);
        assert_eq!(frames(fixed, "virtual", 5, halves), 1);
        let silent = codec("silent-meter", "silence = 3.5, checksum = \"sum8\"");
        assert_eq!(
            frames(silent, "unix", 16, [&[1, 0, 5, 6], &[1, 0, 5, 6]]),
            2
        );
    }
}
