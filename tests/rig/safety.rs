//! Checkers of `[expect.safety]`: each finds a planted defect, or a defective user's program, and
//! passes the correct program.

use hilrig::robots::{self, Dut, OpenEnd, PcEnd, Wired};
use hilrig::run::check::{Check, Status};
use hilrig::run::{Outcome, Run};
use hilrig::scenario::Scenario;
use protocols::avr::{ChecksumOrder, Frame};
use protocols::telemetry::message::{ANY_HEADING, Pose, State, Telecommand};
use protocols::{Instant, LineConfig, telemetry};

use super::{in_a_room, run_to_end, shipped, start};

fn check(outcome: &Outcome, name: &str) -> Check {
    let found = outcome.checks.iter().find(|check| check.name == name);
    found.unwrap_or_else(|| panic!("no check {name}")).clone()
}

const SAFETY: &str = "[expect.safety]\nrests_within = \"1s\"\ntrue_telemetry = true\n\
    says_within = \"3s\"\nalive_for = \"3s\"\nsound_orders = true\n";
const WAY: &str = "[mission]\nto_the_end = true\nwaypoints_m = [[1.5, 2.2], [0.8, 1.5]]\n";
const BY_HAND: &str = "[mission]\nto_the_end = true\n[[mission.step]]\nat = \"2s\"\n\
    do = { drive = [10, -10] }\n[[mission.step]]\nat = \"5s\"\ndo = \"disconnect\"\n";
/// From 5 s on nothing of the lidar arrives.
const NO_LIDAR: &str = "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
    from = \"5s\"\n";

/// Defects of the fielded programs: the robot continues to drive manually when the PC is gone
/// (PU-21), or in the dark (XV-11); it waits for its lidar forever (XV-08); it reports speeds in
/// tenths (MA-10). Each check fails with its defect and passes without it.
#[test]
fn planted_defects_are_found_by_the_checks_of_safety() {
    let rows = [
        ("rests-after-silence", "PU-21", format!("{BY_HAND}{SAFETY}")),
        ("telemetry-true", "MA-10", format!("{WAY}{SAFETY}")),
        (
            "notices-silence",
            "XV-08",
            format!("{WAY}{SAFETY}{NO_LIDAR}"),
        ),
    ];
    for (name, defect, text) in rows {
        let judged = |defects: &str| {
            let program = format!("[program]\ndefects = [{defects}]\n");
            check(
                &run_to_end(in_a_room("12s", &format!("{program}{text}"))),
                name,
            )
        };
        let (with, without) = (judged(&format!("\"{defect}\"")), judged(""));
        assert_eq!(with.status, Status::Fail, "{defect}: {}", with.detail);
        assert_eq!(without.status, Status::Pass, "{defect}: {}", without.detail);
    }
}

/// Text of a scenario that drives by hand, at first with these set-points.
fn by_hand(first: [i32; 2], then: &str) -> String {
    let [left, right] = first;
    format!(
        "[mission]\nto_the_end = true\n[[mission.step]]\nat = \"600ms\"\n\
         do = {{ drive = [{left}, {right}] }}\n{then}"
    )
}

