//! Transcript of a capture: frames and events of all lines as text, in order of time.
//!
//! A frame has the time of its last byte. Bytes are known to be invalid only when a frame or a
//! silence follows. Entries therefore wait for a short, constant time before they are returned, so
//! that a long capture needs no more memory than a short one.

mod beside;
mod entry;
mod lane;
mod lines;

use core::time::Duration;
use std::collections::VecDeque;

use protocols::{FrameError, Instant, LineConfig};

use beside::Beside;
pub use entry::{Entry, Known, Said, Sum};
use lines::texts;

use super::pause::Pauses;

use crate::{Interface, Kind, Record};
use engine::codec::{Codec, RegisterNames, Stream, Stretch, What, words};
use engine::rig::line::Direction;

/// Minimum time that an entry waits for earlier ones: a record describes bytes before its time. On
/// lines slower than 57600 baud, a few entries may come late.
const PATIENCE: Duration = Duration::from_millis(100);
/// Number of bytes within which a protocol must be recognised. If none is, these bytes are text or
/// invalid, and the next bytes are examined.
const GUESS_MAX: usize = 4096;
/// Number of bytes that are examined first; it doubles each time. The result therefore depends on
/// the bytes alone, not on the chunks in which they came.
const GUESS_FIRST: usize = 64;
/// Minimum number of bytes in valid frames for a protocol to be accepted at once.
const GUESS_MIN: u64 = 44;
/// Number of bytes reported without a protocol that are examined again together with the next ones.
const UNKNOWN_MAX: usize = 512;
/// Maximum number of bytes of an unknown protocol that are reported at once.
const CHUNK_MAX: usize = 256;
/// Minimum length of a run of printable bytes among invalid ones that is shown as text.
const TEXT_MIN: usize = 4;

/// One direction of a link.
struct Lane {
    /// The expected protocol.
    expected: Option<&'static Codec>,
    /// Names of its registers.
    names: Option<RegisterNames>,
    link: usize,
    direction: Direction,
    rate: LineConfig,
    /// Silence that separates the bytes of an unknown protocol.
    silence: Duration,
    /// Offsets at which the other direction sent bytes.
    turns: VecDeque<u64>,
    /// Whether the other direction has sent since the last byte.
    is_turned: bool,
    pauses: Pauses,
    /// The last bytes that were reported without a protocol.
    unknown: VecDeque<u8>,
    /// `None` until the bytes have shown the protocol.
    stream: Option<Stream>,
    codec: Option<&'static Codec>,
    /// Number of unreported bytes to examine next, while there is no stream.
    look_at: usize,
    /// Bytes that were not reported yet, and their offset in the stream.
    untold: VecDeque<u8>,
    told: u64,
    beside: Beside,
    /// End offsets of the chunks of these bytes, with their times.
    times: VecDeque<(u64, Instant)>,
    framed: u64,
}

/// Converter of records to lines of text.
#[derive(Default)]
pub struct Transcript {
    known: Vec<Known>,
    lanes: Vec<Lane>,
    waiting: VecDeque<Entry>,
    codec: Option<&'static Codec>,
    pauses: Pauses,
}

impl Transcript {
    /// A transcript in which all lanes carry `codec`; without one, the first bytes of each lane
    /// decide.
    pub fn new(codec: Option<&'static Codec>) -> Self {
        Self {
            codec,
            ..Self::default()
        }
    }

    /// Sets the known protocols of lanes, if the lanes have frames of them. The other lanes are
    /// recognised by their bytes.
    #[must_use]
    pub fn knowing(mut self, known: Vec<Known>) -> Self {
        self.known = known;
        self
    }

    /// Sets the judgement of pauses for the clock of the capture.
    #[must_use]
    pub fn pausing(mut self, pauses: Pauses) -> Self {
        self.pauses = pauses;
        self
    }

