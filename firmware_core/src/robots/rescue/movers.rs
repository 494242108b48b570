//! Objects that move near the robot, such as persons: the newest scan has points where beams of the
//! scan before passed.

use crate::navigation::HALT;
use crate::pose::{Point, Pose, PoseChange};
use crate::scan::{BEAMS, Scan};

/// Maximum distance of a mover from the lidar, mm: a robot that stops for a person at 0.3 m/s rests
/// before the person has covered the distance between them.
const NEAR_MM: f32 = 450.0;
/// A beam has passed a place if it ended this much farther, mm: several times the noise, and the
/// distance that a person at 0.3 m/s covers in a turn.
const PASSED_MM: f32 = 60.0;
/// Minimum number of such points: fewer lie at edges.
const POINTS_MIN: u32 = 4;
/// Set-points with a forward speed of at most this, ticks, count as a turn on the spot.
const TURNS: i16 = 2;

/// The scan before, and whether an object moves.
#[derive(Clone, Debug)]
pub(super) struct Movers {
    /// Distance by bearing from the lidar, one degree each, mm; 0: nothing measured.
    before_mm: [u16; BEAMS],
    is_ahead: bool,
    is_behind: bool,
}

impl Movers {
    pub(super) const fn new() -> Self {
        Self {
            before_mm: [0; BEAMS],
            is_ahead: false,
            is_behind: false,
        }
    }

    /// Takes a scan of the lidar at `lidar` on the robot; `motion` is that of the robot since the
    /// scan before, if it is known.
    pub(super) fn take(&mut self, scan: &Scan, lidar: Point, motion: Option<PoseChange>) {
        let mut counts = [0; 2];
        if let Some(motion) = motion {
            let since = Pose::default().then(motion);
            for point in scan.points() {
                if point.distance_mm(lidar) >= NEAR_MM {
                    continue;
                }
                let (beam, range_mm) = polar(since.to_world(*point), lidar);
                let around = [BEAMS - 1, 0, 1].map(|off| self.before_mm[(beam + off) % BEAMS]);
                if around
                    .iter()
                    .all(|mm| f32::from(*mm) > range_mm + PASSED_MM)
                {
                    counts[usize::from(point.x_mm < 0.0)] += 1;
                }
            }
        }
        [self.is_ahead, self.is_behind] = counts.map(|count: u32| count >= POINTS_MIN);
        self.before_mm = [0; BEAMS];
        for point in scan.points() {
            let (beam, range_mm) = polar(*point, lidar);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a cast saturates"
            )]
            let mm = (range_mm as u16).max(1);
            let slot = &mut self.before_mm[beam];
            *slot = if *slot == 0 { mm } else { mm.min(*slot) };
        }
    }

    /// The set-points `wanted`, or rest if an object moves where the robot would drive.
    pub(super) fn guarded(&self, wanted: [i8; 2]) -> [i8; 2] {
        let ahead = i16::from(wanted[0]) + i16::from(wanted[1]);
        match self.is_ahead && ahead > TURNS || self.is_behind && ahead < -TURNS {
            true => HALT,
            false => wanted,
        }
    }
}

/// Bearing of `point` from `origin`, whole degrees from 0 to 359, and its distance.
pub(super) fn polar(point: Point, origin: Point) -> (usize, f32) {
    let (x, y) = (point.x_mm - origin.x_mm, point.y_mm - origin.y_mm);
    let degrees = libm::atan2f(y, x).to_degrees() + 360.5;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "180 to 541 degrees"
    )]
    let bearing = degrees as usize % BEAMS;
    (bearing, libm::hypotf(x, y))
}

#[cfg(test)]
mod tests {
    extern crate std;

    use protocols::Instant;
    use std::vec::Vec;

    use super::*;
    use crate::pose::sin_cos;

    /// Scan of a robot with this heading before a wall at y = 600 mm. An object stands at 90
    /// degrees: its distance in mm, and its width in degrees.
    fn scan(heading: f32, thing: Option<(f32, f32)>) -> Scan {
        let points: Vec<Point> = (0_u8..180)
            .filter_map(|degree| {
                let bearing = f32::from(degree).to_radians();
                let sin = libm::sinf(bearing);
                let wall_mm = 600.0 / sin;
                let range_mm = match thing {
                    Some((near_mm, wide)) if (f32::from(degree) - 90.0).abs() < wide / 2.0 => {
                        near_mm
                    }
                    _ => wall_mm,
                };
                let (sin, cos) = sin_cos(bearing - heading);
                (range_mm < 3_000.0).then(|| Point::new(range_mm * cos, range_mm * sin))
            })
            .collect();
        Scan::from_points(&points, Instant::ZERO, Instant::ZERO)
    }

    const LIDAR: Point = Point::new(0.0, 0.0);
    const LEFT: f32 = core::f32::consts::FRAC_PI_2;

    /// A person of five degrees stands 400 mm ahead, where the wall was seen at 600 mm: the robot
    /// may turn and drive back, but not ahead. In the next scan the person stands still. A person
    /// of three degrees is an edge, one at 460 mm is too far.
    #[test]
    fn the_robot_rests_before_what_moves() {
        for (thing, moves) in [
            ((400.0, 5.0), true),
            ((400.0, 3.0), false),
            ((460.0, 9.0), false),
        ] {
            let mut movers = Movers::new();
            movers.take(&scan(LEFT, None), LIDAR, None);
            assert_eq!(movers.guarded([20, 20]), [20, 20]);
            movers.take(&scan(LEFT, Some(thing)), LIDAR, Some(PoseChange::NONE));
            let ahead = if moves { HALT } else { [20, 10] };
            assert_eq!(movers.guarded([20, 10]), ahead, "{thing:?}");
            assert_eq!(movers.guarded([-20, -20]), [-20, -20]);
            assert_eq!(movers.guarded([-9, 10]), [-9, 10]);
            movers.take(&scan(LEFT, Some(thing)), LIDAR, Some(PoseChange::NONE));
            assert_eq!(movers.guarded([20, 20]), [20, 20]);
        }
    }

