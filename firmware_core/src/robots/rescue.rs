//! The rescue robot of 2015: maps with a lidar, drives along walls or to waypoints, reports to a
//! PC.
//!
//! ```text
//!   lidar --bytes--> turn --+                 +--> set-points --> base
//!                           +--> match, map --+
//!   base --encoders--> odometry               +--> pose, rows --> radio --> PC
//!                                             +--> picture --> display
//! ```
//!
//! Input is handled at once, as by an interrupt ([`receive`](crate::Master::receive)): packets
//! become turns, readings become odometry, orders take effect. The search is the only long work. It
//! runs once per turn in [`poll`](crate::Master::poll), and its result takes effect in the next
//! call, which knows the time that the search took.

mod blind;
mod board_settings;
mod config;
mod decide;
mod defects;
mod drive;
mod explore;
mod health;
mod kept;
mod kits;
mod lidar;
mod lost;
mod master;
mod movers;
mod orders;
mod report;
mod screen;
mod stall;
mod touch;
mod victims;

use core::time::Duration;

use protocols::pcui::message::{Mode, State};
use protocols::{Instant, LineConfig, Port, xv11};

pub use config::{Config, Display, Infrared, Smear, Turning, WHEELS};
pub use defects::{Defects, Own};
pub use drive::Battery;
pub use explore::Progress;
pub use victims::{VICTIMS_MAX, Victim};

use crate::Work;
use crate::navigation::{HALT, Navigator, Surroundings};
use crate::pc_link::{PcLink, View};
use crate::pose::{Pose, PoseChange};
use crate::radio_setup::RadioSetup;
use crate::scan::Scan;
use crate::slam::Mapper;
use crate::waypoints::{Waypoint, Waypoints};
use blind::Blind;
use drive::Drive;
use explore::Explore;
use health::Health;
use kept::Kept;
use lidar::Lidar;
use lost::Lost;
use movers::Movers;
use screen::{Screen, Switches};
use victims::Victims;

/// Lifetime of a decision without a newer one: three turns.
const DECISION_HOLDS: Duration = Duration::from_millis(600);
/// Lifetime of a manual drive order (seed report: at least once per second).
const ORDER_HOLDS: Duration = Duration::from_secs(1);
/// Largest set-point that the base accepts.
const SET_POINT_MAX: i8 = 35;
/// Timeout with the defect: longer than any run.
const FOR_EVER: Duration = Duration::from_secs(1_000_000);
/// Poll interval of a program that waits for its lidar.
const BLOCKED_LOOK: Duration = Duration::from_millis(10);
/// Maximum wait of a turn for the encoder reading behind it.
const WHEELS_WAIT: Duration = Duration::from_millis(30);
/// Maximum age of an encoder reading at a turn's end.
const WHEELS_STALE: Duration = Duration::from_millis(60);

/// State of a turn between its completion and the decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No turn to work on.
    Waiting,
    /// A turn is complete; the encoder reading behind it was requested.
    Reading { since: Instant },
    /// The scan was matched and drawn; the next poll gives the time that this took.
    Matched { since: Instant },
}

/// The robot's program.
#[derive(Clone, Debug)]
pub struct Rescue {
    config: Config,
    lidar: Lidar,
    drive: Drive,
    pc: PcLink,
    /// The setup of the radio, while it runs.
    radio_setup: Option<RadioSetup>,
    mapper: Mapper,
    scan: Scan,
    navigator: Navigator,
    explore: Explore,
    victims: Victims,
    blind: Blind,
    movers: Movers,
    kept: Kept,
    health: Health,
    waypoints: Waypoints,
    mode: Mode,
    ordered_at: Instant,
    phase: Phase,
    /// Time of the last matched pose, and the wheels' pose then: a search of the whole map takes
    /// longer than the odometry's history.
    matched: Option<(Instant, Pose)>,
    lost: Lost,
    attend_at: Instant,
    motor_duty: Option<u8>,
    switches: Switches,
    screen: Screen,
    work: Work,
    counters: Counters,
}

// Seed figure S10: the 192 kB of the seed's board were nearly full; this leaves a third of them. A
// map of 28 m takes 8 MB more, and the planner's cells of it 1.5 MB.
const _: () = assert!(
    size_of::<Rescue>()
        <= if cfg!(feature = "large") {
            10 << 20
        } else {
            128 << 10
        }
);

#[derive(Clone, Debug, Default)]
struct Counters {
    scans: u32,
    line_errors: u32,
    refused_waypoints: u32,
    fallbacks: u32,
    arrivals: u32,
}

