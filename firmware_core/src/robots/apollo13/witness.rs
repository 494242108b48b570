//! Compares the motions that the odometer and the board report.
//!
//! An encoder with exchanged wires counts backwards, a stuck gyroscope reports an endless turn; the
//! lines of both look valid. The board's pulses and the commanded steering are coarse, but
//! independent. For travel the board is trusted: no standing wheel makes pulses. For turns neither
//! source is trusted, because a servo may be dead as well as a gyroscope; the camera must decide.

use core::ops::RangeInclusive;
use core::time::Duration;

use protocols::Instant;

use crate::ackermann::{CarPose, Motion, wrapped};

/// Travel by the board after which distances are compared, metres: six pulses. Then the travel that
/// ends a comparison: long enough to detect an encoder that loses an eighth of its counts.
const WAY_M: [f64; 2] = [0.15, 0.60];
/// Travel by the board after which turns are compared, metres.
const TURN_M: f64 = 0.30;
/// Maximum difference of distances that agree: two pulses and the time of a frame.
const WAY_OFF_M: f64 = 0.08;
/// Maximum difference of turns that agree over [`TURN_M`]: 8 degrees of steering, and the delay of
/// the servo.
const TURN_OFF_RAD: f64 = 0.25;
/// A gyroscope may be dead if it reports at most the first figure while the steering should have
/// turned the car by the second.
const STILL_RAD: f64 = 0.01;
const TURNED_RAD: f64 = 0.10;
/// Period of the board's frames that are in time. Nominal are 67 ms; a later frame was delayed on
/// the line, and an earlier one follows a delayed one.
const IN_TIME: RangeInclusive<Duration> = Duration::from_millis(30)..=Duration::from_millis(150);

/// A contradiction, over the motion since the last one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finding {
    /// The car moved as the second motion shows, not as the first, which is the odometer's.
    Way(Motion, Motion),
    /// The car turned as one of them shows.
    Turn(Motion, Motion),
}

/// Poses of all sources at a frame of the board, each in its own frame of reference.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told {
    /// Time of the board's frame.
    pub now: Instant,
    /// Pose by encoder and gyroscope.
    pub odometer: CarPose,
    /// Pose by the board's pulses and the commanded steering.
    pub board: CarPose,
    /// Pose by the encoder and the commanded steering.
    pub steered: CarPose,
    /// Whether the last motor command was backwards.
    pub is_backwards: bool,
}

impl Told {
    /// Motions by the odometer, the board, and encoder with steering, from `self` to `to`.
    fn motions(&self, to: &Self) -> [Motion; 3] {
        [
            self.odometer.motion_to(to.odometer),
            self.board.motion_to(to.board),
            self.steered.motion_to(to.steered),
        ]
    }

    /// The motions from `self` to `to`, if the odometer's direction is opposite to the board's.
    fn other_way(&self, to: &Self) -> Option<Finding> {
        let [odometer, board, _] = self.motions(to);
        let is_other_way = odometer.ahead_m * board.ahead_m < 0.0;
        let is_off = (odometer.ahead_m - board.ahead_m).abs() > WAY_OFF_M;
        let is_found = length(&board) >= WAY_M[0] && is_other_way && is_off;
        let turn_rad = odometer.turn_rad;
        is_found.then_some(Finding::Way(odometer, Motion { turn_rad, ..board }))
    }
}

/// The comparison: start poses, for travel and for turns.
#[derive(Clone, Copy, Debug, Default)]
pub struct Witness {
    way: Told,
    turn: Told,
    heard: Instant,
    /// Poses at the order to drive in the other direction.
    turned: Option<Told>,
    /// Whether frames that are late may report motion in both directions.
    is_mixed: bool,
}

impl Witness {
    /// Restarts the comparison: earlier motion is settled, or cannot be compared.
    pub const fn begin(&mut self, told: Told) {
        (self.way, self.turn, self.heard) = (told, told, told.now);
    }

    /// Notes the order to drive in the other direction.
    pub const fn turn_round(&mut self, told: Told) {
        self.turned = Some(told);
    }

