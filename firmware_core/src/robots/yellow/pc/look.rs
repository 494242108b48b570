//! A look around: the robot rests, and is asked for the lines that its lidar sees.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::{LinesRequest, State, Telecommand};

use super::Failure;
use super::link::{Link, Request, Sight};

/// How long the robot rests before, so that the lidar sees nothing from before: the fielded
/// program.
const REST: Duration = Duration::from_secs(2);
/// Lines as the robot finds them by itself: 0 asks for its own figures.
const LINES: LinesRequest = LinesRequest {
    gap_mm: 0,
    tolerance_mm: 0,
    merge_deg: 0,
};

/// How far a look is.
#[derive(Clone, Debug)]
pub(super) enum Look {
    /// It is to rest.
    Stopping(Request),
    /// It rests.
    Resting(Instant),
    /// It is asked.
    Asking(Request),
}

impl Look {
    pub(super) fn new(link: &Link) -> Self {
        Self::Stopping(Request::to_rest(link))
    }

    /// What the robot sees, as soon as it is known.
    pub(super) fn step(&mut self, now: Instant, link: &mut Link) -> Result<Option<Sight>, Failure> {
        match self {
            Self::Stopping(request) => {
                let heard = link.heard_since(request.since());
                let rests = heard.is_some_and(|heard| heard.state() == Some(State::Off));
                if request.is_sent() && (rests || link.asks_once()) {
                    *self = Self::Resting(now + REST);
                } else {
                    request.poll(now, link)?;
                }
            }
            Self::Resting(until) if now >= *until => {
                let command = Telecommand {
                    lines: Some(LINES),
                    ..Telecommand::default()
                };
                *self = Self::Asking(Request::new(link.number(), command));
                return self.step(now, link);
            }
            Self::Resting(_) => {}
            Self::Asking(request) => match link.sight_since(request.since()) {
                Some(sight) => return Ok(Some(sight.clone())),
                None => request.poll(now, link)?,
            },
        }
        Ok(None)
    }
}