/// Defects that only a comparison with the program's own lines, orders and pose shows: the program
/// accepts damaged packets (XV-02); it sends text inside of frames (PU-18); its pose leaps (SL-02);
/// it forgets an order to drive (PU-20), or rolls on after a stop until the watchdog of its base
/// expires (NV-04); it waits for its lidar and sends nothing to its base (XV-08); it turns the long
/// way (NV-01); it drives blind (XV-11). Each check fails with its defect and passes without it.
#[test]
fn planted_defects_are_found_by_the_checks_of_the_program() {
    let noise = "[[fault]]\nkind = \"flip\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
        rate = 0.004\nfrom = \"2s\"\n";
    let to_place = |at: &str, then: &str, place: [f64; 2]| {
        let [x, y] = place;
        format!(
            "[[mission.step]]\nat = \"{at}\"\ndo = {{ waypoints-m = [[{x}, {y}]] }}\n\
             [[mission.step]]\nat = \"{then}\"\ndo = {{ mode = \"waypoint\" }}\n"
        )
    };
    let seam = by_hand([10, -10], &to_place("3500ms", "3550ms", [2.4, 1.36]));
    let stop = "[[mission.step]]\nat = \"6s\"\ndo = { mode = \"stop\" }\n";
    let dark = "[program]\nstart_mode = \"exploration\"\n[[fault]]\nkind = \"device\"\n\
        device = \"lidar\"\nfault = \"dark\"\nfrom = \"4s\"\n";
    let rows = [
        ("counts-true", "XV-02", "6s", format!("{WAY}{noise}")),
        ("sends-sound-frames", "PU-18", "6s", WAY.to_owned()),
        ("pose-believed", "SL-02", "25s", format!("seed = 2\n{WAY}")),
        ("does-as-ordered", "PU-20", "8s", by_hand([10, -10], "")),
        ("does-as-ordered", "NV-04", "9s", format!("{WAY}{stop}")),
        ("drive-fed", "NV-04", "9s", format!("{WAY}{stop}")),
        ("sends-on", "XV-08", "12s", format!("{WAY}{NO_LIDAR}")),
        ("turns-short", "NV-01", "14s", seam),
        ("rests-after-silence", "XV-11", "9s", dark.to_owned()),
    ];
    let keys = "true_counts = true\nsound_frames = true\npose_within_mm = 150\n\
        obeys_within = \"300ms\"\nshort_turns = true\ncommands_within = \"1s\"\n\
        sends_within = \"4s\"\n";
    for (name, defect, duration, text) in rows {
        let judged = |defects: &str| {
            let program = format!("[program]\ndefects = [{defects}]\n");
            let text = match text.contains("[program]\n") {
                true => text.replace("[program]\n", &program),
                false => format!("{text}{program}"),
            };
            let text = format!("{text}{SAFETY}{keys}");
            check(&run_to_end(in_a_room(duration, &text)), name)
        };
        let (with, without) = (judged(&format!("\"{defect}\"")), judged(""));
        assert_eq!(with.status, Status::Fail, "{defect}: {}", with.detail);
        assert_eq!(without.status, Status::Pass, "{defect}: {}", without.detail);
    }
}

/// Defects that the robot's steady work shows: driving backwards counts as driving ahead (SL-07);
/// all packets but the first are rejected (XV-01); after a stop no set-points are sent (NV-04); a
/// read is pushed aside by another one and not repeated (MA-08). Each check fails with its defect
/// and passes without it.
#[test]
fn planted_defects_are_found_by_the_checks_of_steady_work() {
    let drives = |at: &str, axes: &str| {
        format!("[[mission.step]]\nat = \"{at}\"\ndo = {{ drive = {axes} }}\n")
    };
    let to_and_fro: String = ["2s", "6s", "10s"]
        .iter()
        .zip(["4s", "8s", "12s"])
        .map(|(ahead, back)| drives(ahead, "[12, 12]") + &drives(back, "[-12, -12]"))
        .collect();
    let to_and_fro = format!("[mission]\nto_the_end = true\n{to_and_fro}");
    let stop = "[[mission.step]]\nat = \"6s\"\ndo = { mode = \"stop\" }\n";
    let rows = [
        ("motion-true", "SL-07", "14s", to_and_fro),
        ("complaints-true", "XV-01", "6s", WAY.to_owned()),
        ("sends-in-time", "NV-04", "9s", format!("{WAY}{stop}")),
        ("asks-again", "MA-08", "9s", WAY.to_owned()),
    ];
    let keys = "[expect.safety]\nmotion_within_percent = 8\ntrue_complaints = true\n\
        sends_cyclically = true\nasks_again = true\n";
    for (name, defect, duration, text) in rows {
        let judged = |defects: &str| {
            let text = format!("[program]\ndefects = [{defects}]\n{text}{keys}");
            check(&run_to_end(in_a_room(duration, &text)), name)
        };
        let (with, without) = (judged(&format!("\"{defect}\"")), judged(""));
        assert_eq!(with.status, Status::Fail, "{defect}: {}", with.detail);
        assert_eq!(without.status, Status::Pass, "{defect}: {}", without.detail);
    }
}

