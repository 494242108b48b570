//! Tries of one case that begin where they part from the best so far, not at the beginning.

use core::cmp::Reverse;
use core::time::Duration;
use std::collections::BTreeMap;
use std::rc::Rc;

use super::Judged;
use crate::campaign::judge::{Record, run_from};
use engine::rig::trace::fingerprint;
use engine::run::{Checkpoint, LOOK_EVERY, Outcome, Run};
use engine::scenario::{Scenario, ScenarioError, Source};

/// Checkpoints of one run, evenly over its time; as many at most before what goes wrong.
const POINTS: u32 = 24;
/// Minimum time between two.
const EVERY_MIN: Duration = Duration::from_millis(100);

/// Runs the tries of a search in this process; each comes to what a run from the beginning does.
///
/// The checkpoints are those of two ways, each with the tries that it branched from and the latest
/// at its end.
#[derive(Debug)]
pub struct Branches<'a> {
    source: &'a Source,
    cause: String,
    /// Of the last try that failed alike, which is the best so far or near it.
    failing: Vec<Rc<Checkpoint>>,
    /// Of the last other one without faults, which is asked whenever one with them has failed.
    faultless: Vec<Rc<Checkpoint>>,
    /// What each scenario came to, by its fingerprint: that of a case without its faults is asked
    /// after every step.
    judged: BTreeMap<String, Judged>,
}

impl<'a> Branches<'a> {
    /// Nothing tried yet; what fails for `cause` fails alike.
    pub fn new(source: &'a Source, cause: &str) -> Self {
        Self {
            source,
            cause: cause.to_owned(),
            failing: Vec::new(),
            faultless: Vec::new(),
            judged: BTreeMap::new(),
        }
    }

    /// Runs the scenario that a search begins with, and what it came to: what fails for the same
    /// cause fails alike.
    ///
    /// # Errors
    /// If the scenario cannot be wired.
    pub fn begin(
        source: &'a Source,
        start: &Scenario,
    ) -> Result<(Self, Record, Option<Box<Outcome>>), ScenarioError> {
        let mut branches = Self::new(source, "");
        let (record, outcome, points) = branches.run(start)?;
        if let Some(cause) = &record.cause {
            branches.cause.clone_from(cause);
            branches.failing = points;
            branches.judged.insert(name_of(start), Judged::FailsAlike);
        }
        Ok((branches, record, outcome))
    }

    /// What `candidate` comes to.
    pub fn judge(&mut self, candidate: &Scenario) -> Judged {
        let name = name_of(candidate);
        if let Some(known) = self.judged.get(&name) {
            return *known;
        }
        let found = self.try_out(candidate);
        self.judged.insert(name, found);
        found
    }

    fn try_out(&mut self, candidate: &Scenario) -> Judged {
        let Ok((record, _, points)) = self.run(candidate) else {
            return Judged::FailsOtherwise;
        };
        let found = Judged::of(record.cause.as_deref(), &self.cause);
        if found == Judged::FailsAlike {
            self.failing = points;
        } else if candidate.fault.is_empty() {
            self.faultless = points;
        }
        found
    }

    /// Runs `candidate` from the latest checkpoint that it can branch from; with the checkpoints of
    /// its way.
    fn run(&self, candidate: &Scenario) -> Result<Ran, ScenarioError> {
        let ways = [&self.failing, &self.faultless];
        let ends = ways.into_iter().flat_map(|way| {
            let points = way.iter().enumerate();
            points.map(|(last, point)| (point, &way[..=last]))
        });
        let mut ends: Vec<_> = ends.collect();
        ends.sort_by_key(|(point, _)| Reverse(point.at()));
        let mut branches = ends.into_iter().filter_map(|(point, way)| {
            let run = point.resume_as(candidate)?;
            Some((way.to_vec(), Some(run)))
        });
        let (mut points, run) = branches.next().unwrap_or_default();
        let every = (candidate.duration.0 / POINTS).max(EVERY_MIN);
        let from = run.as_ref().map_or(Duration::ZERO, time_of);
        let mut next = from + every;
        // Most tries leave out or move something that goes wrong: they part where it begins.
        let mut begins = begins_of(candidate);
        begins.retain(|begin| *begin > from + LOOK_EVERY);
        let mut begins = begins.into_iter().peekable();
        let begin = || match run {
            Some(run) => Ok(run),
            None => Run::new(candidate.clone(), self.source, None),
        };
        let (record, outcome) = run_from(candidate, begin, |run| {
            let now = time_of(run);
            let mut is_due = now >= next;
            while begins.next_if(|begin| *begin <= now + LOOK_EVERY).is_some() {
                is_due = true;
            }
            if is_due {
                next = now + every;
                points.extend(run.checkpoint().map(Rc::new));
            }
        })?;
        Ok((record, outcome, points))
    }
}

/// What a try came to, and the checkpoints of its way.
type Ran = (Record, Option<Box<Outcome>>, Vec<Rc<Checkpoint>>);

/// A fingerprint of all that a run depends on: not of its words.
fn name_of(case: &Scenario) -> String {
    let plain = Scenario {
        origin: None,
        description: String::new(),
        ..case.clone()
    };
    fingerprint(plain.to_toml().as_bytes())
}

/// When what goes wrong in `case` begins, as far as it is planned by time, in order. Where that is
/// at more times than there are checkpoints, those lie among them anyway, and none counts.
fn begins_of(case: &Scenario) -> Vec<Duration> {
    let begins = case.fault.iter().filter_map(|fault| fault.from);
    let mut begins: Vec<Duration> = begins.map(|from| from.0).collect();
    begins.sort_unstable();
    begins.dedup();
    if begins.len() > POINTS as usize {
        begins.clear();
    }
    begins
}

fn time_of(run: &Run) -> Duration {
    run.rig.now() - protocols::Instant::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A case in other words is the same case; one of another seed is not.
    #[test]
    fn what_was_judged_is_not_run_again() {
        let text = "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"100ms\"\n\
                    world.start = { x_m = 0.6, y_m = 0.6, heading_deg = 0 }\n";
        let (mut case, source) = Scenario::from_text(text).expect("sound");
        let mut branches = Branches::new(&source, "");
        let first = branches.judge(&case);
        case.description = "in other words".to_owned();
        assert_eq!((branches.judge(&case), branches.judged.len()), (first, 1));
        case.seed += 1;
        branches.judge(&case);
        assert_eq!(branches.judged.len(), 2);
    }

    /// 400 ms have checkpoints each 100 ms, and one more before the cut at 250 ms, behind which
    /// they count again.
    #[test]
    fn what_goes_wrong_has_a_checkpoint_before_it() {
        let text = "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"400ms\"\n\
                    world.start = { x_m = 0.6, y_m = 0.6, heading_deg = 0 }\n\
                    [[fault]]\nlink = \"base\"\ndirection = \"to-device\"\nkind = \"cut\"\n\
                    from = \"250ms\"\nuntil = \"300ms\"\n";
        let (case, source) = Scenario::from_text(text).expect("sound");
        let branches = Branches::new(&source, "");
        let (.., points) = branches.run(&case).expect("can be wired");
        let at = points
            .iter()
            .map(|point| point.at() - protocols::Instant::ZERO);
        assert!(at.map(|at| at.as_millis()).eq([100, 200, 240, 340]));
    }
}
