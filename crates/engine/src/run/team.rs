//! The further robots of a run. Each is a run of its own: rig, world, checkers and verdicts are
//! those of a robot alone. The worlds advance in step with each other, and in each world the other
//! robots are obstacles, see [`World::see`](emulators::world::World::see).

use core::time::Duration;
use std::io;

use emulators::world::{Footprint, Pose, World};
use protocols::Instant;

use super::check::Check;
use super::{Outcome, Run};
use crate::rig::trace::fingerprint;
use crate::rig::{Rig, Rigs};
use crate::robots::{self, Dut, Instruments, PcEnd, Wired};
use crate::scenario::{Scenario, ScenarioError, Source};

/// The worlds learn of each other after each step of the physics.
const MEET_EVERY: Duration = Duration::from_millis(1);

/// The command that repeats the run of a member, in its result folder: the case of all robots.
const AGAIN: &str = "hilrig run ../../case.toml";

/// A further robot.
pub struct Member {
    /// Its name in the scenario.
    pub name: String,
    /// Its run, which the run of the first robot advances and judges.
    pub run: Run,
}

impl Run {
    /// The further robots.
    pub fn team(&self) -> &[Member] {
        &self.team
    }

    /// The further robots, to observe them.
    pub fn team_mut(&mut self) -> &mut [Member] {
        &mut self.team
    }

    /// A run of `scenario` in the rig of its first robot, see
    /// [`wire_first`](robots::wire_first); its further robots, with their built-in programs, are
    /// wired into the same world.
    ///
    /// # Errors
    /// If the scenario is invalid for one of them.
    pub fn with_team(
        scenario: Scenario,
        source: &Source,
        first: (Rig, Box<dyn Instruments>),
    ) -> Result<Self, ScenarioError> {
        let members = wire_members(&scenario, source, Dut::Internal)?;
        Self::with_members(scenario, source, first, members)
    }

    /// As [`with_team`](Self::with_team), with further robots of [`wire_members`].
    ///
    /// # Errors
    /// If two robots stand at the same place.
    pub fn with_members(
        scenario: Scenario,
        source: &Source,
        (rig, instruments): (Rig, Box<dyn Instruments>),
        members: Vec<Wired>,
    ) -> Result<Self, ScenarioError> {
        let mut run = Self::with_rig(scenario, rig, instruments);
        run.join(source, members)?;
        Ok(run)
    }

    /// The scenarios of all robots, that of the first one first. Their order is that of
    /// [`Rigs`].
    pub fn scenarios(&self) -> impl Iterator<Item = &Scenario> {
        let others = self.team.iter().map(|member| &member.run.scenario);
        core::iter::once(&self.scenario).chain(others)
    }

    /// Time of the next event in the rig of any robot.
    pub fn next_event(&self) -> Option<Instant> {
        let others = self.team.iter().map(|member| &member.run.rig);
        let rigs = core::iter::once(&self.rig).chain(others);
        rigs.filter_map(Rig::next_event).min()
    }

    /// Finishes the files of all taps; returns the first write error.
    pub fn finish_taps(&mut self) -> io::Result<()> {
        let team = self.team.iter_mut().map(|member| &mut member.run.rig);
        let results = core::iter::once(&mut self.rig).chain(team);
        let results: Vec<_> = results.map(Rig::finish_taps).collect();
        results.into_iter().collect()
    }

    /// Errors that stopped taps since the last call, as text for immediate output.
    pub fn take_tap_trouble(&mut self) -> Option<String> {
        let team = self.team.iter_mut().map(|member| &mut member.run.rig);
        let mut rigs = core::iter::once(&mut self.rig).chain(team);
        rigs.find_map(Rig::take_tap_trouble)
    }

