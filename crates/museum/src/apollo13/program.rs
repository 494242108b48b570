//! The program on a bench: its ports receive bytes, and the bench records the bytes it sends.

use core::time::Duration;

use emulators::Device as _;
use emulators::car_board;
use emulators::odometer::{Odometer, OdometerConfig};
use emulators::world::{Ackermann, Command, Fixture, Pose, Scene, World};
use firmware_core::ackermann::CarPose;
use firmware_core::robots::apollo13::{Apollo13, Config, Defects};
use firmware_core::{Inspect as _, Master as _};
use protocols::Instant;
use protocols::car_board::Readings;
use protocols::odometer::Dialect;
use protocols::perception::Marker;

use crate::{Observation, Variant};
use engine::codec::{CAR_BOARD, CAR_COMMAND, ODOMETER, OSC, PERCEPTION};

const MS: Duration = Duration::from_millis(1);
/// A frame as read from the board: 13 cm ahead, 200 right, 150 left, 269 pulses, 7.2 V.
const READ: Readings = Readings {
    front_cm: 13,
    right_cm: 200,
    left_cm: 150,
    line: 0,
    hall: 269,
    battery_mv: 7_200,
};

/// The program, and the bytes that it sent to the board.
struct Bench {
    program: Box<Apollo13>,
    now: Instant,
    seen: Observation,
    sent: Vec<u8>,
}

impl Bench {
    /// Sets up the program; `switch` enables the defect in the defective variant.
    fn new(variant: Variant, switch: impl Fn(&mut Defects)) -> Self {
        let mut defects = Defects::default();
        if variant.is_defective() {
            switch(&mut defects);
        }
        Self {
            program: Box::new(Apollo13::new(Config {
                dialect: Some(Dialect::AsCoded),
                defects,
                ..Config::default()
            })),
            now: Instant::ZERO,
            seen: Observation::default(),
            sent: Vec::new(),
        }
    }

    /// Advances time in steps of one millisecond.
    fn run(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.now += MS;
            self.program.poll(self.now);
            let mut buf = [0; 16];
            let len = self.program.transmit(Apollo13::CAR, &mut buf);
            self.sent.extend(&buf[..len]);
        }
    }

    /// The board sends `bytes` and is silent for the rest of a round.
    fn board(&mut self, bytes: &[u8]) {
        self.seen.bytes("board", &CAR_BOARD, bytes);
        self.program.receive(Apollo13::CAR, self.now, bytes);
        self.run(66 * MS);
    }

    /// Sets the phone's control at `address` to `value`.
    fn phone(&mut self, address: &str, value: f32) {
        let mut packet = Vec::new();
        for part in [address, ",f"] {
            packet.extend(part.as_bytes());
            packet.extend(vec![0; 4 - part.len() % 4]);
        }
        packet.extend(value.to_be_bytes());
        self.seen.bytes("phone", &OSC, &packet);
        self.program.receive(Apollo13::REMOTE, self.now, &packet);
    }

    fn counter(&self, name: &str) -> u64 {
        let mut found = 0;
        self.program.counters(&mut |known, value| {
            if known == name {
                found = value;
            }
        });
        found
    }

    /// Records the front distance that the program holds.
    fn note_ahead(&mut self, name: &'static str) -> Option<f64> {
        let [ahead, ..] = self.program.ultrasound_m();
        let told = ahead.map_or_else(|| "none".to_owned(), |m| format!("{m:.2}"));
        self.seen.figure(name, told);
        ahead
    }

    /// Records the motor level of the last command.
    fn note_level(&mut self, name: &'static str) -> i8 {
        let last = self.sent.len().saturating_sub(2);
        let pair = self.sent[last..].to_vec();
        self.seen.bytes("host", &CAR_COMMAND, &pair);
        let level = self.program.drive().level;
        self.seen.figure(name, level);
        level
    }
}

pub(super) fn af_01(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.reads_cr_as_nl = true);
    bench.board(READ.encode().as_bytes());
    let ahead = bench.note_ahead("13 cm ahead are read as, m");
    bench.seen.judged(ahead == Some(0.10))
}

pub(super) fn af_02(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.loses_frames = true);
    let frame = READ.encode();
    bench.board(&[&[0], &frame.as_bytes()[..]].concat());
    let frames = bench.counter("board frames");
    bench.seen.figure("frames behind a stray zero", frames);
    bench.seen.judged(frames == 0)
}

/// 10 s straight, then 3.7 s in a curve of 0.36 rad/s, as the emulated board reports them.
pub(super) fn af_03(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.sums_exactly = true);
    let mut world = car();
    let mut board = Odometer::new(OdometerConfig::default());
    let (mut steered, mut before, mut lines) = (false, 0, 0_u64);
    drive(&mut world, 0.0);
    let end = Instant::from_millis(13_700);
    while let Some(now) = board.poll_at().filter(|now| *now < end) {
        if !steered && now >= Instant::from_secs(10) {
            drive(&mut world, 0.4);
            steered = true;
            before = bench.counter("odometer lines");
        }
        world.advance(now);
        board.poll(now, &mut world);
        let mut buf = [0; 600];
        let len = board.transmit(Odometer::UART, &mut buf);
        bench.program.receive(Apollo13::ODOMETER, now, &buf[..len]);
        if steered && len > 0 {
            lines += 1;
            if lines == 100 {
                bench.seen.bytes("odometer", &ODOMETER, &buf[..len]);
            }
        }
    }
    let believed = bench.counter("odometer lines") - before;
    bench.seen.figure("lines in the curve", lines);
    bench.seen.figure("of them believed", believed);
    bench.seen.judged(believed == 0)
}

