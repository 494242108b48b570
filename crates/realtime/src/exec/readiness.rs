//! When a program has opened what it needs, so that rig time may run.

use core::time::Duration;

use super::ports::Ports;

/// Time without a further port after which a program that sends is taken to wait for an answer.
const WAITS: Duration = Duration::from_secs(1);

/// Judges it; time is the program's, the wall's or a virtual one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Readiness {
    wait: Duration,
    /// When the last port was opened, and how many were.
    opening: (Duration, usize),
}

impl Readiness {
    /// For a program that has to open its ports within `wait`.
    pub(crate) const fn new(wait: Duration) -> Self {
        Self {
            wait,
            opening: (Duration::ZERO, 0),
        }
    }

    /// Whether rig time may run, `waited` after the program was started.
    pub(crate) fn is_ready(&mut self, ports: &Ports, waited: Duration) -> bool {
        let opened = ports.opened();
        if opened != self.opening.1 {
            self.opening = (waited, opened);
        }
        let waits = ports.any_speaks() && waited - self.opening.0 >= WAITS;
        ports.is_complete() || waits || waited >= self.wait
    }

    /// Whether its time is up, and it has opened nothing.
    pub(crate) fn has_given_up(&self, ports: &Ports, waited: Duration) -> bool {
        waited >= self.wait && ports.opened() == 0
    }
}