    fn join(&mut self, source: &Source, members: Vec<Wired>) -> Result<(), ScenarioError> {
        let mut starts = Vec::new();
        let wired = self.scenario.members(source).into_iter().zip(members);
        for ((name, scenario, part), wired) in wired {
            let run = Self::with_rig(scenario, wired.rig, wired.instruments);
            starts.push((name.clone(), part));
            self.team.push(Member { name, run });
        }
        if self.team.is_empty() {
            return Ok(());
        }
        let all: Vec<(Footprint, Pose)> = self
            .worlds()
            .map(|world| (world.footprint().clone(), world.pose()))
            .collect();
        for (index, world) in self.worlds_mut().enumerate() {
            let mut others = all.clone();
            others.remove(index);
            world.add_robots(&others);
        }
        let mut wrong = Vec::new();
        for (member, (name, part)) in self.team.iter().zip(starts) {
            if member.run.rig.world.clearance() < 0.0 {
                let message = "stands in another robot, expected a free place".to_owned();
                let span = member.run.scenario.world.start.span();
                let error = part.invalid(Some(span), "world.start", message);
                wrong.push(error.of_member(&name));
            }
        }
        ScenarioError::none_of(wrong)
    }

    /// The worlds of all robots, that of the first one first.
    fn worlds(&self) -> impl Iterator<Item = &World> {
        let others = self.team.iter().map(|member| &member.run.rig.world);
        core::iter::once(&self.rig.world).chain(others)
    }

    fn worlds_mut(&mut self) -> impl Iterator<Item = &mut World> {
        let others = self.team.iter_mut();
        let others = others.map(|member| &mut member.run.rig.world);
        core::iter::once(&mut self.rig.world).chain(others)
    }

    /// Time at which the worlds learn of each other again, if there are several.
    pub(super) fn next_meeting(&self) -> Option<Instant> {
        (!self.team.is_empty()).then(|| meeting_after(self.rig.now()))
    }

    /// Runs all robots until `deadline`, step by step.
    pub(super) fn advance_team(&mut self, deadline: Instant) {
        loop {
            let next = meeting_after(self.rig.now()).min(deadline);
            self.advance_alone(next);
            for member in &mut self.team {
                member.run.advance_alone(next);
            }
            if is_meeting(next) {
                self.meet();
            }
            if next >= deadline {
                return;
            }
        }
    }

    /// Each world learns the motion of all others.
    fn meet(&mut self) {
        for (index, member) in self.team.iter_mut().enumerate() {
            self.rig.world.see(index, &member.run.rig.world);
            member.run.rig.world.see(0, &self.rig.world);
        }
        for index in 0..self.team.len() {
            let (before, rest) = self.team.split_at_mut(index);
            let [member, after @ ..] = rest else {
                return;
            };
            let (world, others) = (&mut member.run.rig.world, before.iter().chain(&*after));
            for (place, other) in (1..).zip(others) {
                world.see(place, &other.run.rig.world);
            }
        }
    }

    /// Whether each further robot has done its task. A robot without waypoints has no task, but it
    /// may wait for an event.
    pub(super) fn is_team_done(&self) -> bool {
        self.team.iter().all(|Member { run, .. }| {
            let Scenario {
                mission, expect, ..
            } = &run.scenario;
            let has_task = !mission.waypoints_m.is_empty() || expect.home_within_mm.is_some();
            let is_done = match has_task {
                true => run.is_done(),
                false => !run.is_waiting(),
            };
            is_done && !mission.to_the_end
        })
    }

    /// Copies of the further robots; `None` if one of them cannot be copied.
    pub(super) fn fork_team(&self) -> Option<Vec<Member>> {
        let members = self.team.iter().map(|member| {
            let name = member.name.clone();
            let run = member.run.fork()?;
            Some(Member { name, run })
        });
        members.collect()
    }

    /// The checks of the further robots, each with the name of its robot.
    pub(super) fn team_checks(&self) -> impl Iterator<Item = Check> {
        let members = self.team.iter();
        members.flat_map(|member| named(&member.name, member.run.checks()))
    }

    /// The ends of the further robots' runs.
    pub(super) fn end_team(&mut self, end: impl Fn(Self) -> Outcome) -> Vec<(String, Outcome)> {
        let is_over = self.is_over;
        let members = core::mem::take(&mut self.team).into_iter();
        let ends = members.map(|mut member| {
            member.run.is_over = is_over;
            let mut outcome = end(member.run);
            outcome.again = Some(AGAIN.to_owned());
            (member.name, outcome)
        });
        ends.collect()
    }
}

impl Rigs for Run {
    fn rig_of(&self, robot: usize) -> &Rig {
        let member = robot.checked_sub(1).and_then(|it| self.team.get(it));
        member.map_or(&self.rig, |member| &member.run.rig)
    }
}

