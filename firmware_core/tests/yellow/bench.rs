//! A minimal two-wheeled robot in a room, the hardware of its chip, and a PC: enough to close the
//! loop around the program without another crate. The emulated devices are in other crates.

use core::f64::consts::TAU;
use core::time::Duration;

use firmware_core::robots::yellow::{Config, Yellow};
use firmware_core::{Inspect, Master};
use protocols::peripherals::{DUTY_MAX, Outputs, OutputsDecoder, OutputsFormat, Sample};
use protocols::telemetry::message::{Pose, State, Telecommand, Telemetry, Velocities};
use protocols::{Decode, Instant, telemetry};

use crate::lidar::{Dice, Lidar};

pub(crate) const SECOND: Duration = Duration::from_secs(1);
const MILLISECOND: Duration = Duration::from_millis(1);

/// A wall from one end to the other, in metres.
pub(crate) type Wall = [f64; 4];

/// Walls through these corners, and back to the first.
pub(crate) fn closed(corners: &[[f64; 2]]) -> Vec<Wall> {
    let next = corners.iter().cycle().skip(1);
    let walls = corners.iter().zip(next);
    walls.map(|(a, b)| [a[0], a[1], b[0], b[1]]).collect()
}

/// Four walls around the origin.
pub(crate) fn square(side_m: f64) -> Vec<Wall> {
    let half = side_m / 2.0;
    closed(&[[-half, -half], [half, -half], [half, half], [-half, half]])
}

/// Distance along a ray to the nearest wall.
pub(crate) fn cast(walls: &[Wall], x: f64, y: f64, angle: f64) -> f64 {
    let (dx, dy) = (libm::cos(angle), libm::sin(angle));
    let hit = |&[x0, y0, x1, y1]: &Wall| {
        let (ex, ey) = (x1 - x0, y1 - y0);
        let across = dx * ey - dy * ex;
        let (ox, oy) = (x0 - x, y0 - y);
        let along_ray = (ox * ey - oy * ex) / across;
        let along_wall = (ox * dy - oy * dx) / across;
        (along_ray > 0.0 && (0.0..=1.0).contains(&along_wall)).then_some(along_ray)
    };
    walls.iter().filter_map(hit).fold(f64::INFINITY, f64::min)
}

/// `angle` in (-pi, pi].
pub(crate) fn wrapped(angle: f64) -> f64 {
    angle - TAU * libm::round(angle / TAU)
}

/// One motor with its wheel, in the motor's own direction.
#[derive(Clone, Copy)]
pub(crate) struct Motor {
    pub(crate) rpm_per_volt: f64,
    /// Voltage that friction consumes.
    pub(crate) friction_volts: f64,
    /// Friction only holds the wheel: above its voltage it consumes nothing.
    pub(crate) only_holds: bool,
    pub(crate) rpm: f64,
    /// Whether its encoder does not count.
    pub(crate) is_uncounted: bool,
    pub(crate) counts: f64,
}

impl Motor {
    fn step(&mut self, duty: u16, is_on: bool) {
        let duty = f64::from(duty) / f64::from(DUTY_MAX);
        let volts = if is_on { (duty - 0.5) * 24.0 } else { 0.0 };
        let driven = if volts.abs() < self.friction_volts {
            0.0
        } else if self.only_holds {
            volts
        } else {
            volts - self.friction_volts * volts.signum()
        };
        // First-order response with a time constant of 60 ms, a millisecond at a time.
        self.rpm += (driven * self.rpm_per_volt - self.rpm) * (1.0 - libm::exp(-1.0 / 60.0));
        if !self.is_uncounted {
            self.counts += self.rpm / 60.0 * 0.001 * 1_200.0;
        }
    }

    fn speed_m_s(&self) -> f64 {
        self.rpm / 60.0 * TAU * 0.0375
    }
}

/// The whole system, advanced by a millisecond at a time.
pub(crate) struct Bench {
    pub(crate) robot: Yellow,
    pub(crate) now: Instant,
    pub(crate) walls: Vec<Wall>,
    /// x, y in metres, heading in radians.
    pub(crate) body: [f64; 3],
    pub(crate) motors: [Motor; 2],
    /// Offset of the counters, so that they wrap when a test needs it.
    pub(crate) counter_offset: [u16; 2],
    pub(crate) outputs: Outputs,
    pub(crate) button: bool,
    /// Whether the board has no supply: motors are off, and no sample arrives.
    pub(crate) is_unsupplied: bool,
    pub(crate) lidar: Lidar,
    pub(crate) heard: Vec<(Instant, Telemetry)>,
    /// Received payloads.
    pub(crate) payloads: Vec<Vec<u8>>,
    pub(crate) modes: Vec<(Instant, &'static str)>,
    /// Minimum distance of the robot's middle from a wall.
    pub(crate) clearance_m: f64,
    /// Volts: ahead, right front, left front.
    infrared: [f64; 3],
    channel: u8,
    outputs_decoder: OutputsDecoder,
    pc: telemetry::Decoder,
    line_credit: f64,
    frame_began_at: Option<Instant>,
    dice: Dice,
}

impl Bench {
    pub(crate) fn new(walls: Vec<Wall>) -> Self {
        Self::with_config(walls, Config::DEFAULT)
    }