impl Counters {
    /// All counters at 0.
    const NONE: Self = Self {
        scans: 0,
        line_errors: 0,
        refused_waypoints: 0,
        fallbacks: 0,
        arrivals: 0,
    };
}

impl Rescue {
    /// The XV-11, 115200 baud.
    pub const LIDAR: Port = Port(0);
    /// The AVR base, 1 Mbaud.
    pub const BASE: Port = Port(1);
    /// The HC-06, 460800 baud.
    pub const RADIO: Port = Port(2);
    /// Duty of the lidar's motor: one byte whenever it changes.
    pub const MOTOR: Port = Port(3);
    /// The touch display, 1 Mbaud.
    pub const DISPLAY: Port = Port(4);

    /// A robot just after power-on.
    pub const fn new(config: Config) -> Self {
        let mode = config.initial_mode;
        Self {
            lidar: Lidar::new(LineConfig::new_8n1(xv11::BAUD), &config),
            drive: Drive::new(&config),
            pc: PcLink::new(config.pc_link),
            radio_setup: match config.radio_setup {
                Some(settings) => Some(RadioSetup::new(settings)),
                None => None,
            },
            mapper: Mapper::new(config.mapping),
            scan: Scan::EMPTY,
            navigator: Navigator::new(config.navigation),
            explore: Explore::new(config.sought),
            victims: Victims::new(),
            blind: Blind::new(),
            movers: Movers::new(),
            kept: Kept::new(),
            health: Health::new(),
            waypoints: Waypoints::with_defects(config.defects.waypoints),
            mode,
            ordered_at: Instant::ZERO,
            phase: Phase::Waiting,
            matched: None,
            lost: Lost::new(),
            attend_at: Instant::ZERO,
            motor_duty: None,
            switches: Switches::AT_START,
            screen: Screen::new(),
            work: Work::NONE,
            counters: Counters::NONE,
            config,
        }
    }

    /// The ordered mode.
    pub const fn ordered_mode(&self) -> Mode {
        self.mode
    }

    /// The effective mode: `Stop` while the base does not answer, while a driven wheel does not
    /// count, while an autonomous robot's lidar is blind, or while a robot that drives to a
    /// position is lost.
    pub fn mode(&self) -> Mode {
        let blind = !self.lidar.sees() && self.mode != Mode::Manual;
        if self.drive.is_silent() || self.drive.is_stalled() || blind || self.is_lost() {
            Mode::Stop
        } else {
            self.mode
        }
    }

    /// The waypoints.
    pub const fn waypoints(&self) -> &Waypoints {
        &self.waypoints
    }

    /// The current target waypoint, or the one of waypoint mode.
    pub fn target(&self) -> Option<&Waypoint> {
        self.waypoints.target()
    }

    /// The wheels' set-points, left and right, in ticks per 40 ms.
    pub const fn set_point(&self) -> [i8; 2] {
        self.drive.set_point()
    }

    /// Whether the base has acknowledged the set-points.
    pub const fn set_point_is_confirmed(&self) -> bool {
        self.drive.is_confirmed()
    }

    /// The battery; `None` until the base has reported it.
    pub const fn battery(&self) -> Option<Battery> {
        self.drive.battery()
    }

    /// Believed pose at `now`: the matched pose plus the wheels' motion since.
    pub fn pose_at(&self, now: Instant) -> Pose {
        self.mapper.pose().then(self.motion_until(now))
    }

    /// Motion by the wheels from the last matched pose to `now`.
    fn motion_until(&self, now: Instant) -> PoseChange {
        let odometry = &self.drive.odometry;
        self.matched.map_or(PoseChange::NONE, |(at, pose)| {
            let pose = if odometry.remembers(at) {
                odometry.pose_at(at)
            } else {
                pose
            };
            pose.change_to(odometry.pose_at(now))
        })
    }

    /// Runs the work of an interrupt or a timer: everything that must not wait for the search.
    fn attend(&mut self, now: Instant) {
        self.lidar.tick(now);
        if self.lidar.is_blocked() {
            self.attend_at = now + BLOCKED_LOOK;
            return;
        }
        if self.mode == Mode::Manual && self.order_ends() && now - self.ordered_at >= ORDER_HOLDS {
            self.counters.fallbacks = self.counters.fallbacks.saturating_add(1);
            self.set_mode(now, Mode::Exploration);
        }
        if self.mode() == Mode::Stop {
            self.drive.command(now, HALT, now);
        }
        self.drive.tick(now);
        self.feel(now);
        self.look_near(now);
        self.watch_health(now);
        if let Some(frame) = self.pc.freed(now) {
            self.obey(now, &frame);
        }
        self.set_radio_up(now);
        if self.uses_radio() && now >= self.pc.next_at() {
            let mut places = [[0; 2]; VICTIMS_MAX];
            let view = View {
                map: self.mapper.grid(),
                pose: self.pose_at(now),
                state: self.state(),
                waypoints: &self.waypoints,
                diagnosis: self.diagnosis(),
                victims: self.victims.told(&mut places),
                readings: self.readings(),
                message: self.screen.notices.told(),
            };
            self.pc.tick(now, &view);
        }
        if let Some(duty) = self.lidar.take_duty() {
            self.motor_duty = Some(duty);
        }
        self.attend_at = self.next_attention();
    }

