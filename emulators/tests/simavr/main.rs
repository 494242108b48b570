//! Emulated chips on the bus and pins of a simulated ATmega2560 (simavr), with sketches built from
//! the Arduino's own core. The output of our emulated board is compared with that of the simulated
//! one, for the same wheel and the same gyroscope.
//!
//! `tests/simavr/run.sh` builds sketches and harness and passes their folder; without it nothing is
//! judged, and a message says so.

mod base;

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use emulators::device::Device as _;
use emulators::i2c::RegisterChip;
use emulators::mpu6050::{Mpu6050, Mpu6050Config};
use emulators::odometer::{Odometer, OdometerConfig};
use emulators::srf08::{Srf08, Srf08Config};
use emulators::world::{
    self, Ackermann, AckermannConfig, Fixture, Point, Pose, Scene, Shape, World,
};
use protocols::odometer::{Decoder, Dialect, passes_exact_sum};
use protocols::{Decode as _, Instant};

/// Edges of the encoder per metre: 60 per turn of a wheel of 32 mm.
const EDGES_PER_M: f64 = 298.415_518;

/// Folder of the sketches; `None`, with a visible message, if there is none.
fn built() -> Option<PathBuf> {
    let folder = std::env::var_os("HILRIG_SIMAVR").map(PathBuf::from);
    if folder.is_none() {
        skipped("no simulated chip, run tests/simavr/run.sh");
    }
    folder
}

/// Prints the message directly, because the test runner hides the output of passing tests.
fn skipped(reason: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: simavr: {reason}");
}

/// The motion: a speed in m/s and a steering angle in radians, each from a time on, milliseconds.
const DRIVE: [(u64, f64, f64); 5] = [
    (0, 0.0, 0.0),
    (1_000, 0.2, 0.0),
    (2_000, 0.2, 0.35),
    (3_500, -0.2, -0.35),
    (4_500, 0.0, 0.0),
];

/// A car without lag in a world with a wall ahead.
struct Surroundings {
    world: World,
    next: usize,
}

impl Surroundings {
    fn new() -> Self {
        let wall = Fixture::from(Shape::Wall {
            from: Point { x: 1.5, y: -3.0 },
            to: Point { x: 1.5, y: 3.0 },
        });
        let scene = Scene::new(vec![wall], vec![]).unwrap();
        let car = AckermannConfig {
            lag_s: 0.0,
            ..AckermannConfig::default().ideal()
        };
        let body = Box::new(Ackermann::new(car, 1).unwrap());
        Self {
            world: World::with_chassis(scene, body, Pose::default()).unwrap(),
            next: 0,
        }
    }

    fn advance(&mut self, now: Instant) {
        while let Some((at, speed, angle)) = DRIVE.get(self.next)
            && Instant::from_millis(*at) <= now
        {
            self.world.advance(Instant::from_millis(*at));
            let speed = world::Command::Speed(*speed);
            self.world.actuate("drive", speed).unwrap();
            let angle = world::Command::Angle(*angle);
            self.world.actuate("steering", angle).unwrap();
            self.next += 1;
        }
        self.world.advance(now);
    }

    /// The contacts of the encoder: A, and B as 2.
    fn pins(&self) -> u8 {
        let encoders = self.world.encoders();
        let index = encoders.iter().position(|it| it.name == "drive").unwrap();
        let counts = self.world.encoder(index).unwrap_or_default();
        let edges = counts as f64 * EDGES_PER_M / encoders[index].counts_per_m + 1e-6;
        // The order of the contacts is 00, 10, 11, 01, written as B A.
        #[expect(clippy::cast_possible_truncation, reason = "0 to 3")]
        let place = edges.floor().rem_euclid(4.0) as usize;
        [0, 2, 3, 1][place]
    }
}

/// An acknowledged transaction.
struct Transaction {
    now: Instant,
    address: u8,
    written: Vec<u8>,
    read: std::vec::IntoIter<u8>,
}

/// The connections of the simulated microcontroller.
struct Bridge<'a, C> {
    chip: &'a mut C,
    around: Surroundings,
    /// Register at which the next read starts.
    register: u8,
    open: Option<Transaction>,
    serial: Vec<u8>,
    lines: Vec<(Instant, String)>,
}

