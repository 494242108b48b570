//! A section of one direction of a link, split into frames.

use core::ops::Range;
use std::collections::VecDeque;

use protocols::Instant;
use serde::Serialize;

use super::{Piece, as_index};
use crate::codec::{BAD_MAX, Codec, IDLE, Stream, Stretch, What, words};
use crate::hex::digits;
use crate::rig::LinkKind;
use crate::rig::line::Direction;

/// Maximum number of bytes in one stretch of an unknown protocol.
const STRETCH_MAX: usize = 256;
const _: () = assert!(STRETCH_MAX as u64 == BAD_MAX);

/// A frame, or bytes outside frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Frame {
    /// Time of the last byte, nanoseconds.
    pub at_ns: u64,
    /// Name of the link.
    pub link: String,
    /// Name of the direction.
    pub way: &'static str,
    /// The frame in words; for invalid bytes, the reason.
    pub words: String,
    /// Bytes as hexadecimal digits.
    pub bytes: String,
    /// Whether the bytes are not a frame of the link's protocol.
    pub is_bad: bool,
    /// Whether a fault hit these bytes, or lost the bytes before them.
    pub is_hit: bool,
}

/// A frame and its place in its lane.
pub(super) struct Placed {
    pub(super) frame: Frame,
    /// Offsets from the first byte ever received.
    pub(super) place: Range<u64>,
    /// Whether later bytes cannot change the frame.
    pub(super) is_settled: bool,
}

/// A section of a lane.
#[derive(Clone, Debug)]
pub struct Tail {
    pub(super) link: String,
    pub(super) way: Direction,
    pub(super) kind: LinkKind,
    pub(super) codec: Option<&'static Codec>,
    /// Whether the section begins with the first byte ever received, or with a frame.
    pub(super) is_whole: bool,
    pub(super) from: u64,
    pub(super) until: Instant,
    pub(super) bytes: Vec<u8>,
    pub(super) pieces: Vec<Piece>,
    /// A frame before the section that sets the state of the decoder.
    pub(super) primer: Vec<u8>,
    /// Times at which the other direction was busy, where the protocol is unknown.
    pub(super) pauses: Vec<Instant>,
}

impl Tail {
    /// Splits bytes of an unknown protocol where the other direction carried bytes.
    pub(super) fn pause_where(&mut self, others: &VecDeque<Piece>) {
        let Some((first, last)) = self.pieces.first().zip(self.pieces.last()) else {
            return;
        };
        let from = others.partition_point(|piece| piece.at < first.at);
        let until = others.partition_point(|piece| piece.at <= last.at);
        self.pauses = others.range(from..until).map(|piece| piece.at).collect();
    }

    /// The frames in the section, and the bytes outside frames.
    pub(super) fn frames(&self) -> Vec<Frame> {
        self.placed().into_iter().map(|one| one.frame).collect()
    }

    /// The same with their places.
    pub(super) fn placed(&self) -> Vec<Placed> {
        match self.codec {
            Some(codec) => self.decoded(codec),
            None => self.as_text(),
        }
    }

    fn decoded(&self, codec: &'static Codec) -> Vec<Placed> {
        let mut stream = Stream::towards(codec, self.way);
        stream.push(&self.primer);
        let (mut found, mut from, mut before) = (Vec::new(), self.from, None);
        for piece in &self.pieces {
            if before.is_some_and(|before| piece.at - before > codec.idle()) {
                found.extend(stream.idle());
            }
            let part = as_index(from - self.from)..as_index(piece.end - self.from);
            found.extend(stream.push(&self.bytes[part]));
            (from, before) = (piece.end, Some(piece.at));
        }
        // The partial frame of a device that fell silent has no later piece.
        if before.is_some_and(|before| self.until > before && self.until - before > codec.idle()) {
            found.extend(stream.idle());
        }
        let primed = self.primer.len() as u64;
        // A frame that is truncated at the beginning of the section is not a line error.
        let is_cut = |one: &Stretch| !one.is_frame() && one.bytes.start == 0 && !self.is_whole;
        let found = found.iter().filter(|one| !is_cut(one));
        let found = found.filter(|one| one.bytes.start >= primed);
        found
            .map(|one| {
                let [start, end] = [one.bytes.start, one.bytes.end].map(|at| as_index(at - primed));
                let (is_bad, words) = meaning(&one.what);
                self.put(start..end, words, is_bad, true)
            })
            .collect()
    }

