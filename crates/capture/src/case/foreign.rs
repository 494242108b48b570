//! Judgement of a case by the bytes that a program sent at its ports, wherever the program runs.

use core::time::Duration;
use std::collections::BTreeMap;

use protocols::{Instant, LineConfig};

use super::{
    Case, Evidence, Expectation, Judgement, LinkBytes, Play, SILENCE, VERSION, is_silent_for,
};
use crate::divergence::Track;
use crate::replay::{Played, Recorded};
use engine::TOOL;
use engine::codec::{self, Codec, What};
use engine::rig::line::Direction;
use engine::robots::{self, Dut, PcEnd};
use engine::run::check::Check;
use engine::scenario::{Scenario, Source};

/// Minimum number of chunks of a program that sends continuously on a link.
const PIECES_MIN: usize = 5;
/// Minimum duration of these chunks.
const SPAN_MIN: Duration = Duration::from_secs(1);
/// Maximum pause, as a multiple of the longest pause before the program fell silent.
const PAUSES: u32 = 3;

/// Name of the check that a program is alive; each case of a capture requires it.
const LIVES: &str = "program-alive";

impl Case {
    /// Makes a case of a foreign program: it must stay alive and continue sending on the links on
    /// which it sent. Its captured bytes are not required again, because they may have been wrong.
    pub fn of_outsider(name: &str, recorded: &Recorded, scenario: Option<&Scenario>) -> Self {
        let links = recorded.links.iter();
        let links = links.filter(|link| !link.arrivals.is_empty());
        let mut expect = Expectation::default();
        let mut longest = SILENCE;
        for link in links.clone() {
            if let Some(pause) = pause_of(&link.sent) {
                expect.talks.push(link.link.clone());
                longest = longest.max(pause * PAUSES);
            }
        }
        if longest > SILENCE && !expect.talks.is_empty() {
            expect.talk_pause_ns = u64::try_from(longest.as_nanos()).ok();
        }
        Self {
            case: VERSION,
            name: name.to_owned(),
            description: String::new(),
            tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
            end_ns: recorded.end.as_nanos(),
            is_foreign: true,
            play: Some(Play::Conversation),
            expect,
            link: links.map(LinkBytes::of).collect(),
            scenario: scenario.cloned(),
        }
    }

    /// Makes a case of a run of `scenario`: its devices reply, and judge the program as in the run.
    pub fn of_run(name: &str, recorded: &Recorded, scenario: &Scenario) -> Self {
        let talks = Self::of_outsider(name, recorded, None).expect;
        Self {
            play: Some(Play::Devices),
            link: Vec::new(),
            scenario: Some(scenario.clone()),
            expect: talks,
            ..Self::of_outsider(name, &Recorded::default(), None)
        }
        .until(recorded.end)
    }

    fn until(self, end: Instant) -> Self {
        Self {
            end_ns: end.as_nanos(),
            ..self
        }
    }

    /// Judges the bytes of a program in its own process; `own` are the verdicts on the process. The
    /// second result names properties that are not visible at a port: rules of devices and checks
    /// of the robot. They are not judged.
    pub fn judge_foreign(
        &self,
        own: impl IntoIterator<Item = Check>,
        seen: &Evidence<'_>,
    ) -> (Judgement, Vec<String>) {
        // The rule about the exit decides how the program must end.
        let is_asked = |check: &Check| self.expect.exits.is_none() || check.name != LIVES;
        let mut checks: Vec<Check> = own.into_iter().filter(is_asked).collect();
        let end = seen.ended_at.filter(|_| seen.exit_code == Some(0));
        checks.extend(self.expect.judge_links(seen.links, end.unwrap_or(seen.end)));
        checks.extend(self.expect.judge_rules(seen));
        if let Some(sound) = &self.expect.sound {
            checks.extend(sound.judge(seen.said, seen.links));
        }
        let judgement = self.judgement(checks, seen.end - Instant::ZERO);
        let rules = self.expect.never.iter().map(|rule| format!("never {rule}"));
        let decoders = self.expect.decoder.iter();
        let decoders = decoders.map(|one| format!("decodes-{}-{}", one.link, one.direction));
        let unjudged = rules
            .chain(self.expect.checks.iter().cloned())
            .chain(decoders);
        (judgement, unjudged.collect())
    }

