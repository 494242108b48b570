//! Robots as data, and devices without a robot.

use std::path::Path;

use hilrig::robots::{self, Dut, PcEnd, Wired};
use hilrig::run::Run;
use hilrig::run::check::Status;
use hilrig::scenario::{Scenario, ScenarioError, Source};
use protocols::avr::{ChecksumOrder, Frame};
use protocols::{Instant, LineConfig};

use super::shipped;

fn read(text: &str) -> Result<(Scenario, Source), ScenarioError> {
    Scenario::parse(Path::new("<test>"), text.to_owned())
}

/// The error that refuses `text`.
fn refusal(text: &str) -> String {
    let wired = read(text).and_then(|(scenario, source)| {
        robots::wire(&scenario, &source, Dut::External, PcEnd::External)
    });
    wired.err().expect("refused").to_string()
}

fn run_of((scenario, source): (Scenario, Source)) -> (Run, Vec<robots::OpenEnd>) {
    let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::External);
    let Wired {
        rig,
        open_ends,
        instruments,
    } = wired.expect("sound");
    (Run::with_rig(scenario, rig, instruments), open_ends)
}

/// Both wheels drive at 20 cm/s for two seconds; the order is repeated each 100 ms. The robot moves
/// by 0.4 m, minus half a per cent of slip and the motors' start. Then the master is silent and the
/// wheels stop.
#[test]
fn registers_drive_the_wheels_of_a_robot_of_data() {
    let (mut run, ends) = run_of(shipped("custom-robot"));
    let names: Vec<&str> = ends.iter().map(|end| &*end.name).collect();
    assert_eq!(names, ["lidar", "lidar-motor", "wheels"]);
    let wheels = &ends[2];
    run.rig
        .set_line_config(wheels.node, LineConfig::new_8n1(115_200));
    let drive = Frame::write(1, &[20, 20], ChecksumOrder::LowFirst);
    for step in 0..20 {
        run.rig.inject(wheels.node, drive.as_bytes());
        run.go_on_until(Instant::from_millis(100 * (step + 1)));
    }
    let axes = run.instruments().axes(&run.rig);
    let told: Vec<_> = axes
        .iter()
        .map(|axis| (&*axis.name, axis.set_point))
        .collect();
    assert_eq!(told, [("left", 0.2), ("right", 0.2)]);
    run.go_on_until(Instant::from_secs(4));
    let way = run.rig.world.pose().x - 1.0;
    // After half a second more the watchdog sets the speed to 0.
    assert!((0.46..0.50).contains(&way), "{way} m");
    assert!(!run.rig.world.is_moving());
    let panels = run.instruments().panels(&run.rig);
    let rows: Vec<&str> = panels[0].rows.iter().map(|row| &*row.name).collect();
    assert_eq!(
        rows,
        ["left-cm-s", "right-cm-s", "encoder-left", "encoder-right"]
    );
    let ticks: f64 = panels[0].rows[2].value.parse().expect("a number");
    // 0.45379 mm a tick, slip of half a per cent.
    assert!(
        (ticks * 0.000_453_79 * 0.995 - way).abs() < 0.01,
        "{ticks} ticks, {way} m"
    );
}

/// No client is connected: the robot's report is empty, and the demanded checks fail.
#[test]
fn a_robot_that_nobody_drives_does_not_pass() {
    let (run, _) = run_of(shipped("custom-robot"));
    let outcome = run.finish();
    assert!(!outcome.passed());
    let status = |name: &str| {
        let mut checks = outcome.checks.iter();
        checks
            .find(|check| check.name == name)
            .map(|check| check.status)
    };
    assert_eq!(status("waypoints-visited"), Some(Status::Fail));
    assert_eq!(status("no-collision-at-speed"), Some(Status::NotObserved));
    assert_eq!(status("program-alive"), Some(Status::NotObserved));
}

