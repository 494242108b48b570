//! A robot in a world without wires: a lidar that measures while the robot moves, wheel counters,
//! and a mapper. The lab can disturb the assembly of scans, which the program does not allow.

use core::time::Duration;
use std::path::Path;

use emulators::rng::Rng;
use emulators::world::{BodyConfig, Drive, Point, Pose, Scene, Shape, Wheel, World};
use firmware_core::Work;
use firmware_core::grid::SIDE;
use firmware_core::odometry::Odometry;
use firmware_core::pose::Pose as Believed;
use firmware_core::robots::rescue::Config;
use firmware_core::scan::{BEAMS, Scan, Turn};
use firmware_core::slam::{Mapper, Outcome, Settings};
use protocols::Instant;

use engine::rig::cpu::CpuModel;
use engine::robots::instruments::in_metres;
use engine::run::score::PosePair;
use engine::scenario::Scenario;

/// Method of making scans from turns of the lidar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sense {
    /// The correct method: motion within a turn is removed.
    Deskewed,
    /// The motion within a turn is kept.
    Raw,
    /// The mapper reads the beams when it wakes: the newest ones from this turn, the others from
    /// the turn before. Its clock and the lidar's clock differ by one per cent.
    Unsynchronised,
}

/// Beams by which the read position of an unsynchronised mapper shifts each turn.
const DRIFT_BEAMS: usize = 4;
/// Speed of a wheel at one tick per 40 ms, and the maximum driving speed, ticks per 40 ms.
const TICK_M_S: f64 = 0.000_453_79 / 0.040;
const CRUISE_TICKS: f64 = 20.0;
const TURN: Duration = Duration::from_millis(200);

/// The robot, its world, and its believed pose and map.
pub(super) struct Lab<const W: usize = SIDE, const H: usize = SIDE> {
    pub(super) world: World,
    pub(super) mapper: Box<Mapper<W, H>>,
    pub(super) sense: Sense,
    /// Range of the lidar, metres.
    pub(super) reach_m: f64,
    /// Believed poses with the true ones.
    pub(super) pairs: Vec<PosePair>,
    wheels: Odometry,
    /// Pose from odometry alone.
    reckoned: Believed,
    noise: Rng,
    before: [u16; BEAMS],
    looks_at: usize,
}

/// The furnished flat of the built-in mission.
pub(super) fn flat(body: BodyConfig, seed: u64) -> World {
    let text = include_str!("../../scenarios/rescue-flat.toml").to_owned();
    let (scenario, source) = Scenario::parse(Path::new("rescue-flat.toml"), text)
        .expect("the built-in mission is sound");
    let world = scenario
        .world
        .build(seed, None, &source)
        .expect("it is driven daily");
    World::new(world.scene().clone(), body, world.pose(), seed).expect("the same place")
}

/// A world with walls from point to point, and a robot between them.
pub(super) fn walls(shapes: &[[f64; 4]], body: BodyConfig, start: Pose, seed: u64) -> World {
    let shapes = shapes.iter().map(|&[x0, y0, x1, y1]| Shape::Wall {
        from: Point::new(x0, y0),
        to: Point::new(x1, y1),
    });
    let scene = Scene::new(shapes, Vec::new()).expect("finite walls");
    World::new(scene, body, start, seed).expect("room for the robot")
}

impl<const W: usize, const H: usize> Lab<W, H> {
    /// A robot that knows its start pose.
    pub(super) fn new(world: World, settings: Settings) -> Self {
        let start = believed(world.pose());
        let mut wheels = Odometry::new(Config::DEFAULT.wheels);
        wheels.update(Instant::ZERO, [0, 0]);
        Self {
            mapper: Box::new(Mapper::new(Settings { start, ..settings })),
            sense: Sense::Deskewed,
            reach_m: 6.0,
            pairs: Vec::new(),
            wheels,
            reckoned: start,
            noise: Rng::stream(1, "museum.range"),
            before: [0; BEAMS],
            looks_at: 0,
            world,
        }
    }

    /// Pose from odometry alone.
    pub(super) const fn reckoned(&self) -> Believed {
        self.reckoned
    }

    /// Distance of the robot from a pose, millimetres.
    pub(super) fn off_mm(&self, believed: Believed) -> f64 {
        pair(self.world.now(), self.world.pose(), believed).error_mm()
    }

    /// One turn of the lidar.
    pub(super) fn scan(&mut self) -> Scan {
        let start = self.world.now();
        let mut turn = Turn {
            distances_mm: [0; BEAMS],
            start,
            end: start + TURN,
            packets: 90,
            gap: 0,
        };
        for (beam, slot) in (0..360_u16).zip(&mut turn.distances_mm) {
            let at = start + TURN * u32::from(beam) / 360;
            self.world.advance(at);
            let pose = self.world.pose();
            let angle = pose.theta + (f64::from(beam) - 90.0).to_radians();
            let noise = self.noise.gauss();
            let hit = self
                .world
                .cast_ray_at(at, pose.point(), angle, self.reach_m);
            *slot = hit.map_or(0, |hit| millimetres(hit.distance * 1000.0, noise));
        }
        self.world.advance(turn.end);
        let ticks = [Wheel::Left, Wheel::Right].map(|wheel| self.world.encoder_ticks(wheel));
        let ticks = ticks.map(|count| i32::try_from(count).expect("minutes of driving"));
        let step = self.wheels.update(turn.end, ticks);
        self.reckoned = self.reckoned.then(step);
        self.mapper.predict(step);
        self.made_of(turn)
    }

