//! Robots that a scenario describes itself: a chassis, devices of the catalogue with their places
//! on it, slaves as data whose values drive the chassis. The program is always somebody else's.
//!
//! And devices without a robot, on their wires alone.

use std::collections::BTreeMap;

use emulators::world::{ActuatorKind, Chassis, Command};

use super::{
    Axis, Instruments, Panel, PanelRow, Robot, ScanDecoder, WirePlan, Wired, add_devices, nowhere,
};
use crate::codec::Codec;
use crate::rig::Rig;
use crate::scenario::{DeviceSpec, NO_ROBOT, Scenario, ScenarioError, Source};

/// A robot as data.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CustomRobot;

impl Robot for CustomRobot {
    fn name(&self) -> &'static str {
        "custom"
    }

    fn about(&self) -> &'static str {
        "chassis, devices and slaves as the scenario describes them; driven by a program of one's own"
    }

    fn chassis(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Box<dyn Chassis>>, ScenarioError> {
        let Some(spec) = &scenario.chassis else {
            return Ok(None);
        };
        let body = scenario.world.body.into();
        spec.build(body, scenario.seed, source).map(Some)
    }

    fn takes_orders(&self) -> bool {
        false
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        refuse_orders(&plan)?;
        wire(plan, true)
    }
}

/// No robot: devices on wires.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bare;

impl Robot for Bare {
    fn name(&self) -> &'static str {
        NO_ROBOT
    }

    fn about(&self) -> &'static str {
        "devices on their wires, without robot and world"
    }

    fn takes_orders(&self) -> bool {
        false
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        refuse_orders(&plan)?;
        let (scenario, source) = (plan.scenario, plan.source);
        if scenario.device.is_empty() {
            let message = "is missing, expected a device, as there is no robot";
            return Err(source.invalid(None, "device", message));
        }
        wire(plan, false)
    }
}

/// Nobody takes orders for waypoints or modes: the program has no station.
fn refuse_orders(plan: &WirePlan<'_>) -> Result<(), ScenarioError> {
    if plan.scenario.mission.step.is_empty() {
        return Ok(());
    }
    let message = "expected none: the robot has no station that could order anything";
    let span = plan.source.find("step");
    Err(plan.source.invalid(span, "mission.step", message))
}

fn wire(plan: WirePlan<'_>, has_body: bool) -> Result<Wired, ScenarioError> {
    let WirePlan {
        scenario,
        source,
        world,
        ..
    } = plan;
    let world = if has_body { world } else { nowhere() };
    let instruments = CustomInstruments {
        has_body,
        devices: scenario.device.clone(),
        codecs: BTreeMap::new(),
    };
    let mut wired = Wired::new(Rig::new(world), Unwired);
    let codecs = add_devices(&mut wired, scenario, source, |_, _| true)?;
    wired.instruments = Box::new(CustomInstruments {
        codecs,
        ..instruments
    });
    Ok(wired)
}

/// Stands in until the links are known.
struct Unwired;

impl Instruments for Unwired {}

struct CustomInstruments {
    has_body: bool,
    devices: BTreeMap<String, DeviceSpec>,
    codecs: BTreeMap<String, &'static Codec>,
}

impl Instruments for CustomInstruments {
    fn axes(&self, rig: &Rig) -> Vec<Axis> {
        if !self.has_body {
            return Vec::new();
        }
        let chassis = rig.world.chassis();
        let axes = chassis.actuators().iter().enumerate();
        let axis = |(index, actuator): (usize, &emulators::world::Actuator)| {
            let (set_point, unit) = match chassis.command(index) {
                Command::Power(power) => (power.into(), "of 255"),
                Command::Speed(m_s) => (m_s, "m/s"),
                Command::Angle(rad) => (rad, "rad"),
                _ => (0.0, unit_of(actuator.kind)),
            };
            Axis {
                name: actuator.name.clone().into(),
                unit,
                set_point,
                limit: None,
                actual: Some(chassis.actual(index)),
            }
        };
        axes.map(axis).collect()
    }

    fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        let mut devices = self.devices.iter();
        devices.find_map(|(name, spec)| Some((name.clone(), spec.scanner()?)))
    }

    fn panels(&self, rig: &Rig) -> Vec<Panel> {
        let panel = |(name, spec): (&String, &DeviceSpec)| {
            let rows = spec.rows(rig, name).into_iter();
            let rows = rows.map(|row| PanelRow {
                name: row.name.into(),
                address: row.address,
                value: row.value.to_string(),
                unit: "".into(),
            });
            Panel {
                name: name.clone(),
                rows: rows.collect(),
            }
        };
        let panels = self.devices.iter().map(panel);
        panels.filter(|panel| !panel.rows.is_empty()).collect()
    }

    fn codec(&self, _: &Rig, link: &str) -> Option<&'static Codec> {
        self.codecs.get(link).copied()
    }
}

const fn unit_of(kind: ActuatorKind) -> &'static str {
    match kind {
        ActuatorKind::Steering => "rad",
        _ => "m/s",
    }
}
