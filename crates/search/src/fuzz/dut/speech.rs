//! The traffic of a link: creates sessions in its format, and distinguishes answers.

use std::collections::BTreeSet;

use emulators::rng::Rng;

use engine::codec::wire::{Choices, Piece, Stream};
use engine::codec::{self, Codec};
use engine::rig::line::Direction;
use engine::scenario::{DeviceSpec, OrderSpec, RegistersSpec, TextSpec};

/// The format of a link.
#[derive(Clone, Debug)]
pub enum Speech {
    /// Frames.
    Frames(&'static Codec),
    /// Lines of text.
    Text(Text),
    /// An unknown format: bytes.
    Bytes,
}

/// Lines of text.
#[derive(Clone, Debug)]
pub struct Text {
    words: Vec<String>,
    terminator: String,
}

/// The properties of an answer apart from its values: the kinds of its frames, or its lines without
/// numbers.
pub type Shape = BTreeSet<Vec<u8>>;

/// This number of equal consecutive bytes is not a coincidence.
const ECHO: usize = 4;
/// Suffix of the kind of an answer that contains bytes of the question.
const ECHOED: u8 = b'=';
/// Maximum number of random bytes for a session; most of its 64 items use fewer than 16.
const CHANCE_MAX: u64 = 1500;

/// The kind of `frame`, with a suffix if it contains bytes of `question`.
fn told_kind(codec: &Codec, frame: &[u8], question: &[u8]) -> Vec<u8> {
    let answers = codec.answers();
    let mut kind = (answers.kind)(frame).to_vec();
    let [carried, asked] = [frame, question].map(|bytes| bytes.get(answers.head..));
    let mut asked = asked.unwrap_or_default().windows(ECHO);
    let echoes = |window: &[u8]| {
        let is_plain = window.iter().all(|byte| *byte == window[0]);
        let mut carried = carried.unwrap_or_default().windows(ECHO);
        !is_plain && carried.any(|found| found == window)
    };
    kind.extend(asked.any(echoes).then_some(ECHOED));
    kind
}

/// Whether a frame begins anywhere in `bytes`, according to the slow reference decoder.
fn is_in(codec: &Codec, bytes: &[u8]) -> bool {
    (0..bytes.len()).any(|start| codec.frame_at(&bytes[start..]).is_some())
}

impl Speech {
    /// Frames of `codec`, or bytes if the format is unknown.
    pub const fn of_codec(codec: Option<&'static Codec>) -> Self {
        match codec {
            Some(codec) => Self::Frames(codec),
            None => Self::Bytes,
        }
    }

    /// The format of a user-defined device.
    pub fn of_device(device: &DeviceSpec) -> Option<Self> {
        if let Some(spec) = device.settings::<RegistersSpec>() {
            return Some(Self::Frames(match spec.checksum {
                OrderSpec::LowFirst => &codec::BUS,
                OrderSpec::HighFirst => &codec::BUS_HIGH_FIRST,
            }));
        }
        let text = device.settings()?;
        Some(Self::Text(Text::of(text)))
    }

    /// A session of traffic: valid and damaged data, some with corrected checksums, and pauses.
    pub fn session(&self, rng: &mut Rng) -> Stream {
        match self {
            Self::Frames(codec) => {
                let len = 200 + rng.below(CHANCE_MAX);
                let chance: Vec<u8> = (0..len).map(|_| byte(rng)).collect();
                self.split(&(codec.target().stream)(&chance))
            }
            Self::Text(text) => text.session(rng),
            Self::Bytes => {
                let len = 1 + rng.below(64);
                Stream::raw(&(0..len).map(|_| byte(rng)).collect::<Vec<u8>>())
            }
        }
    }

    /// The same bytes with one frame per chunk, so that frames can be removed one by one.
    pub(super) fn split(&self, stream: &Stream) -> Stream {
        let Self::Frames(codec) = self else {
            return stream.clone();
        };
        let mut text = String::new();
        for piece in stream.pieces() {
            let Piece::Bytes(bytes) = piece else {
                text += "idle\n";
                continue;
            };
            let mut start = 0;
            for frame in codec.frames(bytes) {
                let [from, to] = [frame.start, frame.end]
                    .map(|at| usize::try_from(at).expect("a place in a slice"));
                text += &Stream::raw(&bytes[start..from]).to_text();
                text += &Stream::raw(&bytes[from..to]).to_text();
                start = to;
            }
            text += &Stream::raw(&bytes[start..]).to_text();
        }
        Stream::parse(&text).expect("written by this module")
    }

