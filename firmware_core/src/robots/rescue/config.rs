use core::f32::consts::FRAC_PI_2;
use core::time::Duration;

use protocols::avr::ChecksumOrder;
use protocols::pcui::message::Mode;

use super::Defects;
use crate::navigation::{self, Body, Sought};
use crate::odometry::WheelGeometry;
use crate::pose::Point;
use crate::scan::{Mounting, WeakReadings};
use crate::{pc_link, radio_setup, slam};

/// Settings of the robot before it starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Byte order of the register bus's checksum.
    pub checksum_order: ChecksumOrder,
    /// Maximum response time of the base. The seed's loop of 65000 turns took 4 to 8 ms; a program
    /// behind a pseudo-terminal needs more.
    pub reply_timeout: Duration,
    /// Map, search, start pose and the search's seed.
    pub mapping: slam::Settings,
    /// Position of the lidar.
    pub mounting: Mounting,
    /// The drive.
    pub wheels: WheelGeometry,
    /// Body, steering, wall follower.
    pub navigation: navigation::Settings,
    /// Target of a search.
    pub sought: Sought,
    /// Correction of the robot's motion while a scan is taken.
    pub smear: Smear,
    /// Source of the robot's turn.
    pub turning: Turning,
    /// Use of the base's infrared sensors.
    pub infrared: Infrared,
    /// Mode of the robot until its first order.
    pub initial_mode: Mode,
    /// Settings that the program sends to the radio before use; `None`: the radio is ready.
    pub radio_setup: Option<radio_setup::Settings>,
    /// The PC link.
    pub pc_link: pc_link::Settings,
    /// Enabled defects of the fielded program, see [`Config::with_defect`].
    pub defects: Defects,
    /// Whether there is a display.
    pub display: Display,
}

impl Config {
    /// The seed report's robot. A constant, so that the robot can be a `static` placed by the
    /// linker: on the board its start needs no second copy on the stack.
    pub const DEFAULT: Self = Self {
        checksum_order: ChecksumOrder::LowFirst,
        reply_timeout: Duration::from_millis(5),
        mapping: slam::Settings::core(slam::DEFAULT_CELL_MM),
        mounting: MOUNTING,
        wheels: WHEELS,
        navigation: navigation::Settings::new(BODY),
        sought: Sought::Floor,
        smear: Smear::Undone,
        turning: Turning::Wheels,
        infrared: Infrared::Unread,
        initial_mode: Mode::Stop,
        radio_setup: None,
        pc_link: pc_link::Settings::DEFAULT,
        defects: Defects::NONE,
        display: Display::Touch,
    };
}

/// Correction of the robot's motion while a scan is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smear {
    /// Each beam is corrected for the motion.
    Undone,
    /// No correction: the report's robot before its improvements.
    Kept,
}

/// Source of the robot's turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turning {
    /// The wheels, which slip.
    Wheels,
    /// The gyroscope of its base.
    Gyroscope,
}

/// Whether the base's infrared sensors are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Infrared {
    /// The sensors are not read, as in the fielded program.
    Unread,
    /// An infrared echo without a lidar point is an obstacle.
    Read,
}

/// Display of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Display {
    /// No display: nothing is drawn.
    None,
    /// The touch display.
    Touch,
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Radius 26 mm, axle 260 mm, 360 ticks a turn. The base samples its encoders at 996 Hz, so it
/// cannot count more than 900 edges a second.
pub const WHEELS: WheelGeometry = WheelGeometry {
    wheel_radius_mm: 26.0,
    axle_mm: 260.0,
    ticks_per_turn: 360,
    ticks_per_second_max: 900,
};

/// Sensor angle 90 points ahead. A packet is sent as soon as its last beam is measured and takes 22
/// bytes of 86.8 us.
const MOUNTING: Mounting = Mounting {
    position: Point {
        x_mm: 0.0,
        y_mm: 0.0,
    },
    first_bearing: -FRAC_PI_2,
    distance_min_mm: 60,
    distance_max_mm: 6000,
    weak: WeakReadings::Use,
    delay: Duration::from_micros(1910),
};

/// The report gives the axle, 260 mm; the radius of the body around it is a guess.
const BODY: Body = Body {
    radius_mm: 160.0,
    clearance_mm: 45.0,
    tick_mm_s: TICK_MM_S,
    axle_mm: 260.0,
};

/// Speed of a wheel per tick in 40 ms: 2 pi 26 mm / 360 / 40 ms.
pub(super) const TICK_MM_S: f32 = 11.345;
