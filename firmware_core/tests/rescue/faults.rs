//! The robot's reaction to failing devices.

use core::time::Duration;

use firmware_core::Inspect;
use protocols::pcui::message::Mode;

use crate::bench::{Bench, SECOND, flat};

const AHEAD: [[i16; 2]; 2] = [[1000, 2400], [1000, 1000]];

/// A robot on the path to its first waypoint.
fn driving(seed: u64) -> Bench {
    let mut bench = Bench::new(flat(), seed);
    bench.send_waypoints(&AHEAD);
    let drives = bench.run_until(10 * SECOND, |bench| bench.set_point == [20, 20]);
    assert!(drives);
    bench
}

/// Field defect XV-08: with the lidar unplugged, the program waited forever. Only the base's
/// watchdog stopped the robot, a second later.
#[test]
fn a_robot_without_lidar_stops_and_says_so() {
    let mut bench = driving(1);
    bench.lidar_is_plugged = false;
    let stopped = bench.run_until(Duration::from_millis(400), |bench| {
        bench.set_point == [0, 0]
    });
    assert!(stopped);
    assert_eq!(
        (Inspect::mode(&bench.robot), bench.robot.mode()),
        ("lidar silent", Mode::Stop)
    );

    bench.run_for(5 * SECOND);
    assert!(
        bench
            .heard
            .states
            .last()
            .is_some_and(|state| state.mode == Mode::Stop)
    );
    bench.lidar_is_plugged = true;
    let arrived = bench.run_until(60 * SECOND, |bench| bench.robot.target().is_none());
    assert!(arrived, "{:?}", bench.body);
}

/// R6: an intermittent lidar. The robot started 0.04 to 0.3 s after each return of the lidar, and
/// hit obstacles when the lidar was absent again. Now it waits for the first turn and two more.
#[test]
fn a_robot_whose_lidar_has_come_back_waits_for_two_further_turns() {
    let mut bench = driving(1);
    bench.lidar_is_plugged = false;
    bench.run_for(2 * SECOND);
    bench.lidar_is_plugged = true;
    let before = bench.counter("lidar turns");
    assert!(bench.run_until(5 * SECOND, |bench| bench.set_point != [0, 0]));
    let turns = bench.counter("lidar turns") - before;
    assert!((3..=4).contains(&turns), "{turns}");
}

/// Field defect MA-07: the fielded program did not detect a silent base. The base receives nothing,
/// sends no reply and stops by its own watchdog; when it returns, the mission continues.
#[test]
fn a_silent_base_is_noticed_and_its_return_as_well() {
    let mut bench = driving(2);
    (bench.base_hears, bench.base_is_heard) = (false, false);
    bench.run_for(Duration::from_millis(300));
    assert_eq!(
        (Inspect::mode(&bench.robot), bench.robot.mode()),
        ("base silent", Mode::Stop)
    );
    assert_eq!(bench.robot.set_point(), [0, 0]);
    bench.run_for(5 * SECOND);
    assert!(bench.counter("base failures") > 2 && bench.counter("base silences") == 1);
    assert!(
        bench
            .heard
            .states
            .last()
            .is_some_and(|state| state.mode == Mode::Stop)
    );

    (bench.base_hears, bench.base_is_heard) = (true, true);
    let arrived = bench.run_until(60 * SECOND, |bench| bench.robot.target().is_none());
    assert!(arrived, "{:?}", bench.body);
}

/// Without replies, the robot rolls on until the base's watchdog stops it, 200 mm or more that no
/// encoder reading contains. The scans must show this motion, and the map must not move with the
/// robot.
#[test]
fn the_way_without_encoders_is_seen_by_the_lidar() {
    let mut bench = driving(11);
    bench.run_for(2 * SECOND);
    let [_, before, _] = bench.body;
    (bench.base_hears, bench.base_is_heard) = (false, false);
    bench.run_for(2 * SECOND);
    (bench.base_hears, bench.base_is_heard) = (true, true);
    bench.run_for(SECOND);
    assert!(bench.body[1] - before > 200.0);
    let (apart_mm, turned_deg) = bench.pose_error();
    assert!(
        apart_mm < 20.0 && turned_deg.abs() < 1.0,
        "{apart_mm} mm, {turned_deg} degrees"
    );
}

/// Only the replies are lost: the robot cannot know that the base receives its requests, so it
/// sends "stop".
#[test]
fn a_base_that_hears_but_is_not_heard_is_stopped() {
    let mut bench = driving(3);
    bench.base_is_heard = false;
    let stopped = bench.run_until(Duration::from_millis(300), |bench| {
        bench.set_point == [0, 0]
    });
    assert!(stopped);
    bench.run_for(5 * SECOND);
    assert!(
        bench
            .writes
            .iter()
            .rev()
            .take(5)
            .all(|(_, wheels)| *wheels == [0, 0])
    );
}