    /// Returns the recording without the damaged bytes to the program, and the number of their
    /// stretches on each link; links without damage are left out. Damaged bytes are those outside
    /// of valid frames of the link's protocol: the one of the case's scenario, which a description
    /// may define, or the one that the bytes prove.
    pub fn without_damage(
        &self,
        recorded: &Recorded,
        source: &Source,
    ) -> (Recorded, BTreeMap<String, u32>) {
        let (mut sound, mut left_out) = (recorded.clone(), BTreeMap::new());
        let wired = self.scenario.as_ref().and_then(|scenario| {
            robots::wire(scenario, source, Dut::Internal, PcEnd::Scripted).ok()
        });
        let expected = |link: &str| {
            let wired = wired.as_ref()?;
            let instruments = &wired.instruments;
            instruments.codec_towards(&wired.rig, link, Direction::ToMaster)
        };
        for passage in &mut sound.links {
            let all: Vec<u8> = passage
                .arrivals
                .iter()
                .flat_map(|one| &one.bytes)
                .copied()
                .collect();
            let is_own = |codec: &&Codec| codec.framed_towards(&all, Direction::ToMaster) > 0;
            let expected = expected(&passage.link).filter(is_own);
            let Some(codec) = expected.or_else(|| codec::guess(&all)) else {
                continue;
            };
            let mut is_bad = vec![false; all.len()];
            for stretch in codec.found_towards(&all, Direction::ToMaster) {
                if matches!(stretch.what, What::Bad(_)) {
                    let range = usize::try_from(stretch.bytes.start).unwrap_or(usize::MAX)
                        ..usize::try_from(stretch.bytes.end).unwrap_or(usize::MAX);
                    is_bad[range].fill(true);
                }
            }
            let stretches = is_bad.chunk_by(|one, other| one == other);
            let stretches = stretches.filter(|stretch| stretch[0]).count();
            if let Some(count) = u32::try_from(stretches).ok().filter(|count| *count > 0) {
                left_out.insert(passage.link.clone(), count);
            }
            let mut place = 0;
            for arrival in &mut passage.arrivals {
                let own = &is_bad[place..place + arrival.bytes.len()];
                place += own.len();
                let mut flags = own.iter();
                arrival
                    .bytes
                    .retain(|_| !flags.next().is_some_and(|bad| *bad));
            }
            passage.arrivals.retain(|one| !one.bytes.is_empty());
        }
        (sound, left_out)
    }

    /// Whether a program ignores damage. It sent `damaged` with the damage and `sound` without: the
    /// requests must be equal, and none may be later by more than `late`, and by one pause for each
    /// damaged frame of `left_out`. A program may pause after each reply, also after a damaged one,
    /// and repeat a missing one earlier.
    pub fn judge_damage(
        damaged: &[Played],
        sound: &[Played],
        left_out: &BTreeMap<String, u32>,
        late: Duration,
    ) -> Vec<Check> {
        let pairs = damaged.iter().zip(sound);
        let checks = pairs.map(|(damaged, sound)| {
            let name = format!("ignores-damage-{}", damaged.link);
            let (got, expected) = (&damaged.got, &sound.got);
            if got.bytes().is_empty() && expected.bytes().is_empty() {
                return Check::not_observed(&name, "the program sent nothing");
            }
            let pairs = got.bytes().iter().zip(expected.bytes());
            let same = pairs.take_while(|(got, expected)| got == expected).count();
            let shift = |(end, at): (usize, Instant)| {
                let there = expected.time_of(end)?;
                // An earlier request is no failure: the program waited for the missing frame.
                Some(at - there)
            };
            let shortest = got.bytes().len().min(expected.bytes().len());
            let times = (0..shortest).filter_map(|byte| Some((byte, got.time_of(byte)?)));
            let shifted = times.filter_map(shift).max().unwrap_or_default();
            let count = left_out.get(&damaged.link).copied().unwrap_or(0);
            let late = late.saturating_add(usual_pause(expected).saturating_mul(count));
            let (shift_s, late_s) = (shifted.as_secs_f64(), late.as_secs_f64());
            let (is_same, detail) = if same < shortest {
                let at = got.time_of(same).unwrap_or_default();
                let words =
                    format!("byte {same}, at {at} s, is another one than without the damage");
                (false, words)
            } else if shifted > late {
                let words = format!(
                    "up to {shift_s:.3} s later than without the damage, limit {late_s:.3} s"
                );
                (false, words)
            } else {
                let words =
                    format!("the same {same} bytes as without the damage, {shift_s:.3} s later");
                (true, words)
            };
            Check::new(&name, is_same, detail)
        });
        checks.collect()
    }
}

/// Pause between two pieces of one request, at most.
const WITHIN: Duration = Duration::from_millis(20);

