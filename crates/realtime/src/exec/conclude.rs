//! The verdict of a run with a user's program: checks about the program before those of the run,
//! and the probable cause of a failure.

use core::time::Duration;

use protocols::Instant;

use super::cause::{self, Evidence};
use super::exchange::Rest;
use super::ports::Ports;
use super::verdict::{alive, childless};
use super::{Foreign, add_checks};
use crate::process::waits::Wait;
use crate::process::{Ended, Farewell};
use engine::run::check::{Check, GOES_ON, STOPS, Status, astray, misunderstood, must_answer};
use engine::run::{Outcome, OwnBreaks};
use engine::scenario::FaultSpec;

/// Rig time after the program's end within which motors must rest.
const REST: Duration = Duration::from_secs(1);

/// Fails motors that still turn after the program's end, if no watchdog is judged.
fn judge_motors(outcome: &mut Outcome, ended: Option<Instant>) {
    let now = Instant::ZERO + outcome.ran;
    let on = outcome.axes.iter().filter(|axis| axis.set_point != 0.0);
    let on: Vec<String> = on
        .map(|axis| format!("{} {} {}", axis.name, axis.set_point, axis.unit))
        .collect();
    let mut checks = outcome.checks.iter_mut();
    let check = checks.find(|check| check.name == STOPS && check.status == Status::NotObserved);
    let is_long = ended.is_none_or(|at| now - at >= REST);
    if let Some(check) = check.filter(|_| is_long && !on.is_empty()) {
        let gone = match ended {
            Some(at) => format!("{:.1} s after the program ended", (now - at).as_secs_f64()),
            None => "though the program has fallen silent".to_owned(),
        };
        check.status = Status::Fail;
        check.detail = format!(
            "set-points still on at the end, {gone}: {}; no watchdog stops them",
            on.join(", ")
        );
    }
}

/// Observations of a program after its run was judged.
pub(crate) struct Ending<'a> {
    /// Observations at its ports.
    pub(crate) ports: &'a Ports,
    /// The end of each program and the rig time of it, by the program's name.
    pub(crate) each: Vec<(String, Option<(Ended, Instant)>)>,
    /// The command of the program, and its permissions.
    pub(crate) foreign: &'a Foreign,
    /// Its own end and the rig time of it, if it ended by itself.
    pub(crate) ended: Option<(Ended, Instant)>,
    /// Calls in which its threads waited at the end.
    pub(crate) waits: &'a [Wait],
    /// Result of its termination.
    pub(crate) farewell: &'a Farewell,
    /// Whether the run was over.
    pub(crate) is_over: bool,
    /// Further checks.
    pub(crate) more: Option<Check>,
}

/// The run so far, for the checks about a program.
pub(crate) struct SoFar<'a> {
    /// Rig time.
    pub(crate) now: Instant,
    /// The checks of the run.
    pub(crate) checks: &'a [Check],
    /// The faults of the run, each struck byte as one of its own.
    pub(crate) faults: &'a [FaultSpec],
    /// Whether a device received a byte.
    pub(crate) was_heard: bool,
    /// The broken rules of the devices.
    pub(crate) breaks: &'a [OwnBreaks],
}

