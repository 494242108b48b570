//! Lays beside each other what the odometer and the board tell of the same way.
//!
//! An encoder whose wires are exchanged counts backwards, a gyroscope that is stuck turns for ever;
//! both lines look sound. The board's pulses and the steering that was commanded are coarse, but
//! they come another way. Of the travel the board is believed: pulses come from no wheel that
//! stands. Of the turn nobody is: a servo may be dead as well as a gyroscope, and what the camera
//! sees must tell.

use crate::ackermann::{CarPose, Motion};

/// Travel by the board after which travels are compared, metres: six pulses.
const WAY_M: f64 = 0.15;
/// The same for turns.
const TURN_M: f64 = 0.30;
/// Travels that agree are no farther apart than this: two pulses and the time of a frame.
const WAY_OFF_M: f64 = 0.08;
/// Turns that agree over [`TURN_M`] are no farther apart than this: 8 degrees of steering, and
/// what the servo takes to get there.
const TURN_OFF_RAD: f64 = 0.25;

/// What is found, each over the way since the last finding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finding {
    /// The car went as the second motion says, not as the odometer, the first.
    Way(Motion, Motion),
    /// It turned as one of them says.
    Turn(Motion, Motion),
}

/// Where odometer and board were when a comparison began.
#[derive(Clone, Copy, Debug, Default)]
struct Since {
    odometer: CarPose,
    board: CarPose,
}

impl Since {
    fn motions(self, odometer: CarPose, board: CarPose) -> [Motion; 2] {
        [
            self.odometer.motion_to(odometer),
            self.board.motion_to(board),
        ]
    }
}

/// The comparison.
#[derive(Clone, Copy, Debug, Default)]
pub struct Witness {
    way: Since,
    turn: Since,
    is_backwards: bool,
}

impl Witness {
    /// Begins anew: what was told up to here is settled, or cannot be compared.
    pub const fn begin(&mut self, odometer: CarPose, board: CarPose) {
        self.way = Since { odometer, board };
        self.turn = self.way;
    }

    /// Where both say that the car is, each in its own frame. A car that changes its direction
    /// rolls on for a while, which only the odometer tells: nothing is compared then.
    pub fn compare(
        &mut self,
        odometer: CarPose,
        board: CarPose,
        is_backwards: bool,
    ) -> Option<Finding> {
        if is_backwards != self.is_backwards {
            self.is_backwards = is_backwards;
            self.begin(odometer, board);
            return None;
        }
        let [told, other] = self.way.motions(odometer, board);
        if other.ahead_m.abs() >= WAY_M {
            self.way = Since { odometer, board };
            let is_short = told.ahead_m.abs() + WAY_OFF_M < other.ahead_m.abs();
            let is_other_way = told.ahead_m * other.ahead_m < 0.0;
            let is_off = (told.ahead_m - other.ahead_m).abs() > WAY_OFF_M;
            if is_off && (is_short || is_other_way) {
                self.turn = self.way;
                let turn_rad = told.turn_rad;
                return Some(Finding::Way(told, Motion { turn_rad, ..other }));
            }
        }
        let [told, other] = self.turn.motions(odometer, board);
        if libm::hypot(other.ahead_m, other.left_m) >= TURN_M {
            self.turn = Since { odometer, board };
            let off = crate::ackermann::wrapped(told.turn_rad - other.turn_rad);
            if off.abs() > TURN_OFF_RAD {
                return Some(Finding::Turn(told, other));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f64, heading_rad: f64) -> CarPose {
        CarPose {
            x_m,
            heading_rad,
            ..CarPose::default()
        }
    }

    /// 0.15 m ahead by the board, as many back by the odometer; and 5 cm in place of 15. A board
    /// that misses pulses finds nothing.
    #[test]
    fn an_encoder_that_counts_backwards_or_too_little_is_found() {
        for (told_m, is_found) in [
            (0.15, false),
            (0.09, false),
            (0.05, true),
            (-0.15, true),
            (0.40, false),
        ] {
            let mut witness = Witness::default();
            let finding = witness.compare(at(told_m, 0.1), at(0.16, 0.0), false);
            let way = matches!(finding, Some(Finding::Way(told, other))
                if told.ahead_m == told_m && other.ahead_m == 0.16 && other.turn_rad == 0.1);
            assert_eq!(way, is_found, "{told_m}");
        }
    }

    /// 0.3 rad over 0.31 m are found, 0.2 rad are not; and not when the direction changed.
    #[test]
    fn a_turn_that_the_steering_did_not_make_is_doubted() {
        for (turned, is_backwards, is_found) in
            [(0.2, false, false), (0.3, false, true), (0.3, true, false)]
        {
            let mut witness = Witness::default();
            let finding = witness.compare(at(0.31, turned), at(0.31, 0.0), is_backwards);
            assert_eq!(
                matches!(finding, Some(Finding::Turn(..))),
                is_found,
                "{turned}"
            );
        }
    }
}
