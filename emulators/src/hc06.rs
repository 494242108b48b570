//! HC-06 Bluetooth module: a UART on one side, a serial port over the air on the other.
//!
//! ```text
//!            UART                                   AIR
//! robot  --> command parser (not connected)
//!        --> FIFO, 700 B, overflows --> 20.5 kB/s --> host
//!        <-- 20.5 kB/s, holds the writer up     <-- host
//! ```
//!
//! While no host has the port open the module reads commands at its configured rate. Once a host is
//! connected all bytes are data; only the end of the connection returns to commands. Towards the
//! host the radio is slower than a UART at 460800 baud, so a robot that floods loses bytes inside
//! its frames. Towards the robot no byte is lost. Figures and guesses are in [`Profile`].
//!
//! Rules for the module's master: `unknown-command`, `line-end-after-command`, `line-end-missing`,
//! `lower-case-command`, `command-too-slow`, `no-pause-between-commands`,
//! `command-while-connected`, `fifo-overflow`, `framing-error`. Rules for the host:
//! `host-overflow`, `host-port-closed`.

mod air;
mod command;
mod connection;
mod lane;
mod profile;
#[cfg(test)]
pub(crate) mod tests;

use std::collections::VecDeque;

use core::time::Duration;

use protocols::hc06::{Family, Led};
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::device::{BrokenRules, Device, Event, EventKind, byte_end, earliest};
use crate::event_log::EventLog;
use crate::world::World;

use air::Air;
use command::{Attempt, Collector, End, Restart};
use lane::NEVER;
pub use lane::Traffic;
pub use profile::{Leftovers, LineSwitch, Profile, Settings};

/// Nominal coding of the air end: it has no rate of its own, so the line must add nothing.
pub const AIR_LINE: LineConfig = LineConfig::new_8n1(9_216_000);

/// Pause after the last byte of a reply before a new line coding is used.
const SWITCH_PAUSE: Duration = Duration::from_millis(2);

/// Handling of bytes from the module's UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Ignores them: no power.
    Off,
    /// Reads commands.
    Command,
    /// Sends them to the host.
    Data,
}

/// Whether module and host are in radio range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Radio {
    /// Module and host are in reach of each other.
    InReach,
    /// Module and host are out of reach; for a while neither notices.
    Lost,
}

/// State of the status LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lamp {
    /// No power, or switched off by command.
    Dark,
    /// No connection.
    Blinking,
    /// A host is connected.
    Steady,
}

/// Time after the host closed its port in which bytes count as written before: the link's latency
/// in scenarios is some milliseconds.
const LEFT_BEHIND: Duration = Duration::from_millis(100);

/// The host's side of the port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Host {
    Closed,
    /// Opened; connected at the given time if module and radio are there.
    Waiting(Option<Instant>),
    Connected,
}

/// An HC-06 module, and the host's end of its radio link.
#[derive(Clone, Debug)]
pub struct Hc06 {
    profile: Profile,
    settings: Settings,
    /// Line coding in use.
    line: LineConfig,
    /// Line coding to be used, once the reply is out.
    next_line: Option<(Instant, LineConfig)>,
    mode: Mode,
    host: Host,
    closed_at: Option<Instant>,
    radio: Radio,
    /// Time at which module and host give up the connection.
    give_up_at: Option<Instant>,
    collector: Collector,
    air: Air,
    /// Number of UART bytes since the start of command mode that were no commands; `None` before
    /// the first of them.
    vanished: Option<u64>,
    changes: VecDeque<LineEvent>,
    log: EventLog,
}

impl Hc06 {
    /// The end that is wired to the robot.
    pub const UART: Port = Port(0);
    /// The end that the host opens.
    pub const AIR: Port = Port(1);

    /// A module as shipped, with power.
    pub fn new(profile: Profile, seed: u64) -> Self {
        Self {
            settings: profile.settings.clone(),
            line: profile.settings.line,
            next_line: None,
            mode: Mode::Command,
            host: Host::Closed,
            closed_at: None,
            radio: Radio::InReach,
            give_up_at: None,
            collector: Collector::new(&profile),
            air: Air::new(&profile, seed),
            vanished: None,
            changes: VecDeque::new(),
            log: EventLog::default(),
            profile,
        }
    }

    /// Handling of bytes from the module's UART.
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Settings that the module stores.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// State of the status LED. Its rate and the STATE pin differ from board to board.
    pub fn lamp(&self) -> Lamp {
        match self.mode {
            _ if self.settings.led == Led::Off => Lamp::Dark,
            Mode::Off => Lamp::Dark,
            Mode::Command => Lamp::Blinking,
            Mode::Data => Lamp::Steady,
        }
    }

    /// Traffic from the UART towards the host.
    pub fn up(&self) -> Traffic {
        self.air.up.traffic()
    }

    /// Traffic from the host towards the UART.
    pub fn down(&self) -> Traffic {
        self.air.down.traffic()
    }