/// The phone of the car is gone permanently (AF-07): the car continues to drive, 3 s after the
/// start of a drive of 40 s. The watchdog of its board does not stop it, because the board receives
/// commands.
#[test]
fn a_car_whose_remote_is_gone_must_stop() {
    let judged = |defects: &str| {
        let (_, source) = shipped("apollo13-remote");
        let cut = "[[fault]]\nkind = \"cut\"\nlink = \"remote\"\ndirection = \"to-master\"\n\
            from = \"3s\"\n";
        let text = format!("{}\n{SAFETY}{cut}", source.text);
        let program = format!("[program]\ndefects = [{defects}]\n[mission]");
        let text = text.replace("[mission]", &program);
        let mut scenario = Scenario::parse(&source.path, text).expect("sound").0;
        scenario.duration = hilrig::scenario::Span::from_millis(8_000);
        check(&run_to_end((scenario, source)), "rests-after-silence")
    };
    let (with, without) = (judged("\"AF-07\""), judged(""));
    assert_eq!(with.status, Status::Fail, "{}", with.detail);
    assert!(
        with.detail.contains("after the last byte of remote"),
        "{}",
        with.detail
    );
    assert_eq!(without.status, Status::Pass, "{}", without.detail);
}

/// Sound programs that checks once accused. A car that its phone has made fast rolls out behind the
/// stop, its wheels steered. A car on its way to a goal rests if the board is silent whose sensors
/// it needs. A program on a line that is slower than it assumes gives up parts of frames.
#[test]
fn sound_programs_pass_the_checks_of_their_silences_and_frames() {
    let cut = |link: &str, from: &str| {
        format!(
            "[[fault]]\nkind = \"cut\"\nlink = \"{link}\"\ndirection = \"to-master\"\n\
             from = \"{from}\"\n"
        )
    };
    let step = |at: &str, action: &str| {
        format!("[[mission.step]]\nat = \"{at}\"\n[mission.step.do]\n{action}\n")
    };
    // The phone's speed, 10.
    let fast = "inject = { link = \"remote\", direction = \"to-master\", \
                hex = \"2F312F7370656564000000002C66000041200000\" }";
    let goal = step("2s", "mode = \"go-to 5 0.7 0\"");
    let own = |name: &str, more: String| {
        let (_, source) = shipped(name);
        let text = format!("{}\n{SAFETY}{more}", source.text);
        let mut scenario = Scenario::parse(&source.path, text).expect("sound").0;
        scenario.duration = hilrig::scenario::Span::from_millis(7_000);
        (scenario, source)
    };
    let slow = "[expect.safety]\nsound_frames = true\n[[fault]]\nkind = \"wrong-baud\"\n\
                link = \"base\"\ndirection = \"to-device\"\nbaud = 9600\nfrom = \"733ms\"\n";
    let rows = [
        (
            "rests-after-silence",
            own(
                "apollo13-remote",
                step("3900ms", fast) + &cut("remote", "3500ms"),
            ),
        ),
        (
            "rests-after-silence",
            own("apollo13-wall", goal + &cut("car", "4s")),
        ),
        ("sends-sound-frames", in_a_room("3s", slow)),
    ];
    for (name, scenario) in rows {
        let told = format!("{name} of {}", scenario.0.name);
        let judged = check(&run_to_end(scenario), name);
        assert_eq!(judged.status, Status::Pass, "{told}: {}", judged.detail);
    }
}

