//! YE5: the state machine.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::{State, Telecommand};

use crate::bench::{Bench, SECOND, square};

/// Duration of the robot's first stay in `mode`.
fn time_in(bench: &Bench, mode: &str) -> Duration {
    let at = bench.modes.iter().position(|(_, name)| *name == mode);
    let at = at.expect("the robot was in that mode");
    bench.modes[at + 1].0 - bench.modes[at].0
}

fn names(bench: &Bench) -> Vec<&'static str> {
    bench.modes.iter().map(|(_, name)| *name).collect()
}

/// The whole table: from OFF over SWITCH ON and ON to each activity, over ON to another one, and
/// over ON and SWITCH OFF back; the drivers take 0.5 s +-10 ms in each direction.
#[test]
fn ye5_the_whole_table() {
    for (id, step) in [(None, 1), (Some("YS-03"), 10)] {
        let mut bench = match id {
            None => Bench::new(square(10.0)),
            Some(id) => Bench::with_defect(square(10.0), id),
        };
        bench.run_for(SECOND / 10);
        bench.order(State::Manual);
        bench.run_for(SECOND);
        bench.order(State::AutoReactive);
        bench.run_for(SECOND / 10);
        bench.go(2.0, 0.0, 0.0);
        bench.run_for(SECOND / 10);
        bench.order(State::Manual);
        bench.run_for(SECOND / 10);
        bench.order(State::Off);
        bench.run_for(SECOND);
        let active = ["manual", "on", "reactive", "on", "position", "on", "manual"];
        let mut expected = vec!["off", "switch on", "on"];
        expected.extend(active);
        expected.extend(["on", "switch off", "off"]);
        assert_eq!(names(&bench), expected);
        for switching in ["switch on", "switch off"] {
            let took = time_in(&bench, switching).as_millis();
            assert!((490..=510).contains(&took), "{switching}: {took} ms");
        }
        // Duration of the intermediate state ON: 1 ms as in the seed, 10 ms as fielded.
        assert_eq!(time_in(&bench, "on").as_millis(), step, "{id:?}");
    }
}

/// D2: the machine steps each millisecond, the fielded one every 10 ms: this is the maximum delay
/// of an order. The drivers' 500 ms and the time for one intermediate step are equal for both.
#[test]
fn d2_an_order_waits_for_a_millisecond_and_in_the_fielded_way_for_ten() {
    let slowest = |id: Option<&str>| {
        let delays = (0..20).map(|offset| {
            let mut bench = match id {
                None => Bench::new(square(10.0)),
                Some(id) => Bench::with_defect(square(10.0), id),
            };
            bench.run_for(Duration::from_millis(100 + offset));
            let ordered_at = bench.now;
            bench.order(State::Manual);
            bench.run_for(SECOND / 10);
            let (at, mode) = bench.modes[bench.modes.len() - 1];
            assert_eq!(mode, "switch on");
            (at - ordered_at).as_millis()
        });
        delays.max().expect("twenty")
    };
    assert_eq!((slowest(None), slowest(Some("YS-03"))), (1, 10));
}

/// The telemetry shows switching as OFF: the PC knows neither drivers nor ON.
#[test]
fn switching_is_told_as_off() {
    let mut bench = Bench::new(square(10.0));
    bench.order(State::Manual);
    bench.run_for(SECOND);
    let told: Vec<_> = bench.heard.iter().map(|(_, told)| told.state).collect();
    assert!(told.starts_with(&[Some(State::Off), Some(State::Off)]));
    assert_eq!(told.last(), Some(&Some(State::Manual)));
}

/// OFF during switching on: the drivers are switched on completely first, as their hardware
/// requires.
#[test]
fn an_order_to_be_off_waits_for_the_drivers() {
    let mut bench = Bench::new(square(10.0));
    bench.order(State::Manual);
    bench.run_for(SECOND / 10);
    bench.order(State::Off);
    bench.run_for(2 * SECOND);
    assert_eq!(names(&bench), ["switch on", "on", "switch off", "off"]);
    assert!(!bench.outputs.enable);
}

#[test]
fn the_button_switches_on_and_off_when_it_goes_down() {
    let mut bench = Bench::new(square(10.0));
    bench.run_for(SECOND / 10);
    bench.button = true;
    bench.run_for(2 * SECOND);
    assert_eq!(bench.mode(), "reactive", "held down it counts once");
    bench.button = false;
    bench.run_for(SECOND / 10);
    assert_eq!(bench.mode(), "reactive");
    bench.button = true;
    bench.run_for(SECOND);
    assert_eq!(bench.mode(), "off");
}

/// AUTO POSITION is refused without a goal, and with a goal that is not a number.
#[test]
fn a_position_needs_a_pose() {
    let mut bench = Bench::new(square(10.0));
    bench.order(State::AutoPosition);
    bench.go(f32::NAN, 0.0, 0.0);
    bench.run_for(SECOND);
    assert_eq!(
        (bench.mode(), bench.counter("telecommands refused")),
        ("off", 2)
    );
    bench.go(0.5, 0.0, 0.0);
    bench.run_for(SECOND);
    assert_eq!(bench.mode(), "position");
}