/// The median pause between two requests of a program: most of them follow a good reply.
fn usual_pause(sent: &Track) -> Duration {
    let times: Vec<Instant> = sent.pieces().map(|(at, _)| at).collect();
    let pauses = times.windows(2).map(|pair| pair[1] - pair[0]);
    let mut pauses: Vec<Duration> = pauses.filter(|pause| *pause > WITHIN).collect();
    pauses.sort_unstable();
    pauses.get(pauses.len() / 2).copied().unwrap_or_default()
}

/// Longest pause of a program while it was sending; `None` if it did not send for long.
fn pause_of(sent: &Track) -> Option<Duration> {
    let times: Vec<Instant> = sent.pieces().map(|(at, _)| at).collect();
    let (first, last) = (times.first()?, times.last()?);
    let pauses = times.windows(2).map(|pair| pair[1] - pair[0]);
    (times.len() >= PIECES_MIN && *last - *first >= SPAN_MIN)
        .then(|| pauses.max().unwrap_or_default())
}

impl Expectation {
    /// Checks that need only the bytes on the links.
    pub(super) fn judge_links(&self, links: &[Played], end: Instant) -> Vec<Check> {
        let mut checks = Vec::new();
        if self.same_outputs {
            let divergence = Played::first_divergence(links);
            let sent: usize = links.iter().map(|one| one.got.bytes().len()).sum();
            let detail = match &divergence {
                None => format!("the same {sent} bytes"),
                Some(divergence) => divergence.to_string(),
            };
            checks.push(Check::new("same-outputs", divergence.is_none(), detail));
        }
        let longest = self.talk_pause_ns.map_or(SILENCE, Duration::from_nanos);
        for name in &self.talks {
            let link = links.iter().find(|one| one.link == *name);
            let last = link.and_then(|one| one.got.end());
            let pass = link.is_some_and(|one| !is_silent_for(&one.got, end, longest));
            let last = last.map_or("never".to_owned(), |at| format!("last at {at} s"));
            let detail = format!("the program sent on {name} {last}, of {end} s");
            checks.push(Check::new(&format!("talks-{name}"), pass, detail));
        }
        checks
    }

    /// Baud rate with which the times of `link` are written.
    pub fn baud_of(links: &[LinkBytes], link: &str) -> u32 {
        let found = links.iter().find(|one| one.name == link);
        found.map_or(LineConfig::new_8n1(115_200).baud, |one| one.baud)
    }
}

#[cfg(test)]
mod tests {
    use protocols::avr::{ChecksumOrder, Frame};

    use super::*;
    use crate::divergence::Track;
    use crate::replay::{Arrival, Passage};
    use engine::run::check::Status;

    /// A byte each half second, the last one at `last_ms`.
    fn track(last_ms: u64) -> Track {
        let mut track = Track::default();
        for millis in (500..=last_ms).step_by(500) {
            track.push(Instant::from_millis(millis), &[1]);
        }
        track
    }

    const END: Instant = Instant::from_secs(10);

    /// Whether a program sent to the end or fell silent, it must continue sending where it sent.
    /// None of its bytes are required again. A link without bytes to the program is not its own.
    #[test]
    fn a_foreign_program_must_go_on_talking_where_it_talked() {
        let passage = |link: &str, last_ms, heard: &[u8]| Passage {
            link: link.to_owned(),
            arrivals: Vec::from_iter((!heard.is_empty()).then(|| Arrival {
                at: Instant::ZERO,
                bytes: heard.to_vec(),
            })),
            sent: track(last_ms),
            ..Passage::default()
        };
        let expected = |last_ms| {
            let recorded = Recorded {
                links: vec![passage("deaf", 10_000, &[]), passage("base", last_ms, &[7])],
                end: END,
                zero: Instant::ZERO,
            };
            let case = Case::of_outsider("x", &recorded, None);
            assert!(case.is_foreign && !case.expect.same_outputs);
            let links: Vec<_> = case.link.iter().map(|link| &*link.name).collect();
            assert_eq!((links, case.end_ns), (vec!["base"], 10_000_000_000));
            (case.expect.talks, case.expect.talk_pause_ns)
        };
        let base = (vec!["base".to_owned()], Some(1_500_000_000));
        assert_eq!(expected(10_000), base);
        assert_eq!(expected(3_000), base);
        assert_eq!(
            expected(1_000),
            (Vec::new(), None),
            "two pieces are no talk"
        );
    }

