//! The robots: devices, links and program of each.
//!
//! A robot is a row of the registry: [`Robot`]. Scenarios name it; another crate adds its own with
//! [`register`]. The robot's [`Instruments`] travel with the rig and answer the queries of
//! observers.

#[cfg(feature = "robots")]
mod apollo13;
pub mod axis;
#[cfg(feature = "rescue")]
mod board_settings;
mod bounds;
pub mod checker;
pub(crate) mod conditions;
pub(crate) mod custom;
mod devices;
mod ignored;
pub mod instruments;
mod kept_map;
mod links;
mod log_rules;
pub mod overlay;
pub mod panel;
mod rates;
#[cfg(feature = "rescue")]
pub mod rescue;
#[cfg(feature = "robots")]
mod script;
pub mod station;
mod warnings;
mod wiring;
#[cfg(feature = "robots")]
mod yellow;

use emulators::world::{Chassis, World};
use firmware_core::odometry::WheelGeometry;
use firmware_core::pose::Pose;
use firmware_core::scan::Mounting;
use protocols::avr::ChecksumOrder;
use protocols::{LineConfig, Port};

pub use crate::scenario::device::scan::{Beam, ScanDecoder};
pub use axis::Axis;
pub(crate) use bounds::beyond_map;
pub use checker::{Check, Checker, Look, Status};
use devices::add_devices;
pub use instruments::{
    Alarm, Asking, Command, Console, Cycle, Dialect, Display, Figure, Found, Instruments, Intake,
    Need, Silence, Stops,
};
pub use kept_map::KeptMap;
pub use overlay::{Overlay, OverlayRole};
pub use panel::{Panel, PanelRow};
pub use station::{DriveKeys, Gesture, Hand, RemoteStation, Station, StationView};
pub use warnings::warnings;
pub use wiring::{nowhere, wire, wire_first, wire_into, wire_without_start};

use crate::near;
pub use crate::registry::NameTaken;
use crate::registry::{Named, Registry};
use crate::rig::line::End;
use crate::rig::{PortRate, Program, Rig};
use crate::scenario::{Scenario, ScenarioError, Source};

/// A kind of robot. It turns a scenario into a rig.
pub trait Robot: Sync {
    /// Its name, as in a scenario.
    fn name(&self) -> &'static str;

    /// A description of the robot in one sentence.
    fn about(&self) -> &'static str;

    /// The robot's drive train and outline; `None`: two wheels with the figures of the scenario.
    ///
    /// # Errors
    /// If the scenario has impossible settings for the robot.
    fn chassis(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Box<dyn Chassis>>, ScenarioError> {
        refuse_chassis(scenario, source).map(|()| None)
    }

    /// Wires its devices and its program into `world`, or open ends instead of the program.
    ///
    /// # Errors
    /// If the scenario has impossible settings for the robot.
    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError>;

    /// The robot's program alone, for a separate process; `None` if the robot has no program.
    ///
    /// # Errors
    /// If the scenario has impossible settings for the robot.
    fn program(
        &self,
        _scenario: &Scenario,
        _source: &Source,
    ) -> Result<Option<Alone>, ScenarioError> {
        Ok(None)
    }

    /// Settings of its program as words for firmware on a simulated board: keys and values.
    ///
    /// # Errors
    /// If the scenario has settings without words.
    fn board_settings(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Vec<(&'static str, String)>, ScenarioError> {
        if !scenario.program.has_settings() {
            return Ok(Vec::new());
        }
        let message = "this robot's program cannot receive settings on a simulated board, expected \
                       only \"cpu\"; remove the others";
        Err(source.invalid(source.find("program"), "program", message))
    }

    /// Limits of worlds and missions that are generated; `None` if only the scenario's own world
    /// and mission are suitable.
    fn arena(&self) -> Option<Arena> {
        None
    }

    /// Range of its map, metres in the world's frame: lower left and upper right corner. `None`
    /// without a map, or without limits that matter.
    fn map_m(&self) -> Option<[[f64; 2]; 2]> {
        None
    }

    /// Whether the mission can order the robot to connect, to visit waypoints, or to change its
    /// mode.
    fn takes_orders(&self) -> bool {
        true
    }

    /// Keys and tables of a scenario that the robot does not read, such as `program.tuning`: each
    /// one in a file is a warning.
    fn ignores(&self, _scenario: &Scenario) -> &'static [&'static str] {
        &ignored::OF_YELLOW
    }

    /// Counters of the program for situations that a campaign must cause at least once. Without
    /// such a situation, the campaign does not show whether the robot can handle it.
    fn situations(&self) -> &'static [&'static str] {
        &[]
    }

