//! The verdict on masters: each got a reply.

use ::description::master::Master;

use super::{Check, Status};
use crate::rig::Rig;
use crate::scenario::FaultSpec;

/// Name of the check.
pub const REQUESTS_ANSWERED: &str = "requests-answered";

/// Whether each master of `rig` got a reply to one of its requests at least; `None` without
/// masters. Without a reply nothing was observed; see [`must_answer`].
pub(crate) fn requests_answered(rig: &Rig) -> Option<Check> {
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
    let is_observed = masters.iter().all(|(_, [_, answered])| *answered > 0);
    Some(Check::new(REQUESTS_ANSWERED, true, detail).if_observed(is_observed))
}

/// Fails a run in which a program is there to answer the masters, and gave no reply. A fault may be
/// the reason, so runs with faults are not judged by this.
pub fn must_answer(checks: &mut [Check], faults: &[FaultSpec]) {
    let mut checks = checks.iter_mut();
    let check = checks.find(|check| check.name == REQUESTS_ANSWERED);
    let open = check.filter(|check| check.status == Status::NotObserved && faults.is_empty());
    if let Some(check) = open {
        check.status = Status::Fail;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Run;
    use crate::scenario::{FaultKind, Scenario};

    fn check(device: &str, of: &str) -> Check {
        let text = format!(
            "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"2s\"\n{device}\
             [device.plc.master]\ndescription = \"modbus-meter\"\nrequests = [\"read voltage\"]\n\
             period = \"100ms\"\n{of}"
        );
        let (scenario, source) = Scenario::from_text(&text).expect("sound");
        let outcome = Run::new(scenario, &source, None).expect("wired").finish();
        let mut checks = outcome.checks.into_iter();
        let check = checks.find(|check| check.name == REQUESTS_ANSWERED);
        check.expect("there is a master")
    }

    /// A device answers its master; a port at which no device is does not.
    #[test]
    fn a_master_without_a_reply_observes_nothing() {
        let meter = "[device]\nmeter = { description = \"modbus-meter\" }\n";
        let answered = check(meter, "of = \"meter\"\n");
        assert_eq!(answered.status, Status::Pass, "{answered}");
        let silent = check("", "");
        assert_eq!(silent.status, Status::NotObserved, "{silent}");
        assert!(silent.detail.starts_with("plc: none of "), "{silent}");
        assert!(!silent.detail.contains("none of 0"), "{silent}");
        let mut checks = [answered, silent];
        must_answer(&mut checks[1..], &[FaultSpec::new(FaultKind::Drop)]);
        assert_eq!(checks[1].status, Status::NotObserved);
        must_answer(&mut checks[1..], &[]);
        must_answer(&mut checks[..1], &[]);
        assert_eq!(
            checks.map(|check| check.status),
            [Status::Pass, Status::Fail]
        );
    }
}