    /// Adds the next record of `link`.
    pub fn record(&mut self, record: &Record, link: &Interface) {
        let now = record.at;
        let index = self.lane(record, link);
        for other in 0..self.lanes.len() {
            let len = if other == index {
                record.bytes.len()
            } else {
                0
            };
            if self.lanes[other].is_over(now, len) {
                self.settle(other);
            }
        }
        self.turn(index, record);
        let place = self.lanes[index].end();
        let event = match record.kind {
            Kind::Data | Kind::Line(_) => words::one_line(&record.comment),
            Kind::Other(number) => format!("number {number} {}", words::one_line(&record.comment)),
        };
        if !event.is_empty() {
            self.report(index, now, place, Said::Event(event));
        }
        if record.kind == Kind::Data {
            let rate = self.lanes[index].rate;
            for (at, bytes) in record.chunks(rate) {
                self.feed(index, at, bytes);
            }
        }
    }

    /// Entries that no earlier one can precede any more at the time `now`.
    pub fn ready(&mut self, now: Instant) -> impl Iterator<Item = Entry> {
        let untold = self.lanes.iter().filter_map(Lane::first_untold).min();
        let count = self.waiting.partition_point(|entry| {
            now - entry.at > PATIENCE && untold.is_none_or(|untold| entry.at <= untold)
        });
        self.waiting.drain(..count)
    }

    /// All entries so far, without waiting for earlier ones.
    pub fn all(&mut self) -> impl Iterator<Item = Entry> {
        self.waiting.drain(..)
    }

    /// The remaining entries, when no more records follow, or none for a long time.
    pub fn finish(&mut self) -> impl Iterator<Item = Entry> {
        (0..self.lanes.len()).for_each(|index| self.settle(index));
        self.waiting.drain(..)
    }

    /// Protocols of the lanes.
    pub fn sums(&self) -> impl Iterator<Item = Sum> {
        self.lanes.iter().map(|lane| Sum {
            link: lane.link,
            direction: lane.direction,
            codec: lane.codec,
            bytes: lane.end(),
            framed: lane.framed,
        })
    }

    fn lane(&mut self, record: &Record, link: &Interface) -> usize {
        let (link_index, direction) = (record.link, record.direction);
        let is_own = |lane: &Lane| (lane.link, lane.direction) == (link_index, direction);
        if let Some(index) = self.lanes.iter().position(is_own) {
            return index;
        }
        let mut known = self.known.iter();
        let known = known.rfind(|known| known.link == link.name && known.direction == direction);
        let mut others = self.lanes.iter();
        let other = others.find(|lane| lane.link == link_index);
        let mut stream = self.codec.map(|codec| Stream::towards(codec, direction));
        let beside = Beside::after(other.map(|lane| &lane.beside), stream.as_mut());
        self.lanes.push(Lane {
            expected: known.and_then(|known| known.codec),
            names: known.and_then(|known| known.names.clone()),
            link: link_index,
            direction,
            rate: LineConfig::new_8n1(link.baud.max(1)),
            silence: silence(link.baud),
            turns: VecDeque::new(),
            is_turned: false,
            pauses: self.pauses,
            unknown: VecDeque::new(),
            beside,
            stream,
            codec: self.codec,
            look_at: GUESS_FIRST,
            untold: VecDeque::new(),
            told: 0,
            times: VecDeque::new(),
            framed: 0,
        });
        self.lanes.len() - 1
    }

    /// Ends the message of the other direction of the link.
    fn turn(&mut self, index: usize, record: &Record) {
        let own = self.lanes[index].direction;
        let others = self.lanes.iter_mut();
        for other in others.filter(|lane| lane.link == record.link && lane.direction != own) {
            let end = other.end();
            other.is_turned |= record.kind == Kind::Data;
            if record.kind == Kind::Data && other.stream.is_none() && end > other.told {
                other.turns.push_back(end);
            }
        }
    }

    fn feed(&mut self, index: usize, at: Instant, bytes: &[u8]) {
        let link = self.lanes[index].link;
        let others = self.lanes.iter_mut().enumerate();
        for (_, other) in others.filter(|(at, lane)| *at != index && lane.link == link) {
            let end = other.end();
            other.beside.hear(end, bytes, other.stream.as_mut());
        }
        let lane = &mut self.lanes[index];
        lane.is_turned = false;
        lane.beside.send(bytes);
        lane.untold.extend(bytes);
        lane.times.push_back((lane.end(), at));
        match &mut lane.stream {
            Some(stream) => {
                let found = stream.push(bytes);
                self.told(index, found);
            }
            None => self.look(index),
        }
    }

