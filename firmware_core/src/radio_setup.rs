//! Setup of an HC-06 radio before its use: name, PIN and rate, by its commands.
//!
//! ```text
//!   AT --OK--> AT+NAMEn --OK--> AT+PINnnnn --OK--> AT+BAUDn --OK--> ready, at the new rate
//!    ^---- no answer: the next rate that a module may be set to ----'
//! ```
//!
//! Modules of the linvor family and of hc01.com take a command only if a second of silence follows
//! it, and never during a connection (module guides, see [`protocols::hc06`]). The setup gives up a
//! module that answers at no rate: the module may be connected already, or use the other command
//! set.

use core::time::Duration;

use protocols::hc06::{BAUD_RATES, Command};
use protocols::{Instant, LineConfig};

use crate::fifo::Fifo;

/// Longest wait for an answer: a second of silence, the longest command and reply at 1200 baud, and
/// a margin.
const REPLY_WAIT: Duration = Duration::from_millis(1_600);
/// Quiet time after which a reply counts as complete, and the module as ready for a command.
const QUIET: Duration = Duration::from_millis(100);
/// Longest command.
const COMMAND_MAX: usize = 32;
/// First bytes of every reply.
const OK: [u8; 2] = *b"OK";

/// Wanted settings of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Expected current rate, bit/s: tried first.
    pub found_baud: u32,
    /// Wanted rate, one of [`BAUD_RATES`].
    pub baud: u32,
    /// Name of the module on the air, 1 to 20 characters.
    pub name: &'static str,
    /// PIN of the module, four digits.
    pub pin: [u8; 4],
}

/// Next command of the dialogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Attention,
    Name,
    Pin,
    Rate,
    /// The setup has ended; whether the module has the wanted settings.
    Over {
        is_set_up: bool,
    },
}

/// The setup of a module.
#[derive(Clone, Debug)]
pub struct RadioSetup {
    settings: Settings,
    step: Step,
    /// Rate of the current command.
    baud: u32,
    /// Number of [`BAUD_RATES`] tried after the expected one.
    tried: usize,
    tx: Fifo<COMMAND_MAX>,
    /// First bytes of the reply, and the number received.
    reply: [u8; OK.len()],
    reply_len: usize,
    heard_at: Instant,
    /// Timeout of the current command; `None` before the first.
    until: Option<Instant>,
}

impl RadioSetup {
    /// A setup that begins with its first [`tick`](Self::tick).
    pub const fn new(settings: Settings) -> Self {
        Self {
            settings,
            step: Step::Attention,
            baud: settings.found_baud,
            tried: 0,
            tx: Fifo::new(),
            reply: [0; OK.len()],
            reply_len: 0,
            heard_at: Instant::ZERO,
            until: None,
        }
    }

    /// Whether the setup has finished: it will send and receive nothing more.
    pub const fn is_over(&self) -> bool {
        matches!(self.step, Step::Over { .. })
    }

    /// Whether no module answered, or the reply was wrong.
    pub const fn has_failed(&self) -> bool {
        matches!(self.step, Step::Over { is_set_up: false })
    }

    /// Line coding of the current command.
    pub const fn line(&self) -> LineConfig {
        LineConfig::new_8n1(self.baud)
    }

