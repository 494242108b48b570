//! Objects that a clock can drive.

use protocols::Instant;

use super::Rig;

/// The rigs of the robots in one world. The first robot has the index 0.
pub trait Rigs {
    /// The rig of the robot with this index.
    fn rig_of(&self, robot: usize) -> &Rig;
}

impl Rigs for Rig {
    fn rig_of(&self, _robot: usize) -> &Rig {
        self
    }
}

/// An object that runs at the pace of a clock: a rig, or a rig with its checkers.
pub trait Paced {
    /// The rig of the first robot.
    fn rig(&mut self) -> &mut Rig;

    /// The rig of the robot with this index, see [`Rigs`].
    fn rig_of_mut(&mut self, _robot: usize) -> &mut Rig {
        self.rig()
    }

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