pub(super) fn af_04(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.floods = true);
    bench.run(Duration::from_secs(1));
    let sent = bench.sent.len();
    let first = bench.sent[..8.min(sent)].to_vec();
    bench.seen.bytes("host", &CAR_COMMAND, &first);
    bench.seen.figure("bytes in a second", sent);
    // 11520 bytes a second.
    bench
        .seen
        .figure("of the line, per cent", sent * 100 / 11_520);
    bench.seen.judged(sent > 1_900)
}

/// Half a circle of 0.963 m radius, from 15 degrees of steering: a line each 5 mm of path.
pub(super) fn af_05(variant: Variant) -> Observation {
    const RADIUS_M: f32 = 0.963;
    let mut bench = Bench::new(variant, |it| it.odometry.wrong_side = true);
    let (mut way_m, mut yaw_rad) = (0.0_f32, 0.0);
    for step in 0..=605_u16 {
        way_m = f32::from(step) * 0.005;
        yaw_rad = way_m / RADIUS_M;
        let line = exact_line(way_m, yaw_rad, step);
        bench.program.receive(Apollo13::ODOMETER, bench.now, &line);
    }
    let last = exact_line(way_m, yaw_rad, 605);
    bench.seen.bytes("odometer", &ODOMETER, &last);
    let [way_m, radius_m] = [way_m, RADIUS_M].map(f64::from);
    let (sin, cos) = libm::sincos(way_m / radius_m);
    let truth = CarPose {
        x_m: radius_m * sin,
        y_m: radius_m * (1.0 - cos),
        heading_rad: way_m / radius_m,
    };
    let off_mm = truth.distance_m(bench.program.pose()) * 1e3;
    bench.seen.figure(
        "position error after 3 m of a circle, mm",
        format!("{off_mm:.0}"),
    );
    bench.seen.judged(off_mm > 8.0)
}

/// A line of the as-coded dialect with four decimals, so that its rounding does not affect the
/// result.
fn exact_line(way_m: f32, yaw_rad: f32, time_ms: u16) -> Vec<u8> {
    let sum = way_m + yaw_rad + f32::from(time_ms);
    format!("{way_m:.4}*0.00*{yaw_rad:.4}*{time_ms}*{sum:.4}*\r\n").into_bytes()
}

/// The phone drives, then enables both modes, then tries to stop.
pub(super) fn af_06(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.arbiter.both_persist = true);
    bench.phone("/1/speed", 2.0);
    bench.run(100 * MS);
    bench.phone("/modes/toggle4", 1.0);
    bench.phone("/modes/follow_aruco", 1.0);
    bench.phone("/1/speed", 0.0);
    bench.run(500 * MS);
    let level = bench.note_level("motor level with both modes on, the fader at 0");
    bench.seen.judged(level == 2)
}

pub(super) fn af_07(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.arbiter.never_silent = true);
    bench.phone("/1/speed", 2.0);
    bench.run(Duration::from_secs(5));
    let level = bench.note_level("motor level 5 s after the phone's last packet");
    bench.seen.judged(level == 2)
}

/// Two markers 1.5 m ahead, 175 mm to either side.
pub(super) fn af_08(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.gates_as_fielded = true);
    bench.phone("/modes/follow_aruco", 1.0);
    for (id, right_mm) in [(10, -175), (11, 175)] {
        let marker = Marker {
            id,
            place_mm: [right_mm, 0, 1_500],
            normal: [0, -10_000],
        };
        bench.seen.bytes("camera", &PERCEPTION, &marker.encode());
        bench
            .program
            .receive(Apollo13::MARKERS, bench.now, &marker.encode());
    }
    bench.run(100 * MS);
    let goal = bench.program.pilot().goal();
    let told = goal.map_or_else(
        || "none".to_owned(),
        |goal| format!("{:.2}, {:.2}", goal.x_m, goal.y_m),
    );
    bench.seen.figure("goal in a gate of 0.35 m", told);
    bench.seen.judged(goal.is_some())
}

/// The fifth byte of a frame is lost, and the next frame follows at once.
pub(super) fn af_09(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.loses_frames = true);
    let mut bytes = READ.encode().as_bytes().to_vec();
    bytes.remove(4);
    bytes.extend(READ.encode().as_bytes());
    bench.board(&bytes);
    let battery = bench.program.battery_mv();
    bench.seen.figure("battery, mV", battery);
    bench.seen.judged(battery == 28)
}

/// The program starts listening one byte too late; the car is parked.
pub(super) fn af_10(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant, |it| it.loses_frames = true);
    let parked = Readings {
        front_cm: 40,
        right_cm: 15,
        ..READ
    };
    let frame = parked.encode();
    bench.board(&frame.as_bytes()[1..]);
    for _ in 0..9 {
        bench.board(frame.as_bytes());
    }
    let ahead = bench.note_ahead("40 cm ahead after ten frames, m");
    bench.seen.judged(ahead != Some(0.40))
}

/// A car in an empty world.
pub(super) fn car() -> World {
    let scene = Scene::new(Vec::<Fixture>::new(), Vec::new()).expect("nothing");
    let body = Ackermann::new(car_board::chassis().ideal(), 1).expect("its own figures");
    World::with_chassis(scene, Box::new(body), Pose::default()).expect("room for the car")
}

/// Drives at 0.22 m/s with this steering angle, radians.
pub(super) fn drive(world: &mut World, angle_rad: f64) {
    let commands = [
        ("drive", Command::Speed(0.22)),
        ("steering", Command::Angle(angle_rad)),
    ];
    for (actuator, command) in commands {
        world.actuate(actuator, command).expect("the car has it");
    }
}
