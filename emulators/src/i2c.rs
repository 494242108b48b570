//! Chips with registers on an I2C bus, by themselves as devices.
//!
//! ```text
//! write   | address u7, 0 | register | data ... |       no data: the register to read from
//! read    | address u7, 1 | count |                  -> | count bytes |
//! ```
//!
//! A message of the link is a transaction. In the second a real master clocks as many bytes as it
//! wants; here it says how many. A chip that does not acknowledge does not answer.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::{Instant, LineConfig, Port};

use crate::device::{Device, Event};
use crate::event_log::EventLog;
use crate::world::World;

/// Messages that wait at most; further ones are lost.
const QUEUE_MAX: usize = 16;
/// From the end of a request to the beginning of the answer: a bus waits for nobody.
const LATENCY: Duration = Duration::from_micros(5);

/// A chip whose master reads and writes registers. The register counts up within a transaction.
///
/// Time never runs backwards between calls. The world is that of the call's `now`. Answers must not
/// depend on how long a chip was left alone but by the model of it.
pub trait RegisterChip: Clone {
    /// Whether it acknowledges the first byte of a transaction, `address` without the lowest bit.
    fn acknowledges(&self, now: Instant, address: u8) -> bool;

    /// Takes `data` for the registers from `register` on; never empty.
    fn write(&mut self, now: Instant, register: u8, data: &[u8], world: &World);

    /// Fills `data` from the registers from `register` on; what is not there reads 0.
    fn read(&mut self, now: Instant, register: u8, data: &mut [u8], world: &World);

    /// As [`Device::known_faults`].
    fn known_faults(&self) -> &'static [&'static str];

    /// As [`Device::set_fault`].
    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool);

    /// Where it writes what its master did wrong.
    fn log(&mut self) -> &mut Log;
}

/// A chip's log.
#[derive(Clone, Debug, Default)]
pub struct Log(pub(crate) EventLog);

/// A chip that is alone on its bus.
#[derive(Clone, Debug)]
pub struct OnBus<C> {
    chip: C,
    /// Where the next read begins.
    register: u8,
    requests: VecDeque<(Instant, Vec<u8>)>,
    answers: VecDeque<Vec<u8>>,
}

impl<C: RegisterChip> OnBus<C> {
    /// The bus.
    pub const BUS: Port = Port(0);

    /// `chip` on a bus of 100 kbit/s.
    pub const fn new(chip: C) -> Self {
        Self {
            chip,
            register: 0,
            requests: VecDeque::new(),
            answers: VecDeque::new(),
        }
    }

    /// The chip.
    pub const fn chip(&self) -> &C {
        &self.chip
    }

    fn obey(&mut self, now: Instant, message: &[u8], world: &World) {
        let [address, rest @ ..] = message else {
            return;
        };
        if !self.chip.acknowledges(now, address & 0xFE) {
            return;
        }
        if address & 1 == 0 {
            let [register, data @ ..] = rest else { return };
            self.register = *register;
            if !data.is_empty() {
                self.chip.write(now, *register, data, world);
            }
        } else if let Some(count) = rest.first().filter(|count| **count > 0) {
            let mut answer = vec![0; usize::from(*count)];
            self.chip.read(now, self.register, &mut answer, world);
            self.register = self.register.wrapping_add(*count);
            self.answers.push_back(answer);
        }
    }
}

impl<C: RegisterChip> Device for OnBus<C> {
    fn receive(&mut self, _port: Port, now: Instant, bytes: &[u8]) {
        if self.requests.len() < QUEUE_MAX {
            self.requests.push_back((now + LATENCY, bytes.to_vec()));
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        while let Some((_, message)) = self.requests.pop_front_if(|(at, _)| *at <= now) {
            self.obey(now, &message, world);
        }
        self.chip.log().0.poll(now);
    }

    fn transmit(&mut self, _port: Port, buf: &mut [u8]) -> usize {
        let Some(answer) = self.answers.pop_front() else {
            return 0;
        };
        let len = answer.len().min(buf.len());
        buf[..len].copy_from_slice(&answer[..len]);
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        self.requests.front().map(|(at, _)| *at)
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        LineConfig::new_8n1(100_000)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        self.chip.known_faults()
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        self.chip.set_fault(now, fault, figure, begins);
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.chip.log().0.take()
    }
}
