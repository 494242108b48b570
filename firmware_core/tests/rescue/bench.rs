//! A minimal robot, flat, base, lidar and PC: enough to close the loop around the rescue robot's
//! program without another crate. The emulated devices are in other crates.

use core::f64::consts::{FRAC_PI_2, TAU};
use core::time::Duration;

use firmware_core::robots::rescue::{Config, Rescue};
use firmware_core::slam::Settings;
use firmware_core::{Inspect, Master};
use protocols::avr::{self, ChecksumOrder};
use protocols::pcui::message::{
    MapProperties, Message, Mode, Order, State, Waypoint, encode_order, encode_waypoints,
};
use protocols::xv11::{Frame, RawReading, Reading, SpeedWord};
use protocols::{Decode, Instant, pcui};

pub(crate) const SECOND: Duration = Duration::from_secs(1);

/// A wall from one end to the other, in millimetres.
pub(crate) type Wall = [f64; 4];

/// Radius of the body.
pub(crate) const RADIUS_MM: f64 = 160.0;

/// Four walls of a box.
pub(crate) fn boxed(x0: f64, y0: f64, x1: f64, y1: f64) -> [Wall; 4] {
    [
        [x0, y0, x1, y0],
        [x1, y0, x1, y1],
        [x1, y1, x0, y1],
        [x0, y1, x0, y0],
    ]
}

/// Two rooms with a door of 700 mm between them, furniture and the legs of a table.
pub(crate) fn flat() -> Vec<Wall> {
    let legs = [
        (2150.0, 2250.0),
        (2550.0, 2250.0),
        (2150.0, 2600.0),
        (2550.0, 2600.0),
    ];
    let mut walls = Vec::new();
    for [x0, y0, x1, y1] in [
        [100.0, 100.0, 2900.0, 2900.0],
        [1560.0, 100.0, 1640.0, 1200.0],
        [1560.0, 1900.0, 1640.0, 2900.0],
        [100.0, 2300.0, 500.0, 2900.0],
        [2300.0, 100.0, 2900.0, 900.0],
        [700.0, 480.0, 900.0, 640.0],
    ] {
        walls.extend(boxed(x0, y0, x1, y1));
    }
    for (x, y) in legs {
        walls.extend(boxed(x, y, x + 40.0, y + 40.0));
    }
    walls
}

