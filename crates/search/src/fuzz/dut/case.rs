use core::time::Duration;
use std::collections::BTreeSet;

use emulators::rng::Rng;
use serde::{Deserialize, Serialize};

use engine::codec::wire::Stream;
use engine::scenario::{DirectionSpec, Expect, FaultKind, FaultSpec, Scenario, Span};

/// How long the devices are at work, in virtual time, before the program comes: a lidar turns by
/// then.
pub(super) const WARM_UP: Duration = Duration::from_secs(5);
/// Maximum number of faults of a case.
const FAULTS_MAX: u64 = 6;

/// What is done to a program, as a value.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// World, devices, and the faults in what the program receives.
    pub scenario: Scenario,
    /// The rest.
    pub told: Told,
}

/// What a finding's folder holds besides the scenario.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told {
    /// How long the scenario lasts before the program must show that it lives.
    pub lasting: Span,
    /// What the program does when nothing is wrong.
    pub known: Known,
    /// Traffic in place of a device's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<Raw>,
}

/// What a program does when nothing is wrong, by the names of the ports.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// It opens these.
    pub opens: BTreeSet<String>,
    /// It reads these.
    pub reads: BTreeSet<String>,
    /// It speaks on these by itself.
    pub speaks: BTreeSet<String>,
    /// It ends by itself with exit code 0.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub ends: bool,
}

/// Traffic on one link in place of a device's.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Raw {
    /// The link.
    pub link: String,
    /// Frames that the program answers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub answered: Vec<Answered>,
    /// Kinds of what it says there unasked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub chatter: Vec<Hex>,
    /// The beginning of a frame that the program answers, with silence after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cut: Option<Hex>,
    /// Sound replies of the device, for requests for which there is no turn.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exchange: Vec<Exchange>,
    /// Whether the program asks: then it gets a turn when it did, and not before.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub asks: bool,
    /// What is said to the program, one turn for each of its requests; in place of the stream.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub turn: Vec<Turn>,
    /// Pairs of frames, first of all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pair: Vec<Pair>,
    /// Then this: a piece a line, `idle` for a pause.
    #[serde(default)]
    pub stream: String,
}

impl Raw {
    /// Whether nothing is said.
    pub(super) const fn is_empty(&self) -> bool {
        let is_nothing = self.pair.is_empty() && self.stream.is_empty() && self.cut.is_none();
        self.turn.is_empty() && is_nothing
    }
}

/// A request of the program and what the device says to it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exchange {
    /// The request.
    pub request: Hex,
    /// The reply.
    pub reply: Hex,
}

/// What is said to the program in one go.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// How it was made, e.g. `wrong-length`.
    pub kind: String,
    /// Whether it differs from what a sound device says: then a program may refuse it.
    #[serde(rename = "altered")]
    pub is_altered: bool,
    /// The request to which it is the reply; none: to any, or unasked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<Hex>,
    /// The bytes, in pieces with a short pause between them.
    pub say: Vec<Hex>,
}

/// A frame that the program answers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answered {
    /// The frame.
    pub frame: Hex,
    /// The kinds of its answer, see [`Speech::shape`](super::Speech::shape).
    pub kinds: Vec<Hex>,
}

/// A frame that the program answers, damaged and not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Sound.
    pub good: Hex,
    /// No frame at all.
    pub damaged: Hex,
    /// The same number of bytes, without meaning in the format.
    pub noise: Hex,
}

/// Bytes that people can read.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Hex(pub Vec<u8>);

impl From<Hex> for String {
    fn from(hex: Hex) -> Self {
        Stream::raw(&hex.0).to_text().trim_end().to_owned()
    }
}

impl TryFrom<String> for Hex {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let stream = Stream::parse(&text).map_err(|error| error.to_string())?;
        Ok(Self(stream.bytes().to_vec()))
    }
}

impl core::fmt::Display for Hex {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(&String::from(self.clone()))
    }
}

