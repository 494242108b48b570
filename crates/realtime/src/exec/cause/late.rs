//! Replies that are late or missing, by the rules of masters and of the scenario, and other broken
//! rules of the scenario.

use super::{Cause, Evidence, weight};
use engine::run::check::{Check, Status};
use engine::run::{Outcome, OwnBreaks};
use engine::scenario::{Condition, Demand, DirectionSpec, RuleSpec};

/// Rules of masters that mean: the reply did not come within the timeout.
pub(super) const LATE: [&str; 1] = ["no-reply"];

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    let outcome = evidence.outcome;
    let breaks = outcome.own_breaks.iter();
    let mut breaks = breaks.filter(|one| LATE.contains(&one.rule) && one.count > 0);
    let masters = breaks.find_map(|one| unanswered(outcome, one));
    masters.into_iter().chain(rule(outcome)).collect()
}

/// The end that plays the device `name`.
fn player(outcome: &Outcome, name: &str) -> String {
    let kind = outcome.case.device.get(name).map(|spec| spec.kind());
    match kind {
        Some("firmware") => format!("the firmware that plays {name}"),
        Some("program") => format!("the program that plays {name}"),
        _ => format!("the device {name}"),
    }
}

/// Requests of a master that had no reply in time.
fn unanswered(outcome: &Outcome, broken: &OwnBreaks) -> Option<Cause> {
    let master = &broken.device;
    let polled = outcome.case.device.get(master)?.polled();
    let (late, weight) = match polled {
        Some(device) => (player(outcome, device), weight::LATE_DEVICE),
        // A program that has ended is late for that reason.
        None => ("the program".to_owned(), weight::LATE),
    };
    let (at, detail) = broken.first.as_ref()?;
    let count = broken.count;
    let text = format!(
        "{late} does not answer {master} in time: {count} times no-reply, first at {at} s \
         ({detail}); let it answer sooner, or raise the timeout of {master}"
    );
    Some(Cause::new(weight, text))
}

/// A failed rule of the scenario. One that waits for a frame names the end that should send it.
fn rule(outcome: &Outcome) -> Option<Cause> {
    let rules = outcome.case.expect.rule.iter().map(|rule| rule.get_ref());
    let failed = |rule: &RuleSpec| -> Option<&Check> {
        let name = rule.check_name();
        let mut checks = outcome.checks.iter();
        checks.find(|check| check.name == name && check.status == Status::Fail)
    };
    let mut failed = rules.filter_map(|rule| Some((rule, failed(rule)?)));
    let (rule, check) = failed.next()?;
    let (name, detail) = (&rule.name, &check.detail);
    let broken = format!("the rule {name} of the scenario is broken: {detail}");
    let waits = match (rule.demand(), &rule.after) {
        (Some((Demand::Eventually, Condition::Frame(frame))), Some(_)) => Some(frame),
        _ => None,
    };
    Some(match waits {
        None => Cause::new(weight::SCENARIO, broken),
        Some(frame) => {
            let is_struck = outcome
                .case
                .fault
                .iter()
                .any(|fault| fault.is_at(&frame.link));
            let (late, weight) = match frame.direction {
                _ if is_struck => return Some(Cause::new(weight::SCENARIO, broken)),
                DirectionSpec::ToMaster => (player(outcome, &frame.link), weight::LATE_DEVICE),
                DirectionSpec::ToDevice => ("the program".to_owned(), weight::LATE),
            };
            let text = format!(
                "{late} is late, or does not send what the rule {name} waits for on {}: {detail}",
                frame.link
            );
            Cause::new(weight, text)
        }
    })
}