    pub(crate) fn with_defect(walls: Vec<Wall>, id: &str) -> Self {
        let config = Config::DEFAULT.with_defect(id).expect("a known defect");
        Self::with_config(walls, config)
    }

    pub(crate) fn with_config(walls: Vec<Wall>, config: Config) -> Self {
        let start = config.start;
        let motor = Motor {
            rpm_per_volt: 40.0,
            friction_volts: 0.5,
            only_holds: false,
            rpm: 0.0,
            is_uncounted: false,
            counts: 0.0,
        };
        Self {
            robot: Yellow::new(config),
            now: Instant::ZERO,
            walls,
            body: [
                f64::from(start.x_mm) / 1e3,
                f64::from(start.y_mm) / 1e3,
                f64::from(start.heading),
            ],
            motors: [motor; 2],
            counter_offset: [0; 2],
            outputs: Outputs::default(),
            button: false,
            is_unsupplied: false,
            lidar: Lidar::new(1),
            heard: Vec::new(),
            payloads: Vec::new(),
            modes: Vec::new(),
            clearance_m: f64::INFINITY,
            infrared: [0.4; 3],
            channel: 0,
            outputs_decoder: OutputsDecoder::with_format(OutputsFormat),
            pc: telemetry::Decoder::default(),
            line_credit: 0.0,
            frame_began_at: None,
            dice: Dice::new(2),
        }
    }

    /// Changes the seed of the noise.
    pub(crate) fn seeded(mut self, seed: u64) -> Self {
        self.dice = Dice::new(seed);
        self.lidar = Lidar::new(seed + 1_000);
        self
    }

    pub(crate) fn run_for(&mut self, duration: Duration) {
        let end = self.now + duration;
        while self.now < end {
            self.step();
        }
    }

    /// Runs until `condition` holds; false if it does not within `limit`.
    pub(crate) fn run_until(&mut self, limit: Duration, condition: impl Fn(&Self) -> bool) -> bool {
        let end = self.now + limit;
        while self.now < end && !condition(self) {
            self.step();
        }
        condition(self)
    }

    pub(crate) fn mode(&self) -> &'static str {
        Inspect::mode(&self.robot)
    }

    /// Forward speed of the body, m/s, and its turn rate to the left, rad/s.
    pub(crate) fn speed(&self) -> [f64; 2] {
        let (left, right) = (self.motors[0].speed_m_s(), -self.motors[1].speed_m_s());
        [(left + right) / 2.0, (right - left) / 0.18]
    }

    /// Error of the program's pose: metres and radians.
    pub(crate) fn pose_error(&self) -> [f64; 2] {
        let pose = self.robot.pose();
        let [x, y, heading] = self.body;
        let (px, py) = (f64::from(pose.x_mm) / 1e3, f64::from(pose.y_mm) / 1e3);
        let turned = wrapped(f64::from(pose.heading) - heading);
        [libm::hypot(px - x, py - y), turned]
    }

    pub(crate) fn counter(&self, wanted: &str) -> u64 {
        let mut found = None;
        self.robot.counters(&mut |name, value| {
            if name == wanted {
                found = Some(value);
            }
        });
        found.expect("a counter of that name")
    }

    pub(crate) fn send(&mut self, command: &Telecommand) {
        let frame = framed(command);
        self.robot.receive(Yellow::TELEMETRY, self.now, &frame);
    }

    pub(crate) fn order(&mut self, state: State) {
        self.send(&Telecommand {
            state: Some(state),
            ..Telecommand::default()
        });
    }

    pub(crate) fn drive(&mut self, linear_m_s: f32, angular_rad_s: f32) {
        self.send(&Telecommand {
            state: Some(State::Manual),
            velocities: Some(Velocities {
                linear_m_s,
                angular_rad_s,
            }),
            ..Telecommand::default()
        });
    }

    pub(crate) fn go(&mut self, x: f32, y: f32, alpha: f32) {
        self.send(&Telecommand {
            state: Some(State::AutoPosition),
            desired_pose: Some(Pose { x, y, alpha }),
            ..Telecommand::default()
        });
    }

