//! Keys of a scenario's devices reach the devices.

use core::time::Duration;

use emulators::avr_base::AvrBase;
use emulators::hc06::Hc06;
use firmware_core::Inspect;
use firmware_core::robots::rescue::Rescue;
use hilrig::robots::{self, Dut, PcEnd};

use super::{in_a_room, start};

/// A blind lidar sends packets without distances: the program receives turns and finds no pose.
#[test]
fn a_fault_from_the_start_is_seen_by_the_program() {
    let mut run = start(in_a_room(
        "9s",
        "[device.lidar.xv11]\nfaults = [\"dark\"]\n",
    ));
    run.rig.run_for(Duration::from_secs(8));
    let mut counters = std::collections::BTreeMap::new();
    let program = run.rig.program_as::<Rescue>().expect("in this process");
    program.counters(&mut |name, value| {
        counters.insert(name, value);
    });
    assert!(counters["lidar packets"] > 2_000, "{counters:?}");
    let map = program.map().expect("it has one");
    assert!(
        map.cells().iter().all(|cell| *cell == 127),
        "nothing may be drawn"
    );
}

/// A sensor that turns in the opposite direction mirrors the map. The robot faces a wall 1.5 m
/// ahead, with another 0.9 m behind it. Angle 0 points to the right in both cases, so ahead and
/// behind are swapped.
#[test]
fn a_sensor_that_turns_the_other_way_mirrors_the_map() {
    assert!(wall_ahead("").abs_diff(270) <= 1);
    let mirrored = wall_ahead("[device.lidar.xv11]\ndirection = \"clockwise\"\n");
    assert!(mirrored.abs_diff(120 + 90) <= 1, "{mirrored}");
}

/// Row of the map in which the robot, in row 120, has drawn the wall ahead.
fn wall_ahead(keys: &str) -> usize {
    let mut run = start(in_a_room("9s", keys));
    run.rig.run_for(Duration::from_secs(8));
    let program = run.rig.program_as::<Rescue>().expect("in this process");
    let map = program.map().expect("it has one");
    let darkness = |y: &usize| -> u32 {
        (140..160)
            .map(|x| u32::from(map.get(x, *y).expect("inside the map")))
            .sum()
    };
    (130..300).max_by_key(darkness).expect("there are rows")
}

/// Rows of up to 320 bytes do not fit through a FIFO of 64 bytes, which fills faster than the radio
/// empties it.
#[test]
fn figures_of_base_and_radio_are_taken_over() {
    let keys = "[device.base.avr-base]\nprofile = \"rcj2015-2015\"\nphase = \"10ms\"\n";
    let bytes_lost = |more: &str| {
        let mut run = start(in_a_room("9s", &format!("{keys}{more}")));
        run.rig.run_for(Duration::from_secs(6));
        let base = run.rig.device::<AvrBase>("base").expect("emulated");
        assert_eq!(base.profile().name(), "rcj2015-2015");
        run.rig.device::<Hc06>("radio").expect("emulated").up().lost
    };
    assert_eq!(bytes_lost(""), 0);
    assert!(bytes_lost("[device.radio.hc06]\nfifo_bytes = 64\n") > 0);
}

#[test]
fn figures_that_cannot_be_are_refused() {
    let refused = |keys: &str| {
        let (scenario, source) = in_a_room("9s", keys);
        let error = crate::Run::new(scenario, &source, None)
            .err()
            .expect("refused");
        error.to_string()
    };
    let error = refused("[device.lidar.xv11]\nbeam_offset_mm = 101\n");
    assert!(
        error.contains("beam_offset_mm: is 101, expected 0 to 100"),
        "{error}"
    );
    let error = refused("[device.lidar.xv11]\nfaults = [\"dusty\"]\n");
    assert!(
        error.contains("is \"dusty\", did you mean \"dust\"? Expected one of off, dust"),
        "{error}"
    );
}

/// A client gets the rate of the configured radio instead of the robot's usual rate.
#[test]
fn a_radio_of_another_rate_is_offered_at_it() {
    for (radio, baud) in [("", 460_800), ("[device.radio.hc06]\nbaud = 9600\n", 9_600)] {
        let (scenario, source) = in_a_room("9s", radio);
        let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::Scripted);
        let ends = wired.expect("sound").open_ends;
        let radio = ends
            .iter()
            .find(|end| end.name == "radio")
            .expect("offered");
        assert_eq!(radio.line.baud, baud);
    }
}

/// A module as shipped, at 9600. The program configures it before the PC connects, by four commands
/// of more than a second each, and breaks no rule of the module.
#[test]
fn a_radio_as_shipped_is_set_up_by_the_program() {
    let keys = "[program]\nradio_baud = 9600\n[device.radio.hc06]\nbaud = 9600\n\
                [mission]\nconnect = \"8s\"\n";
    let mut run = start(in_a_room("9s", keys));
    run.rig.run_for(Duration::from_secs(7));
    let radio = run.rig.device::<Hc06>("radio").expect("it has one");
    let settings = radio.settings();
    assert_eq!(
        (settings.line.baud, &*settings.name),
        (460_800, &b"rescue"[..])
    );
    let broken = run.rig.events().iter().filter(|event| event.is_violation());
    assert_eq!(broken.count(), 0, "{:?}", run.rig.events());
}
