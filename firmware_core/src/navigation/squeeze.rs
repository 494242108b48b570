//! Drives closer to obstacles than usual, and slower: through a narrow door.
//!
//! A robot that stands still reduces its clearance (thin). A robot that drives to and fro before a
//! door never stands still, but the path to its goal becomes no shorter. It then goes wherever its
//! body fits (tight).

use super::{Body, Surroundings};

/// Limits of thin driving: scans without motion before it starts, longer than any turn; duration in
/// scans; clearance; and cruise speed.
const THIN_AFTER: u8 = 22;
const THIN_SCANS: u8 = 40;
const THIN_CLEARANCE_MM: f32 = 15.0;
const THIN_CRUISE: i8 = 8;
/// Limits of tight driving: plans in a row without a shorter path (half a minute) before it starts;
/// duration in scans; clearance; and cruise speed near obstacles. A tight robot goes wherever its
/// body fits. Its speed is low so that a touch does no damage.
const TIGHT_AFTER_PLANS: u8 = 30;
const TIGHT_SCANS: u8 = 200;
const TIGHT_CLEARANCE_MM: f32 = 5.0;
const TIGHT_CRUISE: i8 = 4;
/// Free path that is enough then: requiring more leads away from a narrow door.
const TIGHT_WAY_MM: f32 = 120.0;
/// Minimum number of cells by which a path is shorter.
const SHORTER_CELLS: u16 = 3;

/// `body` with less clearance.
pub(super) const fn thin(body: &Body) -> Body {
    closer(body, THIN_CLEARANCE_MM)
}

const fn closer(body: &Body, clearance_mm: f32) -> Body {
    Body {
        clearance_mm: body.clearance_mm.min(clearance_mm),
        ..*body
    }
}

/// State of thin and tight driving.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Squeeze {
    /// Remaining scans of thin driving.
    thin: u8,
    /// Remaining scans of tight driving.
    tight: u8,
    /// Length of the shortest path to the goal so far, in cells, and plans since.
    shortest: u16,
    late_plans: u8,
}

impl Squeeze {
    pub(super) const NONE: Self = Self {
        thin: 0,
        tight: 0,
        shortest: u16::MAX,
        late_plans: 0,
    };

    /// The body for this scan instead of `body`, and the maximum speed, ticks per 40 ms. The robot
    /// has not moved for `still_scans`.
    pub(super) fn step(
        &mut self,
        body: &Body,
        still_scans: u8,
        around: &Surroundings,
    ) -> (Body, i8) {
        self.thin = self.thin.saturating_sub(1);
        self.tight = self.tight.saturating_sub(1);
        if still_scans >= THIN_AFTER {
            self.thin = THIN_SCANS;
        }
        if self.tight > 0 {
            let is_near = around.nearest_mm() < body.keep_mm();
            let cruise = if is_near { TIGHT_CRUISE } else { THIN_CRUISE };
            (closer(body, TIGHT_CLEARANCE_MM), cruise)
        } else if self.thin > 0 {
            (thin(body), THIN_CRUISE)
        } else {
            (*body, i8::MAX)
        }
    }

    /// Whether the robot goes wherever it fits.
    pub(super) const fn is_tight(&self) -> bool {
        self.tight > 0
    }

    /// Free path that is enough for any direction, millimetres.
    pub(super) const fn way_max_mm(&self) -> f32 {
        if self.is_tight() {
            TIGHT_WAY_MM
        } else {
            f32::INFINITY
        }
    }

    /// Resets the path length for a new goal.
    pub(super) const fn forget_way(&mut self) {
        *self = Self {
            thin: self.thin,
            ..Self::NONE
        };
    }

    /// Takes the length of the newest plan's path in cells. A goal that never had a path does not
    /// start tight driving.
    pub(super) fn watch_way(&mut self, cells: Option<u16>) {
        let cells = cells.unwrap_or(u16::MAX);
        if cells.saturating_add(SHORTER_CELLS) <= self.shortest {
            (self.shortest, self.late_plans) = (cells, 0);
            return;
        }
        self.late_plans += 1;
        if self.late_plans >= TIGHT_AFTER_PLANS {
            (self.late_plans, self.tight) = (0, TIGHT_SCANS);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::pose::Point;

    use super::*;

    const BODY: Body = Body {
        radius_mm: 160.0,
        clearance_mm: 45.0,
        tick_mm_s: 11.345,
        axle_mm: 260.0,
    };

    /// An obstacle 204 or 206 mm ahead: the body keeps 205.
    fn ahead(mm: f32) -> Surroundings {
        Surroundings::of([Point::new(mm, 0.0)].into_iter())
    }

    /// After 22 scans at rest the robot drives with a clearance of 15 mm and at 8 ticks, until 40
    /// scans after the last of them.
    #[test]
    fn a_robot_at_rest_makes_itself_thin_for_a_while() {
        let mut squeeze = Squeeze::NONE;
        let mut step = |still| squeeze.step(&BODY, still, &ahead(206.0));
        assert_eq!(step(21), (BODY, i8::MAX));
        let thin = Body {
            clearance_mm: 15.0,
            ..BODY
        };
        assert!((0..40).all(|scan| step(if scan == 0 { 22 } else { 0 }) == (thin, 8)));
        assert_eq!(step(0), (BODY, i8::MAX));
        let slim = Body {
            clearance_mm: 3.0,
            ..BODY
        };
        assert_eq!(super::thin(&slim), slim);
    }

    /// The robot drives with a clearance of 5 mm for 199 scans after thirty plans, none of which
    /// was 3 cells shorter than the shortest path. Its speed is 4 ticks near an obstacle, else 8.
    #[test]
    fn a_way_that_becomes_no_shorter_is_driven_wherever_the_body_fits() {
        let mut squeeze = Squeeze::NONE;
        squeeze.watch_way(Some(50));
        let plans = [48, 51, 60].into_iter().cycle().take(29);
        plans.for_each(|cells| squeeze.watch_way(Some(cells)));
        assert!(!squeeze.is_tight() && squeeze.way_max_mm() == f32::INFINITY);
        squeeze.watch_way(None);
        assert!(squeeze.is_tight() && squeeze.way_max_mm() == 120.0);
        let tight = Body {
            clearance_mm: 5.0,
            ..BODY
        };
        assert_eq!(squeeze.step(&BODY, 22, &ahead(204.0)), (tight, 4));
        assert!((0..198).all(|_| squeeze.step(&BODY, 0, &ahead(206.0)) == (tight, 8)));
        assert_eq!(squeeze.step(&BODY, 0, &ahead(206.0)), (BODY, i8::MAX));
    }

    /// A path that is three cells shorter counts as progress, and another goal restarts the count.
    /// A robot that never had a path does not start tight driving.
    #[test]
    fn a_way_that_becomes_shorter_is_none() {
        let mut squeeze = Squeeze::NONE;
        (0..200).for_each(|_| squeeze.watch_way(None));
        assert!(!squeeze.is_tight());
        for cells in (0..=90_u16).rev().step_by(3) {
            (0..29).for_each(|_| squeeze.watch_way(Some(cells)));
        }
        assert!(!squeeze.is_tight());
        (0..30).for_each(|_| squeeze.watch_way(Some(90)));
        assert!(squeeze.is_tight());
        squeeze.forget_way();
        assert_eq!(squeeze, Squeeze::NONE);
    }
}
