//! Robots that a scenario defines: a chassis, mounted devices of the catalogue, and slaves as data
//! whose values drive the chassis. The program is always a foreign one.
//!
//! Also devices without a robot, on their links only.

use core::time::Duration;
use std::collections::BTreeMap;

use emulators::world::{ActuatorKind, Chassis, Command};

use super::{
    Axis, Instruments, Need, Panel, PanelRow, Robot, ScanDecoder, Stops, WirePlan, Wired,
    add_devices, nowhere,
};
use crate::codec::Codec;
use crate::rig::Rig;
use crate::scenario::{
    ChassisSpec, DeviceSpec, NO_ROBOT, ProgramSpec, Scenario, ScenarioError, Source,
};

/// A robot defined by data.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CustomRobot;

impl Robot for CustomRobot {
    fn name(&self) -> &'static str {
        "custom"
    }

    fn about(&self) -> &'static str {
        "chassis, devices and slaves as the scenario describes them; driven by your own program"
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

    fn ignores(&self, scenario: &Scenario) -> &'static [&'static str] {
        match &scenario.chassis {
            Some(ChassisSpec::Ackermann(_)) => &["mission.connect", "world.body"],
            _ => &["mission.connect"],
        }
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        refuse_orders(&plan)?;
        refuse_expectations(&plan, true)?;
        wire(plan, true)
    }
}

/// No robot, only devices on links.
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

    fn ignores(&self, _scenario: &Scenario) -> &'static [&'static str] {
        &["mission.connect"]
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        refuse_orders(&plan)?;
        refuse_expectations(&plan, false)?;
        let (scenario, source) = (plan.scenario, plan.source);
        if scenario.device.is_empty() && scenario.cable.is_empty() {
            let message = "is missing, expected a device or a cable, as there is no robot";
            return Err(source.invalid(None, "device", message));
        }
        wire(plan, false)
    }
}

/// Rejects orders for waypoints or modes: the program has no station.
fn refuse_orders(plan: &WirePlan<'_>) -> Result<(), ScenarioError> {
    let steps = plan.scenario.mission.step.iter();
    let Some(index) = { steps }.position(|step| !step.action.is_of_the_rig()) else {
        return Ok(());
    };
    let message = "expected inject or set: the robot has no station that could order anything";
    let span = plan.source.find_in_list("mission.step", index, "do");
    let span = span.or_else(|| plan.source.find("step"));
    Err(plan.source.invalid(span, "mission.step", message))
}

/// Rejects impossible expectations and settings of the program: a foreign program does not report
/// pose, map and findings.
fn refuse_expectations(plan: &WirePlan<'_>, has_body: bool) -> Result<(), ScenarioError> {
    let (scenario, source) = (plan.scenario, plan.source);
    let expect = &scenario.expect;
    let golden = expect.golden.as_ref();
    let of_program = [
        ("pose_rms_mm_max", expect.pose_rms_mm_max.is_some()),
        ("heading_rms_deg_max", expect.heading_rms_deg_max.is_some()),
        ("wall_overlap_min", expect.wall_overlap_min.is_some()),
        ("explored_min", expect.explored_min.is_some()),
        ("victims_within_mm", expect.victims_within_mm.is_some()),
        ("home_within_mm", expect.home_within_mm.is_some()),
        ("map_received", expect.map_received.is_some()),
        ("golden.map", golden.is_some_and(|it| it.map.is_some())),
    ];
    let of_body = [
        ("visit_within_mm", expect.visit_within_mm.is_some()),
        ("return_within_mm", expect.return_within_mm.is_some()),
        ("settle", expect.settle.is_some()),
        ("golden.path", golden.is_some_and(|it| it.path.is_some())),
    ];
    let message = "expected none: the rig cannot see the map and pose of your own program";
    let given = |keys: &[(&'static str, bool)]| keys.iter().find(|key| key.1).map(|key| key.0);
    let refused = |key: &str, message: &str| {
        let span = source.find(key.split('.').next().unwrap_or(key));
        Err(source.invalid(span, format!("expect.{key}"), message))
    };
    if let Some(key) = given(&of_program) {
        return refused(key, message);
    }
    if scenario.program != ProgramSpec::default() {
        return Err(source.invalid(source.find("program"), "program", message));
    }
    if has_body {
        return Ok(());
    }
    let message = "expected none: the scenario has no robot (robot = \"none\")";
    if let Some(key) = given(&of_body) {
        return refused(key, message);
    }
    if !scenario.mission.waypoints_m.is_empty() {
        let span = source.find("waypoints_m");
        return Err(source.invalid(span, "mission.waypoints_m", message));
    }
    Ok(())
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
        limits: limits(&scenario.device),
    };
    let mut wired = Wired::new(Rig::new(world), Unwired);
    let codecs = add_devices(&mut wired, scenario, source, |_, _| true)?;
    wired.instruments = Box::new(CustomInstruments {
        codecs,
        ..instruments
    });
    Ok(wired)
}

/// The greatest set-point of each actuator with a limit.
fn limits(devices: &BTreeMap<String, DeviceSpec>) -> BTreeMap<String, f64> {
    let driven = devices.values().filter_map(DeviceSpec::drives);
    let actuators = driven.flat_map(|drives| drives.actuators);
    let limits = actuators.filter_map(|(name, limit)| Some((name, limit?)));
    limits.collect()
}

/// Time within which a device detects its watchdog timeout; too short to matter for the robot's
/// path.
const STOPS_WITHIN: Duration = Duration::from_millis(50);

/// A placeholder until the links are known.
struct Unwired;

impl Instruments for Unwired {}

struct CustomInstruments {
    has_body: bool,
    devices: BTreeMap<String, DeviceSpec>,
    codecs: BTreeMap<String, &'static Codec>,
    /// Greatest accepted set-points, by the name of the actuator.
    limits: BTreeMap<String, f64>,
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
                limit: self.limits.get(&actuator.name).copied(),
                actual: Some(chassis.actual(index)),
            }
        };
        axes.map(axis).collect()
    }

    fn stops(&self) -> Vec<Stops> {
        let drives = |(name, spec): (&String, &DeviceSpec)| {
            let drives = spec.drives()?;
            let axes = drives.actuators.into_iter().map(|(name, _)| name);
            Some(Stops {
                link: name.clone(),
                silence_max: drives.silence_max.map(|most| most + STOPS_WITHIN),
                axes: axes.collect(),
            })
        };
        match self.has_body {
            true => self.devices.iter().filter_map(drives).collect(),
            false => Vec::new(),
        }
    }

    fn has_body(&self) -> bool {
        self.has_body
    }

    /// The lidars, unless the scenario names other devices.
    fn needs(&self) -> Vec<Need> {
        let devices = self.devices.iter().filter(|_| self.has_body);
        let lidars = devices.filter(|(_, spec)| spec.scanner().is_some());
        lidars.map(|(name, _)| Need::always(name.clone())).collect()
    }

    fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        let mut devices = self.devices.iter();
        devices.find_map(|(name, spec)| Some((name.clone(), spec.scanner()?)))
    }

    fn panels(&self, rig: &Rig) -> Vec<Panel> {
        let panel = |(name, spec): (&String, &DeviceSpec)| {
            let rows = spec.rows(rig, name).into_iter();
            let rows = rows.map(|row| {
                let (value, unit) = row.value_and_unit();
                PanelRow {
                    name: row.name.into(),
                    address: row.address,
                    value,
                    unit: unit.into(),
                }
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
