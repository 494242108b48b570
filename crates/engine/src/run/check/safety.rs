//! Checkers of `[expect.safety]`: they apply during the whole run, whatever fails.

mod alive;
mod asks;
mod calm;
mod complaints;
mod counts;
mod cycles;
mod eyes;
mod fed;
mod lines;
mod motion;
mod ordered;
mod orders;
mod paused;
mod pose;
mod rests;
mod says;
mod sends;
mod sends_on;
mod told;
mod turns;

pub use alive::AliveAtTheEnd;
pub use asks::AsksAgain;
pub use calm::Calm;
pub(super) use calm::EFFECTS;
use calm::Undisturbed;
pub use complaints::ComplaintsTrue;
pub use counts::CountsTrue;
pub use cycles::SendsInTime;
pub use fed::DriveFed;
pub use lines::LinesTrue;
pub use motion::MotionTrue;
pub use ordered::DoesAsOrdered;
pub use orders::MovesOnSoundOrders;
pub use pose::PoseBelieved;
pub use rests::RestsAfterSilence;
pub use says::NoticesSilence;
pub use sends::SendsSoundFrames;
pub use sends_on::SendsOn;
pub use told::TelemetryTrue;
pub use turns::TurnsShort;

use std::sync::Arc;

use protocols::Instant;

use super::{Check, Checker, Status};
use crate::rig::{Logged, Rig};
use crate::robots::{Instruments, Need};
use crate::scenario::{FaultSpec, SafetySpec, Scenario};

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
        let calm = Calm::of(scenario, rig, &|link| drive.iter().any(|own| own == link));
        let rests = RestsAfterSilence::new(needs, drive, calm, within.0);
        checkers.push(Box::new(rests.with_eyes(rig, shared)));
    }
    if spec.sound_orders {
        let link = spec.orders_link.as_deref().or(instruments.orders_link());
        let calm = Calm::of(scenario, rig, &|other| Some(other) != link);
        let orders = MovesOnSoundOrders::listening(rig, instruments, link, calm);
        let starts_alone = scenario.program.start_mode.is_some();
        checkers.push(Box::new(orders.starting_alone(starts_alone)));
    }
    if let Some(within) = spec.says_within {
        let says = NoticesSilence::listening(scenario, rig, shared, within.0);
        checkers.push(Box::new(says));
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
        checkers.push(Box::new(AliveAtTheEnd::new(
            from,
            last.0,
            exempt,
            asks_for_pose,
        )));
    }
    if spec.true_telemetry {
        let station = instruments.station_links();
        let drive = instruments.drive_links();
        let is_meant = |link: &str| station.contains(&link) || drive.iter().any(|own| own == link);
        let calm = Calm::of(scenario, rig, &is_meant);
        checkers.push(Box::new(LinesTrue::new(Arc::clone(shared), calm.clone())));
        checkers.push(Box::new(TelemetryTrue::new(Arc::clone(shared), calm)));
    }
    checkers.extend(of_the_program(spec, scenario, rig, shared));
    checkers.extend(of_its_work(spec, scenario, rig, shared));
    checkers
}

/// The checkers of the program's steady work: its cycles, requests, failures and dead reckoning.
fn of_its_work(
    spec: &SafetySpec,
    scenario: &Scenario,
    rig: &mut Rig,
    shared: &Arc<dyn Instruments>,
) -> Vec<Box<dyn Checker>> {
    let instruments = &**shared;
    let mut checkers: Vec<Box<dyn Checker>> = Vec::new();
    if spec.sends_cyclically {
        checkers.push(Box::new(SendsInTime::listening(scenario, rig, instruments)));
    }
    if spec.asks_again {
        checkers.push(Box::new(AsksAgain::listening(rig, instruments)));
    }
    if spec.true_complaints {
        checkers.push(Box::new(ComplaintsTrue::new(scenario, rig, instruments)));
    }
    if let Some(percent) = spec.motion_within_percent {
        let station = instruments.station_links();
        let calm = Calm::of(scenario, rig, &|link| !station.contains(&link));
        let motion = MotionTrue::new(scenario, Arc::clone(shared), percent, calm);
        checkers.push(Box::new(motion));
    }
    checkers
}

/// The checkers of the program's counters, frames, believed pose and obeyed orders.
fn of_the_program(
    spec: &SafetySpec,
    scenario: &Scenario,
    rig: &mut Rig,
    shared: &Arc<dyn Instruments>,
) -> Vec<Box<dyn Checker>> {
    let instruments = &**shared;
    let mut checkers: Vec<Box<dyn Checker>> = Vec::new();
    if spec.true_counts {
        checkers.push(Box::new(CountsTrue::listening(scenario, rig, instruments)));
    }
    if spec.sound_frames {
        checkers.push(Box::new(SendsSoundFrames::listening(rig, instruments)));
    }
    if let Some(within) = spec.sends_within {
        checkers.push(Box::new(SendsOn::new(scenario, rig, instruments, within.0)));
    }
    if let Some(within) = spec.commands_within {
        let links = instruments.drive_links();
        let is_meant = |other: &str| links.iter().any(|own| own == other);
        let calm = Calm::of(scenario, rig, &is_meant);
        checkers.push(Box::new(DriveFed::new(rig, links, within.0, calm)));
    }
    if let Some(within_mm) = spec.pose_within_mm {
        let quiet = Undisturbed::of(scenario, rig, instruments);
        let pose = PoseBelieved::new(Arc::clone(shared), within_mm, quiet);
        checkers.push(Box::new(pose.by_hand(spec.by_hand)));
    }
    if let Some(within) = spec.obeys_within {
        let link = spec.orders_link.as_deref().or(instruments.orders_link());
        let (drive, station) = (instruments.drive_links(), instruments.station_links());
        let is_meant = |other: &str| {
            let is_order = Some(other) == link || station.contains(&other);
            is_order || drive.iter().any(|own| own == other)
        };
        let calm = Calm::of(scenario, rig, &is_meant);
        let ordered = DoesAsOrdered::of(scenario, link, within.0, calm);
        checkers.push(Box::new(ordered));
    }
    if spec.short_turns {
        let quiet = Undisturbed::of(scenario, rig, instruments);
        checkers.push(Box::new(TurnsShort::new(Arc::clone(shared), quiet)));
    }
    checkers
}

/// Whether `fault` acts on a link that `is_meant` selects, or on a device of such a link.
fn touches(fault: &FaultSpec, rig: &Rig, is_meant: &dyn Fn(&str) -> bool) -> bool {
    let links = [&fault.link, &fault.with].into_iter().flatten();
    let devices = fault.device.iter().chain(fault.devices.iter().flatten());
    let mut of_devices = devices.flat_map(|device| links_of(rig, device));
    let mut links = links.map(String::as_str);
    links.any(is_meant) || of_devices.any(|link| is_meant(&link))
}

/// The links of the device `name`.
fn links_of(rig: &Rig, name: &str) -> Vec<String> {
    let links = rig.links().iter();
    let links = links.filter(|link| {
        let mut lines = link.lines.iter();
        lines.any(|line| rig.node_name(line.from.node) == name)
    });
    links.map(|link| link.name.clone()).collect()
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
            super::COLLISION if self.by_hand => "a person steers",
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
#[path = "safety/tests/puppet.rs"]
pub(in crate::run) mod puppet;
#[cfg(test)]
pub(in crate::run) mod tests;