/// Distance along a ray to the nearest wall.
fn cast(walls: &[Wall], x: f64, y: f64, angle: f64) -> f64 {
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

/// Distance from a point to a wall.
fn distance(&[x0, y0, x1, y1]: &Wall, x: f64, y: f64) -> f64 {
    let (ex, ey) = (x1 - x0, y1 - y0);
    let along = ((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey);
    let along = along.clamp(0.0, 1.0);
    libm::hypot(x - x0 - along * ex, y - y0 - along * ey)
}

/// Xorshift.
struct Dice(u64);

impl Dice {
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn gauss(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Data that the PC received.
#[derive(Default)]
pub(crate) struct Heard {
    pub(crate) properties: Vec<(Instant, MapProperties)>,
    pub(crate) states: Vec<State>,
    pub(crate) echoes: Vec<Vec<Waypoint>>,
    pub(crate) rows: Vec<u16>,
    pub(crate) errors: usize,
}

/// The whole system, advanced by one lidar beam at a time (556 us at 300 rpm).
pub(crate) struct Bench {
    pub(crate) robot: Rescue,
    pub(crate) now: Instant,
    pub(crate) walls: Vec<Wall>,
    /// x, y in millimetres, heading in radians.
    pub(crate) body: [f64; 3],
    /// Last set-points that the base received.
    pub(crate) set_point: [i8; 2],
    pub(crate) lidar_is_plugged: bool,
    pub(crate) base_hears: bool,
    pub(crate) base_is_heard: bool,
    /// Probability that a reply of the base is lost.
    pub(crate) base_loss: f64,
    pub(crate) heard: Heard,
    /// Minimum distance between body and walls so far.
    pub(crate) clearance_mm: f64,
    /// Set-points that the base received, with their times.
    pub(crate) writes: Vec<(Instant, [i8; 2])>,
    pub(crate) duty: u8,
    /// Time that the processor spent on searches.
    pub(crate) busy: Duration,
    pub(crate) heard_bytes: usize,
    pub(crate) radio_is_blocked: bool,
    pub(crate) polls_twice: bool,
    /// Whether the main loop hangs; interrupts continue.
    pub(crate) hangs: bool,
    wheels: [f64; 2],
    ticks: [f64; 2],
    written_at: Instant,
    base: avr::Decoder,
    reply: Vec<u8>,
    pc: pcui::Decoder,
    beam: usize,
    readings: [RawReading; 4],
    packet: Option<(Instant, Frame)>,
    busy_until: Instant,
    dice: Dice,
}

const ORDER: ChecksumOrder = ChecksumOrder::LowFirst;
const BEAM: Duration = Duration::from_nanos(555_555);

impl Bench {
    pub(crate) fn new(walls: Vec<Wall>, seed: u64) -> Self {
        let mut config = Config::default();
        config.mapping.seed = seed;
        Self::with_config(walls, seed, config)
    }

    /// A robot with the search of the seed report, which takes 150 of 200 ms.
    pub(crate) fn searching(walls: Vec<Wall>, seed: u64) -> Self {
        let mapping = Settings {
            seed,
            ..Settings::document()
        };
        let config = Config {
            mapping,
            ..Config::default()
        };
        Self::with_config(walls, seed, config)
    }

    pub(crate) fn with_config(walls: Vec<Wall>, seed: u64, config: Config) -> Self {
        Self {
            robot: Rescue::new(config),
            now: Instant::ZERO,
            walls,
            body: [1000.0, 1000.0, FRAC_PI_2],
            set_point: [0; 2],
            lidar_is_plugged: true,
            base_hears: true,
            base_is_heard: true,
            base_loss: 0.0,
            heard: Heard::default(),
            clearance_mm: f64::INFINITY,
            writes: Vec::new(),
            duty: 0,
            busy: Duration::ZERO,
            heard_bytes: 0,
            radio_is_blocked: false,
            polls_twice: false,
            hangs: false,
            wheels: [0.0; 2],
            ticks: [0.0; 2],
            written_at: Instant::ZERO,
            base: avr::Decoder::new(ORDER),
            reply: Vec::new(),
            pc: pcui::Decoder::default(),
            beam: 0,
            readings: [RawReading([0; 4]); 4],
            packet: None,
            busy_until: Instant::ZERO,
            dice: Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1),
        }
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

    pub(crate) fn send(&mut self, bytes: &[u8]) {
        self.robot.receive(Rescue::RADIO, self.now, bytes);
    }

    pub(crate) fn send_waypoints(&mut self, points: &[[i16; 2]]) {
        let list = (0..).zip(points).map(|(id, &position_mm)| Waypoint {
            position_mm,
            id,
            previous: id - 1,
            ..Waypoint::default()
        });
        let mut frame = [0; pcui::FRAME_MAX];
        let list: Vec<_> = list.collect();
        let len = encode_waypoints(list.into_iter(), &mut frame).expect("fits");
        self.send(&frame[..len]);
    }

    pub(crate) fn order(&mut self, mode: Mode, set_point: [i8; 2]) {
        let mut frame = [0; 64];
        let len = encode_order(&Order { mode, set_point }, &mut frame).expect("fits");
        self.send(&frame[..len]);
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

    pub(crate) fn heard_discarded(&self) -> u64 {
        self.pc.discarded()
    }

    /// Restarts the base: counters and set-points begin at zero.
    pub(crate) fn restart_base(&mut self) {
        self.ticks = [0.0; 2];
        self.set_point = [0; 2];
    }

    pub(crate) fn speed(&self) -> f64 {
        self.wheels[0].abs().max(self.wheels[1].abs())
    }

    pub(crate) fn distance_to(&self, [x, y]: [i16; 2]) -> f64 {
        libm::hypot(self.body[0] - f64::from(x), self.body[1] - f64::from(y))
    }

    /// Present distance, and angle in degrees, between the true and the believed pose.
    pub(crate) fn pose_error(&self) -> (f64, f64) {
        let pose = self.robot.pose_at(self.now);
        let [x, y, heading] = self.body;
        let turn = (f64::from(pose.heading) - heading) / TAU;
        let apart = libm::hypot(f64::from(pose.x_mm) - x, f64::from(pose.y_mm) - y);
        (apart, (turn - turn.round()) * 360.0)
    }

    fn step(&mut self) {
        self.now += BEAM;
        self.drive();
        self.turn_lidar();
        self.serve_base();
        self.listen();
        if self.hangs {
            return;
        }
        if self.now >= self.busy_until && self.robot.poll_at().is_some_and(|at| at <= self.now) {
            self.robot.poll(self.now);
            // Seed figure S4 by the project's cost model: 14 ms a scan, 0.15 ms a try.
            let work = self.robot.take_work();
            let cost = Duration::from_millis(14) * work.scans
                + Duration::from_nanos(25_556) * work.tries
                + Duration::from_nanos(3_457) * work.points;
            self.busy += cost;
            self.busy_until = self.now + cost;
            if self.polls_twice && cost == Duration::ZERO {
                self.robot.poll(self.now);
                let again = self.robot.take_work();
                assert_eq!(again.scans, 0, "a second poll at once has nothing to do");
            }
        }
    }

    fn drive(&mut self) {
        if self.now - self.written_at > Duration::from_secs(1) {
            self.set_point = [0; 2];
        }
        let seconds = BEAM.as_secs_f64();
        let lag = 1.0 - libm::exp(-seconds / 0.06);
        let mut travel = [0.0; 2];
        for (wheel, travel) in travel.iter_mut().enumerate() {
            let wanted = f64::from(self.set_point[wheel]);
            self.wheels[wheel] += (wanted - self.wheels[wheel]) * lag;
            let turned = self.wheels[wheel] / 0.040 * seconds;
            self.ticks[wheel] += turned;
            let slip = 0.01 + 0.005 * wheel as f64 + 0.1 * self.dice.gauss();
            *travel = turned * TAU * 26.0 / 360.0 * (1.0 - slip);
        }
        let turn = (travel[1] - travel[0]) / 260.0;
        let path = (travel[0] + travel[1]) / 2.0;
        let heading = self.body[2] + turn / 2.0;
        self.body[0] += path * libm::cos(heading);
        self.body[1] += path * libm::sin(heading);
        self.body[2] += turn;
        let [x, y, _] = self.body;
        let near = self.walls.iter().map(|wall| distance(wall, x, y));
        let nearest = near.fold(f64::INFINITY, f64::min) - RADIUS_MM;
        self.clearance_mm = self.clearance_mm.min(nearest);
    }

    /// Measures a beam; a packet is complete 1.91 ms after its last beam.
    fn turn_lidar(&mut self) {
        if let Some((_, packet)) = self.packet.take_if(|(at, _)| *at <= self.now)
            && self.lidar_is_plugged
        {
            self.robot
                .receive(Rescue::LIDAR, self.now, packet.as_bytes());
        }
        let [x, y, heading] = self.body;
        let angle = heading + (self.beam as f64).to_radians() - FRAC_PI_2;
        let distance = cast(&self.walls, x, y, angle);
        let sigma = (2e-6 * distance * distance).max(0.3);
        let measured = distance + sigma * self.dice.gauss();
        let reading = if (150.0..6000.0).contains(&distance) {
            Reading::Range {
                distance_mm: measured.round().clamp(0.0, 6000.0) as u16,
                strength: 200,
                weak: false,
            }
        } else {
            Reading::Invalid {
                code: 0x35,
                strength: 0,
            }
        };
        self.readings[self.beam % 4] = reading.into();
        if self.beam % 4 == 3 {
            let packet = Frame::new((self.beam / 4) as u8, SpeedWord(300 * 64), self.readings);
            self.packet = Some((self.now + Duration::from_micros(1910), packet));
        }
        self.beam = (self.beam + 1) % 360;
        let mut duty = [0];
        if self.robot.transmit(Rescue::MOTOR, &mut duty) == 1 {
            self.duty = duty[0];
        }
    }

    /// Replies one beam later, with about the latency of the fielded base.
    fn serve_base(&mut self) {
        let reply = core::mem::take(&mut self.reply);
        if !reply.is_empty() && self.base_is_heard && self.dice.uniform() >= self.base_loss {
            self.robot.receive(Rescue::BASE, self.now, &reply);
        }
        let mut buf = [0; 64];
        let count = self.robot.transmit(Rescue::BASE, &mut buf);
        if count == 0 || !self.base_hears {
            return;
        }
        let requests: Vec<_> = self
            .base
            .push(&buf[..count])
            .filter_map(Result::ok)
            .collect();
        for request in requests {
            let answer = match (request.register(), request.is_write(), request.count()) {
                (36, false, 10) => avr::Frame::write(36, &self.wheel_registers(), ORDER),
                (33, false, 3) => avr::Frame::write(33, &[0xE0, 0x2E, 81], ORDER),
                (46, true, 3) => {
                    let data = request.data();
                    self.set_point = [data[0], data[1]].map(u8::cast_signed);
                    assert_eq!(data[2], 0, "the motor driver is to be active");
                    self.written_at = self.now;
                    self.writes.push((self.now, self.set_point));
                    avr::Frame::read(46, 0, ORDER)
                }
                other => panic!("the robot asked for {other:?}"),
            };
            self.reply.extend(answer.as_bytes());
        }
    }

    fn wheel_registers(&self) -> [u8; 10] {
        let mut data = [0; 10];
        data[..4].copy_from_slice(&(self.ticks[0].floor() as i32).to_le_bytes());
        data[4..8].copy_from_slice(&(self.ticks[1].floor() as i32).to_le_bytes());
        data[8] = (self.wheels[0].round() as i8).cast_unsigned();
        data[9] = (self.wheels[1].round() as i8).cast_unsigned();
        data
    }

    /// 460800 baud carry 25 bytes in the time of a beam.
    fn listen(&mut self) {
        if self.radio_is_blocked {
            return;
        }
        let mut buf = [0; 25];
        let count = self.robot.transmit(Rescue::RADIO, &mut buf);
        self.heard_bytes += count;
        for frame in self.pc.push(&buf[..count]) {
            match frame.as_ref().map(pcui::Frame::message) {
                Ok(Ok(Message::Map(map))) => self.heard.properties.push((self.now, map)),
                Ok(Ok(Message::State(state))) => self.heard.states.push(state),
                Ok(Ok(Message::Waypoints(list))) => self.heard.echoes.push(list.iter().collect()),
                Ok(Ok(Message::Row(row) | Message::CodedRow(row))) => self.heard.rows.push(row.y),
                _ => self.heard.errors += 1,
            }
        }
    }
}
