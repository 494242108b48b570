//! The robot's own display: its pictures, its reaction to touches, and no disturbance of the robot.
//!
//! The pictures are compared pixel for pixel with those of the folder `pictures`, which a person
//! has checked; with `UPDATE_PICTURES=1` in the environment they are written again.

use core::time::Duration;
use std::path::Path;

use emulators::touch_panel::TouchPanel;
use firmware_core::Inspect;
use firmware_core::robots::rescue::Rescue;
use hilrig::picture::Picture;
use hilrig::rig::line::Direction;
use hilrig::run::Run;
use hilrig::show::render;
use protocols::pcui::message::Mode;

use super::{in_a_room, run_to_end, shipped, start};

/// Positions of the buttons on the pictures.
const STOP: [u16; 2] = [280, 50];
const EXPLORE: [u16; 2] = [410, 50];
const MAPPING: [u16; 2] = [410, 90];
const SET_WAYPOINTS: [u16; 2] = [410, 130];
const CLEAR_WAYPOINTS: [u16; 2] = [410, 170];
const STATUS: [u16; 2] = [240, 10];
const INFO: [u16; 2] = [240, 256];
const SETTINGS: [u16; 2] = [400, 256];
const LIDAR: [u16; 2] = [280, 50];
const PC_LINK: [u16; 2] = [410, 50];
const RESET: [u16; 2] = [280, 130];

const PANEL: &str = "[device.display.touch-panel]\n";

/// A blind robot: its display does not depend on the quality of the map.
const BLIND: &str = "[device.display.touch-panel]\n[[fault]]\nlink = \"lidar\"\n\
    direction = \"to-master\"\nkind = \"cut\"\nfrom = \"0s\"\nuntil = \"999s\"\n";

fn program(run: &Run) -> &Rescue {
    run.rig.program_as().expect("in this process")
}

fn picture(run: &Run) -> Picture {
    let panel = run.instruments().display(&run.rig);
    render::display(panel.expect("it has one"))
}

fn pass(run: &mut Run, seconds: u64) {
    let until = run.rig.now() + Duration::from_secs(seconds);
    run.go_on_until(until);
}

/// Taps, and gives the robot two seconds to show the result.
fn tap(run: &mut Run, place: [u16; 2]) {
    run.tap(place).expect("it has a display");
    pass(run, 2);
}

fn assert_looks_like(name: &str, seen: &Picture) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/rig/pictures");
    let path = folder.join(format!("{name}.png"));
    if std::env::var_os("UPDATE_PICTURES").is_some() {
        let png = seen.png().expect("has pixels");
        std::fs::write(&path, png).expect("can be written");
    }
    let expected = Picture::read(&path, 1 << 20).expect("committed");
    if *seen != expected {
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
        let png = seen.png().expect("has pixels");
        std::fs::write(&kept, png).expect("can be written");
        let (kept, path) = (kept.display(), path.display());
        panic!("{kept} is not {path}; if it is right, run again with UPDATE_PICTURES=1");
    }
}

/// Each page, the list of messages, waypoints set by touch: compared with checked pictures.
#[test]
fn the_screens_look_as_on_the_pictures() {
    let mut run = start(in_a_room("99s", BLIND));
    pass(&mut run, 4);
    tap(&mut run, SET_WAYPOINTS);
    tap(&mut run, [60, 80]);
    tap(&mut run, [150, 120]);
    assert_looks_like("map", &picture(&run));
    tap(&mut run, INFO);
    assert_looks_like("info", &picture(&run));
    tap(&mut run, SETTINGS);
    tap(&mut run, PC_LINK);
    assert_looks_like("settings", &picture(&run));
    tap(&mut run, STATUS);
    assert_looks_like("messages", &picture(&run));
}

