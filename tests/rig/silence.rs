//! The slave is the last protection of the robot: these runs attack its line.

use core::time::Duration;

use emulators::avr_base::AvrBase;
use emulators::rng::Rng;
use hilrig::rig::fault::{DamageKind, FaultId, Window};
use proptest::prelude::*;
use protocols::Instant;

use super::{in_a_room, start};
use crate::Run;

const DRIVES: &str = "[program]\nstart_mode = \"exploration\"\n";

fn is_driving(run: &Run) -> bool {
    run.rig
        .device::<AvrBase>("base")
        .expect("emulated")
        .set_points()
        != [0, 0]
}

/// The master drives, then its line to the slave is cut. No software on the master's side can help
/// any more: the slave alone must bring the robot to rest, 1.0 s after the last frame it accepted.
#[test]
fn motors_stop_when_the_master_falls_silent() {
    let mut run = start(in_a_room("60s", DRIVES));
    run.rig.run_for(Duration::from_secs(10));
    assert!(is_driving(&run) && run.rig.world.is_moving());

    let cut = Window {
        from: run.rig.now(),
        until: Window::ALWAYS.until,
    };
    run.rig.link_mut("base").expect("the bus").lines[1]
        .faults
        .add_cut(FaultId(0), cut);
    run.rig.run_for(Duration::from_millis(750));
    assert!(
        is_driving(&run),
        "the last frame is at most 200 ms old: not yet"
    );
    run.rig.run_for(Duration::from_millis(300));
    assert!(!is_driving(&run));
    run.rig.run_for(Duration::from_secs(1));
    assert!(!run.rig.world.is_moving());
}

/// A person presses the button on the robot, at 6 s and for two seconds. The robot stops and stays.
/// The base drives again from 12 s on, after another press, but the robot still waits. The PC's
/// order at 14 s makes it continue. (Seed report, page 9.)
#[test]
fn the_stop_button_stops_the_robot_until_the_pc_lets_it_go_on() {
    let button = |from: &str, lasting: &str| {
        format!(
            "[[fault]]\nkind = \"device\"\nfault = \"stop-button\"\ndevice = \"base\"\n\
             from = \"{from}\"\nlasting = \"{lasting}\"\n"
        )
    };
    let pressed = button("6s", "2s") + &button("12s", "200ms");
    let mut run = start(in_a_room(
        "60s",
        &format!(
            "[mission]\nwaypoints_m = [[0.9, 1.5], [2.1, 1.5], [0.9, 1.5]]\n\
             [[mission.step]]\nat = \"14s\"\ndo = {{ mode = \"waypoint\" }}\n\
             [expect]\nvisit_within_mm = 200\nviolations_max = 0\n\
             [device.base.avr-base]\nannounce = true\n{pressed}"
        ),
    ));
    run.go_on_until(Instant::from_secs(6));
    assert!(run.rig.world.is_moving());
    run.go_on_until(Instant::from_secs(6) + Duration::from_millis(700));
    let place = run.rig.world.pose();
    run.go_on_until(Instant::from_secs(14));
    assert_eq!(run.rig.world.pose(), place);
    assert_eq!(super::failures(&run.finish()), Vec::<String>::new());
}

/// Proof of the checker by a mutant: a base whose firmware never stops (build of 2014, where the
/// register restored the set-point).
#[test]
fn the_checker_catches_the_base_that_never_stops() {
    let device = "[device.base.avr-base]\nprofile = \"rcj2015-2014\"\n";
    let mut run = start(in_a_room("20s", &format!("{DRIVES}{device}")));
    let cut = Window {
        from: Instant::from_secs(10),
        until: Window::ALWAYS.until,
    };
    run.rig.link_mut("base").expect("the bus").lines[1]
        .faults
        .add_cut(FaultId(0), cut);
    let failed = super::failures(&run.finish());
    assert!(
        failed
            .iter()
            .any(|f| f.starts_with("motors-stop-after-silence")),
        "{failed:?}"
    );
}

proptest! {
    #![proptest_config(crate::thorough::cases(48))]

    /// Noise may cost commands, never the line: two clean seconds later the robot drives again, and
    /// a base never drives on without a master.
    #[test]
    fn bit_flips_never_stop_a_driving_robot_for_good(seed: u32, one_in in 20_u32..400) {
        let mut run = start(in_a_room("16s", DRIVES));
        let noise = Window { from: Instant::from_secs(5), until: Instant::from_secs(12) };
        for (index, line) in run.rig.link_mut("base").expect("the bus").lines.iter_mut().enumerate() {
            let rng = Rng::stream(u64::from(seed), &index.to_string());
            let chance = 1.0 / f64::from(one_in);
            line.faults.add_rate(FaultId(0), DamageKind::Flip, noise, chance, rng);
        }
        while run.rig.now() < Instant::from_secs(14) {
            run.step();
        }
        prop_assert!(is_driving(&run));
        let failed = super::failures(&run.judge());
        prop_assert!(failed.is_empty(), "{failed:?}");
    }
}
