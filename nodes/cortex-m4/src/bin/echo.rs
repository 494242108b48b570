//! The smallest firmware: sends back each byte, and a dot every 100 ms.
#![no_std]
#![no_main]

use core::time::Duration;

use cortex_m_rt::entry;
use cortex_m4::Setup;
use firmware_core::{Master, Work};
use protocols::{Instant, LineConfig, Port};

const UART: Port = Port(0);
const PERIOD: Duration = Duration::from_millis(100);

/// Bytes to send, and the time of the next dot.
struct Echo {
    bytes: [u8; 64],
    waiting: usize,
    dot_at: Instant,
}

impl Echo {
    fn put(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.waiting) {
            *place = byte;
            self.waiting += 1;
        }
    }
}

impl Master for Echo {
    fn receive(&mut self, _: Port, _: Instant, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.put(byte));
    }

    fn poll(&mut self, now: Instant) {
        if now >= self.dot_at {
            self.put(b'.');
            self.dot_at = now + PERIOD;
        }
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        let len = buf.len().min(self.waiting);
        buf[..len].copy_from_slice(&self.bytes[..len]);
        self.bytes.copy_within(len..self.waiting, 0);
        self.waiting -= len;
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        Some(self.dot_at)
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LineConfig::new_8n1(9_600)
    }

    fn take_work(&mut self) -> Work {
        Work::NONE
    }
}

#[entry]
fn main() -> ! {
    let setup = Setup::read(&[("uart", UART)], |_, _| {
        Err("this firmware has no settings")
    });
    setup.run(Echo {
        bytes: [0; 64],
        waiting: 0,
        dot_at: Instant::ZERO + PERIOD,
    })
}
