//! The robot's program on the PC: the four functions of its window (reactive drive, mapping,
//! localisation, navigation), stop and driving by hand, over the telemetry link.

mod atlas;
mod config;
mod defects;
mod drive;
mod explore;
mod find;
mod journey;
mod link;
mod look;
mod run;
mod saved;

use core::fmt;

use core::time::Duration;

use protocols::telemetry::{self, message::Telemetry};
use protocols::{Instant, LineConfig, Port};

use atlas::Atlas;
pub use config::{Following, Mapping, NextView, PcConfig, Planning, Sending};
use link::{Heard, Link, Tell};
use run::Run;

pub use crate::localise::{Estimate, Votes};

use crate::growing_map::NotWritten;
use crate::local_map::Segment;
use crate::map_view::MapView;
use crate::pose::{Point, Pose};
use crate::{Master, Work};

/// Commands of an operator at the PC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PcCommand {
    /// Drives by the robot's IR sensors.
    Reactive {
        /// Nominal speed, m/s.
        speed_m_s: f32,
    },
    /// Ends any task and switches the motors off.
    Stop,
    /// Drives with manual speeds until another command.
    Manual {
        /// Ahead, m/s.
        linear_m_s: f32,
        /// To the left, rad/s.
        angular_rad_s: f32,
    },
    /// Explores until the map is complete; the known part is kept.
    MapStart,
    /// Clears the map.
    MapReset,
    /// Finds the robot's pose on the map.
    Localise,
    /// Drives to a position of the map.
    Navigate {
        /// Along x, metres.
        x_m: f32,
        /// Along y, metres.
        y_m: f32,
        /// Heading at the end, radians; `None`: any.
        heading_rad: Option<f32>,
    },
    /// Sends the robot its pose.
    SetPose {
        /// Along x, metres.
        x_m: f32,
        /// Along y, metres.
        y_m: f32,
        /// Heading, radians.
        heading_rad: f32,
    },
}

/// Task that a command starts.
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
    /// Finding the robot's pose.
    Localising,
    /// Driving to a goal.
    Navigating,
    /// Sending the robot its pose.
    SettingPose,
}

/// State of the last task.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TaskState {
    /// No task was started.
    #[default]
    Standby,
    /// The task is running.
    InProgress,
    /// The task ended well.
    Done,
    /// The task failed.
    Failed(Failure),
}

/// Reason why a task failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Failure {
    /// The robot was silent for too long.
    Silent,
    /// The robot did not obey a command, although the command was repeated.
    NoAnswer,
    /// No path leads to the goal.
    NoWay,
    /// The robot sees no wall.
    NothingSeen,
    /// Several positions look alike, and no view distinguishes them.
    Ambiguous,
    /// The map became too large.
    TooLarge,
}

impl Failure {
    /// The failure as a state in messages for operators.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Silent => "failed: robot is silent",
            Self::NoAnswer => "failed: robot does not obey",
            Self::NoWay => "failed: no path leads there",
            Self::NothingSeen => "failed: no wall in sight",
            Self::Ambiguous => "failed: places look alike",
            Self::TooLarge => "failed: map is too large",
        }
    }
}

/// Reason why a command was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Refused {
    /// Another task is running; stop it first.
    Busy(Task),
    /// There is no map.
    NoMap,
    /// A number is not finite.
    NoNumber,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy(task) => write!(f, "still busy: {task:?}"),
            Self::NoMap => write!(f, "there is no map"),
            Self::NoNumber => write!(f, "a number is not finite"),
        }
    }
}

impl core::error::Error for Refused {}

/// Period of a task's own steps, in addition to each message.
const TICK: Duration = Duration::from_millis(50);
/// Maximum silence of the robot before the task fails.
const SILENT_MAX: Duration = Duration::from_secs(10);

/// The PC's program.
#[derive(Clone, Debug)]
pub struct PcProgram {
    link: Link,
    atlas: Atlas,
    task: Option<Task>,
    state: TaskState,
    run: Option<Run>,
    /// The initial pose, until the robot has confirmed it.
    start: Option<Pose>,
    telling: Option<Tell>,
    /// Time of the robot's last message, or of the task's begin.
    alive: Instant,
    tick: Option<Instant>,
}

impl PcProgram {
    /// The link to the robot, at [`telemetry::BAUD`] 8N1.
    pub const TELEMETRY: Port = Port(0);

