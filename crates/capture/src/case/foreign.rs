//! A case judged by what a program said at its ports, wherever that program is.

use protocols::Instant;

use super::{Case, Expectation, Judgement, LinkBytes, VERSION, is_silent, talks};
use crate::replay::{Played, Recorded};
use engine::TOOL;
use engine::run::check::Check;
use engine::scenario::Scenario;

impl Case {
    /// A case of a robot that has no program of its own: all that can be asked is what somebody's
    /// program says at its ports.
    pub(super) fn of_outsider(name: &str, recorded: &Recorded, scenario: &Scenario) -> Self {
        let links = recorded.links.iter();
        let links = links.filter(|link| !link.arrivals.is_empty());
        let talking = links.clone().filter(|link| talks(&link.sent));
        let talks: Vec<String> = talking.clone().map(|link| link.link.clone()).collect();
        let mut talking = talking;
        let fell_silent = talking.any(|link| is_silent(&link.sent, recorded.end));
        Self {
            case: VERSION,
            name: name.to_owned(),
            description: String::new(),
            tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
            end_ns: recorded.end.as_nanos(),
            is_foreign: true,
            expect: Expectation {
                same_outputs: !fell_silent,
                talks,
                ..Expectation::default()
            },
            link: links.map(LinkBytes::of).collect(),
            scenario: Some(scenario.clone()),
        }
    }

    /// Judges what a program in a process of its own said, up to `end`; `own` are the verdicts on
    /// the program itself. What no port tells is named in the second value: rules of devices and
    /// checks of the robot, neither of which is there.
    pub fn judge_foreign(
        &self,
        own: impl IntoIterator<Item = Check>,
        links: &[Played],
        end: Instant,
    ) -> (Judgement, Vec<String>) {
        let mut checks: Vec<Check> = own.into_iter().collect();
        checks.extend(self.expect.judge_links(links, end));
        let judgement = self.judgement(checks, end - Instant::ZERO);
        let rules = self.expect.never.iter().map(|rule| format!("never {rule}"));
        let decoders = self.expect.decoder.iter();
        let decoders = decoders.map(|one| format!("decodes-{}-{}", one.link, one.direction));
        let unjudged = rules
            .chain(self.expect.checks.iter().cloned())
            .chain(decoders);
        (judgement, unjudged.collect())
    }
}

impl Expectation {
    /// What the bytes on the links alone tell.
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
        for name in &self.talks {
            let link = links.iter().find(|one| one.link == *name);
            let last = link.and_then(|one| one.got.end());
            let pass = link.is_some_and(|one| !is_silent(&one.got, end));
            let last = last.map_or("never".to_owned(), |at| format!("last at {at} s"));
            let detail = format!("the program sent on {name} {last}, of {end} s");
            checks.push(Check::new(&format!("talks-{name}"), pass, detail));
        }
        checks
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

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

    /// Of a program that talked to the end the same is expected again; of one that fell silent,
    /// that it talks. A link on which nothing was said to it is none of its own.
    #[test]
    fn what_is_expected_of_an_outsider_depends_on_whether_it_fell_silent() {
        let passage = |link: &str, last_ms, heard: &[u8]| Passage {
            link: link.to_owned(),
            arrivals: Vec::from_iter((!heard.is_empty()).then(|| Arrival {
                at: Instant::ZERO,
                bytes: heard.to_vec(),
            })),
            sent: track(last_ms),
            ..Passage::default()
        };
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        let (scenario, _) = Scenario::read(&path).expect("sound");
        let expected = |last_ms| {
            let recorded = Recorded {
                links: vec![passage("deaf", 10_000, &[]), passage("base", last_ms, &[7])],
                end: END,
                zero: Instant::ZERO,
            };
            let case = Case::of_outsider("x", &recorded, &scenario);
            assert!(case.is_foreign);
            let links: Vec<_> = case.link.iter().map(|link| &*link.name).collect();
            assert_eq!(
                (links, &case.expect.talks[..]),
                (vec!["base"], &["base".to_owned()][..])
            );
            case.expect.same_outputs
        };
        assert_eq!([10_000, 8_500].map(expected), [true, false]);
    }

    /// Each link by its own name: one talks to the end, the other fell silent.
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
