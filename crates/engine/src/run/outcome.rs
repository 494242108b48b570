//! The end of a run.

use core::time::Duration;
use std::collections::BTreeMap;

use emulators::world::Pose;
use protocols::Instant;

use super::check::{BYTES_CONSERVED, Check, Status};
use super::history::History;
use super::score::{self, PoseError, PosePair, WallOverlap};
use super::wire_log::WireLog;
use super::{OwnBreaks, Run, own_breaks, scene};
use crate::picture::Picture;
use crate::rig::fault::Strike;
use crate::rig::line::Direction;
use crate::rig::{Logged, Rig};
use crate::robots::{Axis, KeptMap, Panel};
use crate::scenario::{DirectionSpec, Expect, FaultSpec, NO_ROBOT, Scenario};

/// The end of a run.
pub struct Outcome {
    /// The scenario with faults replaced by their effects: running it gives the same bytes.
    pub case: Scenario,
    /// The seed.
    pub seed: u64,
    /// All verdicts.
    pub checks: Vec<Check>,
    /// Length of the run in virtual time.
    pub ran: Duration,
    /// Errors of the believed pose, if the program runs in this process.
    pub pose_error: Option<PoseError>,
    /// Agreement of map and world, if the program runs in this process.
    pub wall_overlap: Option<WallOverlap>,
    /// True path.
    pub truth: Vec<(Instant, Pose)>,
    /// Believed poses with the true ones.
    pub pairs: Vec<PosePair>,
    /// The program's map.
    pub map: Option<KeptMap>,
    /// The solid shapes, with obstacles at their final positions.
    pub scene: scene::Scene,
    /// Whether there is a robot; otherwise only devices on their wires.
    pub has_body: bool,
    /// The robot's outline in its own axes.
    pub footprint: scene::Outline,
    /// Maps at the end, by name, without the program's own map.
    pub layers: Vec<(&'static str, KeptMap)>,
    /// The course of the run over time.
    pub history: History,
    /// The last bytes on each link, of a run without a robot.
    pub wire_log: Option<WireLog>,
    /// The robot's display at the end.
    pub display: Option<Picture>,
    /// Set-points and measured values of the robot at the end.
    pub axes: Vec<Axis>,
    /// Values of the robot at the end.
    pub panels: Vec<Panel>,
    /// The program's counters.
    pub counters: BTreeMap<&'static str, u64>,
    /// Reports of devices.
    pub events: Vec<Logged>,
    /// Whether a program ran in the rig, sent a byte to a device, or read one from a bench.
    pub was_asked: bool,
    /// Number of violations of device rules by the program.
    pub violations: u64,
    /// Faults that never began, each with the reason.
    pub unbegun: Vec<String>,
    /// Violated rules with their devices and counts, and devices that found no frame, see
    /// [`Rig::mistakes`](crate::rig::Rig::mistakes).
    pub broken_rules: Vec<(String, &'static str, u64)>,
    /// The same, split by whether a fault explains them.
    pub own_breaks: Vec<OwnBreaks>,
    /// Bytes that faults damaged: link, direction, the byte, and its end on the line.
    pub strikes: Vec<(String, DirectionSpec, Strike, Instant)>,
    /// Masters at ports of their own that asked and got no reply.
    pub unanswered: Vec<String>,
    /// Probable cause of a failure, if the program ran in another process and its ports were
    /// watched.
    pub probable_cause: Option<String>,
    /// The end of the node programs' standard error, by node names.
    pub node_words: Vec<(String, String)>,
    /// Sentence that names the node program with late answers in real time.
    pub slow_node: Option<String>,
    /// Waypoints visited and demanded.
    pub waypoints: [usize; 2],
    /// Time of the first real collision.
    pub collided_at: Option<Instant>,
    /// Fingerprint of all bytes.
    pub trace_hash: String,
    /// The command that repeats the run, if running the case alone does not.
    pub again: Option<String>,
    /// The ends of the further robots' runs, by their names. Their checks are among `checks`.
    pub team: Vec<(String, Self)>,
}

fn strikes(rig: &Rig) -> Vec<(String, DirectionSpec, Strike, Instant)> {
    let ways = [
        (DirectionSpec::ToMaster, Direction::ToMaster),
        (DirectionSpec::ToDevice, Direction::ToDevice),
    ];
    let lines = rig.links().iter();
    let lines = lines.flat_map(|link| ways.map(|(spec, way)| (&link.name, spec, link.line(way))));
    let struck = lines.flat_map(|(name, spec, line)| {
        let times = line.faults.struck_times();
        times.map(move |(strike, at)| (name.clone(), spec, strike, at))
    });
    struck.collect()
}

impl Outcome {
    /// Time at which the byte of `fault` passed its line damaged.
    pub fn struck_at(&self, fault: &FaultSpec) -> Option<Instant> {
        let byte = fault.byte?;
        let is_it = |(link, direction, strike, _): &&(String, DirectionSpec, Strike, Instant)| {
            Some(link) == fault.link.as_ref()
                && Some(*direction) == fault.direction
                && strike.byte == byte
        };
        self.strikes.iter().find(is_it).map(|(.., at)| *at)
    }

    /// Whether at least one check was judged, no check failed, and each rule was observed.
    pub fn passed(&self) -> bool {
        let has_failed = self.checks.iter().any(|check| check.status == Status::Fail);
        let mut ends = core::iter::once(self).chain(self.team.iter().map(|(_, end)| end));
        let is_whole = ends.all(|end| end.unobserved_rules().next().is_none());
        self.is_judged() && !has_failed && is_whole
    }

    /// Whether a check was judged. If no program asked a device, the check of the rig's own work
    /// does not count; and a robot without any program breaks no rule, so no passed check counts.
    pub fn is_judged(&self) -> bool {
        let alive =
            |check: &Check| check.name == "program-alive" && check.status != Status::NotObserved;
        let is_supervised = || self.checks.iter().any(alive);
        let is_driven = self.case.robot == NO_ROBOT || self.was_asked || is_supervised();
        let has_failed = || self.checks.iter().any(|one| one.status == Status::Fail);
        if !is_driven && !has_failed() {
            return false;
        }
        let mut judged = self.checks.iter();
        judged.any(|check| {
            check.status != Status::NotObserved && (self.was_asked || check.name != BYTES_CONSERVED)
        })
    }

    /// The checks of rules that the run did not observe, though it had to.
    pub fn unobserved_rules(&self) -> impl Iterator<Item = &Check> {
        unobserved(&self.case.expect, &self.checks)
    }

    /// For tests: the run must have passed.
    ///
    /// # Panics
    /// If it has not passed, with the failed checks, or with all checks if none was judged.
    #[track_caller]
    pub fn assert_passed(&self) {
        if self.passed() {
            return;
        }
        let failed = self
            .checks
            .iter()
            .filter(|check| check.status == Status::Fail);
        let open = failed.chain(self.unobserved_rules());
        let mut lines: Vec<String> = open.map(ToString::to_string).collect();
        if !self.is_judged() || lines.is_empty() {
            lines = self.checks.iter().map(ToString::to_string).collect();
            lines.insert(0, "nothing was judged".to_owned());
        }
        let (name, seed) = (&self.case.name, self.seed);
        panic!("{name}, seed {seed}, did not pass:\n{}", lines.join("\n"));
    }
}

impl Run {
    /// The end of this run, without the further robots.
    pub(super) fn outcome(mut self, wall_overlap: Option<WallOverlap>) -> Outcome {
        self.rig.end_nodes();
        let program = self.rig.program();
        let map = self.instruments.map(&self.rig).map(KeptMap::from);
        let layers = self.instruments.layers(&self.rig).into_iter();
        let layers = layers.map(|(name, map)| (name, KeptMap::from(map)));
        let layers = layers.collect();
        let mut counters = BTreeMap::new();
        if let Some(program) = program {
            program.counters(&mut |name, value| {
                counters.insert(name, value);
            });
        }
        let pose_error = score::pose_error(&self.pairs);
        let checks = self.checks_with(pose_error, wall_overlap);
        let case = self.case();
        let own_breaks = own_breaks(&self.rig, &case.fault);
        Outcome {
            again: None,
            case,
            seed: self.seed,
            checks,
            ran: self.rig.now() - Instant::ZERO,
            pose_error,
            wall_overlap,
            map,
            scene: scene::scene(&self.rig.world),
            has_body: self.instruments.has_body(),
            footprint: scene::footprint(&self.rig.world),
            layers,
            display: self
                .instruments
                .display(&self.rig)
                .map(|display| display.picture()),
            axes: self.instruments.axes(&self.rig),
            panels: self.instruments.panels(&self.rig),
            counters,
            events: self.rig.events().to_vec(),
            was_asked: self.rig.was_asked(),
            violations: self.rig.violations(),
            unbegun: self.unbegun().collect(),
            broken_rules: self.rig.mistakes(),
            own_breaks,
            strikes: strikes(&self.rig),
            #[cfg(feature = "described")]
            unanswered: super::check::unanswered(&self.rig, &self.scenario),
            #[cfg(not(feature = "described"))]
            unanswered: Vec::new(),
            probable_cause: None,
            node_words: self.rig.node_words(),
            slow_node: self.rig.slow_node(),
            waypoints: [self.progress.visits().len(), self.progress.waypoints()],
            collided_at: self.contacts.first_in_earnest(),
            trace_hash: self.rig.trace_hash(),
            history: self.history,
            wire_log: self.wire_log.map(|log| log.lock().clone()),
            truth: self.truth,
            pairs: self.pairs,
            team: Vec::new(),
        }
    }
}

/// The checks in `checks` of rules in `expect` that a run must observe but did not observe.
pub fn unobserved<'a>(expect: &'a Expect, checks: &'a [Check]) -> impl Iterator<Item = &'a Check> {
    let open = checks
        .iter()
        .filter(|one| one.status == Status::NotObserved);
    open.filter(move |check| {
        let mut rules = expect.rules().filter(|rule| rule.must_be_observed());
        rules.any(|rule| rule.check_name() == check.name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::judge;

    /// A sonar that sends by itself, and a rule that has to be observed.
    fn outcome() -> Outcome {
        let text = "schema = 1\nname = \"sonar\"\nrobot = \"none\"\nduration = \"1s\"\n\
                    device.sonar.text.baud = 9600\ndevice.sonar.text.command = []\n\
                    device.sonar.text.periodic = { line = \"mm=700\", period = \"100ms\" }\n\
                    [[expect.rule]]\nname = \"near\"\n\
                    eventually = { bytes = { link = \"sonar\", direction = \"to-master\", count = 1 } }\n";
        judge(text).expect("sound")
    }

    use Status::{Fail, NotObserved, Pass};

    fn with(robot: &str, was_asked: bool, checks: &[(&str, Status)]) -> Outcome {
        let mut outcome = outcome();
        outcome.case.robot = robot.to_owned();
        outcome.was_asked = was_asked;
        let checks = checks.iter().map(|&(name, status)| Check {
            status,
            ..Check::new(name, true, "so")
        });
        outcome.checks = checks.collect();
        outcome
    }

    /// A check of the rig's own work counts if a device was asked; a robot without a program counts
    /// if something failed.
    #[test]
    fn a_run_is_judged_by_what_could_fail() {
        let judged = |robot, was_asked, checks: &[_]| with(robot, was_asked, checks).is_judged();
        let (bytes, alive) = (BYTES_CONSERVED, "program-alive");
        assert!(!judged(NO_ROBOT, false, &[(bytes, Pass)]));
        assert!(judged(NO_ROBOT, true, &[(bytes, Pass)]));
        assert!(judged(NO_ROBOT, false, &[(bytes, Pass), ("other", Pass)]));
        assert!(!judged(
            NO_ROBOT,
            true,
            &[(bytes, NotObserved), ("other", NotObserved)]
        ));
        assert!(!judged("rescue", false, &[("other", Pass)]));
        assert!(!judged(
            "rescue",
            false,
            &[("other", Pass), (alive, NotObserved)]
        ));
        assert!(judged("rescue", false, &[("other", Pass), (alive, Pass)]));
        assert!(judged("rescue", false, &[("other", Fail)]));
        assert!(judged("rescue", true, &[("other", Pass)]));
        assert!(!judged(NO_ROBOT, true, &[]));
    }

    /// A failure, a rule that was not observed, of the robot or of another one of its team, or
    /// nothing judged at all.
    #[test]
    fn a_run_passes_if_all_that_had_to_be_observed_held() {
        let passed = |checks: &[_]| with(NO_ROBOT, true, checks).passed();
        assert!(passed(&[
            ("other", Pass),
            ("rule-near", Pass),
            ("third", NotObserved)
        ]));
        assert!(!passed(&[("other", Pass), ("third", Fail)]));
        assert!(!passed(&[("other", Pass), ("rule-near", NotObserved)]));
        assert!(passed(&[("other", Pass), ("rule-far", NotObserved)]));
        assert!(!passed(&[("other", NotObserved)]));
        let mut team = with(NO_ROBOT, true, &[("other", Pass)]);
        let open = with(NO_ROBOT, true, &[("rule-near", NotObserved)]);
        team.team = vec![("second".to_owned(), open)];
        assert!(!team.passed());
        let open = with(
            NO_ROBOT,
            true,
            &[("rule-near", NotObserved), ("other", Pass)],
        );
        let names: Vec<_> = open.unobserved_rules().map(|check| &*check.name).collect();
        assert_eq!(names, ["rule-near"]);
    }

    fn panics(outcome: &Outcome) -> String {
        let call = core::panic::AssertUnwindSafe(|| outcome.assert_passed());
        let words = std::panic::catch_unwind(call).expect_err("it did not pass");
        words.downcast_ref::<String>().expect("a text").clone()
    }

    /// The message has what failed; all checks if none was judged.
    #[test]
    fn a_run_that_did_not_pass_says_why() {
        with(NO_ROBOT, true, &[("other", Pass)]).assert_passed();
        let words = panics(&with(
            NO_ROBOT,
            true,
            &[("other", Pass), ("third", Fail), ("rule-near", NotObserved)],
        ));
        assert!(
            words.starts_with("sonar, seed 1, did not pass:\nFAIL third"),
            "{words}"
        );
        assert!(
            words.contains("rule-near") && !words.contains("other"),
            "{words}"
        );
        let words = panics(&with(NO_ROBOT, true, &[("other", NotObserved)]));
        assert!(
            words.contains(":\nnothing was judged\n") && words.contains("other"),
            "{words}"
        );
    }

    /// The third byte to the master is dropped: its time is that of its end on the line, and other
    /// bytes, directions and links have none.
    #[test]
    fn a_damaged_byte_has_its_time() {
        let fault =
            "[[fault]]\nkind = \"drop\"\nlink = \"sonar\"\ndirection = \"to-master\"\nbyte = 2\n";
        let text = format!(
            "schema = 1\nname = \"sonar\"\nrobot = \"none\"\nduration = \"1s\"\n\
             device.sonar.text.baud = 9600\ndevice.sonar.text.command = []\n\
             device.sonar.text.periodic = {{ line = \"mm=700\", period = \"100ms\" }}\n{fault}"
        );
        let outcome = judge(&text).expect("sound");
        let [(link, direction, strike, at)] = &outcome.strikes[..] else {
            panic!("one byte: {:?}", outcome.strikes);
        };
        assert_eq!((link.as_str(), strike.byte), ("sonar", 2));
        assert_eq!(*direction, DirectionSpec::ToMaster);
        // The first line is sent at 100 ms or at once; three bytes of 10 bits take 3.125 ms.
        let within = at.as_nanos() % 100_000_000;
        assert!((3_100_000..3_150_000).contains(&within), "{at}");
        let fault = |link: &str, direction, byte| FaultSpec {
            byte,
            ..FaultSpec::on(link, direction, crate::scenario::FaultKind::Drop)
        };
        let (up, down) = (DirectionSpec::ToMaster, DirectionSpec::ToDevice);
        assert_eq!(outcome.struck_at(&fault("sonar", up, Some(2))), Some(*at));
        for other in [
            fault("sonar", up, Some(1)),
            fault("sonar", up, None),
            fault("sonar", down, Some(2)),
            fault("other", up, Some(2)),
        ] {
            assert_eq!(outcome.struck_at(&other), None, "{other:?}");
        }
    }
}