    /// Searches for the protocol of a lane that has none.
    fn look(&mut self, index: usize) {
        loop {
            let lane = &mut self.lanes[index];
            let len = lane.look_at;
            if lane.stream.is_some() || lane.untold.len() < len {
                return;
            }
            let best = lane.best(len);
            let fewest = if len < GUESS_MAX { GUESS_MIN } else { 1 };
            if best.is_some_and(|(_, framed)| framed >= fewest) {
                lane.codec = best.map(|(codec, _)| codec);
                let all = lane.untold.len();
                self.decide(index, all);
            } else if len < GUESS_MAX {
                lane.look_at = 2 * len;
            } else {
                self.decide(index, len);
            }
        }
    }

    /// Reports the first `len` unreported bytes with the protocol found so far. Without a protocol
    /// they are text or data, which does not affect later bytes.
    fn decide(&mut self, index: usize, len: usize) {
        let lane = &mut self.lanes[index];
        let Some(codec) = lane.codec else {
            self.tell_unknown(index, len);
            return;
        };
        let pauses = lane.pauses;
        let held = &lane.untold.make_contiguous()[..len];
        let mut stream = Stream::towards(codec, lane.direction);
        let mut found = Vec::new();
        let (mut start, mut last) = (0, None);
        for &(end, at) in &lane.times {
            if start == len {
                break;
            }
            let until = usize::try_from(end - lane.told).expect("held in memory");
            let is_turned = lane.turns.contains(&(lane.told + start as u64));
            let pause = |last| Pauses::between(last, at, until - start, lane.rate);
            if last.is_some_and(|last| pause(last) > pauses.limit(Some(codec), is_turned)) {
                found.extend(stream.idle());
            }
            last = Some(at);
            lane.beside.give(lane.told + start as u64, &mut stream);
            found.extend(stream.push(&held[start..until.min(len)]));
            start = until.min(len);
        }
        lane.beside.give(u64::MAX, &mut stream);
        lane.stream = Some(stream);
        self.told(index, found);
    }

    /// Reports the first `len` unreported bytes of a lane without a protocol, message by message. A
    /// message ends with a silence, or where the other direction sends.
    fn tell_unknown(&mut self, index: usize, len: usize) {
        let lane = &mut self.lanes[index];
        lane.look_at = GUESS_FIRST;
        for chunk in lane.chunks(len) {
            let lane = &mut self.lanes[index];
            let place = lane.told;
            let (at, bytes) = lane.take(chunk);
            lane.unknown.extend(&bytes);
            let surplus = lane.unknown.len().saturating_sub(UNKNOWN_MAX);
            lane.unknown.drain(..surplus);
            self.report_bad(index, (at, place), &bytes, None);
        }
    }

    /// Reports all bytes of a lane that fell silent.
    fn settle(&mut self, index: usize) {
        let lane = &mut self.lanes[index];
        if lane.untold.is_empty() {
            return;
        }
        if lane.stream.is_none() {
            let all = lane.untold.len();
            lane.codec = lane.best(all).map(|(codec, _)| codec);
            self.decide(index, all);
        }
        let found = self.lanes[index].stream.as_mut().map(Stream::idle);
        self.told(index, found.unwrap_or_default());
    }

    fn told(&mut self, index: usize, found: Vec<Stretch>) {
        for Stretch { bytes: range, what } in found {
            let lane = &mut self.lanes[index];
            // A stream that began later than the lane counts from its own start.
            let len = usize::try_from(range.end - range.start).expect("held in memory");
            let place = lane.told;
            let (at, bytes) = lane.take(len);
            match what {
                What::Frame(words) => {
                    let lane = &mut self.lanes[index];
                    lane.framed += len as u64;
                    let named = lane.names.as_ref().and_then(|names| names.words(&bytes));
                    let words = named.unwrap_or(words);
                    self.report(index, at, place, Said::Frame(words));
                }
                What::Bad(errors) => self.report_bad(index, (at, place), &bytes, Some(errors)),
            }
        }
    }