    /// Three register reads; in the second, a bit of the checksum is wrong.
    #[test]
    fn damage_is_what_is_in_no_frame() {
        let read = |register| Frame::read(register, 10, ChecksumOrder::LowFirst);
        let bytes = [36, 60, 36].map(|register| read(register).as_bytes().to_vec());
        let arrivals = (1..).zip(bytes).map(|(at, mut bytes)| {
            bytes[4] ^= u8::from(at == 2);
            let at = Instant::from_millis(at);
            Arrival { at, bytes }
        });
        let passage = Passage {
            arrivals: arrivals.collect(),
            ..Passage::default()
        };
        let recorded = Recorded {
            links: vec![passage],
            end: END,
            zero: Instant::ZERO,
        };
        let case = Case::of_outsider("x", &recorded, None);
        let text = "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                    device.meter = { description = \"gps\" }\n";
        let (scenario, source) = Scenario::from_text(text).expect("sound");
        let (sound, left_out) = case.without_damage(&recorded, &source);
        assert_eq!(left_out.into_values().collect::<Vec<_>>(), [1]);
        assert_eq!(sound.links[0].arrivals.len(), 2);

        // UBX of u-blox 8: class 1, message 2, no payload, and its checksum 03 0A. One poll is
        // damaged. Only the scenario tells the protocol of so few bytes.
        let polls = [0x0A, 0x0B, 0x0A].map(|last| vec![0xB5, 0x62, 1, 2, 0, 0, 3, last]);
        let arrivals = (1..).zip(polls).map(|(at, bytes)| Arrival {
            at: Instant::from_millis(at),
            bytes,
        });
        let passage = Passage {
            link: "meter".to_owned(),
            arrivals: arrivals.collect(),
            ..Passage::default()
        };
        let recorded = Recorded {
            links: vec![passage],
            end: END,
            zero: Instant::ZERO,
        };
        let case = Case::of_outsider("x", &recorded, Some(&scenario));
        let (sound, left_out) = case.without_damage(&recorded, &source);
        assert_eq!(left_out.into_values().collect::<Vec<_>>(), [1]);
        assert_eq!(sound.links[0].arrivals.len(), 2);
    }

    /// A byte each half second. A program that sends 0.3 s later because of the damage, or sends
    /// another byte, does not ignore the damage.
    #[test]
    fn damage_is_ignored_if_nothing_is_other_or_later() {
        let played = |late_ms, byte| {
            let mut got = Track::default();
            for millis in (500..=2_000).step_by(500) {
                let is_late = if millis > 1_000 { late_ms } else { 0 };
                got.push(Instant::from_millis(millis + is_late), &[byte]);
            }
            [Played {
                link: "base".to_owned(),
                expected: Track::default(),
                got,
                talk: None,
            }]
        };
        let limit = Duration::from_millis(250);
        let judged = |late, byte, count| {
            let left_out = BTreeMap::from([("base".to_owned(), count)]);
            let checks = Case::judge_damage(&played(late, byte), &played(0, 1), &left_out, limit);
            checks[0].status
        };
        let judge = |late, byte| judged(late, byte, 0);
        assert_eq!((judge(0, 1), judge(250, 1)), (Status::Pass, Status::Pass));
        assert_eq!((judge(251, 1), judge(0, 2)), (Status::Fail, Status::Fail));
        // Two damaged frames may cost two of the usual pauses of 500 ms.
        let paced = [judged(1_250, 1, 2), judged(1_251, 1, 2), judged(0, 2, 2)];
        assert_eq!(paced, [Status::Pass, Status::Fail, Status::Fail]);
    }

    /// Each link is judged by its own name: on one the program sends to the end, on the other it
    /// fell silent.
    #[test]
    fn a_program_is_judged_on_each_link_by_what_it_said_there() {
        let expect = Expectation {
            talks: ["base", "radio", "lidar"].map(str::to_owned).to_vec(),
            ..Expectation::default()
        };
        let links = [("base", 9_000), ("radio", 8_500)].map(|(link, last_ms)| Played {
            link: link.to_owned(),
            expected: Track::default(),
            got: track(last_ms),
            talk: None,
        });
        let checks = expect.judge_links(&links, END);
        let checks: Vec<_> = checks
            .iter()
            .map(|one| (one.status, &*one.detail))
            .collect();
        let (pass, fail) = (Status::Pass, Status::Fail);
        let said = [
            (
                pass,
                "the program sent on base last at 9.000000 s, of 10.000000 s",
            ),
            (
                fail,
                "the program sent on radio last at 8.500000 s, of 10.000000 s",
            ),
            (fail, "the program sent on lidar never, of 10.000000 s"),
        ];
        assert_eq!(checks, said);
    }
}
