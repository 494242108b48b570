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
            let clearance_m = member.run.rig.world.clearance();
            if clearance_m < 0.0 {
                let message = format!(
                    "stands {:.3} m deep in another robot, expected a free place",
                    -clearance_m
                );
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
}
