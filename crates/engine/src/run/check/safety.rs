//! Checkers of `[expect.safety]`: they apply during the whole run, whatever fails.

mod alive;
mod orders;
mod rests;
mod says;
mod told;

pub use alive::AliveAtTheEnd;
pub use orders::MovesOnSoundOrders;
pub use rests::RestsAfterSilence;
pub use says::NoticesSilence;
pub use told::TelemetryTrue;

use std::sync::Arc;

use protocols::Instant;

use super::{Check, Checker, Status};
use crate::rig::{Logged, Rig};
use crate::robots::{Instruments, Need};
use crate::scenario::{SafetySpec, Scenario};

/// The checkers that `scenario` requests. Some observe `rig`.
pub(crate) fn asked_for(
    scenario: &Scenario,
    rig: &mut Rig,
    shared: &Arc<dyn Instruments>,
) -> Vec<Box<dyn Checker>> {
    let Some(spec) = &scenario.expect.safety else {
        return Vec::new();
    };
    let instruments = &**shared;
    let mut checkers: Vec<Box<dyn Checker>> = Vec::new();
    if let Some(within) = spec.rests_within {
        let drive = instruments.drive_links();
        let needs = needs(spec, instruments);
        checkers.push(Box::new(RestsAfterSilence::new(needs, drive, within.0)));
    }
    if spec.sound_orders {
        let link = spec.orders_link.as_deref().or(instruments.orders_link());
        checkers.push(Box::new(MovesOnSoundOrders::listening(
            rig,
            instruments,
            link,
        )));
    }
    if let Some(within) = spec.says_within {
        checkers.push(Box::new(NoticesSilence::listening(
            rig,
            instruments,
            within.0,
        )));
    }
    if let Some(last) = spec.alive_for {
        let from = scenario.duration.0.saturating_sub(last.0);
        let mut exempt: Vec<String> = spec.alive_without.clone();
        let asks_for_pose = exempt.is_empty();
        let own = instruments.station_links().iter();
        exempt.extend(
            own.chain(instruments.sporadic_links())
                .map(|&link| link.into()),
        );
        let from = Instant::ZERO + from;
        checkers.push(Box::new(AliveAtTheEnd::new(from, exempt, asks_for_pose)));
    }
    if spec.true_telemetry {
        checkers.push(Box::new(TelemetryTrue::new(Arc::clone(shared))));
    }
    checkers
}

/// The links that the robot needs: those of the scenario, or the robot's own.
fn needs(spec: &SafetySpec, instruments: &dyn Instruments) -> Vec<Need> {
    let own = instruments.needs();
    if spec.rests_without.is_empty() {
        return own;
    }
    let given = spec.rests_without.iter().map(|link| {
        let known = own.iter().find(|need| need.link == *link);
        known.cloned().unwrap_or_else(|| Need::always(link.clone()))
    });
    given.collect()
}

impl SafetySpec {
    /// Changes a failure that the scenario excuses to "not observed".
    pub(crate) fn excuse(&self, check: &mut Check) {
        let reason = match check.name.as_str() {
            "no-collision-at-speed" if self.by_hand => "a person steers",
            name if self.steps_may_wait && name.starts_with("mission-step-") => "it may wait",
            _ => return,
        };
        if check.status == Status::Fail {
            check.status = Status::NotObserved;
            check.detail = format!("{}; {reason}", check.detail);
        }
    }
}

/// Rules of devices and ports whose violation means that a queue was full.
const OVERRUNS: [&str; 4] = ["fifo-overflow", "host-overflow", "overrun", "port-overrun"];

/// The check of `overruns_max`.
pub(crate) fn overruns(most: u64, rig: &Rig, events: &[Logged]) -> Check {
    let counted: Vec<(String, u64)> = rig
        .broken_rules()
        .filter(|(_, rule, _)| OVERRUNS.contains(rule))
        .map(|(device, rule, count)| (format!("{device} {rule}"), count))
        .collect();
    // Devices without counts report violations only in the log.
    let is_counted = |logged: &Logged| {
        let name = format!("{} {}", logged.source, logged.event.rule);
        counted.iter().any(|(known, _)| *known == name)
    };
    let others = events
        .iter()
        .filter(|logged| OVERRUNS.contains(&logged.event.rule));
    let others: Vec<&Logged> = others.filter(|logged| !is_counted(logged)).collect();
    let found = counted.iter().map(|(_, count)| count).sum::<u64>() + others.len() as u64;
    let first = counted.first().map(|(name, _)| name.clone());
    let first = first.or_else(|| others.first().map(ToString::to_string));
    let first = first.map(|first| format!("; first: {first}"));
    let detail = format!(
        "{found} queues overflowed, at most {most}{}",
        first.unwrap_or_default()
    );
    Check::new("queue-overruns", found <= most, detail)
}

#[cfg(test)]
mod tests;
