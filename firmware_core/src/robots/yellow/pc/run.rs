//! The running task, step by step.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::{Reactive, State, Telecommand, Velocities};

use super::atlas::Atlas;
use super::drive::Goal;
use super::explore::Explore;
use super::find::Find;
use super::journey::Journey;
use super::link::{Kind, Link, Request, Tell};
use super::{Failure, PcCommand, Task};
use crate::pose::{Point, Pose};

/// Period at which manual speeds are sent again; the robot stops by itself after 2 s.
const BY_HAND: Duration = Duration::from_millis(500);

/// A task and its progress.
#[derive(Clone, Debug)]
pub(super) enum Run {
    /// The request, and whether it was obeyed.
    Reactive(Request, bool),
    Stop(Request),
    /// The command, and when to send it next; `None`: never again.
    Manual(Telecommand, Option<Instant>),
    Map(Explore),
    Find(Find),
    Go(Journey),
    Tell(Tell),
}

impl Run {
    /// The task that a command starts; none if the command only clears the map.
    pub(super) fn new(now: Instant, link: &Link, command: PcCommand) -> Option<(Task, Self)> {
        let begun = match command {
            PcCommand::Reactive { speed_m_s } => {
                let reactive = Some(Reactive {
                    speed_m_s: Some(speed_m_s),
                    ..Reactive::default()
                });
                let command = Telecommand {
                    state: Some(State::AutoReactive),
                    reactive,
                    ..Telecommand::default()
                };
                let request = Request::of_state(link.number(), command);
                (Task::Reactive, Self::Reactive(request, false))
            }
            PcCommand::Stop => (Task::Stop, Self::Stop(Request::to_rest(link))),
            PcCommand::Manual {
                linear_m_s,
                angular_rad_s,
            } => {
                let velocities = Some(Velocities {
                    linear_m_s,
                    angular_rad_s,
                });
                let command = Telecommand {
                    state: Some(State::Manual),
                    velocities,
                    ..Telecommand::default()
                };
                (Task::Manual, Self::Manual(command, Some(now)))
            }
            PcCommand::MapStart => (Task::Mapping, Self::Map(Explore::new(link))),
            PcCommand::MapReset => return None,
            PcCommand::Localise => (Task::Localising, Self::Find(Find::new(link))),
            PcCommand::Navigate {
                x_m,
                y_m,
                heading_rad: heading,
            } => {
                let place = Point::new(x_m * 1_000.0, y_m * 1_000.0);
                let goal = Goal { place, heading };
                (Task::Navigating, Self::Go(Journey::new(goal)))
            }
            PcCommand::SetPose {
                x_m,
                y_m,
                heading_rad,
            } => {
                let pose = Pose::new(x_m * 1_000.0, y_m * 1_000.0, heading_rad);
                (Task::SettingPose, Self::Tell(Tell::new(link, pose)))
            }
        };
        Some(begun)
    }

    /// Returns whether the task has ended well. Call it only while the robot sends messages.
    pub(super) fn step(
        &mut self,
        now: Instant,
        link: &mut Link,
        atlas: &mut Atlas,
    ) -> Result<bool, Failure> {
        match self {
            Self::Reactive(request, is_obeyed) => {
                let heard = link.heard_since(request.since());
                let state = heard.and_then(|heard| heard.state());
                *is_obeyed |= request.is_sent() && state == Some(State::AutoReactive);
                if !*is_obeyed {
                    request.poll(now, link)?;
                }
                Ok(*is_obeyed && state == Some(State::Off))
            }
            Self::Stop(request) => {
                let heard = link.heard_since(request.since());
                let rests = heard.is_some_and(|heard| heard.state() == Some(State::Off));
                if request.is_sent() && rests {
                    return Ok(true);
                }
                request.poll(now, link)?;
                Ok(false)
            }
            Self::Manual(command, due) => {
                if due.is_some_and(|due| now >= due) {
                    link.send(now, Kind::Drive, *command);
                    *due = (!link.asks_once()).then_some(now + BY_HAND);
                }
                Ok(false)
            }
            Self::Map(explore) => explore.step(now, link, atlas),
            Self::Find(find) => find.step(now, link, atlas),
            Self::Go(journey) => journey.step(now, link, atlas),
            Self::Tell(tell) => tell.step(now, link),
        }
    }
}
