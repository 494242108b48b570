//! A robot's program without a rig, on serial ports, at the pace of the wall clock.
//!
//! It does the work of a board: it calls the program, and connects a port to each of its UARTs. A
//! UART takes time to send, but a port does not. Bytes are therefore written no faster than the
//! line could carry them, so that the program decides about a byte when it is sent and not seconds
//! before.

use core::time::Duration;
use std::os::fd::BorrowedFd;

use firmware_core::Master;
use protocols::{Instant, Port};

use crate::clock::Clock;
use crate::transport::{Transport, TransportError, wait};

/// Time by which bytes are written ahead of the line. More bytes would be out of the program's
/// control; fewer would wake this thread for each byte.
const AHEAD: Duration = Duration::from_millis(1);
/// Minimum and maximum wait between two turns without input.
const WAIT_MIN: Duration = Duration::from_micros(200);
const WAIT_MAX: Duration = Duration::from_millis(5);
/// Maximum number of bytes in one write.
const PIECE_MAX: usize = 256;

/// A program, its ports and a clock.
pub struct Standalone<P: ?Sized, C> {
    program: Box<P>,
    clock: C,
    uarts: Vec<Uart>,
}

/// A port of the program and its transport.
struct Uart {
    port: Port,
    transport: Box<dyn Transport>,
    /// Time at which the line has carried all written bytes.
    free_at: Instant,
}

impl<P: Master + ?Sized, C: Clock> Standalone<P, C> {
    /// `program` without ports.
    pub fn new(program: Box<P>, clock: C) -> Self {
        Self {
            program,
            clock,
            uarts: Vec::new(),
        }
    }

    /// Connects a port of the program.
    pub fn connect(&mut self, port: Port, transport: Box<dyn Transport>) {
        self.uarts.push(Uart {
            port,
            transport,
            free_at: Instant::ZERO,
        });
    }

    /// The program.
    pub fn program(&self) -> &P {
        &self.program
    }

    /// The clock.
    pub const fn clock(&self) -> &C {
        &self.clock
    }

    /// Reads input, runs the program and sends its output once, then waits for the next event.
    ///
    /// # Errors
    /// If a port disappeared.
    pub fn turn(&mut self) -> Result<(), TransportError> {
        let mut buf = [0; 1024];
        for uart in &mut self.uarts {
            // Read all available input, but not forever: a port may be faster than this loop.
            for _ in 0..READS_MAX {
                let len = uart.transport.read(&mut buf)?;
                while uart.transport.next_event().is_some() {}
                if len == 0 {
                    break;
                }
                let now = self.clock.now();
                self.program.receive(uart.port, now, &buf[..len]);
            }
        }
        self.program.poll(self.clock.now());
        let now = self.clock.now();
        for uart in &mut self.uarts {
            uart.send(now, self.program.as_mut());
        }
        self.wait();
        Ok(())
    }

    fn wait(&self) {
        let now = self.clock.now();
        // A port with written bytes is due again when its line can take more.
        let lines = self
            .uarts
            .iter()
            .filter(|uart| uart.free_at > now)
            .map(|uart| uart.free_at);
        let next = self.program.poll_at().into_iter().chain(lines).min();
        let timeout = next.map_or(WAIT_MAX, |next| next - now);
        let timeout = timeout.clamp(WAIT_MIN, WAIT_MAX);
        let mut fds: Vec<BorrowedFd<'_>> = Vec::new();
        for uart in &self.uarts {
            uart.transport.readiness(&mut fds);
        }
        if fds.is_empty() || wait(&fds, timeout).is_err() {
            self.clock.sleep_until(now + timeout);
        }
    }
}

const READS_MAX: usize = 16;

impl Uart {
    /// Writes the program's bytes, as far as the line would carry them by [`AHEAD`] from now.
    fn send(&mut self, now: Instant, program: &mut (impl Master + ?Sized)) {
        let line = program.line_config(self.port);
        let mut buf = [0; PIECE_MAX];
        self.free_at = self.free_at.max(now);
        while self.free_at < now + AHEAD {
            let room = (now + AHEAD - self.free_at).as_nanos() / line.byte_time().as_nanos().max(1);
            let room = usize::try_from(room).map_or(PIECE_MAX, |room| room.clamp(1, PIECE_MAX));
            let len = program.transmit(self.port, &mut buf[..room]);
            if len == 0 {
                return;
            }
            self.transport.write(&buf[..len]);
            self.free_at += line.bytes_time(len as u64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SimClock;
    use crate::transport::Memory;
    use firmware_core::Work;
    use protocols::LineConfig;

    /// Sends zeros without end, and stores its input.
    #[derive(Default)]
    struct Talker {
        heard: Vec<u8>,
    }

    impl Master for Talker {
        fn receive(&mut self, _: Port, _: Instant, bytes: &[u8]) {
            self.heard.extend_from_slice(bytes);
        }
        fn poll(&mut self, _: Instant) {}
        fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
            buf.fill(0);
            buf.len()
        }
        fn poll_at(&self) -> Option<Instant> {
            None
        }
        fn line_config(&self, _: Port) -> LineConfig {
            LineConfig::new_8n1(115_200)
        }
        fn take_work(&mut self) -> Work {
            Work::default()
        }
    }

    /// 115200 baud carry 11,520 bytes per second; a port would accept any number.
    #[test]
    fn a_program_that_always_has_something_to_send_keeps_to_the_rate_of_its_line() {
        let (near, mut far) = Memory::pair("line");
        let mut alone = Standalone::new(Box::<Talker>::default(), SimClock::default());
        alone.connect(Port(0), Box::new(near));
        let (mut bytes, mut buf) = (0, [0; 4096]);
        while alone.clock().now() < Instant::from_secs(1) {
            alone.turn().expect("memory stays");
            bytes += far.read(&mut buf).expect("memory stays");
        }
        assert!((11_520..=11_520 + 100).contains(&bytes), "{bytes}");
    }

    #[test]
    fn what_comes_in_reaches_the_program_in_order() {
        let (near, mut far) = Memory::pair("line");
        let mut alone = Standalone::new(Box::<Talker>::default(), SimClock::default());
        alone.connect(Port(0), Box::new(near));
        let sent: Vec<u8> = (0..=255).cycle().take(3000).collect();
        assert_eq!(far.write(&sent), 3000);
        alone.turn().expect("memory stays");
        assert_eq!(alone.program().heard, sent);
    }
}
