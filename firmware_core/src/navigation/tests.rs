extern crate std;

use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::pose::WirePose;

const BODY: Body = Body {
    radius_mm: 160.0,
    clearance_mm: 45.0,
    tick_mm_s: 11.345,
    axle_mm: 260.0,
};

/// Wheel speeds by the seed report's law. The robot is at the origin with heading psi; the waypoint
/// is one metre away, in the direction of psi `target_deg`.
fn document(psi_deg: i16, target_deg: i16) -> [i8; 2] {
    let aim = |psi_deg| {
        Pose::from_wire(WirePose {
            x_mm: 0,
            y_mm: 0,
            psi_deg,
        })
        .heading
    };
    Steering::DOCUMENT.towards(aim(target_deg) - aim(psi_deg))
}

/// Seed report, chapter on navigation, and the fielded program's own answers, as speeds of the left
/// and the right wheel: ahead (20, 20), 90 degrees left (-10, 20), right (20, -10), behind (-20,
/// 20).
#[test]
fn steering_follows_the_seeds_table() {
    assert_eq!(document(90, 90), [20, 20]);
    assert_eq!(document(90, 0), [-10, 20]);
    assert_eq!(document(90, 180), [20, -10]);
    assert_eq!(document(90, 270), [-20, 20]);
}

/// Field defects NV-01 (psi -170, target 170: 340 degrees right instead of 20 left) and NV-02
/// (psi 810 is 90: two turns to the left until it was unwound).
#[test]
fn the_shorter_way_round_is_taken() {
    assert_eq!(document(-170, 170), [13, 20]);
    assert_eq!(document(170, -170), [20, 13]);
    assert_eq!(document(810, 95), [20, 18]);
    assert_eq!(document(-270, 95), [20, 18]);
}

#[test]
fn calm_steering_turns_on_the_spot_when_it_must_turn_far() {
    let towards = |degrees: f32| Steering::CALM.towards(degrees.to_radians());
    assert_eq!(towards(90.0), [-9, 9]);
    assert_eq!(towards(-60.0), [9, -9]);
    assert_eq!(towards(15.0), [15, 20]);
    assert_eq!(towards(0.0), [20, 20]);
}

/// A wall of points across the path, from -600 to 600 mm, `ahead` of the robot, and enough points
/// behind it that the robot is not blind.
fn wall(ahead: f32) -> Surroundings {
    let across = (-60..=60_i8).map(|n| Point::new(ahead, f32::from(n) * 10.0));
    let behind = (-60..=60_i8).map(|n| Point::new(-1000.0, f32::from(n) * 10.0));
    Surroundings::of(across.chain(behind))
}

/// The body's radius and the clearance are 205 mm.
#[test]
fn the_free_way_ends_where_the_body_would_come_too_near() {
    let around = wall(600.0);
    assert!((around.free_mm(&BODY, 0.0) - 395.0).abs() < 0.5);
    assert!((around.free_mm(&BODY, core::f32::consts::PI) - 795.0).abs() < 0.5);
    assert!(around.free_mm(&BODY, core::f32::consts::FRAC_PI_2) > 5000.0);
}

#[test]
fn the_guard_slows_down_before_a_wall_and_stops_at_it() {
    let guarded = |ahead| wall(ahead).guarded(&BODY, [20, 20]);
    assert_eq!(guarded(600.0), [20, 20]);
    assert_eq!(guarded(370.0), [14, 14]);
    assert_eq!(guarded(260.0), [5, 5]);
    assert_eq!(guarded(230.0), [0, 0]);
    assert_eq!(wall(230.0).guarded(&BODY, [8, 20]), [-6, 6]);
    assert_eq!(wall(230.0).guarded(&BODY, [-20, -20]), [-20, -20]);
}

#[test]
fn a_robot_that_is_too_near_already_may_leave() {
    assert_eq!(wall(180.0).guarded(&BODY, [-9, 9]), [-9, 9]);
    let aside = Surroundings::of((-60..=60_i8).map(|n| Point::new(f32::from(n) * 10.0, 190.0)));
    assert_eq!(aside.guarded(&BODY, [20, 20]), [20, 20]);
    assert!(aside.free_mm(&BODY, 0.0) > 1000.0);
}

#[test]
fn a_blind_robot_stands() {
    let mut navigator = Navigator::new(Settings::new(BODY));
    let around = Surroundings::EMPTY;
    assert_eq!(navigator.explore(Pose::default(), &around), HALT);
    let goal = Goal {
        position: Point::new(1000.0, 0.0),
        is_last: true,
    };
    let map = std::boxed::Box::new(Grid::new(10.0));
    let step = navigator.approach(&map, Pose::default(), goal, &around);
    assert_eq!(step, Step::Drive(HALT));
}

