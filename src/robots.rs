//! The robots: which devices, links and program each one consists of.

use core::time::Duration;

use emulators::world::World;
use protocols::LineConfig;

use crate::rig::Rig;
use crate::scenario::{Robot, Scenario, ScenarioError, Source};

pub mod rescue;

/// What the base was told to do with the wheels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Actuators {
    /// Set-points in force, left and right, in the base's own unit.
    pub set_points: [i16; 2],
    /// Largest sound value.
    pub limit: i16,
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

/// What a robot's checkers need to know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watch {
    /// Link on which wheel commands travel.
    pub command_link: &'static str,
    /// Silence after which the base must have stopped the motors.
    pub silence_max: Duration,
}

/// Wires the scenario's robot into `world`.
pub fn wire(
    scenario: &Scenario,
    source: &Source,
    world: World,
    dut: Dut,
    pc: PcEnd,
) -> Result<Wired, ScenarioError> {
    match scenario.robot {
        Robot::Rescue => rescue::wire(scenario, source, world, dut, pc),
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

/// Whether the PC has received all of the map; `None` if it is not emulated.
pub fn map_received(robot: Robot, rig: &Rig) -> Option<bool> {
    match robot {
        Robot::Rescue => rescue::map_received(rig),
    }
}
