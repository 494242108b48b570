//! The link to the PC: telecommands in, telemetry out each 200 ms.

use core::time::Duration;

use protocols::telemetry::message::{
    Infrared, Lidar, Line, LinesRequest, Odometry, POINTS_MAX, State, Telecommand, Telemetry,
};
use protocols::telemetry::{self, FRAME_MAX, PAYLOAD_MAX, message};
use protocols::{Decode, Instant};

use super::scans::Scans;
use crate::lines::{self, Lines};
use crate::pose::{Point, Pose};

/// Period of telemetry.
const PERIOD: Duration = Duration::from_millis(200);
/// Idle time after which a partial frame is discarded. The value only affects the count of bad
/// frames, because a start byte begins a frame anywhere; a radio may pause within a frame.
const IDLE_GAP: Duration = Duration::from_secs(1);

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Defects of the framing.
    pub framing: telemetry::Defects,
    /// A scan too large for the buffer leaves the previous message in it, which is sent again.
    pub resends_stale: bool,
    /// The robot's own message counts as a telecommand if the radio sends it back, because a frame
    /// does not name its sender. A scan's fields are read as those of a pose.
    pub obeys_itself: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        framing: telemetry::Defects {
            deliver_corrupt: false,
            ignore_start: false,
            deaf_while_done: false,
        },
        resends_stale: false,
        obeys_itself: false,
    };
}

/// State that the robot sends.
pub(super) struct View<'a> {
    pub(super) state: State,
    pub(super) pose: Pose,
    pub(super) infrared_m: [f32; 3],
    pub(super) scans: &'a Scans,
    pub(super) lines: lines::Defects,
}

/// The link.
#[derive(Clone, Debug)]
pub(super) struct Radio {
    defects: Defects,
    decoder: telemetry::Decoder,
    received_at: Instant,
    next_at: Instant,
    /// Requests of the PC that are not answered yet.
    scan_step_deg: Option<u32>,
    lines: Option<LinesRequest>,
    payload: [u8; PAYLOAD_MAX],
    payload_len: usize,
    frame: [u8; FRAME_MAX],
    frame_len: usize,
    sent: usize,
    pub(super) counters: Counters,
}

#[derive(Clone, Debug)]
pub(super) struct Counters {
    pub(super) telecommands: u32,
    pub(super) bad_frames: u32,
    pub(super) bad_messages: u32,
    /// The robot's own messages that came back.
    pub(super) echoes: u32,
    pub(super) telemetry: u32,
    /// Messages skipped because the line was still busy.
    pub(super) skipped: u32,
    /// Scans that were too large at the requested resolution.
    pub(super) over_size: u32,
    pub(super) lines_left_out: u32,
}

impl Radio {
    pub(super) const fn new(defects: Defects) -> Self {
        Self {
            defects,
            decoder: telemetry::Decoder::new(defects.framing),
            received_at: Instant::ZERO,
            next_at: Instant::ZERO,
            scan_step_deg: None,
            lines: None,
            payload: [0; PAYLOAD_MAX],
            payload_len: 0,
            frame: [0; FRAME_MAX],
            frame_len: 0,
            sent: 0,
            counters: Counters {
                telecommands: 0,
                bad_frames: 0,
                bad_messages: 0,
                echoes: 0,
                telemetry: 0,
                skipped: 0,
                over_size: 0,
                lines_left_out: 0,
            },
        }
    }

    /// Takes bytes from the front of `input` until a telecommand is complete.
    pub(super) fn receive(&mut self, now: Instant, input: &mut &[u8]) -> Option<Telecommand> {
        if now - self.received_at >= IDLE_GAP {
            self.line_broke();
        }
        self.received_at = now;
        while let Some(outcome) = self.decoder.step(input) {
            let Ok(frame) = outcome else {
                self.counters.bad_frames = self.counters.bad_frames.saturating_add(1);
                continue;
            };
            if self.is_own(frame.payload()) && !self.defects.obeys_itself {
                self.counters.echoes = self.counters.echoes.saturating_add(1);
                continue;
            }
            match Telecommand::decode(frame.payload()) {
                Ok(command) => {
                    self.counters.telecommands = self.counters.telecommands.saturating_add(1);
                    self.note_requests(&command);
                    return Some(command);
                }
                Err(_) => {
                    self.counters.bad_messages = self.counters.bad_messages.saturating_add(1);
                }
            }
        }
        None
    }

    /// Whether `payload` is the robot's own last message. A telecommand cannot equal it by chance,
    /// because the time of sending would have to be the same.
    fn is_own(&self, payload: &[u8]) -> bool {
        self.payload_len > 0 && *payload == self.payload[..self.payload_len]
    }

    pub(super) fn line_broke(&mut self) {
        self.decoder.idle();
    }

    /// Notes that the program has read the received bytes.
    pub(super) fn read_done(&mut self) {
        self.decoder.read_done();
    }

    pub(super) const fn next_at(&self) -> Instant {
        self.next_at
    }

