//! Steps of the mission with a condition: observed in their order, executed when the condition is
//! true, judged.

use std::collections::VecDeque;

use protocols::Instant;

use super::check::Check;
use super::{Run, Watch};
use crate::scenario::{Flaw, Mission, Step};

/// A step with a condition.
#[derive(Clone, Debug)]
struct Waiting {
    /// Its number in the mission, from 1.
    number: usize,
    step: Step,
    /// Time at which all earlier steps with a time are done.
    not_before: Instant,
}

/// All waiting steps of a mission, the next one first.
#[derive(Clone, Debug, Default)]
pub(super) struct Steps {
    waiting: VecDeque<Waiting>,
    /// The watch of the next step, and the time of its start.
    watch: Option<(Watch, Instant)>,
    done: Vec<Check>,
    has_failed: bool,
    /// Orders of the PC added during the run.
    pub(super) by_hand: Vec<Step>,
}

impl Steps {
    /// Takes the steps with a condition from `mission`; steps with a time stay.
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

    /// Whether a step can still be executed.
    pub(super) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty() && !self.has_failed
    }

    /// Result of each step; `is_over`: no condition can become true any more.
    pub(super) fn checks(&self, is_over: bool) -> Vec<Check> {
        let mut checks = self.done.clone();
        // Only the first remaining step has a verdict if it failed.
        for (index, waiting) in self.waiting.iter().enumerate() {
            let name = name(waiting.number);
            let detail = format!("{} did not come true", condition(&waiting.step));
            checks.push(match (index, self.has_failed, is_over) {
                (0, true, _) => continue,
                (0, false, true) => Check::new(&name, false, detail + " until the end"),
                (0, false, false) => Check::not_observed(&name, "is still waited for"),
                _ => Check::not_observed(&name, "an earlier step is not done"),
            });
        }
        checks
    }

    /// Records that a step of the rig that was due at `now` cannot be executed.
    pub(super) fn fail_now(&mut self, number: usize, now: Instant, flaw: &Flaw) {
        let detail = format!("at {now} s: {flaw}");
        self.done.push(Check::new(&name(number), false, detail));
    }

    /// Records that the next step cannot be executed any more.
    fn fail(&mut self, number: usize, detail: String) {
        self.done.push(Check::new(&name(number), false, detail));
        self.has_failed = true;
        self.watch = None;
    }
}

