//! The operator's station of a robot: the other end of its radio or telemetry link, and manual
//! control from the page.

use core::time::Duration;

use emulators::Device;
use firmware_core::map_view::MapView;
use protocols::{Instant, Port};
use serde::Serialize;

use super::panel::Panel;
use crate::scenario::{Action, SetPoint, Step};

/// The reason why no station executes an action of the rig itself.
pub const NOT_AN_ORDER: &str =
    "is no order of the PC, expected connect, disconnect, waypoints-m, mode or drive";

/// Time without manual input after which the robot is stopped: a page that hangs or was closed must
/// not keep driving.
pub const HAND_OFF: Duration = Duration::from_millis(1000);

/// Splits a mode with a position and a heading behind its name, metres and degrees; see
/// [`PlaceAct`].
pub fn with_pose(mode: &str) -> Option<(&str, [f32; 3])> {
    let mut words = mode.split_whitespace();
    let name = words.next()?;
    let figures: Vec<f32> = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let figures = <[f32; 3]>::try_from(figures).ok()?;
    let are_finite = figures.iter().all(|figure| figure.is_finite());
    are_finite.then_some((name, figures))
}

/// Orders. Positions are in millimetres of the robot's map.
#[derive(Clone, Debug, PartialEq)]
pub enum Gesture {
    /// Adds a waypoint at the end of the list.
    Add {
        /// The position.
        at: [i32; 2],
    },
    /// Moves a waypoint.
    Move {
        /// Index in the list.
        index: usize,
        /// Its position, as displayed to the operator.
        from: [i32; 2],
        /// Its destination.
        to: [i32; 2],
    },
    /// Removes a waypoint from the list.
    Delete {
        /// Index in the list.
        index: usize,
        /// Its position, as displayed to the operator.
        at: [i32; 2],
    },
    /// Removes all waypoints.
    Clear,
    /// The robot's order: one of the station's [modes](Station::modes).
    Mode(String),
    /// Sets the axes by hand, in their order and unit.
    Drive(Vec<SetPoint>),
    /// Opens the port.
    Connect,
    /// Closes the port.
    Disconnect,
}

impl Gesture {
    /// The action of a station that only has a list of `places`, metres.
    ///
    /// # Errors
    /// A message, if the position is not in the list.
    pub fn on(self, places: &[[f64; 2]]) -> Result<Action, String> {
        let mut places = places.to_vec();
        let metres = |at: [i32; 2]| at.map(|mm| f64::from(mm) / 1_000.0);
        let gone = || "the list of places has changed meanwhile".to_owned();
        match self {
            Self::Connect => return Ok(Action::Connect),
            Self::Disconnect => return Ok(Action::Disconnect),
            Self::Mode(mode) => return Ok(Action::Mode(mode)),
            Self::Drive(set_points) => return Ok(Action::Drive(set_points)),
            Self::Clear => places.clear(),
            Self::Add { at } => places.push(metres(at)),
            Self::Move { index, to, .. } => *places.get_mut(index).ok_or_else(gone)? = metres(to),
            Self::Delete { index, .. } if index < places.len() => {
                places.remove(index);
            }
            Self::Delete { .. } => return Err(gone()),
        }
        Ok(Action::WaypointsM(places))
    }
}

/// A station's knowledge of its robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StationView {
    /// `closed`, `opening` or `connected`.
    pub connection: &'static str,
    /// Time since the robot's last message, milliseconds.
    pub heard_ms: Option<u64>,
    /// The reported activity of the robot.
    pub state: Option<StationState>,
    /// The reported pose: millimetres and degrees of the robot's map.
    pub pose: Option<[i16; 3]>,
    /// Size of its map, millimetres.
    pub size_mm: Option<[u16; 2]>,
    /// The waypoints, millimetres of the robot's map: those last sent, until the robot confirms
    /// them.
    pub waypoints: Vec<[i16; 2]>,
    /// Whether the robot has received all waypoints.
    pub confirmed: bool,
    /// Number of rows of the map that have not arrived.
    pub rows_missing: Option<usize>,
    /// The last order: mode and set-points.
    pub order: Option<(&'static str, Vec<SetPoint>)>,
    /// Received bytes.
    pub bytes: u64,
    /// Number of damaged frames, messages and rows.
    pub bad: u64,
}

/// A robot's reports about itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StationState {
    /// Its mode.
    pub mode: &'static str,
    /// Speeds of its wheels or axes, mm/s.
    pub speed: Vec<SetPoint>,
    /// Current set-points.
    pub to: Vec<SetPoint>,
}

