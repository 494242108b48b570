//! Latencies and faults of links, and cables between programs.

use protocols::Port;

use super::{OpenEnd, Wired};
use crate::near;
use crate::rig::fault::FaultId;
use crate::rig::line::End;
use crate::rig::{LinkKind, PortRate, Rig};
use crate::scenario::{CableSpec, DeviceSpec, Flaw, Scenario, ScenarioError, Source};

/// Adds the cables of the scenario: each end is a port for a program.
///
/// # Errors
/// If two ports or links have one name.
pub(super) fn add_cables(
    wired: &mut Wired,
    scenario: &Scenario,
    source: &Source,
) -> Result<(), ScenarioError> {
    for (name, spec) in &scenario.cable {
        let invalid = |key: &str, message: String| {
            let span = source.find(name);
            Err(source.invalid(span, format!("cable.{name}{key}"), message))
        };
        if let Err(flaw) = spec.check() {
            return invalid(&format!(".{}", flaw.key), flaw.message);
        }
        if wired.rig.link(name).is_some() {
            return invalid(
                "",
                "a link with this name exists, expected another name".to_owned(),
            );
        }
        for (key, port) in [(".master", &spec.master), (".device", &spec.device)] {
            let ports = wired.open_ends.iter().map(|end| &*end.name);
            let mut taken: Vec<&str> = ports.collect();
            if key == ".device" {
                taken.push(&spec.master);
            }
            if taken.contains(&port.as_str()) {
                let message = format!("is {port:?} once more, expected another name of a port");
                return invalid(key, message);
            }
        }
        let [device, master] =
            [&spec.device, &spec.master].map(|port| end(wired, name, port, spec));
        let rig = &mut wired.rig;
        rig.connect_by(LinkKind::Uart, name, device, master, 1);
    }
    Ok(())
}

/// Adds the end `port` of the cable `link`.
fn end(wired: &mut Wired, link: &str, port: &str, spec: &CableSpec) -> End {
    let line = spec.line();
    let node = wired.rig.add_outside(port, line);
    wired.open_ends.push(OpenEnd {
        name: port.to_owned(),
        link: link.to_owned(),
        node,
        line,
        rate: PortRate::OfLine,
        connect: "a program of the scenario",
        is_optional: false,
        robot: 0,
    });
    End {
        node,
        port: Port(0),
    }
}

/// The master that polls the device `name`.
pub(super) fn master_of<'a>(
    scenario: &'a Scenario,
    name: &str,
) -> Option<(&'a String, &'a DeviceSpec)> {
    let mut devices = scenario.device.iter();
    devices.find(|(_, spec)| spec.polled() == Some(name))
}

/// Checks that the master `name` can poll the device `polled`.
///
/// # Errors
/// If the device does not exist, is a master itself, or has another master.
pub(super) fn check_polled(
    scenario: &Scenario,
    source: &Source,
    (name, polled): (&str, &str),
) -> Result<(), ScenarioError> {
    let is_free = |(other, spec): &(&String, &DeviceSpec)| {
        *other != name && spec.is_own() && !spec.is_master()
    };
    let free = scenario.device.iter().filter(is_free);
    let known: Vec<&str> = free.map(|(name, _)| name.as_str()).collect();
    let message = if !known.contains(&polled) {
        near::expected(polled, &known)
    } else if let Some((first, _)) = master_of(scenario, polled).filter(|(first, _)| *first != name)
    {
        format!("is \"{polled}\", which \"{first}\" polls already, expected another device")
    } else {
        return Ok(());
    };
    let key = format!("device.{name}.master.of");
    Err(source.invalid(source.find(name), key, message))
}

/// Plans the scenario's latencies and faults on the links of a wired rig.
///
/// # Errors
/// Unknown links, and faults that do not fit their links.
pub(super) fn plan(
    rig: &mut Rig,
    scenario: &Scenario,
    source: &Source,
) -> Result<(), ScenarioError> {
    let mut wrong = Vec::new();
    for (name, spec) in &scenario.link {
        let Some(link) = rig.link_mut(name) else {
            let known: Vec<&str> = rig.links().iter().map(|link| &*link.name).collect();
            let message = near::expected(name, &known);
            wrong.push(source.invalid(source.find(name), format!("link.{name}"), message));
            continue;
        };
        let lines = link.lines.iter_mut();
        lines.for_each(|line| line.latency = spec.latency.0);
    }
    rig.budget = scenario.budget.unwrap_or_default().into();
    for (index, fault) in scenario.fault.iter().enumerate() {
        let planned = rig.plan_fault(fault, FaultId(index), scenario.seed);
        if let Err(flaw) = planned {
            wrong.push(fault_error(source, index, flaw));
        }
    }
    ScenarioError::none_of(wrong)
}

/// Checks the keys of the scenario's faults, without their links and devices.
///
/// # Errors
/// All faults with a wrong or missing key.
pub(super) fn check_faults(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let mut wrong = Vec::new();
    for (index, fault) in scenario.fault.iter().enumerate() {
        let checked = fault.check();
        let checked = checked.and_then(|()| fault.strike().map(drop));
        let checked = checked.and_then(|()| fault.effect(FaultId(index), scenario.seed).map(drop));
        if let Err(flaw) = checked {
            wrong.push(fault_error(source, index, flaw));
        }
    }
    ScenarioError::none_of(wrong)
}

/// The error of the fault `index`.
fn fault_error(source: &Source, index: usize, flaw: Flaw) -> ScenarioError {
    let span = source.find_in_list("fault", index, flaw.key);
    source.invalid(span, format!("fault[{index}].{}", flaw.key), flaw.message)
}