impl Run {
    /// Executes the steps whose conditions have become true.
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
            if let Err(error) = self.order(next.number, next.step.action.clone()) {
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

/// Condition of a step in the form of a file.
fn condition(step: &Step) -> String {
    let text = step.when.as_ref().map(serde_json::to_string);
    text.and_then(Result::ok).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::run::check::Status;
    use crate::scenario::Scenario;

    /// Steps 2, 4 and 5 wait; step 4 for an event after the time of step 3.
    fn steps() -> (Steps, Mission) {
        let text = "schema = 1\nname = \"steps\"\nrobot = \"rescue\"\nduration = \"5s\"\n\
                    [[mission.step]]\nat = \"1s\"\ndo = { mode = \"stop\" }\n\
                    [[mission.step]]\nwhen = { visited = 1 }\ndo = { mode = \"stop\" }\n\
                    [[mission.step]]\nat = \"3s\"\ndo = { mode = \"stop\" }\n\
                    [[mission.step]]\nwhen = { visited = 2 }\ndo = \"disconnect\"\n\
                    [[mission.step]]\nwhen = { visited = 3 }\ndo = \"disconnect\"\n\
                    [world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n";
        let parsed = Scenario::parse(Path::new("<test>"), text.to_owned());
        let mut mission = parsed.expect("sound").0.mission;
        (Steps::take_from(&mut mission), mission)
    }

    fn told(steps: &Steps, is_over: bool) -> Vec<(String, Status, String)> {
        let checks = steps.checks(is_over).into_iter();
        checks
            .map(|check| (check.name, check.status, check.detail))
            .collect()
    }

    #[test]
    fn steps_without_a_time_wait_in_their_order() {
        let (steps, mission) = steps();
        assert_eq!((mission.step.len(), steps.waiting.len()), (2, 3));
        let places = steps.waiting.iter().map(|one| (one.number, one.not_before));
        let (one, three) = (Instant::from_secs(1), Instant::from_secs(3));
        assert_eq!(
            places.collect::<Vec<_>>(),
            [(2, one), (4, three), (5, three)]
        );
        assert!(steps.is_waiting());
    }

    /// A condition that always holds becomes true with the step before it, at 1 s; the run checks
    /// it then, as every 10 ms.
    #[test]
    fn a_step_may_be_done_as_soon_as_those_before_it() {
        let text = "schema = 1\nname = \"steps\"\nrobot = \"rescue\"\nduration = \"5s\"\n\
                    [[mission.step]]\nat = \"1s\"\ndo = { mode = \"stop\" }\n\
                    [[mission.step]]\n\
                    when = { pose = { near_m = [1.0, 1.0], within_m = 9.0 } }\n\
                    do = { mode = \"stop\" }\n\
                    [world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n";
        let parsed = Scenario::parse(Path::new("<test>"), text.to_owned());
        let (scenario, source) = parsed.expect("sound");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        run.go_on_until(Instant::from_secs(2));
        let checks = told(&run.steps, false);
        let [(name, Status::Pass, detail)] = &checks[..] else {
            panic!("{checks:?}")
        };
        assert_eq!(name, "mission-step-2");
        assert!(detail.ends_with(" came true by 1.000000 s"), "{detail}");
    }

    /// Only the next step can have failed; the others have not begun to wait.
    #[test]
    fn what_was_waited_for_is_judged_at_the_end() {
        let (mut steps, _) = steps();
        let later = |number: u8| {
            let detail = "an earlier step is not done".to_owned();
            (
                format!("mission-step-{number}"),
                Status::NotObserved,
                detail,
            )
        };
        let first = |status, detail: &str| ("mission-step-2".to_owned(), status, detail.to_owned());
        let going = first(Status::NotObserved, "is still waited for");
        assert_eq!(told(&steps, false), [going, later(4), later(5)]);
        let missed = "{\"visited\":1} did not come true until the end";
        let missed = first(Status::Fail, missed);
        assert_eq!(told(&steps, true), [missed, later(4), later(5)]);
        steps.fail(2, "too late".to_owned());
        assert!(!steps.is_waiting());
        let failed = first(Status::Fail, "too late");
        for is_over in [false, true] {
            assert_eq!(told(&steps, is_over), [failed.clone(), later(4), later(5)]);
        }
    }

    /// A step waits from the first look at 10 ms on, for a second; then the mission waits no more.
    #[test]
    fn a_step_waits_for_its_time() {
        let text = "schema = 1\nname = \"steps\"\nrobot = \"rescue\"\nduration = \"5s\"\n\
                    [mission]\nwaypoints_m = [[2.5, 2.5]]\n\
                    [[mission.step]]\nwhen = { visited = 1 }\ntimeout = \"1s\"\ndo = { mode = \"stop\" }\n\
                    [world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n";
        let parsed = Scenario::parse(Path::new("<test>"), text.to_owned());
        let (scenario, source) = parsed.expect("sound");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        run.go_on_until(Instant::from_millis(1_000));
        assert!(run.steps.is_waiting());
        run.go_on_until(Instant::from_millis(1_010));
        assert!(!run.steps.is_waiting());
        let detail = "{\"visited\":1} did not come true within 1s of 0.010000 s".to_owned();
        let failed = ("mission-step-1".to_owned(), Status::Fail, detail);
        assert_eq!(told(&run.steps, false), [failed]);
    }

    /// A step of the rig that cannot be executed is a failure of its own, and the others go on.
    #[test]
    fn a_step_of_the_rig_may_fail() {
        let (mut steps, _) = steps();
        let flaw = Flaw::new("name", "is unknown");
        steps.fail_now(7, Instant::from_secs(3), &flaw);
        assert!(steps.is_waiting());
        let first = told(&steps, false).remove(0);
        let detail = "at 3.000000 s: name: is unknown".to_owned();
        assert_eq!(first, ("mission-step-7".to_owned(), Status::Fail, detail));
    }
}
