//! The verdict on masters: each got a reply.

use ::description::master::Master;

use super::{Check, Status};
use crate::rig::Rig;
use crate::scenario::{FaultSpec, Scenario};

/// Name of the check.
pub const REQUESTS_ANSWERED: &str = "requests-answered";

/// Whether each master of `rig` got a reply to at least one of its requests; `None` without
/// masters. A device of `scenario` without a fault has to answer. Any other master without a reply
/// has observed nothing, unless a program should have answered; see [`must_answer`].
pub(crate) fn requests_answered(rig: &Rig, scenario: &Scenario) -> Option<Check> {
    let names = rig.device_names();
    let masters = names.filter_map(|name| Some((name, rig.device::<Master>(name)?.judged())));
    let masters: Vec<_> = masters.collect();
    if masters.is_empty() {
        return None;
    }
    let told = |(name, [asked, answered]): &(&str, [u64; 2])| match answered {
        0 => format!("{name}: none of {asked} requests was answered"),
        _ => format!("{name}: {answered} of {asked} requests were answered"),
    };
    let detail = masters.iter().map(told).collect::<Vec<_>>().join(", ");
    let is_silent = |(name, [asked, answered]): &&(&str, [u64; 2])| {
        let polled = scenario.device.get(*name).and_then(|spec| spec.polled());
        let has_fault = |place: &str| scenario.fault.iter().any(|fault| fault.is_at(place));
        let must = polled.is_some_and(|device| !has_fault(device) && !has_fault(name));
        *asked > 0 && *answered == 0 && must
    };
    let fails = masters.iter().any(|one| is_silent(&one));
    let is_observed = masters.iter().all(|(_, [_, answered])| *answered > 0);
    Some(Check::new(REQUESTS_ANSWERED, !fails, detail).if_observed(is_observed))
}

/// The masters of `rig` that asked at ports of their own and got no reply. A program under test has
/// to answer there; a master with `of` polls a device of `scenario`.
pub(crate) fn unanswered(rig: &Rig, scenario: &Scenario) -> Vec<String> {
    let own = scenario.device.iter();
    let own = own.filter(|(_, spec)| spec.is_master() && spec.polled().is_none());
    let is_open = |name: &&String| {
        let master = rig.device::<Master>(name).map(Master::judged);
        master.is_some_and(|[asked, answered]| asked > 0 && answered == 0)
    };
    own.map(|(name, _)| name).filter(is_open).cloned().collect()
}

/// Fails a run in which a program left the requests of one of `masters` without any reply, and no
/// fault is at the master's port.
pub fn must_answer<'a>(
    checks: &mut [Check],
    mut masters: impl Iterator<Item = &'a String>,
    faults: &[FaultSpec],
) {
    let fails = masters.any(|name| !faults.iter().any(|fault| fault.is_at(name)));
    let mut checks = checks.iter_mut();
    let check = checks.find(|check| check.name == REQUESTS_ANSWERED);
    if let Some(check) = check.filter(|_| fails) {
        check.status = Status::Fail;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Outcome, Run};
    use crate::scenario::{DirectionSpec, FaultKind, Source};

    fn scenario(device: &str, of: &str) -> (Scenario, Source) {
        let text = format!(
            "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"2s\"\n{device}\
             [device.plc.master]\ndescription = \"modbus-meter\"\nrequests = [\"read voltage\"]\n\
             period = \"100ms\"\n{of}"
        );
        Scenario::from_text(&text).expect("sound")
    }

    fn outcome(device: &str, of: &str) -> Outcome {
        let (scenario, source) = scenario(device, of);
        Run::new(scenario, &source, None).expect("wired").finish()
    }

    fn check(outcome: Outcome) -> Check {
        let mut checks = outcome.checks.into_iter();
        let check = checks.find(|check| check.name == REQUESTS_ANSWERED);
        check.expect("there is a master")
    }

    /// A device answers its master; a port without a device does not.
    #[test]
    fn a_master_without_a_reply_observes_nothing() {
        let meter = "[device]\nmeter = { description = \"modbus-meter\" }\n";
        let answered = outcome(meter, "of = \"meter\"\n");
        assert!(answered.unanswered.is_empty());
        let answered = check(answered);
        assert_eq!(answered.status, Status::Pass, "{answered}");
        let silent = outcome("", "");
        let plc = silent.unanswered.clone();
        assert_eq!(plc, ["plc"]);
        let silent = check(silent);
        assert_eq!(silent.status, Status::NotObserved, "{silent}");
        assert!(silent.detail.starts_with("plc: none of "), "{silent}");
        assert!(!silent.detail.contains("none of 0"), "{silent}");
        let mut checks = [answered, silent];
        let at = |link| FaultSpec::on(link, DirectionSpec::ToMaster, FaultKind::Drop);
        must_answer(&mut checks, plc.iter(), &[at("plc")]);
        must_answer(&mut checks, [].iter(), &[]);
        assert_eq!(checks[1].status, Status::NotObserved);
        must_answer(&mut checks[..1], [].iter(), &[]);
        must_answer(&mut checks[1..], plc.iter(), &[at("other")]);
        assert_eq!(
            checks.map(|check| check.status),
            [Status::Pass, Status::Fail]
        );
    }

    /// The slave of the scenario speaks another protocol, so that it never answers.
    #[test]
    fn a_device_that_never_answers_its_master_fails() {
        let mute = "[device.meter.text]\nbaud = 9600\ncommand = []\n";
        let silent = outcome(mute, "of = \"meter\"\n");
        // A program under test has no part in it.
        assert!(silent.unanswered.is_empty());
        let silent = check(silent);
        assert_eq!(silent.status, Status::Fail, "{silent}");
        let cut = "[[fault]]\nkind = \"cut\"\nlink = \"meter\"\ndirection = \"to-master\"\n";
        let excused = check(outcome(mute, &format!("of = \"meter\"\n{cut}")));
        assert_eq!(excused.status, Status::NotObserved, "{excused}");
    }

    /// A device that is off to the end has observed nothing of its master.
    #[test]
    fn a_device_that_is_off_to_the_end_is_not_passed() {
        let meter = "[device]\nmeter = { description = \"modbus-meter\" }\n";
        let off = "of = \"meter\"\n[[fault]]\nkind = \"off\"\ndevice = \"meter\"\n";
        let later = format!("{off}from = \"1s\"\n");
        let [off, later] = [off, &later].map(|text| outcome(meter, text));
        assert_eq!((off.passed(), off.is_judged()), (false, false));
        assert!(later.passed());
        assert_eq!(check(off).status, Status::NotObserved);
    }
}