const CART: &str = "schema = 1\nname = \"cart\"\nrobot = \"custom\"\nduration = \"1s\"\n\
    [chassis.differential]\n[device.wheels.registers]\nbaud = 115200\nwatchdog = \"500ms\"\n\
    register = [\n\
    { address = 1, name = \"left\", width = \"i8\", access = \"write\", limits = [-30, 30], \
    safe = 0, drives = { actuator = \"left\", speed_m_s = 0.01 } },\n\
    { address = 2, name = \"right\", width = \"i8\", access = \"write\", limits = [-30, 30], \
    safe = 0, drives = { actuator = \"right\", speed_m_s = 0.01 } },\n]\n\
    [world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n\
    [[world.wall]]\npath_m = [[0,0],[2,0],[2,2],[0,2],[0,0]]\n\
    [[expect.rule]]\nname = \"slow\"\n\
    always = { robot = { of = \"speed-m-s\", op = \"<=\", value = 0.12 } }\n";

/// A robot that stands keeps each rule; that shows nothing of a program.
#[test]
fn rules_of_a_robot_that_nobody_drives_are_not_judged() {
    let drive = Frame::write(1, &[5, 5], ChecksumOrder::LowFirst);
    let outcome = |is_driven: bool| {
        let (mut run, ends) = run_of(read(CART).expect("sound"));
        let wheels = ends[0].node;
        run.rig
            .set_line_config(wheels, LineConfig::new_8n1(115_200));
        if is_driven {
            run.rig.inject(wheels, drive.as_bytes());
        }
        run.finish()
    };
    let [stands, drives] = [false, true].map(outcome);
    assert!(!stands.is_judged() && !stands.passed());
    assert!(drives.is_judged());
}

const GRIPPER: &str = "schema = 1\nname = \"gripper\"\nrobot = \"none\"\nduration = \"1s\"\n\
    [device.gripper.registers]\nbaud = 115200\n[[device.gripper.registers.register]]\n\
    address = 4\nname = \"way\"\nwidth = \"u8\"\naccess = \"write\"\n";

/// A gripper on a wire: no robot, no world; its master writes a register and reads it back.
#[test]
fn a_device_needs_neither_robot_nor_world() {
    let (scenario, source) = read(GRIPPER).expect("sound");
    assert!(
        !scenario.to_toml().contains("[world"),
        "{}",
        scenario.to_toml()
    );
    let (mut run, ends) = run_of((scenario, source));
    assert_eq!(ends.len(), 1);
    let order = ChecksumOrder::LowFirst;
    let node = ends[0].node;
    run.rig
        .inject(node, Frame::write(4, &[77], order).as_bytes());
    run.go_on_until(Instant::from_millis(10));
    run.rig.inject(node, Frame::read(4, 1, order).as_bytes());
    run.go_on_until(Instant::from_millis(20));
    let heard = run.rig.take_output(node);
    // A write is acknowledged by the empty frame of its register.
    let expected = [Frame::read(4, 0, order), Frame::write(4, &[77], order)];
    assert_eq!(
        heard,
        expected.map(|frame| frame.as_bytes().to_vec()).concat()
    );
    assert!(run.instruments().axes(&run.rig).is_empty());
}