/// Wires the further robots of `scenario`. With [`Dut::External`], robots with an `exec` table and
/// robots without a built-in program have open ends; others have their built-in programs. The name
/// of an open end is `ROBOT/PORT`.
///
/// # Errors
/// If the scenario is invalid for one of them, or if a robot has no program.
pub fn wire_members(
    scenario: &Scenario,
    source: &Source,
    dut: Dut,
) -> Result<Vec<Wired>, ScenarioError> {
    let members = (1..).zip(scenario.members(source));
    let wired = members.map(|(robot, (name, scenario, part))| {
        let wired = wire_member(&scenario, &part, dut);
        let mut wired = wired.map_err(|error| error.of_member(&name))?;
        for end in &mut wired.open_ends {
            end.robot = robot;
            end.name = format!("{name}/{}", end.name);
        }
        Ok(wired)
    });
    wired.collect()
}

fn wire_member(scenario: &Scenario, source: &Source, dut: Dut) -> Result<Wired, ScenarioError> {
    let has_own = robots::of(scenario, source)?
        .program(scenario, source)?
        .is_some();
    if dut == Dut::External && !(has_own && scenario.exec.is_empty()) {
        let pc = match scenario.mission.gives_orders() {
            true => PcEnd::Scripted,
            false => PcEnd::External,
        };
        return robots::wire_first(scenario, source, Dut::External, pc);
    }
    let wired = robots::wire_first(scenario, source, Dut::Internal, PcEnd::Scripted)?;
    if wired.rig.program().is_some() {
        return Ok(wired);
    }
    let message = format!(
        "is \"{}\", which has no built-in program, expected one of yours: \"hilrig run\" starts those of \
         [team.NAME.exec.PROGRAM] and of [exec.PROGRAM], or --exec CMD --virtual starts one for all \
         robots",
        scenario.robot
    );
    Err(source.invalid(source.find("robot"), "robot", message))
}

impl Outcome {
    /// Adds the verdicts of the further robots, and their bytes to the fingerprint.
    pub(super) fn join(&mut self, team: Vec<(String, Self)>) {
        if team.is_empty() {
            return;
        }
        let mut hashes = self.trace_hash.clone();
        for (name, outcome) in &team {
            self.checks.extend(named(name, outcome.checks.clone()));
            hashes.push_str(&format!(" {name} {}", outcome.trace_hash));
        }
        self.trace_hash = fingerprint(hashes.as_bytes());
        if let Some(origin) = &mut self.case.origin {
            origin.trace_hash.clone_from(&self.trace_hash);
        }
        self.team = team;
    }
}

/// The checks of the robot `name`, by their names in the run of all robots.
fn named(name: &str, checks: Vec<Check>) -> impl Iterator<Item = Check> {
    checks.into_iter().map(move |check| Check {
        name: format!("{name}/{}", check.name),
        ..check
    })
}

/// The start of the first step of the physics after `now`.
fn meeting_after(now: Instant) -> Instant {
    let every = step_nanos();
    Instant::from_nanos((now.as_nanos() / every + 1) * every)
}

fn is_meeting(at: Instant) -> bool {
    at.as_nanos().is_multiple_of(step_nanos())
}