/// Seed report: reg = (260 - distance) / 10 in tens of millimetres.
#[test]
fn the_beam_law_is_the_seeds() {
    let follow = |length| WallFollowing::DOCUMENT.follow_beam(length);
    assert_eq!(follow(260.0), [20, 20]);
    assert_eq!(follow(160.0), [20, 10]);
    assert_eq!(follow(360.0), [10, 20]);
    assert_eq!(follow(0.0), [20, -6]);
    assert_eq!(follow(2000.0), [0, 20]);
}

/// A wall abeam at its set distance requires no turn; a wall ahead requires a turn to the right.
#[test]
fn the_nearest_law_keeps_the_wall_abeam() {
    let follow = |bearing_deg: f32, range| {
        let bearing = WallFollowing::NEAREST.follow_nearest(bearing_deg.to_radians(), range);
        libm::roundf(bearing.to_degrees())
    };
    assert_eq!(follow(90.0, 270.0), 0.0);
    assert_eq!(follow(90.0, 290.0), 10.0);
    assert_eq!(follow(0.0, 270.0), -90.0);
    assert_eq!(follow(130.0, 270.0), 40.0);
}

proptest! {
    /// For any scan and any command, the guard never speeds a wheel up beyond the command.
    #[test]
    fn the_guard_never_asks_for_more(
        points in prop::collection::vec((-2e3_f32..2e3, -2e3_f32..2e3), 0..400),
        wanted in [-35_i8..=35, -35_i8..=35],
    ) {
        let points: Vec<_> = points.into_iter().map(|(x, y)| Point::new(x, y)).collect();
        let around = Surroundings::of(points.into_iter());
        let guarded = around.guarded(&BODY, wanted);
        let most = wanted[0].abs().max(wanted[1].abs());
        prop_assert!(guarded[0].abs() <= most && guarded[1].abs() <= most);
    }

    /// Within a second the robot never comes nearer than the body's radius to any obstacle point
    /// that was outside at the start.
    #[test]
    fn a_guarded_second_hits_nothing(
        points in prop::collection::vec((170.0_f32..2e3, -3.2_f32..3.2), 10..60),
        wanted in [-20_i8..=20, -20_i8..=20],
    ) {
        let points: Vec<_> = points.iter().map(|(range, bearing)| {
            let (sin, cos) = sin_cos(*bearing);
            Point::new(range * cos, range * sin)
        }).collect();
        let around = Surroundings::of(points.iter().copied());
        let set_point = around.guarded(&BODY, wanted);
        for tenth in 1..=9_u8 {
            let end = arc_end(&BODY, set_point, f32::from(tenth) / 10.0);
            let is_clear = points.iter().all(|point| point.distance_mm(end) > 160.0);
            prop_assert!(is_clear, "{set_point:?}");
        }
    }
}

/// Finding T5, NV-01 and NV-02: left = 20 + err / 3, right = 20 - err / 3, each within +-20; an
/// error of more than 180 degrees is brought back by one turn, but only with one of the two signs.
#[test]
fn the_fielded_law_brings_one_side_back() {
    let law = |psi, target| Steering::DOCUMENT.towards_psi(psi, target);
    assert_eq!(law(90.0, 90.0), [20, 20]);
    assert_eq!(law(90.0, 0.0), [-10, 20]);
    assert_eq!(law(0.0, 90.0), [20, -10]);
    assert_eq!(law(180.0, 0.0), [-20, 20]);
    // 181 becomes -179.
    assert_eq!(law(181.0, 0.0), [20, -20]);
    assert_eq!(law(-170.0, 170.0), [20, -20]);
    assert_eq!(law(170.0, -170.0), [20, 13]);
    // 720 becomes 360.
    assert_eq!(law(810.0, 90.0), [-20, 20]);
}

/// The free direction around a post 300 mm away at `degrees`, after the earlier choice of `side`. A
/// body of 205 mm passes the post at asin(205 / 300) = 43.1 degrees to either side of it.
fn around_a_post(degrees: f32, side: f32) -> f32 {
    let (sin, cos) = sin_cos(degrees.to_radians());
    let around = Surroundings::of(core::iter::once(Point::new(300.0 * cos, 300.0 * sin)));
    let mut navigator = Navigator::new(Settings::new(BODY));
    navigator.side = side;
    let way = navigator.free_way(&BODY, &around, 0.0, 1000.0);
    assert_eq!(navigator.side, way.signum());
    libm::roundf(way.to_degrees())
}