    /// Takes the module's reply.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(slot) = self.reply.get_mut(self.reply_len) {
                *slot = byte;
            }
            self.reply_len += 1;
        }
        self.heard_at = now;
    }

    /// Continues if a reply is complete or did not arrive in time.
    pub fn tick(&mut self, now: Instant) {
        if now < self.next_at() {
            return;
        }
        match self.until {
            None => self.say(now),
            Some(_) if self.reply_len > 0 => self.take_reply(now),
            Some(_) => self.try_next_rate(now),
        }
    }

    /// Time of the next call of [`tick`](Self::tick).
    pub fn next_at(&self) -> Instant {
        match self.until {
            _ if self.is_over() => Instant::from_nanos(u64::MAX),
            None => Instant::ZERO,
            Some(_) if self.reply_len > 0 => self.heard_at + QUIET,
            Some(until) => until,
        }
    }

    /// Whether bytes wait for the radio.
    pub const fn has_output(&self) -> bool {
        !self.tx.is_empty()
    }

    /// Moves bytes for the module into `buf`; returns how many.
    pub fn transmit(&mut self, buf: &mut [u8]) -> usize {
        self.tx.pop(buf)
    }

    fn take_reply(&mut self, now: Instant) {
        if self.reply != OK {
            self.try_next_rate(now);
            return;
        }
        self.step = match self.step {
            Step::Attention => Step::Name,
            Step::Name => Step::Pin,
            Step::Pin if self.baud != self.settings.baud => Step::Rate,
            _ => Step::Over { is_set_up: true },
        };
        self.say(now);
    }

    fn try_next_rate(&mut self, now: Instant) {
        let left = BAUD_RATES.iter().rev().skip(self.tried);
        let mut left = left.zip(self.tried + 1..);
        let next = left.find(|(rate, _)| **rate != self.settings.found_baud);
        (self.step, self.baud) = match next {
            Some((&rate, tried)) => {
                self.tried = tried;
                (Step::Attention, rate)
            }
            None => (Step::Over { is_set_up: false }, self.settings.baud),
        };
        self.say(now);
    }

    fn say(&mut self, now: Instant) {
        let command = match self.step {
            Step::Attention => Command::Attention,
            Step::Name => Command::Name(self.settings.name.as_bytes()),
            Step::Pin => Command::Pin(self.settings.pin),
            Step::Rate => Command::Baud(self.settings.baud),
            Step::Over { .. } => {
                self.baud = self.settings.baud;
                return;
            }
        };
        let mut bytes = [0; COMMAND_MAX];
        // A command that cannot be encoded gets no reply either.
        let len = command.encode(&mut bytes).unwrap_or(0);
        self.tx.clear();
        self.tx.push(&bytes[..len]);
        self.reply = [0; OK.len()];
        self.reply_len = 0;
        self.until = Some(now + REPLY_WAIT);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::String;
    use std::vec::Vec;

    use super::*;

    const SETTINGS: Settings = Settings {
        found_baud: 9_600,
        baud: 460_800,
        name: "rescue",
        pin: *b"1234",
    };

    /// Commands sent until the end, with their rates, and the time needed, for a module at `baud`
    /// that replies OK after a second of silence.
    fn said_to(baud: u32, settings: Settings) -> (Vec<(u32, String)>, RadioSetup, u64) {
        let mut setup = RadioSetup::new(settings);
        let (mut said, mut baud) = (Vec::new(), baud);
        let mut answer = None;
        for millis in 0..60_000 {
            let now = Instant::from_millis(millis);
            if setup.is_over() {
                return (said, setup, millis);
            }
            if answer == Some(millis) {
                setup.receive(now, b"OK");
            }
            setup.tick(now);
            let mut buf = [0; COMMAND_MAX];
            if let len @ 1.. = setup.transmit(&mut buf) {
                let text = String::from_utf8(buf[..len].to_vec()).expect("words");
                answer = (setup.line().baud == baud).then_some(millis + 1_010);
                said.push((setup.line().baud, text.clone()));
                if answer.is_some() && text == "AT+BAUDA" {
                    baud = 460_800;
                }
            }
        }
        (said, setup, 60_000)
    }

    /// A module as shipped: four commands, a second of silence and a tenth of quiet each.
    #[test]
    fn a_module_as_shipped_is_named_and_set_to_the_rate() {
        let (said, setup, took) = said_to(9_600, SETTINGS);
        let words = ["AT", "AT+NAMErescue", "AT+PIN1234", "AT+BAUDA"];
        let expected: Vec<_> = words.map(|word| (9_600, String::from(word))).into();
        assert_eq!(said, expected);
        assert_eq!((setup.has_failed(), setup.line().baud), (false, 460_800));
        assert!((4 * 1_110..4 * 1_110 + 10).contains(&took), "{took}");
    }

    /// A module at the wanted rate only gets its name and PIN; 1382400 and 921600 are tried before
    /// it.
    #[test]
    fn a_module_that_has_the_rate_is_found_at_it() {
        let (said, setup, _) = said_to(460_800, SETTINGS);
        let rates: Vec<u32> = said.iter().map(|(rate, _)| *rate).collect();
        let expected = [9_600, 1_382_400, 921_600, 460_800, 460_800, 460_800];
        assert_eq!(rates, expected);
        assert!(!setup.has_failed());
    }

    /// Each of the twelve rates once, 1.6 s each; then the robot continues as if it were ready.
    #[test]
    fn a_module_that_never_answers_is_given_up() {
        let (said, setup, took) = said_to(1, SETTINGS);
        let mut rates: Vec<u32> = said.iter().map(|(rate, _)| *rate).collect();
        rates.sort_unstable();
        assert_eq!(rates, BAUD_RATES);
        assert!((12 * 1_600..12 * 1_600 + 20).contains(&took), "{took}");
        assert_eq!((setup.has_failed(), setup.line().baud), (true, 460_800));
    }
}
