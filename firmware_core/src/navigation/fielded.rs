//! The fielded program's heading: degrees, clockwise, never normalised to one turn.

use super::{Defects, Steering};
use crate::pose::{Pose, normalised};

/// The heading psi with all turns that the robot has made.
#[derive(Clone, Debug)]
pub(super) struct Psi {
    last: Option<f32>,
    psi_deg: f32,
}

impl Psi {
    pub(super) const fn new() -> Self {
        Self {
            last: None,
            psi_deg: 0.0,
        }
    }

    /// Updates psi to the robot's new `pose`.
    pub(super) fn turned(&mut self, pose: Pose) {
        self.psi_deg = match self.last {
            Some(last) => self.psi_deg - normalised(pose.heading - last).to_degrees(),
            None => psi_deg(pose.heading),
        };
        self.last = Some(pose.heading);
    }

    /// Wheel speeds for `way`, a bearing seen from `pose`.
    pub(super) fn steer(
        &self,
        defects: &Defects,
        steering: &Steering,
        pose: Pose,
        way: f32,
    ) -> [i8; 2] {
        let target_deg = psi_deg(pose.heading + way);
        if defects.counts_turns {
            steering.towards_psi(self.psi_deg, target_deg)
        } else if defects.wraps_one_side {
            steering.towards_psi(psi_deg(pose.heading), target_deg)
        } else {
            steering.towards(way)
        }
    }
}

/// Clockwise degrees within half a turn of 0.
fn psi_deg(heading: f32) -> f32 {
    normalised(core::f32::consts::PI - heading).to_degrees()
}

#[cfg(test)]
mod tests {
    use core::f32::consts::{FRAC_PI_2, PI};

    use super::*;
    use crate::navigation::{Body, Settings};

    fn is(found: f32, expected: f32) -> bool {
        (found - expected).abs() < 1e-3
    }

    /// Psi is 90 where the map's heading is 90 degrees, and falls as that grows.
    #[test]
    fn psi_is_counted_clockwise() {
        assert!(is(psi_deg(FRAC_PI_2), 90.0) && is(psi_deg(PI), 0.0));
        assert!(is(psi_deg(-FRAC_PI_2), -90.0) && is(psi_deg(0.1).abs(), 174.270_4));
    }

    /// Four quarter turns to the left give the headings 90, 0, -90, -180 and -270; then half a turn
    /// back.
    #[test]
    fn all_turns_are_kept() {
        let mut psi = Psi::new();
        let told = [1.0, 2.0, 3.0, 4.0, 5.0, 3.0].map(|quarters: f32| {
            let heading = normalised(quarters * FRAC_PI_2 - 1e-4);
            psi.turned(Pose::new(0.0, 0.0, heading));
            psi.psi_deg
        });
        for (found, expected) in told[..5].iter().zip([90.0, 0.0, -90.0, -180.0, -270.0]) {
            assert!((found - expected).abs() < 0.02, "{told:?}");
        }
        assert!((told[5].abs() - 90.0).abs() < 0.02 || (told[5] + 450.0).abs() < 0.02);
    }

    /// NV-01 and NV-02: psi 0 is a quarter turn to the left for a robot that looks along y. A robot
    /// that has turned once around before counts 450 degrees and turns on by 90.
    #[test]
    fn the_fielded_steering_compares_headings() {
        let settings = Settings::new(Body {
            radius_mm: 160.0,
            clearance_mm: 45.0,
            tick_mm_s: 11.345,
            axle_mm: 260.0,
        });
        let steering = &settings.steering;
        let pose = Pose::new(0.0, 0.0, FRAC_PI_2);
        let psi = Psi {
            last: Some(FRAC_PI_2),
            psi_deg: 100.0,
        };
        let steer = |defects| psi.steer(&defects, steering, pose, FRAC_PI_2);
        let counts_turns = Defects {
            counts_turns: true,
            ..Defects::default()
        };
        let wraps_one_side = Defects {
            wraps_one_side: true,
            ..Defects::default()
        };
        assert_eq!(steer(counts_turns), steering.towards_psi(100.0, 0.0));
        assert_eq!(steer(wraps_one_side), steering.towards_psi(90.0, 0.0));
        assert_eq!(steer(Defects::default()), steering.towards(FRAC_PI_2));
        // 30 degrees to the right are psi 120.
        let right = |defects| psi.steer(&defects, steering, pose, -FRAC_PI_2 / 3.0);
        assert_eq!(right(counts_turns), steering.towards_psi(100.0, 120.0));
        assert_ne!(right(counts_turns), right(wraps_one_side));
    }
}
