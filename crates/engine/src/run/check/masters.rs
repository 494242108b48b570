//! The verdict on masters: each got a reply.

use ::description::master::Master;

use super::Check;
use crate::rig::Rig;

/// Name of the check.
pub const REQUESTS_ANSWERED: &str = "requests-answered";

/// Whether each master of `rig` got a reply to one of its requests at least; `None` without
/// masters. A silent device is no failure, as a fault may be the reason, but nothing was observed
/// of it.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Run;
    use crate::run::check::Status;
    use crate::scenario::Scenario;

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
    }
}
