use protocols::pcui::message::Mode;

use super::Rescue;
use crate::slam::{Certainty, Mapper};

/// Maximum distance and turn without a measurement, from one turn of the lidar to the next: the
/// robot drives 45 mm.
const UNSEEN_MM: f32 = 50.0;
const UNSEEN_RAD: f32 = 0.1;
/// Maximum of such a motion, per turn and in total: the base stops the motors after a second.
const BLIND_TURN: [f32; 2] = [50.0, 0.17];
const BLIND_MOST: [f32; 2] = [280.0, 1.2];
/// Number of unfitting turns in a row after which the robot counts as lost.
const LOST_AFTER: u8 = 3;
/// Number of turns in a row after which a lost robot may be anywhere; before, an unmeasured turn or
/// roll is more likely.
const ANYWHERE_AFTER: u8 = 30;

/// Whether the robot knows its pose.
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

    /// Notes in `mapper`, before it gets the next turn, the motion that the wheels missed in this
    /// turn or in some before.
    pub(super) fn before(mapper: &mut Mapper, knows_motion: bool, has_gap: bool) {
        if !knows_motion {
            mapper.doubt(UNSEEN_MM, UNSEEN_RAD);
            mapper.lose_track(BLIND_TURN, BLIND_MOST);
        }
        if has_gap {
            mapper.lose_track(BLIND_MOST, BLIND_MOST);
        }
    }

    /// Takes the certainty of the newest turn's pose.
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
    /// Whether the robot is lost while it needs its pose for a goal. It then stops, because the
    /// search of the whole map takes longer than its decisions hold.
    pub fn is_lost(&self) -> bool {
        matches!(self.mode, Mode::Waypoint | Mode::Explore) && self.lost.is_lost()
    }
}
