//! A case without a program: the output of a decoder for the bytes of a line.
//!
//! A dump of one direction contains nothing about a program. Such a case detects three regressions:
//! a decoder finds other frames, other bytes outside of frames, or another cause of damage.

use protocols::Instant;
use serde::{Deserialize, Serialize};

use super::{Case, CaseError, Expectation, LinkBytes, VERSION};
use crate::decode::diagnose::{self, diagnose};
use crate::decode::transcript::Said;
use crate::replay::{Passage, Recorded};
use engine::TOOL;
use engine::codec::{self, Codec, Stream, Stretch, What};
use engine::rig::line::Direction;
use engine::run::check::Check;

/// Expected output of a decoder for one direction of a link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Decoded {
    /// Name of the link.
    pub link: String,
    /// Direction: `to-master` or `to-device`.
    pub direction: String,
    /// Name of the protocol.
    pub protocol: String,
    /// Damage of the whole stream, in the words of `hilrig decode --diagnose`.
    #[serde(default)]
    pub diagnosis: Vec<String>,
    /// Frames in words, and the bytes outside of them; one a line with its offset.
    #[serde(default)]
    pub found: String,
}

/// Bytes with the time of the last of them.
type Piece<'a> = (Instant, &'a [u8]);

impl Recorded {
    /// Whether the recording has one direction only: nothing reached the program, or it sent
    /// nothing.
    pub fn is_one_way(&self) -> bool {
        let is_heard = self.links.iter().any(|one| !one.arrivals.is_empty());
        let is_sent = self.links.iter().any(|one| !one.sent.bytes().is_empty());
        !(is_heard && is_sent)
    }
}

impl Case {
    /// Makes a case from the present decoder output for `recorded`. A line of an unknown protocol
    /// is left out; `None` if no line remains.
    ///
    /// # Errors
    /// If the bytes cannot be written as a case.
    pub fn of_decoders(name: &str, recorded: &Recorded) -> Result<Option<Self>, CaseError> {
        let mut case = Self {
            case: VERSION,
            name: name.to_owned(),
            description: String::new(),
            tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
            end_ns: recorded.end.as_nanos(),
            is_foreign: false,
            play: None,
            expect: Expectation::default(),
            link: recorded.links.iter().map(LinkBytes::of).collect(),
            scenario: None,
        };
        // Decodes the bytes as a reader of the file will get them.
        let recorded = case.recorded(name.as_ref())?;
        for passage in &recorded.links {
            for direction in [Direction::ToMaster, Direction::ToDevice] {
                let bytes = pieces(passage, direction)
                    .map(|(_, bytes)| bytes)
                    .collect::<Vec<_>>();
                if let Some(codec) = codec::guess(&bytes.concat()) {
                    case.expect.decoder.push(decode(passage, direction, codec));
                }
            }
        }
        Ok((!case.expect.decoder.is_empty()).then_some(case))
    }
}

impl Decoded {
    /// Compares the present decoder output for `recorded` with the expected one.
    pub(super) fn judge(&self, recorded: &Recorded) -> Vec<Check> {
        let line = format!("{}-{}", self.link, self.direction);
        let now = match self.now(recorded) {
            Ok(now) => now,
            Err(flaw) => return vec![Check::new(&format!("decodes-{line}"), false, flaw)],
        };
        let frames = now
            .found
            .lines()
            .filter(|line| !line.contains(" BAD "))
            .count();
        let difference = first_difference(&self.found, &now.found);
        let is_same = difference.is_none();
        let detail = difference.unwrap_or_else(|| format!("the same {frames} frames"));
        let causes = |decoded: &Self| match decoded.diagnosis.is_empty() {
            true => "no systematic damage".to_owned(),
            false => decoded.diagnosis.join("; "),
        };
        let same_cause = self.diagnosis == now.diagnosis;
        let cause = match same_cause {
            true => causes(&now),
            false => format!("expected {}, found {}", causes(self), causes(&now)),
        };
        vec![
            Check::new(&format!("decodes-{line}"), is_same, detail),
            Check::new(&format!("diagnosis-{line}"), same_cause, cause),
        ]
    }

    fn now(&self, recorded: &Recorded) -> Result<Self, String> {
        let links = &mut recorded.links.iter();
        let passage = links.find(|one| one.link == self.link);
        let passage = passage.ok_or_else(|| format!("no link {} in the case", self.link))?;
        let ways = [Direction::ToMaster, Direction::ToDevice];
        let way = ways.into_iter().find(|way| way.name() == self.direction);
        let way = way.ok_or("direction: expected to-master or to-device")?;
        let codec = codec::find(&self.protocol).ok_or_else(|| {
            let known = codec::names().join(", ");
            format!("protocol {}: expected one of {known}", self.protocol)
        })?;
        Ok(decode(passage, way, codec))
    }
}

