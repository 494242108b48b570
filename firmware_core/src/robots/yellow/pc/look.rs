//! A look around: the robot rests, and is asked for the lines that its lidar sees.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::{LinesRequest, State, Telecommand};

use super::Failure;
use super::link::{Link, Request, Sight};

/// How long the robot rests before, so that the lidar sees nothing from before: the fielded
/// program.
const REST: Duration = Duration::from_secs(2);
/// A lidar that shows no wall may have lost its turns: it is asked again after so long,
const BLIND: Duration = Duration::from_secs(1);
/// so often. A lidar that has to be started again needs 5 s.
const BLIND_MAX: u32 = 10;
/// Fewer walls than this are none, mm.
const WALLS_MIN_MM: f32 = 300.0;
/// Lines as the robot finds them by itself: 0 asks for its own figures.
const LINES: LinesRequest = LinesRequest {
    gap_mm: 0,
    tolerance_mm: 0,
    merge_deg: 0,
};

/// A look around.
#[derive(Clone, Debug)]
pub(super) struct Look {
    phase: Phase,
    /// How often nothing was seen.
    blind: u32,
}

/// How far it is.
#[derive(Clone, Debug)]
enum Phase {
    /// The robot is to rest.
    Stopping(Request),
    /// It rests.
    Resting(Instant),
    /// It is asked.
    Asking(Request),
}

impl Look {
    pub(super) fn new(link: &Link) -> Self {
        Self {
            phase: Phase::Stopping(Request::to_rest(link)),
            blind: 0,
        }
    }

    /// What the robot sees, as soon as it is known.
    pub(super) fn step(&mut self, now: Instant, link: &mut Link) -> Result<Option<Sight>, Failure> {
        match &mut self.phase {
            Phase::Stopping(request) => {
                let heard = link.heard_since(request.since());
                let rests = heard.is_some_and(|heard| heard.state() == Some(State::Off));
                if request.is_sent() && (rests || link.asks_once()) {
                    self.phase = Phase::Resting(now + REST);
                } else {
                    request.poll(now, link)?;
                }
            }
            Phase::Resting(until) if now >= *until => {
                let command = Telecommand {
                    lines: Some(LINES),
                    ..Telecommand::default()
                };
                self.phase = Phase::Asking(Request::new(link.number(), command));
                return self.step(now, link);
            }
            Phase::Resting(_) => {}
            Phase::Asking(request) => match link.sight_since(request.since()) {
                Some(sight) => {
                    let sight = sight.clone();
                    return Ok(self.judged(now, link, sight));
                }
                None => request.poll(now, link)?,
            },
        }
        Ok(None)
    }

    /// The sight, unless another look may show more.
    fn judged(&mut self, now: Instant, link: &Link, sight: Sight) -> Option<Sight> {
        let walls_mm: f32 = sight.lines.iter().map(|line| line.length_mm()).sum();
        if walls_mm >= WALLS_MIN_MM || self.blind == BLIND_MAX || link.asks_once() {
            return Some(sight);
        }
        self.blind += 1;
        self.phase = Phase::Resting(now + BLIND);
        None
    }
}
