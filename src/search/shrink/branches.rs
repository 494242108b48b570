//! Tries of one case that begin where they part from the best so far, not at the beginning.

use std::collections::BTreeMap;
use std::rc::Rc;

use core::time::Duration;

use super::Judged;
use crate::rig::trace::fingerprint;
use crate::run::{Checkpoint, Run};
use crate::scenario::{Scenario, Source};
use crate::search::campaign::judge::run_from;

/// Checkpoints of one run, evenly over its time.
const POINTS: u32 = 24;
/// Least time between two.
const EVERY_MIN: Duration = Duration::from_millis(100);

/// Runs the tries of a search in this process; each comes to what a run from the beginning does.
///
/// The checkpoints are those of two ways, each with the tries that it branched from and the latest
/// at its end.
#[derive(Debug)]
pub struct Branches<'a> {
    source: &'a Source,
    cause: &'a str,
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
    pub fn new(source: &'a Source, cause: &'a str) -> Self {
        Self {
            source,
            cause,
            failing: Vec::new(),
            faultless: Vec::new(),
            judged: BTreeMap::new(),
        }
    }

    /// What `candidate` comes to.
    pub fn judge(&mut self, candidate: &Scenario) -> Judged {
        let name = fingerprint(candidate.to_toml().as_bytes());
        if let Some(known) = self.judged.get(&name) {
            return *known;
        }
        let found = self.try_out(candidate);
        self.judged.insert(name, found);
        found
    }

    fn try_out(&mut self, candidate: &Scenario) -> Judged {
        let ways = [&self.failing, &self.faultless];
        let branches = ways.into_iter().filter_map(|way| {
            let points = way.iter().enumerate().rev();
            let mut branches = points.filter_map(|(last, point)| {
                let run = point.resume_as(candidate)?;
                Some((&way[..=last], run))
            });
            branches.next()
        });
        let branched = branches.max_by_key(|(_, run)| run.rig.now());
        let (mut points, run) = branched.map_or((Vec::new(), None), |(points, run)| {
            (points.to_vec(), Some(run))
        });
        let every = (candidate.duration.0 / POINTS).max(EVERY_MIN);
        let mut next = run.as_ref().map_or(every, |run| time_of(run) + every);
        let begin = || match run {
            Some(run) => Ok(run),
            None => Run::new(candidate.clone(), self.source, None),
        };
        let judged = run_from(candidate, begin, |run| {
            if time_of(run) >= next {
                next = time_of(run) + every;
                points.extend(run.checkpoint().map(Rc::new));
            }
        });
        let Ok((record, _)) = judged else {
            return Judged::FailsOtherwise;
        };
        let found = Judged::of(record.cause.as_deref(), self.cause);
        if found == Judged::FailsAlike {
            self.failing = points;
        } else if candidate.fault.is_empty() {
            self.faultless = points;
        }
        found
    }
}

fn time_of(run: &Run) -> Duration {
    run.rig.now() - protocols::Instant::ZERO
}
