//! What an observer may ask of a robot in a rig: page, report, history, score and checkers use
//! nothing else.

use core::time::Duration;
use std::borrow::Cow;

use emulators::world::Pose;
use firmware_core::map_view::MapView;
use protocols::Instant;
use serde::Serialize;

use super::axis::Axis;
use super::checker::Checker;
use super::overlay::Overlay;
use super::station::Station;
use crate::codec::Codec;
use crate::picture::Picture;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::scenario::device::scan::ScanDecoder;

/// How the axes are commanded.
#[derive(Clone, Copy)]
pub struct Dialect {
    /// Link on which commands travel.
    pub link: &'static str,
    /// The longest frame, bytes.
    pub frame_max: usize,
    /// What the valid frame with which these bytes end commands, if they end with one that
    /// commands: for each axis the set-point as the axis can follow it.
    pub command: fn(&[u8]) -> Option<Command>,
}

/// What a frame commands: a set-point for each axis that it names, in the order of the axes.
pub type Command = Vec<Option<f64>>;

/// When a device must have stopped its axes by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Silence {
    /// Link on which commands travel.
    pub link: &'static str,
    /// Silence of the master after which set-points must be zero.
    pub silence_max: Duration,
}

/// A device that drives axes, and when it stops them by itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stops {
    /// Link on which commands travel.
    pub link: String,
    /// Silence of the master after which set-points must be zero; `None`: it has no watchdog.
    pub silence_max: Option<Duration>,
    /// The axes, by name; none: all of the robot.
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

/// A link from which the robot must receive bytes in order to drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Need {
    /// Its name.
    pub link: Cow<'static, str>,
    /// Modes of the robot in which it needs the link; empty: all but those in `except`.
    pub only: &'static [&'static str],
    /// Modes in which it does not.
    pub except: &'static [&'static str],
    /// Documented silence after which the robot stops, if it is longer than expected of others.
    pub stops_after: Duration,
}

impl Need {
    /// A link that is needed in all modes.
    pub fn always(link: impl Into<Cow<'static, str>>) -> Self {
        Self {
            link: link.into(),
            only: &[],
            except: &[],
            stops_after: Duration::ZERO,
        }
    }

    /// The same, in these modes only.
    #[must_use]
    pub const fn only(mut self, modes: &'static [&'static str]) -> Self {
        self.only = modes;
        self
    }

    /// The same, but not in these modes.
    #[must_use]
    pub const fn except(mut self, modes: &'static [&'static str]) -> Self {
        self.except = modes;
        self
    }

    /// Whether the link is needed in `mode`. Of a program whose mode is unknown only what is needed
    /// in all modes is known.
    pub fn is_needed(&self, mode: Option<&str>) -> bool {
        let Some(mode) = mode else {
            return self.only.is_empty() && self.except.is_empty();
        };
        (self.only.is_empty() || self.only.contains(&mode)) && !self.except.contains(&mode)
    }
}

/// A counter of the program that grows when the program notices that a link is silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alarm {
    /// Name of the link.
    pub link: &'static str,
    /// Name of the counter.
    pub counter: &'static str,
}

/// A figure that the robot reported to its station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Its name, with its unit.
    pub name: &'static str,
    /// When the station received it.
    pub at: Instant,
    /// The reported value.
    pub told: f64,
    /// The value now, as the robot's own devices or its program have it.
    pub truth: f64,
    /// Permitted difference, beside the change since.
    pub tolerance: f64,
}

impl Figure {
    /// The figures of a pose that was reported `at`: place and heading.
    pub fn of_pose(at: Instant, told: Pose, truth: Pose) -> [Self; 3] {
        let place = |name, told: f64, truth: f64| Self {
            name,
            at,
            told: told * 1000.0,
            truth: truth * 1000.0,
            tolerance: 30.0,
        };
        // The nearer of both turns.
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
            },
        ]
    }
}

/// Values that belong together, for page and report.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Panel {
    /// What they are of, e.g. `base registers`.
    pub name: String,
    /// The values.
    pub rows: Vec<PanelRow>,
}

/// A value of a panel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PanelRow {
    /// Its name.
    pub name: Cow<'static, str>,
    /// Where it lies in its device, if it has an address.
    pub address: Option<u32>,
    /// What it is now, as text.
    pub value: String,
    /// Unit of the value, empty if it has none.
    pub unit: Cow<'static, str>,
}

/// People that the robot reports as found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// Where, in the frame of the world, metres.
    pub places: Vec<[f64; 2]>,
    /// Rescue kits that its devices have dropped, if they are known.
    pub kits: Option<usize>,
}

/// The robot's own display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Display<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// All pixels, top row first: five bits red, six green, five blue.
    pub pixels: &'a [u16],
    /// Whether it is lit.
    pub is_on: bool,
}