    fn put(&self, range: Range<usize>, words: String, is_bad: bool, is_settled: bool) -> Placed {
        let [start, end] = [range.start, range.end].map(|at| self.from + at as u64);
        let first = self.pieces.partition_point(|piece| piece.end <= start);
        let last = self.pieces.partition_point(|piece| piece.end < end);
        let own = self.pieces.get(first..=last).unwrap_or_default();
        let frame = Frame {
            at_ns: own.last().map_or(0, |piece| piece.at.as_nanos()),
            link: self.link.clone(),
            way: self.way.name(),
            words,
            bytes: digits(&self.bytes[range]),
            is_bad,
            is_hit: own.iter().any(|piece| piece.is_hit),
        };
        Placed {
            frame,
            place: start..end,
            is_settled,
        }
    }

    /// The bytes in stretches, because the protocol is unknown.
    fn as_text(&self) -> Vec<Placed> {
        let is_message = self.kind != LinkKind::Uart;
        let (mut all, mut from) = (Vec::new(), 0);
        let is_pause = |a: &Piece, b: &Piece| is_message || b.at - a.at > IDLE;
        for stretch in self.pieces.chunk_by(|a, b| !is_pause(a, b)) {
            let last = stretch.last().expect("a chunk is not empty");
            let end = as_index(last.end - self.from);
            let range = core::mem::replace(&mut from, end)..end;
            let is_last = end == self.bytes.len();
            let goes_on = is_last && !is_message && self.until - last.at <= IDLE;
            let parts = match is_message {
                true => vec![range],
                false => self.split(range),
            };
            for part in parts {
                let is_settled = !goes_on || part.end + STRETCH_MAX <= end;
                let words = words::text(&self.bytes[part.clone()]);
                all.push(self.put(part, words, false, is_settled));
            }
        }
        // A line that begins before the section is not whole.
        if !self.is_whole && !is_message && all.len() > 1 {
            all.remove(0);
        }
        all
    }

    /// The parts of `range`, which has no pause: lines of text, and other bytes up to the next
    /// bytes of the other direction.
    fn split(&self, range: Range<usize>) -> Vec<Range<usize>> {
        let (mut parts, mut from, mut strange) = (Vec::new(), range.start, 0);
        for at in range.clone() {
            let (byte, next) = (self.bytes[at], self.bytes.get(at + 1));
            let next = next.filter(|_| at + 1 < range.end);
            strange += usize::from(!is_text(byte));
            let len = at + 1 - from;
            let is_line = 4 * strange <= len;
            let ends_line = byte == b'\n' || byte == b'\r' && next != Some(&b'\n');
            let is_end = next.is_none()
                || len >= STRETCH_MAX
                || is_line && ends_line
                || self.is_turn(at) && !self.is_in_line(from..range.end);
            if is_end {
                parts.push(core::mem::replace(&mut from, at + 1)..at + 1);
                strange = 0;
            }
        }
        parts
    }

    /// Whether the other direction carried bytes between the byte at `at` and the next one.
    fn is_turn(&self, at: usize) -> bool {
        if self.pauses.is_empty() {
            return false;
        }
        let end = self.from + at as u64 + 1;
        let piece = self.pieces.partition_point(|piece| piece.end < end);
        let Some([before, after]) = self.pieces.get(piece..piece + 2) else {
            return false;
        };
        let busy = self.pauses.partition_point(|at| *at < before.at);
        let between = self.pauses.get(busy).is_some_and(|at| *at < after.at);
        before.end == end && between
    }

    /// Whether `range` begins with a line of mostly text with its end. Bytes of the other direction
    /// do not split the line of a full-duplex device.
    fn is_in_line(&self, range: Range<usize>) -> bool {
        let bytes = &self.bytes[range];
        let line = &bytes[..bytes.len().min(STRETCH_MAX)];
        let end = line.iter().position(|byte| matches!(byte, b'\r' | b'\n'));
        end.is_some_and(|end| {
            let strange = line[..end].iter().filter(|byte| !is_text(**byte));
            4 * strange.count() <= end
        })
    }
}

const fn is_text(byte: u8) -> bool {
    matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n')
}