    /// A valid frame; `None` if the format cannot distinguish it from a damaged one.
    pub fn frame(&self, rng: &mut Rng) -> Option<Vec<u8>> {
        let Self::Frames(codec) = self else {
            return None;
        };
        let mut chance: Vec<u8> = (0..600).map(|_| byte(rng)).collect();
        let likely = codec.answers().likely;
        if !likely.is_empty() && rng.below(2) == 0 {
            for (choice, &(least, count)) in chance.iter_mut().zip(likely) {
                let more = u8::try_from(rng.below(u64::from(count))).expect("below a byte");
                *choice = least.saturating_add(more);
            }
        }
        let mut bytes = Vec::new();
        codec.build(&mut Choices::new(&chance), &mut bytes);
        Some(bytes)
    }

    /// `good` with damage that only the checksum detects; no part of the result is a frame.
    pub fn damaged(&self, good: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
        let Self::Frames(codec) = self else {
            return None;
        };
        (0..TRIES).find_map(|_| {
            let mut bytes = good.to_vec();
            let len = bytes.len() as u64;
            // Checksums are at the end, and some programs verify only half of a checksum.
            let at = match rng.below(3) {
                0 => len - 1 - rng.below(2.min(len)),
                _ => rng.below(len),
            };
            let at = usize::try_from(at).ok()?;
            bytes[at] = with_bit(good, at, rng.below(8));
            (!is_in(codec, &bytes)).then_some(bytes)
        })
    }

    /// The same number of bytes as `good`, without a frame; `None` if a frame is in each attempt:
    /// frames of a known size without marker and checksum are in any bytes.
    pub fn noise(&self, good: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
        (0..TRIES).find_map(|_| {
            let bytes: Vec<u8> = good.iter().map(|_| byte(rng)).collect();
            let has_frame = matches!(self, Self::Frames(codec) if is_in(codec, &bytes));
            (!has_frame).then_some(bytes)
        })
    }

    /// The kinds of frames or lines in `bytes`, the answer to `question`; refusals are left out. An
    /// answer with bytes of the question has its own kind, because it is certainly not unsolicited.
    pub fn shape(&self, bytes: &[u8], question: &[u8]) -> Shape {
        match self {
            Self::Frames(codec) => {
                // The program's data go to the device.
                let found = codec.frames_towards(bytes, Direction::ToDevice);
                let frame = found.iter().filter_map(|frame| {
                    let [from, to] = [frame.start, frame.end].map(usize::try_from);
                    bytes.get(from.ok()?..to.ok()?)
                });
                let frame = frame.filter(|frame| !(codec.answers().is_refusal)(frame));
                let kinds: Shape = frame
                    .map(|frame| told_kind(codec, frame, question))
                    .collect();
                let echoes: Shape = kinds.iter().filter(|kind| is_echo(kind)).cloned().collect();
                if echoes.is_empty() { kinds } else { echoes }
            }
            Self::Text(_) => {
                let lines = bytes.split(|&byte| byte == b'\n' || byte == b'\r');
                lines
                    .filter(|line| !line.is_empty())
                    .map(without_numbers)
                    .collect()
            }
            Self::Bytes => Shape::new(),
        }
    }
}

/// The byte `at` of `frame` with another bit. In a frame of text a hexadecimal digit becomes
/// another one: each reader of digits refuses other characters, also one that ignores the checksum.
pub(super) fn with_bit(frame: &[u8], at: usize, bit: u64) -> u8 {
    let byte = frame[at];
    let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\r' | b'\n');
    match char::from(byte).to_digit(16) {
        Some(digit) if frame.iter().all(is_text) => {
            let other = char::from_digit(digit ^ 1 << (bit % 4), 16).unwrap_or('0');
            let is_lower = frame.iter().any(|byte| matches!(byte, b'a'..=b'f'));
            let other = if is_lower {
                other
            } else {
                other.to_ascii_uppercase()
            };
            u8::try_from(other).unwrap_or(byte)
        }
        _ => byte ^ 1 << bit,
    }
}

/// Whether answers of this kind contain bytes of the question.
pub(super) fn is_echo(kind: &[u8]) -> bool {
    kind.len() > 1 && kind.ends_with(&[ECHOED])
}

/// Maximum number of attempts to damage a frame, or to draw noise, so that no part of it is a
/// frame: a frame of zeros resists.
const TRIES: usize = 32;

fn byte(rng: &mut Rng) -> u8 {
    u8::try_from(rng.below(256)).expect("below 256")
}

/// A line with `#` for each number.
fn without_numbers(line: &[u8]) -> Vec<u8> {
    let mut out: Vec<u8> = Vec::new();
    for &byte in line {
        match byte {
            b'0'..=b'9' if out.last() == Some(&b'#') => {}
            b'0'..=b'9' => out.push(b'#'),
            _ => out.push(byte),
        }
    }
    out
}

impl Text {
    fn of(spec: &TextSpec) -> Self {
        let mut words: Vec<String> = Vec::new();
        for command in &spec.command {
            words.push(command.get_ref().request.clone());
            words.extend(command.get_ref().reply.clone());
        }
        words.extend(spec.unknown.clone());
        words.extend(spec.refused.clone());
        words.extend(spec.periodic.as_ref().map(|periodic| periodic.line.clone()));
        Self {
            words,
            terminator: spec.terminator.clone(),
        }
    }

