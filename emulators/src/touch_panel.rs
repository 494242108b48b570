//! Touch display of 480 x 272 pixels with its own controller, which contains the frame buffer: the
//! robot's program has no memory for one.
//!
//! Frames are those of [`protocols::panel`]. A damaged frame is dropped, as by a controller with a
//! checksum. A valid frame without a meaning is an error of the program and a violation. The pen is
//! an ADS7843-class converter: it reports its position every 20 ms while it touches, and once when
//! it is lifted.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::panel::{self, Command, Contact, Pen, READING_MAX, Window};
use protocols::{Decode, Instant, LineConfig, Port};

use crate::device::{BrokenRules, Device, Event, EventKind, earliest, take};
use crate::event_log::EventLog;
use crate::world::World;

/// Columns.
pub const WIDTH: usize = 480;
/// Rows.
pub const HEIGHT: usize = 272;

/// Idle time after which a partial frame is discarded.
const IDLE_GAP: Duration = Duration::from_millis(5);
/// Time between two reports of a touching pen.
const REPORT_PERIOD: Duration = Duration::from_millis(20);
/// Duration of a tap, and pause between taps in a row.
const TAP: Duration = Duration::from_millis(100);
/// Maximum number of taps that wait.
pub const TAPS_MAX: usize = 1000;

/// A finger that touches a place for a tenth of a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tap {
    /// Time of the tap.
    pub at: Instant,
    /// Column and row; beyond the edges it touches nothing.
    pub place: [u16; 2],
}

/// The display.
#[derive(Clone, Debug)]
pub struct TouchPanel {
    decoder: panel::Decoder,
    received_at: Instant,
    /// RGB565, top row first.
    pixels: Vec<u16>,
    is_on: bool,
    frames: u64,
    damaged: u64,
    /// The taps in order of time.
    taps: VecDeque<Tap>,
    pen: Option<Touch>,
    /// End of the pause before the next touch.
    rests_until: Instant,
    reports: VecDeque<u8>,
    log: EventLog,
}

/// A finger on the panel.
#[derive(Clone, Copy, Debug)]
struct Touch {
    place: [u16; 2],
    report_at: Instant,
    until: Instant,
}

impl TouchPanel {
    /// The line to the robot's program.
    pub const UART: Port = Port(0);

    /// A dark display that will be touched at `taps`.
    pub fn new(taps: Vec<Tap>) -> Self {
        let mut taps = taps;
        taps.sort_by_key(|tap| tap.at);
        taps.truncate(TAPS_MAX);
        Self {
            decoder: panel::Decoder::default(),
            received_at: Instant::ZERO,
            pixels: vec![0; WIDTH * HEIGHT],
            is_on: false,
            frames: 0,
            damaged: 0,
            taps: taps.into(),
            pen: None,
            rests_until: Instant::ZERO,
            reports: VecDeque::new(),
            log: EventLog::default(),
        }
    }

    /// Taps at `place`, column and row, at `at` or when the taps before are over.
    pub fn tap(&mut self, at: Instant, place: [u16; 2]) {
        if self.taps.len() < TAPS_MAX {
            let index = self.taps.partition_point(|tap| tap.at <= at);
            self.taps.insert(index, Tap { at, place });
        }
    }

    /// Whether the display shows its memory.
    pub const fn is_on(&self) -> bool {
        self.is_on
    }

    /// Content of the display: RGB565, 480 pixels a row, top row first.
    pub fn pixels(&self) -> &[u16] {
        &self.pixels
    }

    /// Valid frames received, and candidates dropped because they were damaged.
    pub const fn frames(&self) -> [u64; 2] {
        [self.frames, self.damaged]
    }

    fn obey(&mut self, now: Instant, frame: &panel::Frame) {
        self.frames += 1;
        let op = frame.op();
        match frame.command() {
            Some(Command::On) => self.switch(now, true),
            Some(Command::Off) => self.switch(now, false),
            Some(Command::Write(window, bytes)) => {
                let (pixels, _) = bytes.as_chunks();
                let pixels = pixels.iter().map(|&pixel| u16::from_be_bytes(pixel));
                self.fill(now, window, &pixels.collect::<Vec<_>>());
            }
            Some(Command::Runs(window, bytes)) => {
                let (runs, _) = bytes.as_chunks();
                let mut pixels = Vec::with_capacity(WIDTH);
                for &[count, high, low] in runs {
                    let pixel = u16::from_be_bytes([high, low]);
                    pixels.resize(pixels.len() + usize::from(count), pixel);
                }
                self.fill(now, window, &pixels);
            }
            None => {
                let detail = || format!("{op:02X} with {} bytes", frame.payload().len());
                self.violation(now, "unknown-command", detail);
            }
        }
    }