/// Describes the first line in which two texts differ.
fn first_difference(expected: &str, found: &str) -> Option<String> {
    if expected == found {
        return None;
    }
    let mut lines = [expected, found].map(str::lines);
    for number in 1.. {
        let [expected, found] = lines.each_mut().map(Iterator::next);
        if expected != found || expected.is_none() {
            let [expected, found] = [expected, found].map(|line| line.unwrap_or("nothing more"));
            return Some(format!("line {number}: expected {expected}, found {found}"));
        }
    }
    None
}

fn pieces(passage: &Passage, direction: Direction) -> Box<dyn Iterator<Item = Piece<'_>> + '_> {
    match direction {
        Direction::ToMaster => {
            let arrivals = passage.arrivals.iter();
            Box::new(arrivals.map(|arrival| (arrival.at, &arrival.bytes[..])))
        }
        Direction::ToDevice => Box::new(passage.sent.pieces()),
    }
}

/// Output of `codec` for one direction of a link.
fn decode(passage: &Passage, direction: Direction, codec: &'static Codec) -> Decoded {
    let mut stream = Stream::towards(codec, direction);
    let (mut bytes, mut found) = (Vec::new(), Vec::new());
    let (mut last, mut framing_errors) = (None, 0);
    for (at, piece) in pieces(passage, direction) {
        let is_late = |last: Instant| {
            at - last > codec.idle() + passage.line().bytes_time(piece.len() as u64)
        };
        if last.is_some_and(is_late) {
            found.extend(stream.idle());
        }
        last = Some(at);
        framing_errors += u64::from(piece.is_empty());
        bytes.extend_from_slice(piece);
        found.extend(stream.push(piece));
    }
    found.extend(stream.idle());
    let frames = found.iter().filter(|stretch| stretch.is_frame());
    let framed = frames.map(|one| one.bytes.end - one.bytes.start).sum();
    let damages = diagnose(&diagnose::Line {
        bytes: &bytes,
        codec: Some(codec),
        direction: Some(direction),
        framing_errors,
        framed: Some(framed),
        ..diagnose::Line::default()
    });
    let lines = found.into_iter().map(|stretch| line(&bytes, stretch));
    Decoded {
        link: passage.link.clone(),
        direction: direction.name().to_owned(),
        protocol: codec.name().to_owned(),
        diagnosis: damages.iter().map(ToString::to_string).collect(),
        found: lines.collect(),
    }
}

