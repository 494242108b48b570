use core::time::Duration;
use std::collections::BTreeSet;

use emulators::rng::Rng;
use serde::{Deserialize, Serialize};

use engine::codec::wire::Stream;
use engine::scenario::{DirectionSpec, Expect, FaultKind, FaultSpec, Scenario, Span};

/// Virtual time for which the devices run before the program starts; after it a lidar is turning.
pub(super) const WARM_UP: Duration = Duration::from_secs(5);
/// Maximum number of faults of a case.
const FAULTS_MAX: u64 = 6;

/// The complete input of a program, as a value.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// World, devices, and the faults in the data that the program receives.
    pub scenario: Scenario,
    /// All other input.
    pub told: Told,
}

/// The content of a finding's folder, in addition to the scenario.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told {
    /// Duration of the scenario before the program must prove that it is alive.
    pub lasting: Span,
    /// The behaviour of the program without faults.
    pub known: Known,
    /// Raw traffic instead of a device's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<Raw>,
}

/// The behaviour of a program without faults, by port name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// Ports that the program opens.
    pub opens: BTreeSet<String>,
    /// Ports that the program reads.
    pub reads: BTreeSet<String>,
    /// Ports on which the program sends without a request.
    pub speaks: BTreeSet<String>,
    /// Whether the program ends by itself with exit code 0.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub ends: bool,
}

/// Raw traffic on one link instead of a device's.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Raw {
    /// The link.
    pub link: String,
    /// Frames that the program answers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub answered: Vec<Answered>,
    /// Kinds of unsolicited frames that the program sends.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub chatter: Vec<Hex>,
    /// The beginning of a frame that the program answers; a silence follows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cut: Option<Hex>,
    /// Intact replies of the device, for requests without a turn.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exchange: Vec<Exchange>,
    /// Whether the program sends requests: each turn then waits for a request.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub asks: bool,
    /// The pause behind each turn if the program sends no requests [default: 25 ms], and at each
    /// `idle` of the stream [default: 20 ms after the last byte].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap: Option<Span>,
    /// Data sent to the program, one turn for each of its requests; replaces the stream.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub turn: Vec<Turn>,
    /// The experiment with damaged replies, done first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damage: Option<Damage>,
    /// Pairs of frames, sent first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pair: Vec<Pair>,
    /// Pairs of frames whose format was learned, sent first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub learned: Vec<Pair>,
    /// The stream that follows: one chunk per line, `idle` for a pause.
    #[serde(default)]
    pub stream: String,
}

impl Raw {
    /// Whether nothing is sent.
    pub(super) const fn is_empty(&self) -> bool {
        let is_nothing = self.pair.is_empty() && self.stream.is_empty() && self.cut.is_none();
        self.turn.is_empty() && self.learned.is_empty() && is_nothing
    }

    /// Number of chunks of the stream.
    pub(super) fn chunks(&self) -> usize {
        self.stream.lines().filter(|line| *line != "idle").count()
    }
}

/// A request of the program and the reply of the device.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exchange {
    /// The request.
    pub request: Hex,
    /// The reply.
    pub reply: Hex,
}

/// Data sent to the program at once.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// The mutation, e.g. `wrong-length`.
    pub kind: String,
    /// Whether the data differ from those of an intact device: the program may then reject them.
    #[serde(rename = "altered")]
    pub is_altered: bool,
    /// The request that the data answer; none: any request, or unsolicited.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<Hex>,
    /// The bytes, in chunks with a short pause between them.
    pub say: Vec<Hex>,
    /// Seed of the change, which the search applies to the reply to another request of this kind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u32>,
}

/// A frame that the program answers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answered {
    /// The frame.
    pub frame: Hex,
    /// The kinds of the answer, see [`Speech::shape`](super::Speech::shape).
    pub kinds: Vec<Hex>,
}

/// A frame that the program answers, intact and damaged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// The intact frame.
    pub good: Hex,
    /// The damaged frame, which is not a valid frame.
    pub damaged: Hex,
    /// Noise: the same number of bytes as the intact frame, without a valid frame.
    pub noise: Hex,
}

/// The experiment with damaged replies, see `damage.rs`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Damage {
    /// A request of the kind whose replies are damaged.
    pub to: Hex,
    /// Number of consecutive replies of one phase, at most [`COUNT_MAX`](Self::COUNT_MAX).
    pub count: u64,
    /// Seed of the damage.
    pub seed: u32,
    /// The damaged replies that were sent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sent: Vec<Exchange>,
    /// The requests that came, each with a known request of its kind.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub kinds: Vec<Kind>,
}

impl Damage {
    /// Maximum number of consecutive replies of one phase.
    pub const COUNT_MAX: u64 = 3;
}

/// A request and its kind.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kind {
    /// The request.
    pub request: Hex,
    /// A known request of its kind.
    pub of: Hex,
}

/// Bytes as readable text.
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

/// Whether a fault is a property of the wiring, which each case keeps: on a single wire the sender
/// hears its own bytes.
pub(super) fn is_wiring(fault: &FaultSpec) -> bool {
    fault.kind == FaultKind::Echo
}

/// Whether the program hears its own bytes on `link`.
pub(super) fn has_echo(scenario: &Scenario, link: &str) -> bool {
    scenario.fault.iter().any(|fault| {
        let is_here = fault.link.as_deref() == Some(link);
        is_wiring(fault) && is_here && fault.direction != Some(DirectionSpec::ToMaster)
    })
}

/// `scenario` for a program that starts after the warm-up: the mission begins then, the scenario's
/// own faults are removed, except the [wiring](is_wiring), and the final state is not judged.
pub(super) fn quiet(scenario: &Scenario, lasting: Duration) -> Scenario {
    let mut quiet = scenario.clone();
    quiet.mission.connect = Span(quiet.mission.connect.0 + WARM_UP);
    for step in &mut quiet.mission.step {
        step.at = step.at.map(|at| Span(at.0 + WARM_UP));
    }
    quiet.expect = Expect::default();
    quiet.fault.retain(is_wiring);
    (quiet.budget, quiet.phases) = (None, None);
    quiet.duration = Span(quiet.duration.0.max(WARM_UP + lasting));
    quiet
}

/// Kinds of faults in the data that a program receives. No kind delays data: a program that repeats
/// a request because a reply is late breaks no rule, and the device cannot distinguish the two
/// cases.
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
/// Probabilities per byte.
const RATES: [f64; 6] = [0.0003, 0.001, 0.003, 0.01, 0.03, 0.1];

/// Faults in the data that the program receives on `links`, from the end of the warm-up, for
/// `lasting`.
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