/// Seed figure S8: lost replies cause retries. With a third of them lost, the tour is still driven,
/// and the base never receives a wrong set-point.
#[test]
fn lost_answers_cost_retries_and_nothing_else() {
    let mut bench = Bench::new(flat(), 4);
    bench.base_loss = 0.33;
    bench.send_waypoints(&AHEAD);
    let arrived = bench.run_until(90 * SECOND, |bench| bench.robot.target().is_none());
    assert!(arrived, "{:?}", bench.body);
    assert!(bench.counter("base retries") > 50);
    let bound = 20;
    let in_range = |(_, wheels): &(_, [i8; 2])| wheels.iter().all(|wheel| wheel.abs() <= bound);
    assert!(bench.writes.iter().all(in_range));
    assert!(bench.clearance_mm > 10.0);
}

/// The base restarts: its counters begin at zero and its set-points are lost. The pose must not
/// jump, and the set-points must be restored automatically.
#[test]
fn a_restarted_base_goes_on_where_it_was() {
    let mut bench = driving(5);
    bench.run_for(2 * SECOND);
    bench.restart_base();
    bench.run_for(Duration::from_millis(300));
    assert_ne!(bench.set_point, [0, 0], "the set-points are refreshed");
    bench.run_for(SECOND);
    let (apart_mm, turned_deg) = bench.pose_error();
    assert!(
        apart_mm < 60.0 && turned_deg.abs() < 3.0,
        "{apart_mm} mm, {turned_deg} degrees"
    );
    assert!(bench.counter("encoder readings disbelieved") <= 3);
}

/// The base was absent and returns with counters that begin at zero. No reading of them may count
/// as motion or as a glitch.
#[test]
fn a_base_that_was_away_is_read_afresh() {
    let mut bench = driving(8);
    bench.run_for(2 * SECOND);
    bench.order(Mode::Stop, [0, 0]);
    bench.run_for(SECOND);
    (bench.base_hears, bench.base_is_heard) = (false, false);
    bench.run_for(SECOND);
    bench.restart_base();
    let answers = bench.counter("base answers");
    (bench.base_hears, bench.base_is_heard) = (true, true);
    let back = bench.run_until(SECOND, |bench| bench.counter("base answers") > answers + 2);
    let (apart_mm, _) = bench.pose_error();
    assert!(
        back && apart_mm < 40.0,
        "{apart_mm} mm, before a scan could mend it"
    );
    assert_eq!(bench.counter("encoder readings disbelieved"), 0);
}

/// The base follows its last set-point for as long as the program repeats it. If the program's main
/// loop hangs, its interrupts must not repeat it.
#[test]
fn a_hanging_main_loop_does_not_drive_on() {
    let mut bench = driving(9);
    bench.hangs = true;
    let stopped = bench.run_until(Duration::from_millis(850), |bench| {
        bench.set_point == [0, 0]
    });
    assert!(stopped, "before the base's own watchdog");
    assert_eq!(bench.counter("set-points expired"), 1);
}

/// A search of the whole map takes some two seconds, and the robot rolls on during the first of
/// them. This is longer than the odometry keeps readings. A campaign found this defect: a robot
/// that was lost once drove on a little after each search, and was lost again because of it.
#[test]
fn the_way_rolled_during_a_long_search_is_not_forgotten() {
    let mut bench = driving(9);
    bench.hangs = true;
    let before = bench.body;
    bench.run_for(2 * SECOND);
    let rolled = libm::hypot(bench.body[0] - before[0], bench.body[1] - before[1]);
    let (apart_mm, _) = bench.pose_error();
    assert!(rolled > 60.0, "{rolled} mm");
    assert!(apart_mm < 30.0, "{apart_mm} mm of {rolled} mm");
}

/// All three tries of a write are lost: the write is repeated at once, not at its next refresh.
#[test]
fn a_lost_write_is_made_again_at_once() {
    for phase in 0..8 {
        let mut bench = Bench::new(flat(), 10);
        bench.run_for(SECOND + Duration::from_millis(5) * phase);
        bench.base_hears = false;
        bench.order(Mode::Manual, [7, 7]);
        bench.run_for(Duration::from_micros(15_800));
        bench.base_hears = true;
        let told = bench.run_until(Duration::from_millis(30), |bench| bench.set_point == [7, 7]);
        assert!(told, "phase {phase}");
    }
}

/// The base's watchdog needs a write each second; the seed requires a refresh in time.
#[test]
fn set_points_are_refreshed_at_least_each_200_ms() {
    let mut bench = driving(6);
    bench.run_for(20 * SECOND);
    let gaps = bench.writes.windows(2).map(|pair| pair[1].0 - pair[0].0);
    let longest = gaps.max().expect("many writes");
    assert!(longest <= Duration::from_millis(200), "{longest:?}");
}

/// Field defect MA-09: before the base's first reply, the battery counted as empty.
#[test]
fn the_battery_is_unknown_until_the_base_has_told() {
    let mut bench = Bench::new(flat(), 7);
    assert_eq!(bench.robot.battery(), None);
    bench.run_for(SECOND);
    assert_eq!(
        bench.robot.battery().map(|battery| battery.millivolts),
        Some(12_000)
    );
}
