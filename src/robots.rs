//! The robots: which devices, links and program each one consists of.

use core::time::Duration;

use emulators::pc::{Pc, ScriptError};
use emulators::touch_panel::TouchPanel;
use emulators::world::World;
use firmware_core::odometry::WheelGeometry;
use firmware_core::pose::Pose;
use firmware_core::scan::Mounting;
use protocols::avr::ChecksumOrder;
use protocols::{LineConfig, Port};
use serde::Serialize;

use crate::codec::Protocol;
use crate::rig::fault::FaultId;
use crate::rig::line::End;
use crate::rig::{Program, Rig};
use crate::scenario::{Robot, Scenario, ScenarioError, Source, Step, TapSpec};

pub mod rescue;

/// What the base was told to do with the wheels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Actuators {
    /// Set-points in force, left and right, in the base's own unit.
    pub set_points: [i16; 2],
    /// Largest sound value.
    pub limit: i16,
}

/// What a frame to the base commands: the set-points of the left and the right wheel, as the wheels
/// can follow them.
pub type Command = [Option<i16>; 2];

/// How a robot's base is commanded.
#[derive(Clone, Copy, Debug)]
pub struct Dialect {
    /// The longest frame.
    pub frame_max: usize,
    /// The command in the sound frame with which these bytes end, if they do.
    pub command: fn(&[u8]) -> Option<Command>,
}

/// Who takes the part of the robot's program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dut {
    /// The program in this process.
    Internal,
    /// Somebody outside, on the open ends of the links.
    External,
}

/// Who takes the part of the PC, if the robot has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PcEnd {
    /// The mission's script.
    Scripted,
    /// Somebody outside.
    External,
}

/// An end of a link that is served from outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenEnd {
    /// Name under which it is offered, e.g. `lidar`.
    pub name: String,
    /// Link that it belongs to.
    pub link: String,
    /// Node of the rig, see [`Rig::inject`].
    pub node: usize,
    /// Coding that a client should set.
    pub line: LineConfig,
    /// Who is to connect, for people.
    pub connect: &'static str,
}

/// A rig with what outsiders need to know of it.
pub struct Wired {
    /// The rig.
    pub rig: Rig,
    /// Ends to be served from outside.
    pub open_ends: Vec<OpenEnd>,
}

impl Wired {
    fn open_end(&mut self, name: &str, line: LineConfig, connect: &'static str) -> End {
        let node = self.rig.add_outside(name, line);
        let (name, link) = (name.to_owned(), name.to_owned());
        self.open_ends.push(OpenEnd {
            name,
            link,
            node,
            line,
            connect,
        });
        End {
            node,
            port: Port(0),
        }
    }
}

/// Plans the scenario's latencies and faults on the links of a wired rig.
fn plan_links(rig: &mut Rig, scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    for (name, spec) in &scenario.link {
        if let Some(link) = rig.link_mut(name) {
            link.lines
                .iter_mut()
                .for_each(|line| line.latency = spec.latency.0);
        }
    }
    rig.budget = scenario.budget.unwrap_or_default().into();
    for (index, fault) in scenario.fault.iter().enumerate() {
        let planned = rig.plan_fault(fault, FaultId(index), scenario.seed);
        planned.map_err(|flaw| {
            let span = source.find_in_list("fault", index, flaw.key);
            source.invalid(span, format!("fault[{index}].{}", flaw.key), flaw.message)
        })?;
    }
    Ok(())
}

/// What a robot's checkers need to know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watch {
    /// Link on which wheel commands travel.
    pub command_link: &'static str,
    /// Silence after which the base must have stopped the motors.
    pub silence_max: Duration,
}

/// A room that suits a robot, for missions that are made by chance. It looks different from each
/// place and in each direction: a robot that was lost can find out where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arena {
    /// Side of the world, metres.
    pub side_m: f64,
    /// The wall, from corner to corner.
    pub wall_m: &'static [[f64; 2]],
    /// Places for the robot, its waypoints and obstacles: six at least, so far apart that the
    /// robot gets past an obstacle.
    pub places_m: &'static [[f64; 2]],
    /// Least and greatest radius of an obstacle.
    pub obstacle_mm: [u64; 2],
}

/// The room for missions that are made by chance.
pub const fn arena(robot: Robot) -> Arena {
    match robot {
        Robot::Rescue => rescue::ARENA,
    }
}

/// Links on which a device may be told to do something else for good, and the device: nothing but
/// its switch brings it back.
pub const fn consoles(robot: Robot) -> &'static [(&'static str, &'static str)] {
    match robot {
        Robot::Rescue => &rescue::CONSOLES,
    }
}

/// Wires the scenario's robot into `world`.
pub fn wire(
    scenario: &Scenario,
    source: &Source,
    world: World,
    dut: Dut,
    pc: PcEnd,
) -> Result<Wired, ScenarioError> {
    let mut wired = match scenario.robot {
        Robot::Rescue => rescue::wire(scenario, source, world, dut, pc)?,
    };
    add_own_devices(&mut wired, scenario, source)?;
    plan_links(&mut wired.rig, scenario, source)?;
    Ok(wired)
}

