//! The verdict on a run as lines of text.

use core::fmt;
use core::time::Duration;
use std::path::Path;

use engine::rig::NO_FRAME;
use engine::run::Outcome;
use engine::run::check::VIOLATIONS;

use crate::folder::{Metrics, factor};

/// Verdict, checks and figures of a run, one a line.
pub struct Summary<'a> {
    /// The judged run.
    pub outcome: &'a Outcome,
    /// Wall time that the run took.
    pub wall: Duration,
    /// Its result folder.
    pub folder: &'a Path,
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let outcome = self.outcome;
        let metrics = Metrics::of(outcome, self.wall);
        let verdict = if outcome.passed() { "PASS" } else { "FAIL" };
        writeln!(f, "{verdict} {} seed {}", outcome.case.name, outcome.seed)?;
        for check in &outcome.checks {
            writeln!(f, "  {check}")?;
        }
        if !outcome.is_judged() {
            let why = match outcome.was_asked {
                true => "no check observed anything",
                false => {
                    "no device received a byte: no program sent one, or each device was off or \
                     unplugged; --exec CMD starts a program"
                }
            };
            writeln!(f, "  nothing was judged, so not passed: {why}")?;
        }
        let unobserved: Vec<&str> = outcome.unobserved_rules().map(|one| &*one.name).collect();
        if !unobserved.is_empty() {
            writeln!(
                f,
                "  not observed, so not passed: {}; a rule with may_be_unobserved = true may be",
                unobserved.join(", ")
            )?;
        }
        if let Some(broken) = unjudged(outcome) {
            writeln!(f, "  not judged without expect.violations_max: {broken}")?;
        }
        if let Some(failing) = failing_expression(outcome) {
            writeln!(f, "  {failing}")?;
        }
        for fault in &outcome.unbegun {
            writeln!(f, "  never began: {fault}")?;
        }
        if let Some(cause) = &outcome.probable_cause {
            writeln!(f, "  probable cause: {cause}")?;
        }
        let (sim_s, wall_s) = (metrics.sim_s, metrics.wall_s);
        writeln!(
            f,
            "  {sim_s:.1} s simulated in {wall_s:.2} s, {} times real time",
            factor(metrics.speedup)
        )?;
        if let Some(error) = outcome.pose_error {
            let (mm, deg) = (error.rms_mm, error.rms_deg);
            writeln!(
                f,
                "  pose error {mm:.1} mm and {deg:.2} deg RMS, at worst {:.1} mm",
                error.max_mm
            )?;
        }
        writeln!(f, "  trace {}", outcome.trace_hash)?;
        writeln!(f, "  results in {}", self.folder.display())
    }
}

/// The first expression of a description that failed: its device did not do its work.
fn failing_expression(outcome: &Outcome) -> Option<String> {
    let mut events = outcome.events.iter();
    let first = events.find(|logged| logged.event.rule == "expression-failed")?;
    let (device, at, detail) = (&first.source, first.event.at, &first.event.detail);
    Some(format!(
        "the description of {device} is wrong: an expression failed, first at {at} s: {detail}"
    ))
}

/// The rules that the program broke, if no check counts them; at most three.
fn unjudged(outcome: &Outcome) -> Option<String> {
    let is_judged = outcome.checks.iter().any(|check| check.name == VIOLATIONS);
    if is_judged || outcome.violations == 0 {
        return None;
    }
    let broken = outcome.broken_rules.iter();
    let broken = broken.filter(|(_, rule, _)| *rule != NO_FRAME);
    let words = broken.map(|(device, rule, count)| format!("{count} times {rule} of {device}"));
    let mut words: Vec<String> = words.collect();
    let more = words.len().saturating_sub(3);
    words.truncate(3);
    if more > 0 {
        words.push(format!("{more} more"));
    }
    Some(words.join(", "))
}