/// Duration of manual driving without further orders.
fn manual_lasts(mut bench: Bench) -> (Duration, Bench) {
    bench.drive(0.3, 0.0);
    assert!(bench.run_until(SECOND, |bench| bench.mode() == "manual"));
    bench.drive(0.3, 0.0);
    let since = bench.now;
    bench.run_until(10 * SECOND, |bench| bench.mode() != "manual");
    (bench.now - since, bench)
}

/// Without the PC, manual driving ends after 2 s: the robot rests, its drivers stay on.
#[test]
fn ye5_driving_by_hand_ends_2_s_behind_the_last_word() {
    let (lasted, mut bench) = manual_lasts(Bench::new(square(100.0)));
    assert!((1_990..=2_010).contains(&lasted.as_millis()), "{lasted:?}");
    bench.run_for(SECOND);
    assert_eq!((bench.mode(), bench.counter("manual time-outs")), ("on", 1));
    assert!(bench.speed()[0].abs() < 0.01);
    // Any telecommand counts, also an empty one.
    let mut bench = Bench::new(square(100.0));
    bench.drive(0.3, 0.0);
    for _ in 0..10 {
        bench.run_for(SECOND);
        bench.send(&Telecommand::default());
    }
    assert_eq!(bench.mode(), "manual");
}

/// YS-01: the fielded robot drives on forever.
#[test]
fn ye5_the_fielded_robot_drives_on_without_anybody() {
    let (lasted, bench) = manual_lasts(Bench::with_defect(square(100.0), "YS-01"));
    assert_eq!(lasted, 10 * SECOND);
    assert!(bench.speed()[0] > 0.29);
}

/// Sends a new goal between the end of a manoeuvre and the following state change; returns the
/// robot's mode then.
fn goal_at_the_end(mut bench: Bench) -> &'static str {
    bench.go(0.3, 0.0, 0.0);
    let arrived = bench.run_until(10 * SECOND, |bench| bench.counter("arrivals") == 1);
    assert!(arrived && bench.mode() == "position");
    bench.go(0.6, 0.0, 0.0);
    bench.run_for(SECOND / 5);
    bench.mode()
}

/// YS-02: the fielded robot overwrites the new order with OFF.
#[test]
fn the_end_of_a_manoeuvre_erases_no_order() {
    assert_eq!(goal_at_the_end(Bench::new(square(10.0))), "position");
    let fielded = goal_at_the_end(Bench::with_defect(square(10.0), "YS-02"));
    assert_eq!(fielded, "switch off");
}

/// Without samples of the hardware, the machine runs by the clock and does no harm. After a board
/// restart, or 50 ms without supply, the robot has rolled by an unknown distance. A manoeuvre
/// depends on that distance, so it ends; an operator with manual control sees the robot's position.
#[test]
fn a_manoeuvre_ends_when_the_way_is_lost() {
    for is_unsupplied in [false, true] {
        let lose = |bench: &mut Bench| {
            bench.run_for(SECOND / 2);
            bench.is_unsupplied = is_unsupplied;
            if !is_unsupplied {
                bench.counter_offset = [20_000, 40_000];
            }
            bench.run_for(SECOND / 20);
            bench.is_unsupplied = false;
        };
        let mut bench = Bench::new(square(10.0));
        bench.go(2.0, 0.0, 0.0);
        assert!(bench.run_until(SECOND, |bench| bench.mode() == "position"));
        lose(&mut bench);
        bench.run_for(SECOND);
        assert_eq!((bench.mode(), bench.body[0] < 1.0), ("off", true));
        assert_eq!(bench.counter("manoeuvres interrupted"), 1);

        bench.drive(0.3, 0.0);
        bench.run_for(SECOND);
        lose(&mut bench);
        assert_eq!(bench.mode(), "manual");
        assert_eq!(bench.counter("manoeuvres interrupted"), 1);
    }
}

/// Encoders that stop for half a second while the robot drives at 0.5 m/s. The controller must not
/// compensate for the missing counts: that would be 1.9 m/s at 12 V and 0.9 m until they count
/// again. At 120 V ms, after 10 to 20 ms, it switches off; the motors coast for 60 ms.
#[test]
fn wheels_that_do_not_count_are_not_driven_on() {
    let mut bench = Bench::new(square(10.0));
    bench.go(3.0, 0.0, 0.0);
    assert!(bench.run_until(3 * SECOND, |bench| bench.body[0] > 0.5));
    bench
        .motors
        .iter_mut()
        .for_each(|motor| motor.is_uncounted = true);
    bench.run_for(SECOND / 2);
    bench
        .motors
        .iter_mut()
        .for_each(|motor| motor.is_uncounted = false);
    assert!(bench.body[0] < 0.6, "{:?}", bench.body);
    bench.run_for(SECOND);
    assert_eq!(bench.mode(), "off");
    assert!(bench.body[0] < 0.6 && bench.counter("manoeuvres interrupted") == 1);
}

#[test]
fn modes_need_no_samples() {
    use firmware_core::Master as _;
    let mut bench = Bench::new(square(10.0));
    bench.order(State::Manual);
    for millis in 1..700 {
        bench.robot.poll(Instant::from_millis(millis));
    }
    assert_eq!(bench.mode(), "manual");
}