    /// A program at its start.
    pub fn new(config: PcConfig) -> Self {
        Self {
            link: Link::new(&config),
            atlas: Atlas::new(&config),
            task: None,
            state: TaskState::Standby,
            run: None,
            start: config.start,
            telling: None,
            alive: Instant::ZERO,
            tick: None,
        }
    }

    /// Takes a command. A task that needs the robot waits for the robot's first message.
    ///
    /// # Errors
    /// If the command is not possible now: nothing changes.
    pub fn command(&mut self, now: Instant, command: PcCommand) -> Result<(), Refused> {
        self.check(command)?;
        if let Some((task, run)) = Run::new(now, &self.link, command) {
            self.task = Some(task);
            self.state = TaskState::InProgress;
            self.run = Some(run);
            self.alive = now;
            self.tick = Some(now);
        } else {
            self.atlas.clear();
            if self.run.is_none() {
                (self.task, self.state) = (None, TaskState::Standby);
            }
        }
        Ok(())
    }

    fn check(&self, command: PcCommand) -> Result<(), Refused> {
        let is_sound = match command {
            PcCommand::Reactive { speed_m_s } => speed_m_s.is_finite(),
            PcCommand::Manual {
                linear_m_s,
                angular_rad_s,
            } => linear_m_s.is_finite() && angular_rad_s.is_finite(),
            PcCommand::Navigate {
                x_m,
                y_m,
                heading_rad,
            } => x_m.is_finite() && y_m.is_finite() && heading_rad.is_none_or(f32::is_finite),
            PcCommand::SetPose {
                x_m,
                y_m,
                heading_rad,
            } => x_m.is_finite() && y_m.is_finite() && heading_rad.is_finite(),
            _ => true,
        };
        let busy = self.task.filter(|task| {
            let is_long = matches!(task, Task::Mapping | Task::Localising | Task::Navigating);
            is_long && self.run.is_some()
        });
        let needs_map = matches!(command, PcCommand::Localise | PcCommand::Navigate { .. });
        match (is_sound, busy, command) {
            (false, ..) => Err(Refused::NoNumber),
            (_, _, PcCommand::Stop) | (_, None, _) => {
                let is_missing = needs_map && self.atlas.global.view().is_none();
                if is_missing {
                    Err(Refused::NoMap)
                } else {
                    Ok(())
                }
            }
            (_, Some(task), _) => Err(Refused::Busy(task)),
        }
    }

    /// Loads a saved map of cells of 10 cm.
    ///
    /// # Errors
    /// If the map is too large, or its position is not finite: the map is then incomplete.
    pub fn load_map(&mut self, map: &MapView<'_>) -> Result<(), NotWritten> {
        self.atlas.load(map)
    }

    /// As [`load_map`](Self::load_map), and the robot's pose is corrected by the walls of the map,
    /// to about half a cell. Without the walls, the pose after the first look is that of the
    /// odometry.
    ///
    /// # Errors
    /// As [`load_map`](Self::load_map).
    pub fn load_map_with_walls(&mut self, map: &MapView<'_>) -> Result<(), NotWritten> {
        self.atlas.load(map)?;
        self.atlas.trust_cells();
        Ok(())
    }

    /// The last task.
    pub const fn task(&self) -> Option<Task> {
        self.task
    }

    /// State of the task.
    pub const fn task_state(&self) -> TaskState {
        self.state
    }