    fn made_of(&mut self, mut turn: Turn) -> Scan {
        let mounting = Config::DEFAULT.mounting;
        match self.sense {
            Sense::Deskewed => Scan::deskewed(&turn, &mounting, &self.wheels),
            Sense::Raw => Scan::raw(&turn, &mounting),
            Sense::Unsynchronised => {
                let newest = turn.distances_mm;
                self.looks_at = (self.looks_at + DRIFT_BEAMS) % BEAMS;
                turn.distances_mm[self.looks_at..].copy_from_slice(&self.before[self.looks_at..]);
                self.before = newest;
                Scan::raw(&turn, &mounting)
            }
        }
    }

    /// One turn of the lidar, matched and drawn.
    pub(super) fn step(&mut self) -> Outcome {
        let scan = self.scan();
        let outcome = self.mapper.integrate(&scan, self.wheel_ticks());
        self.mapper.search_time(CpuModel::STM32F4.cost(Work {
            scans: 1,
            tries: outcome.tries,
            points: outcome.points,
        }));
        let (now, truth) = (self.world.now(), self.world.pose());
        self.pairs.push(pair(now, truth, outcome.pose));
        outcome
    }

    pub(super) fn steps(&mut self, count: u32) {
        (0..count).for_each(|_| {
            self.step();
        });
    }

    /// Speeds of the wheels as the base reports them.
    fn wheel_ticks(&self) -> [i16; 2] {
        [Wheel::Left, Wheel::Right].map(|wheel| {
            let ticks = self.world.wheel_speed(wheel) / TICK_M_S;
            #[expect(clippy::cast_possible_truncation, reason = "31 ticks at most")]
            let ticks = ticks.round() as i16;
            ticks
        })
    }

    /// Sets the speeds of the wheels, in ticks per 40 ms.
    pub(super) fn drive(&mut self, ticks: [f64; 2]) {
        let body = self.world.body().clone();
        let dead = f64::from(body.dead_zone_drive);
        for (wheel, ticks) in [Wheel::Left, Wheel::Right].into_iter().zip(ticks) {
            let part = ticks * TICK_M_S / body.full_speed_m_s;
            let power = part.abs().mul_add(255.0 - dead, dead).copysign(part);
            #[expect(clippy::cast_possible_truncation, reason = "clamped")]
            let power = power.clamp(-255.0, 255.0) as i16;
            self.world
                .set_drive(wheel, Drive::Power(if ticks == 0.0 { 0 } else { power }));
        }
    }

    /// Steers towards a position by the robot's true pose; returns whether it has arrived.
    pub(super) fn steer_to(&mut self, [x, y]: [f64; 2]) -> bool {
        let pose = self.world.pose();
        let (dx, dy) = (x - pose.x, y - pose.y);
        let error = emulators::world::wrap_angle(libm::atan2(dy, dx) - pose.theta).to_degrees();
        let wheel = |ticks: f64| ticks.clamp(-CRUISE_TICKS, CRUISE_TICKS);
        self.drive([
            wheel(CRUISE_TICKS - error / 3.0),
            wheel(CRUISE_TICKS + error / 3.0),
        ]);
        libm::hypot(dx, dy) < 0.15
    }

    /// Drives round through these positions for a number of turns of the lidar.
    pub(super) fn rounds(&mut self, places: &[[f64; 2]], turns: u32) {
        let mut next = 0;
        for _ in 0..turns {
            if self.steer_to(places[next]) {
                next = (next + 1) % places.len();
            }
            self.step();
        }
    }
}

/// A distance with the lidar's noise; below the minimum range there is no return.
fn millimetres(distance_mm: f64, noise: f64) -> u16 {
    let sigma = (2e-6 * distance_mm * distance_mm).max(0.3);
    let measured = (distance_mm + noise * sigma).round();
    if distance_mm < 120.0 {
        return 0;
    }
    #[expect(clippy::cast_possible_truncation, reason = "the reach is 6 m")]
    #[expect(clippy::cast_sign_loss, reason = "the reach is 6 m")]
    let measured = measured.clamp(1.0, 16_383.0) as u16;
    measured
}

/// Converts a pose of the world to the robot's coordinates.
pub(super) fn believed(pose: Pose) -> Believed {
    #[expect(clippy::cast_possible_truncation, reason = "metres of a room")]
    let [x, y, heading] = [pose.x * 1000.0, pose.y * 1000.0, pose.theta].map(|v| v as f32);
    Believed::new(x, y, heading)
}

/// A program's pose with the true one.
fn pair(at: Instant, truth: Pose, believed: Believed) -> PosePair {
    PosePair {
        at,
        truth,
        estimate: in_metres(believed),
    }
}
