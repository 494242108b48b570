//! The state of the connection: power, radio and the host's port.
//!
//! ```text
//!                     connect delay
//! Command (host waits) ----------> Data   host closes, or 20 s of radio silence
//!    ^  ^------------------------------'
//!    |
//!    '-- power on -- Off <-- power off, from anywhere; the host notices after 20 s
//! ```

use protocols::{Instant, LineEvent};

use super::{Hc06, Host, Leftovers, Mode, Radio};
use crate::device::earliest;

impl Hc06 {
    /// Takes the host out of the radio's reach, or brings it back.
    pub fn set_radio(&mut self, now: Instant, radio: Radio) {
        self.advance(now);
        if self.radio == radio {
            return;
        }
        self.radio = radio;
        match radio {
            Radio::Lost => {
                self.log.note(now, "radio-lost", String::new());
                if self.mode == Mode::Data || self.host == Host::Connected {
                    self.expect_give_up(now);
                }
            }
            Radio::InReach => {
                self.log.note(now, "radio-back", String::new());
                match (self.mode, self.host) {
                    (Mode::Data, Host::Connected) => self.give_up_at = None,
                    (Mode::Data, _) => self.leave_data_mode(now, "the host had closed its port"),
                    _ => {}
                }
            }
        }
        self.look_for_partner(now);
    }

    /// Cuts the power. The host does not notice until the supervision time is over.
    pub fn power_off(&mut self, now: Instant) {
        self.advance(now);
        if self.mode == Mode::Off {
            return;
        }
        self.mode = Mode::Off;
        self.next_line = None;
        self.collector.clear();
        self.air.down.drop_ready();
        self.air.up.drop_under_way();
        self.log.note(now, "power-off", String::new());
        if self.host == Host::Connected {
            self.expect_give_up(now);
        }
        self.look_for_partner(now);
    }

    /// Gives the power back: the module starts with the settings it remembers.
    pub fn power_on(&mut self, now: Instant) {
        self.advance(now);
        if self.mode != Mode::Off {
            return;
        }
        self.line = self.settings.line;
        self.enter_command_mode();
        self.log
            .note(now, "power-on", format!("UART at {} baud", self.line.baud));
        self.look_for_partner(now);
    }

    /// Takes the power away and gives it back.
    pub fn power_cycle(&mut self, now: Instant) {
        self.power_off(now);
        self.power_on(now);
    }

    fn expect_give_up(&mut self, now: Instant) {
        let at = now + self.profile.supervision;
        self.give_up_at = earliest([self.give_up_at, Some(at)]);
    }

    /// Starts, stops and postpones actions that need module, radio and host together.
    fn look_for_partner(&mut self, now: Instant) {
        let reachable = self.mode == Mode::Command && self.radio == Radio::InReach;
        self.host = match self.host {
            Host::Waiting(None) if reachable => {
                Host::Waiting(Some(now + self.profile.connect_delay))
            }
            Host::Waiting(_) if !reachable => Host::Waiting(None),
            other => other,
        };
        let flows = self.mode == Mode::Data && self.host == Host::Connected;
        let carrier = if flows { self.radio } else { Radio::Lost };
        self.air.set_carrier(now, carrier);
    }

    fn enter_command_mode(&mut self) {
        self.mode = Mode::Command;
        self.collector.clear();
        self.vanished = None;
    }

    /// Handles a new connection.
    pub(super) fn connect(&mut self, now: Instant) {
        self.host = Host::Connected;
        self.mode = Mode::Data;
        self.give_up_at = None;
        self.changes.push_back(LineEvent::Opened);
        let vanished = self.vanished.take().unwrap_or(0) + self.collector.count();
        self.collector.clear();
        let detail = format!("{vanished} bytes of the UART vanished in command mode before");
        self.log.note(now, "connected", detail);
        self.look_for_partner(now);
    }

    /// Handles the end of the connection on the module's side.
    fn leave_data_mode(&mut self, now: Instant, why: &str) {
        self.give_up_at = None;
        self.enter_command_mode();
        self.drop_leftovers();
        self.air.down.put_ready(self.profile.disconnect_text);
        self.log.note(now, "disconnected", why.to_owned());
        self.look_for_partner(now);
    }

    fn drop_leftovers(&mut self) {
        if self.profile.leftovers == Leftovers::Dropped {
            self.air.up.drop_under_way();
            self.air.down.drop_under_way();
        }
    }

    pub(super) fn host_opens(&mut self, now: Instant) {
        if self.host == Host::Closed {
            self.host = Host::Waiting(None);
            self.look_for_partner(now);
        }
    }

    pub(super) fn host_closes(&mut self, now: Instant) {
        if self.host == Host::Closed {
            return;
        }
        self.host = Host::Closed;
        self.closed_at = Some(now);
        self.changes.clear();
        self.air.up.drop_ready();
        match (self.mode, self.radio) {
            (Mode::Data, Radio::InReach) => self.leave_data_mode(now, "the host closed its port"),
            // The module gets no notice of the close and waits for the supervision time.
            (Mode::Data, Radio::Lost) => self.look_for_partner(now),
            (Mode::Off | Mode::Command, _) => {
                self.give_up_at = None;
                self.drop_leftovers();
                self.look_for_partner(now);
            }
        }
    }

    /// Ends the connection after the supervision time.
    pub(super) fn give_up(&mut self, now: Instant) {
        if self.host == Host::Connected {
            self.host = Host::Closed;
            self.closed_at = Some(now);
            self.changes.push_back(LineEvent::Closed);
            if self.mode != Mode::Data {
                let detail = "the module did not answer for the supervision time".to_owned();
                self.log.note(now, "host-gave-up", detail);
            }
        }
        if self.mode == Mode::Data {
            self.leave_data_mode(now, "the radio was silent for the supervision time");
        } else {
            self.drop_leftovers();
            self.look_for_partner(now);
        }
    }
}
