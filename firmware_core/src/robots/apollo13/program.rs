//! The whole program: its input on five ports, its decisions, its output.
//!
//! | port | protocol |
//! |---|---|
//! | [`CAR`](Apollo13::CAR) | the car's board: commands out, ultrasound, hall, battery in |
//! | [`ODOMETER`](Apollo13::ODOMETER) | text lines of encoder and gyroscope, in |
//! | [`SCAN`](Apollo13::SCAN) | depth rows or scans of the camera, messages, in |
//! | [`MARKERS`](Apollo13::MARKERS) | markers that were recognised, messages, in |
//! | [`REMOTE`](Apollo13::REMOTE) | Open Sound Control of the phone, packets, in |

mod inspect;
mod mapping;
mod passing;
mod place;
mod search;
mod senses;
mod sight;
#[cfg(test)]
mod tests;

use alloc::collections::VecDeque;
use core::time::Duration;

use protocols::{Instant, LineConfig, LineEvent, Port, car_board, odometer};

use super::arbiter::{self, Arbiter, Drive, Mode};
use super::board_odometry::BoardOdometry;
use super::camera_watch::CameraWatch;
use super::floor::{Floor, FloorPlan};
use super::follower;
use super::gates::{self, Gates, Passage};
use super::gyro_odometry::{self, GyroOdometry};
use super::gyro_watch::GyroWatch;
use super::odometer_watch::OdometerWatch;
use super::pilot::Pilot;
use super::raw_lines::RawLines;
use super::steering;
use super::survey::Survey;
use super::wall::{Gains, Side, WallDistance};
use super::witness::Witness;
use crate::ackermann::CarPose;
use crate::costmap::Inflation;
use crate::lattice::{Outline, PrimitiveSet};
use crate::particles::Localiser;
use crate::pose::Point;
use crate::{Master, Work};

/// Period of commands.
const SEND_EVERY: Duration = Duration::from_millis(20);
/// The fielded program sends both bytes each millisecond.
const FIELDED_SEND_EVERY: Duration = Duration::from_millis(1);
/// Minimum distance ahead for driving on, metres.
const TOO_NEAR_M: f64 = 0.25;
/// Longest time without a wall distance in which the wall is still followed: 11 cm of path.
const WALL_SILENT_MAX: Duration = Duration::from_millis(500);
/// Travel after which a board that still reports the same readings is stuck, metres: four pulses.
const STUCK_M: f64 = 0.1;
/// Number of unfitting scans, 2 m of path, after which the car is lost.
const MISFITS_MAX: u8 = 40;
/// Distance of the camera before the rear axle's middle, metres.
pub(super) const CAMERA_AHEAD_M: f64 = 0.18 + 0.129;
/// Distance of the front ultrasonic sensor before the rear axle's middle.
const FRONT_AHEAD_M: f64 = 0.175 + 0.129;

/// Defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Defects of the arbiter between phone and planner.
    pub arbiter: arbiter::Defects,
    /// Defects of the odometry.
    pub odometry: gyro_odometry::Defects,
    /// Frames of the board are read by the fielded parser, which loses `00 00 0F`.
    pub loses_frames: bool,
    /// Carriage returns are read as newlines on the board's port.
    pub reads_cr_as_nl: bool,
    /// Lines of the odometer count only if their sum is exact in 32-bit floats.
    pub sums_exactly: bool,
    /// Both bytes are sent each millisecond.
    pub floods: bool,
    /// Gates are chosen by the fielded rule.
    pub gates_as_fielded: bool,
}

/// Settings of the program.
#[derive(Clone, Debug)]
pub struct Config {
    /// Initial pose of the car: the rear axle's middle.
    pub start: CarPose,
    /// The car's map; without one the car drives by odometry and cannot plan.
    pub floor: FloorPlan,
    /// Format of the odometer's lines; `None`: those of the later sketch, [`odometer::Raw`].
    pub dialect: Option<odometer::Dialect>,
    /// The wall to follow in autonomous driving without a goal, and its distance, metres.
    pub wall: Option<(Side, f64)>,
    /// Seed of the localisation's random numbers.
    pub seed: u64,
    /// Enabled defects of the fielded program.
    pub defects: Defects,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            start: CarPose::default(),
            floor: FloorPlan::default(),
            dialect: Some(odometer::Dialect::Fixed),
            wall: None,
            seed: 0,
            defects: Defects::default(),
        }
    }
}