impl Ending<'_> {
    /// Whether each program ran for as long as required.
    fn alive(&self, now: Instant) -> Check {
        let (foreign, farewell) = (self.foreign, self.farewell);
        let over = self.is_over.then_some(now);
        let one = |index: usize| {
            let (name, ended) = &self.each[index];
            let may_end = foreign.may_end_of(name);
            let last = farewell.ends.get(index).copied().flatten();
            (name, alive(*ended, over, may_end, farewell, last))
        };
        if self.each.len() == 1 {
            return one(0).1;
        }
        let each: Vec<(&String, Check)> = (0..self.each.len()).map(one).collect();
        let words = each
            .iter()
            .map(|(name, check)| format!("{name} {}", check.detail));
        let words: Vec<String> = words.collect();
        let pass = each.iter().all(|(_, check)| check.status == Status::Pass);
        Check::new("program-alive", pass, words.join("; "))
    }

    /// Judges the motors of each robot that has a program of the user.
    fn judge_all_motors(&self, outcome: &mut Outcome, is_silent: bool) {
        let others = self.foreign.others.iter().map(|one| one.robot);
        let robots = core::iter::once(self.foreign.robot).chain(others);
        let ends: Vec<_> = robots
            .zip(self.each.iter().map(|(_, ended)| *ended))
            .collect();
        let end_of = |robot: usize| {
            let own = ends.iter().filter(|(of, _)| *of == robot);
            let first = own.clone().filter_map(|(_, ended)| *ended);
            let first = first.map(|(_, at)| at).min();
            let is_judged = own.count() > 0 && (first.is_some() || is_silent);
            is_judged.then_some(first)
        };
        if let Some(ended) = end_of(0) {
            judge_motors(outcome, ended);
        }
        for (index, (name, member)) in outcome.team.iter_mut().enumerate() {
            let Some(ended) = end_of(index + 1) else {
                continue;
            };
            judge_motors(member, ended);
            let name = format!("{name}/{STOPS}");
            let all = outcome.checks.iter_mut().filter(|check| check.name == name);
            let own = member.checks.iter().find(|check| check.name == STOPS);
            for (check, own) in all.zip(own) {
                check.status = own.status;
                check.detail.clone_from(&own.detail);
            }
        }
    }

    /// The checks about the program and its ports.
    pub(crate) fn own_checks(&self, so_far: &SoFar<'_>) -> Vec<Check> {
        let (ports, foreign) = (self.ports, self.foreign);
        let ended = self
            .ended
            .map(|(ended, at)| format!("ended with {ended} at {at} s"));
        let connected = ports.connected(foreign.wait, ended);
        let reads = ports.reads();
        let is_told = [&connected, &reads]
            .iter()
            .any(|check| check.status == Status::Fail);
        let end = self.ended.map_or(so_far.now, |(_, at)| at);
        let astray = astray(so_far.breaks, end);
        let goes_on = ports.go_on(&Rest {
            now: so_far.now,
            has_ended: self.ended.is_some(),
            is_cut: !self.is_over && self.ended.is_none() && ports.is_complete(),
            is_mute: (!foreign.prints || self.farewell.said.trim().is_empty())
                && !self.ended.is_some_and(|(how, _)| how == Ended::Code(0)),
            may_idle: foreign.may_idle,
            is_told,
            checks: so_far.checks,
            faults: so_far.faults,
            was_heard: so_far.was_heard,
            misunderstood: misunderstood(so_far.breaks),
            astray: astray.as_deref(),
        });
        let alive = self.alive(so_far.now);
        let left = childless(&self.farewell.left);
        vec![connected, alive, reads, goes_on, ports.settings(), left]
    }

    /// Adds the checks about the program to `outcome`, and the probable cause if it failed.
    pub(crate) fn conclude(self, outcome: &mut Outcome) {
        let ports = self.ports;
        let mut own = self.own_checks(&SoFar {
            now: Instant::ZERO + outcome.ran,
            checks: &outcome.checks,
            faults: &outcome.case.fault,
            was_heard: outcome.was_asked || outcome.team.iter().any(|(_, end)| end.was_asked),
            breaks: &outcome.own_breaks,
        });
        let unanswered = outcome.unanswered.iter();
        let left = unanswered.filter(|master| ports.was_opened(master));
        must_answer(&mut outcome.checks, left, &outcome.case.fault);
        let mut goes_on = own.iter().filter(|check| check.name == GOES_ON);
        let is_silent = goes_on.any(|check| check.status == Status::Fail);
        self.judge_all_motors(outcome, is_silent);
        own.extend(self.more);
        add_checks(outcome, own);
        outcome.probable_cause = cause::probable(&Evidence {
            ports,
            waits: self.waits,
            ended: self.ended,
            said: &self.farewell.said,
            outcome,
        });
    }
}
