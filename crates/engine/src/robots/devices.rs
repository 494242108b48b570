//! Devices of a scenario on their links, each with an open end or with its master.

use std::collections::BTreeMap;

use protocols::Port;

use super::{Wired, links};
use crate::codec::Codec;
use crate::rig::line::End;
use crate::scenario::device::PortInfo;
use crate::scenario::{DeviceSpec, NO_ROBOT, Scenario, ScenarioError, Source};

/// Adds the missing devices of the scenario that `fits` accepts, each port on its own link with an
/// open end. Returns the protocols of these links.
pub(super) fn add_devices(
    wired: &mut Wired,
    scenario: &Scenario,
    source: &Source,
    fits: impl Fn(&str, &DeviceSpec) -> bool,
) -> Result<BTreeMap<String, &'static Codec>, ScenarioError> {
    let (mut codecs, mut wrong) = (BTreeMap::new(), Vec::new());
    for (name, spec) in scenario
        .device
        .iter()
        .filter(|(name, spec)| fits(name, spec))
    {
        match add_device(wired, scenario, source, (name, spec)) {
            Ok(found) => codecs.extend(found),
            Err(error) => wrong.push(error),
        }
    }
    ScenarioError::none_of(wrong)?;
    Ok(codecs)
}

/// Adds one device, and returns the protocols of its links.
fn add_device(
    wired: &mut Wired,
    scenario: &Scenario,
    source: &Source,
    (name, spec): (&String, &DeviceSpec),
) -> Result<Vec<(String, &'static Codec)>, ScenarioError> {
    let key = format!("device.{name}");
    let invalid = |message| Err(source.invalid(source.find(name), key.clone(), message));
    if wired.rig.link(name).is_some() {
        return invalid("the robot has a link of this name, expected another name");
    }
    let fits = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    if !name.chars().all(fits) {
        return invalid("expected a name of letters, digits, '-' and '_'");
    }
    if let Some(polled) = spec.polled() {
        // The polled device brings its master along.
        return links::check_polled(scenario, source, (name, polled)).map(|()| Vec::new());
    }
    let (node, ports) = add_node(wired, scenario, source, (name, spec))?;
    let mut codecs = Vec::new();
    for (index, info) in ports.into_iter().enumerate() {
        // The first port is the main port; the links of further ports have the port's name as
        // suffix.
        let link = match index {
            0 => name.clone(),
            _ => format!("{name}-{}", info.name),
        };
        let own = End {
            node,
            port: info.port,
        };
        let master = links::master_of(scenario, name).filter(|_| index == 0);
        let other = match master {
            Some(master) => {
                let (node, ports) = add_node(wired, scenario, source, master)?;
                let port = ports.first().map_or(Port(0), |info| info.port);
                End { node, port }
            }
            None => {
                let other = wired.open_end(&link, info.line, info.connect);
                wired.set_optional(other, info.is_optional);
                wired.set_rate(other, info.rate);
                other
            }
        };
        let [device, master] = match info.is_master {
            true => [other, own],
            false => [own, other],
        };
        let rig = &mut wired.rig;
        rig.connect_by(info.kind, &link, device, master, info.piece);
        codecs.extend(info.codec.map(|codec| (link, codec)));
    }
    Ok(codecs)
}

/// Checks that each actuator follows one value: of two, only the later one would have an effect.
///
/// # Errors
/// All values that drive an actuator which another value drives.
pub(super) fn check_drives(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let mut driven = Vec::new();
    for (name, spec) in &scenario.device {
        let drives = spec.drives().unwrap_or_default();
        for ((actuator, _), (key, span)) in drives.actuators.into_iter().zip(drives.places) {
            let key = format!("device.{name}.{}.{key}", spec.kind());
            driven.push((span.start, actuator, key, span));
        }
    }
    // In the order of the file, the second value of an actuator is the wrong one.
    driven.sort_by_key(|(start, ..)| *start);
    let mut wrong = Vec::new();
    for (index, (_, actuator, key, span)) in driven.iter().enumerate() {
        let mut before = driven[..index].iter();
        if let Some((.., first, _)) = before.find(|(_, other, ..)| other == actuator) {
            let message = format!(
                "is \"{actuator}\", which {first} drives already, expected another actuator: each \
                 follows one value"
            );
            wrong.push(source.invalid(Some(span.clone()), key.as_str(), message));
        }
    }
    ScenarioError::none_of(wrong)
}

/// Makes a device of the scenario and adds it to the rig.
fn add_node(
    wired: &mut Wired,
    scenario: &Scenario,
    source: &Source,
    (name, spec): (&String, &DeviceSpec),
) -> Result<(usize, Vec<PortInfo>), ScenarioError> {
    let built = spec.build(name, scenario.seed, source)?;
    let parts = (built.device.as_ref(), &wired.rig.world);
    spec.check_with(name, source, parts, scenario.robot != NO_ROBOT)?;
    let node = wired.rig.add_boxed_device(name, built.device);
    Ok((node, built.ports))
}