/// Counters for reports.
#[derive(Clone, Copy, Debug, Default)]
struct Counters {
    frames: u64,
    bad_frames: u64,
    lines: u64,
    bad_lines: u64,
    scans: u64,
    bad_messages: u64,
    packets: u64,
    bad_packets: u64,
    too_near: u64,
    doubts: u64,
    lost: u64,
}

/// The program.
#[derive(Clone, Debug)]
pub struct Apollo13 {
    config: Config,
    board: Board,
    lines: odometer::Decoder,
    raw_lines: RawLines,
    arbiter: Arbiter,
    odometry: GyroOdometry,
    watch: OdometerWatch,
    camera: CameraWatch,
    gyro: GyroWatch,
    /// Odometry of the board.
    by_board: BoardOdometry,
    /// Odometry from encoder and steering table.
    steered: CarPose,
    /// The odometry at the last line, and the board's pose then.
    at_line: (GyroOdometry, CarPose),
    witness: Witness,
    /// Time of the odometer's last line by its own clock, seconds.
    odometer_s: f64,
    localiser: Option<Localiser>,
    /// Pose of the odometry's origin on the map.
    origin: CarPose,
    floor: Floor,
    /// The map under construction, from the order to map until another order.
    survey: Option<Survey>,
    /// Time of the last choice of a view.
    chosen: Option<Instant>,
    /// Time and pose since which the car has made no progress while it maps.
    got_on: Option<(Instant, CarPose)>,
    pilot: Pilot,
    gates: Gates,
    passage: Option<Passage>,
    search: search::Search,
    /// Balance of scans that do not fit at the believed pose.
    misfits: u8,
    wall: Option<WallDistance>,
    wall_heard: Option<Instant>,
    wall_angle_rad: f64,
    board_heard: Option<Instant>,
    board_read: Option<Instant>,
    /// The board's last readings, and the pose by odometry when they first came.
    same: Option<(car_board::Readings, CarPose)>,
    ultrasound_m: [Option<f64>; 3],
    battery_mv: u16,
    scan: alloc::vec::Vec<Point>,
    sight: sight::Sight,
    seen: Option<Instant>,
    sent: Option<Instant>,
    drive: Drive,
    out: VecDeque<u8>,
    now: Instant,
    counters: Counters,
}

/// Parser of the board's frames.
#[derive(Clone, Debug)]
enum Board {
    Sound(car_board::Decoder),
    Fielded(car_board::FieldedDecoder),
}

impl Board {
    fn new(loses_frames: bool) -> Self {
        match loses_frames {
            true => Self::Fielded(car_board::FieldedDecoder::default()),
            false => Self::Sound(car_board::Decoder::default()),
        }
    }
}

impl Apollo13 {
    /// The car's board, [`car_board::BAUD`].
    pub const CAR: Port = Port(0);
    /// The odometer, [`odometer::BAUD`].
    pub const ODOMETER: Port = Port(1);
    /// The camera's scans.
    pub const SCAN: Port = Port(2);
    /// Markers.
    pub const MARKERS: Port = Port(3);
    /// The phone.
    pub const REMOTE: Port = Port(4);

    /// A program in its initial state.
    pub fn new(config: Config) -> Self {
        let defects = config.defects;
        let floor = Floor::new(config.floor.clone(), INFLATION);
        let localiser = floor
            .is_known()
            .then(|| place::localiser(&config, config.start));
        let outline = Outline::rectangle(0.359 + ROOM_M, 0.101 + ROOM_M, 0.165 + ROOM_M);
        let rules = match defects.gates_as_fielded {
            true => gates::Settings::fielded(),
            false => gates::Settings::default(),
        };
        let odometry = GyroOdometry::new(CarPose::default(), defects.odometry);
        let wall = config.wall;
        let wall = wall.map(|(side, wanted_m)| WallDistance::new(side, wanted_m, Gains::default()));
        Self {
            board: Board::new(defects.loses_frames),
            lines: odometer::Decoder::default(),
            raw_lines: RawLines::default(),
            arbiter: Arbiter::new(defects.arbiter),
            at_line: (odometry.clone(), CarPose::default()),
            odometry,
            watch: OdometerWatch::default(),
            camera: CameraWatch::default(),
            gyro: GyroWatch::default(),
            by_board: BoardOdometry::default(),
            steered: CarPose::default(),
            witness: Witness::default(),
            odometer_s: 0.0,
            localiser,
            origin: config.start,
            floor,
            survey: None,
            chosen: None,
            got_on: None,
            pilot: Pilot::new(PrimitiveSet::car(), &outline, follower::Settings::default()),
            gates: Gates::new(rules),
            passage: None,
            search: search::Search::default(),
            misfits: 0,
            wall,
            wall_heard: None,
            wall_angle_rad: 0.0,
            board_heard: None,
            board_read: None,
            same: None,
            ultrasound_m: [None; 3],
            battery_mv: 0,
            scan: alloc::vec::Vec::new(),
            sight: sight::Sight::default(),
            seen: None,
            sent: None,
            drive: Drive::STOP,
            out: VecDeque::new(),
            now: Instant::ZERO,
            counters: Counters::default(),
            config,
        }
    }