/// `scenario` for a program that comes after the warm-up: its mission begins then, it has no faults
/// of its own, and the end of the mission is not judged.
pub(super) fn quiet(scenario: &Scenario, lasting: Duration) -> Scenario {
    let mut quiet = scenario.clone();
    quiet.mission.connect = Span(quiet.mission.connect.0 + WARM_UP);
    for step in &mut quiet.mission.step {
        step.at = step.at.map(|at| Span(at.0 + WARM_UP));
    }
    quiet.expect = Expect::default();
    quiet.fault.clear();
    (quiet.budget, quiet.phases) = (None, None);
    quiet.duration = Span(quiet.duration.0.max(WARM_UP + lasting));
    quiet
}

/// Kinds of faults in what a program receives. None delays: a program that asks again because an
/// answer is late breaks no rule, and the device could not tell the difference.
const KINDS: [FaultKind; 12] = [
    FaultKind::Flip,
    FaultKind::Drop,
    FaultKind::Insert,
    FaultKind::Duplicate,
    FaultKind::Burst,
    FaultKind::Truncate,
    FaultKind::Swap,
    FaultKind::Cut,
    FaultKind::StripNul,
    FaultKind::CrToLf,
    FaultKind::EatXonXoff,
    FaultKind::ClearBit7,
];
/// Chances per byte.
const RATES: [f64; 6] = [0.0003, 0.001, 0.003, 0.01, 0.03, 0.1];

/// Faults in what the program receives on `links`, from the end of the warm-up, for `lasting`.
pub(super) fn faults(links: &[String], lasting: Duration, rng: &mut Rng) -> Vec<FaultSpec> {
    let Some(last) = (links.len() as u64).checked_sub(1) else {
        return Vec::new();
    };
    let millis = u64::try_from(lasting.as_millis()).expect("a week at most");
    let count = 1 + rng.below(FAULTS_MAX);
    let fault = |_| {
        let link = &links[index(rng, last + 1)];
        let kind = KINDS[index(rng, KINDS.len() as u64)];
        let rate = RATES[index(rng, RATES.len() as u64)];
        let from = rng.below(millis.max(1));
        let until = (from + 1 + rng.below(millis.max(1))).min(millis.max(from + 1));
        let at = |millis| Some(Span(WARM_UP + Duration::from_millis(millis)));
        FaultSpec {
            rate: kind.is_strike().then_some(rate),
            from: at(from),
            until: at(until),
            ..FaultSpec::on(link, DirectionSpec::ToMaster, kind)
        }
    };
    (0..count).map(fault).collect()
}

pub(super) fn index(rng: &mut Rng, below: u64) -> usize {
    usize::try_from(rng.below(below)).expect("an index")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_written_so_that_people_can_read_them() {
        let hex = Hex(vec![0xAB, 0x04, 0x00]);
        assert_eq!(String::from(hex.clone()), "AB 04 00");
        assert_eq!(Hex::try_from("AB 04 00".to_owned()), Ok(hex));
        assert!(Hex::try_from("AB 4".to_owned()).is_err());
    }

    #[test]
    fn faults_are_in_what_the_program_hears_and_end_in_time() {
        let links = ["a".to_owned(), "b".to_owned()];
        let lasting = Duration::from_secs(2);
        let end = Span(WARM_UP + lasting);
        for seed in 0..200 {
            let made = faults(&links, lasting, &mut Rng::stream(seed, "test"));
            assert!(!made.is_empty());
            for fault in made {
                assert_eq!(fault.check(), Ok(()), "{fault:?}");
                assert_eq!(fault.direction, Some(DirectionSpec::ToMaster));
                assert!(fault.from >= Some(Span(WARM_UP)) && fault.until <= Some(end));
            }
        }
        assert!(faults(&[], lasting, &mut Rng::stream(1, "test")).is_empty());
    }
}
