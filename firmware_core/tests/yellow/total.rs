//! Any bytes on any port, at any time: no panic, and the robot still works afterwards.

use core::time::Duration;

use firmware_core::robots::yellow::{Config, Yellow};
use firmware_core::{Inspect, Master};
use proptest::prelude::*;
use protocols::{Instant, Port};

use crate::bench::{Bench, SECOND, square};

proptest! {
    #![proptest_config(ProptestConfig::default())]

    #[test]
    fn any_bytes_are_borne(
        steps in prop::collection::vec(
            (0_u8..5, 0_u64..300_000, prop::collection::vec(any::<u8>(), 1..60)),
            0..60,
        ),
        fielded in any::<bool>(),
    ) {
        let config = if fielded { Config::DEFAULT.fielded() } else { Config::DEFAULT };
        let mut robot = Yellow::new(config);
        let mut now = Instant::ZERO;
        for (port, pause, bytes) in steps {
            now += Duration::from_micros(pause);
            robot.receive(Port(port), now, &bytes);
            robot.poll(now);
            let mut buf = [0; 100];
            for port in 0..5 {
                robot.transmit(Port(port), &mut buf);
            }
        }
        prop_assert!(robot.pose().x_mm.is_finite());
    }
}

/// Every defect has a unique number, which selects it, and changes the robot.
#[test]
fn every_defect_is_known_by_its_number() {
    let ids: Vec<_> = Config::defects().collect();
    let mut sorted = ids.clone();
    sorted.dedup();
    assert_eq!((ids.len(), sorted.len()), (25, 25));
    for id in ids {
        let config = Config::DEFAULT.with_defect(id).expect("a known one");
        assert_ne!(config, Config::DEFAULT, "{id}");
    }
    assert_eq!(Config::DEFAULT.with_defect("YX-01"), None);
}

/// With all defects, the robot still runs, sends telemetry, and drives.
#[test]
fn the_fielded_robot_drives() {
    let mut bench = Bench::with_config(square(4.0), Config::DEFAULT.fielded());
    bench.go(0.5, 0.0, 0.0);
    bench.run_for(10 * SECOND);
    assert!((bench.body[0] - 0.5).abs() < 0.05, "{:?}", bench.body);
    assert!(bench.heard.len() > 40);
}

/// Additional polls, early and late, do not change the robot.
#[test]
fn more_polls_change_nothing() {
    let run = |often: bool| {
        let mut bench = Bench::new(square(2.0));
        bench.go(0.3, 0.2, 1.0);
        for _ in 0..3_000 {
            bench.step();
            if often {
                bench.robot.poll(bench.now);
                bench.robot.poll(bench.now);
            }
        }
        (
            bench.body,
            bench.robot.pose(),
            Inspect::scan(&bench.robot).to_vec(),
        )
    };
    assert_eq!(run(false), run(true));
}

/// Odometry begins at the start pose; before the first sample, there is no pose.
#[test]
fn odometry_begins_where_it_is_told() {
    let mut config = Config::DEFAULT;
    config.start = firmware_core::pose::Pose::new(1_200.0, -300.0, 1.5);
    assert_eq!(Yellow::new(config).estimate(), None);
    let mut bench = Bench::with_config(square(9.0), config);
    bench.run_for(SECOND);
    let (at, pose) = bench.robot.estimate().expect("a pose");
    assert_eq!((at, pose), (bench.now, config.start));
    assert!(Inspect::map(&bench.robot).is_none());
}