    /// The car's believed pose on its map: the rear axle's middle.
    pub fn pose(&self) -> CarPose {
        let moved = CarPose::default().motion_to(self.odometry.pose());
        self.origin.then(moved)
    }

    /// The pose by the odometry alone, from the program's start.
    pub const fn reckoned(&self) -> CarPose {
        self.odometry.pose()
    }

    /// Sets a goal on the map, or none.
    pub fn set_goal(&mut self, goal: Option<CarPose>) {
        self.pilot.set_goal(goal);
    }

    /// Sets the gains of the wall follower.
    pub fn set_wall_gains(&mut self, gains: Gains) {
        let wall = self.config.wall;
        self.wall = wall.map(|(side, wanted_m)| WallDistance::new(side, wanted_m, gains));
    }

    /// The pilot with the path to the goal.
    pub const fn pilot(&self) -> &Pilot {
        &self.pilot
    }

    /// Markers and gates.
    pub const fn gates(&self) -> &Gates {
        &self.gates
    }

    /// Positions of obstacle cells that are not on the map, metres.
    pub fn in_the_way(&self) -> impl Iterator<Item = [f64; 2]> {
        self.floor.in_the_way()
    }

    /// The guesses of the car's pose.
    pub fn particles(&self) -> &[crate::particles::Particle] {
        self.localiser.as_ref().map_or(&[], Localiser::particles)
    }

    /// The last command sent to the board.
    pub const fn drive(&self) -> Drive {
        self.drive
    }

    /// Ultrasonic ranges ahead, to the right and to the left, metres, as last received.
    pub const fn ultrasound_m(&self) -> [Option<f64>; 3] {
        self.ultrasound_m
    }

    /// The battery's voltage as last received, millivolts; 0: not yet.
    pub const fn battery_mv(&self) -> u16 {
        self.battery_mv
    }

    /// The planner's command: through gates, to the goal, or along the wall.
    fn planned(&mut self) -> Option<Drive> {
        let pose = self.pose();
        self.begin_or_end_mapping(pose);
        match self.arbiter.mode() {
            Mode::Gates => self.choose_gate(pose),
            Mode::Mapping => self.explore(pose),
            Mode::Autonomous => {}
            _ => return None,
        }
        // The car stops while its odometer restarts, because its pose is unknown then. It continues
        // without a lost odometer.
        if self.watch.wants_rest() {
            return Some(Drive::STOP);
        }
        if self.lacks().is_some() || self.is_lost() && self.uses_camera() {
            return Some(Drive::STOP);
        }
        let is_driving = self.pilot.goal().is_some();
        let [speed_m_s, angle_rad] = match is_driving {
            true => {
                let (floor, now) = (&mut self.floor, self.now);
                self.pilot.drive(now, pose, || floor.costs(now))?
            }
            false if self.survey.is_some() => return None,
            false if self.hears_wall() => [0.22, self.wall_angle_rad],
            false if self.wall.is_some() => return Some(Drive::STOP),
            false => return None,
        };
        if speed_m_s > 0.0 && self.is_too_near() {
            self.counters.too_near += 1;
            // The map contains the obstacle by now: plan another path, or none.
            if is_driving {
                self.pilot.plan_anew();
            }
            return Some(Drive::STOP);
        }
        Some(Drive {
            level: steering::level_for(speed_m_s),
            steering: steering::value_for(angle_rad.to_degrees()).unwrap_or(steering::STRAIGHT),
        })
    }

    /// Whether the camera has not fitted the map for a long time: an operator must give the car's
    /// pose.
    const fn is_lost(&self) -> bool {
        self.misfits >= MISFITS_MAX
    }

