//! A small world of straight walls, a differential drive and an XV-11, for tests and benches of the
//! mapper. It knows the true pose; the mapper receives only data that the wire carries.

use firmware_core::odometry::{Odometry, WheelGeometry};
use firmware_core::pose::{Point, Pose};
use firmware_core::scan::{Defects, Mounting, Scan, TurnAssembler, WeakReadings};
use protocols::Instant;
use protocols::xv11::{Frame, RawReading, Reading, SpeedWord};

use core::f64::consts::{FRAC_PI_2, PI, TAU};
use core::time::Duration;

/// The rescue robot's drive according to the seed report.
pub(crate) const DRIVE: WheelGeometry = WheelGeometry {
    wheel_radius_mm: 26.0,
    axle_mm: 260.0,
    ticks_per_turn: 360,
    ticks_per_second_max: 900,
};

/// Its lidar: sensor degree k points k - 90 degrees to the left of straight ahead.
pub(crate) const MOUNTING: Mounting = Mounting {
    position: Point::new(0.0, 0.0),
    first_bearing: -core::f32::consts::FRAC_PI_2,
    distance_min_mm: 100,
    distance_max_mm: 6000,
    weak: WeakReadings::Use,
    delay: Duration::ZERO,
};

/// Random numbers of the world: xorshift64*, Box-Muller.
#[derive(Clone)]
pub(crate) struct Dice(u64);

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn gauss(&mut self) -> f64 {
        let (a, b) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * libm::log(a)).sqrt() * libm::cos(TAU * b)
    }
}

/// A wall from one end to the other, in millimetres.
pub(crate) type Wall = [f64; 4];

/// Four walls of a box.
pub(crate) fn boxed(x0: f64, y0: f64, x1: f64, y1: f64) -> [Wall; 4] {
    [
        [x0, y0, x1, y0],
        [x1, y0, x1, y1],
        [x1, y1, x0, y1],
        [x0, y1, x0, y0],
    ]
}

/// A furnished flat of two rooms inside 3 m x 3 m.
pub(crate) fn flat() -> Vec<Wall> {
    let mut walls = Vec::new();
    walls.extend(boxed(100.0, 100.0, 2900.0, 2900.0));
    // The wall between the rooms, 80 mm thick, with a door 700 mm wide.
    walls.extend(boxed(1560.0, 100.0, 1640.0, 1200.0));
    walls.extend(boxed(1560.0, 1900.0, 1640.0, 2900.0));
    // A cupboard, a bed, a table's legs, a box.
    walls.extend(boxed(100.0, 2300.0, 500.0, 2900.0));
    walls.extend(boxed(2300.0, 100.0, 2900.0, 900.0));
    for (x, y) in [
        (2150.0, 2250.0),
        (2550.0, 2250.0),
        (2150.0, 2600.0),
        (2550.0, 2600.0),
    ] {
        walls.extend(boxed(x, y, x + 40.0, y + 40.0));
    }
    walls.extend(boxed(700.0, 480.0, 900.0, 640.0));
    walls
}

/// Way-points that visit both rooms of [`flat`] and return.
pub(crate) const FLAT_TOUR: [[f64; 2]; 8] = [
    [1000.0, 1550.0],
    [1900.0, 1550.0],
    [2600.0, 1500.0],
    [1900.0, 2500.0],
    [1900.0, 1550.0],
    [1000.0, 1550.0],
    [1000.0, 2500.0],
    [500.0, 1000.0],
];

/// Distance along a ray to the nearest wall.
pub(crate) fn cast(walls: &[Wall], x: f64, y: f64, angle: f64) -> f64 {
    let (dx, dy) = (libm::cos(angle), libm::sin(angle));
    let mut nearest = f64::INFINITY;
    for [x0, y0, x1, y1] in walls {
        let (ex, ey) = (x1 - x0, y1 - y0);
        let across = dx * ey - dy * ex;
        if across == 0.0 {
            continue;
        }
        let (ox, oy) = (x0 - x, y0 - y);
        let along_ray = (ox * ey - oy * ex) / across;
        let along_wall = (ox * dy - oy * dx) / across;
        if along_ray > 0.0 && along_ray < nearest && (0.0..=1.0).contains(&along_wall) {
            nearest = along_ray;
        }
    }
    nearest
}

/// Deviations of the world from the ideal.
#[derive(Clone, Copy)]
pub(crate) struct Imperfection {
    /// Range noise as a multiple of the XV-11's: sigma = max(0.3, 2e-6 d^2) mm.
    pub(crate) range_noise: f64,
    /// Standard deviation of slip per wheel and motor step of 40 ms.
    pub(crate) slip_noise: f64,
    /// Constant slip of each wheel.
    pub(crate) slip: [f64; 2],
    /// Maximum distance with a return.
    pub(crate) range_max_mm: f64,
}

impl Imperfection {
    pub(crate) const REAL: Self = Self {
        range_noise: 1.0,
        slip_noise: 0.02,
        slip: [0.01, 0.015],
        range_max_mm: 6000.0,
    };
}

