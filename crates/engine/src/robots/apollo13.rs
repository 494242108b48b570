//! Apollo 13, a model car of 2016: Ackermann steering, two serial boards, a depth camera, a phone.
//!
//! | link | device end | master end |
//! |---|---|---|
//! | `car` | board of the car | program, 115200 baud |
//! | `odometer` | microcontroller with encoder and gyroscope | program, 115200 baud |
//! | `scan` | camera, rows of depths | program, messages |
//! | `markers` | camera, markers | program, messages |
//! | `remote` | phone | program, packets of Open Sound Control |
//!
//! The program gets a floor plan: the mapped objects of the world that are higher than the camera.

mod defects;
mod floor;
mod instruments;
mod overlays;
mod phone;
mod script;

use emulators::car_board;
use emulators::world::Chassis;
use firmware_core::Master as _;
use firmware_core::ackermann::CarPose;
use firmware_core::robots::apollo13::wall::Side;
use firmware_core::robots::apollo13::{Apollo13, Config};

use super::ignored::{OF_RESCUE, OF_YELLOW};
use super::{Alone, Dut, PcEnd, ProgramPort, Robot, WirePlan, Wired};
use crate::near;
use crate::rig::line::End;
use crate::rig::{LinkKind, Rig};
use crate::scenario::device::{
    Built, CAMERA, CAR_BOARD, CameraSpec, MountSpec, ODOMETER, OdometerSpec,
};
use crate::scenario::{AckermannSpec, ChassisSpec, DeviceSpec, Scenario, ScenarioError, Source};

use instruments::ApolloInstruments;
use phone::Phone;
use script::script;

/// Name of the phone, as a device and as an open end.
const PHONE: &str = "phone";
const REMOTE: &str = "remote";
const LINKS: [&str; 5] = ["car", "odometer", "scan", "markers", REMOTE];
/// Devices with their kinds.
const DEVICES: [(&str, &str); 3] = [
    ("car", "car-board"),
    ("odometer", "odometer"),
    ("camera", "camera"),
];

/// Position of the camera: 0.18 m plus half of the wheelbase ahead of the car's centre, and 0.34 m
/// above the floor (the car's own transforms).
const CAMERA_AHEAD_M: f64 = 0.18 + 0.129;
const CAMERA_HEIGHT_M: f64 = 0.34;
/// Distance from the followed wall (seed 003).
const WALL_M: f64 = 0.40;
/// The side of the followed wall when driving autonomously without a goal, by the name of the start
/// mode.
const WALLS: [(&str, Side); 2] = [("wall-left", Side::Left), ("wall-right", Side::Right)];

/// Situations that a campaign must cause: possible events on each link.
const SITUATIONS: [&str; 6] = [
    "board bad frames",
    "odometer bad lines",
    "messages without meaning",
    "remote bad packets",
    "obstacles too near",
    "gates passed",
];

/// The robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct ApolloRobot;

impl Robot for ApolloRobot {
    fn name(&self) -> &'static str {
        "apollo13"
    }

    fn about(&self) -> &'static str {
        "model car with ultrasound, odometer and depth camera; a phone drives it or orders goals"
    }

    fn chassis(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Box<dyn Chassis>>, ScenarioError> {
        let spec = match &scenario.chassis {
            Some(ChassisSpec::Ackermann(spec)) => &**spec,
            Some(ChassisSpec::Differential(_)) => {
                let message = "expected ackermann: this robot is a car";
                return Err(source.invalid(source.find("chassis"), "chassis", message));
            }
            None => &AckermannSpec::default(),
        };
        let chassis = spec.build(car_board::chassis(), scenario.seed, source)?;
        Ok(Some(chassis))
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        wire(plan)
    }

    fn program(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Alone>, ScenarioError> {
        alone(scenario, source).map(Some)
    }

    fn ignores(&self, _scenario: &Scenario) -> &'static [&'static str] {
        // Its chassis has figures of its own.
        const ALL: [&str; 8] = {
            let ([a, b, c, d, e], [f, g]) = (OF_RESCUE, OF_YELLOW);
            [a, b, c, d, e, f, g, "world.body"]
        };
        &ALL
    }

    fn situations(&self) -> &'static [&'static str] {
        &SITUATIONS
    }

    fn defects(&self) -> Vec<&'static str> {
        defects::ids().collect()
    }
}

