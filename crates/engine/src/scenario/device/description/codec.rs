//! A described device's frames as a row of the table of wire formats.

use std::sync::{Arc, Mutex, PoisonError};

use ::description::{Cutter, Description, Frame, From};
use protocols::{Decode as _, FrameError};

use crate::codec::wire::Choices;
use crate::codec::{self, AnyDecoder, Codec, OwnFormat, Pause};
use crate::rig::line::Direction;

struct Described(Arc<Description>);

#[derive(Clone)]
struct Reader {
    description: Arc<Description>,
    cutter: Cutter,
    from: From,
    last: Option<Frame>,
}

impl Reader {
    fn new(description: &Arc<Description>, from: From) -> Self {
        Self {
            description: description.clone(),
            cutter: description.cutter_for(from),
            from,
            last: None,
        }
    }
}

impl AnyDecoder for Reader {
    fn step(&mut self, input: &mut &[u8]) -> Option<Result<usize, FrameError>> {
        let outcome = self.cutter.step(input)?;
        Some(outcome.map(|frame| self.last.insert(frame).bytes.len()))
    }

    fn words(&self) -> String {
        let frame = self.last.as_ref();
        frame
            .map(|frame| self.description.words_for(frame, self.from))
            .unwrap_or_default()
    }

    fn idle(&mut self) {
        self.cutter.idle();
    }

    fn pending(&self) -> usize {
        self.cutter.pending()
    }

    fn copy(&self) -> Box<dyn AnyDecoder> {
        Box::new(self.clone())
    }
}

/// The end that sends the bytes in this direction.
const fn sender(direction: Direction) -> From {
    match direction {
        Direction::ToMaster => From::Device,
        Direction::ToDevice => From::Host,
    }
}

impl OwnFormat for Described {
    fn decoder(&self) -> Box<dyn AnyDecoder> {
        Box::new(Reader::new(&self.0, From::Both))
    }

    fn decoder_towards(&self, direction: Direction) -> Box<dyn AnyDecoder> {
        Box::new(Reader::new(&self.0, sender(direction)))
    }

    fn repair(&self, frame: &mut [u8]) {
        self.0.repair(frame);
    }

    fn build(&self, choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let messages = self.0.messages();
        if messages.is_empty() {
            let body: Vec<u8> = choices.take(6).to_vec();
            return out.extend(self.0.frame_of(0, &body).unwrap_or_default());
        }
        let message = &messages[choices.below(messages.len())];
        let values = message.example(&mut |below| {
            let drawn = u64::from(choices.word()) << 16 | u64::from(choices.word());
            let drawn = drawn << 32 | u64::from(choices.word());
            drawn % below.max(1)
        });
        out.extend(self.0.frame(message, &values).unwrap_or_default());
    }

    fn pause(&self) -> Pause {
        match (self.0.needs_silence(), self.0.may_need_silence()) {
            (true, _) => Pause::Ends,
            (false, true) => Pause::EndsUnknown,
            (false, false) => Pause::Discards,
        }
    }

    fn names_of_field(&self, field: &str) -> Option<Vec<&str>> {
        self.0.names_of_field(field)
    }

    fn vocabulary(&self, direction: Direction, beside_texts: bool) -> Option<Vec<&str>> {
        self.0.vocabulary(sender(direction), beside_texts)
    }

    fn other_order(&self) -> Option<Box<dyn OwnFormat>> {
        let other = self.0.with_swapped_checksums()?;
        Some(Box::new(Self(other)))
    }
}

/// Created rows, each with its description.
static ROWS: Mutex<Vec<(Arc<Description>, &'static Codec)>> = Mutex::new(Vec::new());

/// The codec row of a description. Like all rows, it exists until the process ends; a duplicate
/// name gets a number as suffix.
pub fn codec_of(description: &Arc<Description>) -> &'static Codec {
    let mut rows = ROWS.lock().unwrap_or_else(PoisonError::into_inner);
    let is_same = |other: &Arc<Description>| other.is_same(description);
    if let Some((_, row)) = rows.iter().find(|(other, _)| is_same(other)) {
        return row;
    }
    let format: &'static Described = Box::leak(Box::new(Described(description.clone())));
    let about: &'static str = description.about().to_owned().leak();
    for number in 1_u32.. {
        let name = match number {
            1 => description.name().to_owned(),
            number => format!("{}-{number}", description.name()),
        };
        let row = Codec::own(name.leak(), about, format).with_idle(description.idle());
        if let Ok(row) = codec::register(row) {
            rows.push((description.clone(), row));
            return row;
        }
    }
    unreachable!("there are more numbers than rows")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{Count, Counter};

    /// A short and a long frame of each direction: the formats of the sender are tried first.
    #[test]
    fn frames_are_those_of_the_way_that_bytes_go() {
        let text = r#"
            name = "two-ways"
            about = "other frames each way"
            line = { baud = 9600 }
            frame = [{ name = "out", terminator = "\n" }, { name = "in", start = "<", end = ">" }]
            message = [
              { name = "ask", from = "host", frame = "in", text = "?" },
              { name = "ok", from = "device", frame = "out", text = "ok" },
            ]
            on = [{ message = "ask", reply = "ok" }]
        "#;
        let none = |_: &str| Err("no file".to_owned());
        let description = Description::parse("two.toml", text, &none).expect("sound");
        let codec = codec_of(&description);
        let bytes = b"<?\n>";
        for (direction, first) in [(Direction::ToDevice, 0..4), (Direction::ToMaster, 0..3)] {
            let len = first.end - first.start;
            assert_eq!(codec.framed_towards(bytes, direction), len, "{direction:?}");
            assert_eq!(
                codec.frames_towards(bytes, direction),
                core::slice::from_ref(&first)
            );
            let found = codec.found_towards(bytes, direction);
            let frames = found.iter().filter(|one| one.is_frame());
            let frames: Vec<_> = frames.map(|one| one.bytes.clone()).collect();
            assert_eq!(frames, [first], "{direction:?}");
            let mut counter = Counter::towards(codec, direction);
            let counts = [counter.push(bytes), counter.idle()];
            let frames: u64 = counts.iter().map(|count: &Count| count.frames).sum();
            assert_eq!(frames, 1, "{direction:?}");
        }
        // Without a direction, the first matching format of the file is used.
        assert_eq!(codec.framed(bytes), 3);
    }
}