    /// The line terminator.
    pub(super) fn terminator(&self) -> &[u8] {
        self.terminator.as_bytes()
    }

    /// Some lines with random numbers; some lines are damaged.
    fn session(&self, rng: &mut Rng) -> Stream {
        let mut text = String::new();
        for _ in 0..1 + rng.below(16) {
            let mut line = self.line(rng).into_bytes();
            for _ in 0..rng.below(4).saturating_sub(1) {
                let at = usize::try_from(rng.below(line.len() as u64 + 1)).expect("in a line");
                match rng.below(3) {
                    0 => line.insert(at, byte(rng)),
                    1 if at < line.len() => drop(line.remove(at)),
                    _ => line.truncate(at),
                }
            }
            if rng.below(8) > 0 {
                line.extend(self.terminator.bytes());
            }
            text += &Stream::raw(&line).to_text();
            text += if rng.below(4) == 0 { "idle\n" } else { "" };
        }
        Stream::parse(&text).expect("written by this module")
    }

    /// A line that the device knows, with random numbers, or a line that is far too long.
    pub(super) fn line(&self, rng: &mut Rng) -> String {
        if self.words.is_empty() || rng.below(16) == 0 {
            let len = usize::try_from(rng.below(600)).expect("below 600");
            return "x".repeat(len);
        }
        let word = usize::try_from(rng.below(self.words.len() as u64)).expect("in the list");
        let mut line = String::new();
        let mut rest = self.words[word].as_str();
        while let Some((before, (_, after))) = rest
            .split_once('{')
            .and_then(|(before, behind)| Some((before, behind.split_once('}')?)))
        {
            line += before;
            line += &number(rng);
            rest = after;
        }
        line + rest
    }
}

/// A number that parsers often handle wrongly.
fn number(rng: &mut Rng) -> String {
    match rng.below(8) {
        0 => String::new(),
        1 => "-1".to_owned(),
        2 => i64::MIN.to_string(),
        3 => u64::MAX.to_string(),
        4 => "9".repeat(40),
        _ => rng.below(100_000).to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `:010300` of Modbus ASCII: digits stay digits, the colon and bytes of binary frames do not.
    #[test]
    fn a_digit_of_a_text_becomes_another_digit() {
        let text = b":0103FA\r\n";
        assert_eq!([0, 3].map(|bit| with_bit(text, 4, bit)), [b'2', b'B']);
        assert_eq!([0, 3].map(|bit| with_bit(text, 5, bit)), [b'E', b'7']);
        assert_eq!(with_bit(text, 0, 0), b';');
        assert_eq!(with_bit(&[0x30, 0x01], 0, 7), 0xB0);
    }

    const BUS: Speech = Speech::of_codec(Some(&codec::BUS));

    /// The sum of AB 04 02 is B1; swapping two bytes does not change a sum, a bit does.
    #[test]
    fn a_damaged_frame_has_no_frame_in_it() {
        let good = [0xAB, 0x04, 0x02, 0xB1, 0x00];
        let mut rng = Rng::stream(1, "test");
        for _ in 0..100 {
            let bad = BUS.damaged(&good, &mut rng).expect("a checksum tells");
            assert_eq!(bad.len(), good.len());
            assert_eq!(BUS.shape(&bad, &[]), Shape::new(), "{bad:02X?}");
        }
    }

    /// Any three bytes are a frame of this device: there is neither noise nor damage. The sum of
    /// 01 02 is 03; of 256 sums of another device one is right.
    #[test]
    fn where_any_bytes_are_a_frame_there_is_no_noise() {
        let speech = |size: u8, frame: &str| {
            let text = format!(
                "name = \"any\"\nabout = \"x\"\nline = {{ baud = 9600 }}\nframe = {{ {frame} }}\n\
                 message = [{{ name = \"m\", from = \"device\", fields = [{{ name = \"a\", \
                 type = \"bytes\", size = {size} }}] }}]\n\
                 every = [{{ period = \"1s\", send = \"m\" }}]\n"
            );
            let of = description::Description::parse("any", &text, &|_| Err(String::new()));
            let codec = engine::scenario::device::description::codec_of(&of.expect("sound"));
            Speech::of_codec(Some(codec))
        };
        let mut rng = Rng::stream(1, "test");
        let any = speech(3, "size = 3");
        assert_eq!(any.noise(&[1, 2, 3], &mut rng), None);
        assert_eq!(any.damaged(&[1, 2, 3], &mut rng), None);
        let sum = speech(2, "size = 3, checksum = \"sum8\"");
        let noise = sum.noise(&[1, 2, 3], &mut rng).expect("a sum tells");
        assert_eq!(noise.len(), 3);
        assert_ne!(noise[2], noise[0].wrapping_add(noise[1]));
    }

    #[test]
    fn a_session_is_the_same_for_the_same_seed_and_holds_frames_and_damage() {
        let make = |seed| BUS.session(&mut Rng::stream(seed, "test"));
        assert_eq!(make(1), make(1));
        assert_ne!(make(1), make(2));
        let framed = codec::BUS.framed(make(1).bytes());
        assert!(
            (1..make(1).bytes().len() as u64).contains(&framed),
            "{framed}"
        );
    }

    #[test]
    fn answers_that_differ_in_their_values_only_have_the_same_shape() {
        // Reads of register 4 answered with 1 and with 2: sums AB + 04 + 81 + value.
        let one = [0xAB, 0x04, 0x81, 0x01, 0x31, 0x01];
        let two = [0xAB, 0x04, 0x81, 0x02, 0x32, 0x01];
        let refusal = [0xAB, 0xFF, 0x80, 0x2A, 0x02];
        assert_eq!(BUS.shape(&one, &[]), Shape::from([vec![0x04, 0x81]]));
        assert_eq!(BUS.shape(&one, &[]), BUS.shape(&two, &[]));
        assert_eq!(BUS.shape(&refusal, &[]), Shape::new());
        let text = Speech::Text(Text {
            words: Vec::new(),
            terminator: "\n".into(),
        });
        assert_eq!(
            text.shape(b"mm=120\r\n", b""),
            Shape::from([b"mm=#".to_vec()])
        );
    }

    /// A list of one waypoint, returned by the robot; the sum of 1, 0, 2 to 10 is 55, 37
    /// hexadecimal.
    #[test]
    fn an_answer_that_carries_the_question_is_told_from_one_that_does_not() {
        let pcui = Speech::of_codec(Some(&codec::PCUI));
        let mut list = b"PCUI_MSG\x0B\x00\x37\x00\x00\x00LWP\x01\x00".to_vec();
        list.extend(2..=10);
        let echo = Shape::from([b"LWP=".to_vec()]);
        assert_eq!(pcui.shape(&list, &list), echo);
        assert_eq!(pcui.shape(&list, b"?"), Shape::from([b"LWP".to_vec()]));
    }
}
