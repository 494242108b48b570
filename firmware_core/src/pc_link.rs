//! Robot end of the PC link: pose, map rows, waypoints and state out, orders in.
//!
//! All output goes through one queue, frame by frame, so no other bytes can get between the bytes
//! of a frame. (The fielded program wrote its pose into the middle of map rows, and its debug text
//! into both.) Map rows use the remaining time. The radio behind the port has 700 bytes of buffer
//! and forwards less than half of the port's rate, so rows are paced.

mod fielded;

use core::time::Duration;

use protocols::pcui::diagnosis::{
    Diagnosis, Readings, Text, encode_diagnosis, encode_readings, encode_text, encode_victims,
};
use protocols::pcui::message::{
    MapProperties, State, encode_map_properties, encode_row, encode_state, encode_waypoints,
};
use protocols::pcui::{self, FRAME_MAX, Frame};
use protocols::{Decode, FrameError, Instant, rle};

use crate::fifo::Fifo;
use crate::grid::Grid;
use crate::pose::Pose;
use crate::waypoints::Waypoints;
pub use fielded::Defects;
use fielded::{CountedPsi, Receiver};

/// Room for the longest frame in addition to a useful queue.
const TX_LEN: usize = if cfg!(feature = "large") { 8192 } else { 2048 };
/// Bytes sent without a pause: the radio has room for 700, and other frames may wait in it. Two
/// kinds of frames may be longer: a list of more than 54 waypoints (100 of them take 919 bytes),
/// and a row of the large map.
const AT_ONCE: usize = 512;
/// Rows are added only while no more than this is queued, so that a pose never waits long.
const ROWS_BELOW: usize = 512;
/// Retry interval for a row while the queue does not drain.
const ROW_RETRY: Duration = Duration::from_millis(5);
/// Idle time after which a partial frame is discarded. The radio delivers in bursts up to 40 ms
/// apart.
const IDLE_GAP: Duration = Duration::from_millis(100);
/// State is sent at 5 Hz.
const STATE_PERIOD: Duration = Duration::from_millis(200);
/// Period of the diagnosis messages.
const DIAGNOSIS_PERIOD: Duration = Duration::from_secs(1);
const NEVER: Instant = Instant::from_nanos(u64::MAX);

/// Settings of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Time from pose to pose.
    pub pose_period: Duration,
    /// Bytes per second that the radio forwards; `None` fills the line.
    pub pace_bytes_per_s: Option<u32>,
    /// Run-length coding of rows.
    pub dialect: rle::Dialect,
    /// Diagnosis sent besides pose, state and map.
    pub diagnosis: Diagnose,
    /// Enabled defects of the fielded program.
    pub defects: Defects,
}

/// Diagnosis sent besides pose, state and map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Diagnose {
    /// No diagnosis, as in the report.
    #[default]
    Nothing,
    /// Battery, conditions, errors, victims, sensors and the newest message, once a second.
    EachSecond,
}

impl Settings {
    /// The seed report's 50 ms, and a pace that an HC-06 carries (20.5 kB/s, half of that while the
    /// PC sends as well) with room for its bursts.
    pub const DEFAULT: Self = Self {
        pose_period: Duration::from_millis(50),
        pace_bytes_per_s: Some(12_000),
        dialect: rle::Dialect::Lossless,
        diagnosis: Diagnose::Nothing,
        defects: Defects::NONE,
    };
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Data that the link sends to the PC.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The map.
    pub map: &'a Grid,
    /// Pose of the robot.
    pub pose: Pose,
    /// The state, for the state message.
    pub state: State,
    /// Waypoints of the robot.
    pub waypoints: &'a Waypoints,
    /// Diagnosis of the robot.
    pub diagnosis: Diagnosis,
    /// Positions of the found victims, millimetres in the map.
    pub victims: &'a [[i16; 2]],
    /// Readings of the sensors.
    pub readings: Readings,
    /// The newest message to the operator.
    pub message: Text<'a>,
}

/// Counters of the link since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Valid frames received.
    pub received: u32,
    /// Candidates rejected: checksum, length, cut off.
    pub bad_frames: u32,
    /// Valid frames that the robot could not interpret.
    pub meaningless: u32,
    /// Frames queued for sending.
    pub sent: u32,
    /// Map rows among them.
    pub rows: u32,
}