/// A robot at rest with mapping switched off, so that nothing changes any more: each of 200 x 200
/// pixels is the gray of the cell under its middle, 1.5 cells a pixel, except under the robot.
#[test]
fn each_pixel_of_the_map_is_the_cell_under_it() {
    let mut run = start(in_a_room("99s", PANEL));
    pass(&mut run, 6);
    tap(&mut run, MAPPING);
    pass(&mut run, 5);
    let (seen, program) = (picture(&run), program(&run));
    let map = program.map().expect("it has one");
    let (_, pose) = program.estimate().expect("it sees");
    let robot = [pose.x_mm / 15.0, pose.y_mm / 15.0];
    let mut shades = std::collections::BTreeSet::new();
    let pixels = (0_u16..200).flat_map(|up| (0_u16..200).map(move |x| (x, up)));
    for (x, up) in pixels {
        let near = |a: u16, b: f32| (f32::from(a) - b).abs() < 12.0;
        if near(x, robot[0]) && near(up, robot[1]) {
            continue;
        }
        let cell = |pixel: u16| usize::from(3 * (2 * pixel + 1) / 4);
        let value = map.get(cell(x), cell(up)).expect("inside");
        let pixel = seen.get((6 + x).into(), (231 - up).into()).expect("inside");
        let gray = f64::from(255 - value);
        shades.insert(pixel[1]);
        let off = (f64::from(pixel[1]) - gray).abs();
        assert!(
            off <= 32.0,
            "pixel {x}, {up} is {pixel:?}, the cell {value}"
        );
        assert!(pixel[0].abs_diff(pixel[1]) <= 8, "{pixel:?} is no gray");
    }
    assert!(shades.len() > 4, "{shades:?}");
}

#[test]
fn buttons_do_what_they_say() {
    let mut run = start(in_a_room("99s", PANEL));
    pass(&mut run, 3);
    tap(&mut run, EXPLORE);
    assert_eq!(program(&run).ordered_mode(), Mode::Exploration);
    assert!(run.rig.world.is_moving());
    tap(&mut run, STOP);
    assert_eq!(program(&run).ordered_mode(), Mode::Stop);
    assert!(!run.rig.world.is_moving());

    // A touched waypoint is added to the list, and the robot starts as if the PC had sent the
    // waypoint. Pixel (6 + 100, 231 - 80) is cell (150.75, 120.75) of 10 mm.
    tap(&mut run, SET_WAYPOINTS);
    tap(&mut run, [106, 151]);
    let places: Vec<_> = program(&run).waypoints().all().to_vec();
    assert_eq!(places.len(), 1);
    assert_eq!(places[0].position_mm, [1507, 1207]);
    assert_eq!(program(&run).ordered_mode(), Mode::Waypoint);
    tap(&mut run, CLEAR_WAYPOINTS);
    assert!(program(&run).waypoints().is_empty());
    assert_eq!(program(&run).ordered_mode(), Mode::Stop);
    assert_eq!(run.rig.violations(), 0);
}

/// Switched off, the program sends nothing to the PC and receives nothing from it. A partial frame
/// from before must not join the rest of another frame.
#[test]
fn the_pc_link_is_silent_while_it_is_switched_off() {
    let mut run = start(in_a_room("99s", PANEL));
    pass(&mut run, 3);
    tap(&mut run, SETTINGS);
    tap(&mut run, PC_LINK);
    let sent = |run: &Run| {
        let link = run.rig.link("radio").expect("it has one");
        link.line(Direction::ToDevice).traffic().sent
    };
    let before = sent(&run);
    pass(&mut run, 3);
    assert_eq!(sent(&run), before);
    tap(&mut run, PC_LINK);
    assert!(sent(&run) > before + 1000);
}

/// The lidar runs down in both cases: if the robot drives the motor, and if the rig holds the
/// speed.
#[test]
fn a_lidar_that_is_switched_off_runs_out_and_the_robot_stops() {
    lidar_is_switched_off("");
    lidar_is_switched_off("[device.lidar.xv11]\nsupply = { host-v = 5.0 }\n");
}

fn lidar_is_switched_off(supply: &str) {
    let mut run = start(in_a_room("99s", &format!("{PANEL}{supply}")));
    pass(&mut run, 6);
    tap(&mut run, EXPLORE);
    assert!(run.rig.world.is_moving());
    tap(&mut run, SETTINGS);
    tap(&mut run, LIDAR);
    pass(&mut run, 6);
    assert_eq!(program(&run).mode(), Mode::Stop);
    assert!(!run.rig.world.is_moving());
    tap(&mut run, LIDAR);
    pass(&mut run, 6);
    assert!(run.rig.world.is_moving());
}

