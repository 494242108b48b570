//! Board of a slave that is described by data: its reset conditions and its modem lines.
//!
//! ```text
//! host: DTR off -> on --| |--> RESET   capacitor: the edge resets, a level does not
//!            boots, 1.6 s: receives nothing, says nothing, its lines are off
//!            is up: all values as at the start
//! ```
//!
//! An Arduino resets whenever its port is opened. Its boot loader then delays the first reception:
//! optiboot 8 (`optiboot.c`, the Uno's) flashes three times, 6 sixteenths of a second, and waits a
//! second of the watchdog for an upload. The ATmega328P starts up for 65 ms before that and once
//! more after it (its data sheet, the Uno's fuses). That is 1.5 s by arithmetic; 1.6 s because the
//! watchdog's oscillator is some percent slow.

use core::time::Duration;

use protocols::{Instant, LineConfig, Port};

use crate::device::{EventKind, byte_end, earliest};
use crate::event_log::EventLog;
use crate::quantity::Variables;
use crate::world::World;

/// Event that resets a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetOn {
    /// The host switches DTR on, as with an Arduino.
    Dtr,
    /// The host switches RTS on: the same board behind an adapter cable that has RTS in DTR's
    /// place.
    Rts,
    /// A break on the line.
    Break,
}

/// A modem line that a board sets for its host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum HostLine {
    /// Clear to send.
    Cts,
    /// Data set ready.
    Dsr,
    /// Data carrier detect.
    Dcd,
    /// Ring indicator.
    Ri,
}

/// Connection of a board to its host.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BoardConfig {
    /// Event that resets the board, if any.
    pub resets_on: Option<ResetOn>,
    /// From its reset until it receives again; [`BOOT`] if not given.
    pub boot: Option<Duration>,
    /// The lines that it sets, each with the name of a value: the line is on while the value is not
    /// 0.
    pub raises: Vec<(HostLine, String)>,
}

/// Time of an Arduino Uno from its reset to its program, see above.
pub const BOOT: Duration = Duration::from_millis(1_600);
/// The pin at which the host's DTR or RTS arrives: each byte is its level.
pub const RESET_PIN: Port = Port(1);
/// A level has no rate; it arrives after 10 us.
pub const PIN_LINE: LineConfig = LineConfig::new_8n1(1_000_000);
/// Interval between two looks at the values that lines follow: a sketch's loop may run as often.
const LOOK_EVERY: Duration = Duration::from_millis(1);

impl HostLine {
    /// The port of the pin on which a board sets this line.
    pub const fn port(self) -> Port {
        match self {
            Self::Cts => Port(2),
            Self::Dsr => Port(3),
            Self::Dcd => Port(4),
            Self::Ri => Port(5),
        }
    }
}

/// A line that follows a value.
#[derive(Clone, Copy, Debug)]
struct Follower {
    port: Port,
    /// The value's place.
    value: usize,
    is_on: bool,
    /// The level has not left yet.
    is_due: bool,
}

/// The board of a slave.
#[derive(Clone, Debug)]
pub(crate) struct Board {
    resets_on: Option<ResetOn>,
    boot: Duration,
    /// The host's DTR or RTS.
    is_raised: bool,
    boots_until: Option<Instant>,
    followers: Vec<Follower>,
    next_look: Option<Instant>,
}

impl Board {
    /// Creates a board at rest. The error is the name of a value that does not exist.
    pub(crate) fn new(config: &BoardConfig, values: &Variables) -> Result<Self, String> {
        let followers = config.raises.iter().map(|(line, name)| {
            let value = values.find(name).ok_or_else(|| name.clone())?;
            Ok(Follower {
                port: line.port(),
                value,
                is_on: false,
                is_due: false,
            })
        });
        let followers: Vec<Follower> = followers.collect::<Result<_, String>>()?;
        Ok(Self {
            resets_on: config.resets_on,
            boot: config.boot.unwrap_or(BOOT),
            is_raised: false,
            boots_until: None,
            next_look: (!followers.is_empty()).then_some(Instant::ZERO),
            followers,
        })
    }

    /// Takes levels of the reset pin; returns the time at which they restarted the board, if they
    /// did.
    pub(crate) fn pin(&mut self, now: Instant, levels: &[u8]) -> Option<Instant> {
        let mut started = None;
        for (index, &level) in levels.iter().enumerate() {
            let is_on = level != 0;
            if is_on && !core::mem::replace(&mut self.is_raised, is_on) {
                started = Some(byte_end(now, PIN_LINE, index, levels.len()));
            }
            self.is_raised = is_on;
        }
        let started = started.filter(|_| self.resets_on.is_some())?;
        self.restart(started);
        Some(started)
    }

    /// Takes a break; returns whether it restarts the board.
    pub(crate) fn is_reset_by_break(&mut self, now: Instant) -> bool {
        let is_reset = self.resets_on == Some(ResetOn::Break);
        if is_reset {
            self.restart(now);
        }
        is_reset
    }

    fn restart(&mut self, now: Instant) {
        self.boots_until = Some(now + self.boot);
        self.followers.iter_mut().for_each(|one| one.set(false));
    }

    /// Time at which the board receives again, while it boots.
    pub(crate) const fn boots_until(&self) -> Option<Instant> {
        self.boots_until
    }

    /// Reports the restart at `at`.
    pub(crate) fn tell_reset(&self, at: Instant, why: &str, log: &mut EventLog) {
        let up = self.boots_until.unwrap_or(at);
        let detail = format!("{why}: restarts, receives nothing until {up} s");
        log.note(at, "board-reset", detail);
    }

    /// Whether bytes at `now` are lost because the board is starting; logs it then.
    pub(crate) fn is_deaf(&self, now: Instant, log: &mut EventLog) -> bool {
        let up = self.boots_until.filter(|&up| now < up);
        if let Some(up) = up {
            let detail = || format!("bytes lost: the board starts, until {up} s");
            log.repeated(now, EventKind::Note, "board-deaf", detail);
        }
        up.is_some()
    }

    /// Runs the board's own work; `true` if the board has just finished booting.
    pub(crate) fn poll(&mut self, now: Instant, values: &Variables, world: &World) -> bool {
        let is_up = self.boots_until.take_if(|at| *at <= now).is_some();
        if self.next_look.is_some_and(|at| at <= now) {
            self.next_look = Some(now + LOOK_EVERY);
            for one in &mut self.followers {
                let is_on = values.read(one.value, now, world) != 0;
                one.set(is_on && self.boots_until.is_none());
            }
        }
        is_up
    }

    /// Moves a changed level into `buf`; returns the number of bytes.
    pub(crate) fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        let mut followers = self.followers.iter_mut();
        let due = followers.find(|one| one.port == port && one.is_due);
        match (due, buf.first_mut()) {
            (Some(one), Some(slot)) => {
                one.is_due = false;
                *slot = u8::from(one.is_on);
                1
            }
            _ => 0,
        }
    }

    pub(crate) fn poll_at(&self) -> Option<Instant> {
        earliest([self.boots_until, self.next_look])
    }
}

impl Follower {
    fn set(&mut self, is_on: bool) {
        self.is_due |= self.is_on != is_on;
        self.is_on = is_on;
    }
}