    pub(crate) fn step(&mut self) {
        self.now += MILLISECOND;
        self.move_body();
        self.sense();
        let bytes = self.lidar.step(self.now, self.body, &self.walls);
        if !bytes.is_empty() {
            self.robot.receive(Yellow::LIDAR, self.now, &bytes);
        }
        if self.robot.poll_at().is_some_and(|at| at <= self.now) {
            self.robot.poll(self.now);
        }
        // All due actions are done; otherwise a rig that jumps from event to event would make no
        // progress.
        assert!(self.robot.poll_at() > Some(self.now));
        self.carry();
        let mode = self.mode();
        if self.modes.last().is_none_or(|(_, last)| *last != mode) {
            self.modes.push((self.now, mode));
        }
    }

    fn move_body(&mut self) {
        let Outputs { duty, enable, .. } = self.outputs;
        for (motor, duty) in self.motors.iter_mut().zip(duty) {
            motor.step(duty, enable && !self.is_unsupplied);
        }
        let [linear, angular] = self.speed();
        let heading = self.body[2] + angular * 0.000_5;
        self.body[0] += linear * 0.001 * libm::cos(heading);
        self.body[1] += linear * 0.001 * libm::sin(heading);
        self.body[2] += angular * 0.001;
        if !self.now.as_millis().is_multiple_of(10) {
            return;
        }
        let ways = (0..36).map(|at| f64::from(at) * TAU / 36.0);
        let nearest = ways
            .map(|way| cast(&self.walls, self.body[0], self.body[1], way))
            .fold(self.clearance_m, f64::min);
        self.clearance_m = nearest;
    }

    /// One sample of the chip's hardware.
    fn sense(&mut self) {
        // The sensors measure each 38 ms, from a ring of 9 cm radius; 15 mV of noise.
        if self.now.as_millis().is_multiple_of(38) {
            for (slot, bearing) in [0.0, -60.0, 60.0_f64].into_iter().enumerate() {
                let way = self.body[2] + bearing.to_radians();
                let distance = cast(&self.walls, self.body[0], self.body[1], way) - 0.09;
                self.infrared[slot] = volts(distance) + 0.015 * self.dice.gauss();
            }
        }
        let volts = match self.channel {
            0 => self.infrared[0],
            1 => self.infrared[1],
            5 => self.infrared[2],
            _ => 0.0,
        };
        let counters = [0, 1].map(|at| {
            let whole = libm::floor(self.motors[at].counts) as i64;
            (whole as u16).wrapping_add(self.counter_offset[at])
        });
        let sample = Sample {
            counters,
            adc: (volts / 3.3 * 4_095.0) as u16,
            channel: self.channel,
            supply_cv: 1_200,
            button: self.button,
        };
        if !self.is_unsupplied {
            self.robot
                .receive(Yellow::BOARD, self.now, &sample.encode());
        }
    }

    /// Collects the bytes that the robot sends.
    fn carry(&mut self) {
        let mut buf = [0; 64];
        let len = self.robot.transmit(Yellow::BOARD, &mut buf);
        for outputs in self.outputs_decoder.push(&buf[..len]).flatten() {
            self.channel = outputs.channel;
            self.outputs = outputs;
        }
        if self.robot.transmit(Yellow::LIDAR_MOTOR, &mut buf) > 0 {
            self.lidar.duty = buf[0];
        }
        let len = self.robot.transmit(Yellow::LIDAR, &mut buf);
        self.lidar.receive(self.now, &buf[..len]);
        // 38400 baud are 3.84 bytes a millisecond.
        self.line_credit = (self.line_credit + 3.84).min(5.0);
        let room = self.line_credit as usize;
        let len = self.robot.transmit(Yellow::TELEMETRY, &mut buf[..room]);
        self.line_credit -= len as f64;
        for &byte in &buf[..len] {
            if byte == telemetry::START {
                self.frame_began_at = Some(self.now);
            }
            for frame in self.pc.push(&[byte]).flatten() {
                let at = self.frame_began_at.expect("a frame begins before it ends");
                let told = Telemetry::decode(frame.payload()).expect("the robot's message");
                self.payloads.push(frame.payload().to_vec());
                self.heard.push((at, told));
            }
        }
    }
}

/// Voltage of a sensor: 0.4 V at 0.8 m, 2.3 V at 0.1 m, linear in the reciprocal, and decreasing
/// again below 7 cm.
fn volts(distance: f64) -> f64 {
    let above = |distance: f64| 0.4 + 1.9 * (1.0 / distance - 1.25) / 8.75;
    match distance < 0.07 {
        true => above(0.07) * distance.max(0.0) / 0.07,
        false => above(distance),
    }
}

/// The frame of a telecommand.
pub(crate) fn framed(command: &Telecommand) -> Vec<u8> {
    let mut payload = [0; 256];
    let len = command.encode(&mut payload).expect("fits");
    let mut frame = [0; 600];
    let len = telemetry::encode(&payload[..len], &mut frame).expect("fits");
    frame[..len].to_vec()
}