impl<C: RegisterChip> Bridge<'_, C> {
    /// The answer to a line of the harness.
    fn answer(&mut self, line: &str) -> Option<u8> {
        let mut words = line.split(' ');
        let what = words.next()?;
        let mut number = || words.next().and_then(|word| word.parse::<u64>().ok());
        let byte = |number: Option<u64>| u8::try_from(number.expect("a number")).expect("a byte");
        let at = |number: Option<u64>| Instant::from_micros(number.expect("a time"));
        match what {
            "P" => {
                self.around.advance(at(number()));
                Some(self.around.pins())
            }
            "S" => Some(u8::from(self.begin(at(number()), byte(number())))),
            "W" => {
                let open = self.open.as_mut().expect("acknowledged");
                open.written.push(byte(number()));
                Some(1)
            }
            "R" => self.open.as_mut().expect("acknowledged").read.next(),
            "E" => {
                self.end();
                None
            }
            "U" => {
                self.print(at(number()), byte(number()));
                None
            }
            // Messages of the loader itself.
            _ => None,
        }
    }

    /// Begins a transaction; returns whether the chip is present. Without a stop, it ends the
    /// previous one.
    fn begin(&mut self, now: Instant, address: u8) -> bool {
        self.around.advance(now);
        self.end();
        let is_there = self.chip.acknowledges(now, address & 0xFE);
        let mut read = vec![0; 32];
        if is_there && address & 1 == 1 {
            let world = &self.around.world;
            self.chip.read(now, self.register, &mut read, world);
        }
        self.open = is_there.then(|| Transaction {
            now,
            address,
            written: Vec::new(),
            read: read.into_iter(),
        });
        is_there
    }

    /// Applies a completed transaction to the chip.
    fn end(&mut self) {
        let over = self.open.take().filter(|over| over.address & 1 == 0);
        let Some(over) = over else { return };
        if let [first, data @ ..] = &over.written[..] {
            self.register = *first;
            if !data.is_empty() {
                self.chip.write(over.now, *first, data, &self.around.world);
            }
        }
    }

    fn print(&mut self, now: Instant, byte: u8) {
        self.serial.push(byte);
        if byte == b'\n' {
            let text = String::from_utf8(core::mem::take(&mut self.serial));
            let text = text.expect("ASCII").trim_end().to_owned();
            self.lines.push((now, text));
        }
    }
}