/// One line of text for a stretch.
fn line(bytes: &[u8], Stretch { bytes: range, what }: Stretch) -> String {
    let place = range.start;
    let index = |place| usize::try_from(place).expect("held in memory");
    let said = match what {
        What::Frame(words) => Said::Frame(words),
        What::Bad(errors) => {
            Said::Bad(bytes[index(range.start)..index(range.end)].to_vec(), errors)
        }
    };
    format!("@{place} {said}\n")
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use protocols::avr::{ChecksumOrder, Frame};

    use super::*;
    use crate::divergence::Track;
    use crate::replay::Arrival;
    use engine::run::check::Status;

    /// Two register reads towards the base, with a byte between them that belongs to neither.
    fn recorded(second: u8) -> Recorded {
        let read = |register| Frame::read(register, 10, ChecksumOrder::LowFirst);
        let (one, other) = (read(36), read(second));
        let bytes = [one.as_bytes(), &[0x01], other.as_bytes()].concat();
        let mut sent = Track::default();
        sent.push(Instant::from_millis(1), &bytes);
        let base = Passage {
            link: "base".to_owned(),
            baud: 1_000_000,
            arrivals: Vec::new(),
            heard: Vec::new(),
            sent,
            opened: Vec::new(),
        };
        Recorded {
            links: vec![base],
            end: Instant::from_secs(1),
            zero: Instant::ZERO,
        }
    }

    fn decoded() -> Decoded {
        let case = Case::of_decoders("x", &recorded(60)).expect("it has a form");
        let case = case.expect("there are frames");
        assert!(case.scenario.is_none() && !case.is_foreign);
        let [one] = &case.expect.decoder[..] else {
            panic!("{:?}", case.expect)
        };
        one.clone()
    }

    fn verdicts(of: &Decoded, recorded: &Recorded) -> Vec<(Status, String)> {
        let checks = of.judge(recorded).into_iter();
        checks.map(|check| (check.status, check.detail)).collect()
    }

    #[test]
    fn the_same_bytes_are_the_same_frames_and_the_same_cause() {
        let decoded = decoded();
        assert_eq!((&*decoded.link, &*decoded.direction), ("base", "to-device"));
        assert!(decoded.diagnosis.is_empty());
        let places: Vec<_> = decoded.found.lines().map(|line| &line[..2]).collect();
        assert_eq!(places, ["@0", "@5", "@6"]);
        let same = [
            (Status::Pass, "the same 2 frames".to_owned()),
            (Status::Pass, "no systematic damage".to_owned()),
        ];
        assert_eq!(verdicts(&decoded, &recorded(60)), same);
        let names: Vec<_> = decoded
            .judge(&recorded(60))
            .into_iter()
            .map(|one| one.name)
            .collect();
        assert_eq!(
            names,
            ["decodes-base-to-device", "diagnosis-base-to-device"]
        );
    }

    /// Eight characters without a stop bit beside fifty bytes are more than one in fifty.
    #[test]
    fn what_was_no_character_is_a_cause() {
        let read = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let bytes = [read.as_bytes(); 10].into_iter().chain([&[][..]; 8]);
        let arrivals = (1..).zip(bytes).map(|(millis, bytes)| Arrival {
            at: Instant::from_millis(millis),
            bytes: bytes.to_vec(),
        });
        let mut recorded = recorded(60);
        recorded.links[0].arrivals = arrivals.collect();
        recorded.links[0].sent = Track::default();
        let case = Case::of_decoders("x", &recorded).expect("it has a form");
        let decoder = case.expect("there are frames").expect.decoder;
        let cause = "wrong baud rate (8 characters without a stop bit beside 50 bytes)";
        assert_eq!(
            (decoder.len(), &decoder[0].diagnosis[..]),
            (1, &[cause.to_owned()][..])
        );
    }

    #[test]
    fn another_frame_or_cause_is_told_with_both() {
        let verdict = verdicts(&decoded(), &recorded(61)).remove(0);
        assert_eq!(verdict.0, Status::Fail);
        let said = &verdict.1;
        assert!(
            said.starts_with("line 3: expected @6 read 10 from 60"),
            "{said}"
        );
        assert!(said.contains(", found @6 read 10 from 61"), "{said}");
        let other = Decoded {
            diagnosis: vec!["one".to_owned(), "two".to_owned()],
            ..decoded()
        };
        let cause = (
            Status::Fail,
            "expected one; two, found no systematic damage".to_owned(),
        );
        assert_eq!(verdicts(&other, &recorded(60)).remove(1), cause);
    }

    #[test]
    fn what_is_not_there_fails_with_what_there_is() {
        let of = |change: fn(&mut Decoded)| {
            let mut other = decoded();
            change(&mut other);
            let all = verdicts(&other, &recorded(60));
            assert_eq!((all.len(), all[0].0), (1, Status::Fail));
            all[0].1.clone()
        };
        assert_eq!(of(|one| one.link.push('x')), "no link basex in the case");
        let direction = "direction: expected to-master or to-device";
        assert_eq!(of(|one| one.direction.clear()), direction);
        let protocol = of(|one| "nothing".clone_into(&mut one.protocol));
        assert!(
            protocol.starts_with("protocol nothing: expected one of "),
            "{protocol}"
        );
    }

    #[test]
    fn texts_differ_in_their_first_line_that_does() {
        assert_eq!(first_difference("a\nb\n", "a\nb\n"), None);
        let said = |expected, found| first_difference(expected, found).expect("they differ");
        assert_eq!(said("a\nb\n", "a\nc\n"), "line 2: expected b, found c");
        assert_eq!(
            said("a\n", "a\nc\n"),
            "line 2: expected nothing more, found c"
        );
        assert_eq!(said("a\nb", ""), "line 1: expected a, found nothing more");
    }

    /// With bytes in both directions, one side sent requests and the other replied.
    #[test]
    fn a_dump_is_one_way_unless_both_ends_speak() {
        let mut both = recorded(60);
        assert!(both.is_one_way());
        both.links[0].arrivals.push(Arrival {
            at: Instant::ZERO,
            bytes: vec![1],
        });
        assert!(!both.is_one_way());
        both.links[0].sent = Track::default();
        assert!(both.is_one_way());
    }

    /// The two halves of a frame are one frame if the second half follows at once. Five seconds
    /// later they are none: a partial frame is discarded after the idle time.
    #[test]
    fn silence_breaks_a_frame_in_two() {
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let (codec, _) = codec::best(frame.as_bytes()).expect("a frame");
        let found = |cut: usize, second: Instant| {
            let mut recorded = recorded(60);
            let mut sent = Track::default();
            sent.push(Instant::from_millis(1), &frame.as_bytes()[..cut]);
            sent.push(second, &frame.as_bytes()[cut..]);
            recorded.links[0].sent = sent;
            decode(&recorded.links[0], Direction::ToDevice, codec).found
        };
        let whole = found(5, Instant::from_millis(1));
        assert_eq!(found(3, Instant::from_millis(1)), whole);
        assert_ne!(found(3, Instant::from_secs(5)), whole);
        // Two bytes at 1 Mbaud take 20 us. The silence before them is the idle time of a partial
        // frame, or a nanosecond longer.
        let kept = Instant::from_micros(1_020) + codec.idle();
        assert_eq!(found(3, kept), whole);
        assert_ne!(found(3, kept + Duration::from_nanos(1)), whole);
    }
}