    /// Bytes that `port` takes without losing any. A host's operating system makes a writer wait
    /// when this is 0; a caller that feeds [`AIR`](Self::AIR) should do the same.
    pub fn room(&self, port: Port) -> usize {
        match port {
            Self::AIR => self.air.down.room(),
            _ => self.air.up.room(),
        }
    }

    /// Whether module and host are in radio range.
    pub const fn radio(&self) -> Radio {
        self.radio
    }

    /// Handles all timers due by `now`, in order of time.
    fn advance(&mut self, now: Instant) {
        while let Some(at) = self.timer().filter(|&at| at <= now) {
            self.air.advance(at);
            self.fire(at);
        }
        self.air.advance(now);
    }

    /// The next deadline of the module itself.
    fn timer(&self) -> Option<Instant> {
        let connect_at = match self.host {
            Host::Waiting(connect_at) => connect_at,
            Host::Closed | Host::Connected => None,
        };
        let switch_at = self.next_line.map(|(at, _)| at);
        let silent_at = self.collector.deadline();
        // This runs for each byte, so it avoids a walk through a list of four.
        let at = |at: Option<Instant>| at.unwrap_or(NEVER);
        let next = at(connect_at).min(at(self.give_up_at));
        let next = next.min(at(switch_at)).min(at(silent_at));
        (next < NEVER).then_some(next)
    }

    /// Handles the timers due exactly at `now`.
    fn fire(&mut self, now: Instant) {
        if self.collector.deadline() == Some(now) {
            let attempt = self.collector.silence();
            self.judge_or_execute(&attempt, now);
        }
        if let Some((_, line)) = self.next_line.filter(|&(at, _)| at == now) {
            self.next_line = None;
            if self.air.down.is_drained() {
                self.use_line(line, now);
            } else {
                // The reply is not out yet: look again a little later.
                self.next_line = Some((now + SWITCH_PAUSE, line));
            }
        }
        if self.host == Host::Waiting(Some(now)) {
            self.connect(now);
        }
        if self.give_up_at == Some(now) {
            self.give_up_at = None;
            self.give_up(now);
        }
    }

    fn use_line(&mut self, line: LineConfig, now: Instant) {
        self.line = line;
        let detail = format!("UART at {} baud", line.baud);
        self.log.note(now, "line-coding-changed", detail);
    }

    /// Handles bytes of the UART that ended like a command.
    fn judge_or_execute(&mut self, attempt: &Attempt, now: Instant) {
        let answer = command::execute(attempt, &self.settings, &self.profile);
        let text = attempt.text.escape_ascii();
        match (self.mode, answer) {
            (Mode::Off, _) | (Mode::Data, None) => {}
            (Mode::Data, Some(_)) => {
                let detail = format!("\"{text}\" was sent as a command and went out as data");
                let rule = "command-while-connected";
                self.log.violation(now, rule, detail, &attempt.text);
            }
            (Mode::Command, Some(answer)) => {
                if attempt.end == End::Silence && attempt.text.ends_with(b"\n") {
                    let detail = format!("\"{text}\": the line end became part of the name");
                    let rule = "line-end-after-command";
                    self.log.violation(now, rule, detail, &attempt.text);
                }
                self.obey(attempt, answer, now);
            }
            (Mode::Command, None) => {
                if let Some((rule, advice)) = command::complaint(attempt, &self.profile) {
                    let detail = format!("\"{text}\": {advice}");
                    self.log.violation(now, rule, detail, &attempt.text);
                }
                if self.profile.family == Family::V30 {
                    if attempt.end == End::Silence {
                        return;
                    }
                    self.refuse();
                }
                self.count_vanished(attempt.count, now);
            }
        }
    }

    /// Answers an unknown command, in the line-terminated family.
    fn refuse(&mut self) {
        let mut out = [0; 16];
        let reply = protocols::hc06::LineReply::Unknown;
        let len = reply.encode(&mut out).expect("eleven bytes");
        self.air.down.put_ready(&out[..len]);
    }

    /// Counts bytes of the UART that command mode consumed although they are no command.
    fn count_vanished(&mut self, count: u64, now: Instant) {
        if self.vanished.is_none() {
            let detail = "no connection: bytes of the UART are taken as commands".to_owned();
            self.log.note(now, "data-in-command-mode", detail);
        }
        self.vanished = Some(self.vanished.unwrap_or(0) + count);
    }

    fn obey(&mut self, attempt: &Attempt, answer: command::Answer, now: Instant) {
        let old = self.line;
        let new = answer.settings.line;
        if answer.settings != self.settings {
            let detail = format!("by \"{}\"", attempt.text.escape_ascii());
            self.log.note(now, "settings-changed", detail);
        }
        self.settings = answer.settings;
        self.air.down.put_ready(&answer.reply);
        let restarts = answer.restart == Restart::Yes;
        match self.profile.line_switch {
            LineSwitch::BeforeReply if new != old => self.use_line(new, now),
            LineSwitch::AtPowerOn if !restarts => {}
            _ if new == old => {}
            _ => {
                let reply_time = old.bytes_time(answer.reply.len() as u64);
                self.next_line = Some((now + reply_time + SWITCH_PAUSE, new));
            }
        }
    }

