//! A depth camera with its evaluation program. The program turns pictures into two streams of
//! messages: rows of depths (or scans made of them), and recognised markers.
//!
//! ```text
//! world at the camera's height -> a row of depths -> noise, gaps -> `SCAN`     one a picture
//! markers of the settings      -> in view, not hidden, facing    -> `MARKERS`  one a marker
//! ```
//!
//! Messages are those of [`protocols::perception`]. Only the row at the camera's own height is
//! measured: the camera does not see lower objects. Markers belong to the camera's settings, so
//! that the world need not know them. An object hides a marker if it is higher than the lower of
//! camera and marker.
//!
//! Sources: Kinect of 2010: 640 columns, focal length 525 pixels, 0.45 to 10 m by the defaults of
//! the conversion to scans, 30 pictures a second; noise of 1.43 mm at 1 m that grows with the
//! square of the depth (Khoshelham and Elberink, 2012). The share of columns without depth and the
//! error of marker positions are guesses. Pictures, lens distortion and the swing of a camera on a
//! long arm are not modelled.

#[cfg(test)]
mod tests;
mod view;

use core::time::Duration;
use std::collections::VecDeque;

use protocols::perception::{DepthRow, MESSAGE_MAX, Scan};
use protocols::{Instant, LineConfig, Port};

use crate::device::{BrokenRules, Device, Event, earliest};
use crate::event_log::EventLog;
use crate::rng::Rng;
use crate::world::{Scene, World};

/// Messages that wait for the network at most; further ones are lost.
const QUEUE_MAX: usize = 64;
/// Rate of the network, bit/s.
pub const RATE: u32 = 20_000_000;
/// From one picture to the next when the camera is slow, by default.
const SLOW_MS: f64 = 200.0;

/// Message that the camera sends for a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Output {
    /// The depths of one row.
    #[default]
    Depths,
    /// Ranges at even bearings, one a column.
    Scan,
}

/// A marker in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedMarker {
    /// Number of the marker.
    pub id: u16,
    /// Its middle, metres: x, y, and above the floor.
    pub at_m: [f64; 3],
    /// Bearing of its normal, radians in the world's frame.
    pub facing_rad: f64,
}

/// Mounting and optics of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraConfig {
    /// Metres ahead of the reference point of the robot.
    pub x_m: f64,
    /// Metres to the left of it.
    pub y_m: f64,
    /// Bearing, radians counter-clockwise from ahead.
    pub yaw_rad: f64,
    /// Height above the floor, metres. The camera does not see lower objects.
    pub height_m: f64,
    /// Horizontal field of view, radians.
    pub field_rad: f64,
    /// Columns of a row, at most [`protocols::perception::VALUES_MAX`].
    pub columns: u16,
    /// From one picture to the next.
    pub period: Duration,
    /// Minimum and maximum depth, metres.
    pub range_m: [f64; 2],
    /// Standard deviation of a depth at 1 m, metres; it grows with the square of the depth.
    pub noise_m: f64,
    /// Share of the columns without a depth, 0 to 1.
    pub gaps: f64,
    /// Messages that the camera sends.
    pub output: Output,
    /// All markers in the world.
    pub markers: Vec<PlacedMarker>,
}

impl Default for CameraConfig {
    /// In the middle of the robot, looking ahead.
    fn default() -> Self {
        Self {
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad: 0.0,
            height_m: 0.34,
            field_rad: 62.6_f64.to_radians(),
            columns: 640,
            period: Duration::from_nanos(33_333_333),
            range_m: [0.45, 10.0],
            noise_m: 0.001_43,
            gaps: 0.02,
            output: Output::default(),
            markers: Vec::new(),
        }
    }
}

/// Names of the faults.
const FAULTS: [&str; 6] = ["off", "slow", "garbage", "stuck", "blind", "battery"];
/// Share of the columns without a depth while its battery collapses: a guess.
const FAILING: f64 = 0.5;
/// Time from the first gaps to a blank picture, seconds, by default: a guess.
const COLLAPSE_S: f64 = 5.0;

/// Active faults of the camera itself.
#[derive(Clone, Copy, Debug, Default)]
struct Faults {
    is_off: bool,
    is_garbage: bool,
    is_stuck: bool,
    period: Option<Duration>,
    /// Share of the columns without a depth.
    blind: f64,
    /// Its battery is empty from then on.
    empty_at: Option<Instant>,
}

/// The camera.
#[derive(Clone, Debug)]
pub struct Camera {
    config: CameraConfig,
    depth_noise: Rng,
    gap_dice: Rng,
    marker_noise: Rng,
    garbage: Rng,
    /// Objects of the scene higher than the camera, and higher than each marker if the marker is
    /// lower.
    views: Option<Views>,
    /// The last row as drawn; its memory is reused.
    columns: Vec<f64>,
    picture_at: Option<Instant>,
    /// The messages of the last picture, for a camera that is stuck.
    last: [Vec<Vec<u8>>; 2],
    out: [VecDeque<Vec<u8>>; 2],
    faults: Faults,
    log: EventLog,
}

#[derive(Clone, Debug)]
struct Views {
    camera: Scene,
    markers: Vec<Scene>,
}