    /// State of the last task, for operators.
    pub const fn status(&self) -> &'static str {
        match self.state {
            TaskState::Standby => "standby",
            TaskState::InProgress if self.link.is_silent() => "in progress: robot is silent",
            TaskState::InProgress => "in progress",
            TaskState::Done => "done",
            TaskState::Failed(failure) => failure.name(),
        }
    }

    /// The last telemetry and its time of arrival.
    pub fn telemetry(&self) -> Option<(Instant, &Telemetry)> {
        let heard = self.link.heard();
        heard.map(|heard| (heard.at, &*heard.message))
    }

    /// The pose that the robot reports: in the map's frame if it knows that frame.
    pub fn believed_pose(&self) -> Option<Pose> {
        self.link.heard().and_then(Heard::pose)
    }

    /// The last walls that the robot sent, in the frame of the pose sent with them.
    pub fn lines(&self) -> impl Iterator<Item = Segment> {
        let sight = self.link.sight().into_iter();
        sight.flat_map(|sight| sight.lines.iter().map(|line| line.to_world(sight.pose)))
    }

    /// The map of the last look.
    pub fn local_map(&self) -> Option<MapView<'_>> {
        self.atlas.local.as_ref()?.view()
    }

    /// The whole known map.
    pub fn global_map(&self) -> Option<MapView<'_>> {
        self.atlas.global.view()
    }

    /// The last roadmap: vertices, edges as pairs of vertices, and the chosen path; positions in
    /// the map's frame.
    pub fn roadmap(&self) -> (&[Point], &[(usize, usize)], &[Point]) {
        let Atlas {
            vertices,
            edges,
            way,
            ..
        } = &self.atlas;
        (vertices, edges, way)
    }

    /// The last localisation, even if it was ambiguous.
    pub const fn estimate(&self) -> Option<Estimate> {
        self.atlas.estimate
    }

    /// Whether the robot has sent messages before, but none for 0.9 s.
    pub const fn is_silent(&self) -> bool {
        self.link.is_silent()
    }

    /// Reports every counter with its name and value, always in the same order.
    pub fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        let counts = self.link.counts;
        report("frames", counts.frames);
        report("bad frames", counts.bad_frames);
        report("bad messages", counts.bad_messages);
        report("commands", counts.commands);
        report("requests", counts.requests);
        report("re-sends", counts.resends);
        report("lost in queue", counts.lost_in_queue);
        report("silences", counts.silences);
        report("views", self.atlas.views);
        report("ambiguous", self.atlas.ambiguous);
    }

    /// Runs the due part of the task, once the robot has sent a message.
    fn step(&mut self, now: Instant) -> Result<bool, Failure> {
        if let Some(heard) = self.link.heard() {
            self.alive = self.alive.max(heard.at);
        }
        if now - self.alive > SILENT_MAX {
            return Err(Failure::Silent);
        }
        if self.link.heard().is_none() {
            return Ok(false);
        }
        if let Some(pose) = self.start.take() {
            self.telling = Some(Tell::new(&self.link, pose));
        }
        if let Some(telling) = &mut self.telling {
            if !telling.step(now, &mut self.link)? {
                return Ok(false);
            }
            self.telling = None;
        }
        match &mut self.run {
            Some(run) => run.step(now, &mut self.link, &mut self.atlas),
            None => Ok(false),
        }
    }

    /// Whether the program must act without a message.
    const fn is_active(&self) -> bool {
        self.run.is_some() || self.telling.is_some()
    }
}

impl Master for PcProgram {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port == Self::TELEMETRY {
            self.link.receive(now, bytes);
        }
    }

    fn poll(&mut self, now: Instant) {
        if self.is_active() || self.start.is_some() {
            let outcome = self.step(now);
            if !matches!(outcome, Ok(false)) {
                self.telling = None;
                let ended = outcome.map_or_else(TaskState::Failed, |_| TaskState::Done);
                if self.run.take().is_some() {
                    self.state = ended;
                }
            }
        }
        self.link.poll(now);
        self.tick = self.is_active().then_some(now + TICK);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        if port != Self::TELEMETRY {
            return 0;
        }
        self.link.transmit(buf)
    }

    fn poll_at(&self) -> Option<Instant> {
        self.tick.into_iter().chain(self.link.poll_at()).min()
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        LineConfig::new_8n1(telemetry::BAUD)
    }

    fn take_work(&mut self) -> Work {
        Work::NONE
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString as _;

    use super::*;

    #[test]
    fn a_refusal_says_why() {
        let refused = [
            Refused::Busy(Task::Mapping),
            Refused::NoMap,
            Refused::NoNumber,
        ];
        let said = [
            "still busy: Mapping",
            "there is no map",
            "a number is not finite",
        ];
        assert_eq!(refused.map(|why| why.to_string()), said);
        let failed = [
            Failure::Silent,
            Failure::NoAnswer,
            Failure::NoWay,
            Failure::NothingSeen,
            Failure::Ambiguous,
            Failure::TooLarge,
        ];
        let mut states: alloc::vec::Vec<_> = failed.map(Failure::name).into();
        states.sort_unstable();
        states.dedup();
        let all_fail = states.iter().all(|state| state.starts_with("failed: "));
        assert!(states.len() == 6 && all_fail, "{states:?}");
    }
}
