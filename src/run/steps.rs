//! Steps of the mission that wait for something: watched in their order, done when it has come
//! true, judged.

use std::collections::VecDeque;

use protocols::Instant;

use super::check::Check;
use super::{Run, Watch};
use crate::scenario::{Mission, Step};

/// A step that waits.
#[derive(Clone, Debug)]
struct Waiting {
    /// Its place in the mission, from 1.
    number: usize,
    step: Step,
    /// When the steps with a time before it are done.
    not_before: Instant,
}

/// All steps of a mission that wait, the next one first.
#[derive(Clone, Debug, Default)]
pub(super) struct Steps {
    waiting: VecDeque<Waiting>,
    /// The watch of the next one, and since when.
    watch: Option<(Watch, Instant)>,
    done: Vec<Check>,
    has_failed: bool,
}

impl Steps {
    /// Takes the steps that wait out of `mission`; those with a time stay.
    pub(super) fn take_from(mission: &mut Mission) -> Self {
        let mut steps = Self::default();
        let mut not_before = Instant::ZERO;
        for (index, step) in core::mem::take(&mut mission.step).into_iter().enumerate() {
            if let Some(at) = step.at {
                not_before = not_before.max(at.instant());
                mission.step.push(step);
            } else {
                let number = index + 1;
                steps.waiting.push_back(Waiting {
                    number,
                    step,
                    not_before,
                });
            }
        }
        steps
    }

    /// Whether one may still be done.
    pub(super) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty() && !self.has_failed
    }

    /// Those that were not done, as the mission has them.
    pub(super) fn left(&self) -> impl Iterator<Item = Step> {
        self.waiting.iter().map(|waiting| waiting.step.clone())
    }

    /// What came of each; `is_over`: nothing more can come true.
    pub(super) fn checks(&self, is_over: bool) -> Vec<Check> {
        let mut checks = self.done.clone();
        // The first of those that are left has a verdict if it failed.
        for (index, waiting) in self.waiting.iter().enumerate() {
            let name = name(waiting.number);
            let detail = format!("{} did not come true", condition(&waiting.step));
            checks.push(match (index, self.has_failed, is_over) {
                (0, true, _) => continue,
                (0, false, true) => Check::new(&name, false, detail + " until the end"),
                (0, false, false) => Check::not_observed(&name, "is still waited for"),
                _ => Check::not_observed(&name, "its turn has not come"),
            });
        }
        checks
    }

    /// The next one cannot be done any more.
    fn fail(&mut self, number: usize, detail: String) {
        self.done.push(Check::new(&name(number), false, detail));
        self.has_failed = true;
        self.watch = None;
    }
}

impl Run {
    /// Does the steps whose conditions have come true.
    pub(super) fn do_what_waited(&mut self) {
        let now = self.rig.now();
        while self.steps.is_waiting() {
            let Some(next) = self.steps.waiting.front().cloned() else {
                return;
            };
            if now < next.not_before {
                return;
            }
            if self.steps.watch.is_none() {
                let Some(watched) = next.step.when.as_ref().map(|when| self.watch(when)) else {
                    return;
                };
                match watched {
                    Ok(watch) => self.steps.watch = Some((watch, now)),
                    Err(flaw) => return self.steps.fail(next.number, flaw.to_string()),
                }
            }
            let watch = self.steps.watch.as_ref();
            let Some((has_come, since)) = watch.map(|(w, since)| (self.has_come(w), *since)) else {
                return;
            };
            if !has_come {
                let timeout = next.step.timeout.filter(|timeout| now - since >= timeout.0);
                if let Some(timeout) = timeout {
                    let what = condition(&next.step);
                    let detail = format!("{what} did not come true within {timeout} of {since} s");
                    self.steps.fail(next.number, detail);
                }
                return;
            }
            if let Err(error) = self.order(next.step.action.clone()) {
                return self.steps.fail(next.number, error.to_string());
            }
            let detail = format!("{} came true by {now} s", condition(&next.step));
            self.steps
                .done
                .push(Check::new(&name(next.number), true, detail));
            self.steps.waiting.pop_front();
            self.steps.watch = None;
        }
    }
}

fn name(number: usize) -> String {
    format!("mission-step-{number}")
}

/// What a step waits for, as a file could say it.
fn condition(step: &Step) -> String {
    let text = step.when.as_ref().map(serde_json::to_string);
    text.and_then(Result::ok).unwrap_or_default()
}