    /// Behind the robot it is the other way round. If the motion is unknown, nothing is detected.
    #[test]
    fn what_moves_behind_the_robot_stops_it_when_it_drives_back() {
        let thing = Some((400.0, 9.0));
        let mut movers = Movers::new();
        movers.take(&scan(-LEFT, None), LIDAR, None);
        movers.take(&scan(-LEFT, thing), LIDAR, Some(PoseChange::NONE));
        assert_eq!(movers.guarded([-20, -20]), HALT);
        assert_eq!(movers.guarded([20, 20]), [20, 20]);
        let mut movers = Movers::new();
        movers.take(&scan(-LEFT, None), LIDAR, None);
        movers.take(&scan(-LEFT, thing), LIDAR, None);
        assert_eq!(movers.guarded([-20, -20]), [-20, -20]);
    }

    /// The robot turns by 30 degrees; in the second case the wheels count only 10 of them. The
    /// wall, and a post before it, stay where they are in the first case only.
    #[test]
    fn the_robots_own_motion_is_no_motion_of_others() {
        let post = Some((300.0, 20.0));
        let turned = LEFT + 30_f32.to_radians();
        for (counted_deg, moves) in [(30.0_f32, false), (10.0, true)] {
            let mut movers = Movers::new();
            movers.take(&scan(LEFT, post), LIDAR, None);
            let motion = PoseChange {
                turn: counted_deg.to_radians(),
                ..PoseChange::NONE
            };
            movers.take(&scan(turned, post), LIDAR, Some(motion));
            assert_eq!(movers.guarded([20, 20]) == HALT, moves, "{counted_deg}");
        }
        // 100 mm ahead: the wall comes nearer by as much.
        let ahead = |wall_mm: f32| {
            let points: Vec<Point> = (-30_i8..30)
                .map(|degree| {
                    Point::new(
                        wall_mm,
                        wall_mm * libm::tanf(f32::from(degree).to_radians()),
                    )
                })
                .collect();
            Scan::from_points(&points, Instant::ZERO, Instant::ZERO)
        };
        for (counted_mm, moves) in [(100.0, false), (20.0, true)] {
            let mut movers = Movers::new();
            movers.take(&ahead(450.0), LIDAR, None);
            let motion = PoseChange {
                forward_mm: counted_mm,
                ..PoseChange::NONE
            };
            movers.take(&ahead(350.0), LIDAR, Some(motion));
            assert_eq!(movers.guarded([20, 20]) == HALT, moves, "{counted_mm}");
        }
    }

    /// Up to 89 degrees a wall at 300 mm, from 90 on one at 600 mm; then four points at 400 mm from
    /// 90 on. The first one lies beside the near wall, and three are too few.
    #[test]
    fn a_point_beside_a_near_one_is_an_edge() {
        for (count, moves) in [(4, false), (5, true)] {
            let scan = |near: core::ops::Range<u16>| {
                let points: Vec<Point> = (60_u16..120)
                    .map(|degree| {
                        let range_mm = match degree {
                            _ if near.contains(&degree) => 400.0,
                            0..90 => 300.0,
                            _ => 600.0,
                        };
                        let (sin, cos) = sin_cos(f32::from(degree).to_radians() - LEFT);
                        Point::new(range_mm * cos, range_mm * sin)
                    })
                    .collect();
                Scan::from_points(&points, Instant::ZERO, Instant::ZERO)
            };
            let mut movers = Movers::new();
            movers.take(&scan(0..0), LIDAR, None);
            movers.take(&scan(90..90 + count), LIDAR, Some(PoseChange::NONE));
            assert_eq!(movers.guarded([20, 20]) == HALT, moves, "{count}");
        }
    }

    /// A forward speed of up to two ticks is a turn.
    #[test]
    fn a_turn_is_no_drive() {
        let mut movers = Movers::new();
        movers.is_ahead = true;
        for (wanted, rests) in [([1, 1], false), ([2, 1], true), ([-9, -9], false)] {
            assert_eq!(movers.guarded(wanted) == HALT, rests, "{wanted:?}");
        }
        let mut movers = Movers::new();
        movers.is_behind = true;
        for (wanted, rests) in [([-1, -1], false), ([-2, -1], true), ([1, 0], false)] {
            assert_eq!(movers.guarded(wanted) == HALT, rests, "{wanted:?}");
        }
    }

    /// From (50, -50), the place (150, 50) lies at 45 degrees.
    #[test]
    fn a_bearing_is_that_from_the_lidar() {
        let (bearing, range_mm) = polar(Point::new(150.0, 50.0), Point::new(50.0, -50.0));
        assert_eq!(bearing, 45);
        assert!((range_mm - 141.42).abs() < 0.01);
        assert_eq!(polar(Point::new(9.0, -0.01), LIDAR).0, 0);
        assert_eq!(polar(Point::new(0.0, -9.0), LIDAR).0, 270);
    }
}
