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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::bare;

    /// A rig has one robot: whatever its number, it is the rig itself.
    #[test]
    fn a_rig_is_paced_by_itself() {
        let (mut rig, _) = bare::linked(["line"], 9600);
        Paced::run_until(&mut rig, Instant::from_millis(3));
        let seen = [0, 1].map(|robot| rig.rig_of(robot).now().as_millis());
        assert_eq!(seen, [3, 3]);
        assert_eq!(rig.rig_of_mut(1).links().len(), 1);
        assert_eq!(Paced::rig(&mut rig).now().as_millis(), 3);
    }
}