/// The true state and the robot's sensors; a step is a turn of the lidar.
#[derive(Clone)]
pub(crate) struct World {
    pub(crate) walls: Vec<Wall>,
    /// x, y in millimetres, heading in radians.
    pub(crate) body: [f64; 3],
    /// Commanded wheel speeds, ticks per 40 ms.
    pub(crate) command: [f64; 2],
    pub(crate) imperfection: Imperfection,
    pub(crate) odometry: Odometry,
    pub(crate) assembler: TurnAssembler,
    /// Odometry readings per turn.
    pub(crate) readings_per_turn: usize,
    /// Displacement per millisecond while a person pushes the body, for the milliseconds of a turn.
    pub(crate) push: [f64; 3],
    dice: Dice,
    wheels: [f64; 2],
    slip: [f64; 2],
    ticks: [f64; 2],
    nanos: u64,
}

/// Beams of a turn.
const BEAMS: usize = 360;
const TURN_NS: u64 = 200_000_000;

impl World {
    pub(crate) fn new(walls: Vec<Wall>, body: [f64; 3], seed: u64) -> Self {
        Self {
            walls,
            body,
            command: [0.0; 2],
            imperfection: Imperfection::REAL,
            odometry: Odometry::new(DRIVE),
            assembler: TurnAssembler::with_defects(MOUNTING, Defects::default()),
            readings_per_turn: 1,
            push: [0.0; 3],
            dice: Dice::new(seed),
            wheels: [0.0; 2],
            slip: [0.0; 2],
            ticks: [0.0; 2],
            nanos: 0,
        }
    }

    pub(crate) fn truth(&self) -> Pose {
        Pose::new(
            self.body[0] as f32,
            self.body[1] as f32,
            self.body[2] as f32,
        )
    }

    pub(crate) fn wheel_speeds(&self) -> [i16; 2] {
        self.wheels.map(|ticks| ticks.round() as i16)
    }

    pub(crate) fn now(&self) -> Instant {
        Instant::from_nanos(self.nanos)
    }

    /// One turn of the lidar; returns whether it was completed (always, unless packets are lost).
    pub(crate) fn turn(&mut self) -> bool {
        if self.nanos == 0 {
            self.read_wheels();
        }
        let step = TURN_NS as f64 / BEAMS as f64 / 1e9;
        let started = self.nanos;
        let mut ended = false;
        let mut readings = [RawReading([0; 4]); 4];
        for beam in 0..BEAMS {
            self.drive(step, beam);
            readings[beam % 4] = RawReading::from(self.measure(beam));
            self.nanos = started + TURN_NS * (beam as u64 + 1) / BEAMS as u64;
            if (beam + 1).is_multiple_of(BEAMS / self.readings_per_turn) {
                self.read_wheels();
            }
            if beam % 4 == 3 {
                let packet = Frame::new((beam / 4) as u8, SpeedWord(300 * 64), readings);
                ended |= self.assembler.push(self.now(), &packet).is_some();
            }
        }
        ended
    }

    pub(crate) fn scan(&self) -> Scan {
        Scan::deskewed(self.assembler.turn(), &MOUNTING, &self.odometry)
    }

    fn read_wheels(&mut self) {
        self.odometry
            .update(self.now(), self.ticks.map(|ticks| ticks.floor() as i32));
    }

    fn drive(&mut self, step: f64, beam: usize) {
        let lag = 1.0 - libm::exp(-step / 0.06);
        let mut travel = [0.0; 2];
        for (wheel, travel) in travel.iter_mut().enumerate() {
            if beam.is_multiple_of(72) {
                let noise = self.imperfection.slip_noise * self.dice.gauss();
                self.slip[wheel] = self.imperfection.slip[wheel] + noise;
            }
            self.wheels[wheel] += (self.command[wheel] - self.wheels[wheel]) * lag;
            let turned = self.wheels[wheel] / 0.040 * step;
            self.ticks[wheel] += turned;
            *travel = turned * TAU * 26.0 / 360.0 * (1.0 - self.slip[wheel]);
        }
        let turn = (travel[1] - travel[0]) / 260.0;
        let path = (travel[0] + travel[1]) / 2.0;
        let heading = self.body[2] + turn / 2.0;
        self.body[0] += path * libm::cos(heading) + self.push[0] * step * 1e3;
        self.body[1] += path * libm::sin(heading) + self.push[1] * step * 1e3;
        self.body[2] += turn + self.push[2] * step * 1e3;
    }

    fn measure(&mut self, beam: usize) -> Reading {
        let [x, y, heading] = self.body;
        let distance = cast(
            &self.walls,
            x,
            y,
            heading + (beam as f64).to_radians() - FRAC_PI_2,
        );
        let sigma = (2e-6 * distance * distance).max(0.3) * self.imperfection.range_noise;
        let noise = self.dice.gauss();
        if distance > self.imperfection.range_max_mm || distance < 120.0 {
            return Reading::Invalid {
                code: 0x35,
                strength: 0,
            };
        }
        let distance_mm = (distance + sigma * noise).round().clamp(1.0, 16383.0) as u16;
        Reading::Range {
            distance_mm,
            strength: 200,
            weak: false,
        }
    }

    /// Steers towards a point as the rescue robot does: 20 ticks minus or plus a third of the
    /// bearing error in degrees. Returns whether the point is near.
    pub(crate) fn steer_to(&mut self, [x, y]: [f64; 2]) -> bool {
        let (dx, dy) = (x - self.body[0], y - self.body[1]);
        let error = libm::atan2(dy, dx) - self.body[2];
        let error = (error - TAU * ((error + PI) / TAU).floor()).to_degrees();
        let command = [20.0 - error / 3.0, 20.0 + error / 3.0];
        self.command = command.map(|ticks| ticks.trunc().clamp(-20.0, 20.0));
        libm::hypot(dx, dy) < 150.0
    }
}
