//! State of a lost robot: how far it may have moved unseen, and when to search the whole map, which
//! takes a second.

use super::relocate::Bound;
use super::settings::Pushes;
use crate::pose::Pose;

/// Number of doubtful scans before the whole map is searched; the search repeats whenever the
/// number has doubled.
const DOUBTS_MAX: u8 = 2;
/// Number of doubtful scans from which the search repeats at a fixed interval, and that interval.
const PATIENCE: u8 = 32;
/// Maximum number of scans for which an unseen motion is searched while half of the scan fits: in
/// that case the world has changed as well.
const SEARCHES_MAX: u8 = 8;
/// Margin of the search beyond the unseen motion, for the earlier error of the pose.
const MARGIN_MM: f32 = 150.0;
const MARGIN_RAD: f32 = 0.2;
/// Maximum drift of the wheels, in millimetres and radians, until a scan fits nowhere near: some
/// wheels turn by half a radian too much in one step.
const DRIFT: (f32, f32) = (3000.0, 0.7);

/// State of a lost robot; see the module's documentation.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lost {
    unseen_mm: f32,
    unseen_rad: f32,
    searches: u8,
    doubts: u8,
    is_ambiguous: bool,
}

impl Lost {
    /// A robot that is not lost.
    pub(super) const NONE: Self = Self {
        unseen_mm: 0.0,
        unseen_rad: 0.0,
        searches: 0,
        doubts: 0,
        is_ambiguous: false,
    };

    /// Adds an unseen motion, with at most `most` in total.
    pub(super) const fn lose(&mut self, [mm, rad]: [f32; 2], most: [f32; 2]) {
        self.unseen_mm = (self.unseen_mm + mm).min(most[0]);
        self.unseen_rad = (self.unseen_rad + rad).min(most[1]);
        self.searches = 0;
    }

    /// Maximum unseen turn of the robot; 0 if its motion was seen.
    pub(super) const fn unseen_rad(&self) -> f32 {
        self.unseen_rad
    }

    /// Search area for a robot that was lost at `pose`; `None`, the whole map, if the cause is
    /// unknown and a person may have carried the robot.
    pub(super) fn bound(&self, pose: Pose, pushes: Pushes) -> Option<Bound> {
        let (mm, rad) = if self.unseen_rad > 0.0 {
            (self.unseen_mm + MARGIN_MM, self.unseen_rad + MARGIN_RAD)
        } else if pushes == Pushes::Unlikely {
            DRIFT
        } else {
            return None;
        };
        Some(Bound {
            centre: pose,
            mm,
            rad,
        })
    }

    /// Notes that the scan fits at the believed pose.
    pub(super) const fn found(&mut self) {
        *self = Self::NONE;
    }

    /// Notes that half of the scan fits; returns whether an unseen motion is still searched.
    pub(super) fn half_found(&mut self) -> bool {
        self.doubts = 0;
        self.is_ambiguous = false;
        self.searches += 1;
        if self.searches > SEARCHES_MAX {
            self.found();
        }
        self.unseen_rad > 0.0
    }

    /// Notes that the scan fits nowhere near; returns whether the whole map should be searched now.
    pub(super) const fn doubted(&mut self) -> bool {
        self.doubts += 1;
        if self.doubts == 2 * PATIENCE {
            self.doubts = PATIENCE;
        }
        self.doubts >= DOUBTS_MAX && self.doubts.is_power_of_two()
    }

    /// Notes whether several poses fit.
    pub(super) const fn set_ambiguous(&mut self, is_ambiguous: bool) {
        self.is_ambiguous = is_ambiguous;
    }

    /// Whether the last search of the whole map found several fitting poses.
    pub(super) const fn is_ambiguous(&self) -> bool {
        self.is_ambiguous
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A search of the whole map takes a second: a standing robot gains nothing from five searches
    /// a second.
    #[test]
    fn the_whole_map_is_searched_ever_more_rarely() {
        let mut lost = Lost::NONE;
        let searched = (1..=130_u32).filter(|_| lost.doubted());
        let searched: [u32; 9] = {
            let mut all = [0; 9];
            all.iter_mut().zip(searched).for_each(|(to, at)| *to = at);
            all
        };
        assert_eq!(searched, [2, 4, 8, 16, 32, 64, 96, 128, 0]);
    }

    #[test]
    fn an_unseen_motion_is_looked_for_until_a_scan_fits_or_the_world_has_changed() {
        let mut lost = Lost::NONE;
        lost.lose([300.0, 2.0], [280.0, 1.0]);
        assert!(lost.unseen_rad() <= 1.0);
        assert_eq!((0..20).take_while(|_| lost.half_found()).count(), 8);
        lost.lose([10.0, 0.1], [280.0, 1.0]);
        lost.found();
        let bound = |pushes| lost.bound(Pose::default(), pushes);
        assert!(bound(Pushes::Followed).is_none() && bound(Pushes::Unlikely).is_some());
    }

    /// 100 mm and half a radian unseen, plus the earlier uncertainty, but no more than `most`. If
    /// pushes are unlikely, a robot that was measured all the time may have drifted; if a person
    /// can push it, it may be anywhere.
    #[test]
    fn a_lost_robot_is_sought_as_far_as_it_may_have_moved() {
        let pose = Pose::new(1.0, 2.0, 3.0);
        let bound = |lost: &Lost, pushes| {
            lost.bound(pose, pushes)
                .map(|it| (it.centre, it.mm, it.rad))
        };
        let mut lost = Lost::NONE;
        assert_eq!(bound(&lost, Pushes::Unlikely), Some((pose, 3_000.0, 0.7)));
        assert_eq!(bound(&lost, Pushes::Followed), None);
        lost.lose([100.0, 0.5], [280.0, 1.25]);
        assert_eq!(
            bound(&lost, Pushes::Followed),
            Some((pose, 250.0, 0.5 + MARGIN_RAD))
        );
        lost.lose([100.0, 0.5], [280.0, 1.25]);
        assert_eq!(
            bound(&lost, Pushes::Unlikely),
            Some((pose, 350.0, 1.0 + MARGIN_RAD))
        );
        lost.lose([100.0, 0.5], [280.0, 1.25]);
        assert_eq!(
            bound(&lost, Pushes::Followed),
            Some((pose, 430.0, 1.25 + MARGIN_RAD))
        );
        assert_eq!(lost.unseen_rad(), 1.25);
    }
}
