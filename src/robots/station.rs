//! Whoever steers a robot from afar: the far end of its radio or telemetry link, and the hand at
//! the page that uses it.

use core::time::Duration;

use emulators::Device;
use firmware_core::map_view::MapView;
use protocols::{Instant, Port};
use serde::Serialize;

use crate::scenario::{Action, ModeSpec, Step};

/// Silence of whoever drives by hand after which the robot is stopped: a page that hangs or was
/// closed must not go on driving.
pub const HAND_OFF: Duration = Duration::from_millis(1000);

/// What somebody wants. Places are in millimetres of the robot's map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gesture {
    /// Another waypoint at the end of the list.
    Add {
        /// Where.
        at: [i32; 2],
    },
    /// A waypoint goes elsewhere.
    Move {
        /// Its place in the list, from 0.
        index: usize,
        /// Where it is, as whoever moves it sees it.
        from: [i32; 2],
        /// Where it goes.
        to: [i32; 2],
    },
    /// A waypoint is taken out of the list.
    Delete {
        /// Its place in the list, from 0.
        index: usize,
        /// Where it is, as whoever deletes it sees it.
        at: [i32; 2],
    },
    /// All waypoints are taken out.
    Clear,
    /// What the robot shall do.
    Mode(ModeSpec),
    /// The axes' set-points by hand.
    Drive([i8; 2]),
    /// Opens the port.
    Connect,
    /// Closes it.
    Disconnect,
}

/// What a station knows of its robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StationView {
    /// `closed`, `opening` or `connected`.
    pub connection: &'static str,
    /// Since the robot last told something, milliseconds.
    pub heard_ms: Option<u64>,
    /// What the robot says that it does.
    pub state: Option<StationState>,
    /// Where it says that it is: millimetres and degrees of its map.
    pub pose: Option<[i16; 3]>,
    /// Size of its map, millimetres.
    pub size_mm: Option<[u16; 2]>,
    /// The waypoints, millimetres of its map: what was sent last until it is confirmed.
    pub waypoints: Vec<[i16; 2]>,
    /// Whether the robot has them all.
    pub confirmed: bool,
    /// Rows of the map that have not come yet.
    pub rows_missing: Option<usize>,
    /// What it was last ordered: mode and set-points.
    pub order: Option<(&'static str, [i8; 2])>,
    /// Bytes that came.
    pub bytes: u64,
    /// Frames, messages and rows that were damaged.
    pub bad: u64,
}

/// What a robot tells of itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StationState {
    /// Its mode.
    pub mode: &'static str,
    /// Speed of the wheels, mm/s.
    pub speed: [i16; 2],
    /// Set-points in force.
    pub to: [i8; 2],
}

/// The far end of a robot's link, steered by a mission's steps and by gestures.
pub trait Station {
    /// What it knows at `now`.
    fn view(&self, now: Instant) -> StationView;

    /// The map that it received.
    fn map(&self) -> Option<MapView<'_>>;

    /// Whether it has all of the robot's map, if robots like this one send it.
    fn has_whole_map(&self) -> Option<bool> {
        None
    }

    /// Where the robot says that it is, metres and radians of its map.
    fn stated_pose(&self) -> Option<emulators::world::Pose>;

    /// What it does about `gesture`, by what it knows.
    ///
    /// # Errors
    /// A sentence, if the gesture makes no sense now.
    fn answer(&self, gesture: Gesture) -> Result<Action, String>;

    /// Puts a step into its script, at `index` among the `mission` steps of the scenario.
    ///
    /// # Errors
    /// A sentence, if the step is beyond the limits of the protocol.
    fn insert_step(&mut self, mission: usize, index: usize, step: &Step) -> Result<(), String>;
}

/// A station by itself, for a real robot on a port.
pub trait RemoteStation: Station + Device {
    /// The port that the robot is on.
    fn port(&self) -> Port;

    /// Does `action` now.
    ///
    /// # Errors
    /// A sentence, if it is beyond the limits of the protocol.
    fn perform(&mut self, now: Instant, action: &Action) -> Result<(), String>;

    /// Does what is due by `now`; a station has no world.
    fn tick(&mut self, now: Instant);

    /// Size of the robot as it is drawn, metres.
    fn radius_m(&self) -> f64;
}

/// Somebody's hand on the axes. Says what to order when the hand moves, and lets go by itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hand {
    held: Option<([i8; 2], Instant)>,
}

impl Hand {
    /// The hand asks for `set_point` at `now`, of a clock that also runs while the run is paused;
    /// what to order, if it is news.
    pub fn hold(&mut self, now: Instant, set_point: [i8; 2]) -> Option<Gesture> {
        let before = self.held.map(|(before, _)| before);
        self.held = Some((set_point, now));
        (before != Some(set_point)).then_some(Gesture::Drive(set_point))
    }

    /// Somebody ordered something else.
    pub fn let_go(&mut self) {
        self.held = None;
    }

    /// What to order because the hand has not been felt for [`HAND_OFF`].
    pub fn tick(&mut self, now: Instant) -> Option<Gesture> {
        let (set_point, since) = self.held?;
        if now - since < HAND_OFF {
            return None;
        }
        self.held = None;
        (set_point != [0, 0]).then_some(Gesture::Drive([0, 0]))
    }
}