impl Counters {
    /// All counters at 0.
    const NONE: Self = Self {
        received: 0,
        bad_frames: 0,
        meaningless: 0,
        sent: 0,
        rows: 0,
    };
}

/// Robot end of the link.
#[derive(Clone, Debug)]
pub struct PcLink {
    settings: Settings,
    decoder: pcui::Decoder,
    received_at: Instant,
    tx: Fifo<TX_LEN>,
    pose_at: Instant,
    state_at: Instant,
    diagnosis_at: Instant,
    row_at: Instant,
    /// Time at which the last bytes sent will have passed the receiving radio.
    passed_at: Instant,
    row: u16,
    /// Queued bytes that have to wait, and until when.
    held: usize,
    release_at: Instant,
    echo_is_due: bool,
    counters: Counters,
    fielded: Fielded,
}

/// State that only the fielded program's defects need.
#[derive(Clone, Debug)]
struct Fielded {
    receiver: Receiver,
    psi: CountedPsi,
    /// Received bytes that the program has not read yet, and how many may wait.
    waiting: Fifo<WAITING_MAX>,
    allowed: usize,
    is_dead: bool,
}

/// Longest of the queues of received bytes.
const WAITING_MAX: usize = 512;
/// Length of the fielded program's queue.
const SHORT_QUEUE: usize = 200;
/// Time before which the fielded program has no queue (field defect PU-16).
const READY_AFTER: Duration = Duration::from_millis(1);

impl PcLink {
    /// A link that begins to send at once.
    pub const fn new(settings: Settings) -> Self {
        Self {
            settings,
            decoder: pcui::Decoder::with_format(pcui::Framing),
            received_at: Instant::ZERO,
            tx: Fifo::new(),
            pose_at: Instant::ZERO,
            state_at: Instant::ZERO,
            diagnosis_at: match settings.diagnosis {
                Diagnose::Nothing => NEVER,
                Diagnose::EachSecond => Instant::ZERO,
            },
            row_at: Instant::ZERO,
            passed_at: Instant::ZERO,
            row: 0,
            held: 0,
            release_at: Instant::ZERO,
            echo_is_due: false,
            counters: Counters::NONE,
            fielded: Fielded {
                receiver: Receiver::new(),
                psi: CountedPsi::new(),
                waiting: Fifo::new(),
                allowed: 0,
                is_dead: false,
            },
        }
    }

    /// Takes bytes from the front of `input` until a frame is complete.
    pub fn receive(&mut self, now: Instant, input: &mut &[u8]) -> Option<Frame> {
        if !input.is_empty() {
            if now - self.received_at >= IDLE_GAP {
                self.decoder.idle();
            }
            self.received_at = now;
            self.stumble(now, input);
            if let Some(frame) = self.kept_frame() {
                return Some(frame);
            }
        }
        self.next_frame(input)
    }

    /// A frame that the decoder releases on an idle line.
    pub fn freed(&mut self, now: Instant) -> Option<Frame> {
        while self.fielded.allowed > 0 {
            self.fielded.allowed -= 1;
            let mut byte = [0];
            if self.fielded.waiting.pop(&mut byte) == 1 {
                self.received_at = now;
                if let Some(frame) = self.next_frame(&mut &byte[..]) {
                    return Some(frame);
                }
            }
        }
        if self.decoder.pending() > 0 && now - self.received_at >= IDLE_GAP {
            self.decoder.idle();
        }
        self.next_frame(&mut &[][..])
    }

    /// Discards a half-received frame: the other end closed or the line broke.
    pub fn line_broke(&mut self) {
        self.decoder.idle();
    }

    /// Counts a frame that no receiver understood.
    pub const fn count_meaningless(&mut self) {
        self.counters.meaningless = self.counters.meaningless.saturating_add(1);
    }

    /// Requests that the waypoints are sent.
    pub const fn echo_waypoints(&mut self) {
        self.echo_is_due = true;
    }