    /// Compares the motions up to the current frame. After a change of direction the car rolls on
    /// for a while, which only the odometer reports: that motion is left out. Delayed frames report
    /// motion that the odometer reported earlier, so nothing is compared until frames arrive in
    /// time again. If the car changed its direction meanwhile, their pulses have an unknown
    /// direction, and the comparison restarts. One fault is found even then: an encoder that has
    /// counted in the wrong direction since the car changed its own.
    pub fn compare(&mut self, told: Told) -> Option<Finding> {
        let passed = told.now - core::mem::replace(&mut self.heard, told.now);
        let is_late = passed > *IN_TIME.end();
        let turned = self.turned.take().filter(|_| is_late);
        self.is_mixed |= turned.is_some();
        if told.is_backwards != self.way.is_backwards {
            self.begin(told);
            return turned.and_then(|from| from.other_way(&told));
        }
        if !IN_TIME.contains(&passed) {
            return None;
        }
        if core::mem::take(&mut self.is_mixed) {
            self.begin(told);
            return None;
        }
        self.compare_ways(told).or_else(|| self.compare_turns(told))
    }

    fn compare_ways(&mut self, told: Told) -> Option<Finding> {
        let [odometer, board, _] = self.way.motions(&told);
        let [by_odometer_m, by_board_m] = [odometer, board].map(|motion| length(&motion));
        if by_board_m < WAY_M[0] {
            return None;
        }
        let is_short = by_odometer_m + WAY_OFF_M < by_board_m;
        let is_other_way = odometer.ahead_m * board.ahead_m < 0.0;
        let is_off = (odometer.ahead_m - board.ahead_m).abs() > WAY_OFF_M;
        let is_found = is_off && (is_short || is_other_way);
        if is_found || by_board_m >= WAY_M[1] {
            self.way = told;
        }
        is_found.then(|| {
            self.turn = told;
            let turn_rad = odometer.turn_rad;
            Finding::Way(odometer, Motion { turn_rad, ..board })
        })
    }

    fn compare_turns(&mut self, told: Told) -> Option<Finding> {
        let [odometer, board, steered] = self.turn.motions(&told);
        // A board with repeated resets counts less than the encoder, and never more.
        let other = match length(&steered) > length(&board) {
            true => steered,
            false => board,
        };
        if length(&other) < TURN_M {
            return None;
        }
        self.turn = told;
        let off = wrapped(odometer.turn_rad - other.turn_rad).abs();
        let is_dead = odometer.turn_rad.abs() < STILL_RAD && off > TURNED_RAD;
        (is_dead || off > TURN_OFF_RAD).then_some(Finding::Turn(odometer, other))
    }
}

