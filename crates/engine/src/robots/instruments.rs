//! The interface through which page, report, history, score and checkers observe a robot in a rig.

use core::time::Duration;
use std::borrow::Cow;

use emulators::world::Pose;
use firmware_core::map_view::MapView;
use protocols::Instant;

use super::axis::Axis;
use super::checker::Checker;
use super::overlay::Overlay;
use super::panel::Panel;
use super::station::Station;
use crate::codec::Codec;
use crate::picture::Picture;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::scenario::device::scan::ScanDecoder;

mod work;

pub use work::{Alarm, Asking, Cycle, Intake, counted};

/// The protocol of commands to the axes.
#[derive(Clone, Copy)]
pub struct Dialect {
    /// Link that carries the commands.
    pub link: &'static str,
    /// Maximum length of a frame, bytes.
    pub frame_max: usize,
    /// The command of the valid frame at the end of the bytes, if there is one: for each axis the
    /// set-point, limited to the range of the axis.
    pub command: fn(&[u8]) -> Option<Command>,
}

/// The command of a frame: a set-point for each axis that it contains, in the order of the axes.
pub type Command = Vec<Option<f64>>;

/// The watchdog of a device that drives axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Silence {
    /// Link that carries the commands.
    pub link: &'static str,
    /// Silence of the master after which set-points must be zero.
    pub silence_max: Duration,
}

/// A device that drives axes, with its watchdog.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stops {
    /// Link that carries the commands.
    pub link: String,
    /// Silence of the master after which set-points must be zero; `None` without a watchdog.
    pub silence_max: Option<Duration>,
    /// Names of the axes; empty: all axes of the robot.
    pub axes: Vec<String>,
}

impl From<Silence> for Stops {
    fn from(silence: Silence) -> Self {
        Self {
            link: silence.link.to_owned(),
            silence_max: Some(silence.silence_max),
            axes: Vec::new(),
        }
    }
}

/// A link from which the robot must receive bytes to drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Need {
    /// Name of the link.
    pub link: Cow<'static, str>,
    /// Modes of the robot that need the link; empty: all modes except those in `except`.
    pub only: &'static [&'static str],
    /// Modes that do not need the link.
    pub except: &'static [&'static str],
    /// Documented silence after which the robot stops, if it is longer than usual.
    pub stops_after: Duration,
}

impl Need {
    /// A link that all modes need.
    pub fn always(link: impl Into<Cow<'static, str>>) -> Self {
        Self {
            link: link.into(),
            only: &[],
            except: &[],
            stops_after: Duration::ZERO,
        }
    }

    /// Restricts the need to these modes.
    #[must_use]
    pub const fn only(mut self, modes: &'static [&'static str]) -> Self {
        self.only = modes;
        self
    }

    /// Excludes these modes from the need.
    #[must_use]
    pub const fn except(mut self, modes: &'static [&'static str]) -> Self {
        self.except = modes;
        self
    }

    /// Whether `mode` needs the link. If the mode is unknown, returns true only if all modes need
    /// it.
    pub fn is_needed(&self, mode: Option<&str>) -> bool {
        let Some(mode) = mode else {
            return self.only.is_empty() && self.except.is_empty();
        };
        (self.only.is_empty() || self.only.contains(&mode)) && !self.except.contains(&mode)
    }
}

/// A value that the robot reported to its station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Name with unit.
    pub name: &'static str,
    /// Time of reception.
    pub at: Instant,
    /// The reported value.
    pub told: f64,
    /// The current value according to the robot's own devices or its program.
    pub truth: f64,
    /// Permitted difference, in addition to the change since the report.
    pub tolerance: f64,
    /// Number of wrong reports in a row that fail: [`Self::CHANGING`], or 1 for a value that is
    /// steady.
    pub wrong_min: u32,
}

impl Figure {
    /// Number of wrong reports of a changing value that fail: a single one may be from a moment
    /// between two updates.
    pub const CHANGING: u32 = 3;

    /// The number of a mode that was reported `at`.
    pub fn of_mode(at: Instant, told: u8, truth: u8) -> Self {
        Self {
            name: "the number of the mode",
            at,
            told: told.into(),
            truth: truth.into(),
            tolerance: 0.0,
            wrong_min: Self::CHANGING,
        }
    }

    /// The values of a pose that was reported `at`: position and heading.
    pub fn of_pose(at: Instant, told: Pose, truth: Pose) -> [Self; 3] {
        let place = |name, told: f64, truth: f64| Self {
            name,
            at,
            told: told * 1000.0,
            truth: truth * 1000.0,
            tolerance: 30.0,
            wrong_min: Self::CHANGING,
        };
        // The smaller of the two rotations.
        let turned = emulators::world::wrap_angle(told.theta - truth.theta);
        [
            place("the x of the pose, mm", told.x, truth.x),
            place("the y of the pose, mm", told.y, truth.y),
            Self {
                name: "the error of the heading, degrees",
                at,
                told: turned.to_degrees(),
                truth: 0.0,
                tolerance: 60.0,
                wrong_min: Self::CHANGING,
            },
        ]
    }
}