    /// Name of the mode in which the car waits for a silent sensor: for its board if it follows
    /// walls, for its camera in all other drives.
    fn lacks(&self) -> Option<&'static str> {
        let is_new = |read: Instant| self.now - read <= WALL_SILENT_MAX;
        if self.follows_walls() && !self.board_read.is_some_and(is_new) {
            return Some("board silent");
        }
        let is_blind = self.uses_camera() && self.camera.is_blind(self.now);
        is_blind.then_some("camera silent")
    }

    /// Whether the car drives by itself along walls, which needs the sensors of its board.
    fn follows_walls(&self) -> bool {
        self.wall.is_some() && self.arbiter.mode() == Mode::Autonomous
    }

    /// Whether the car drives to a goal, passes gates or maps.
    fn uses_camera(&self) -> bool {
        !self.follows_walls() || self.pilot.goal().is_some()
    }

    /// Whether there is a wall to follow, and the board has recently reported its distance.
    fn hears_wall(&self) -> bool {
        let is_new = |heard: Instant| self.now - heard <= WALL_SILENT_MAX;
        self.wall.is_some() && self.wall_heard.is_some_and(is_new)
    }

    fn is_too_near(&self) -> bool {
        self.ultrasound_m[0].is_some_and(|range_m| range_m < TOO_NEAR_M)
    }

    fn send(&mut self) {
        let planned = self.planned();
        self.drive = self.arbiter.decide(self.now, planned);
        let Drive { level, steering } = self.drive;
        self.note_command();
        if level != 0 {
            self.watch.roll(self.now);
        }
        let level = car_board::Level::new(level.into()).unwrap_or(car_board::Level::STOP);
        self.out
            .push_back(car_board::Command::Motor(level).encode());
        if let Ok(steering) = car_board::Steering::new(steering.into()) {
            self.out
                .push_back(car_board::Command::Steering(steering).encode());
        }
        // Commands that the line has not taken are outdated: only the newest pair counts.
        while self.out.len() > 2 {
            self.out.pop_front();
        }
    }

    const fn send_every(&self) -> Duration {
        match self.config.defects.floods {
            true => FIELDED_SEND_EVERY,
            false => SEND_EVERY,
        }
    }
}

/// Margin of plans around the car, metres: the error of following.
const ROOM_M: f64 = 0.03;
/// The rear end is the outline's nearest side, as its reference point is the rear axle's middle.
const INFLATION: Inflation = Inflation {
    inscribed_m: 0.101 + ROOM_M,
    radius_m: 0.40,
};

impl Master for Apollo13 {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        self.now = self.now.max(now);
        match port {
            Self::CAR => self.hear_board(bytes),
            Self::ODOMETER => self.hear_odometer(bytes),
            Self::SCAN | Self::MARKERS => self.see(bytes),
            Self::REMOTE => self.hear_phone(bytes),
            _ => {}
        }
    }

    fn poll(&mut self, now: Instant) {
        self.now = self.now.max(now);
        self.let_board_idle();
        self.watch.poll(self.now);
        self.camera.poll(self.now);
        if self
            .sent
            .is_none_or(|sent| self.now - sent >= self.send_every())
        {
            self.sent = Some(self.now);
            self.send();
        }
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        if port != Self::CAR {
            return 0;
        }
        let len = buf.len().min(self.out.len());
        for (slot, byte) in buf.iter_mut().zip(self.out.drain(..len)) {
            *slot = byte;
        }
        len
    }

    fn line_change(&mut self, port: Port) -> Option<LineEvent> {
        let is_opened = port == Self::ODOMETER && self.watch.take_opening();
        is_opened.then_some(LineEvent::Opened)
    }

    fn may_send(&self, port: Port) -> bool {
        port == Self::ODOMETER || port == Self::CAR && !self.out.is_empty()
    }

    fn poll_at(&self) -> Option<Instant> {
        Some(
            self.sent
                .map_or(Instant::ZERO, |sent| sent + self.send_every()),
        )
    }

    fn line_config(&self, port: Port) -> LineConfig {
        LineConfig::new_8n1(match port {
            Self::CAR => car_board::BAUD,
            Self::ODOMETER => odometer::BAUD,
            // Wireless in the seed: at most 54 Mbit/s.
            _ => 20_000_000,
        })
    }

    fn take_work(&mut self) -> Work {
        // The program runs on a PC.
        Work::NONE
    }
}