impl Display<'_> {
    /// Rows of pixels.
    pub const fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    /// What is on it; black if it is dark.
    pub fn picture(&self) -> Picture {
        Picture::from_fn(self.width, self.height(), |x, y| {
            let pixel = self.pixels[y * self.width + x];
            let [high, low] = pixel.to_be_bytes();
            // Five or six bits become eight so that the largest value stays the largest.
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

/// A link on which a device can be told to do something else for good, and the device: nothing but
/// its switch brings it back.
pub type Console = (&'static str, &'static str);

/// What may be asked of a robot in its rig. Everything is optional; what is not answered is not
/// shown and not judged. Looking changes nothing.
pub trait Instruments: Send + Sync {
    /// Set-points of the robot, as its devices accepted them: always the same axes.
    fn axes(&self, _rig: &Rig) -> Vec<Axis> {
        Vec::new()
    }

    /// How the axes are commanded on the wire.
    fn dialect(&self, _rig: &Rig) -> Option<Dialect> {
        None
    }

    /// When the axes must have been stopped.
    fn silence(&self) -> Option<Silence> {
        None
    }

    /// The devices that drive axes, and when each stops by itself.
    fn stops(&self) -> Vec<Stops> {
        self.silence().map(Stops::from).into_iter().collect()
    }

    /// Links from which the robot must receive bytes in order to drive.
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

    /// Links of the station: they carry bytes when a person wants something.
    fn station_links(&self) -> &'static [&'static str] {
        &[]
    }

    /// Counters that tell which links the program found silent.
    fn alarms(&self) -> &'static [Alarm] {
        &[]
    }

    /// Figures that the robot reported to its station, with the true ones.
    fn figures(&self, _rig: &Rig) -> Vec<Figure> {
        Vec::new()
    }

    /// Whether there is a robot that moves; else there are devices on their wires alone.
    fn has_body(&self) -> bool {
        true
    }

    /// Where the robot believes to be, in the frame of the world, metres and radians, and when that
    /// was: from the program in this process if nothing else is said.
    fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        let (at, pose) = rig.program()?.estimate()?;
        Some((at, in_metres(pose)))
    }

    /// How much older than its time an [`estimate`](Self::estimate) may be: of one that came over a
    /// radio it is unknown when it held. It is judged by the nearest true pose of that span, at
    /// most 250 ms.
    fn estimate_age(&self, _rig: &Rig) -> Duration {
        Duration::ZERO
    }

    /// The robot's map.
    fn map<'a>(&'a self, rig: &'a Rig) -> Option<MapView<'a>> {
        rig.program()?.map()
    }

    /// Maps besides [`map`](Self::map) by name: heat, plans, what a station received.
    fn layers<'a>(&'a self, _rig: &'a Rig) -> Vec<(&'static str, MapView<'a>)> {
        Vec::new()
    }

    /// Where the beams of the newest scan ended that the robot used, in the frame of the world,
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

    /// What else is drawn over the world: walls of a scan, roadmaps, plans, guesses. An overlay
    /// that is empty now is left out.
    fn overlays(&self, _rig: &Rig) -> Vec<Overlay> {
        Vec::new()
    }

    /// The link on which a lidar sends, and what reads its turns.
    fn scanner(&self, _rig: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        None
    }

    /// What the robot is doing, in one or two words.
    fn mode(&self, rig: &Rig) -> Option<&'static str> {
        Some(rig.program()?.mode())
    }

    /// Whether a search that the robot does by itself has come to its end; `None` if there is none.
    fn is_done(&self, rig: &Rig) -> Option<bool> {
        rig.program()?.is_done()
    }

    /// The people that the robot has found; `None` if it does not search.
    fn found(&self, _rig: &Rig) -> Option<Found> {
        None
    }

    /// Values to be shown, always the same panels.
    fn panels(&self, _rig: &Rig) -> Vec<Panel> {
        Vec::new()
    }

    /// The robot's own display.
    fn display<'a>(&'a self, _rig: &'a Rig) -> Option<Display<'a>> {
        None
    }

    /// A finger touches the display at `place`, column and row, at `at`; whether there is one.
    fn tap(&self, _rig: &mut Rig, _at: Instant, _place: [u16; 2]) -> bool {
        false
    }

    /// The other end of the robot's radio or telemetry link, if it is emulated.
    fn station<'a>(&'a self, _rig: &'a Rig) -> Option<&'a dyn Station> {
        None
    }

    /// The same, to plan what it does later.
    fn station_mut<'a>(&'a self, _rig: &'a mut Rig) -> Option<&'a mut dyn Station> {
        None
    }

    /// What a link speaks, if it is known.
    fn codec(&self, _rig: &Rig, _link: &str) -> Option<&'static Codec> {
        None
    }

    /// The same for one way of a link whose ways speak differently.
    fn codec_towards(
        &self,
        rig: &Rig,
        link: &str,
        _direction: Direction,
    ) -> Option<&'static Codec> {
        self.codec(rig, link)
    }

    /// Checkers that only this robot needs. They may listen to the rig.
    fn checkers(&self, _rig: &mut Rig) -> Vec<Box<dyn Checker>> {
        Vec::new()
    }

    /// Links that carry something only when there is something to tell, e.g. of what a camera
    /// recognises: that they are silent says nothing.
    fn sporadic_links(&self) -> &'static [&'static str] {
        &[]
    }

    /// Links that reach a console, for faults that are made by chance.
    fn consoles(&self) -> &'static [Console] {
        &[]
    }
}

/// A robot of which nothing is known but its rig.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unknown;

impl Instruments for Unknown {}

/// A program's pose in the world's units: map and world share their frame.
pub fn in_metres(pose: firmware_core::pose::Pose) -> Pose {
    let [x, y, theta] = [pose.x_mm, pose.y_mm, pose.heading].map(f64::from);
    Pose::new(x / 1000.0, y / 1000.0, theta)
}