/// A lidar that is silent for some time is no failure at the end. A lidar that stays silent is one,
/// unless the scenario names its link as broken.
#[test]
fn what_was_healed_must_carry_bytes_again() {
    let judged = |until: &str, without: &str| {
        let safety = format!("[expect.safety]\nalive_for = \"3s\"\n{without}");
        let fault = format!("{NO_LIDAR}{until}");
        let outcome = run_to_end(in_a_room("14s", &format!("{WAY}{safety}{fault}")));
        check(&outcome, "alive-at-the-end")
    };
    assert_eq!(judged("until = \"8s\"\n", "").status, Status::Pass);
    let broken = judged("", "");
    assert_eq!(broken.status, Status::Fail);
    assert!(
        broken.detail.ends_with(": lidar to-master"),
        "{}",
        broken.detail
    );
    assert_eq!(
        judged("", "alive_without = [\"lidar\"]\n").status,
        Status::Pass
    );
}

/// A custom robot with a lidar, wheels, and a hand-held remote that the program reads the speed
/// from.
fn own_robot(more: &str) -> (Run, Vec<OpenEnd>) {
    let (_, source) = shipped("custom-robot");
    let remote = "[device.remote.registers]\nbaud = 115200\n[[device.remote.registers.register]]\n\
        address = 7\nname = \"speed\"\nwidth = \"i8\"\ninitial = 20\n";
    let text = source
        .text
        .replace("[world]", &format!("{remote}{more}\n[world]"));
    let (scenario, source) = Scenario::parse(&source.path, text).expect("sound");
    let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::External);
    let Wired {
        mut rig,
        open_ends,
        instruments,
    } = wired.expect("sound");
    for end in &open_ends {
        if end.name != "lidar" && end.name != "lidar-motor" {
            rig.set_line_config(end.node, LineConfig::new_8n1(115_200));
        }
    }
    (Run::with_rig(scenario, rig, instruments), open_ends)
}

/// Drives for 6 s with a user's program: every 100 ms it reads a speed from the remote and sends it
/// to the wheels, if `may_drive` allows this for the received bytes of the lidar and the remote.
fn drive(more: &str, may_drive: impl Fn(&[u8], &[u8]) -> bool) -> Outcome {
    let (mut run, ends) = own_robot(more);
    let node = |name: &str| {
        ends.iter()
            .find(|end| end.name == name)
            .expect("a port")
            .node
    };
    let [lidar, wheels, remote] = ["lidar", "wheels", "remote"].map(node);
    let order = ChecksumOrder::LowFirst;
    run.rig.inject(node("lidar-motor"), &[60]);
    for step in 1..60 {
        run.rig.inject(remote, Frame::read(7, 1, order).as_bytes());
        run.go_on_until(Instant::from_millis(100 * step));
        let (seen, said) = (run.rig.take_output(lidar), run.rig.take_output(remote));
        let speed = if may_drive(&seen, &said) {
            [10, 10]
        } else {
            [0, 0]
        };
        run.rig
            .inject(wheels, Frame::write(1, &speed, order).as_bytes());
    }
    run.judge()
}

/// The rules for the built-in robots also hold for a user's program. One program drives without
/// regard to its lidar; the other stops when no bytes arrive.
#[test]
fn a_strangers_program_must_rest_without_its_lidar() {
    let more = "[expect.safety]\nrests_within = \"1s\"\n[[fault]]\nkind = \"cut\"\n\
        link = \"lidar\"\ndirection = \"to-master\"\nfrom = \"2s\"\n";
    let name = "rests-after-silence";
    let blind = check(&drive(more, |_, _| true), name);
    assert_eq!(blind.status, Status::Fail, "{}", blind.detail);
    assert!(
        blind.detail.contains("after the last byte of lidar"),
        "{}",
        blind.detail
    );
    let sound = check(&drive(more, |seen, _| !seen.is_empty()), name);
    assert_eq!(sound.status, Status::Pass, "{}", sound.detail);
}