    fn switch(&mut self, now: Instant, on: bool) {
        if self.is_on != on {
            let rule = if on { "display-on" } else { "display-off" };
            self.log.note(now, rule, String::new());
        }
        self.is_on = on;
    }

    fn fill(&mut self, now: Instant, window: Window, pixels: &[u16]) {
        let ([x0, x1], [y0, y1]) = (window.columns, window.rows);
        if window.area() == 0 || usize::from(x1) >= WIDTH || usize::from(y1) >= HEIGHT {
            let detail = || format!("{x0},{y0} to {x1},{y1}, the display has {WIDTH} x {HEIGHT}");
            self.violation(now, "window-outside", detail);
            return;
        }
        let count = pixels.len();
        if u32::try_from(count) != Ok(window.area()) {
            let detail = || format!("{count} pixels for a window of {}", window.area());
            self.violation(now, "pixel-count", detail);
            return;
        }
        let columns = usize::from(x0)..=usize::from(x1);
        let rows = self.pixels.chunks_exact_mut(WIDTH).skip(y0.into());
        for (row, part) in rows.zip(pixels.chunks_exact(columns.clone().count())) {
            row[columns.clone()].copy_from_slice(part);
        }
    }

    fn violation(&mut self, now: Instant, rule: &'static str, detail: impl FnOnce() -> String) {
        self.log.repeated(now, EventKind::Violation, rule, detail);
    }

    /// Moves the finger.
    fn touch(&mut self, now: Instant) {
        if self.pen.is_none()
            && let Some(tap) = self
                .taps
                .pop_front_if(|tap| tap.at.max(self.rests_until) <= now)
        {
            self.pen = Some(Touch {
                place: tap.place,
                report_at: now,
                until: now + TAP,
            });
        }
        let Some(touch) = &mut self.pen else { return };
        let inside = usize::from(touch.place[0]) < WIDTH && usize::from(touch.place[1]) < HEIGHT;
        let mut report = None;
        if now >= touch.until {
            report = Some(Contact::Up);
        } else if now >= touch.report_at {
            touch.report_at = now + REPORT_PERIOD;
            report = Some(Contact::Down);
        }
        if let Some(contact) = report.filter(|_| inside) {
            let reading = reading_of(touch.place);
            let bytes = panel::encode_pen(Pen { contact, reading });
            self.reports.extend(bytes);
        }
        if report == Some(Contact::Up) {
            let [x, y] = touch.place;
            self.log.note(now, "tapped", format!("at {x}, {y}"));
            self.pen = None;
            self.rests_until = now + TAP;
        }
    }
}

/// Reading of the converter at the middle of a pixel: the whole panel is 0 to 4095.
fn reading_of(place: [u16; 2]) -> [u16; 2] {
    let reading = |at: u16, all: usize| {
        let all = u32::try_from(all).expect("a few hundred");
        let value = (2 * u32::from(at) + 1) * (u32::from(READING_MAX) + 1) / (2 * all);
        u16::try_from(value).map_or(READING_MAX, |value| value.min(READING_MAX))
    };
    [reading(place[0], WIDTH), reading(place[1], HEIGHT)]
}

impl Device for TouchPanel {
    fn receive(&mut self, _port: Port, now: Instant, bytes: &[u8]) {
        if now - self.received_at >= IDLE_GAP {
            self.decoder.idle();
        }
        self.received_at = now;
        let mut input = bytes;
        while let Some(frame) = self.decoder.step(&mut input) {
            match frame {
                Ok(frame) => self.obey(now, &frame),
                Err(_) => self.damaged += 1,
            }
        }
    }

    fn poll(&mut self, now: Instant, _world: &mut World) {
        self.touch(now);
        self.log.poll(now);
    }

    fn transmit(&mut self, _port: Port, buf: &mut [u8]) -> usize {
        take(&mut self.reports, buf)
    }

    fn may_send(&self, _port: Port) -> bool {
        !self.reports.is_empty()
    }

    fn poll_at(&self) -> Option<Instant> {
        let pen = self.pen.map(|touch| touch.report_at.min(touch.until));
        let tap = self.taps.front().map(|tap| tap.at.max(self.rests_until));
        earliest([pen.or(tap), self.log.poll_at()])
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        LineConfig::new_8n1(panel::BAUD)
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}

#[cfg(test)]
mod tests;
