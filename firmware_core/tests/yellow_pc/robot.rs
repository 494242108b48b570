//! The robot: an ideal differential drive that follows commands as the real one does.

use protocols::telemetry::message::{
    ANY_HEADING, Line, Odometry, Pose, State, Telecommand, Telemetry,
};

use crate::chance::Chance;
use crate::lines::lines;
use crate::world::World;

/// Half of the robot's width: wheels 18 cm apart, plus the wheels themselves.
pub(crate) const RADIUS_M: f64 = 0.1;
const SWITCH_S: f64 = 0.5;
const SPEED_MAX: f64 = 0.5;
const TURN_MAX: f64 = 3.0;
const TOLERANCE: f64 = 0.01;

/// Pose, metres and radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct At {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) heading: f64,
}

impl At {
    fn moved(self, forward: f64, turn: f64) -> Self {
        let (sin, cos) = libm::sincos(self.heading + turn / 2.0);
        Self {
            x: self.x + forward * cos,
            y: self.y + forward * sin,
            heading: wrapped(self.heading + turn),
        }
    }

    fn of(pose: Pose) -> Self {
        Self {
            x: f64::from(pose.x),
            y: f64::from(pose.y),
            heading: f64::from(pose.alpha),
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "as on the wire")]
    fn wire(self) -> Pose {
        Pose {
            x: self.x as f32,
            y: self.y as f32,
            alpha: self.heading as f32,
        }
    }
}

pub(crate) fn wrapped(angle: f64) -> f64 {
    libm::remainder(angle, core::f64::consts::TAU)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Off,
    /// Remaining time until the new state.
    Switching(f64, State),
    Driving(State),
}

/// Deviations from the ideal.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Errors {
    /// Relative error of a distance and of a turn.
    pub(crate) way: f64,
    pub(crate) turn: f64,
    /// Standard deviation of a range, metres.
    pub(crate) range: f64,
}

pub(crate) struct Robot {
    pub(crate) truth: At,
    pub(crate) odometry: At,
    errors: Errors,
    chance: Chance,
    mode: Mode,
    goal: Option<Pose>,
    /// Stage of a manoeuvre: turned towards the goal, arrived at the goal.
    stage: u8,
    speeds: (f64, f64),
    sees: bool,
    /// Whether its lidar has no readings.
    pub(crate) is_blind: bool,
    /// Whether its lidar shows the walls rotated, each time by another angle.
    pub(crate) is_dizzy: bool,
    /// Minimum distance to a wall so far, metres.
    pub(crate) room: f64,
    pub(crate) driven: f64,
}

impl Robot {
    pub(crate) fn new(truth: At, errors: Errors, seed: u64) -> Self {
        Self {
            truth,
            odometry: At::default(),
            errors,
            chance: Chance::new(seed),
            mode: Mode::Off,
            goal: None,
            stage: 0,
            speeds: (0.0, 0.0),
            sees: false,
            is_blind: false,
            is_dizzy: false,
            room: f64::MAX,
            driven: 0.0,
        }
    }

    pub(crate) fn state(&self) -> State {
        match self.mode {
            Mode::Driving(state) => state,
            _ => State::Off,
        }
    }

    /// `goal` rotated about the robot's believed pose.
    pub(crate) fn turned(&self, goal: Pose, by: f64) -> Pose {
        let (sin, cos) = libm::sincos(by);
        let (dx, dy) = (
            f64::from(goal.x) - self.odometry.x,
            f64::from(goal.y) - self.odometry.y,
        );
        let turned = At {
            x: self.odometry.x + cos * dx - sin * dy,
            y: self.odometry.y + sin * dx + cos * dy,
            heading: f64::from(goal.alpha),
        };
        turned.wire()
    }

    pub(crate) fn obey(&mut self, command: &Telecommand) {
        if let Some(pose) = command.corrected_pose {
            self.odometry = At::of(pose);
        }
        self.sees |= command.lines.is_some();
        if let Some(speeds) = command.velocities {
            self.speeds = (
                f64::from(speeds.linear_m_s),
                f64::from(speeds.angular_rad_s),
            );
        }
        match (command.state, command.desired_pose) {
            (Some(State::AutoPosition), None) | (None, _) => {}
            (Some(State::Off), _) => {
                if self.mode != Mode::Off {
                    self.mode = Mode::Switching(SWITCH_S, State::Off);
                }
            }
            (Some(state), goal) => {
                (self.goal, self.stage) = (goal, 0);
                if !matches!(self.mode, Mode::Driving(_)) {
                    self.mode = Mode::Switching(SWITCH_S, state);
                } else {
                    self.mode = Mode::Driving(state);
                }
            }
        }
    }