fn wire(plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
    let WirePlan {
        scenario,
        source,
        world,
        dut,
        pc,
    } = plan;
    check_names(scenario, source)?;
    let config = config(scenario, source)?;
    let car = scenario.build_device("car", CAR_BOARD, source)?;
    if let Some(spec) = scenario.device.get("car") {
        spec.check("car", source, car.device.as_ref(), &world)?;
    }
    let odometer = scenario.build_device("odometer", ODOMETER, source)?;
    let (camera, eye) = camera(scenario, source)?;
    let follows_wall = scenario.program.start_mode.is_some();
    let mut wired = Wired::new(Rig::new(world), ApolloInstruments::new(eye, follows_wall));
    let program = match dut {
        Dut::Internal => {
            let program = Box::new(Apollo13::new(config));
            Some(wired.rig.add_program("program", program))
        }
        Dut::External => None,
    };
    let devices = [("car", car), ("odometer", odometer), ("camera", camera)];
    connect_devices(&mut wired, devices, program);
    connect_phone(&mut wired, pc, (scenario, source), program)?;
    Ok(wired)
}

/// Connects the devices to their links, with the program or an open end at the other end.
fn connect_devices(wired: &mut Wired, devices: [(&'static str, Built); 3], program: Option<usize>) {
    let ports = [Apollo13::CAR, Apollo13::ODOMETER, Apollo13::SCAN];
    let mut links = LINKS.into_iter();
    for ((name, built), first) in devices.into_iter().zip(ports) {
        let node = wired.rig.add_boxed_device(name, built.device);
        for (info, link) in built.ports.into_iter().zip(links.by_ref()) {
            let port = match link {
                "markers" => Apollo13::MARKERS,
                _ => first,
            };
            let device = End {
                node,
                port: info.port,
            };
            let master = match program {
                Some(node) => End { node, port },
                None => wired.open_end(link, info.line, info.connect),
            };
            wired.set_optional(master, info.is_optional);
            wired.set_rate(master, info.rate);
            let rig = &mut wired.rig;
            rig.connect_by(info.kind, link, device, master, info.piece);
        }
    }
}

/// Connects the phone: the mission's script, or a foreign program.
fn connect_phone(
    wired: &mut Wired,
    pc: PcEnd,
    (scenario, source): (&Scenario, &Source),
    program: Option<usize>,
) -> Result<(), ScenarioError> {
    // A car that follows a wall has no goal.
    let has_goals = scenario.program.start_mode.is_none();
    let phone = Phone::new(script(&scenario.mission, source)?, has_goals);
    let is_idle = !scenario.mission.gives_orders();
    let far = match pc {
        PcEnd::Scripted => End {
            node: wired.rig.add_device(PHONE, phone),
            port: Phone::NETWORK,
        },
        PcEnd::External => {
            let end = wired.open_end(PHONE, Phone::LINE, "your own remote control");
            if let Some(open) = wired.open_ends.last_mut() {
                REMOTE.clone_into(&mut open.link);
            }
            end
        }
    };
    wired.set_optional(far, is_idle);
    let near = match program {
        Some(node) => End {
            node,
            port: Apollo13::REMOTE,
        },
        None => wired.open_end(REMOTE, Phone::LINE, "the robot's port for its remote"),
    };
    wired.set_optional(near, is_idle);
    let rig = &mut wired.rig;
    rig.connect_by(LinkKind::Datagram, REMOTE, far, near, 1);
    Ok(())
}

/// The program alone.
fn alone(scenario: &Scenario, source: &Source) -> Result<Alone, ScenarioError> {
    check_names(scenario, source)?;
    let program = Apollo13::new(config(scenario, source)?);
    let ports = [
        Apollo13::CAR,
        Apollo13::ODOMETER,
        Apollo13::SCAN,
        Apollo13::MARKERS,
        Apollo13::REMOTE,
    ];
    let port = |(name, port)| ProgramPort {
        name,
        port,
        line: program.line_config(port),
        is_optional: port == Apollo13::MARKERS,
    };
    let ports = LINKS.into_iter().zip(ports).map(port).collect();
    Ok(Alone {
        program: Box::new(program),
        ports,
    })
}

/// The camera with its usual mounting and settings, unless the scenario changes them.
fn camera(scenario: &Scenario, source: &Source) -> Result<(Built, DeviceSpec), ScenarioError> {
    let plain = || {
        let plain = DeviceSpec::plain(CAMERA);
        plain.map_err(|error| source.invalid(None, "device.camera.camera", error.message()))
    };
    let mut spec = match scenario.device.get("camera") {
        Some(spec) => spec.clone(),
        None => plain()?,
    };
    if let Some(settings) = spec.settings_mut::<CameraSpec>() {
        settings.mount.get_or_insert(MountSpec {
            x_m: CAMERA_AHEAD_M,
            ..MountSpec::default()
        });
        settings.height_m.get_or_insert(CAMERA_HEIGHT_M);
    }
    let built = spec.build("camera", scenario.seed, source)?;
    Ok((built, spec))
}

fn check_names(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    for (name, spec) in &scenario.device {
        let found = DEVICES.iter().find(|(known, _)| known == name);
        let message = match found {
            Some((_, kind)) if spec.kind() == *kind => continue,
            Some((_, kind)) => format!("is of kind {}, expected {kind}", spec.kind()),
            None if spec.is_own() => continue,
            None => {
                let known = DEVICES.map(|(name, _)| name);
                near::expected(name, &known)
            }
        };
        return Err(source.invalid(source.find(name), format!("device.{name}"), message));
    }
    for name in scenario.link.keys() {
        let is_own = scenario.device.contains_key(name);
        if !is_own && !LINKS.contains(&name.as_str()) {
            let message = near::expected(name, &LINKS);
            return Err(source.invalid(source.find(name), format!("link.{name}"), message));
        }
    }
    Ok(())
}

/// Fixed settings of the car: start pose, floor plan, format of the odometer.
fn config(scenario: &Scenario, source: &Source) -> Result<Config, ScenarioError> {
    let start = scenario.world.start_pose();
    let wall = match &scenario.program.start_mode {
        None => None,
        Some(name) => {
            let found = WALLS.iter().find(|(known, _)| known == name);
            let (_, side) = found.ok_or_else(|| {
                let known = WALLS.map(|(name, _)| name).join(" or ");
                let message = format!("is \"{name}\", expected {known}, or none: the phone orders");
                source.invalid(source.find("start_mode"), "program.start_mode", message)
            })?;
            Some((*side, WALL_M))
        }
    };
    let odometer = scenario.device.get("odometer");
    let lines = odometer.and_then(DeviceSpec::settings::<OdometerSpec>);
    let mut config = Config {
        start: CarPose {
            x_m: start.x,
            y_m: start.y,
            heading_rad: start.theta,
        },
        floor: floor::plan(&scenario.world, CAMERA_HEIGHT_M, source)?,
        dialect: match lines {
            Some(spec) => spec.program.dialect(),
            None => Some(protocols::odometer::Dialect::default()),
        },
        wall,
        seed: scenario.seed,
        ..Config::default()
    };
    for id in &scenario.program.defects {
        if !defects::switch_on(&mut config.defects, id.get_ref()) {
            let known: Vec<&str> = defects::ids().collect();
            return Err(source.unknown("program.defects", id, &known));
        }
    }
    Ok(config)
}