    /// Numbers of the defects of the fielded program that `program.defects` can switch on.
    fn defects(&self) -> Vec<&'static str> {
        Vec::new()
    }

    /// The data that a mapper needs to interpret the bytes on the robot's links.
    ///
    /// # Errors
    /// If the scenario has impossible settings for the robot.
    fn senses(
        &self,
        _scenario: &Scenario,
        _source: &Source,
    ) -> Result<Option<Senses>, ScenarioError> {
        Ok(None)
    }

    /// The station that controls such a robot remotely, with the coding of its port.
    fn remote(&self) -> Option<(Box<dyn RemoteStation>, LineConfig)> {
        None
    }
}

impl Named for dyn Robot {
    fn name(&self) -> &str {
        Robot::name(self)
    }
}

static ROBOTS: Registry<dyn Robot> = Registry::new(&[
    #[cfg(feature = "rescue")]
    &rescue::RescueRobot,
    #[cfg(feature = "robots")]
    &yellow::YellowRobot,
    #[cfg(feature = "robots")]
    &apollo13::ApolloRobot,
    &custom::CustomRobot,
    &custom::Bare,
]);

/// Adds a robot to the registry, for all scenarios of this process.
///
/// # Errors
/// If the registry has a robot of that name.
pub fn register(robot: impl Robot + 'static) -> Result<(), NameTaken> {
    ROBOTS.register(Box::new(robot)).map(drop)
}

/// All robots, the built-in ones first.
pub fn all() -> Vec<&'static dyn Robot> {
    ROBOTS.all()
}

/// The robot called `name`.
pub fn find(name: &str) -> Option<&'static dyn Robot> {
    ROBOTS.find(name)
}

/// The robot that a scenario names.
///
/// # Errors
/// If it is unknown.
pub fn of(scenario: &Scenario, source: &Source) -> Result<&'static dyn Robot, ScenarioError> {
    ROBOTS.find(&scenario.robot).ok_or_else(|| {
        let message = near::expected(&scenario.robot, &ROBOTS.names());
        source.invalid(source.find("robot"), "robot", message)
    })
}

/// Rejects a chassis in the scenario, because the robot has its own.
fn refuse_chassis(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    if scenario.chassis.is_none() {
        return Ok(());
    }
    let message = "expected none: this robot has its own chassis";
    Err(source.invalid(source.find("chassis"), "chassis", message))
}

/// The input for the wiring of a robot.
pub struct WirePlan<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// The source of the scenario, for messages.
    pub source: &'a Source,
    /// The true world with the robot's body.
    pub world: World,
    /// The kind of program.
    pub dut: Dut,
    /// The kind of PC.
    pub pc: PcEnd,
}

/// The robot's program in a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dut {
    /// The program in this process.
    Internal,
    /// A foreign program on the open ends of the links.
    External,
}

/// The PC in a rig, if the robot has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PcEnd {
    /// The mission's script.
    Scripted,
    /// A foreign program.
    External,
}

