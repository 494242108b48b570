//! Expectations of a case.

use protocols::Instant;
use serde::{Deserialize, Serialize};

use super::decoder::Decoded;
use super::rules::Evidence;
use super::sound::Sound;
use super::{is_false, rule};
use crate::replay::Replayed;
use engine::run::check::Check;

/// Expectations when the bytes of a case are played to the program.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// The program sends the captured bytes again, byte by byte.
    #[serde(default)]
    pub same_outputs: bool,
    /// Links on which the program still sends within the last second.
    #[serde(default)]
    pub talks: Vec<String>,
    /// Rules that the program must not violate, as `device rule`, e.g. `base unknown-register`.
    #[serde(default)]
    pub never: Vec<String>,
    /// Checks of every run that must pass, e.g. `memory-intact`.
    #[serde(default)]
    pub checks: Vec<String>,
    /// Maximum pause of a program that still sends, ns; `None`: a second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub talk_pause_ns: Option<u64>,
    /// The program may end with exit code 0 before the case is over, as with `--exec-may-end`.
    #[serde(default, skip_serializing_if = "is_false")]
    pub may_end: bool,
    /// The program ends with this exit code.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exits: Option<i32>,
    /// Texts of lines that the program must print.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub prints: Vec<String>,
    /// Texts that no printed line may contain.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub never_prints: Vec<String>,
    /// Bytes that the program sends, `LINK:HEX` or `HEX`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sends: Vec<String>,
    /// Bytes that the program must never send.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub never_sends: Vec<String>,
    /// The program behaves as if damaged frames had not arrived.
    #[serde(default, skip_serializing_if = "is_false")]
    pub ignores_damage: bool,
    /// Maximum pause of a program that has begun to send, ns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recovers_ns: Option<u64>,
    /// Behaviour of a reference program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sound: Option<Sound>,
    /// Output of decoders for the bytes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub decoder: Vec<Decoded>,
}

impl Expectation {
    /// Whether an expectation needs a program.
    pub(super) fn needs_program(&self) -> bool {
        let lists = [
            &self.talks,
            &self.never,
            &self.checks,
            &self.prints,
            &self.never_prints,
            &self.sends,
            &self.never_sends,
        ];
        let is_asked = self.exits.is_some() || self.recovers_ns.is_some() || self.sound.is_some();
        self.same_outputs
            || self.ignores_damage
            || is_asked
            || lists.iter().any(|list| !list.is_empty())
    }

    /// Verdicts on the robot's own program, up to `end`.
    pub(super) fn judge(&self, replayed: &Replayed, end: Instant) -> Vec<Check> {
        let mut checks = self.judge_links(&replayed.links, end);
        checks.extend(self.judge_rules(&Evidence {
            links: &replayed.links,
            said: "",
            exit_code: None,
            ended_at: None,
            end,
        }));
        for forbidden in &self.never {
            let mut broken = replayed
                .violations
                .iter()
                .filter(|one| rule(one) == *forbidden);
            let first = broken.next();
            let detail = match first {
                None => "not broken".to_owned(),
                Some(first) => format!("broken {} times; first: {first}", 1 + broken.count()),
            };
            let name = format!("never-{}", forbidden.replace(' ', "-"));
            checks.push(Check::new(&name, first.is_none(), detail));
        }
        for name in &self.checks {
            let found = replayed.checks.iter().find(|check| check.name == *name);
            let unknown = || Check::new(name, false, "expected the name of a check of every run");
            checks.push(found.cloned().unwrap_or_else(unknown));
        }
        checks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only decoders are judged without a program.
    #[test]
    fn each_expectation_of_a_program_needs_one() {
        let words = || vec!["x".to_owned()];
        type Set = fn(&mut Expectation, Vec<String>);
        let sets: [Set; 12] = [
            |one, _| one.same_outputs = true,
            |one, _| one.ignores_damage = true,
            |one, _| one.exits = Some(1),
            |one, _| one.recovers_ns = Some(1),
            |one, _| {
                one.sound = Some(Sound {
                    command: "x".to_owned(),
                    prints: String::new(),
                    link: Vec::new(),
                });
            },
            |one, words| one.talks = words,
            |one, words| one.never = words,
            |one, words| one.checks = words,
            |one, words| one.prints = words,
            |one, words| one.never_prints = words,
            |one, words| one.sends = words,
            |one, words| one.never_sends = words,
        ];
        for (number, set) in sets.into_iter().enumerate() {
            let mut one = Expectation::default();
            set(&mut one, words());
            assert!(one.needs_program(), "{number}");
        }
        let mut none = Expectation {
            may_end: true,
            talk_pause_ns: Some(1),
            ..Expectation::default()
        };
        none.decoder.push(Decoded::default());
        assert!(!none.needs_program());
    }

    /// A rule that was broken twice, one that was not, a check of the run, and an unknown one.
    #[test]
    fn rules_and_checks_of_a_run_are_judged() {
        use core::time::Duration;
        use emulators::device::{Event, EventKind};
        use engine::rig::Logged;
        use engine::run::check::Status;

        let broken = |source: &str| Logged {
            source: source.to_owned(),
            event: Event {
                at: Instant::from_secs(1),
                kind: EventKind::Violation,
                rule: "bad-frame",
                detail: String::new(),
                bytes: Vec::new(),
            },
            is_kept: true,
        };
        let replayed = Replayed {
            ran: Duration::from_secs(2),
            heard: 0,
            links: Vec::new(),
            violations: vec![broken("base"), broken("base"), broken("radio")],
            checks: vec![
                Check::new("other", false, "no"),
                Check::new("whole", true, "yes"),
            ],
            trace_hash: String::new(),
        };
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let expect = Expectation {
            never: names(&["base bad-frame", "lidar bad-frame"]),
            checks: names(&["whole", "unknown"]),
            ..Expectation::default()
        };
        let found = expect.judge(&replayed, Instant::from_secs(2));
        let found: Vec<_> = found.iter().map(|one| (&*one.name, one.status)).collect();
        assert_eq!(
            found,
            [
                ("never-base-bad-frame", Status::Fail),
                ("never-lidar-bad-frame", Status::Pass),
                ("whole", Status::Pass),
                ("unknown", Status::Fail),
            ]
        );
        let detail = &expect.judge(&replayed, Instant::from_secs(2))[0].detail;
        assert!(detail.starts_with("broken 2 times; first: "), "{detail}");
    }
}