    /// Rolls without supply by a distance that the wheels do not count; the robot has stopped.
    pub(crate) fn roll(&mut self, forward: f64, turn: f64) {
        self.truth = self.truth.moved(forward, turn);
        self.mode = Mode::Switching(SWITCH_S, State::Off);
    }

    pub(crate) fn step(&mut self, world: &World, seconds: f64) {
        let (speed, turn) = match self.mode {
            Mode::Off => (0.0, 0.0),
            Mode::Switching(left, state) => {
                self.mode = match (left > seconds, state) {
                    (true, _) => Mode::Switching(left - seconds, state),
                    (false, State::Off) => Mode::Off,
                    (false, _) => Mode::Driving(state),
                };
                (0.0, 0.0)
            }
            Mode::Driving(State::AutoPosition) => self.auto_position(),
            Mode::Driving(_) => self.speeds,
        };
        let turn = turn.clamp(-TURN_MAX, TURN_MAX);
        let (way, turn) = (speed * seconds, turn * seconds);
        self.truth = self.truth.moved(way, turn);
        let Errors {
            way: e, turn: t, ..
        } = self.errors;
        self.odometry = self.odometry.moved(way * (1.0 + e), turn * (1.0 + t));
        self.driven += way.abs();
        let room = world.clearance([self.truth.x, self.truth.y]) - RADIUS_M;
        self.room = self.room.min(room);
    }

    fn auto_position(&mut self) -> (f64, f64) {
        let Some(goal) = self.goal else {
            return (0.0, 0.0);
        };
        let (any, goal) = (goal.alpha == ANY_HEADING, At::of(goal));
        let (dx, dy) = (goal.x - self.odometry.x, goal.y - self.odometry.y);
        let far = libm::hypot(dx, dy);
        let aside = wrapped(libm::atan2(dy, dx) - self.odometry.heading);
        if far < TOLERANCE {
            self.stage = 2;
        }
        if self.stage == 0 && aside.abs() < 0.02 {
            self.stage = 1;
        }
        let turned = wrapped(goal.heading - self.odometry.heading);
        match self.stage {
            0 => (0.0, 10.0 * aside),
            1 => (
                (2.0 * far).min(SPEED_MAX) * libm::cos(aside).max(0.0),
                8.0 * aside,
            ),
            _ if any || turned.abs() < 0.01 => {
                self.mode = Mode::Switching(SWITCH_S, State::Off);
                (0.0, 0.0)
            }
            _ => (0.0, 10.0 * turned),
        }
    }

    pub(crate) fn tell(&mut self, world: &World, timestamp_ms: u32) -> Telemetry {
        let sees = core::mem::take(&mut self.sees);
        let lines = sees.then(|| self.look(world).into_iter().collect());
        Telemetry {
            timestamp_ms,
            state: Some(self.state()),
            odometry: Some(Odometry {
                pose: self.odometry.wire(),
                ..Odometry::default()
            }),
            lines,
            ..Telemetry::default()
        }
    }

    /// Lines in the robot's frame, millimetres.
    pub(crate) fn look(&mut self, world: &World) -> Vec<Line> {
        let mut points = Vec::new();
        let turned = if self.is_dizzy {
            self.chance.between(0.4, 5.8)
        } else {
            0.0
        };
        for degree in 0..360 {
            let angle = f64::from(degree).to_radians();
            let At { x, y, heading } = self.truth;
            let range =
                world.ray([x, y], heading + angle) + self.errors.range * self.chance.normal();
            if (0.15..5.0).contains(&range) && !self.is_blind {
                let (sin, cos) = libm::sincos(angle + turned);
                points.push([range * cos, range * sin]);
            }
        }
        let end = |[x, y]: [f64; 2]| {
            At {
                x: x * 1e3,
                y: y * 1e3,
                heading: 0.0,
            }
            .wire()
        };
        let lines = lines(&points).into_iter();
        lines
            .map(|(start, stop)| Line {
                start: end(start),
                end: end(stop),
            })
            .collect()
    }
}
