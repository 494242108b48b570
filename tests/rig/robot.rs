//! Places and seeds that stop the robot, or once did.

use core::time::Duration;

use protocols::Instant;

use super::{failures, in_a_room, run_to_end, shipped, start};

/// R4: at the block's corner the robot turned to and fro between two paths of the same length, for
/// 5,020 s with seed 14. These are the five seeds of 0 to 199 with this failure.
#[test]
fn a_robot_at_a_corner_finds_its_way_round() {
    for seed in [14, 25, 46, 128, 191] {
        let (mut scenario, source) = shipped("island");
        scenario.seed = seed;
        scenario.mission.waypoints_m = vec![[2.4, 2.4]];
        let outcome = run_to_end((scenario, source));
        assert_eq!(failures(&outcome), Vec::<String>::new(), "seed {seed}");
    }
}

/// Debris at a place of the floor holds the left wheel: the robot rests within two seconds, and
/// says why.
#[test]
fn debris_at_a_place_holds_a_wheel_and_the_robot_says_so() {
    let debris = "[mission]\nwaypoints_m = [[1.5, 2.2]]\n[program]\ndiagnosis = true\n\
        [[fault]]\nkind = \"device\"\ndevice = \"base\"\nfault = \"wheel-held\"\nfactor = 0\n\
        when = { near_m = [1.5, 1.7], within_m = 0.2 }\n";
    let mut run = start(in_a_room("20s", debris));
    run.go_on_until(Instant::from_secs(20));
    let events = run.rig.events();
    let began = events
        .iter()
        .find(|logged| logged.event.rule == "fault-begun");
    let told = events
        .iter()
        .find(|logged| logged.event.detail.contains("wheel stalled"));
    let (began, told) = (began.expect("it came near"), told.expect("it says so"));
    assert!(told.event.at - began.event.at < Duration::from_secs(2));
    assert!(!run.rig.world.is_moving());
}
