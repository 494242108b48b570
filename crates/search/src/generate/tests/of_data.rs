//! Robots of data and devices without a robot: the program under test is at the open ends of their
//! links, which are the only links that can have faults.

use std::path::PathBuf;

use super::*;
use engine::run::Run;

const VARY: Vary = Vary {
    world: false,
    mission: false,
    timing: false,
    faults: true,
    schedule: false,
};

const SONAR: &str = "[device.sonar.text]\nbaud = 9600\n\
    [[device.sonar.text.command]]\nrequest = \"ping\"\nreply = \"pong\"\n";
const WHEELS: &str = "[device.wheels.registers]\nbaud = 9600\n\
    [[device.wheels.registers.register]]\naddress = 1\nname = \"power\"\nwidth = \"u8\"\n\
    access = \"write\"\n";
const ROOM: &str = "chassis.differential = {}\n\
    world.start = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n\
    world.wall = [{ path_m = [[0, 0], [3, 0], [3, 2], [0, 2], [0, 0]] }]\n";

/// A file in the folder of the described devices, so that it can name one by its file.
fn in_devices(text: &str) -> (Scenario, Source) {
    let devices = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../devices");
    Scenario::parse(&devices.join("bench.toml"), text.to_owned()).expect(text)
}

fn of(robot: &str, parts: &[&str]) -> (Scenario, Source) {
    let head = "schema = 1\nname = \"own\"\nduration = \"20s\"\n";
    in_devices(&format!("{head}robot = \"{robot}\"\n{}", parts.concat()))
}

/// Links of the faults that `seeds` draw.
fn struck(base: &(Scenario, Source), profile: &Profile, seeds: u64) -> (usize, BTreeSet<String>) {
    let (base, source) = base;
    let (mut count, mut links) = (0, BTreeSet::new());
    for seed in 0..seeds {
        let mut dice = Dice::of_seed(seed, "own");
        let made = super::super::scenario(base, source, VARY, profile, &mut dice);
        count += made.fault.len();
        links.extend(made.fault.iter().filter_map(|fault| fault.link.clone()));
        if !base.device.values().any(|spec| spec.kind() == "program") {
            let wired = Run::new(made, source, None);
            assert!(wired.is_ok(), "seed {seed}: {:?}", wired.err());
        }
    }
    (count, links)
}

/// Each kind of device gets faults on each of its links, in each profile, and each case can be
/// wired.
#[test]
fn each_link_to_the_program_under_test_has_faults() {
    let connect = include_str!("../../../../../docs/connect/robot.toml");
    let shipped = include_str!("../../../scenarios/custom-robot.toml");
    let described = "device.meter = { description = \"modbus-meter\" }\n";
    let of_file = "device.flow = { description = \"alicat.toml\" }\n";
    let cable = "cable.bus = { master = \"a\", device = \"b\", baud = 9600 }\n";
    let cases = [
        (of("none", &[SONAR]), vec!["sonar"]),
        (of("none", &[described]), vec!["meter"]),
        (of("none", &[of_file, SONAR]), vec!["flow", "sonar"]),
        (of("none", &[cable]), vec!["bus"]),
        (
            of("custom", &[ROOM, SONAR, WHEELS]),
            vec!["sonar", "wheels"],
        ),
        (
            of("custom", &[of_file, ROOM, WHEELS]),
            vec!["flow", "wheels"],
        ),
        (in_devices(connect), vec!["lidar", "wheels"]),
        (in_devices(shipped), vec!["lidar", "wheels"]),
    ];
    for name in Profile::names() {
        let profile = Profile::find(name).expect("it is built in");
        for (base, links) in &cases {
            let (count, struck) = struck(base, &profile, 12);
            assert!(count >= 12, "{name}: {count}, {links:?}");
            let links = links.iter().map(|&link| link.to_owned());
            assert_eq!(struck, links.collect(), "{name}");
        }
    }
}

/// A program that plays a device has faults on its link. It does not start for them: a campaign
/// would start it once more for each run.
#[test]
fn a_program_that_plays_a_device_is_not_started_for_faults() {
    let mark = std::env::temp_dir().join(format!("hilrig-started-{}", std::process::id()));
    let exec = format!(
        "[device.drive.program]\nexec = \"touch '{}'\"\n",
        mark.display()
    );
    let base = of("custom", &[ROOM, &exec, "rate = 9600\n"]);
    let (count, links) = struck(&base, &Profile::default(), 12);
    assert!(count >= 12, "{count}");
    assert_eq!(links, BTreeSet::from(["drive".to_owned()]));
    assert!(!mark.exists(), "{}", mark.display());
}

/// Beside a built-in program, a device that the scenario adds has no client.
#[test]
fn a_device_without_a_client_has_no_faults() {
    let (count, links) = struck(&of("rescue", &[ROOM_ONLY, SONAR]), &Profile::default(), 12);
    assert!(count > 0);
    assert!(!links.contains("sonar"), "{links:?}");
}

const ROOM_ONLY: &str = "world.start = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n\
    world.wall = [{ path_m = [[0, 0], [3, 0], [3, 2], [0, 2], [0, 0]] }]\n";

/// Without a part that can have a fault, each run would pass without one.
#[test]
fn a_scenario_without_parts_says_why_it_has_no_faults() {
    let mut profile = Profile::default();
    let lack = |base: &(Scenario, Source), profile: &Profile| {
        lack_of_faults(&base.0, &base.1, profile).expect("it can be wired")
    };
    let bare = of("custom", &[ROOM]);
    let said = lack(&bare, &profile).expect("it has no link");
    assert_eq!(said, "it has no link and no device");
    let sonar = of("none", &[SONAR]);
    assert_eq!(lack(&sonar, &profile), None);
    let kinds = FaultKind::ALL.iter().map(|kind| kind.name().to_owned());
    profile.faults.never = kinds.collect();
    let said = lack(&sonar, &profile).expect("all are excluded");
    assert!(said.starts_with("profile gentle excludes"), "{said}");
    let unknown = of(
        "none",
        &["device.meter = { description = \"no-such.toml\" }\n"],
    );
    let error = lack_of_faults(&unknown.0, &unknown.1, &profile).expect_err("no such file");
    assert!(error.to_string().contains("no-such.toml"), "{error}");
}

/// Devices without a robot have no mission to finish: the run lasts as long as the faults of the
/// gentle profile, 14 s, and the scenario, 20 s.
#[test]
fn devices_alone_get_no_time_for_a_mission() {
    let lasts = |(base, source): (Scenario, Source)| {
        let mut dice = Dice::of_seed(1, "own");
        let made = super::super::scenario(&base, &source, VARY, &Profile::default(), &mut dice);
        made.duration
    };
    assert_eq!(lasts(of("none", &[SONAR])), Span::from_millis(34_000));
    let robot = of("custom", &[ROOM, SONAR, WHEELS]);
    assert_eq!(lasts(robot), Span::from_millis(134_000));
}