    /// Reports bytes outside of frames and the text among them, with the errors of a known
    /// protocol.
    fn report_bad(
        &mut self,
        index: usize,
        (at, place): (Instant, u64),
        bytes: &[u8],
        mut errors: Option<Vec<FrameError>>,
    ) {
        let is_known = errors.is_some();
        let is_text = |byte: u8| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t');
        let runs: Vec<&[u8]> = bytes.chunk_by(|a, b| is_text(*a) == is_text(*b)).collect();
        let shown_as_text =
            |run: &[u8]| is_text(run[0]) && (run.len() >= TEXT_MIN || run.len() == bytes.len());
        let mut said = |bytes: &[u8]| match is_known {
            true => Said::Bad(bytes.to_vec(), errors.take().unwrap_or_default()),
            false => Said::Data(bytes.to_vec()),
        };
        let lane = &self.lanes[index];
        let of = lane.codec.filter(|_| is_known).zip(Some(lane.direction));
        let mut start = 0;
        let mut bad = 0..0;
        for run in runs {
            let own = start..start + run.len();
            start = own.end;
            if !shown_as_text(run) {
                bad.end = own.end;
                continue;
            }
            if !bad.is_empty() {
                let said = said(&bytes[bad.clone()]);
                self.report(index, at, place + bad.start as u64, said);
            }
            bad = own.end..own.end;
            for (from, said) in texts(run, of) {
                self.report(index, at, place + (own.start + from) as u64, said);
            }
        }
        if !bad.is_empty() {
            let said = said(&bytes[bad.clone()]);
            self.report(index, at, place + bad.start as u64, said);
        }
    }

    fn report(&mut self, index: usize, at: Instant, place: u64, said: Said) {
        let Lane {
            link, direction, ..
        } = self.lanes[index];
        let later = self.waiting.iter().rev();
        let later = later.take_while(|entry| entry.at > at).count();
        let entry = Entry {
            at,
            link,
            direction,
            place,
            said,
        };
        self.waiting.insert(self.waiting.len() - later, entry);
    }
}

/// Silence that separates messages of an unknown protocol: three characters; 2 ms at an unknown
/// rate.
pub(crate) fn silence(baud: u32) -> Duration {
    match baud {
        0 => Duration::from_millis(2),
        baud => LineConfig::new_8n1(baud).bytes_time(3),
    }
}

#[cfg(test)]
mod tests {
    use engine::codec;

    use super::*;

