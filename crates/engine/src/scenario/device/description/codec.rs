//! A described device's frames as a row of the table of wire formats.

use std::sync::{Arc, Mutex, PoisonError};

use ::description::{Asked, Cutter, Description, Frame, From};
use protocols::{Decode as _, FrameError};

use crate::codec::wire::Choices;
use crate::codec::{self, AnyDecoder, Codec, OwnFormat, Pause};
use crate::rig::line::Direction;

/// The description of a line, and those of devices with other registers by their addresses.
#[derive(Clone)]
struct Described(Arc<Description>, Arc<[Unit]>);

/// A device of a line: its address and its description.
type Unit = (u32, Arc<Description>);

#[derive(Clone)]
struct Reader {
    of: Described,
    cutter: Cutter,
    from: From,
    last: Option<Frame>,
    /// Decodes the requests of the other direction, because a reply is decoded with the last
    /// request.
    requests: Option<Cutter>,
    asked: Option<Asked>,
    /// The request to which the last frame is the reply.
    replied: Option<Asked>,
}

impl Described {
    /// The description of the device that a frame names.
    fn of(&self, frame: &Frame) -> &Arc<Description> {
        let Self(first, units) = self;
        let address = first.addressee(frame).map(u32::from);
        let unit = units.iter().find(|(own, _)| Some(*own) == address);
        unit.map_or(first, |(_, description)| description)
    }

    /// Names of all devices of the line, each once.
    fn each<'a>(
        &'a self,
        names: &dyn Fn(&'a Description) -> Option<Vec<&'a str>>,
    ) -> Option<Vec<&'a str>> {
        let mut all = names(&self.0)?;
        for (_, other) in self.1.iter() {
            for name in names(other)? {
                if !all.contains(&name) {
                    all.push(name);
                }
            }
        }
        Some(all)
    }
}

impl Reader {
    fn new(of: &Described, from: From) -> Self {
        let needs_requests = of.0.protocol().is_some() && from == From::Device;
        Self {
            of: of.clone(),
            cutter: of.0.cutter_for(from),
            from,
            last: None,
            requests: needs_requests.then(|| of.0.cutter_for(From::Host)),
            asked: None,
            replied: None,
        }
    }
}

impl AnyDecoder for Reader {
    fn step(&mut self, input: &mut &[u8]) -> Option<Result<usize, FrameError>> {
        let outcome = self.cutter.step(input)?;
        Some(outcome.map(|frame| {
            match self.of.0.asked(&frame, self.from) {
                Some(asked) => self.asked = Some(asked),
                None => self.replied = self.asked.take(),
            }
            self.last.insert(frame).bytes.len()
        }))
    }

    fn words(&self) -> String {
        let words = |frame| {
            let of = self.of.of(frame);
            of.words_asked(frame, self.from, self.replied)
        };
        self.last.as_ref().map(words).unwrap_or_default()
    }

    fn beside(&mut self, mut bytes: &[u8]) {
        let Some(requests) = &mut self.requests else {
            return;
        };
        while let Some(outcome) = requests.step(&mut bytes) {
            if let Ok(frame) = outcome
                && let Some(asked) = self.of.0.asked(&frame, From::Host)
            {
                self.asked = Some(asked);
            }
        }
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
        Box::new(Reader::new(self, From::Both))
    }

    fn decoder_towards(&self, direction: Direction) -> Box<dyn AnyDecoder> {
        Box::new(Reader::new(self, sender(direction)))
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
        // A register that one device lacks may have any value there.
        match self.1.is_empty() {
            true => self.0.names_of_field(field),
            false => None,
        }
    }

    fn field_names(&self, direction: Direction) -> Option<Vec<&str>> {
        self.each(&|one| one.shown_fields(sender(direction)))
    }

    fn vocabulary(&self, direction: Direction, beside_texts: bool) -> Option<Vec<&str>> {
        self.each(&|one| one.vocabulary(sender(direction), beside_texts))
    }

    fn other_order(&self) -> Option<Box<dyn OwnFormat>> {
        let other = self.0.with_swapped_checksums()?;
        Some(Box::new(Self(other, self.1.clone())))
    }
}

/// Created rows, each with its description.
static ROWS: Mutex<Vec<(Described, &'static Codec)>> = Mutex::new(Vec::new());

/// The codec row of a line with several devices; the first one gives its frames.
pub(super) fn codec_of_all(units: &[Unit]) -> Option<&'static Codec> {
    let (_, first) = units.first()?;
    let is_modbus = units.iter().all(|(_, one)| one.protocol().is_some());
    let are_alike = units.iter().all(|(_, one)| one.is_same(first));
    let others = match is_modbus && !are_alike {
        true => units,
        false => &[],
    };
    Some(row_of(Described(first.clone(), others.into())))
}

/// The codec row of a description. Like all rows, it exists until the process ends; a duplicate
/// name gets a number as suffix.
pub fn codec_of(description: &Arc<Description>) -> &'static Codec {
    row_of(Described(description.clone(), Arc::new([])))
}

fn row_of(described: Described) -> &'static Codec {
    let description = described.0.clone();
    let mut rows = ROWS.lock().unwrap_or_else(PoisonError::into_inner);
    let is_same = |other: &Described| {
        let units = |of: &Described| of.1.iter().map(|(at, _)| *at).collect::<Vec<_>>();
        let mut pairs = other.1.iter().zip(described.1.iter());
        other.0.is_same(&description)
            && units(other) == units(&described)
            && pairs.all(|((_, one), (_, own))| one.is_same(own))
    };
    if let Some((_, row)) = rows.iter().find(|(other, _)| is_same(other)) {
        return row;
    }
    let format: &'static Described = Box::leak(Box::new(described.clone()));
    let about: &'static str = description.about().to_owned().leak();
    for number in 1_u32.. {
        let name = match number {
            1 => description.name().to_owned(),
            number => format!("{}-{number}", description.name()),
        };
        let row = Codec::own(name.leak(), about, format).with_idle(description.idle());
        if let Ok(row) = codec::register(row) {
            rows.push((described, row));
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
