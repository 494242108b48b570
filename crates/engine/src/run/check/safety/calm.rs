//! The times in which no fault of a scenario acts on some links.

use core::time::Duration;

use protocols::Instant;

use super::touches;
use crate::rig::Rig;
use crate::scenario::{FaultKind, FaultSpec, Scenario};

/// Time from the end of a fault until its effects are over: queues are empty, devices work again.
const EFFECTS: Duration = Duration::from_secs(5);

/// The times in which no fault acts on some links.
#[derive(Clone, Debug, Default)]
pub struct Calm {
    /// Begin and end of each fault with its effects.
    faults: Vec<(Instant, Option<Instant>)>,
}

impl Calm {
    /// The faults of `scenario` on links of `rig` that `is_meant`, and on their devices.
    pub(super) fn of(scenario: &Scenario, rig: &Rig, is_meant: &dyn Fn(&str) -> bool) -> Self {
        let faults = scenario.fault.iter();
        let faults = faults.filter(|fault| touches(fault, rig, is_meant));
        Self {
            faults: faults.map(times).collect(),
        }
    }

    /// The same for faults that delay bytes only: they damage no frame, but a program may give up a
    /// late one.
    pub(super) fn of_delays(scenario: &Scenario, rig: &Rig, link: &str) -> Self {
        let faults = scenario.fault.iter();
        let faults = faults.filter(|fault| delays(fault.kind));
        let faults = faults.filter(|fault| touches(fault, rig, &|other| other == link));
        Self {
            faults: faults.map(times).collect(),
        }
    }

    /// Whether no fault acts at `now`.
    pub(super) fn is(&self, now: Instant) -> bool {
        let acts = |(from, until): &(Instant, Option<Instant>)| {
            now >= *from && until.is_none_or(|until| now < until)
        };
        !self.faults.iter().any(acts)
    }
}

/// Whether a fault of `kind` delays bytes.
const fn delays(kind: FaultKind) -> bool {
    use FaultKind as K;
    matches!(
        kind,
        K::Stall
            | K::Clog
            | K::Overrun
            | K::ShortRead
            | K::Latency
            | K::Jitter
            | K::Idle
            | K::Delayed
            | K::Intermittent
    )
}

/// Begin and end of the effects of `fault`.
fn times(fault: &FaultSpec) -> (Instant, Option<Instant>) {
    let from = fault.from.unwrap_or_default().instant();
    (from, fault.until.map(|until| until.instant() + EFFECTS))
}