fn length(motion: &Motion) -> f64 {
    libm::hypot(motion.ahead_m, motion.left_m)
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

    /// Poses at the frame after the beginning; the encoder agrees with the board.
    fn told(odometer: CarPose, board: CarPose) -> Told {
        Told {
            now: Instant::ZERO + Duration::from_millis(67),
            odometer,
            board,
            steered: board,
            is_backwards: false,
        }
    }

    /// The board reports 0.15 m ahead. An odometer that reports the same distance back is a
    /// finding, and so is one that reports 5 cm instead of 15. A board that misses pulses causes no
    /// finding.
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
            let finding = witness.compare(told(at(told_m, 0.1), at(0.16, 0.0)));
            let way = matches!(finding, Some(Finding::Way(told, other))
                if told.ahead_m == told_m && other.ahead_m == 0.16 && other.turn_rad == 0.1);
            assert_eq!(way, is_found, "{told_m}");
        }
    }

    /// A worn encoder counts 18 mm of each pulse's 25 mm: 0.07 m are missing after 10 pulses, 0.084
    /// m after 12. If it counts 23 mm, the difference stays within two pulses over any distance.
    #[test]
    fn an_encoder_that_is_worn_is_found() {
        for (counted_m, found_at) in [(0.018, Some(12)), (0.023, None)] {
            let mut witness = Witness::default();
            let found = (1..100).find(|pulse| {
                let way = |each_m: f64| at(each_m * f64::from(*pulse), 0.0);
                let told = Told {
                    now: Instant::ZERO + Duration::from_millis(67) * *pulse,
                    ..told(way(counted_m), way(0.025))
                };
                matches!(witness.compare(told), Some(Finding::Way(..)))
            });
            assert_eq!(found, found_at, "{counted_m}");
        }
    }

    /// The car changes its direction while the board's frames are lost for two seconds: it drove
    /// 0.4 m back, and an encoder that reports ahead is found. An encoder that reports back is
    /// trusted at any distance. Without lost frames both reports are trusted, because the car
    /// rolled on.
    #[test]
    fn an_encoder_that_counts_the_other_way_is_found_behind_a_gap() {
        for (told_m, gap_ms, is_found) in [
            (0.40, 2_000, true),
            (-0.40, 2_000, false),
            (-0.20, 2_000, false),
            (0.40, 67, false),
        ] {
            let mut witness = Witness::default();
            let turned = Told {
                is_backwards: true,
                ..Told::default()
            };
            witness.turn_round(turned);
            let back = Told {
                now: Instant::ZERO + Duration::from_millis(gap_ms),
                odometer: at(told_m, 0.0),
                board: at(-0.40, 0.0),
                ..turned
            };
            let finding = witness.compare(back);
            let way = matches!(finding, Some(Finding::Way(_, other)) if other.ahead_m == -0.40);
            assert_eq!(way, is_found, "{told_m} m, {gap_ms} ms");
        }
    }

    /// Over 0.31 m the odometer reports a turn that the steering did not make: 0.3 rad are a
    /// finding, 0.2 rad are not. A turn across a change of direction is no finding either.
    #[test]
    fn a_turn_that_the_steering_did_not_make_is_doubted() {
        for (turned, is_backwards, is_found) in
            [(0.2, false, false), (0.3, false, true), (0.3, true, false)]
        {
            let mut witness = Witness::default();
            let finding = witness.compare(Told {
                is_backwards,
                ..told(at(0.31, turned), at(0.31, 0.0))
            });
            assert_eq!(
                matches!(finding, Some(Finding::Turn(..))),
                is_found,
                "{turned}"
            );
        }
    }

    /// The car is steered by 0.15 rad over 0.31 m. A gyroscope that reports no turn is doubted, one
    /// that reports 0.05 rad is not, because the linkage may have that error. A board that is reset
    /// meanwhile changes nothing.
    #[test]
    fn a_gyroscope_that_stands_still_in_a_turn_is_doubted() {
        for (turned, board_m, is_found) in [
            (0.0, 0.31, true),
            (0.0, 0.05, true),
            (0.05, 0.31, false),
            (0.05, 0.05, false),
        ] {
            let mut witness = Witness::default();
            let finding = witness.compare(Told {
                steered: at(0.31, 0.15),
                ..told(at(0.31, turned), at(board_m, 0.15 * board_m / 0.31))
            });
            let other = |motion: Motion| motion.turn_rad == 0.15;
            let is = matches!(finding, Some(Finding::Turn(_, motion)) if other(motion));
            assert_eq!(is, is_found, "{turned} {board_m}");
        }
    }

    /// The board's line stops while the car drives 0.3 m back and ahead again, or only back; then
    /// its frames arrive at once. Their pulses count in the car's last direction.
    #[test]
    fn frames_held_up_over_a_change_of_direction_find_nothing() {
        for is_back_at_the_end in [true, false] {
            let at_ms = |ms: u64, odometer_m: f64, board_m: f64, is_backwards: bool| Told {
                now: Instant::ZERO + Duration::from_millis(ms),
                is_backwards,
                ..told(at(odometer_m, 0.0), at(board_m, 0.0))
            };
            let mut witness = Witness::default();
            assert_eq!(witness.compare(at_ms(67, 0.0, 0.0, false)), None);
            witness.turn_round(at_ms(100, 0.0, 0.0, true));
            let (end_m, way_m) = match is_back_at_the_end {
                true => (-0.3, -0.3),
                false => {
                    witness.turn_round(at_ms(900, -0.3, 0.0, false));
                    (0.0, 0.6)
                }
            };
            let told = |ms, off_m: f64, share: f64| {
                let odometer_m = end_m + off_m;
                let board_m = share * way_m + off_m;
                at_ms(ms, odometer_m, board_m, is_back_at_the_end)
            };
            for frame in 1..=10 {
                let ms = 1_500 + frame;
                let found = witness.compare(told(ms, 0.0, frame as f64 / 10.0));
                assert_eq!(found, None, "{frame}");
            }
            let way = if is_back_at_the_end { -1.0 } else { 1.0 };
            for frame in 1..=20 {
                let off_m = way * 0.02 * frame as f64;
                let found = witness.compare(told(1_510 + 67 * frame, off_m, 1.0));
                assert_eq!(found, None, "{frame}");
            }
        }
    }

    /// The board's line stops for a second; then its frames arrive at once, a millisecond apart,
    /// and report the 0.22 m that the odometer reported before. From then on both continue alike.
    #[test]
    fn frames_that_were_held_up_find_nothing() {
        let mut witness = Witness::default();
        let at_ms = |ms: u64, odometer_m: f64, board_m: f64| Told {
            now: Instant::ZERO + Duration::from_millis(ms),
            ..told(at(odometer_m, 0.0), at(board_m, 0.0))
        };
        assert_eq!(witness.compare(at_ms(67, 0.0, 0.0)), None);
        for frame in 1..=15 {
            let board_m = 0.0147 * frame as f64;
            assert_eq!(witness.compare(at_ms(1_067 + frame, 0.22, board_m)), None);
        }
        for frame in 1..=40 {
            let way = 0.0147 * frame as f64;
            let told = at_ms(1_082 + 67 * frame, 0.22 + way, 0.2205 + way);
            assert_eq!(witness.compare(told), None, "{frame}");
        }
        // Motion that the odometer misses while frames are delayed is found behind them.
        for (ms, board_m) in [(4_000, 1.1), (4_001, 1.2)] {
            assert_eq!(witness.compare(at_ms(ms, 0.808, board_m)), None);
        }
        let finding = witness.compare(at_ms(4_070, 0.808, 1.2));
        assert!(matches!(finding, Some(Finding::Way(..))));
    }

    /// Odometer and board report half a radian over 2 m. Equal signs agree; opposite signs are a
    /// finding.
    #[test]
    fn turns_are_compared_with_their_signs() {
        let found = |odometer_rad: f64, board_rad: f64| {
            let mut witness = Witness::default();
            witness.compare(told(at(2.0, odometer_rad), at(2.0, board_rad)))
        };
        assert!(found(0.5, 0.5).is_none() && found(-0.5, -0.5).is_none());
        for sign in [1.0, -1.0] {
            let finding = found(0.5 * sign, -0.5 * sign);
            let is_turn = matches!(finding, Some(Finding::Turn(told, other))
                if told.turn_rad == 0.5 * sign && other.turn_rad == -0.5 * sign);
            assert!(is_turn, "{finding:?}");
        }
    }

    /// Whether a turn is doubted after `way_m`, by odometer and steering.
    fn is_doubted(way_m: f64, odometer_rad: f64, steered_rad: f64) -> bool {
        let mut witness = Witness::default();
        let told = told(at(way_m, odometer_rad), at(way_m, steered_rad));
        matches!(witness.compare(told), Some(Finding::Turn(..)))
    }

    /// Values at a limit still agree: turns may differ by 0.25 rad; with up to 0.10 rad of steering
    /// the gyroscope may report no turn, with more it must report at least 0.01 rad. A path of 0.30
    /// m is long enough for a comparison.
    #[test]
    fn turns_agree_up_to_their_limits() {
        assert_eq!(
            [0.25, 0.26].map(|off| is_doubted(0.31, off, 0.0)),
            [false, true]
        );
        assert_eq!(
            [0.10, 0.11].map(|off| is_doubted(0.31, 0.0, off)),
            [false, true]
        );
        assert_eq!(
            [0.01, 0.009].map(|told| is_doubted(0.31, told, 0.2)),
            [false, true]
        );
        assert_eq!(
            [0.30, 0.299].map(|way_m| is_doubted(way_m, 0.3, 0.0)),
            [true, false]
        );
    }

    /// Frames 30 and 150 ms apart are in time, closer or farther ones are not.
    #[test]
    fn frames_are_in_time_from_30_to_150_ms() {
        let is_found = |ms: u64| {
            let mut witness = Witness::default();
            let told = Told {
                now: Instant::ZERO + Duration::from_millis(ms),
                ..told(at(-0.16, 0.0), at(0.16, 0.0))
            };
            witness.compare(told).is_some()
        };
        assert_eq!([29, 30, 150, 151].map(is_found), [false, true, true, false]);
    }

    /// While the car slides aside by 0.2 m, the board reports 4 cm ahead and the encoder 4 or 5 cm
    /// back. A difference of 8 cm, two pulses, is accepted; 9 cm mean an encoder that counts
    /// backwards. The same holds after a gap if the path is 0.15 m long; 0.14 m are too short.
    #[test]
    fn an_encoder_counts_the_other_way_by_more_than_two_pulses() {
        let aside = |ahead_m: f64, left_m: f64| CarPose {
            y_m: left_m,
            ..at(ahead_m, 0.0)
        };
        let is_found = |back_m: f64| {
            let mut witness = Witness::default();
            let told = told(aside(-back_m, 0.2), aside(0.04, 0.2));
            matches!(witness.compare(told), Some(Finding::Way(..)))
        };
        assert_eq!([0.04, 0.05].map(is_found), [false, true]);
        let behind_a_gap = |odometer: CarPose, board: CarPose| {
            let mut witness = Witness::default();
            let turned = Told {
                is_backwards: true,
                ..Told::default()
            };
            witness.turn_round(turned);
            let back = Told {
                now: Instant::ZERO + Duration::from_secs(2),
                odometer,
                board,
                ..turned
            };
            witness.compare(back).is_some()
        };
        assert!(!behind_a_gap(aside(0.04, 0.2), aside(-0.04, 0.2)));
        assert!(behind_a_gap(aside(0.05, 0.2), aside(-0.04, 0.2)));
        assert!(behind_a_gap(at(0.10, 0.0), at(-0.15, 0.0)));
        assert!(!behind_a_gap(at(0.10, 0.0), at(-0.14, 0.0)));
        // Directions do not contradict if one source stands.
        assert!(!behind_a_gap(at(0.0, 0.0), at(-0.40, 0.0)));
    }

    /// A comparison ends after 0.60 m: an error until then, here 7 cm, is not added to the next
    /// one.
    #[test]
    fn a_comparison_of_ways_ends_after_60_cm() {
        let second = |ends_m: f64| {
            let mut witness = Witness::default();
            let frame = |frame: u32, odometer_m, board_m| Told {
                now: Instant::ZERO + Duration::from_millis(67) * frame,
                ..told(at(odometer_m, 0.0), at(board_m, 0.0))
            };
            assert_eq!(witness.compare(frame(1, ends_m - 0.07, ends_m)), None);
            witness
                .compare(frame(2, ends_m + 0.11, ends_m + 0.2))
                .is_some()
        };
        assert_eq!([0.59, 0.60].map(second), [true, false]);
    }

    /// While the car slides aside, the board reports 4 cm ahead and 25 cm to the left. An encoder
    /// with 25 cm ahead reports the same distance in the same direction. One with 17 cm has missed
    /// more than two pulses.
    #[test]
    fn an_encoder_that_told_as_much_way_is_not_short() {
        let board = CarPose {
            y_m: 0.25,
            ..at(0.04, 0.0)
        };
        let is_found = |ahead_m: f64| {
            let finding = Witness::default().compare(told(at(ahead_m, 0.0), board));
            matches!(finding, Some(Finding::Way(..)))
        };
        assert_eq!([0.25, 0.18, 0.17].map(is_found), [false, false, true]);
    }

    /// An odometer that reports 25 cm to the left, and 0 ahead, has not counted in the other
    /// direction, and its distance is not shorter.
    #[test]
    fn aside_is_not_the_other_way() {
        let aside = CarPose {
            y_m: 0.25,
            ..at(0.0, 0.0)
        };
        let mut witness = Witness::default();
        let finding = witness.compare(told(aside, at(0.25, 0.0)));
        assert!(!matches!(finding, Some(Finding::Way(..))), "{finding:?}");
        let begun = Told::default();
        assert!(begun.other_way(&told(aside, at(0.25, 0.0))).is_none());
        assert!(
            begun
                .other_way(&told(at(-0.01, 0.0), at(0.25, 0.0)))
                .is_some()
        );
    }
}
