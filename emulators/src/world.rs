//! Ground truth: solid objects, the pose of the robot's body, the rotation of its wheels.
//!
//! Physics runs in steps of 1 ms counted from the start of the run. The conditions of a step are
//! fixed at its beginning, and every figure within the step follows from them exactly. So no result
//! depends on when or how often [`World::advance`] is called. A new drive takes effect at the next
//! beginning, at most 1 ms later.
//!
//! | module | is |
//! |---|---|
//! | [`geometry`] | points, poses, ray against wall and circle |
//! | [`scene`] | walls, furniture, obstacles; the ray cast |
//! | [`path`] | how obstacles move |
//! | [`occupancy`] | floor plans from occupancy images |
//! | `team` | several robots, each with a world of its own |
//! | [`body`] | drive trains: motors, wheels, steering, slip; colliding parts of a body |

pub mod body;
mod bundle;
mod contact;
mod error;
pub mod geometry;
mod glide;
mod grid;
mod inertia;
pub mod occupancy;
pub mod path;
pub mod scene;
mod sectors;
mod team;

use core::time::Duration;

use protocols::Instant;

pub use body::{
    Ackermann, AckermannConfig, Actuator, ActuatorKind, BodyConfig, BodyError, Chassis, Command,
    CommandError, Differential, Drive, Encoder, Floor, Footprint, FootprintError, Outline,
    Reversing, Select, SteeringLaw, Velocity, Wheel,
};
use body::{Motion, STEP_NANOS, STEP_S};
pub use contact::Contact;
use contact::{Bumper, Push, REACH_M};
pub use error::WorldError;
pub use geometry::{Bounds, Point, Pose, wrap_angle};
use glide::glide;
pub use occupancy::OccupancyImage;
pub use path::{Path, Repeat, Waypoint};
pub use scene::{
    AMBIENT_C, Cause, Cone, Fixture, FloorLine, FloorLineError, HeatPlate, HeatPlateError, Hit,
    Obstacle, PRIMITIVES_MAX, Part, Row, Scene, SceneError, Shape, SlickFloor, SlickFloorError,
};

/// Number of steps whose motion is stored: a lidar's packet holds beams of the last few
/// milliseconds, one whole revolution lasts 200 ms.
const TRAIL_STEPS: usize = 256;

/// The scene, one robot body in it, and the time up to which both are known.
#[derive(Clone, Debug)]
pub struct World {
    scene: Scene,
    chassis: Box<dyn Chassis>,
    /// See [`World::body`].
    stand_in: BodyConfig,
    /// Indices of the motors and of the encoders named `left` and `right`.
    motors: [Option<usize>; 2],
    wheels: [Option<usize>; 2],
    bumper: Bumper,
    push: Push,
    /// Motion of the body by its wheels alone in the previous step.
    rolled: Velocity,
    now: Instant,
    /// The step that begins next. The one before it is in progress, or ends right `now`.
    next_step: u64,
    /// Motion of step `n` at index `n % TRAIL_STEPS`.
    trail: Vec<Motion>,
}

impl World {
    /// A round body with two driven wheels at rest at `start`, brakes on. The noise of the floor
    /// follows from `seed`.
    ///
    /// # Errors
    /// If a figure of the body is out of range, the start is not finite or in a wall.
    pub fn new(
        scene: Scene,
        config: BodyConfig,
        start: Pose,
        seed: u64,
    ) -> Result<Self, WorldError> {
        let chassis = Differential::new(config, seed).map_err(WorldError::Body)?;
        Self::with_chassis(scene, Box::new(chassis), start)
    }