#[test]
fn what_cannot_be_is_told_with_its_place() {
    let robot = std::fs::read_to_string("scenarios/custom-robot.toml").expect("is there");
    insta::assert_snapshot!(
        refusal(&robot.replace("actuator = \"left\"", "actuator = \"rear\"")),
        @r#"<test>:34: device.wheels.registers.register[0].drives.actuator: there is no actuator "rear", expected one of: left, right"#
    );
    insta::assert_snapshot!(
        refusal(&robot.replace("speed_m_s = 0.01 }", "speed_m_s = 0.01, power = 1 }")),
        @r#"<test>:27: device.wheels.registers.register[0].drives: drives "left" without a scale or with several, expected one of power, speed_m_s and angle_deg, other than 0"#
    );
    insta::assert_snapshot!(
        refusal(&robot.replace("{ encoder = \"left\" }", "{ encoder = \"drive\" }")),
        @r#"<test>:49: device.wheels.registers.register[2].source.encoder: there is no encoder "drive", expected one of: left, right"#
    );
    insta::assert_snapshot!(refusal(&robot.replace("\"custom\"", "\"rescue\"")), @r#"<test>:18: chassis: expected none: this robot has its own chassis"#);
    insta::assert_snapshot!(refusal(&robot.replace("\"custom\"", "\"costum\"")), @r#"<test>:8: robot: is "costum", did you mean "custom"? Expected one of apollo13, custom, none, rescue, yellow"#);
    insta::assert_snapshot!(refusal(&GRIPPER.replace("\"none\"", "\"custom\"")), @r#"<test>: world: is missing, expected a table with the robot's start and the obstacles; robot = "none" needs no world"#);
    let car = "[chassis.ackermann]\nwheelbase_m = -1\n";
    insta::assert_snapshot!(refusal(&robot.replace("[chassis.differential]", car)), @r#"<test>:18: chassis.ackermann: body.wheelbase_m is -1; expected 0.02 to 4"#);
    let flat = "[chassis.differential]\nfootprint_m = [[0, 0], [1, 1]]\n";
    insta::assert_snapshot!(refusal(&robot.replace("[chassis.differential]", flat)), @r#"<test>:19: chassis.differential.footprint_m: 2 corners; expected 3 to 64"#);
}

/// A board that counts an encoder which the chassis lacks would show a standstill forever: the
/// scenario is refused. A car has the encoders of its shaft and of its rear wheels.
#[test]
fn f15_a_board_without_its_encoder_is_refused() {
    let text = |chassis: &str, devices: &str| {
        format!(
            "schema = 1\nname = \"test\"\nrobot = \"custom\"\nduration = \"1s\"\n\
             [chassis.{chassis}]\n{devices}\n[world]\n\
             start = {{ x_m = 1.0, y_m = 1.0, heading_deg = 0 }}\n\
             [[world.wall]]\npath_m = [[0, 0], [2, 0]]\n"
        )
    };
    let odometer = "[device.wheel.odometer]";
    let refused = refusal(&text("differential", odometer));
    assert!(
        refused.contains("counts the encoder \"drive\"") && refused.contains("\"left\""),
        "{refused}"
    );
    let sound = text("ackermann", &format!("[device.car.car-board]\n{odometer}"));
    run_of(read(&sound).expect("sound"));
}

/// Only what a device sends is late, not what it receives.
#[test]
fn a_delayed_device_hears_at_once() {
    let late = "[[fault]]\nkind = \"delayed\"\ndevice = \"gripper\"\nby = \"100ms\"\n";
    let (mut run, ends) = run_of(read(&format!("{GRIPPER}{late}")).expect("sound"));
    let node = ends[0].node;
    let order = Frame::write(4, &[77], ChecksumOrder::LowFirst);
    run.rig.inject(node, order.as_bytes());
    let heard = [100, 120].map(|at| {
        run.go_on_until(Instant::from_millis(at));
        run.rig.take_output(node).len()
    });
    assert_eq!(
        heard,
        [
            0,
            Frame::read(4, 0, ChecksumOrder::LowFirst).as_bytes().len()
        ]
    );
}

/// A step by hand that the device cannot take is refused, and the run is as before.
#[test]
fn a_refused_order_changes_nothing() {
    let order = |text: &str| serde_json::from_str(text).expect("an action");
    let limits = GRIPPER.replace("access", "limits = [0, 50]\naccess");
    let (mut run, _) = run_of(read(&limits).expect("sound"));
    for (text, word) in [
        (
            r#"{"set":{"device":"grippr","name":"way","value":3}}"#,
            "did you mean",
        ),
        (
            r#"{"set":{"device":"gripper","name":"wy","value":3}}"#,
            "expected one of way",
        ),
        (
            r#"{"set":{"device":"gripper","name":"way","value":99}}"#,
            "50",
        ),
        (
            r#"{"set":{"device":"gripper","name":"way","value":1.5}}"#,
            "",
        ),
        (
            r#"{"inject":{"link":"grippr","direction":"to-device","hex":"AB"}}"#,
            "did you mean",
        ),
    ] {
        let refused = run.command(order(text)).expect_err(text).to_string();
        assert!(refused.contains(word), "{text}: {refused}");
    }
    let sound = r#"{"set":{"device":"gripper","name":"way","value":3}}"#;
    run.command(order(sound)).expect("sound");
    assert_eq!(run.case().mission.step.len(), 1);
    let outcome = run.finish();
    let mut checks = outcome.checks.iter();
    assert!(checks.all(|check| check.status != Status::Fail));
}
