//! The servo board: accepts `S angle` and `D speed`, reports the drive's count.
//!
//! ```text
//! to the board:   'S' | degrees, signed | xor        'D' | cm/s, signed | xor
//! from the board: 'E' | counts, 32 bits, low byte first | xor         each 20 ms
//! ```

use std::collections::VecDeque;

use hilrig::prelude::*;

/// Coding of its line.
pub const LINE: LineConfig = LineConfig::new_8n1(57_600);
/// Silence after which the board brakes.
pub const WATCHDOG: Duration = Duration::from_millis(300);
const REPORT: Duration = Duration::from_millis(20);

/// A command with its checksum.
pub fn command(what: u8, value: i8) -> [u8; 3] {
    let value = value.to_be_bytes()[0];
    [what, value, what ^ value]
}

/// The board.
#[derive(Clone, Default)]
pub struct Board {
    heard: Vec<u8>,
    out: VecDeque<u8>,
    next: Instant,
    heard_at: Option<Instant>,
    /// The last commands: degrees, cm/s.
    pub told: [i8; 2],
    /// Count of the drive as last reported.
    pub count: i32,
    events: Vec<Event>,
}

impl Board {
    fn obey(&mut self, now: Instant) {
        while let Some(&[what, value, sum]) = self.heard.first_chunk() {
            let axis = [b'S', b'D'].iter().position(|known| *known == what);
            match axis.filter(|_| what ^ value == sum) {
                Some(axis) => {
                    self.told[axis] = value.cast_signed();
                    self.heard_at = Some(now);
                    self.heard.drain(..3);
                }
                None => {
                    let bytes: Vec<u8> = self.heard.drain(..1).collect();
                    let detail = "no command, or a wrong sum".to_owned();
                    self.note(now, EventKind::Violation, "bad-command", detail, bytes);
                }
            }
        }
    }

    fn note(
        &mut self,
        at: Instant,
        kind: EventKind,
        rule: &'static str,
        detail: String,
        bytes: Vec<u8>,
    ) {
        self.events.push(Event {
            at,
            kind,
            rule,
            detail,
            bytes,
        });
    }
}

impl Device for Board {
    fn receive(&mut self, _: Port, _: Instant, bytes: &[u8]) {
        self.heard.extend(bytes);
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.obey(now);
        if self.heard_at.is_some_and(|at| now - at >= WATCHDOG) {
            self.heard_at = None;
            self.told[1] = 0;
            let detail = format!("silence of {WATCHDOG:?}");
            self.note(now, EventKind::Note, "braked", detail, Vec::new());
        }
        let [angle, speed] = self.told.map(f64::from);
        let drive = match self.told[1] {
            0 => Command::Brake,
            _ => Command::Speed(speed / 100.0),
        };
        let steered = world.actuate("steering", Command::Angle(angle.to_radians()));
        steered
            .and_then(|()| world.actuate("drive", drive))
            .expect("it sits in a car");
        while self.next <= now {
            self.count = world.encoder("drive").unwrap_or(0) as i32;
            let [a, b, c, d] = self.count.to_le_bytes();
            self.out.extend([b'E', a, b, c, d, b'E' ^ a ^ b ^ c ^ d]);
            self.next += REPORT;
        }
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        hilrig::emulators::device::take(&mut self.out, buf)
    }

    fn poll_at(&self) -> Option<Instant> {
        let silence = self.heard_at.map(|at| at + WATCHDOG);
        silence.into_iter().chain([self.next]).min()
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LINE
    }

    fn take_events(&mut self) -> Vec<Event> {
        core::mem::take(&mut self.events)
    }
}