    /// One byte of the UART that ended at `at`.
    fn receive_byte(&mut self, byte: u8, at: Instant) {
        match self.mode {
            Mode::Off => return,
            Mode::Command => {}
            Mode::Data => self.send_up(&[byte], at),
        }
        if let Some(attempt) = self.collector.push(byte, at) {
            self.judge_or_execute(&attempt, at);
        } else if self.mode == Mode::Command && self.collector.just_overflowed() {
            self.count_vanished(0, at);
        }
    }

    fn send_up(&mut self, bytes: &[u8], at: Instant) {
        let accepted = self.air.push_up(bytes, at);
        if accepted < bytes.len() {
            let fifo_len = self.profile.fifo_len;
            let rule = "fifo-overflow";
            self.log.repeated(at, EventKind::Violation, rule, || {
                format!("a byte was lost: {fifo_len} B wait for the radio")
            });
        }
    }

    fn receive_uart(&mut self, now: Instant, bytes: &[u8]) {
        let line = self.line;
        let begin = byte_end(now, line, 0, bytes.len()).max(self.air.now());
        self.advance(begin);
        // A radio slower than the UART never waits for a byte of the piece, and nothing else
        // happens during it: then the piece may go in as a whole.
        let undisturbed = self.mode == Mode::Data && self.timer().is_none_or(|at| at > now);
        let fits = bytes.len() <= self.air.up.room() && line.byte_time() <= self.air.step();
        if undisturbed && fits && self.collector.push_all(bytes, begin, now).is_ok() {
            self.send_up(bytes, begin);
            return;
        }
        for (index, &byte) in bytes.iter().enumerate() {
            let at = byte_end(now, line, index, bytes.len()).max(begin);
            self.advance(at);
            self.receive_byte(byte, at);
        }
    }

    fn receive_air(&mut self, now: Instant, bytes: &[u8]) {
        self.advance(now);
        if self.host == Host::Closed {
            // A closing host drops its unsent bytes.
            if self.closed_at.is_some_and(|at| now - at < LEFT_BEHIND) {
                return;
            }
            self.log
                .repeated(now, EventKind::Violation, "host-port-closed", || {
                    format!("{} bytes arrived at a port that is not open", bytes.len())
                });
            return;
        }
        if self.air.push_down(bytes, now) < bytes.len() {
            let rule = "host-overflow";
            self.log.repeated(now, EventKind::Violation, rule, || {
                "bytes of the host were lost: it did not wait".to_owned()
            });
        }
    }
}

impl Device for Hc06 {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        match port {
            Self::UART => self.receive_uart(now, bytes),
            Self::AIR => self.receive_air(now, bytes),
            _ => {}
        }
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        self.advance(now);
        match (port, event) {
            (Self::AIR, LineEvent::Opened) => self.host_opens(now),
            (Self::AIR, LineEvent::Closed) => self.host_closes(now),
            (Self::UART, LineEvent::FramingError) if self.mode != Mode::Off => {
                let baud = self.line.baud;
                let rule = "framing-error";
                self.log.repeated(now, EventKind::Violation, rule, || {
                    format!("a character without stop bit; the module is set to {baud} baud")
                });
            }
            _ => {}
        }
    }

    fn poll(&mut self, now: Instant, _world: &mut World) {
        self.advance(now);
        self.log.poll(now);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match port {
            Self::UART => self.air.down.take(buf),
            Self::AIR => self.air.up.take(buf),
            _ => 0,
        }
    }

    fn line_change(&mut self, port: Port) -> Option<LineEvent> {
        if port == Self::AIR {
            self.changes.pop_front()
        } else {
            None
        }
    }

    fn may_send(&self, port: Port) -> bool {
        match port {
            Self::UART => !self.air.down.is_drained(),
            Self::AIR => !self.air.up.is_drained() || !self.changes.is_empty(),
            _ => false,
        }
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest([self.timer(), self.air.poll_at(), self.log.poll_at()])
    }

    fn line_config(&self, port: Port) -> LineConfig {
        if port == Self::UART {
            self.line
        } else {
            AIR_LINE
        }
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &["off", "restart", "out-of-reach"]
    }

    fn set_fault(&mut self, now: Instant, fault: &str, _figure: Option<f64>, begins: bool) {
        match (fault, begins) {
            ("off", true) => self.power_off(now),
            ("off", false) => self.power_on(now),
            ("restart", true) => self.power_cycle(now),
            ("out-of-reach", true) => self.set_radio(now, Radio::Lost),
            ("out-of-reach", false) => self.set_radio(now, Radio::InReach),
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