    /// Queues all messages that are due.
    pub fn tick(&mut self, now: Instant, view: &View<'_>) {
        if now < self.next_at() {
            return;
        }
        self.release(now);
        let mut frame = [0; FRAME_MAX];
        if now >= self.pose_at {
            self.pose_at = next_period(self.pose_at, self.settings.pose_period, now);
            let mut properties = properties(view);
            if self.settings.defects.counts_psi {
                properties.psi_deg = self.fielded.psi.count(properties.psi_deg);
            }
            let len = encode_map_properties(&properties, &mut frame);
            self.queue(now, &frame, len);
        }
        if self.can_echo() {
            self.echo_is_due = false;
            let list = view.waypoints.to_send();
            let most = pcui::message::WAYPOINTS_MAX.min(view.waypoints.all().len());
            let len = encode_waypoints(Counted { list, most }, &mut frame);
            self.queue(now, &frame, len);
        }
        if now >= self.state_at {
            self.state_at = next_period(self.state_at, STATE_PERIOD, now);
            let len = encode_state(&view.state, &mut frame);
            self.queue(now, &frame, len);
        }
        if now >= self.diagnosis_at {
            self.diagnosis_at = next_period(self.diagnosis_at, DIAGNOSIS_PERIOD, now);
            let len = encode_diagnosis(&view.diagnosis, &mut frame);
            self.queue(now, &frame, len);
            let len = encode_victims(view.victims.iter().copied(), &mut frame);
            self.queue(now, &frame, len);
            let len = encode_readings(&view.readings, &mut frame);
            self.queue(now, &frame, len);
            let len = encode_text(view.message, &mut frame);
            self.queue(now, &frame, len);
        }
        while now >= self.row_at {
            self.tick_row(now, view, &mut frame);
        }
    }

    /// Time of the next call of [`tick`](Self::tick).
    pub fn next_at(&self) -> Instant {
        if self.can_echo() {
            return Instant::ZERO;
        }
        let figures = self.state_at.min(self.diagnosis_at);
        let release_at = if self.held > 0 {
            self.release_at
        } else {
            NEVER
        };
        let frames_at = self.pose_at.min(figures).min(self.row_at);
        frames_at.min(release_at)
    }

    /// Time of the next call of [`freed`](Self::freed).
    pub fn idle_at(&self) -> Option<Instant> {
        (self.decoder.pending() > 0).then_some(self.received_at + IDLE_GAP)
    }

    /// Whether bytes wait for the line that need not wait any longer.
    pub const fn has_output(&self) -> bool {
        self.tx.len() > self.held
    }

    /// Moves bytes for the line into `buf`; returns how many.
    pub fn transmit(&mut self, buf: &mut [u8]) -> usize {
        let was_full = self.tx.len() > ROWS_BELOW;
        let is_twice = self.settings.defects.sends_twice && self.tx.refused() > 0;
        let len = (self.tx.len() - self.held) * (1 + usize::from(is_twice));
        let free = buf.len().min(len);
        let buf = &mut buf[..free];
        let count = match is_twice {
            true => self.pop_twice(buf),
            false => self.tx.pop(buf),
        };
        if was_full && self.tx.len() <= ROWS_BELOW {
            self.row_at = self.row_at.min(self.passed_at);
        }
        count
    }

    /// The counters so far.
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Whether a defect has ended the program.
    pub const fn is_dead(&self) -> bool {
        self.fielded.is_dead
    }

    /// Frames for which the queue had no room.
    pub const fn overflows(&self) -> u32 {
        self.tx.refused()
    }

    const fn can_echo(&self) -> bool {
        self.echo_is_due && self.tx.room() >= FRAME_MAX
    }

    fn next_frame(&mut self, input: &mut &[u8]) -> Option<Frame> {
        loop {
            let outcome = if self.settings.defects.of_receiver() {
                let (&byte, rest) = input.split_first()?;
                *input = rest;
                self.fielded.receiver.take(byte, &self.settings.defects)
            } else {
                Some(self.decoder.step(input)?)
            };
            let Some(outcome) = outcome else {
                continue;
            };
            match outcome {
                Ok(frame) => {
                    self.counters.received = self.counters.received.saturating_add(1);
                    return Some(frame);
                }
                Err(error) => {
                    self.counters.bad_frames = self.counters.bad_frames.saturating_add(1);
                    // The sender of an over-long frame gets the robot's own list back.
                    let is_fielded = self.settings.defects.of_receiver();
                    self.echo_is_due |= matches!(error, FrameError::Length { .. }) && !is_fielded;
                }
            }
        }
    }