/// Finding T5: at 10 degrees the post is passed at -33.1 or 53.1, in steps of five: -35 or 55. A
/// robot that passed on the left before stays on the left: the right is only 20 better, and a
/// change needs 40.
#[test]
fn a_side_once_taken_is_kept_unless_the_other_is_much_better() {
    assert_eq!(
        [0.0, -1.0, 1.0].map(|side| around_a_post(10.0, side)),
        [-35.0, -35.0, 55.0]
    );
    assert_eq!(
        [0.0, 1.0, -1.0].map(|side| around_a_post(-10.0, side)),
        [35.0, 35.0, -55.0]
    );
    // At 17 degrees the post is passed at -26.1 or 60.1, so -30 + 40 competes with 65; at 25
    // degrees it is passed at -18.1 or 68.1, so -20 + 40 competes with 70.
    assert_eq!([17.0, 25.0].map(|at| around_a_post(at, 1.0)), [65.0, -20.0]);
}

/// Only a free straight path resets the chosen side; a path shorter than 450 mm needs only its own
/// length.
#[test]
fn the_straight_way_is_taken_if_it_is_long_enough() {
    let around = wall(600.0);
    let mut navigator = Navigator::new(Settings::new(BODY));
    navigator.side = 1.0;
    // 395 mm are free ahead.
    assert_eq!(navigator.free_way(&BODY, &around, 0.0, 390.0), 0.0);
    assert_eq!(navigator.side, 0.0);
    assert_ne!(navigator.free_way(&BODY, &around, 0.0, 1000.0), 0.0);
    assert_ne!(navigator.side, 0.0);
}

/// Finding T5: after 15 scans without 10 mm of progress, a goal within 160 mm counts as reached; a
/// farther one never does.
#[test]
fn a_goal_that_comes_no_nearer_is_reached_after_three_seconds() {
    let map = std::boxed::Box::new(Grid::new(10.0));
    let around = wall(2000.0);
    let scans = |distance: f32, step: f32| {
        let mut navigator = Navigator::new(Settings::new(BODY));
        let goal = Goal {
            position: Point::new(distance, 0.0),
            is_last: true,
        };
        let poses = (0..40_u8).map(|scan| Pose::new(f32::from(scan) * step, 0.0, 0.0));
        let mut steps = poses.map(|pose| navigator.approach(&map, pose, goal, &around));
        steps.position(|step| step == Step::Arrived)
    };
    assert_eq!((scans(160.0, 0.0), scans(161.0, 0.0)), (Some(15), None));
    assert_eq!((scans(80.0, 0.0), scans(81.0, 0.0)), (Some(0), Some(15)));
    // At 1 mm a scan the goal comes 10 mm nearer every 11 scans, so the robot never counts as
    // stalled. From 150 mm away it drives on until 80 mm are left, which takes longer than 40
    // scans.
    assert_eq!(scans(150.0, 1.0), None);
}

/// A map with only a box of walls, 0.6 m wide, around this cell.
fn walled_in([x, y]: [usize; 2]) -> std::boxed::Box<Grid> {
    let mut map = std::boxed::Box::new(Grid::new(10.0));
    for n in 0..=60 {
        for side in [0, 1, 59, 60] {
            map.set(x - 30 + n, y - 30 + side, 255);
            map.set(x - 30 + side, y - 30 + n, 255);
        }
    }
    map
}

/// Plans are made each second: after four of them without a path there is none. Another goal may
/// have a path, and an obstacle that has left blocks none.
#[test]
fn a_goal_without_a_way_is_told_after_four_plans() {
    let (pose, goal) = (Pose::new(500.0, 500.0, 0.0), Point::new(2000.0, 500.0));
    let closed = walled_in([200, 50]);
    let open = std::boxed::Box::new(Grid::new(10.0));
    let around = wall(800.0);
    let mut navigator = Navigator::new(Settings::new(BODY));
    let mut told = |map: &Grid, position: Point| {
        let goal = Goal {
            position,
            is_last: false,
        };
        navigator.approach(map, pose, goal, &around);
        navigator.has_no_way()
    };
    let first = (1..40).find(|_| told(&closed, goal));
    assert_eq!(first, Some(3 * 5 + 1));
    assert!(!told(&closed, Point::new(2000.0, 2000.0)), "another goal");
    assert!((1..12).all(|_| !told(&closed, goal)));
    assert!((1..6).all(|_| !told(&open, goal)), "a way opens");
    assert!((1..12).all(|_| !told(&closed, goal)));
}

