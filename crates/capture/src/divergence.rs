//! First difference of two byte streams: position, time, and meaning.

use core::fmt;
use core::time::Duration;

use protocols::Instant;

use engine::codec::{self, Codec, Stretch, What};
use engine::hex::digits;
use engine::rig::line::Direction;

/// The bytes of one direction of a link, with the time of each piece.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Track {
    bytes: Vec<u8>,
    /// End and time of each piece.
    ends: Vec<(usize, Instant)>,
}

impl Track {
    /// Appends a piece whose last byte was complete at `at`.
    pub fn push(&mut self, at: Instant, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.bytes.extend_from_slice(bytes);
            self.ends.push((self.bytes.len(), at));
        }
    }

    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The pieces with their times.
    pub fn pieces(&self) -> impl Iterator<Item = (Instant, &[u8])> {
        let starts = core::iter::once(0).chain(self.ends.iter().map(|&(end, _)| end));
        let pieces = starts.zip(&self.ends);
        pieces.map(|(start, &(end, at))| (at, &self.bytes[start..end]))
    }

    /// Time at which byte `index` was complete: that of the last byte of its piece.
    pub fn time_of(&self, index: usize) -> Option<Instant> {
        let piece = self.ends.partition_point(|&(end, _)| end <= index);
        self.ends.get(piece).map(|&(_, at)| at)
    }

    /// Time at which the last byte was complete.
    pub fn end(&self) -> Option<Instant> {
        self.ends.last().map(|&(_, at)| at)
    }

    /// Maximum time by which a piece of `other` ended earlier or later, over the bytes that both
    /// have.
    pub fn largest_shift(&self, other: &Self) -> Duration {
        let shift = |&(end, at): &(usize, Instant)| {
            let there = other.time_of(end - 1)?;
            Some((at - there).max(there - at))
        };
        self.ends.iter().filter_map(shift).max().unwrap_or_default()
    }
}

/// The first difference between the expected and the actual bytes of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Divergence {
    /// Name of the link.
    pub link: String,
    /// Direction.
    pub direction: Direction,
    /// Time of the byte: expected, or actual if none was expected.
    pub at: Instant,
    /// Number of the byte on its line, from zero.
    pub byte: usize,
    /// The expected byte; `None`: end of the stream.
    pub expected: Option<u8>,
    /// The actual byte; `None`: end of the stream.
    pub got: Option<u8>,
    /// The frame that contains the byte: the expected and the actual one, as text.
    pub frames: [String; 2],
    /// Further notes on the position; may be empty.
    pub note: String,
}

impl Divergence {
    /// The difference between the `expected` message and the actual one; at least one of them is
    /// present. `at` is the time of the last byte, `start` the number of the first byte.
    pub(crate) fn between(
        (link, direction): (&str, Direction),
        (at, start): (Instant, usize),
        expected: Option<&[u8]>,
        got: Option<&[u8]>,
        codec: Option<&'static Codec>,
    ) -> Self {
        let codec = codec.map(|codec| (codec, direction));
        let [left, right] = [expected, got].map(Option::unwrap_or_default);
        let pairs = left.iter().zip(right);
        let same = pairs.take_while(|(left, right)| left == right).count();
        Self {
            link: link.to_owned(),
            direction,
            at,
            byte: start + same,
            expected: left.get(same).copied(),
            got: right.get(same).copied(),
            frames: [expected, got].map(|message| match message {
                Some(message) => message_words(codec, message, same),
                None => "nothing more".to_owned(),
            }),
            note: String::new(),
        }
    }
}

/// Compares the actual with the expected bytes of a line.
pub fn compare(
    link: &str,
    direction: Direction,
    expected: &Track,
    got: &Track,
) -> Option<Divergence> {
    let pairs = expected.bytes.iter().zip(&got.bytes);
    let same = pairs.take_while(|(expected, got)| expected == got).count();
    let at = expected.time_of(same).or_else(|| got.time_of(same))?;
    let codec = codec::guess(&expected.bytes).or_else(|| codec::guess(&got.bytes));
    let codec = codec.map(|codec| (codec, direction));
    let frame = |track: &Track| words(codec, &track.bytes, same);
    Some(Divergence {
        link: link.to_owned(),
        direction,
        at,
        byte: same,
        expected: expected.bytes.get(same).copied(),
        got: got.bytes.get(same).copied(),
        frames: [frame(expected), frame(got)],
        note: String::new(),
    })
}

/// Number of bytes before and after the differing one that are decoded. A frame is shorter, and the
/// bytes before are equal on both sides.
const AROUND: usize = 4096;

/// Maximum length of the text of a frame; a row of a map is longer.
const WORDS_MAX: usize = 200;

