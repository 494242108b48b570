//! Objects that a clock can drive.

use protocols::Instant;

use super::Rig;

/// An object that runs at the pace of a clock: a rig, or a rig with its checkers.
pub trait Paced {
    /// The rig.
    fn rig(&mut self) -> &mut Rig;

    /// Runs until `deadline`, with all work due by then.
    fn run_until(&mut self, deadline: Instant);
}

impl Paced for Rig {
    fn rig(&mut self) -> &mut Rig {
        self
    }

    fn run_until(&mut self, deadline: Instant) {
        Self::run_until(self, deadline);
    }
}