/// Two doors. At each check an obstacle stands in the door of the current path. After both were
/// found blocked twice, there is no path.
#[test]
fn ways_that_are_blocked_in_turn_are_none() {
    let mut map = std::boxed::Box::new(Grid::new(10.0));
    for y in (0..100).chain(161..230).chain(291..300) {
        (150..153).for_each(|x| map.set(x, y, 255));
    }
    let (pose, goal) = (Pose::new(1000.0, 1650.0, 0.0), Point::new(2000.0, 1650.0));
    // Points 10 mm apart, seen from the robot: on the wall between the doors, and across one.
    let along = |from: i8, to: i8| (from..=to).map(|n| Point::new(510.0, f32::from(n) * 10.0));
    let between = || along(-4, 64);
    let in_door = [
        Surroundings::of(between().chain(along(-65, -5))),
        Surroundings::of(between().chain(along(65, 125))),
    ];
    let mut navigator = Navigator::new(Settings::new(BODY));
    let mut rounds = Vec::new();
    for second in 0..30 {
        let is_low = navigator
            .planner
            .way_from(pose.position())
            .is_none_or(|aim| aim.y_mm < pose.y_mm);
        for _ in 0..PLAN_SCANS {
            let goal = Goal {
                position: goal,
                is_last: false,
            };
            navigator.approach(&map, pose, goal, &in_door[usize::from(!is_low)]);
        }
        rounds.push(navigator.rounds);
        if navigator.has_no_way() {
            assert!((4..=8).contains(&second), "{rounds:?}");
            return;
        }
    }
    panic!("it goes to and fro: {rounds:?}");
}

/// A post straight ahead is passed on the left. It needs 43.1 degrees, and the robot turns in steps
/// of five.
#[test]
fn of_two_sides_alike_the_left_is_taken() {
    assert_eq!(around_a_post(0.0, 0.0), 45.0);
}

/// Points each degree, 380 mm away except two niches of 40 degrees about 40 to the left and to the
/// right, where they are 400 mm away. No direction has 200 mm free, and of the 195 mm in both
/// niches the left ones come first.
#[test]
fn where_nothing_is_free_far_enough_the_freest_way_is_taken() {
    let point = |degree: i16| {
        let is_niche = (20..=60).contains(&degree.abs());
        let range = if is_niche { 400.0 } else { 380.0 };
        let (sin, cos) = sin_cos(f32::from(degree.abs()).to_radians());
        Point::new(range * cos, range * sin * f32::from(degree.signum()))
    };
    let around = Surroundings::of((-179..=180).map(point));
    let mut navigator = Navigator::new(Settings::new(BODY));
    let way = navigator.free_way(&BODY, &around, 0.0, 1_000.0);
    assert!(
        (way.to_degrees() - 40.0).abs() < 0.1,
        "{}",
        way.to_degrees()
    );
    assert_eq!(navigator.side, 0.0);
}

/// A path past the end of a board into an alley across it; the alley's far wall is 397 mm away at
/// 67 degrees. 450 mm are free only where the robot came from, but it must get past the board.
/// Noise moves the board's end a hand's breadth to either side of the body's limit.
#[test]
fn a_short_way_on_is_better_than_a_long_one_back() {
    let (sin, cos) = sin_cos(67_f32.to_radians());
    let wall = (-100..=100_i16).map(|n| {
        let along = f32::from(n) * 10.0;
        Point::new(397.0 * cos - along * sin, 397.0 * sin + along * cos)
    });
    for past_mm in [-212.0, -209.0, -205.0, -200.0, -195.0] {
        let (sin, cos) = sin_cos((-23_f32).to_radians());
        let board = (0..50_u8).map(|n| {
            let along = f32::from(n) * 10.0;
            Point::new(153.0 + along * cos, past_mm + along * sin)
        });
        let around = Surroundings::of(wall.clone().chain(board));
        let way = Navigator::new(Settings::new(BODY)).free_way(&BODY, &around, 0.0, 465.0);
        let degrees = way.to_degrees();
        assert!((0.0..=30.0).contains(&degrees), "{degrees} at {past_mm}");
    }
}

/// A goal that is 10 mm nearer is no progress, one that is more than 10 mm nearer is.
#[test]
fn progress_is_more_than_ten_millimetres() {
    let mut navigator = Navigator::new(Settings::new(BODY));
    let stalled = [200.0, 190.0, 189.0, 180.0, 179.0, 178.9].map(|distance| {
        navigator.watch_progress(Point::new(9.0, 9.0), distance);
        navigator.stalled
    });
    assert_eq!(stalled, [0, 1, 0, 1, 2, 0]);
    navigator.watch_progress(Point::new(9.0, 8.0), 300.0);
    assert_eq!((navigator.stalled, navigator.nearest_mm), (0, 300.0));
}