/// Adds the devices that the scenario describes itself, each on a link of its own whose other end
/// is open.
fn add_own_devices(
    wired: &mut Wired,
    scenario: &Scenario,
    source: &Source,
) -> Result<(), ScenarioError> {
    for (name, spec) in &scenario.device {
        let key = format!("device.{name}");
        let invalid = |message| Err(source.invalid(source.find(name), key.clone(), message));
        if spec.is_own() && wired.rig.link(name).is_some() {
            return invalid("the robot has a link of this name, expected another name");
        }
        let fits = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
        if spec.is_own() && !name.chars().all(fits) {
            return invalid("expected a name of letters, digits, '-' and '_'");
        }
        if !spec.is_own() {
            continue;
        }
        let built = spec.build(name, scenario.seed, source)?;
        let node = wired.rig.add_boxed_device(name, built.device);
        for (index, info) in built.ports.into_iter().enumerate() {
            // The first port is the one that counts; further ones are told apart by their names.
            let link = match index {
                0 => name.clone(),
                _ => format!("{name}-{}", info.name),
            };
            let master = wired.open_end(&link, info.line, info.connect);
            let device = End {
                node,
                port: info.port,
            };
            let rig = &mut wired.rig;
            rig.connect_by(info.kind, &link, device, master, info.piece);
        }
    }
    Ok(())
}

/// A robot's program by itself, with the names of its ports.
pub struct Alone {
    /// The program.
    pub program: Box<dyn Program>,
    /// Its ports.
    pub ports: Vec<ProgramPort>,
}

/// A port of a robot's program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProgramPort {
    /// Name of the link that belongs there.
    pub name: &'static str,
    /// The program's number for it.
    pub port: Port,
    /// Coding of its line.
    pub line: LineConfig,
    /// Whether the program can do without.
    pub is_optional: bool,
}

/// The program of the scenario's robot, for a process of its own.
pub fn program(scenario: &Scenario, source: &Source) -> Result<Alone, ScenarioError> {
    match scenario.robot {
        Robot::Rescue => rescue::alone(scenario, source),
    }
}

/// What the robot's checkers need to know.
pub const fn watch(robot: Robot) -> Watch {
    match robot {
        Robot::Rescue => rescue::WATCH,
    }
}

/// What the base was told to do, if the base is emulated.
pub fn actuators(robot: Robot, rig: &Rig) -> Option<Actuators> {
    match robot {
        Robot::Rescue => rescue::actuators(rig),
    }
}

/// How the base is commanded, if the base is emulated.
pub fn dialect(robot: Robot, rig: &Rig) -> Option<Dialect> {
    match robot {
        Robot::Rescue => rescue::dialect(rig),
    }
}

/// Whether the PC has received all of the map; `None` if it is not emulated.
pub fn map_received(robot: Robot, rig: &Rig) -> Option<bool> {
    match robot {
        Robot::Rescue => rescue::map_received(rig),
    }
}

/// Counters of the program that tell of situations which a campaign must bring about at least
/// once: otherwise nothing is known about how it copes with them.
pub const fn situations(robot: Robot) -> &'static [&'static str] {
    match robot {
        Robot::Rescue => &rescue::SITUATIONS,
    }
}

/// The PC at the far end of the radio, if the rig has one.
pub fn pc(robot: Robot, rig: &Rig) -> Option<&Pc> {
    match robot {
        Robot::Rescue => rescue::pc(rig),
    }
}

/// Puts a step into the script of the rig's PC: at `index` among the `mission` steps that the
/// scenario gave it. `None` if the rig has no PC.
pub fn insert_pc_step(
    robot: Robot,
    rig: &mut Rig,
    mission: usize,
    index: usize,
    step: &Step,
) -> Option<Result<(), ScriptError>> {
    match robot {
        Robot::Rescue => rescue::insert_pc_step(rig, mission, index, step),
    }
}

/// What a link speaks, if it is known.
pub fn protocol(robot: Robot, rig: &Rig, link: &str) -> Option<Protocol> {
    match robot {
        Robot::Rescue => rescue::protocol(rig, link),
    }
}

/// Where the page finds a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanLink {
    /// The link on which an XV-11 sends.
    pub link: &'static str,
    /// Bearing of its first reading, counter-clockwise from straight ahead.
    pub first_bearing: f64,
}

/// Where the page finds the robot's scan.
pub const fn scan_link(robot: Robot) -> ScanLink {
    match robot {
        Robot::Rescue => rescue::SCAN_LINK,
    }
}

/// What a mapper needs to know of a robot to understand what passed its links.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Senses {
    /// Link on which an XV-11 sends.
    pub lidar: &'static str,
    /// How it sits, and which of its readings count.
    pub mounting: Mounting,
    /// Register bus of the base.
    pub base: &'static str,
    /// Order of its checksum.
    pub checksum_order: ChecksumOrder,
    /// First registers of the wheels' counters of 32 bits, left and right.
    pub counters: [u8; 2],
    /// What a count means.
    pub wheels: WheelGeometry,
    /// Where the robot believes to start.
    pub start: Pose,
}

/// What a mapper needs to know of the scenario's robot.
///
/// # Errors
/// If the scenario sets the robot up in a way that it cannot be.
pub fn senses(scenario: &Scenario, source: &Source) -> Result<Senses, ScenarioError> {
    match scenario.robot {
        Robot::Rescue => rescue::senses(scenario, source),
    }
}

/// A value of a device, for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Register {
    /// Its address.
    pub address: u8,
    /// Its name.
    pub name: &'static str,
    /// What it holds.
    pub value: i64,
    /// Unit of the value, empty if it has none.
    pub unit: &'static str,
}

/// The registers of the robot's base, if it is emulated.
pub fn registers(robot: Robot, rig: &Rig) -> Vec<Register> {
    match robot {
        Robot::Rescue => rescue::registers(rig),
    }
}

/// The robot's own display, if it has one.
pub fn display(robot: Robot, rig: &Rig) -> Option<&TouchPanel> {
    match robot {
        Robot::Rescue => rescue::display::of(rig),
    }
}

/// Lets somebody tap on the robot's display, and adds the tap to the scenario; whether there is a
/// display.
pub fn tap(scenario: &mut Scenario, rig: &mut Rig, tap: TapSpec) -> bool {
    match scenario.robot {
        Robot::Rescue => rescue::display::tap(scenario, rig, tap),
    }
}