    /// Queues the next row, or postpones it.
    fn tick_row(&mut self, now: Instant, view: &View<'_>, frame: &mut [u8]) {
        if self.tx.len() > ROWS_BELOW {
            self.row_at = now + ROW_RETRY;
            return;
        }
        let Some(row) = view.map.row(usize::from(self.row)) else {
            self.row = 0;
            return;
        };
        let len = encode_row(0, self.row, row, self.settings.dialect, frame);
        match len {
            Some(len) if self.is_interrupted(now, len) => self.queue_torn(now, view, &frame[..len]),
            _ => self.queue(now, frame, len),
        }
        self.fielded.allowed += usize::from(self.settings.defects.queues());
        self.counters.rows = self.counters.rows.saturating_add(1);
        self.row += 1;
        self.row_at = self.passed_at.max(now);
        if self.tx.len() > ROWS_BELOW {
            self.row_at = self.row_at.max(now + ROW_RETRY);
        }
    }

    /// Bytes that the radio has no room for wait in the queue, together with all bytes behind them.
    fn hold(&mut self, now: Instant, len: usize, pace: u32) {
        if self.held > 0 {
            self.held += len;
        } else if len > AT_ONCE {
            self.held = len - AT_ONCE;
            self.release_at = now + passing(AT_ONCE, pace);
        }
    }

    fn release(&mut self, now: Instant) {
        let pace = self.settings.pace_bytes_per_s.unwrap_or(u32::MAX);
        while self.held > 0 && now >= self.release_at {
            let part = self.held.min(AT_ONCE / 2);
            self.held -= part;
            self.release_at += passing(part, pace);
        }
    }

    fn queue(&mut self, now: Instant, frame: &[u8], len: Option<usize>) {
        let Some(len) = len else {
            return;
        };
        if self.tx.push(&frame[..len]) {
            self.counters.sent = self.counters.sent.saturating_add(1);
            if let Some(pace) = self.settings.pace_bytes_per_s {
                self.hold(now, len, pace);
                self.passed_at = self.passed_at.max(now) + passing(len, pace);
                self.row_at = self.row_at.max(self.passed_at);
            }
        }
    }
}

/// Time that the radio takes for `len` bytes.
fn passing(len: usize, pace: u32) -> Duration {
    Duration::from_nanos(len as u64 * 1_000_000_000 / u64::from(pace.max(1)))
}

/// The first elements of a list, with a known length.
struct Counted<I> {
    list: I,
    most: usize,
}

impl<I: Iterator> Iterator for Counted<I> {
    type Item = I::Item;

    fn next(&mut self) -> Option<I::Item> {
        self.most = self.most.checked_sub(1)?;
        self.list.next()
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.most, Some(self.most))
    }
}

impl<I: Iterator> ExactSizeIterator for Counted<I> {}

/// The next multiple of `period` after `due`; missed ones are skipped.
fn next_period(due: Instant, period: Duration, now: Instant) -> Instant {
    let next = due + period;
    if next > now { next } else { now + period }
}

fn properties(view: &View<'_>) -> MapProperties {
    let pose = view.pose.to_wire();
    let size = |cells: usize| whole(cells as f32 * view.map.resolution_mm());
    MapProperties {
        resolution_mm: u8::try_from(whole(view.map.resolution_mm())).unwrap_or(u8::MAX),
        size_mm: [size(view.map.width()), size(view.map.height())],
        layers: 1,
        position_mm: [pose.x_mm, pose.y_mm],
        layer: 0,
        psi_deg: pose.psi_deg,
    }
}

fn whole(mm: f32) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturates, which is what is wanted"
    )]
    let whole = libm::roundf(mm) as u16;
    whole
}

#[cfg(test)]
mod tests;