    /// Sends telemetry when due.
    pub(super) fn tick(&mut self, now: Instant, view: &View<'_>) {
        if now < self.next_at {
            return;
        }
        self.next_at += PERIOD;
        if self.next_at <= now {
            self.next_at = now + PERIOD;
        }
        if self.sent < self.frame_len {
            self.counters.skipped = self.counters.skipped.saturating_add(1);
            return;
        }
        self.tell(now, view);
    }

    pub(super) fn transmit(&mut self, buf: &mut [u8]) -> usize {
        let rest = &self.frame[self.sent..self.frame_len];
        let count = rest.len().min(buf.len());
        buf[..count].copy_from_slice(&rest[..count]);
        self.sent += count;
        count
    }

    const fn note_requests(&mut self, command: &Telecommand) {
        if let Some(step) = command.lidar_step_deg {
            self.scan_step_deg = Some(step);
        }
        if let Some(lines) = command.lines {
            self.lines = Some(lines);
        }
    }

    fn tell(&mut self, now: Instant, view: &View<'_>) {
        let timestamp_ms = to_u32(now.as_millis());
        let mut telemetry = Telemetry {
            timestamp_ms,
            state: Some(view.state),
            odometry: Some(odometry(view.pose)),
            infrared: Some(infrared(timestamp_ms, view.infrared_m)),
            ..Telemetry::default()
        };
        if let Some(request) = self.lines.take() {
            let lines = Lines::find(view.scans.points(), &settings(request, view.lines));
            let left_out = self.counters.lines_left_out;
            self.counters.lines_left_out = left_out.saturating_add(lines.left_out());
            telemetry.lines = Some(lines.as_slice().iter().copied().map(told).collect());
        }
        self.encode(&mut telemetry, view.scans);
        let payload = &self.payload[..self.payload_len];
        if let Ok(len) = telemetry::encode(payload, &mut self.frame) {
            (self.frame_len, self.sent) = (len, 0);
            self.counters.telemetry = self.counters.telemetry.saturating_add(1);
        }
    }

    /// Writes the message, with the scan if one was requested: at the requested resolution, or at
    /// the finest that fits.
    fn encode(&mut self, telemetry: &mut Telemetry, scans: &Scans) {
        let asked = self.scan_step_deg.take();
        let mut step = asked.unwrap_or(1).max(1);
        loop {
            let timestamp_ms = telemetry.timestamp_ms;
            telemetry.lidar = asked.map(|_| scan(timestamp_ms, step, scans));
            let encoded = telemetry.encode(&mut self.payload);
            if let Ok(len) = encoded {
                self.payload_len = len;
            }
            if encoded.is_ok() || telemetry.lidar.is_none() || self.defects.resends_stale {
                break;
            }
            step += 1;
        }
        if asked.is_some_and(|asked| asked.max(1) != step) {
            self.counters.over_size = self.counters.over_size.saturating_add(1);
        }
    }
}

/// The scan, a point each `step` degrees.
fn scan(timestamp_ms: u32, step: u32, scans: &Scans) -> Lidar {
    let step = usize::try_from(step).unwrap_or(usize::MAX);
    let points = (0..POINTS_MAX).step_by(step).map(|degrees| {
        let (distance_mm, quality) = scans.reading(degrees);
        message::LidarPoint {
            angle_deg: i32::try_from(degrees).unwrap_or(i32::MAX),
            distance_mm,
            quality,
        }
    });
    Lidar {
        timestamp_ms,
        points: points.collect(),
    }
}

/// Settings of the line search: 0 selects the robot's own value.
fn settings(request: LinesRequest, defects: lines::Defects) -> lines::Settings {
    let or = |value: u32, own: f32| match u16::try_from(value) {
        Ok(0) | Err(_) => own,
        Ok(value) => f32::from(value),
    };
    let own = lines::Settings::DEFAULT;
    lines::Settings {
        gap_mm: or(request.gap_mm, own.gap_mm),
        tolerance_mm: or(request.tolerance_mm, own.tolerance_mm),
        merge_deg: or(request.merge_deg, own.merge_deg),
        defects,
        ..own
    }
}

fn told(line: lines::Line) -> Line {
    let pose = |point: Point| message::Pose {
        x: point.x_mm,
        y: point.y_mm,
        alpha: 0.0,
    };
    Line {
        start: pose(line.start),
        end: pose(line.end),
    }
}

/// Converts millimetres to metres.
fn odometry(pose: Pose) -> Odometry {
    Odometry {
        pose: message::Pose {
            x: pose.x_mm / 1_000.0,
            y: pose.y_mm / 1_000.0,
            alpha: pose.heading,
        },
        ..Odometry::default()
    }
}

fn infrared(timestamp_ms: u32, distances_m: [f32; 3]) -> Infrared {
    Infrared {
        timestamp_ms: Some(timestamp_ms),
        distances_m: distances_m.into_iter().collect(),
    }
}

/// The lowest 32 bits: a counter of milliseconds that wraps.
fn to_u32(millis: u64) -> u32 {
    u32::try_from(millis & u64::from(u32::MAX)).expect("masked to 32 bits")
}