fn step_nanos() -> u64 {
    u64::from(MEET_EVERY.subsec_nanos())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The physics has steps of a millisecond. At the start of a step, the next one is later.
    #[test]
    fn worlds_meet_at_each_step_of_the_physics() {
        let nanos = Instant::from_nanos;
        let after = [0, 999_999, 1_000_000, 1_000_001].map(|now| meeting_after(nanos(now)));
        let next = [1_000_000, 1_000_000, 2_000_000, 2_000_000].map(nanos);
        assert_eq!(after, next);
        let are = [0, 1, 1_000_000, 1_000_001, 7_000_000].map(|now| is_meeting(nanos(now)));
        assert_eq!(are, [true, false, true, false, true]);
    }

    #[test]
    fn checks_have_the_names_of_their_robots() {
        let check = Check::new("settled", false, "so");
        let all: Vec<Check> = named("second", vec![check]).collect();
        assert_eq!(all, [Check::new("second/settled", false, "so")]);
    }

    /// A robot alone has nothing to meet, and its taps no trouble.
    #[test]
    fn a_robot_alone_meets_nothing() {
        let (scenario, source) = super::super::check::safety::puppet::scenario("");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        assert_eq!((run.next_meeting(), run.team().len()), (None, 0));
        assert_eq!((run.team_checks().count(), run.scenarios().count()), (0, 1));
        assert!(run.is_team_done() && run.take_tap_trouble().is_none());
        assert!(run.finish_taps().is_ok() && run.fork_team().is_some());
        assert_eq!(run.next_event(), run.rig.next_event());
    }

    /// Three rescue robots in a row, at x of 1, 1.5 and 2.2 m, with further tables of the second
    /// one.
    fn team(more: &str) -> (Scenario, Source) {
        let member = |name: &str, x: f64| {
            format!(
                "[team.{name}]\nrobot = \"rescue\"\n\
                 start = {{ x_m = {x}, y_m = 1, heading_deg = 0 }}\n"
            )
        };
        let text = format!("{}{more}{}", member("second", 1.5), member("third", 2.2));
        super::super::check::safety::puppet::scenario(&text)
    }

    fn run(more: &str) -> Run {
        let (scenario, source) = team(more);
        Run::new(scenario, &source, None).expect("can be wired")
    }

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    /// All rigs have the same time. The first robot has the number 0, also for the rig of a number
    /// that no robot has.
    #[test]
    fn robots_of_a_team_advance_together() {
        use crate::rig::Paced as _;
        let mut run = run("");
        run.go_on_until(at(25));
        let times: Vec<Instant> = (0..3).map(|robot| run.rig_of(robot).now()).collect();
        assert_eq!(times, [at(25); 3]);
        assert_eq!(
            (run.next_meeting(), run.undisturbed_until()),
            (Some(at(26)), at(26))
        );
        let places = [0, 1, 2, 3].map(|robot| run.rig_of(robot).world.pose().x);
        let expected = [1.0, 1.5, 2.2, 1.0];
        assert!(
            places
                .iter()
                .zip(expected)
                .all(|(x, own)| (x - own).abs() < 0.01),
            "{places:?}"
        );
        for robot in 0..4 {
            let own = run.rig_of(robot).world.pose();
            assert_eq!(run.rig_of_mut(robot).world.pose(), own);
        }
        let names: Vec<&str> = run.scenarios().map(|one| &*one.name).collect();
        assert_eq!(names, ["t", "t-second", "t-third"]);
        let events = (0..3)
            .filter_map(|robot| run.rig_of(robot).next_event())
            .min();
        assert_eq!(run.next_event(), events);
        assert!(run.finish_taps().is_ok() && run.take_tap_trouble().is_none());
        let names: Vec<&str> = run.team_mut().iter().map(|member| &*member.name).collect();
        assert_eq!(names, ["second", "third"]);
        let copies = run.fork_team().expect("plain state");
        let copies: Vec<&str> = copies.iter().map(|member| &*member.name).collect();
        assert_eq!(copies, ["second", "third"]);
    }

    /// The second robot is pushed by 0.2 m to the third one, the first one by 0.1 m to the second
    /// one, and the third one by 0.1 m back. In each world, the gap to the nearest robot is that
    /// of their discs.
    #[test]
    fn each_world_has_the_motion_of_all_robots() {
        let mut run = run("");
        let push = |run: &mut Run, robot: usize, by_m: f64| {
            use crate::rig::Paced as _;
            let over = Duration::from_millis(20);
            run.rig_of_mut(robot).world.push(by_m, 0.0, 0.0, over);
        };
        let is_as_far = |run: &Run| {
            let places: Vec<f64> = run.worlds().map(|world| world.pose().x).collect();
            let gaps = [places[1] - places[0], places[2] - places[1]];
            let nearest = [gaps[0], gaps[0].min(gaps[1]), gaps[1]];
            for (world, nearest) in run.worlds().zip(nearest) {
                let free = nearest - 2.0 * world.footprint().reach_m();
                let clearance = world.clearance();
                assert!((clearance - free).abs() < 0.002, "{places:?}: {clearance}");
            }
            gaps
        };
        run.go_on_until(at(10));
        is_as_far(&run);
        push(&mut run, 1, 0.2);
        run.go_on_until(at(110));
        let first = is_as_far(&run);
        assert!(first[0] > 0.65 && first[1] < 0.55, "{first:?}");
        push(&mut run, 0, 0.1);
        run.go_on_until(at(210));
        let second = is_as_far(&run);
        assert!(second[0] < first[0] - 0.05, "{second:?}");
        push(&mut run, 2, -0.1);
        run.go_on_until(at(310));
        let third = is_as_far(&run);
        assert!(third[1] < second[1] - 0.05, "{third:?}");
    }

    /// Two discs of which the middles are 0.25 m apart are in each other.
    #[test]
    fn two_robots_have_no_room_at_one_place() {
        let (scenario, source) = super::super::check::safety::puppet::scenario(
            "[team.second]\nrobot = \"rescue\"\n\
             start = { x_m = 1.25, y_m = 1, heading_deg = 0 }\n",
        );
        let error = Run::new(scenario, &source, None).map(|_| ());
        let error = error.expect_err("no room").to_string();
        assert!(
            error.contains("stands in another robot") && error.contains("team.second.start"),
            "{error}"
        );
    }

    /// A further robot without a task is done unless it waits or continues to the end; one with
    /// waypoints, or one that has to be home, has a task.
    #[test]
    fn each_robot_of_a_team_has_to_be_done() {
        assert!(run("").is_team_done());
        assert!(!run("[team.second.mission]\nwaypoints_m = [[2.0, 2.0]]\n").is_team_done());
        assert!(!run("[team.second.expect]\nhome_within_mm = 100\n").is_team_done());
        assert!(!run("[team.second.mission]\nto_the_end = true\n").is_team_done());
        let waits = "[[team.second.mission.step]]\ndo = { mode = \"stop\" }\n\
                     when = { contact = { faster_than_m_s = 0.1 } }\n";
        assert!(!run(waits).is_team_done());
    }

    /// Checks and bytes of all robots are those of the run; each further robot has its own end.
    #[test]
    fn a_run_is_judged_with_all_robots() {
        let mut run = run("");
        run.go_on_until(at(20));
        let named = run.checks();
        let count = |name: &str| {
            let own = named.iter().filter(|check| check.name.starts_with(name));
            own.count()
        };
        let (second, third) = (count("second/"), count("third/"));
        assert!(second > 0 && second == third && named.len() > second + third);
        assert_eq!(run.team_checks().count(), second + third);
        let alone = run.rig.trace_hash();
        let outcome = run.judge();
        let names: Vec<&str> = outcome.team.iter().map(|(name, _)| &**name).collect();
        assert_eq!(names, ["second", "third"]);
        assert!(
            outcome
                .team
                .iter()
                .all(|(_, end)| end.again.as_deref() == Some(AGAIN))
        );
        let is_named = |check: &&Check| check.name.starts_with("second/");
        assert_eq!(outcome.checks.iter().filter(is_named).count(), second);
        assert_ne!(outcome.trace_hash, alone);
        let hashes: Vec<&str> = outcome
            .team
            .iter()
            .map(|(_, end)| &*end.trace_hash)
            .collect();
        let all = format!("{alone} second {} third {}", hashes[0], hashes[1]);
        assert_eq!(outcome.trace_hash, fingerprint(all.as_bytes()));
        let origin = outcome.case.origin.expect("a case of a run");
        assert_eq!(origin.trace_hash, outcome.trace_hash);
    }

    /// A further robot with an `exec` table has open ends, which have its number and its name; the
    /// others have their built-in programs.
    #[test]
    fn only_a_robot_with_a_program_of_yours_has_open_ends() {
        let exec = "[team.second.exec.pilot]\ncommand = \"true\"\n";
        let ends = |more: &str, dut| {
            let (scenario, source) = team(more);
            let wired = wire_members(&scenario, &source, dut).expect("can be wired");
            let ends = wired.iter().map(|one| {
                let ends = &one.open_ends;
                assert!(ends.iter().all(|end| end.robot == 1));
                assert!(ends.iter().all(|end| end.name.starts_with("second/")));
                (ends.is_empty(), one.rig.program().is_some())
            });
            ends.collect::<Vec<_>>()
        };
        let built_in = [(true, true), (true, true)];
        assert_eq!(ends("", Dut::Internal), built_in);
        assert_eq!(ends("", Dut::External), built_in);
        assert_eq!(ends(exec, Dut::Internal), built_in);
        assert_eq!(ends(exec, Dut::External), [(false, false), (true, true)]);
    }
}