/// An end of a link that is served from outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenEnd {
    /// Name of the port, e.g. `lidar`.
    pub name: String,
    /// Name of its link.
    pub link: String,
    /// Node of the rig, see [`Rig::inject`].
    pub node: usize,
    /// Initial coding of its port.
    pub line: LineConfig,
    /// The accepted baud rates of a client.
    pub rate: PortRate,
    /// Description of the program that connects here, for messages.
    pub connect: &'static str,
    /// Whether a program may leave the port closed.
    pub is_optional: bool,
    /// Index of its robot, see [`Rigs`](crate::rig::Rigs).
    pub robot: usize,
}

impl OpenEnd {
    /// The name without that of a further robot.
    pub fn own_name(&self) -> &str {
        self.name.split_once('/').map_or(&self.name, |(_, own)| own)
    }
}

/// A rig and the data for its users.
pub struct Wired {
    /// The rig.
    pub rig: Rig,
    /// Ends to be served from outside.
    pub open_ends: Vec<OpenEnd>,
    /// The interface of the robot.
    pub instruments: Box<dyn Instruments>,
}

impl Wired {
    /// A rig without open ends.
    pub fn new(rig: Rig, instruments: impl Instruments + 'static) -> Self {
        Self {
            rig,
            open_ends: Vec::new(),
            instruments: Box::new(instruments),
        }
    }

    /// Sets whether a program may leave the port of `end` closed.
    pub fn set_optional(&mut self, end: End, is_optional: bool) {
        let ends = self.open_ends.iter_mut();
        for open in ends.filter(|open| open.node == end.node) {
            open.is_optional = is_optional;
        }
    }

    /// Sets the accepted baud rates of a client at the port of `end`.
    pub fn set_rate(&mut self, end: End, rate: PortRate) {
        let ends = self.open_ends.iter_mut();
        for open in ends.filter(|open| open.node == end.node) {
            open.rate = rate;
            if let PortRate::Any { usual } = rate {
                open.line = usual;
            }
        }
    }

    /// Adds an open end for the link `name`; `connect` describes its client.
    pub fn open_end(&mut self, name: &str, line: LineConfig, connect: &'static str) -> End {
        let node = self.rig.add_outside(name, line);
        let (name, link) = (name.to_owned(), name.to_owned());
        self.open_ends.push(OpenEnd {
            name,
            link,
            node,
            line,
            rate: PortRate::OfLine,
            connect,
            is_optional: false,
            robot: 0,
        });
        End {
            node,
            port: Port(0),
        }
    }
}

/// Limits of generated worlds and missions for a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arena {
    /// Side of the square that the robot's map covers, from the origin, metres.
    pub side_m: f64,
    /// Free margin that the robot needs beside its body, metres.
    pub margin_m: f64,
    /// Minimum average speed of the robot, metres per second, including turns, stops and detours.
    pub pace_m_s: f64,
    /// Minimum and maximum width of a door or corridor.
    pub passage_mm: [u64; 2],
    /// Minimum and maximum radius of an obstacle.
    pub obstacle_mm: [u64; 2],
}

/// A robot's program alone, with the names of its ports.
pub struct Alone {
    /// The program.
    pub program: Box<dyn Program>,
    /// Its ports.
    pub ports: Vec<ProgramPort>,
}

/// A port of a robot's program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProgramPort {
    /// Name of the link at this port.
    pub name: &'static str,
    /// The program's number of the port.
    pub port: Port,
    /// Coding of its line.
    pub line: LineConfig,
    /// Whether the port may be left closed.
    pub is_optional: bool,
}

/// The data that a mapper needs to interpret the bytes on a robot's links.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Senses {
    /// Link of the XV-11 lidar.
    pub lidar: &'static str,
    /// Mounting of the lidar, and filter of its readings.
    pub mounting: Mounting,
    /// Register bus of the base.
    pub base: &'static str,
    /// Byte order of its checksum.
    pub checksum_order: ChecksumOrder,
    /// First registers of the wheels' counters of 32 bits, left and right.
    pub counters: [u8; 2],
    /// Meaning of the encoder counts.
    pub wheels: WheelGeometry,
    /// Estimated start pose of the robot.
    pub start: Pose,
}
