//! The operator's station of a robot: the other end of its radio or telemetry link, and the hand at
//! the page that uses it.

use core::time::Duration;

use emulators::Device;
use firmware_core::map_view::MapView;
use protocols::{Instant, Port};
use serde::Serialize;

use crate::scenario::{Action, SetPoint, Step};

/// Silence of the driver by hand after which the robot is stopped: a page that hangs or was
/// closed must not continue driving.
pub const HAND_OFF: Duration = Duration::from_millis(1000);

/// A mode with a place and a heading behind its name, metres and degrees: its name and the figures,
/// as [`PlaceAct`] has it.
pub fn with_pose(mode: &str) -> Option<(&str, [f32; 3])> {
    let mut words = mode.split_whitespace();
    let name = words.next()?;
    let figures: Vec<f32> = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let figures = <[f32; 3]>::try_from(figures).ok()?;
    let are_finite = figures.iter().all(|figure| figure.is_finite());
    are_finite.then_some((name, figures))
}

/// Orders. Places are in millimetres of the robot's map.
#[derive(Clone, Debug, PartialEq)]
pub enum Gesture {
    /// Another waypoint at the end of the list.
    Add {
        /// The position.
        at: [i32; 2],
    },
    /// Moves a waypoint.
    Move {
        /// Its place in the list, from 0.
        index: usize,
        /// Its position, as displayed to the operator.
        from: [i32; 2],
        /// Its destination.
        to: [i32; 2],
    },
    /// A waypoint is taken out of the list.
    Delete {
        /// Its place in the list, from 0.
        index: usize,
        /// Its position, as displayed to the operator.
        at: [i32; 2],
    },
    /// All waypoints are taken out.
    Clear,
    /// The robot's order: one of the station's [modes](Station::modes).
    Mode(String),
    /// The axes' set-points by hand, in their order and unit.
    Drive(Vec<SetPoint>),
    /// Opens the port.
    Connect,
    /// Closes it.
    Disconnect,
}

impl Gesture {
    /// The reaction of a station that only has a list of `places`, metres.
    ///
    /// # Errors
    /// A sentence, if there is no such place.
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
    /// The waypoints, millimetres of the robot's map: the last sent ones until they are confirmed.
    pub waypoints: Vec<[i16; 2]>,
    /// Whether the robot has them all.
    pub confirmed: bool,
    /// Rows of the map that have not come yet.
    pub rows_missing: Option<usize>,
    /// The last order: mode and set-points.
    pub order: Option<(&'static str, Vec<SetPoint>)>,
    /// Received bytes.
    pub bytes: u64,
    /// Frames, messages and rows that were damaged.
    pub bad: u64,
}

/// A robot's reports about itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StationState {
    /// Its mode.
    pub mode: &'static str,
    /// Speeds of its wheels or axes, mm/s.
    pub speed: Vec<SetPoint>,
    /// Set-points in force.
    pub to: Vec<SetPoint>,
}

/// Effect of keys on the set-points of the axes, in the axes' order and unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveKeys {
    /// Change by the forward key; the backward key subtracts it.
    pub ahead: Vec<SetPoint>,
    /// Change by the left key; the right key subtracts it.
    pub left: Vec<SetPoint>,
    /// Greatest set-point either way, of each axis.
    pub limit: Vec<SetPoint>,
}

/// Something that a station can do with a place: a mode with figures behind its name, the place in
/// metres of the robot's map, and the heading in degrees if there is one, as in `go-to 0.5 1.2 90`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PlaceAct {
    /// Name of the mode.
    pub mode: &'static str,
    /// Its effect, in a sentence.
    pub about: &'static str,
    /// Whether a heading follows the place.
    pub heading: bool,
}

/// The other end of a robot's link, steered by a mission's steps and by gestures.
pub trait Station {
    /// The modes that it can order.
    fn modes(&self) -> &'static [&'static str];

    /// Its actions with a position on the map.
    fn place_acts(&self) -> &'static [PlaceAct] {
        &[]
    }

    /// Manual control by keys; `None` if it has none.
    fn keys(&self) -> Option<DriveKeys> {
        None
    }

    /// Its knowledge at `now`.
    fn view(&self, now: Instant) -> StationView;

    /// The map that it received.
    fn map(&self) -> Option<MapView<'_>>;

    /// Whether it has all of the robot's map, if robots like this one send it.
    fn has_whole_map(&self) -> Option<bool> {
        None
    }

    /// The reported pose of the robot, metres and radians of its map.
    fn stated_pose(&self) -> Option<emulators::world::Pose>;

    /// Its reaction to `gesture`.
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

    /// Performs actions that are due at `now`; a station has no world.
    fn tick(&mut self, now: Instant);

    /// Size of the drawn robot, metres.
    fn radius_m(&self) -> f64;
}

/// The operator's hand on the axes. Says what to order when the hand moves, and lets go by itself.
#[derive(Clone, Debug, Default)]
pub struct Hand {
    held: Option<(Vec<SetPoint>, Instant)>,
}

impl Hand {
    /// The hand asks for `set_point` at `now`, of a clock that also runs while the run is paused;
    /// what to order, if it is news.
    pub fn hold(&mut self, now: Instant, set_points: &[SetPoint]) -> Option<Gesture> {
        let before = self.held.replace((set_points.to_owned(), now));
        let is_news = before.is_none_or(|(before, _)| before != set_points);
        is_news.then(|| Gesture::Drive(set_points.to_owned()))
    }

    /// Another order came.
    pub fn let_go(&mut self) {
        self.held = None;
    }

    /// What to order because the hand has not been felt for [`HAND_OFF`].
    pub fn tick(&mut self, now: Instant) -> Option<Gesture> {
        let (mut set_points, _) = self.held.take_if(|(_, since)| now - *since >= HAND_OFF)?;
        let is_rest = set_points.iter().all(|one| *one == SetPoint::default());
        set_points.fill(SetPoint::default());
        (!is_rest).then_some(Gesture::Drive(set_points))
    }
}
