//! Judgement of a case by the bytes that a program sent at its ports, wherever the program runs.

use core::time::Duration;

use protocols::{Instant, LineConfig};

use super::{
    Case, Evidence, Expectation, Judgement, LinkBytes, Play, SILENCE, VERSION, is_silent_for,
};
use crate::divergence::Track;
use crate::replay::{Played, Recorded};
use engine::TOOL;
use engine::run::check::Check;
use engine::scenario::Scenario;

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

    /// The rate of a link, or the usual one.
    #[test]
    fn a_link_has_its_own_rate() {
        let link = |name: &str, baud| LinkBytes {
            name: name.to_owned(),
            baud,
            opened_ns: Vec::new(),
            to_program: String::new(),
            from_program: String::new(),
        };
        let links = [link("a", 9_600), link("b", 19_200)];
        let rates = ["a", "b", "c"].map(|name| Expectation::baud_of(&links, name));
        assert_eq!(rates, [9_600, 19_200, 115_200]);
    }

    /// The devices of the scenario answer: the case has no bytes, but the expectations and the end.
    #[test]
    fn a_case_of_a_run_has_its_scenario_and_no_bytes() {
        let text = "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                    device.meter = { description = \"gps\" }\n";
        let (scenario, _) = Scenario::from_text(text).expect("sound");
        let recorded = Recorded {
            links: vec![Passage {
                link: "meter".to_owned(),
                arrivals: vec![Arrival {
                    at: Instant::ZERO,
                    bytes: vec![1],
                }],
                sent: track(10_000),
                ..Passage::default()
            }],
            end: END,
            zero: Instant::ZERO,
        };
        let case = Case::of_run("x", &recorded, &scenario);
        assert_eq!(case.play, Some(Play::Devices));
        assert!(case.link.is_empty() && case.is_foreign);
        assert_eq!(case.scenario, Some(scenario));
        assert_eq!(
            (case.expect.talks, case.end_ns),
            (vec!["meter".to_owned()], 10_000_000_000)
        );
        let captured = Case::of_outsider("x", &recorded, None);
        assert_eq!(
            (captured.play, captured.link.len()),
            (Some(Play::Conversation), 1)
        );
        // Three times a pause of 300 ms is no longer than the usual silence.
        let mut fast = Track::default();
        (0..10).for_each(|n| fast.push(Instant::from_millis(n * 300), &[1]));
        let mut recorded = recorded;
        recorded.links[0].sent = fast;
        let expect = Case::of_outsider("x", &recorded, None).expect;
        assert_eq!((expect.talks.len(), expect.talk_pause_ns), (1, None));
    }

    /// The rule about the exit replaces the check that the program is alive. A program that ended
    /// with code 0 is judged up to its end.
    #[test]
    fn the_exit_of_a_program_is_judged_by_its_rule() {
        let text = "case = 1\nname = \"x\"\nend_ns = 7\n[expect]\ntalks = [\"base\"]\n";
        let path = std::path::Path::new("x.toml");
        let judge = |text: &str, exit_code, ended_s: Option<u64>| {
            let (case, _) = Case::parse(path, text.to_owned()).expect("sound");
            let links = [Played {
                link: "base".to_owned(),
                expected: Track::default(),
                got: track(5_000),
                talk: None,
            }];
            let own = ["program-alive", "other"].map(|name| Check::new(name, true, "yes"));
            let seen = Evidence {
                links: &links,
                said: "",
                exit_code,
                ended_at: ended_s.map(Instant::from_secs),
                end: END,
            };
            let (judgement, unjudged) = case.judge_foreign(own, &seen);
            assert_eq!(
                (judgement.ran, unjudged.len()),
                (Duration::from_secs(10), 0)
            );
            let checks = judgement.checks.into_iter();
            checks.map(|one| (one.name, one.status)).collect::<Vec<_>>()
        };
        let of = |list: &[(&str, Status)]| {
            let owned = list
                .iter()
                .map(|(name, status)| ((*name).to_owned(), *status));
            owned.collect::<Vec<_>>()
        };
        let (pass, fail) = (Status::Pass, Status::Fail);
        let base = "[[link]]\nname = \"base\"\nbaud = 9600\n";
        let text = format!("{text}{base}");
        let own = [("program-alive", pass), ("other", pass)];
        let late = of(&[&own[..], &[("talks-base", fail)]].concat());
        assert_eq!(judge(&text, None, None), late);
        assert_eq!(judge(&text, Some(1), Some(5)), late);
        let ended = of(&[&own[..], &[("talks-base", pass)]].concat());
        assert_eq!(judge(&text, Some(0), Some(5)), ended);
        let exits = text.replace("talks = ", "exits = 0\ntalks = ");
        let expected = of(&[("other", pass), ("talks-base", pass), ("exits", pass)]);
        assert_eq!(judge(&exits, Some(0), Some(5)), expected);
    }

    /// Five chunks in a second or more.
    #[test]
    fn a_program_sends_for_long_from_five_chunks_on() {
        let of = |step: u64, count: u64| {
            let mut track = Track::default();
            (0..count).for_each(|n| track.push(Instant::from_millis(n * step), &[1]));
            pause_of(&track).map(|pause| pause.as_millis())
        };
        assert_eq!(of(250, 5), Some(250));
        assert_eq!((of(249, 5), of(1_000, 4), of(1, 0)), (None, None, None));
    }
}