fn meaning(what: &What) -> (bool, String) {
    match what {
        What::Frame(words) => (false, words.clone()),
        What::Bad(errors) if errors.is_empty() => (true, "no frame".to_owned()),
        What::Bad(errors) => {
            let errors: Vec<String> = errors.iter().map(ToString::to_string).collect();
            (true, errors.join("; "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::BUS_HIGH_FIRST;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    /// A section of a link to a device: chunks with their milliseconds; the first byte has the
    /// number 100.
    fn tail(chunks: &[(u64, &[u8])]) -> Tail {
        let (mut bytes, mut pieces) = (Vec::new(), Vec::new());
        for &(millis, chunk) in chunks {
            bytes.extend_from_slice(chunk);
            pieces.push(Piece {
                end: 100 + bytes.len() as u64,
                at: at(millis),
                is_hit: false,
            });
        }
        Tail {
            link: "port".to_owned(),
            way: Direction::ToDevice,
            kind: LinkKind::Uart,
            codec: None,
            is_whole: true,
            from: 100,
            until: at(1_000_000),
            bytes,
            pieces,
            primer: Vec::new(),
            pauses: Vec::new(),
        }
    }

    /// Beginnings and ends of frames, from the first byte of the section on.
    fn places(tail: &Tail) -> Vec<[u64; 2]> {
        let all = tail.placed().into_iter();
        all.map(|one| [one.place.start, one.place.end].map(|at| at - 100))
            .collect()
    }

    /// Pauses of more than 50 ms split the bytes. Bytes before the section's first pause are left
    /// out if the section does not begin with the first byte.
    #[test]
    fn bytes_of_an_unknown_protocol_are_parted_by_pauses() {
        let mut parted = tail(&[(10, &[1, 2]), (60, &[3]), (111, &[4])]);
        assert_eq!(places(&parted), [[0, 3], [3, 4]]);
        let frames = parted.frames();
        let told: Vec<_> = frames
            .iter()
            .map(|one| (one.at_ns, &*one.bytes, one.way))
            .collect();
        let expected = [
            (60_000_000, "010203", "to-device"),
            (111_000_000, "04", "to-device"),
        ];
        assert_eq!(told, expected);
        parted.is_whole = false;
        assert_eq!(places(&parted), [[3, 4]]);
        let mut alone = tail(&[(10, &[1, 2])]);
        alone.is_whole = false;
        assert_eq!(places(&alone), [[0, 2]]);
    }

    /// The last bytes may continue until 50 ms have passed.
    #[test]
    fn the_last_bytes_are_settled_after_a_pause() {
        let settled = |until_ms: u64| {
            let mut tail = tail(&[(10, &[1]), (100, &[2])]);
            tail.until = at(until_ms);
            tail.placed()
                .iter()
                .map(|one| one.is_settled)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            (settled(150), settled(151)),
            (vec![true, false], vec![true, true])
        );
        // A part with 256 further bytes behind it does not change.
        let mut long = tail(&[(10, &[7; 600])]);
        long.until = at(10);
        let settled: Vec<bool> = long.placed().iter().map(|one| one.is_settled).collect();
        assert_eq!(settled, [true, false, false]);
    }

    /// On a datagram link each chunk is a message of its own.
    #[test]
    fn messages_are_not_parted() {
        let mut tail = tail(&[(10, b"a\nb"), (10, b"c"), (11, &[7; 600])]);
        (tail.kind, tail.until, tail.is_whole) = (LinkKind::Datagram, at(11), false);
        assert_eq!(places(&tail), [[0, 3], [3, 4], [4, 604]]);
        assert!(tail.placed().iter().all(|one| one.is_settled));
    }

    /// A quarter of a line may be strange. A carriage return ends a line unless a line feed
    /// follows; binary data is split after 256 bytes.
    #[test]
    fn lines_of_text_are_parts() {
        let parts = |bytes: &[u8]| places(&tail(&[(10, bytes)]));
        assert_eq!(parts(b"ab\ncd\r\ne\rf"), [[0, 3], [3, 7], [7, 9], [9, 10]]);
        assert_eq!(parts(b"a\xFF\xFF\xFFbcdefgh\nx"), [[0, 12], [12, 13]]);
        assert_eq!(
            parts(b"a\xFF\xFF\xFFbcdefg\nx"),
            [[0, 12]],
            "more than a quarter"
        );
        assert_eq!(parts(&[0xFF; 257]), [[0, 256], [256, 257]]);
        assert_eq!(parts(&[0xFF; 256])[..], [[0, 256]]);
    }

    /// Bytes of the other direction split data, but not a complete line of text.
    #[test]
    fn the_other_direction_parts_what_is_no_line() {
        let turned = |chunks: &[(u64, &[u8])], others: &[u64]| {
            let mut tail = tail(chunks);
            let piece = |&millis: &u64| Piece {
                end: 0,
                at: at(millis),
                is_hit: false,
            };
            tail.pause_where(&others.iter().map(piece).collect());
            (tail.pauses.len(), places(&tail))
        };
        let data: [(u64, &[u8]); 3] = [(10, &[1]), (20, &[2]), (30, &[3])];
        assert_eq!(turned(&data, &[15]), (1, vec![[0, 1], [1, 3]]));
        assert_eq!(turned(&data, &[20]), (1, vec![[0, 2], [2, 3]]));
        assert_eq!(turned(&data, &[5, 9, 31]), (0, vec![[0, 3]]));
        assert_eq!(turned(&data, &[10, 30]), (2, vec![[0, 1], [1, 3]]));
        let text: [(u64, &[u8]); 3] = [(10, b"a"), (20, b"b"), (30, b"c\n")];
        assert_eq!(turned(&text, &[15, 25]), (2, vec![[0, 4]]));
        let open: [(u64, &[u8]); 2] = [(10, b"a"), (20, b"b")];
        assert_eq!(turned(&open, &[15]), (1, vec![[0, 1], [1, 2]]));
    }

    /// A hit belongs to the frame with its chunk.
    #[test]
    fn a_frame_is_hit_if_one_of_its_chunks_is() {
        let frame = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
        let hit = |piece: usize| {
            let mut tail = tail(&[(10, &frame[..2]), (11, &frame[2..]), (12, &frame)]);
            tail.codec = Some(&BUS_HIGH_FIRST);
            tail.pieces[piece].is_hit = true;
            let frames = tail.frames();
            assert_eq!(
                frames.iter().map(|one| one.at_ns).collect::<Vec<_>>(),
                [11_000_000, 12_000_000]
            );
            frames.iter().map(|one| one.is_hit).collect::<Vec<_>>()
        };
        assert_eq!(
            [hit(0), hit(1), hit(2)],
            [[true, false], [true, false], [false, true]]
        );
    }

    /// A frame in two parts stays one frame unless the pause between them exceeds the decoder's
    /// idle time. The beginning of a section may be the rest of a frame, which is no error.
    #[test]
    fn frames_of_a_known_protocol_are_whole() {
        let frame = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
        let patience = u64::try_from(BUS_HIGH_FIRST.idle().as_millis()).expect("short");
        let bad = |pause: u64| {
            let mut tail = tail(&[(10, &frame[..2]), (10 + pause, &frame[2..])]);
            tail.codec = Some(&BUS_HIGH_FIRST);
            tail.frames()
                .iter()
                .map(|one| one.is_bad)
                .collect::<Vec<_>>()
        };
        assert_eq!(bad(patience), [false]);
        assert!(bad(patience + 1).iter().all(|is_bad| *is_bad));
        let cut = |is_whole: bool| {
            let mut tail = tail(&[(10, &[0x0A, 0x00, 0xD9]), (11, &frame)]);
            (tail.codec, tail.is_whole) = (Some(&BUS_HIGH_FIRST), is_whole);
            tail.frames()
                .iter()
                .map(|one| one.is_bad)
                .collect::<Vec<_>>()
        };
        assert_eq!((cut(true), cut(false)), (vec![true, false], vec![false]));
        // The frame of a device that fell silent is known to be cut off after a while.
        let silent = |until: u64| {
            let mut tail = tail(&[(10, &frame[..2])]);
            (tail.codec, tail.until) = (Some(&BUS_HIGH_FIRST), at(until));
            tail.frames().len()
        };
        assert_eq!((silent(10 + patience), silent(11 + patience)), (0, 1));
    }

    /// A frame before the section sets the state of the decoder, and is none of its frames.
    #[test]
    fn a_primer_is_no_frame_of_the_section() {
        let frame = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
        let mut primed = tail(&[(10, &frame[..3]), (11, &frame[3..]), (12, &frame)]);
        (primed.codec, primed.primer) = (Some(&BUS_HIGH_FIRST), frame.to_vec());
        assert_eq!(places(&primed), [[0, 5], [5, 10]]);
        assert!(
            primed
                .placed()
                .iter()
                .all(|one| one.is_settled && !one.frame.is_bad)
        );
        primed.pieces[1].at = at(500);
        let bad: Vec<bool> = primed.frames().iter().map(|one| one.is_bad).collect();
        assert_eq!(bad.last(), Some(&false));
        assert!(bad[0], "{bad:?}");
    }

    /// The times of the other direction from the first byte of the section to its last one.
    #[test]
    fn pauses_are_those_within_the_section() {
        let pauses = |others: &[u64]| {
            let mut tail = tail(&[(10, &[1]), (20, &[2]), (30, &[3])]);
            let piece = |&millis: &u64| Piece {
                end: 0,
                at: at(millis),
                is_hit: false,
            };
            tail.pause_where(&others.iter().map(piece).collect());
            let pauses = tail.pauses.iter();
            pauses.map(|at| at.as_millis()).collect::<Vec<_>>()
        };
        assert_eq!(pauses(&[9, 10, 15, 30, 31]), [10, 15, 30]);
        assert_eq!(pauses(&[]), [0; 0]);
        let mut empty = tail(&[]);
        empty.pause_where(&VecDeque::from([Piece {
            end: 0,
            at: at(1),
            is_hit: false,
        }]));
        assert!(empty.pauses.is_empty());
    }

    /// Up to a quarter of a line may be strange, and its end is within 256 bytes.
    #[test]
    fn a_line_is_mostly_text_and_has_an_end() {
        let is_line = |bytes: &[u8]| tail(&[(10, bytes)]).is_in_line(0..bytes.len());
        assert!(is_line(b"abcd\n") && is_line(b"\r") && !is_line(b"abcd"));
        assert!(is_line(b"\xFFbcd\n") && !is_line(b"\xFFbc\n"));
        assert!(is_line(b"\xFF\xFFcdefgh\n") && !is_line(b"\xFF\xFFcdefg\n"));
        // Bytes behind the end do not matter.
        assert!(is_line(b"abcd\n\xFF\xFF\xFF"));
        let long = |len: usize| is_line(&[&vec![b'a'; len][..], b"\n"].concat());
        assert_eq!([long(255), long(256)], [true, false]);
        let [tab, delete] = [b'\t', 0x7F].map(is_text);
        assert!(tab && !delete && is_text(b' ') && is_text(b'~') && !is_text(0x1F));
    }

    /// Bytes of the other direction at 20 ms, exactly with the second byte: the turn is behind it.
    #[test]
    fn a_turn_is_between_two_chunks() {
        let turns = |chunks: &[(u64, &[u8])], pauses: &[u64]| {
            let mut tail = tail(chunks);
            tail.pauses = pauses.iter().map(|&millis| at(millis)).collect();
            (0..tail.bytes.len())
                .map(|place| tail.is_turn(place))
                .collect::<Vec<_>>()
        };
        let chunks: [(u64, &[u8]); 3] = [(10, &[1, 2]), (20, &[3]), (30, &[4])];
        assert_eq!(turns(&chunks, &[15]), [false, true, false, false]);
        assert_eq!(turns(&chunks, &[20]), [false, false, true, false]);
        assert_eq!(turns(&chunks, &[10, 29]), [false, true, true, false]);
        assert_eq!(turns(&chunks, &[9, 30, 99]), [false; 4]);
        assert_eq!(turns(&chunks, &[]), [false; 4]);
    }

    /// Invalid bytes have the reasons of the decoder, if it gives any.
    #[test]
    fn invalid_bytes_have_their_reasons() {
        use protocols::FrameError::{Length, Truncated};
        let bad = |errors| meaning(&What::Bad(errors));
        assert_eq!(bad(vec![]), (true, "no frame".to_owned()));
        let errors = vec![Truncated { found: 4 }, Length { max: 1, found: 2 }];
        let words = errors.iter().map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(words[0], "line went quiet after 4 bytes");
        assert_eq!(bad(errors), (true, words.join("; ")));
        let frame = What::Frame("go".to_owned());
        assert_eq!(meaning(&frame), (false, "go".to_owned()));
    }
}
