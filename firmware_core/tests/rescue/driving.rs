//! Goals of the robot, and obstacles that it avoids.

use core::time::Duration;

use protocols::pcui::message::Mode;

use crate::bench::{Bench, SECOND, boxed, flat};

/// A tour through both rooms and the door, and back.
const TOUR: [[i16; 2]; 7] = [
    [1000, 1550],
    [1900, 1550],
    [2600, 1500],
    [1900, 1550],
    [1000, 1550],
    [1000, 2500],
    [1000, 1000],
];

/// The report drives to the nearest waypoint; the program, like the published one, to the first of
/// its list, though the second is nearer.
#[test]
fn r083_waypoints_are_visited_in_their_order() {
    let mut bench = Bench::new(flat(), 1);
    let [far, near] = [[2600, 1500], [1000, 1550]];
    assert!(bench.distance_to(near) < bench.distance_to(far));
    bench.run_for(SECOND);
    bench.send_waypoints(&[far, near]);
    bench.run_for(SECOND);
    let target = bench.robot.target().map(|target| target.position_mm);
    assert_eq!(target, Some(far));
}

/// The corner of the other room lies directly behind the wall; the path to it leads back through
/// the door. A robot that only steers towards its goal, or around the nearest obstacle, stays here.
#[test]
fn a_goal_behind_a_wall_is_reached_through_the_door() {
    let mut bench = Bench::new(flat(), 12);
    bench.run_for(2 * SECOND);
    bench.send_waypoints(&[[1900, 500], [1000, 500], [2100, 2450]]);
    let arrived = bench.run_until(90 * SECOND, |bench| bench.robot.target().is_none());
    assert!(
        arrived,
        "{:?} {}",
        bench.body,
        bench.robot.waypoints().reached()
    );
    assert!(bench.distance_to([2100, 2450]) < 200.0 && bench.clearance_mm > 10.0);
}

/// A dead end of 900 mm depth and 700 mm width, open towards the robot, with the goal behind it.
#[test]
fn a_dead_end_is_left_again() {
    let mut walls = boxed(100.0, 100.0, 2900.0, 2900.0).to_vec();
    walls.extend([
        [600.0, 1300.0, 600.0, 2200.0],
        [600.0, 2200.0, 1300.0, 2200.0],
        [1300.0, 2200.0, 1300.0, 1300.0],
    ]);
    let mut bench = Bench::new(walls, 13);
    bench.send_waypoints(&[[1000, 1900], [950, 2550]]);
    let arrived = bench.run_until(90 * SECOND, |bench| bench.robot.target().is_none());
    assert!(
        arrived,
        "{:?} {}",
        bench.body,
        bench.robot.waypoints().reached()
    );
    assert!(bench.clearance_mm > 10.0, "{}", bench.clearance_mm);
}

/// A person puts a box 350 mm in front of the driving robot.
#[test]
fn the_robot_stops_for_what_suddenly_stands_in_front_of_it() {
    let mut bench = Bench::new(flat(), 4);
    bench.send_waypoints(&[[1000, 2500]]);
    let drives = bench.run_until(10 * SECOND, |bench| bench.body[1] > 1400.0);
    assert!(drives && bench.speed() > 15.0);
    let front = bench.body[1] + 350.0 + 160.0;
    bench
        .walls
        .extend(boxed(500.0, front, 1550.0, front + 100.0));
    bench.run_for(5 * SECOND);
    assert!(bench.clearance_mm > 10.0, "{}", bench.clearance_mm);
}

/// Two minutes of exploration: through the door into the other room, without a contact.
#[test]
fn exploration_finds_both_rooms_and_touches_nothing() {
    let mut bench = Bench::new(flat(), 5);
    bench.order(Mode::Exploration, [0, 0]);
    let crossed = bench.run_until(120 * SECOND, |bench| bench.body[0] > 2000.0);
    assert!(crossed, "{:?}", bench.body);
    bench.run_for(60 * SECOND);
    assert!(bench.clearance_mm > 10.0, "{}", bench.clearance_mm);
    let (apart_mm, _) = bench.pose_error();
    assert!(apart_mm < 40.0, "{apart_mm}");
}

/// Field defect XV-11: so close to a wall that no beam returns, the robot drove straight ahead.
#[test]
fn a_robot_that_sees_nothing_stands() {
    let mut bench = Bench::new(boxed(900.0, 900.0, 1100.0, 1100.0).to_vec(), 6);
    bench.order(Mode::Exploration, [0, 0]);
    bench.run_for(5 * SECOND);
    assert!(bench.counter("scans") > 20);
    assert_eq!(bench.body[..2], [1000.0, 1000.0]);
}

/// A stop order must not wait for a running search.
#[test]
fn a_stop_reaches_the_base_within_milliseconds() {
    let mut bench = Bench::searching(flat(), 7);
    bench.send_waypoints(&TOUR);
    let drives = bench.run_until(10 * SECOND, |bench| bench.set_point == [20, 20]);
    assert!(drives);
    bench.order(Mode::Stop, [0, 0]);
    let stopped = bench.run_until(Duration::from_millis(3), |bench| bench.set_point == [0, 0]);
    assert!(stopped);
    bench.run_for(2 * SECOND);
    assert_eq!(
        (bench.set_point, bench.robot.ordered_mode()),
        ([0, 0], Mode::Stop)
    );
}

/// Field defects PU-20 and PU-21: orders for manual driving were ignored, and their end as well.
#[test]
fn driving_by_hand_ends_a_second_after_the_last_order() {
    let mut bench = Bench::new(flat(), 8);
    bench.run_for(SECOND);
    bench.order(Mode::Manual, [-10, 10]);
    bench.run_for(Duration::from_millis(900));
    assert_eq!(
        (bench.set_point, bench.robot.mode()),
        ([-10, 10], Mode::Manual)
    );
    bench.order(Mode::Manual, [100, -100]);
    bench.run_for(Duration::from_millis(990));
    assert_eq!(bench.set_point, [35, -35], "the base's largest set-points");
    bench.run_for(Duration::from_millis(20));
    assert_eq!(bench.robot.mode(), Mode::Exploration);
    assert_eq!(bench.counter("manual fallbacks"), 1);
    assert!(
        bench
            .writes
            .iter()
            .any(|(at, wheels)| *wheels == [0, 0] && *at + SECOND > bench.now)
    );
}

/// Between two modes the robot rests until a scan gives the new mode its direction.
#[test]
fn a_change_of_mode_stops_the_robot_first() {
    let mut bench = Bench::new(flat(), 14);
    bench.run_for(SECOND);
    bench.order(Mode::Manual, [10, 10]);
    bench.run_for(Duration::from_millis(300));
    assert_eq!(bench.set_point, [10, 10]);
    bench.order(Mode::Exploration, [0, 0]);
    let stops = bench.run_until(Duration::from_millis(3), |bench| bench.set_point == [0, 0]);
    assert!(stops);
}