impl Camera {
    /// Rows of depths or scans.
    pub const SCAN: Port = Port(0);
    /// Markers.
    pub const MARKERS: Port = Port(1);

    /// A camera that is switched on as the run begins. Its noise is that of streams of `seed` that
    /// begin with `name`.
    pub fn new(config: CameraConfig, seed: u64, name: &str) -> Self {
        let stream = |what: &str| Rng::stream(seed, &format!("{name}.{what}"));
        Self {
            depth_noise: stream("depth"),
            gap_dice: stream("gaps"),
            marker_noise: stream("markers"),
            garbage: stream("garbage"),
            views: None,
            columns: Vec::new(),
            picture_at: Some(Instant::ZERO + config.period),
            last: [Vec::new(), Vec::new()],
            out: [VecDeque::new(), VecDeque::new()],
            faults: Faults::default(),
            log: EventLog::default(),
            config,
        }
    }

    fn period(&self) -> Duration {
        self.faults.period.unwrap_or(self.config.period)
    }

    fn take_picture(&mut self, now: Instant, world: &World) {
        if !self.faults.is_stuck {
            let config = &self.config;
            self.views.get_or_insert_with(|| Views::of(config, world));
            let row = self.measure(now, world);
            let markers = self.recognise(now, world);
            self.last = [vec![row], markers];
        }
        for (queue, messages) in self.out.iter_mut().zip(&self.last) {
            for message in messages {
                if queue.len() == QUEUE_MAX {
                    let detail = "the network is slower than the camera".to_owned();
                    self.log.note(now, "message-lost", detail);
                    break;
                }
                let mut message = message.clone();
                if self.faults.is_garbage {
                    message.fill_with(|| self.garbage.next_u64().to_le_bytes()[0]);
                }
                queue.push_back(message);
            }
        }
    }
}

impl Device for Camera {
    /// The camera takes no bytes.
    fn receive(&mut self, _port: Port, _now: Instant, _bytes: &[u8]) {}

    fn poll(&mut self, now: Instant, world: &mut World) {
        if self.faults.empty_at.take_if(|at| *at <= now).is_some() {
            self.picture_at = None;
            let detail = "its battery has collapsed".to_owned();
            self.log.note(now, "undervoltage", detail);
        }
        if let Some(due) = self.picture_at.take_if(|at| *at <= now) {
            // A camera that was polled late continues from then.
            self.picture_at = Some((due + self.period()).max(now));
            self.take_picture(now, world);
        }
        self.log.poll(now);
    }

    /// Sends one message at a time.
    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        let queue = self.out.get_mut(usize::from(port.0));
        let Some(message) = queue.and_then(VecDeque::pop_front) else {
            return 0;
        };
        let len = message.len().min(buf.len());
        buf[..len].copy_from_slice(&message[..len]);
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest([self.picture_at, self.faults.empty_at, self.log.poll_at()])
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        LineConfig::new_8n1(RATE)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &FAULTS
    }

    /// `off`. `slow`: this many milliseconds between pictures, 200 by default. `garbage`: messages
    /// of their lengths, but of random bytes. `stuck`: the last picture forever. `blind`: this
    /// share of the columns has no depth, all by default, and then no marker is recognised.
    /// `battery`: its own pack, which has no protection, collapses within this many seconds, 5 by
    /// default; the end of the fault is a new pack.
    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        match fault {
            "off" => {
                self.faults.is_off = begins;
                self.out.iter_mut().for_each(VecDeque::clear);
                self.picture_at = (!begins).then(|| now + self.period());
            }
            "slow" => {
                let millis = figure.unwrap_or(SLOW_MS).clamp(1.0, 1e6);
                self.faults.period = begins.then(|| Duration::from_secs_f64(millis / 1e3));
            }
            "garbage" => self.faults.is_garbage = begins,
            "stuck" => self.faults.is_stuck = begins,
            "blind" => {
                let share = figure.unwrap_or(1.0).clamp(0.0, 1.0);
                self.faults.blind = if begins { share } else { 0.0 };
            }
            "battery" => {
                let left = Duration::from_secs_f64(figure.unwrap_or(COLLAPSE_S).clamp(0.0, 1e6));
                self.faults.empty_at = begins.then(|| now + left);
                self.faults.blind = if begins { FAILING } else { 0.0 };
                if !begins && !self.faults.is_off {
                    self.picture_at = Some(now + self.period());
                }
            }
            _ => {}
        }
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}

/// The message of a row or scan.
fn message(encode: impl FnOnce(&mut [u8]) -> usize) -> Vec<u8> {
    let mut bytes = vec![0; MESSAGE_MAX];
    let len = encode(&mut bytes);
    bytes.truncate(len);
    bytes
}

/// The message of `values` in the selected form.
fn encoded(output: Output, focal_px: f64, step_urad: (i32, i32), values: &[u16]) -> Vec<u8> {
    match output {
        Output::Depths => {
            let tenths = view::word(focal_px * 10.0);
            message(|out| DepthRow::encode(tenths, values, out))
        }
        Output::Scan => {
            let (first, step) = step_urad;
            message(|out| Scan::encode(first, step, values, out))
        }
    }
}
