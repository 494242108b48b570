//! Whether a program has opened its required ports, so that rig time may start.

use core::time::Duration;

use super::ports::Ports;

/// Time without a further port after which a program that has sent a byte probably waits for an
/// answer.
const WAITS: Duration = Duration::from_secs(1);

/// Decides on the start of rig time; the program's time is wall time or virtual time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Readiness {
    wait: Duration,
    /// Time of the last opening, and the number of opened ports.
    opening: (Duration, usize),
}

impl Readiness {
    /// For a program that must open its ports within `wait`.
    pub(crate) const fn new(wait: Duration) -> Self {
        Self {
            wait,
            opening: (Duration::ZERO, 0),
        }
    }

    /// Whether rig time may start, `waited` after the start of the program.
    pub(crate) fn is_ready(&mut self, ports: &Ports, waited: Duration) -> bool {
        let opened = ports.opened();
        if opened != self.opening.1 {
            self.opening = (waited, opened);
        }
        let waits = ports.any_speaks() && waited - self.opening.0 >= WAITS;
        ports.is_complete() || waits || waited >= self.wait
    }

    /// Whether the program's time is over and it has opened no port.
    pub(crate) fn has_given_up(&self, ports: &Ports, waited: Duration) -> bool {
        waited >= self.wait && ports.opened() == 0
    }
}