/// Runs a sketch for `millis` with `chip` on its bus; returns its lines with the times of their
/// ends.
fn run(sketch: &str, millis: u64, chip: &mut impl RegisterChip) -> Option<Vec<(Instant, String)>> {
    let folder = built()?;
    let mut child = Command::new(folder.join("harness"))
        .arg(folder.join(format!("{sketch}.elf")))
        .arg(millis.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the harness is built");
    let mut answers = child.stdin.take().expect("piped");
    let said = BufReader::new(child.stdout.take().expect("piped"));
    let mut bridge = Bridge {
        chip,
        around: Surroundings::new(),
        register: 0,
        open: None,
        serial: Vec::new(),
        lines: Vec::new(),
    };
    for line in said.lines() {
        if let Some(answer) = bridge.answer(&line.expect("text")) {
            writeln!(answers, "{answer}").expect("it listens");
        }
    }
    assert!(child.wait().expect("it was started").success(), "harness");
    Some(bridge.lines)
}

fn quiet() -> Mpu6050Config {
    Mpu6050Config {
        bias_walk_dps: 0.0,
        gyro_noise_dps: 0.0,
        accel_noise_m_s2: 0.0,
        ..Mpu6050Config::default()
    }
}

/// The lines of our emulated board.
fn emulated(millis: u64) -> Vec<(Instant, String)> {
    let mut around = Surroundings::new();
    let mut board = Odometer::new(OdometerConfig {
        imu: quiet(),
        jitter: core::time::Duration::ZERO,
        ..OdometerConfig::default()
    });
    let (mut lines, mut decoder) = (Vec::new(), Decoder::default());
    let end = Instant::from_millis(millis);
    while let Some(now) = board.poll_at().filter(|now| *now < end) {
        around.advance(now);
        board.poll(now, &mut around.world);
        let mut buf = [0; 600];
        let len = board.transmit(Odometer::UART, &mut buf);
        for line in decoder.push(&buf[..len]).flatten() {
            let text = String::from_utf8(line.content().to_vec()).expect("ASCII");
            lines.push((now, text));
        }
    }
    lines
}

fn fields(line: &str) -> Vec<f64> {
    let fields = line.trim_end_matches('*').split('*');
    fields
        .map(|field| field.parse().expect("a figure"))
        .collect()
}

/// At rest, straight ahead, in a curve and back: the lines of both are equal within limits. While
/// both stand still, the distance has the same text, and so has the rate. The heading may differ by
/// one loop more or less per stretch (0.2 m/s * tan 0.35 / 0.258 m * 10 ms = 2.8 mrad, three
/// stretches). While they move, the distance may differ by one loop.
#[test]
fn a_simulated_chip_prints_what_our_emulated_board_prints() {
    let mut sensor = Mpu6050::new(quiet(), 1, "odometer.imu");
    let Some(simulated) = run("odometer", 5_500, &mut sensor) else {
        return;
    };
    let ours = emulated(5_500);
    // The run takes 5.5 s less 265 ms, with a line every 9.9 to 10.1 ms.
    for lines in [&simulated, &ours] {
        assert!((518..=529).contains(&lines.len()), "{}", lines.len());
    }
    let first = fields(&simulated[0].1);
    assert!((first[3] - 265.0).abs() <= 10.0, "{first:?}");
    for (_, line) in &simulated {
        let read = Dialect::AsCoded.read(line.as_bytes());
        assert!(read.is_ok(), "{line}: {read:?}");
    }
    let at = |lines: &[(Instant, String)], millis: f64| -> String {
        let line = lines.iter().find(|(_, line)| fields(line)[3] >= millis);
        line.expect("it went on").1.clone()
    };
    let texts = |millis| [at(&simulated, millis), at(&ours, millis)];
    for (millis, way_m, yaw_rad) in [
        (900.0, 0.0, 0.001),
        (1_500.0, 0.008, 0.001),
        (3_000.0, 0.008, 0.015),
        (4_000.0, 0.008, 0.02),
        (5_400.0, 0.0, 0.02),
    ] {
        let [theirs, ours] = texts(millis).map(|line| fields(&line));
        assert!(
            (theirs[0] - ours[0]).abs() <= way_m + 1e-9,
            "{theirs:?} {ours:?}"
        );
        assert!((theirs[1] - ours[1]).abs() < 0.011, "{theirs:?} {ours:?}");
        assert!(
            (theirs[2] - ours[2]).abs() <= yaw_rad,
            "{theirs:?} {ours:?}"
        );
    }
    for millis in [900.0, 5_400.0] {
        let texts = texts(millis);
        let way_and_rate = texts.each_ref().map(|line| {
            let mut stars = line.match_indices('*');
            line[..stars.nth(1).expect("five").0].to_owned()
        });
        assert_eq!(way_and_rate[0], way_and_rate[1]);
    }
    // In the curve the fielded host accepts the values of neither; at rest it accepts some of both.
    for lines in [&simulated, &ours] {
        let turning = lines.iter().filter(|(_, line)| {
            let figures = fields(line);
            (2_500.0..3_400.0).contains(&figures[3])
        });
        let believed = turning.filter(|(_, line)| passes_exact_sum(line.as_bytes()));
        assert_eq!(believed.count(), 0);
    }
}

/// A sketch measures distances with our SRF08 while the car drives from 1.5 m towards the wall and
/// back. With a range of 6 m there is an echo within 2 cm of the truth after 36 ms, the time of
/// sound there and back. With 1 m there is an echo only when the wall is near, after 7 ms.
#[test]
fn a_simulated_chip_ranges_with_our_ranger() {
    let mut chip = Srf08::new(Srf08Config::default(), 1, "ranger");
    let Some(lines) = run("ranger", 4_000, &mut chip) else {
        return;
    };
    // A pair takes 36 + 7 ms plus the time of the bus.
    assert!((160..=186).contains(&lines.len()), "{}", lines.len());
    let mut echoes = [0, 0];
    let mut truth = Surroundings::new();
    for (now, line) in &lines {
        let figures: Vec<u64> = line
            .split(' ')
            .map(|it| it.parse().expect("a number"))
            .collect();
        let [reach, centimetres, took] = figures[..] else {
            panic!("{line}")
        };
        // (n + 1) * 43 mm there and back at 343.2 m/s, plus 1 ms.
        let expected = match reach {
            140 => 36,
            _ => 7,
        };
        assert!(took.abs_diff(expected) <= 2, "{line}");
        truth.advance(*now);
        // The nearest point in the cone is straight towards the wall.
        let away_m = 1.5 - truth.world.pose().x;
        let is_heard = centimetres > 0;
        if reach == 140 {
            assert!(is_heard, "{line}");
            let off = away_m - centimetres as f64 / 100.0;
            // 3 mm of noise, rounding to whole centimetres, and the distance driven since the
            // burst: 8 mm.
            assert!(off.abs() <= 0.03, "{line}: {away_m}");
        } else {
            assert!(!is_heard || centimetres <= 110, "{line}");
        }
        echoes[usize::from(reach == 140)] += u32::from(is_heard);
    }
    assert!(echoes[0] > 0 && echoes[1] > 30, "{echoes:?}");
}
