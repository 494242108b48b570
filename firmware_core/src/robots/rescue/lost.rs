use protocols::pcui::message::Mode;

use super::Rescue;
use crate::slam::{Certainty, Mapper};

/// How far the robot may roll and turn without a measurement, from one turn of the lidar to the
/// next: it drives 45 mm.
const UNSEEN_MM: f32 = 50.0;
const UNSEEN_RAD: f32 = 0.1;
/// The most for such a motion, by the turn and in all: its base stops the motors after a second.
const BLIND_TURN: [f32; 2] = [50.0, 0.17];
const BLIND_MOST: [f32; 2] = [280.0, 1.2];
/// Turns in a row that fit nowhere before a robot counts as lost.
const LOST_AFTER: u8 = 3;
/// Turns in a row after which a lost robot may be anywhere; before, it most likely turned or rolled
/// on without a measurement.
const ANYWHERE_AFTER: u8 = 30;

/// Whether the robot knows where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lost {
    /// Turns in a row without a known pose in the map.
    turns: u8,
}

impl Lost {
    pub(super) const fn new() -> Self {
        Self { turns: 0 }
    }

    pub(super) const fn is_lost(self) -> bool {
        self.turns >= LOST_AFTER
    }

    /// Tells `mapper`, before it is given the next turn, what the wheels missed: the motion of this
    /// turn, or some before it.
    pub(super) fn before(mapper: &mut Mapper, knows_motion: bool, has_gap: bool) {
        if !knows_motion {
            mapper.doubt(UNSEEN_MM, UNSEEN_RAD);
            mapper.lose_track(BLIND_TURN, BLIND_MOST);
        }
        if has_gap {
            mapper.lose_track(BLIND_MOST, BLIND_MOST);
        }
    }

    /// Takes how sure the pose of the newest turn is.
    pub(super) const fn after(&mut self, mapper: &mut Mapper, certainty: Certainty) {
        self.turns = match certainty {
            Certainty::Doubtful | Certainty::Ambiguous => self.turns.saturating_add(1),
            Certainty::Sure | Certainty::Moved => 0,
        };
        match self.turns {
            LOST_AFTER => mapper.lose_track(BLIND_MOST, BLIND_MOST),
            ANYWHERE_AFTER => mapper.lose_track([0.0; 2], [0.0; 2]),
            _ => {}
        }
    }
}

impl Rescue {
    /// Whether the robot has to go to a place and does not know where it is: it stands, because
    /// looking for itself takes its processor longer than its decisions hold.
    pub fn is_lost(&self) -> bool {
        matches!(self.mode, Mode::Waypoint | Mode::Explore) && self.lost.is_lost()
    }
}
