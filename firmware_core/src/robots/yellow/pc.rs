//! What runs on the PC for the robot: the four functions of its window (reactive drive, mapping,
//! localisation, navigation), stop and driving by hand, over the telemetry link.

mod config;

use core::fmt;

use alloc::boxed::Box;
use alloc::vec::Vec;

use protocols::telemetry::{self, message::Telemetry};
use protocols::{Instant, LineConfig, Port};

pub use config::{Following, Localising, Mapping, NextView, PcConfig, Planning, Sending};

use crate::map_view::MapView;
use crate::pose::{Point, Pose};
use crate::{Master, Work};

/// What a person at the PC may ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PcCommand {
    /// The robot drives by its IR sensors.
    Reactive {
        /// Nominal speed, m/s.
        speed_m_s: f32,
    },
    /// Whatever goes on ends, and the motors are off.
    Stop,
    /// Speeds by hand, until something else is asked for.
    Manual {
        /// Ahead, m/s.
        linear_m_s: f32,
        /// To the left, rad/s.
        angular_rad_s: f32,
    },
    /// The robot explores until the map is complete; what is known already stays.
    MapStart,
    /// The map is forgotten.
    MapReset,
    /// The robot finds itself on the map.
    Localise,
    /// The robot drives to a place of the map.
    Navigate {
        /// Along x, metres.
        x_m: f32,
        /// Along y, metres.
        y_m: f32,
        /// Where it shall look at the end, radians; `None`: anywhere.
        heading_rad: Option<f32>,
    },
    /// The robot is told where it stands.
    SetPose {
        /// Along x, metres.
        x_m: f32,
        /// Along y, metres.
        y_m: f32,
        /// Heading, radians.
        heading_rad: f32,
    },
}

/// What a command set going.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// Driving by the IR sensors.
    Reactive,
    /// Coming to rest.
    Stop,
    /// Driving by hand.
    Manual,
    /// Making the map.
    Mapping,
    /// Finding itself.
    Localising,
    /// Driving to a goal.
    Navigating,
    /// Telling the robot its pose.
    SettingPose,
}

/// How far the last task is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TaskState {
    /// None was begun.
    #[default]
    Standby,
    /// It goes on.
    InProgress,
    /// It ended well.
    Done,
    /// It ended.
    Failed(Failure),
}

/// Why a task ended before its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Failure {
    /// The robot was not heard for long.
    Silent,
    /// The robot did not do what it was told, though told again.
    NoAnswer,
    /// No way leads there.
    NoWay,
    /// The robot sees no wall.
    NothingSeen,
    /// Several places look alike, and no view tells them apart.
    Ambiguous,
    /// The map became too large.
    TooLarge,
}

impl Failure {
    /// The state of a task that ended so, as in messages to people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Silent => "failed: robot is silent",
            Self::NoAnswer => "failed: robot does not obey",
            Self::NoWay => "failed: no way leads there",
            Self::NothingSeen => "failed: no wall in sight",
            Self::Ambiguous => "failed: places look alike",
            Self::TooLarge => "failed: map is too large",
        }
    }
}

/// Why a command was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Refused {
    /// Something else goes on; it has to be stopped first.
    Busy(Task),
    /// The robot was not heard yet.
    NotHeard,
    /// There is no map.
    NoMap,
    /// A number is none.
    NoNumber,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy(task) => write!(f, "still busy: {task:?}"),
            Self::NotHeard => write!(f, "the robot was not heard yet"),
            Self::NoMap => write!(f, "there is no map"),
            Self::NoNumber => write!(f, "a number is not finite"),
        }
    }
}

impl core::error::Error for Refused {}

/// The PC's program.
#[derive(Clone, Debug)]
pub struct PcProgram {
    config: PcConfig,
    task: Option<Task>,
    state: TaskState,
    heard: Option<(Instant, Box<Telemetry>)>,
    path: Vec<Point>,
}

impl PcProgram {
    /// The link to the robot, at [`telemetry::BAUD`] 8N1.
    pub const TELEMETRY: Port = Port(0);

    /// A program at its start.
    pub fn new(config: PcConfig) -> Self {
        Self {
            config,
            task: None,
            state: TaskState::Standby,
            heard: None,
            path: Vec::new(),
        }
    }

    /// Takes a command.
    ///
    /// # Errors
    /// If it cannot be taken now: nothing changes.
    pub fn command(&mut self, _now: Instant, _command: PcCommand) -> Result<(), Refused> {
        let _ = self.config;
        Err(Refused::NotHeard)
    }

    /// The last task.
    pub const fn task(&self) -> Option<Task> {
        self.task
    }

    /// How far it is.
    pub const fn task_state(&self) -> TaskState {
        self.state
    }

    /// How far the last task is, for people.
    pub const fn status(&self) -> &'static str {
        match self.state {
            TaskState::Standby => "standby",
            TaskState::InProgress => "in progress",
            TaskState::Done => "done",
            TaskState::Failed(failure) => failure.name(),
        }
    }

    /// What was heard last, and when.
    pub fn telemetry(&self) -> Option<(Instant, &Telemetry)> {
        self.heard.as_ref().map(|(at, heard)| (*at, &**heard))
    }

    /// Where the robot says that it is, in the map's frame.
    pub fn believed_pose(&self) -> Option<Pose> {
        None
    }

    /// What the last scan showed.
    pub fn local_map(&self) -> Option<MapView<'_>> {
        None
    }

    /// All that is known.
    pub fn global_map(&self) -> Option<MapView<'_>> {
        None
    }

    /// The last roadmap: vertices, edges as pairs of vertices, and the way that was chosen; places
    /// in the map's frame.
    pub fn roadmap(&self) -> (&[Point], &[(usize, usize)], &[Point]) {
        (&[], &[], &self.path)
    }

    /// Whether the robot was heard once and is no more, for 1 s.
    pub fn is_silent(&self) -> bool {
        false
    }

    /// Names every counter with its value, always in the same order.
    pub fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        report("frames", 0);
    }
}

impl Master for PcProgram {
    fn receive(&mut self, _port: Port, _now: Instant, _bytes: &[u8]) {}

    fn poll(&mut self, _now: Instant) {}

    fn transmit(&mut self, _port: Port, _buf: &mut [u8]) -> usize {
        0
    }

    fn poll_at(&self) -> Option<Instant> {
        None
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        LineConfig::new_8n1(telemetry::BAUD)
    }

    fn take_work(&mut self) -> Work {
        Work::NONE
    }
}
