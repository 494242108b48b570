//! Frames that a fault damages on their way to a device are no mistakes of the program; all others
//! are. A run that fails without a failed check names its cause, too.

use crate::conversation::Bench;

/// A slave with registers; two bytes for it get lost, at about 0.3 s and 0.6 s.
const SLAVE: &str = r#"
schema = 1
name = "damaged"
robot = "none"
duration = "4s"

[device.grip.registers]
baud = 115200
register = [{ address = 8, name = "wanted", width = "u8", access = "write" }]

[[fault]]
link = "grip"
direction = "to-device"
kind = "drop"
byte = 100

[[fault]]
link = "grip"
direction = "to-device"
kind = "drop"
byte = 203
"#;

/// Writes the register every 20 ms. The sum at the end of a frame is too large by the first
/// argument; after the second one, a number of seconds, the client ends.
const CLIENT: &str = "\
import os, select, sys, time, tty
fd = os.open(os.environ['HILRIG_PORT_GRIP'], os.O_RDWR | os.O_NOCTTY)
tty.setraw(fd)
wrong, until = int(sys.argv[1]), time.monotonic() + float(sys.argv[2])
head = bytes([0xAB, 8, 0x81, 5])
while time.monotonic() < until:
    os.write(fd, head + (sum(head) + wrong).to_bytes(2, 'little'))
    if select.select([fd], [], [], 0.02)[0]:
        os.read(fd, 99)
    time.sleep(0.02)
";

fn judged(name: &str, more: &str, arguments: &str, options: &[&str]) -> (Option<i32>, String) {
    let bench = Bench::new(name, &format!("{SLAVE}{more}"), CLIENT);
    bench.run(arguments, options)
}

fn cause(said: &str) -> &str {
    let mut lines = said.lines().map(str::trim);
    let cause = lines.find_map(|line| line.strip_prefix("probable cause: "));
    cause.unwrap_or_else(|| panic!("no cause: {said}"))
}

/// The lost bytes are excused; a wrong sum in all frames is not, although faults strike as well.
#[test]
fn lost_bytes_excuse_their_own_frames_alone() {
    let (code, said) = judged("damaged-sound", "", "0 60", &[]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = judged("damaged-wrong", "", "1 60", &[]);
    assert_eq!(code, Some(1), "{said}");
    let told = cause(&said);
    assert!(
        told.starts_with("grip does not understand the received bytes: "),
        "{told}"
    );
    assert!(
        told.contains("times bad-checksum (the first at 0.0"),
        "{told}"
    );
}

/// `violations_max` counts all broken rules: the cause says that the rig damaged the frames.
#[test]
fn a_sound_program_is_not_blamed_for_the_damage_of_the_rig() {
    let most = "[expect]\nviolations_max = 0\n";
    let (code, said) = judged("damaged-strict", most, "0 60", &[]);
    assert_eq!(code, Some(1), "{said}");
    let told = cause(&said);
    assert!(
        told.starts_with("faults damage or delay what grip receives: "),
        "{told}"
    );
}

/// The program ends before a rule comes true that must be observed.
#[test]
fn a_rule_that_was_never_decided_is_the_cause() {
    let rule = "[[expect.rule]]\nname = \"opens\"\neventually = { register = { device = \"grip\", \
                name = \"wanted\", op = \"==\", value = 9 } }\n";
    let (code, said) = judged("damaged-open", rule, "0 1", &["--exec-may-end"]);
    assert_eq!(code, Some(1), "{said}");
    let told = cause(&said);
    assert!(told.contains("rule-opens"), "{told}");
    assert!(
        told.contains("before a rule of the scenario was decided"),
        "{told}"
    );
}

/// Whatever a fault does to the bytes for a device, a sound program passes: the log of the device
/// has few of many like entries, and later times than the fault.
#[test]
fn no_fault_on_the_way_to_a_device_is_a_mistake_of_the_program() {
    let rates = [
        "drop",
        "flip",
        "insert",
        "duplicate",
        "swap",
        "burst",
        "truncate",
    ];
    let rates = rates.map(|kind| format!("kind = \"{kind}\"\nrate = 0.08\n"));
    let lasting = [
        "kind = \"clear-bit7\"\n",
        "kind = \"cr-to-lf\"\n",
        "kind = \"jitter\"\nby = \"50ms\"\n",
        "kind = \"wrong-baud\"\nppm = 40_000\n",
        "kind = \"echo\"\n",
    ];
    let lasting = lasting.map(|kind| format!("{kind}from = \"500ms\"\nuntil = \"2s\"\n"));
    for kind in rates.iter().chain(&lasting) {
        let fault = format!("[[fault]]\nlink = \"grip\"\ndirection = \"to-device\"\n{kind}");
        let (code, said) = judged("damaged-kinds", &fault, "0 60", &[]);
        assert_eq!(code, Some(0), "{kind}: {said}");
    }
}