/// Victims that the robot reports as found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// Positions in the frame of the world, metres.
    pub places: Vec<[f64; 2]>,
    /// Number of rescue kits that its devices have dropped, if known.
    pub kits: Option<usize>,
}

/// The robot's own display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Display<'a> {
    /// Width in pixels.
    pub width: usize,
    /// All pixels, top row first: five bits red, six green, five blue.
    pub pixels: &'a [u16],
    /// Whether the display is on.
    pub is_on: bool,
}

impl Display<'_> {
    /// Height in pixels.
    pub const fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    /// The displayed picture; black if the display is off.
    pub fn picture(&self) -> Picture {
        Picture::from_fn(self.width, self.height(), |x, y| {
            let pixel = self.pixels[y * self.width + x];
            let [high, low] = pixel.to_be_bytes();
            // Expands five or six bits to eight so that the greatest value stays the greatest.
            let five = |bits: u8| bits << 3 | bits >> 2;
            let green = (high & 0x07) << 3 | low >> 5;
            if self.is_on {
                [five(high >> 3), green << 2 | green >> 4, five(low & 0x1F)]
            } else {
                [0; 3]
            }
        })
    }
}

/// A link over which a device can be switched permanently to a console, and the device: only a
/// power cycle restores it.
pub type Console = (&'static str, &'static str);

/// The observable state of a robot in its rig. All methods are optional; a value that is not
/// provided is neither shown nor judged. Observation has no side effects.
pub trait Instruments: Send + Sync {
    /// The robot's axes with their accepted set-points; always the same axes.
    fn axes(&self, _rig: &Rig) -> Vec<Axis> {
        Vec::new()
    }

    /// The protocol of commands to the axes.
    fn dialect(&self, _rig: &Rig) -> Option<Dialect> {
        None
    }

    /// The watchdog that stops the axes.
    fn silence(&self) -> Option<Silence> {
        None
    }

    /// The devices that drive axes, with their watchdogs.
    fn stops(&self) -> Vec<Stops> {
        self.silence().map(Stops::from).into_iter().collect()
    }

    /// Links from which the robot must receive bytes to drive.
    fn needs(&self) -> Vec<Need> {
        Vec::new()
    }

    /// Links over which the program drives the robot.
    fn drive_links(&self) -> Vec<String> {
        self.stops().into_iter().map(|stops| stops.link).collect()
    }