    /// A world with a body of any kind that has not moved yet. `start` is the pose of the body's
    /// reference point.
    ///
    /// # Errors
    /// If the start is not finite or in a wall.
    pub fn with_chassis(
        scene: Scene,
        chassis: Box<dyn Chassis>,
        start: Pose,
    ) -> Result<Self, WorldError> {
        if !start.is_finite() {
            return Err(WorldError::StartNotFinite);
        }
        let bumper = Bumper::new(&scene, chassis.footprint().clone());
        let clearance_m = bumper.clearance(&scene, Instant::ZERO, start, REACH_M);
        if clearance_m < 0.0 {
            return Err(WorldError::StartBlocked {
                start,
                overlap_m: -clearance_m,
            });
        }
        let motor = |wheel: Wheel| {
            let is_it = |actuator: &Actuator| {
                actuator.kind == ActuatorKind::Motor && actuator.name == wheel.name()
            };
            chassis.actuators().iter().position(is_it)
        };
        let encoder = |wheel: Wheel| Select::Name(wheel.name()).find(names(chassis.encoders()));
        Ok(Self {
            scene,
            stand_in: BodyConfig {
                radius_m: chassis.footprint().reach_m(),
                ..BodyConfig::default()
            },
            motors: Wheel::ALL.map(motor),
            wheels: Wheel::ALL.map(encoder),
            bumper,
            chassis,
            push: Push::default(),
            rolled: Velocity::default(),
            now: Instant::ZERO,
            next_step: 0,
            trail: vec![Motion::rest(start); TRAIL_STEPS],
        })
    }

    /// Advances everything to `now`; an earlier time changes nothing.
    pub fn advance(&mut self, now: Instant) {
        if now <= self.now {
            return;
        }
        while self.next_step * STEP_NANOS < now.as_nanos() {
            self.begin_step();
        }
        self.now = now;
    }

    /// The time up to which the world was advanced.
    pub fn now(&self) -> Instant {
        self.now
    }

    /// The solid shapes.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The drive train.
    pub fn chassis(&self) -> &dyn Chassis {
        &*self.chassis
    }

    /// Outline of the body for collisions.
    pub fn footprint(&self) -> &Footprint {
        self.chassis.footprint()
    }

    /// The figures of a differential drive. For every other chassis a stand-in: the default figures
    /// with the radius of the circle around the footprint. To be removed once its callers use
    /// [`footprint`](Self::footprint) and [`actuators`](Self::actuators) instead.
    pub fn body(&self) -> &BodyConfig {
        self.chassis.body().unwrap_or(&self.stand_in)
    }

    /// Pose of the body.
    pub fn pose(&self) -> Pose {
        self.pose_at(self.now)
    }

    /// Pose of the body at `at`, up to 250 ms in the past. Farther back it is the oldest known
    /// pose, in the future the present one.
    pub fn pose_at(&self, at: Instant) -> Pose {
        let at = at.min(self.now).as_nanos();
        let newest = self.next_step.saturating_sub(1);
        let oldest = self.next_step.saturating_sub(TRAIL_STEPS as u64);
        let step = (at / STEP_NANOS).clamp(oldest, newest);
        let after = Instant::from_nanos(at.saturating_sub(step * STEP_NANOS)).as_secs_f64();
        let pose = self.motion(step).pose(after);
        Pose {
            theta: wrap_angle(pose.theta),
            ..pose
        }
    }

    /// Nearest surface on a ray from `from` now, up to `max_range` metres away. `angle` is in the
    /// world's frame. The ray ignores the robot's own body.
    pub fn cast_ray(&self, from: Point, angle: f64, max_range: f64) -> Option<Hit> {
        self.scene.cast_ray(self.now, from, angle, max_range)
    }

    /// As [`cast_ray`](Self::cast_ray), with the obstacles at their positions at the time `at`: for
    /// a beam measured a little earlier.
    pub fn cast_ray_at(&self, at: Instant, from: Point, angle: f64, max_range: f64) -> Option<Hit> {
        self.scene.cast_ray(at, from, angle, max_range)
    }

    /// Actuators of the body.
    pub fn actuators(&self) -> &[Actuator] {
        self.chassis.actuators()
    }