    fn next_attention(&self) -> Instant {
        let mut own = self.lidar.next_at().min(self.drive.next_at());
        if self.uses_radio() {
            own = own.min(self.pc.next_at());
        }
        if let Some(setup) = &self.radio_setup {
            own = own.min(setup.next_at());
        }
        let idle = self.pc.idle_at().unwrap_or(own);
        let order = if self.mode == Mode::Manual && self.order_ends() {
            self.ordered_at + ORDER_HOLDS
        } else {
            own
        };
        own.min(idle).min(order)
    }

    const fn own(&self) -> &Own {
        &self.config.defects.own
    }

    const fn order_ends(&self) -> bool {
        !self.own().manual_never_ends
    }

    /// Whether a defect has ended the program.
    const fn has_ended(&self) -> bool {
        self.waypoints.is_dead() || self.pc.is_dead()
    }

    fn state(&self) -> State {
        State {
            mode: self.mode(),
            speed: self.drive.speed(),
            speed_mm_s: self.drive.speed_mm_s(),
            set_point: self.drive.set_point(),
        }
    }

    /// Stops the robot in any mode; the next scan decides how it continues.
    fn set_mode(&mut self, now: Instant, mode: Mode) {
        self.mode = mode;
        if mode != Mode::Stop {
            self.health.goes_on();
        }
        self.drive.is_mute = self.own().stops_without_a_word && mode == Mode::Stop;
        self.navigator.reset();
        self.explore.pause();
        self.drive.command(now, HALT, now);
    }

    /// Matches and draws the complete turn.
    fn map_turn(&mut self) {
        let has_gap = self.drive.odometry.take_gap();
        let odometry = &self.drive.odometry;
        let turn = self.lidar.take_turn();
        self.scan = match self.config.smear {
            Smear::Undone => Scan::deskewed(turn, &self.config.mounting, odometry),
            Smear::Kept => Scan::raw(turn, &self.config.mounting),
        };
        let end = self.scan.end;
        let motion = self.matched.is_some().then(|| self.motion_until(end));
        if let Some(motion) = motion {
            self.mapper.predict(motion);
        }
        let lidar = self.config.mounting.position;
        let known = motion.filter(|_| !has_gap);
        self.movers.take(&self.scan, lidar, known);
        self.kept.take(&self.scan, known);
        self.matched = Some((end, odometry.pose_at(end)));
        // Without a known motion, a moving robot would drag the map along with it.
        let knows_motion = odometry
            .updated_at()
            .is_some_and(|at| at + WHEELS_STALE >= end);
        Lost::before(&mut self.mapper, knows_motion, has_gap);
        let outcome = if knows_motion && self.switches.mapping {
            let speed = self.drive.speed().map(i16::from);
            self.mapper.integrate(&self.scan, speed)
        } else {
            self.mapper.locate(&self.scan)
        };
        self.lost.after(&mut self.mapper, outcome.certainty);
        self.counters.scans = self.counters.scans.saturating_add(1);
        self.work.scans += 1;
        self.work.tries = self.work.tries.saturating_add(outcome.tries);
        self.work.points = self.work.points.saturating_add(outcome.points);
    }

    /// Decides the drive, from the newest scan and the wheels' motion since.
    fn navigate(&mut self, now: Instant) {
        let since = self.motion_until(now);
        let pose = self.mapper.pose().then(since);
        let mut around = Surroundings::seen(&self.scan, since);
        around.add(self.blind.seen_from(pose));
        around.add(self.kept.seen_after(since));
        let set_point = match self.mode() {
            Mode::Stop => HALT,
            Mode::Manual => return,
            _ if !self.lidar.is_steady() => HALT,
            Mode::Exploration => self.navigator.explore(pose, &around),
            Mode::Waypoint => self.approach(pose, &around),
            Mode::Explore => self.search(now, pose, &around),
        };
        let set_point = self.movers.guarded(set_point);
        self.drive.command(now, set_point, now + DECISION_HOLDS);
    }
}

#[cfg(test)]
mod tests;