/// The seed's robot feeds the motor from its board. At 3.3 V the start duty gives 166 rpm, too slow
/// for a measurement; at 2.6 V only the highest duty gives more than 200.
#[test]
fn a_robot_that_drives_its_lidar_brings_it_to_its_speed() {
    for volts in ["2.6", "3.3", "6.0", "9.0"] {
        let supply = format!("[device.lidar.xv11]\nsupply = {{ host-v = {volts} }}\n");
        let mut run = start(in_a_room("99s", &supply));
        pass(&mut run, 12);
        let mut turns = 0;
        program(&run).counters(&mut |name, count| {
            if name == "lidar turns" {
                turns = count;
            }
        });
        assert!(turns > 10, "{volts} V: {turns} turns");
    }
}

/// A single tap must not cost the map.
#[test]
fn a_reset_takes_two_taps() {
    let mut run = start(in_a_room("99s", PANEL));
    pass(&mut run, 4);
    let known = |run: &Run| {
        let map = program(run).map().expect("it has one");
        map.cells().iter().filter(|&&cell| cell != 127).count()
    };
    tap(&mut run, SETTINGS);
    tap(&mut run, RESET);
    assert!(known(&run) > 10_000);
    run.tap(RESET).expect("it has a display");
    run.tap(RESET).expect("it has a display");
    // The map is checked before the next turn of the lidar fills it again.
    let mut least = usize::MAX;
    for _ in 0..60 {
        run.rig.run_for(Duration::from_millis(10));
        least = least.min(known(&run));
    }
    assert_eq!(least, 0);
}

/// Bytes in both directions are damaged for ten seconds. Half a minute later the picture equals
/// that of an undisturbed robot. The damage counts against the line, not against the program.
#[test]
fn a_picture_that_a_bad_line_damaged_mends() {
    let noise = |direction| {
        format!(
            "[[fault]]\nlink = \"display\"\ndirection = \"{direction}\"\nkind = \"flip\"\n\
             rate = 0.02\nfrom = \"0s\"\nuntil = \"10s\"\n"
        )
    };
    let more = format!("{BLIND}{}{}", noise("to-device"), noise("to-master"));
    let mut damaged = start(in_a_room("99s", &more));
    let mut clean = start(in_a_room("99s", BLIND));
    pass(&mut damaged, 9);
    pass(&mut clean, 9);
    let panel = damaged
        .rig
        .device::<TouchPanel>("display")
        .expect("it has one");
    assert!(panel.frames()[1] > 10, "{:?}", panel.frames());
    assert!(picture(&damaged) != picture(&clean));
    pass(&mut damaged, 40);
    pass(&mut clean, 40);
    assert!(picture(&damaged) == picture(&clean));
    assert_eq!(damaged.rig.violations(), 0);
}

/// The display uses only spare time: a run with the display equals the run without it, except for
/// the display's own line.
#[test]
fn a_display_changes_nothing_else() {
    let run = |with: bool| {
        let (mut scenario, source) = shipped("rescue-flat");
        scenario.duration = "15s".parse().expect("a time");
        if !with {
            scenario.device.remove("display");
        }
        run_to_end((scenario, source))
    };
    let (with, without) = (run(true), run(false));
    assert!(with.display.is_some() && without.display.is_none());
    assert!(with.map == without.map && with.truth == without.truth);
    assert_eq!(with.counters, without.counters);
    assert_ne!(with.trace_hash, without.trace_hash);
}

#[test]
fn a_tap_beside_the_display_is_refused() {
    let beside = "[[device.display.touch-panel.tap]]\nat = \"1s\"\nplace = [480, 0]\n";
    let (scenario, source) = in_a_room("9s", beside);
    let error = Run::new(scenario, &source, None).err().expect("unsound");
    insta::assert_snapshot!(
        error.to_string(),
        @"<test>:7: device.display.touch-panel.tap: is 480, 0, expected a position on 480 x 272 pixels"
    );
}

/// The scenario makes the same taps: a run with touches can be repeated.
#[test]
fn a_scenario_can_touch() {
    let taps = format!(
        "{PANEL}[[device.display.touch-panel.tap]]\nat = \"3s\"\nplace = [410, 50]\n\
         [[device.display.touch-panel.tap]]\nat = \"5s\"\nplace = [280, 50]\n"
    );
    let mut run = start(in_a_room("9s", &taps));
    pass(&mut run, 4);
    assert_eq!(program(&run).ordered_mode(), Mode::Exploration);
    pass(&mut run, 2);
    assert_eq!(program(&run).ordered_mode(), Mode::Stop);
}