/// Effect of keys on the set-points of the axes, in the axes' order and unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveKeys {
    /// Change by the forward key; the backward key subtracts it.
    pub ahead: Vec<SetPoint>,
    /// Change by the left key; the right key subtracts it.
    pub left: Vec<SetPoint>,
    /// Greatest set-point of each axis in both directions.
    pub limit: Vec<SetPoint>,
}

/// A station's action with a position: a mode with values behind its name, the position in metres
/// of the robot's map, and the heading in degrees if there is one, as in `go-to 0.5 1.2 90`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PlaceAct {
    /// Name of the mode.
    pub mode: &'static str,
    /// Effect in one sentence.
    pub about: &'static str,
    /// Whether a heading follows the position.
    pub heading: bool,
    /// Whether the robot drives there.
    pub is_goal: bool,
}

/// The other end of a robot's link, controlled by the steps of a mission and by gestures.
pub trait Station {
    /// The supported modes.
    fn modes(&self) -> &'static [&'static str];

    /// Words for a mode on a button, if its name does not explain it.
    fn mode_words(&self, _mode: &str) -> Option<&'static str> {
        None
    }

    /// Maximum number of places of a list that the protocol carries, if it is limited.
    fn list_max(&self) -> Option<usize> {
        None
    }

    /// Actions with a position on the map.
    fn place_acts(&self) -> &'static [PlaceAct] {
        &[]
    }

    /// Manual control by keys; `None` if not supported.
    fn keys(&self) -> Option<DriveKeys> {
        None
    }

    /// The station's knowledge at `now`.
    fn view(&self, now: Instant) -> StationView;

    /// The received map.
    fn map(&self) -> Option<MapView<'_>>;

    /// Whether the station has received the whole map, if such robots send it.
    fn has_whole_map(&self) -> Option<bool> {
        None
    }

    /// The reported pose of the robot, metres and radians of its map.
    fn stated_pose(&self) -> Option<emulators::world::Pose>;

    /// The action for `gesture`.
    ///
    /// # Errors
    /// A message, if the gesture is not valid now.
    fn answer(&self, gesture: Gesture) -> Result<Action, String>;

    /// Inserts a step into the script, at `index` among the `mission` steps of the scenario.
    ///
    /// # Errors
    /// A message, if the step exceeds the limits of the protocol.
    fn insert_step(&mut self, mission: usize, index: usize, step: &Step) -> Result<(), String>;
}

/// A station without a rig, for a real robot on a port.
pub trait RemoteStation: Station + Device {
    /// The port of the robot.
    fn port(&self) -> Port;

    /// Executes `action` now.
    ///
    /// # Errors
    /// A message, if the action exceeds the limits of the protocol.
    fn perform(&mut self, now: Instant, action: &Action) -> Result<(), String>;

    /// Performs actions that are due at `now`; a station has no world.
    fn tick(&mut self, now: Instant);

    /// Size of the drawn robot, metres.
    fn radius_m(&self) -> f64;

    /// The robot's messages about itself, for display.
    fn panels(&self) -> Vec<Panel> {
        Vec::new()
    }
}

/// Manual control of the axes. Returns the order when the set-points change, and releases the axes
/// after a timeout.
#[derive(Clone, Debug, Default)]
pub struct Hand {
    held: Option<(Vec<SetPoint>, Instant)>,
}

impl Hand {
    /// Sets `set_point` at `now`, on a clock that also runs while the run is paused; returns the
    /// order, if it is new.
    pub fn hold(&mut self, now: Instant, set_points: &[SetPoint]) -> Option<Gesture> {
        let before = self.held.replace((set_points.to_owned(), now));
        let is_news = before.is_none_or(|(before, _)| before != set_points);
        is_news.then(|| Gesture::Drive(set_points.to_owned()))
    }

    /// Ends manual control, because another order came.
    pub fn let_go(&mut self) {
        self.held = None;
    }

    /// The order after [`HAND_OFF`] without manual input.
    pub fn tick(&mut self, now: Instant) -> Option<Gesture> {
        let (mut set_points, _) = self.held.take_if(|(_, since)| now - *since >= HAND_OFF)?;
        let is_rest = set_points.iter().all(|one| *one == SetPoint::default());
        set_points.fill(SetPoint::default());
        (!is_rest).then_some(Gesture::Drive(set_points))
    }
}