    fn record(millis: u64, bytes: &[u8], comment: &str) -> Record {
        Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(millis),
            direction: Direction::ToMaster,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: comment.to_owned(),
        }
    }

    /// Entries for these bytes when nothing follows, each with its offset.
    fn said(bytes: &[u8]) -> Vec<(u64, String)> {
        let mut transcript = Transcript::new(None);
        let link = Interface::new("x", 1_000_000);
        transcript.record(&record(5, bytes, ""), &link);
        let all = transcript.finish();
        all.map(|one| (one.place, one.said.to_string())).collect()
    }

    fn line(place: u64, words: &str) -> (u64, String) {
        (place, words.to_owned())
    }

    /// Four printable bytes in a row are text among others, three are not; a lone run of any length
    /// is.
    #[test]
    fn text_among_bad_bytes_is_told_by_itself() {
        assert_eq!(
            said(b"\x01\x02help\x03"),
            [
                line(0, "DATA 2 bytes 01 02"),
                line(2, "text \"help\""),
                line(6, "DATA 1 bytes 03"),
            ]
        );
        assert_eq!(
            said(b"\x01sos\x02"),
            [line(0, "DATA 5 bytes 01 73 6F 73 02")]
        );
        assert_eq!(said(b"sos"), [line(0, "text \"sos\"")]);
        assert_eq!(
            said(b"help\x01"),
            [line(0, "text \"help\""), line(4, "DATA 1 bytes 01"),]
        );
        assert_eq!(
            said(b"\x01ab\t~ \r\n"),
            [
                line(0, "DATA 1 bytes 01"),
                line(1, "text \"ab\\t~ \\r\\n\""),
            ]
        );
    }

    /// Of many invalid bytes, 32 are shown.
    #[test]
    fn bad_bytes_are_shown_up_to_so_many() {
        let shown = |len: usize| Said::Bad(vec![b'x'; len], Vec::new()).to_string();
        let xs = "x".repeat(32);
        assert_eq!(shown(32), format!("BAD 32 bytes \"{xs}\""));
        assert_eq!(shown(33), format!("BAD 33 bytes \"{xs}..\""));
    }

    /// NMEA 0183: the checksum of "GPGGA,1" is 0x4B, by exclusive or. A sentence with another one is
    /// damage, also without any other byte that is no text; words of the device are text.
    #[test]
    fn a_sentence_with_a_wrong_checksum_is_damage() {
        let text = "name = \"nmea\"\nabout = \"sentences\"\nline = { baud = 9600 }\n\
                    frame = { start = \"$\", end = \"\\r\\n\", checksum = \"nmea\" }\n\
                    message = [{ name = \"gga\", from = \"device\", text = \"GPGGA,1\" }]\n\
                    every = [{ period = \"1s\", send = [\"gga\"] }]\n";
        let none = |_: &str| Err("no file".to_owned());
        let description = ::description::Description::parse("nmea.toml", text, &none);
        let codec = engine::scenario::device::description::codec_of(&description.expect("sound"));
        let mut transcript = Transcript::new(Some(codec));
        let bytes = b"$GPGGA,1*4B\r\nboot\r\n$GPGGA,1*4C\r\nready\r\n$GPGGA,1*4B\r\n";
        transcript.record(&record(5, bytes, ""), &Interface::new("x", 9_600));
        let all: Vec<_> = transcript
            .finish()
            .map(|one| (one.place, one.said))
            .collect();
        let bad = all.iter().find(|(_, said)| matches!(said, Said::Bad(..)));
        let (place, bad) = bad.expect("a damaged sentence");
        assert_eq!(*place, 19);
        let words = bad.to_string();
        assert!(words.starts_with("BAD 13 bytes \"$GPGGA,1*4C"), "{words}");
        assert!(words.contains("checksum"), "{words}");
        let texts = all.iter().filter(|(_, said)| matches!(said, Said::Text(_)));
        assert_eq!(texts.count(), 2);
        let frames = all
            .iter()
            .filter(|(_, said)| matches!(said, Said::Frame(_)));
        assert_eq!(frames.count(), 2);
    }

    /// Events precede the bytes of their record, in order of time, on one line.
    #[test]
    fn what_is_told_later_of_an_earlier_time_stands_before() {
        let mut transcript = Transcript::new(None);
        let link = Interface::new("x", 1_000_000);
        transcript.record(&record(5, b"help", ""), &link);
        transcript.record(&record(6, b"", "fault:\none"), &link);
        let kind = Kind::Other(7);
        let other = Record {
            kind,
            ..record(7, b"", "two")
        };
        transcript.record(&other, &link);
        let all: Vec<_> = transcript.finish().collect();
        let all: Vec<_> = all
            .iter()
            .map(|one| (one.at.as_millis(), one.said.to_string()))
            .collect();
        assert_eq!(
            all,
            [
                line(5, "text \"help\""),
                line(6, "EVENT fault: one"),
                line(7, "EVENT number 7 two"),
            ]
        );
        let sums: Vec<_> = transcript.sums().collect();
        let sum = Sum {
            link: 0,
            direction: Direction::ToMaster,
            codec: None,
            bytes: 4,
            framed: 0,
        };
        assert_eq!(sums, [sum]);
    }

    /// An entry is returned when no other lane can have an earlier one: 100 ms later, and not
    /// before an earlier entry of a lane that is still examined.
    #[test]
    fn a_line_waits_for_earlier_ones() {
        let mut transcript = Transcript::new(None);
        let link = Interface::new("x", 1_000_000);
        transcript.record(&record(10, b"", "one"), &link);
        let ready = |transcript: &mut Transcript, millis| {
            transcript.ready(Instant::from_millis(millis)).count()
        };
        assert_eq!(ready(&mut transcript, 110), 0);
        assert_eq!(ready(&mut transcript, 111), 1);
        transcript.record(&record(200, b"abc", ""), &link);
        transcript.record(&record(200, b"", "two"), &link);
        transcript.record(&record(201, b"", "three"), &link);
        assert_eq!(ready(&mut transcript, 400), 1);
        assert_eq!(transcript.all().count(), 1);
    }

    /// Bytes between two texts have their own offset.
    #[test]
    fn bad_bytes_between_texts_have_their_place() {
        assert_eq!(
            said(b"help\x01more\x02"),
            [
                line(0, "text \"help\""),
                line(4, "DATA 1 bytes 01"),
                line(5, "text \"more\""),
                line(9, "DATA 1 bytes 02"),
            ]
        );
    }

    /// No protocol appears in 64, 128 and so on up to 2048 bytes: these are held. At 4096 bytes
    /// they are reported.
    #[test]
    fn bytes_of_no_protocol_are_held_for_so_long() {
        let mut transcript = Transcript::new(None);
        let link = Interface::new("x", 1_000_000);
        let mut told = |bytes: usize| {
            transcript.record(&record(5, &vec![2; bytes], ""), &link);
            transcript.lanes[0].told
        };
        assert_eq!([64, 1, 4_030, 1, 1].map(&mut told), [0, 0, 0, 4_096, 4_096]);
        // The next bytes are examined from there on.
        assert_eq!([4_094, 1].map(&mut told), [4_096, 8_192]);
    }

    /// One frame of five bytes among 64 or 4096 may be chance; two frames are not.
    #[test]
    fn a_single_frame_is_not_believed_at_once() {
        use protocols::avr::{ChecksumOrder, Frame};
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let mut transcript = Transcript::new(None);
        let link = Interface::new("x", 1_000_000);
        let mut framed = |bytes: &[u8]| {
            transcript.record(&record(5, bytes, ""), &link);
            let sum = transcript.sums().next().expect("one lane");
            (sum.codec.is_some(), sum.framed)
        };
        let first = [frame.as_bytes(), &[2; 59]].concat();
        assert_eq!(framed(&first), (false, 0));
        assert_eq!(framed(&[2; 4_031]), (false, 0));
        assert_eq!(framed(&[2; 1]), (false, 0));
        let two = [frame.as_bytes(), frame.as_bytes(), &[2; 54]].concat();
        framed(&two);
        let all: Vec<_> = transcript.finish().collect();
        let frames = all.iter().filter(|one| matches!(one.said, Said::Frame(_)));
        assert_eq!(frames.count(), 2);
    }

    /// Three requests and replies of an unknown protocol. Each is reported separately, with its own
    /// time and offset. At 9,600 baud a character takes 1.04 ms, so a silence of 4 ms separates
    /// them.
    #[test]
    fn requests_and_answers_of_an_unknown_protocol_stay_apart() {
        let mut transcript = Transcript::new(None);
        let link = Interface::new("x", 9_600);
        for turn in 0..3 {
            let request = Record {
                direction: Direction::ToDevice,
                ..record(10 + 30 * turn, &[1, 3, 0], "")
            };
            transcript.record(&request, &link);
            transcript.record(&record(20 + 30 * turn, &[1, 3], ""), &link);
            transcript.record(&record(27 + 30 * turn, &[0xC9, 0xC8], ""), &link);
        }
        let told = |one: Entry| (one.at.as_millis(), one.place, one.said.to_string());
        let all: Vec<_> = transcript.finish().map(told).collect();
        let line = |at, place, words: &str| (at, place, words.to_owned());
        assert_eq!(
            all[..4],
            [
                line(10, 0, "DATA 3 bytes 01 03 00"),
                line(20, 0, "DATA 2 bytes 01 03"),
                line(27, 2, "DATA 2 bytes C9 C8"),
                line(40, 3, "DATA 3 bytes 01 03 00"),
            ]
        );
        assert_eq!(all.len(), 9);
    }

    /// A frame in two chunks within its protocol's idle time is one frame.
    #[test]
    fn a_frame_may_come_in_pieces() {
        use protocols::avr::{ChecksumOrder, Frame};
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let (begin, rest) = frame.as_bytes().split_at(2);
        let mut transcript = Transcript::new(None);
        let link = Interface::new("x", 1_000_000);
        transcript.record(&record(5, begin, ""), &link);
        transcript.record(&record(6, rest, ""), &link);
        let all: Vec<_> = transcript.finish().collect();
        assert_eq!(all.len(), 1);
        assert!(matches!(&all[0].said, Said::Frame(words) if words.contains("36")));
    }

    /// Of two whole frames and half of one, ten bytes are valid; the unreported bytes came with the
    /// half.
    #[test]
    fn what_is_told_of_a_lane_is_no_longer_waited_for() {
        use protocols::avr::{ChecksumOrder, Frame};
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let codec = codec::guess(frame.as_bytes());
        let mut transcript = Transcript::new(codec);
        let link = Interface::new("x", 1_000_000);
        transcript.record(&record(5, frame.as_bytes(), ""), &link);
        transcript.record(&record(6, frame.as_bytes(), ""), &link);
        assert_eq!(transcript.lanes[0].first_untold(), None);
        transcript.record(&record(7, &frame.as_bytes()[..3], ""), &link);
        let first = transcript.lanes[0].first_untold();
        assert_eq!(first, Some(Instant::from_millis(7)));
        let sums: Vec<_> = transcript
            .sums()
            .map(|sum| (sum.bytes, sum.framed))
            .collect();
        assert_eq!(sums, [(13, 10)]);
    }

    /// Words of all entries of these records of link 0 or 1 at 1 Mbaud, all at 10 ms.
    fn at_once(records: &[(usize, Direction, Kind, &[u8])]) -> Vec<String> {
        let mut transcript = Transcript::new(None);
        let links = ["x", "y"].map(|name| Interface::new(name, 1_000_000));
        for &(link, direction, kind, bytes) in records {
            let record = Record {
                link,
                direction,
                kind,
                ..record(10, bytes, "")
            };
            transcript.record(&record, &links[link]);
        }
        let all = transcript.finish();
        all.map(|one| format!("{} {}", one.link, one.said))
            .collect()
    }

    /// Bytes of the other direction of the link end a message, even without a silence. Those of
    /// another link do not, nor do events.
    #[test]
    fn a_message_ends_where_the_other_direction_sends() {
        let (to, from, data) = (Direction::ToDevice, Direction::ToMaster, Kind::Data);
        let around = |between: (usize, Direction, Kind, &'static [u8])| {
            let mut all = at_once(&[(0, from, data, &[1, 2]), between, (0, from, data, &[4, 5])]);
            all.retain(|words| !words.contains("03") && !words.contains("EVENT"));
            all
        };
        let apart = ["0 DATA 2 bytes 01 02", "0 DATA 2 bytes 04 05"];
        assert_eq!(around((0, to, data, &[3])), apart);
        let whole = ["0 DATA 4 bytes 01 02 04 05"];
        assert_eq!(around((1, to, data, &[3])), whole);
        assert_eq!(around((0, to, Kind::Other(7), &[])), whole);
        assert_eq!(around((1, from, data, &[3])), whole);
    }

    /// 44 bytes in frames among 64 prove a protocol at once, 40 do not.
    #[test]
    fn many_frames_are_believed_at_once() {
        use protocols::avr::{ChecksumOrder, Frame};
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let framed = |frames: usize| {
            let mut transcript = Transcript::new(None);
            let mut bytes = frame.as_bytes().repeat(frames);
            bytes.resize(64, 2);
            transcript.record(&record(5, &bytes, ""), &Interface::new("x", 1_000_000));
            transcript.sums().next().map(|sum| sum.framed)
        };
        assert_eq!((framed(9), framed(8)), (Some(45), Some(0)));
    }

    /// An expected protocol without any frame gives way to the one that the bytes show.
    #[test]
    fn an_expected_protocol_needs_a_frame() {
        use protocols::xv11;
        let known = Known {
            link: "x".to_owned(),
            direction: Direction::ToMaster,
            codec: Some(&codec::BUS),
            names: None,
        };
        let frames = (0..6).flat_map(|index| {
            let invalid = xv11::Reading::Invalid {
                code: 0x35,
                strength: 0,
            };
            let readings = [xv11::RawReading::from(invalid); 4];
            *xv11::Frame::new(index, xv11::SpeedWord(19_200), readings).as_bytes()
        });
        let frames: Vec<u8> = frames.collect();
        let mut transcript = Transcript::new(None).knowing(vec![known]);
        transcript.record(&record(5, &frames, ""), &Interface::new("x", 1_000_000));
        drop(transcript.finish().collect::<Vec<_>>());
        let sum = transcript.sums().next().expect("one lane");
        assert_eq!((sum.codec, sum.framed), (Some(&codec::XV11), 132));
    }

    /// At 10,000 baud a byte takes a millisecond, and three of them are a silence. At an unknown
    /// rate, bytes take no time and 2 ms are a silence.
    #[test]
    fn messages_of_an_unknown_protocol_end_with_a_silence() {
        let lens = |baud: u32, second: u64| -> Vec<u64> {
            let mut transcript = Transcript::new(None);
            let link = Interface::new("x", baud);
            for at in [10, second] {
                transcript.record(&record(at, &[1, 2], ""), &link);
            }
            transcript.finish().map(|one| one.place).collect()
        };
        assert_eq!((lens(10_000, 15), lens(10_000, 16)), (vec![0], vec![0, 2]));
        assert_eq!((lens(0, 12), lens(0, 13)), (vec![0], vec![0, 2]));
        assert_eq!(
            (silence(0).as_millis(), silence(10_000).as_millis()),
            (2, 3)
        );
    }

    /// A known protocol counts for its own link and direction: then a single frame is believed.
    #[test]
    fn a_known_protocol_is_that_of_its_direction() {
        use protocols::avr::{ChecksumOrder, Frame};
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let bytes = [frame.as_bytes(), &[2; 59]].concat();
        let frames = |link: &str, direction| {
            let known = Known {
                link: link.to_owned(),
                direction,
                codec: Some(&codec::BUS),
                names: None,
            };
            let mut transcript = Transcript::new(None).knowing(vec![known]);
            transcript.record(&record(5, &bytes, ""), &Interface::new("x", 1_000_000));
            let all: Vec<_> = transcript.finish().collect();
            all.iter()
                .filter(|one| matches!(one.said, Said::Frame(_)))
                .count()
        };
        assert_eq!(frames("x", Direction::ToMaster), 1);
        assert_eq!(frames("x", Direction::ToDevice), 0);
        assert_eq!(frames("y", Direction::ToMaster), 0);
    }

    /// Commands of a model car: 94 64 is motor 10 and steering 50, and a pause of more than 5 ms
    /// divides two bytes. At 10,000 baud a byte takes a millisecond of the time before it. Bytes
    /// were reported before these.
    #[test]
    fn a_pause_among_the_first_bytes_divides_frames() {
        let frames = |second: u64| {
            let known = Known {
                link: "x".to_owned(),
                direction: Direction::ToMaster,
                codec: Some(&codec::CAR_COMMAND),
                names: None,
            };
            let mut transcript = Transcript::new(None).knowing(vec![known]);
            let link = Interface::new("x", 10_000);
            transcript.record(&record(1, b"", ""), &link);
            transcript.lanes[0].told = 100;
            transcript.record(&record(10, &[0x94], ""), &link);
            transcript.record(&record(second, &[0x64, 0x94], ""), &link);
            transcript.record(&record(second + 1, &[0x64], ""), &link);
            let all: Vec<_> = transcript.finish().collect();
            let frames = all.iter().filter(|one| matches!(one.said, Said::Frame(_)));
            let places: Vec<u64> = frames.map(|one| one.place).collect();
            places
        };
        assert_eq!(frames(17), [100, 102]);
        assert_eq!(frames(18), [102]);
    }
}