/// On a line that clears the highest bit, no reply of the remote has a valid checksum. One program
/// accepts any bytes as an order, the other only a valid frame.
#[test]
fn a_strangers_program_must_not_move_on_damaged_frames() {
    let more = "[expect.safety]\nsound_orders = true\norders_link = \"remote\"\n[[fault]]\n\
        kind = \"clear-bit7\"\nlink = \"remote\"\ndirection = \"to-master\"\n";
    let name = "moves-on-sound-orders";
    let trusting = check(&drive(more, |_, said| !said.is_empty()), name);
    assert_eq!(trusting.status, Status::Fail, "{}", trusting.detail);
    let sound = check(&drive(more, |_, said| said.starts_with(&[0xAB])), name);
    assert_eq!(sound.status, Status::Pass, "{}", sound.detail);
}

/// A link that does not exist is refused with file, line and key.
#[test]
fn a_link_that_safety_names_must_exist() {
    let (scenario, source) = in_a_room("1s", "[expect.safety]\nrests_without = [\"radar\"]\n");
    let refused = Run::new(scenario, &source, None).err().expect("refused");
    let expected = "<test>:6: expect.safety.rests_without: is \"radar\", did you mean ";
    assert!(refused.to_string().starts_with(expected), "{refused}");
    drop(start(in_a_room(
        "1s",
        "[expect.safety]\nrests_without = [\"lidar\"]\n",
    )));
}

/// Text of a step that sends `command` to the robot.
fn injected(at: &str, command: &Telecommand) -> String {
    let mut payload = [0; 64];
    let len = command.encode(&mut payload).expect("fits");
    let mut frame = [0; 80];
    let len = telemetry::encode(&payload[..len], &mut frame).expect("fits");
    let bytes = frame[..len].iter();
    let hex: String = bytes.map(|byte| format!("{byte:02X}")).collect();
    format!(
        "[[mission.step]]\nat = \"{at}\"\ndo = {{ inject = {{ link = \"telemetry\", \
         direction = \"to-master\", hex = \"{hex}\" }} }}\n"
    )
}

/// Defects of a robot that an operator drives by hand and sends to poses: it turns the long way
/// (YA-01), drives on when its PC is gone (YS-01) or away from a goal behind it (YA-02), repeats
/// its last message when a scan with a value per degree does not fit (YF-04), and takes two walls
/// for one (YN-01) or one for two, beside its points (YN-05). Each check fails with its defect and
/// passes without it.
#[test]
fn planted_defects_are_found_while_an_operator_drives() {
    let asks = Telecommand {
        lidar_step_deg: Some(1),
        ..Telecommand::default()
    };
    let back = Telecommand {
        state: Some(State::AutoPosition),
        desired_pose: Some(Pose {
            x: 0.3,
            y: 0.6,
            alpha: ANY_HEADING,
        }),
        ..Telecommand::default()
    };
    let scan = injected("8s", &asks);
    let behind = injected("12400ms", &back);
    let gone = "[[mission.step]]\nat = \"7500ms\"\ndo = \"disconnect\"\n";
    let rows = [
        ("turns-short", "YA-01", ""),
        ("rests-after-silence", "YS-01", gone),
        ("sends-in-time", "YF-04", &scan),
        ("turns-short", "YA-02", &behind),
        ("lines-true", "YN-01", ""),
        ("lines-true", "YN-05", ""),
    ];
    let keys = "[expect.safety]\nshort_turns = true\nsends_cyclically = true\n\
        true_telemetry = true\nrests_within = \"1s\"\nsteps_may_wait = true\n[expect]";
    for (name, defect, step) in rows {
        let judged = |defects: &str| {
            let (_, source) = shipped("yellow-hand");
            let program = format!("[program]\ndefects = [{defects}]\n[mission]");
            let text = source.text.replacen("[mission]", &program, 1);
            let text = text.replace("[expect]", &format!("{step}{keys}"));
            let (scenario, source) = Scenario::parse(&source.path, text).expect("sound");
            check(&run_to_end((scenario, source)), name)
        };
        let (with, without) = (judged(&format!("\"{defect}\"")), judged(""));
        assert_eq!(with.status, Status::Fail, "{defect}: {}", with.detail);
        assert_eq!(without.status, Status::Pass, "{defect}: {}", without.detail);
    }
}