/// Straight walls from end to end, millimetres.
type Walls = [[[f32; 2]; 2]];

/// The map of `walls`, each a cell thick.
fn drawn(walls: &Walls) -> std::boxed::Box<Grid> {
    let mut map = std::boxed::Box::new(Grid::new(10.0));
    for [x, y] in walls.iter().flat_map(|wall| places(*wall, 5.0)) {
        #[expect(clippy::cast_possible_truncation, reason = "below 3 m")]
        let [x, y] = [x, y].map(|mm| (mm / 10.0) as usize);
        map.set(x, y, 255);
    }
    map
}

/// Points of a wall at this spacing.
fn places([[x0, y0], [x1, y1]]: [[f32; 2]; 2], apart: f32) -> impl Iterator<Item = [f32; 2]> {
    let (dx, dy) = (x1 - x0, y1 - y0);
    #[expect(clippy::cast_possible_truncation, reason = "below 3 m")]
    let steps = libm::ceilf(libm::sqrtf(dx * dx + dy * dy) / apart) as u16;
    (0..=steps).map(move |step| {
        let part = f32::from(step) / f32::from(steps);
        [x0 + part * dx, y0 + part * dy]
    })
}

/// `walls` as seen from `pose` by a lidar with errors up to 5 mm.
fn seen_by_lidar(walls: &Walls, pose: Pose, random: &mut crate::random::Pcg32) -> Surroundings {
    let (sin, cos) = sin_cos(pose.heading);
    let points = walls.iter().flat_map(|wall| places(*wall, 18.0));
    Surroundings::of(points.map(|[x, y]| {
        let (dx, dy) = (x - pose.x_mm, y - pose.y_mm);
        let range = libm::sqrtf(dx * dx + dy * dy);
        let off = 1.0 + (random.below(11) as f32 - 5.0) / range;
        Point::new((cos * dx + sin * dy) * off, (cos * dy - sin * dx) * off)
    }))
}

/// Number of scans until a robot that drives from `pose` for a goal beyond y = 2.7 m has passed y =
/// 2.3 m, and its smallest distance to a wall. `None` after two minutes.
fn scans_to_leave(walls: &Walls, mut pose: Pose, seed: u64) -> Option<(u16, f32)> {
    let map = drawn(walls);
    let goal = Goal {
        position: Point::new(1_000.0, 2_700.0),
        is_last: true,
    };
    let mut random = crate::random::Pcg32::new(seed);
    let mut navigator = Navigator::new(Settings::new(BODY));
    let mut nearest = f32::INFINITY;
    for scan in 0..600 {
        let around = seen_by_lidar(walls, pose, &mut random);
        let Step::Drive(set_point) = navigator.approach(&map, pose, goal, &around) else {
            return None;
        };
        let at = pose.to_world(arc_end(&BODY, set_point, 0.2));
        let turn = f32::from(set_point[1] - set_point[0]) * BODY.tick_mm_s * 0.2 / BODY.axle_mm;
        pose = Pose::new(at.x_mm, at.y_mm, pose.heading + turn);
        let all = walls.iter().flat_map(|wall| places(*wall, 5.0));
        let ranges = all.map(|[x, y]| at.distance_mm(Point::new(x, y)));
        nearest = ranges.fold(nearest, f32::min);
        if pose.y_mm > 2_300.0 {
            return Some((scan, nearest));
        }
    }
    None
}

/// Guards against a robot that does not leave a narrow area again but drives to and fro before its
/// door. 15 mm of clearance are required on each side; the door leaves 17 mm, less the lidar's
/// error.
#[test]
fn a_robot_leaves_by_the_narrow_door_that_it_came_in_by() {
    let walls = [
        [[900.0, 900.0], [900.0, 2_100.0]],
        [[900.0, 900.0], [2_100.0, 900.0]],
        [[2_100.0, 900.0], [2_100.0, 2_600.0]],
        [[900.0, 2_100.0], [1_746.0, 2_100.0]],
    ];
    let leaves = |seed| scans_to_leave(&walls, Pose::new(1_300.0, 1_400.0, 1.0), seed);
    let all: Vec<_> = (0..8).map(leaves).collect();
    // The robot may touch a wall, but only slightly.
    let is_sound = |left: &Option<_>| left.is_some_and(|(_, nearest)| nearest > 155.0);
    assert!(all.iter().all(is_sound), "{all:?}");
}
