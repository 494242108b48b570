//! A case without a program: what a decoder makes of the bytes of a line.
//!
//! A dump of one direction says nothing of a program. What can go wrong with it again is that a
//! decoder finds other frames in it, other bytes outside of them, or another cause.

use protocols::Instant;
use serde::{Deserialize, Serialize};

use super::{Case, CaseError, Expectation, LinkBytes, VERSION};
use crate::TOOL;
use crate::capture::decode::diagnose::{self, diagnose};
use crate::capture::decode::transcript::Said;
use crate::capture::replay::{Passage, Recorded};
use crate::codec::{self, Codec, Stream, Stretch, What};
use crate::rig::line::Direction;
use crate::run::check::Check;

/// What a decoder makes of one direction of a link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Decoded {
    /// Name of the link.
    pub link: String,
    /// Which way: `to-master` or `to-device`.
    pub direction: String,
    /// Name of the protocol.
    pub protocol: String,
    /// Damage that the whole stream shows, as `hilrig decode --diagnose` tells it.
    #[serde(default)]
    pub diagnosis: Vec<String>,
    /// Frames in words and the bytes outside of them, one a line with its place.
    #[serde(default)]
    pub found: String,
}

/// A run of bytes with the time of the last of them.
type Piece<'a> = (Instant, &'a [u8]);

impl Recorded {
    /// Whether nobody answered: nothing reached the program, or it sent nothing.
    pub fn is_one_way(&self) -> bool {
        let is_heard = self.links.iter().any(|one| !one.arrivals.is_empty());
        let is_sent = self.links.iter().any(|one| !one.sent.bytes().is_empty());
        !(is_heard && is_sent)
    }
}

impl Case {
    /// Makes a case of what decoders make of `recorded` today. A line of no known protocol is left
    /// out; `None` if none is left.
    ///
    /// # Errors
    /// If the bytes have no form as a case.
    pub fn of_decoders(name: &str, recorded: &Recorded) -> Result<Option<Self>, CaseError> {
        let mut case = Self {
            case: VERSION,
            name: name.to_owned(),
            description: String::new(),
            tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
            end_ns: recorded.end.as_nanos(),
            is_foreign: false,
            expect: Expectation::default(),
            link: recorded.links.iter().map(LinkBytes::of).collect(),
            scenario: None,
        };
        // As they will be read from the file.
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
    /// Compares what a decoder makes of `recorded` now.
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

/// The first line in which two texts differ, in words.
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

/// What `codec` makes of one direction of a link.
fn decode(passage: &Passage, direction: Direction, codec: &'static Codec) -> Decoded {
    let mut stream = Stream::new(codec);
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
    let damages = diagnose(&diagnose::Line {
        bytes: &bytes,
        opposite: &[],
        codec: Some(codec),
        framing_errors,
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

/// A stretch as a line of text.
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