/// A protocol, and the direction of its frames.
type Way = (&'static Codec, Direction);

/// Text of a whole message: as a frame, as text, or as bytes around `byte`.
fn message_words(codec: Option<Way>, message: &[u8], byte: usize) -> String {
    let place = byte.min(message.len().saturating_sub(1));
    let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n');
    match codec {
        Some(_) => words(codec, message, place),
        None if message.iter().all(is_text) => {
            let text: String = message.iter().map(|&byte| char::from(byte)).collect();
            let short: String = text.chars().take(WORDS_MAX).collect();
            let more = if short.len() < text.len() { ".." } else { "" };
            format!("text {short:?}{more}")
        }
        None => {
            let (len, hex) = (message.len(), hex(message, place));
            format!("{len} bytes: {hex}")
        }
    }
}

/// Text of the frame that contains `byte` of `bytes`.
fn words(codec: Option<Way>, bytes: &[u8], byte: usize) -> String {
    if byte >= bytes.len() {
        return "nothing more".to_owned();
    }
    let start = byte.saturating_sub(AROUND);
    let part = &bytes[start..bytes.len().min(byte + AROUND)];
    let Some((codec, direction)) = codec else {
        return format!("no known protocol: {}", hex(part, byte - start));
    };
    let place = (byte - start) as u64;
    let Some(Stretch { bytes: range, what }) = codec
        .found_towards(part, direction)
        .into_iter()
        .find(|found| found.bytes.contains(&place))
    else {
        return format!("no frame: {}", hex(part, byte - start));
    };
    let index = |at: u64| usize::try_from(at).expect("within a slice");
    let (first, last) = (index(range.start), index(range.end) - 1);
    let place = format!("bytes {}..={}", start + first, start + last);
    match what {
        What::Frame(words) => {
            let short: String = words.chars().take(WORDS_MAX).collect();
            let more = if short.len() < words.len() { ".." } else { "" };
            format!("{short}{more} ({} frame, {place})", codec.name())
        }
        What::Bad(errors) => {
            let mut text = format!("no {} frame ({place})", codec.name());
            for error in errors {
                text += &format!("; {error}");
            }
            format!("{text}: {}", hex(part, byte - start))
        }
    }
}

/// Bytes around `byte` in hex, that one in brackets.
fn hex(bytes: &[u8], byte: usize) -> String {
    let range = byte.saturating_sub(8)..bytes.len().min(byte + 9);
    let shown = range.map(|index| {
        let digits = digits(&bytes[index..=index]);
        match index == byte {
            true => format!("[{digits}]"),
            false => digits,
        }
    });
    shown.collect::<Vec<_>>().join(" ")
}

impl fmt::Display for Divergence {
    /// Three lines: place and bytes, the expected frame, the actual frame; then the note.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let byte = |byte: Option<u8>| match byte {
            Some(byte) => format!("{byte:#04x}"),
            None => "nothing".to_owned(),
        };
        let (link, to, number) = (&self.link, self.direction.name(), self.byte);
        let [expected, got] = [self.expected, self.got].map(byte);
        writeln!(
            f,
            "{} s, {link} {to}, byte {number}: expected {expected}, got {got}",
            self.at
        )?;
        let [as_expected, as_it_came] = &self.frames;
        write!(f, "  expected: {as_expected}\n  got:      {as_it_came}")?;
        match &*self.note {
            "" => Ok(()),
            note => write!(f, "\n  {note}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::avr::{self, ChecksumOrder};

    fn track(pieces: &[(u64, &[u8])]) -> Track {
        let mut track = Track::default();
        for &(at, bytes) in pieces {
            track.push(Instant::from_millis(at), bytes);
        }
        track
    }

    fn read(register: u8) -> Vec<u8> {
        let frame = avr::Frame::read(register, 10, ChecksumOrder::LowFirst);
        frame.as_bytes().to_vec()
    }

    /// Two register reads of five bytes. The second reads another register, so its second byte
    /// differs: number 6 of the line, complete at 2 ms. The register has no name.
    #[test]
    fn the_first_different_byte_is_told_with_its_frame() {
        let expected = track(&[(1, &read(36)), (2, &read(60))]);
        let got = track(&[(1, &read(36)), (3, &read(61))]);
        let divergence = compare("base", Direction::ToDevice, &expected, &got);
        let divergence = divergence.expect("one byte differs");
        assert_eq!(
            (divergence.byte, divergence.at),
            (6, Instant::from_millis(2))
        );
        insta::assert_snapshot!(divergence, @r"
        0.002000 s, base to-device, byte 6: expected 0x3c, got 0x3d
          expected: read 10 from 60: (bus frame, bytes 5..=9)
          got:      read 10 from 61: (bus frame, bytes 5..=9)
        ");
        assert_eq!(expected.largest_shift(&got), Duration::from_millis(1));
    }

    #[test]
    fn what_is_missing_or_too_much_is_a_difference_too() {
        let (long, short) = (track(&[(1, b"ab"), (2, b"c")]), track(&[(1, b"ab")]));
        let of = |expected, got| compare("x", Direction::ToDevice, expected, got);
        let missing = of(&long, &short).expect("c is missing");
        assert_eq!(
            (missing.byte, missing.expected, missing.got),
            (2, Some(b'c'), None)
        );
        let extra = of(&short, &long).expect("c is too much");
        assert_eq!(
            (extra.byte, extra.expected, extra.got),
            (2, None, Some(b'c'))
        );
        assert_eq!(of(&long, &long), None);
    }

    /// Two bytes at 1 ms, nothing at 2 ms, one at 3 ms.
    #[test]
    fn a_track_knows_its_pieces_and_their_times() {
        let track = track(&[(1, b"ab"), (2, b""), (3, b"c")]);
        let millis = Instant::from_millis;
        assert_eq!(track.bytes(), b"abc");
        let pieces: Vec<_> = track.pieces().collect();
        assert_eq!(pieces, [(millis(1), &b"ab"[..]), (millis(3), b"c")]);
        let times = [0, 1, 2, 3].map(|byte| track.time_of(byte));
        assert_eq!(
            times,
            [Some(millis(1)), Some(millis(1)), Some(millis(3)), None]
        );
        assert_eq!(
            (track.end(), Track::default().end()),
            (Some(millis(3)), None)
        );
    }

    /// The largest difference in either direction; bytes of one side only do not count.
    #[test]
    fn a_shift_is_earlier_or_later() {
        let here = track(&[(10, b"a"), (20, b"b"), (90, b"c")]);
        let shift = |there: &[(u64, &[u8])]| here.largest_shift(&track(there)).as_millis();
        assert_eq!(shift(&[(12, b"a"), (21, b"b")]), 2);
        assert_eq!(shift(&[(10, b"a"), (13, b"b")]), 7);
        assert_eq!(shift(&[(25, b"ab")]), 15);
        assert_eq!(shift(&[]), 0);
    }

    /// Eight bytes on both sides, the differing one in brackets.
    #[test]
    fn bytes_of_no_protocol_are_shown_around_the_place() {
        let bytes: Vec<u8> = (0..=20).collect();
        let around = "02 03 04 05 06 07 08 09 [0A] 0B 0C 0D 0E 0F 10 11 12";
        assert_eq!(hex(&bytes, 10), around);
        assert_eq!(hex(&bytes, 0), "[00] 01 02 03 04 05 06 07 08");
        assert_eq!(hex(&bytes, 20), "0C 0D 0E 0F 10 11 12 13 [14]");
        assert_eq!(words(None, &bytes, 21), "nothing more");
        assert_eq!(
            words(None, &bytes, 20),
            format!("no known protocol: {}", hex(&bytes, 20))
        );
    }

    /// A message is shown as a frame, as text, or as bytes; text up to 200 characters.
    #[test]
    fn a_message_is_shown_in_its_form() {
        assert_eq!(message_words(None, b"AT\r", 1), "text \"AT\\r\"");
        let long = "a".repeat(201);
        let shown = format!("text \"{}\"..", "a".repeat(200));
        assert_eq!(message_words(None, long.as_bytes(), 0), shown);
        let all = format!("text \"{}\"", "a".repeat(200));
        assert_eq!(message_words(None, &long.as_bytes()[1..], 0), all);
        assert_eq!(message_words(None, b"\x01\x02", 5), "2 bytes: 01 [02]");
        assert_eq!(message_words(None, b"\x01\x02", 0), "2 bytes: [01] 02");
        assert_eq!(message_words(None, b"", 0), "text \"\"");
    }

    /// A damaged frame has its place and its error; behind thousands of bytes as well.
    #[test]
    fn a_frame_is_shown_with_its_place() {
        let codec = Some((&codec::BUS, Direction::ToDevice));
        let mut bytes = read(36).repeat(2_000);
        let shown = words(codec, &bytes, 9_007);
        assert!(shown.ends_with("(bus frame, bytes 9005..=9009)"), "{shown}");
        bytes[9_009] ^= 1;
        let shown = words(codec, &bytes, 9_007);
        assert!(shown.starts_with("no bus frame (bytes 9005..="), "{shown}");
        assert!(shown.contains("; checksum is "), "{shown}");
    }
}
