//! Tries that begin at a checkpoint of the best case so far, where they first differ from it.

use core::cmp::Reverse;
use core::time::Duration;
use std::collections::BTreeMap;
use std::rc::Rc;

use super::Judged;
use crate::campaign::judge::{Record, run_from};
use engine::rig::trace::fingerprint;
use engine::run::{Checkpoint, LOOK_EVERY, Outcome, Run};
use engine::scenario::{Scenario, ScenarioError, Source};

/// Number of checkpoints that are distributed evenly over a run. At most the same number is added
/// before faults.
const POINTS: u32 = 24;
/// `POINTS` for a case with more than [`MANY`] faults, because each checkpoint contains all of
/// them.
const FEW_POINTS: u32 = 4;
const MANY: usize = 5_000;
/// Minimum time between two checkpoints.
const EVERY_MIN: Duration = Duration::from_millis(100);

/// Executes the tries of a search in this process; the result equals that of a run from the
/// beginning.
///
/// The checkpoints are those of two runs, each in order of time, including those of the run from
/// which it branched.
#[derive(Debug)]
pub struct Branches<'a> {
    source: &'a Source,
    cause: String,
    /// Checkpoints of the last try that failed alike: the best case so far, or similar to it.
    failing: Vec<Rc<Checkpoint>>,
    /// Checkpoints of the last other try without faults. Such a try follows each failed try with
    /// faults.
    faultless: Vec<Rc<Checkpoint>>,
    /// Results by fingerprint of the scenario: the case without faults is judged after every step.
    judged: BTreeMap<String, Judged>,
    /// Whether each try begins at the start, because one from a checkpoint had another result.
    is_plain: bool,
}

impl<'a> Branches<'a> {
    /// A search without tries; a try that fails for `cause` fails alike.
    pub fn new(source: &'a Source, cause: &str) -> Self {
        Self {
            source,
            cause: cause.to_owned(),
            failing: Vec::new(),
            faultless: Vec::new(),
            judged: BTreeMap::new(),
            is_plain: false,
        }
    }

    /// Runs the first scenario of a search and returns its result; a try that fails for the same
    /// cause fails alike.
    ///
    /// # Errors
    /// If the scenario cannot be wired.
    pub fn begin(
        source: &'a Source,
        start: &Scenario,
    ) -> Result<(Self, Record, Option<Box<Outcome>>), ScenarioError> {
        let mut branches = Self::new(source, "");
        let (record, outcome, points) = branches.run(start)?.0;
        if let Some(cause) = &record.cause {
            branches.cause.clone_from(cause);
            branches.failing = points;
            branches.judged.insert(name_of(start), Judged::FailsAlike);
        }
        Ok((branches, record, outcome))
    }

    /// Judges `candidate`.
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
        let Ok(((record, _, mut points), resumed)) = self.run(candidate) else {
            return Judged::FailsOtherwise;
        };
        let mut found = Judged::of(record.cause.as_deref(), &self.cause);
        // A kept try fails from its beginning, too.
        if found == Judged::FailsAlike && resumed {
            self.is_plain = true;
            let Ok(((record, _, fresh), _)) = self.run(candidate) else {
                return Judged::FailsOtherwise;
            };
            found = Judged::of(record.cause.as_deref(), &self.cause);
            self.is_plain = found != Judged::FailsAlike;
            points = fresh;
        }
        if found == Judged::FailsAlike {
            self.failing = points;
        } else if candidate.fault.is_empty() {
            self.faultless = points;
        }
        found
    }

    /// Runs `candidate` from the latest usable checkpoint; returns the checkpoints of the run too,
    /// and whether it began at one.
    fn run(&self, candidate: &Scenario) -> Result<(Ran, bool), ScenarioError> {
        let ways = [&self.failing, &self.faultless];
        let ways = ways.into_iter().filter(|_| !self.is_plain);
        let ends = ways.flat_map(|way| {
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
        let resumed = run.is_some();
        let count = if candidate.fault.len() > MANY {
            FEW_POINTS
        } else {
            POINTS
        };
        let every = (candidate.duration.0 / count).max(EVERY_MIN);
        let from = run.as_ref().map_or(Duration::ZERO, time_of);
        let mut next = from + every;
        // Most tries remove or move a fault: they differ from its start on.
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
        Ok(((record, outcome, points), resumed))
    }
}

/// The result of a try, and its checkpoints.
type Ran = (Record, Option<Box<Outcome>>, Vec<Rc<Checkpoint>>);

/// A fingerprint of all that determines a run, without descriptive texts.
fn name_of(case: &Scenario) -> String {
    let plain = Scenario {
        origin: None,
        description: String::new(),
        ..case.clone()
    };
    fingerprint(plain.to_toml().as_bytes())
}

/// The planned times at which faults of `case` begin, in order. Empty if there are more times than
/// checkpoints: those are then close to each fault anyway.
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

    /// A case with other descriptive texts is the same case; a case with another seed is not.
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

    /// 400 ms have a checkpoint every 100 ms, and one more before the cut at 250 ms; the next one
    /// follows 100 ms later.
    #[test]
    fn what_goes_wrong_has_a_checkpoint_before_it() {
        let text = "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"400ms\"\n\
                    world.start = { x_m = 0.6, y_m = 0.6, heading_deg = 0 }\n\
                    [[fault]]\nlink = \"base\"\ndirection = \"to-device\"\nkind = \"cut\"\n\
                    from = \"250ms\"\nuntil = \"300ms\"\n";
        let (case, source) = Scenario::from_text(text).expect("sound");
        let branches = Branches::new(&source, "");
        let ((.., points), _) = branches.run(&case).expect("can be wired");
        let at = points
            .iter()
            .map(|point| point.at() - protocols::Instant::ZERO);
        assert!(at.map(|at| at.as_millis()).eq([100, 200, 240, 340]));
    }
}