    /// Sets an actuator from the next step on, by name or by its index in
    /// [`actuators`](Self::actuators). A value beyond its range becomes the end of the range.
    ///
    /// # Errors
    /// If the actuator does not exist, does not accept the command, or the figure is not finite.
    /// Nothing changes then.
    pub fn actuate<'a>(
        &mut self,
        actuator: impl Into<Select<'a>>,
        command: Command,
    ) -> Result<(), CommandError> {
        let wanted = actuator.into();
        let known = self.chassis.actuators();
        let Some(index) = wanted.find(known.iter().map(|known| known.name.as_str())) else {
            return Err(CommandError::UnknownActuator {
                wanted: wanted.to_string(),
                known: known.iter().map(|known| known.name.clone()).collect(),
            });
        };
        let command = known[index].admit(command)?;
        self.chassis.actuate(index, command);
        Ok(())
    }

    /// Encoders of the body.
    pub fn encoders(&self) -> &[Encoder] {
        self.chassis.encoders()
    }

    /// Counts of an encoder since the start of the run, by name or by its index in
    /// [`encoders`](Self::encoders); `None` if it does not exist.
    pub fn encoder<'a>(&self, encoder: impl Into<Select<'a>>) -> Option<i64> {
        let index = encoder.into().find(names(self.chassis.encoders()))?;
        Some(self.chassis.count(index, self.elapsed_s()))
    }

    /// Current speed of an encoder's axis, metres of rim per second; `None` if the encoder does not
    /// exist.
    pub fn axis_speed<'a>(&self, encoder: impl Into<Select<'a>>) -> Option<f64> {
        let index = encoder.into().find(names(self.chassis.encoders()))?;
        Some(self.chassis.axis_speed(index))
    }

    /// Sets the motor driver's command for one wheel from now on, to the motor named `left` or
    /// `right`. A chassis without such a motor ignores it.
    pub fn set_drive(&mut self, wheel: Wheel, drive: Drive) {
        if let Some(motor) = self.motors[wheel as usize] {
            self.chassis.actuate(motor, drive.into());
        }
    }

    /// The motor driver's command for one wheel. For a motor with a speed regulator: the same part
    /// of full drive. Without such a motor: brake.
    pub fn drive(&self, wheel: Wheel) -> Drive {
        let Some(motor) = self.motors[wheel as usize] else {
            return Drive::Brake;
        };
        let [_, full] = self.chassis.actuators()[motor].range;
        self.chassis.command(motor).as_drive(full)
    }

    /// Encoder counts of one wheel since the start of the run; forward counts up. 0 if the chassis
    /// has no encoder named `left` or `right`.
    pub fn encoder_ticks(&self, wheel: Wheel) -> i64 {
        let encoder = self.wheels[wheel as usize];
        encoder.map_or(0, |encoder| self.chassis.count(encoder, self.elapsed_s()))
    }

    /// Speed of one wheel's rim now, m/s; forward is positive. 0 if the chassis has no encoder
    /// named `left` or `right`.
    pub fn wheel_speed(&self, wheel: Wheel) -> f64 {
        let encoder = self.wheels[wheel as usize];
        encoder.map_or(0.0, |encoder| self.chassis.axis_speed(encoder))
    }

    /// Speed of the body over the floor now, m/s, whatever moves it.
    pub fn speed(&self) -> f64 {
        self.current().floor_speed()
    }

    /// Turn rate of the body now, rad/s, counter-clockwise.
    pub fn turn_rate(&self) -> f64 {
        self.current().turn
    }

    /// Whether the body moves or turns now.
    pub fn is_moving(&self) -> bool {
        let motion = self.current();
        motion.speed != 0.0 || motion.turn != 0.0 || motion.drift != Point::default()
    }

    /// Free distance between the body and the nearest surface now, metres, capped at 1 m; negative
    /// when they overlap.
    pub fn clearance(&self) -> f64 {
        self.clearance_up_to(REACH_M)
    }

    /// As [`clearance`](Self::clearance), limited to `limit_m`: a smaller limit needs fewer
    /// surfaces.
    pub fn clearance_up_to(&self, limit_m: f64) -> f64 {
        let limit_m = limit_m.min(REACH_M);
        self.bumper
            .clearance(&self.scene, self.now, self.pose(), limit_m)
    }

    /// A push of a person: the body moves by (`dx`, `dy`) metres in world axes and turns by
    /// `dtheta` radians, evenly `over` this time. The push adds to the wheels' motion, and the
    /// wheels do not count it. The limits are 5 m/s and 20 rad/s: a shorter time is stretched. The
    /// rest of an earlier push is added. Walls hold the robot all the same.
    ///
    /// # Panics
    /// If a figure is not finite.
    pub fn push(&mut self, dx: f64, dy: f64, dtheta: f64, over: Duration) {
        self.push.add(Pose::new(dx, dy, dtheta), over);
    }

    /// Puts the robot elsewhere at once; its wheels continue as before.
    ///
    /// # Panics
    /// If a coordinate is not finite.
    pub fn teleport(&mut self, pose: Pose) {
        assert!(pose.is_finite(), "teleport to a pose that is not finite");
        let after = self.elapsed_s();
        let newest = self.next_step.saturating_sub(1);
        let motion = &mut self.trail[index(newest)];
        motion.start = Pose {
            theta: pose.theta - motion.turn * after,
            ..Pose::default()
        };
        let gone = motion.pose(after);
        (motion.start.x, motion.start.y) = (pose.x - gone.x, pose.y - gone.y);
        self.bumper.forget();
    }

    /// Collisions since the last call, oldest first: one entry per collision, however long the
    /// robot leans on the wall afterwards. Only the first thousand or so are kept.
    pub fn take_contacts(&mut self) -> Vec<Contact> {
        self.bumper.take_contacts()
    }

    /// Whether the body touches a surface that it has met and has not left since.
    pub fn is_touching(&self) -> bool {
        self.bumper.is_touching()
    }

    /// Collisions since the start of the run, including any not kept.
    pub fn contact_count(&self) -> u64 {
        self.bumper.count()
    }

    fn begin_step(&mut self) {
        let step = self.next_step;
        let began = Instant::from_nanos(step * STEP_NANOS);
        let mut start = match step.checked_sub(1) {
            Some(previous) => self.motion(previous).pose(STEP_S),
            None => self.motion(0).start,
        };
        start.theta = wrap_angle(start.theta);
        let wanted = self.chassis.begin_step(step);
        assert!(
            wanted.speed_m_s.is_finite() && wanted.turn_rad_s.is_finite(),
            "the speed and turn rate of a chassis must be finite"
        );
        let Velocity {
            speed_m_s: speed,
            turn_rad_s: turn,
        } = self.on_floor(start.point(), wanted);
        let (drift, twist) = self.push.step();
        let wanted = Motion {
            start,
            speed,
            turn: turn + twist,
            drift,
        };
        let motion = self.bumper.constrain(&self.scene, began, wanted);
        self.rolled = Velocity {
            speed_m_s: motion.speed,
            turn_rad_s: motion.turn - twist,
        };
        self.trail[index(step)] = motion;
        self.next_step = step + 1;
    }

    /// Velocity at `place` from the wheels' `wanted` velocity and the floor's grip.
    fn on_floor(&self, place: Point, wanted: Velocity) -> Velocity {
        match self.scene.grip_at(place) {
            Some(grip) => glide(self.rolled, wanted, grip, self.footprint().reach_m()),
            None => wanted,
        }
    }

    fn current(&self) -> &Motion {
        self.motion(self.next_step.saturating_sub(1))
    }

    fn motion(&self, step: u64) -> &Motion {
        &self.trail[index(step)]
    }

    fn elapsed_s(&self) -> f64 {
        let began = self.next_step.saturating_sub(1) * STEP_NANOS;
        Instant::from_nanos(self.now.as_nanos().saturating_sub(began)).as_secs_f64()
    }
}

fn names(encoders: &[Encoder]) -> impl ExactSizeIterator<Item = &str> {
    encoders.iter().map(|encoder| encoder.name.as_str())
}

fn index(step: u64) -> usize {
    usize::try_from(step % TRAIL_STEPS as u64).expect("below TRAIL_STEPS")
}

#[cfg(test)]
mod tests;