    /// The link that carries the orders of a station to the robot.
    fn orders_link(&self) -> Option<&'static str> {
        None
    }

    /// Links of the station, the nearest to the robot first: they only carry bytes when an operator
    /// acts.
    fn station_links(&self) -> &'static [&'static str] {
        &[]
    }

    /// Counters that grow when the program detects a silent link.
    fn alarms(&self) -> &'static [Alarm] {
        &[]
    }

    /// Counters of the program for the frames that arrive on its lines.
    fn intakes(&self) -> &'static [Intake] {
        &[]
    }

    /// Counters that grow when the program detects a failure of a link; they must not grow while
    /// the link works.
    fn complaints(&self) -> &'static [Alarm] {
        &[]
    }

    /// Kinds of frames that the program sends steadily.
    fn cycles(&self) -> &'static [Cycle] {
        &[]
    }

    /// The link on which the program repeats unanswered requests.
    fn asking(&self) -> Option<Asking> {
        None
    }

    /// The pose by the robot's dead reckoning alone, in any frame, with its time; only its changes
    /// count.
    fn reckoned(&self, _rig: &Rig) -> Option<(Instant, Pose)> {
        None
    }

    /// Number of times that another source has set this pose: such a change is no motion.
    fn reckoned_anew(&self, _rig: &Rig) -> u64 {
        0
    }

    /// Distance from an obstacle within which the robot drives without a distance from its scanner,
    /// metres, because it has other sensors there.
    fn blind_below_m(&self) -> Option<f64> {
        None
    }

    /// Maximum error of the believed pose of an undisturbed robot, millimetres and degrees, if it
    /// is smaller than usual.
    fn accuracy(&self) -> Option<[f64; 2]> {
        None
    }

    /// Modes in which the program drives to a goal of its own choice or of an order.
    fn goal_modes(&self) -> &'static [&'static str] {
        &[]
    }

    /// Believed bearing of the goal to which the program drives in a straight line, radians,
    /// positive to the left.
    fn goal_bearing(&self, _rig: &Rig) -> Option<f64> {
        None
    }

    /// The lines that the robot last reported to its station, with the time of the report; both
    /// ends in the robot's frame, millimetres.
    fn told_lines(&self, _rig: &Rig) -> Option<(Instant, Vec<[[f64; 2]; 2]>)> {
        None
    }

    /// The points in which the program searches for lines, by their angles; the robot's frame,
    /// millimetres.
    fn searched_points(&self, _rig: &Rig) -> Vec<[f64; 2]> {
        Vec::new()
    }

    /// Values that the robot reported to its station, with the true ones.
    fn figures(&self, _rig: &Rig) -> Vec<Figure> {
        Vec::new()
    }

    /// Whether there is a moving robot; otherwise there are only devices on links.
    fn has_body(&self) -> bool {
        true
    }

    /// The believed pose of the robot in the frame of the world, metres and radians, with its time;
    /// by default that of the program in this process.
    fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        let (at, pose) = rig.program()?.estimate()?;
        Some((at, in_metres(pose)))
    }

    /// Maximum age of an [`estimate`](Self::estimate): a pose that was received over a radio has an
    /// unknown time. It is compared with the nearest true pose of this span, at most 250 ms.
    fn estimate_age(&self, _rig: &Rig) -> Duration {
        Duration::ZERO
    }

    /// The robot's map.
    fn map<'a>(&'a self, rig: &'a Rig) -> Option<MapView<'a>> {
        rig.program()?.map()
    }

    /// Further maps by name: heat, plans, maps received by a station.
    fn layers<'a>(&'a self, _rig: &'a Rig) -> Vec<(&'static str, MapView<'a>)> {
        Vec::new()
    }

    /// End points of the beams in the newest scan that the robot used, in the frame of the world,
    /// metres.
    fn scan(&self, rig: &Rig) -> Vec<[f64; 2]> {
        let Some((program, (_, pose))) = rig
            .program()
            .and_then(|program| Some((program, program.estimate()?)))
        else {
            return Vec::new();
        };
        let places = program.scan().iter().map(|point| pose.to_world(*point));
        let metres = |mm: f32| f64::from(mm.round()) / 1000.0;
        places
            .map(|place| [metres(place.x_mm), metres(place.y_mm)])
            .collect()
    }

    /// Further drawings over the world: walls of a scan, roadmaps, plans, hypotheses. Empty
    /// overlays are left out.
    fn overlays(&self, _rig: &Rig) -> Vec<Overlay> {
        Vec::new()
    }

    /// The link on which a lidar sends, and the decoder of its turns.
    fn scanner(&self, _rig: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        None
    }

    /// The robot's activity in one or two words.
    fn mode(&self, rig: &Rig) -> Option<&'static str> {
        Some(rig.program()?.mode())
    }

    /// Whether the robot's autonomous search has ended; `None` without a search.
    fn is_done(&self, rig: &Rig) -> Option<bool> {
        rig.program()?.is_done()
    }

    /// The victims that the robot has found; `None` if it does not search.
    fn found(&self, _rig: &Rig) -> Option<Found> {
        None
    }

    /// Values for display; always the same panels.
    fn panels(&self, _rig: &Rig) -> Vec<Panel> {
        Vec::new()
    }

    /// The robot's own display.
    fn display<'a>(&'a self, _rig: &'a Rig) -> Option<Display<'a>> {
        None
    }

    /// Touches the display at `place`, column and row, at `at`; returns whether there is a display.
    fn tap(&self, _rig: &mut Rig, _at: Instant, _place: [u16; 2]) -> bool {
        false
    }

    /// The other end of the robot's radio or telemetry link, if it is emulated.
    fn station<'a>(&'a self, _rig: &'a Rig) -> Option<&'a dyn Station> {
        None
    }

    /// As [`station`](Self::station), mutable, to plan its later actions.
    fn station_mut<'a>(&'a self, _rig: &'a mut Rig) -> Option<&'a mut dyn Station> {
        None
    }

    /// The protocol of a link, if it is known.
    fn codec(&self, _rig: &Rig, _link: &str) -> Option<&'static Codec> {
        None
    }

    /// The protocol of one direction of a link whose directions use different protocols.
    fn codec_towards(
        &self,
        rig: &Rig,
        link: &str,
        _direction: Direction,
    ) -> Option<&'static Codec> {
        self.codec(rig, link)
    }

    /// Checks for this robot only. They may observe the rig.
    fn checkers(&self, _rig: &mut Rig) -> Vec<Box<dyn Checker>> {
        Vec::new()
    }

    /// Links that only carry occasional messages, e.g. recognised markers: their silence is not a
    /// fault.
    fn sporadic_links(&self) -> &'static [&'static str] {
        &[]
    }

    /// Links with a console, for randomly generated faults.
    fn consoles(&self) -> &'static [Console] {
        &[]
    }
}

/// Instruments of an unknown robot: only the rig is observable.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unknown;

impl Instruments for Unknown {}

/// A pose of the program in the units of the world: map and world share their frame.
pub fn in_metres(pose: firmware_core::pose::Pose) -> Pose {
    let [x, y, theta] = [pose.x_mm, pose.y_mm, pose.heading].map(f64::from);
    Pose::new(x / 1000.0, y / 1000.0, theta)
}
