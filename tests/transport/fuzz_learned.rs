//! `hilrig fuzz --exec --corpus`: a driver with a planted bug, of a protocol that the rig does not
//! know, in virtual time.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::support::fresh_path;

const HILRIG: &str = env!("CARGO_BIN_EXE_hilrig");

/// A master: `01 03`, then frames of a head AA, a length, a count, as many values, and the checksum
/// of Modbus over all. It reports a checksum mismatch by an exception.
const DRIVER: &str = r#"
import os, select, tty
port = os.open(os.environ["HILRIG_DIR"] + "/port", os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
class BadFrame(Exception): pass
def crc(data, value=0xFFFF):
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value
def receive(count):
    data = b""
    while len(data) < count:
        if not select.select([port], [], [], 0.3)[0]:
            return None
        data += os.read(port, count - len(data))
    return data
while True:
    os.write(port, b"\x01\x03")
    head = receive(2)
    if head is None:
        continue
    if head[0] != 0xAA:
        raise BadFrame("no head: %r" % head)
    rest = receive(head[1] + 2)
    if rest is None:
        continue
    if crc(head + rest[:-2]) != int.from_bytes(rest[-2:], "little"):
        raise BadFrame("checksum of %s" % rest.hex())
    count = rest[0]
    CHECK
    values = [rest[1 + at] for at in range(count)]
"#;

/// The folder of a search with the driver. `check` is the driver's check of the count.
fn search(name: &str, check: &str, more: &[&str]) -> (PathBuf, Option<i32>, String) {
    let dir = fresh_path(&format!("fuzz-learned-{name}"));
    let frames = dir.join("frames");
    std::fs::create_dir_all(&frames).expect("room");
    std::fs::write(dir.join("driver.py"), DRIVER.replace("CHECK", check)).expect("room");
    let modbus = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);
    for at in 0..6_u8 {
        let mut frame = vec![0xAA, at + 2, at + 1];
        frame.extend((0..=at).map(|value| value.wrapping_mul(37).wrapping_add(at)));
        frame.extend(modbus.checksum(&frame).to_le_bytes());
        std::fs::write(frames.join(format!("{at}.bin")), frame).expect("room");
    }
    let mut command = Command::new(HILRIG);
    let exec = ["fuzz", "--exec", "exec python3 -S driver.py", "--virtual"];
    command
        .args(exec)
        .args(["--corpus", "frames", "--out", "out", "--shrink", "8"]);
    let output = command
        .args(more)
        .current_dir(&dir)
        .output()
        .expect("it starts");
    let [stdout, stderr] = [output.stdout, output.stderr].map(String::from_utf8);
    let said = [stdout, stderr].map(|said| said.expect("the command speaks UTF-8"));
    (dir.join("out"), output.status.code(), said.concat())
}

fn findings(out: &Path) -> Vec<String> {
    let folders = std::fs::read_dir(out.join("findings"));
    let causes = folders.into_iter().flatten().flatten().map(|entry| {
        let cause = std::fs::read_to_string(entry.path().join("cause.txt"));
        let cause = cause.expect("the command wrote it");
        cause.lines().next().unwrap_or_default().to_owned()
    });
    let mut causes: Vec<String> = causes.collect();
    causes.sort();
    causes
}

/// The driver trusts the count. The search finds that through checksum and length, learned from six
/// frames, and minimises it to one reply. An exception raised on purpose is counted and is no
/// finding.
#[test]
fn a_count_that_lies_is_found_through_a_checksum_that_was_learned() {
    let (out, code, said) = search("lies", "pass", &["--cases", "10"]);
    assert_eq!(
        findings(&out),
        ["crash-exit-code-1 IndexError at driver.py:33"],
        "{said}"
    );
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("CRC-16/MODBUS, low byte first, at the end"),
        "{said}"
    );
    assert!(said.contains("8-bit length at byte 1"), "{said}");
    let told = out.join("findings/01-crash-exit-code-1/told.toml");
    let told = std::fs::read_to_string(told).expect("the command wrote it");
    assert_eq!(told.matches("[[raw.turn]]").count(), 1, "{told}");
}

/// The same driver with the missing check. Exceptions that it raises are no findings by default. If
/// the user wants them, all of them are one finding, for any bytes.
#[test]
fn a_driver_that_reports_bad_frames_is_not_found_fault_with() {
    let check = "if count != head[1] - 1: raise BadFrame(\"count\")";
    let (out, code, said) = search("sound", check, &["--cases", "8"]);
    assert_eq!(findings(&out), [""; 0], "{said}");
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("which is no finding: crash-exit-code-1"),
        "{said}"
    );

    let more = ["--cases", "4", "--errors", "always"];
    let (out, code, said) = search("always", check, &more);
    assert_eq!(findings(&out), ["crash-exit-code-1 BadFrame"], "{said}");
    assert_eq!(code, Some(1), "{said}");
}

/// Two searches side by side find it once.
#[test]
fn searches_side_by_side_put_their_findings_together() {
    let (out, code, said) = search("jobs", "pass", &["--cases", "16", "--jobs", "2"]);
    assert_eq!(
        findings(&out),
        ["crash-exit-code-1 IndexError at driver.py:33"],
        "{said}"
    );
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("2 jobs, 16 cases"), "{said}");
}

#[test]
fn a_corpus_without_bytes_is_an_error_that_says_what_is_expected() {
    let more = ["--cases", "1", "--corpus", "nowhere"];
    let dir = fresh_path("fuzz-learned-nowhere");
    std::fs::create_dir_all(&dir).expect("room");
    let mut command = Command::new(HILRIG);
    command
        .args(["fuzz", "--exec", "true", "--virtual"])
        .args(more);
    let output = command.current_dir(&dir).output().expect("it starts");
    let error = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(
        error.starts_with("error: --corpus nowhere: No such file"),
        "{error}"
    );
}

/// A device with frames of a head A5, a length, a body, and the checksum of Modbus over the length
/// and the body. It counts its replies. "sound" ignores damaged requests, "refuses" sends an error
/// for them, and "trusts" answers them.
const DEVICE: &str = r#"
import os, select, sys, tty
port = os.open(os.environ["HILRIG_DIR"] + "/port", os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
def crc(data, value=0xFFFF):
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")
def reply(*body):
    data = bytes([len(body), *body])
    os.write(port, b"\xA5" + data + crc(data))
buffer, count = b"", 0
while True:
    if not select.select([port], [], [], 0.05)[0]:
        buffer = b""
        continue
    buffer += os.read(port, 64)
    while len(buffer) > 1 and len(buffer) >= buffer[1] + 4:
        frame, buffer = buffer[:buffer[1] + 4], buffer[buffer[1] + 4:]
        if crc(frame[1:-2]) != frame[-2:]:
            if sys.argv[1] == "refuses":
                reply(0xFF, 1)
            if sys.argv[1] != "trusts":
                continue
        count = count + 1 & 255
        if len(frame) == 7 and frame[2] == 1:
            reply(0x81, count, *(frame[3] + at & 255 for at in range(frame[4] % 8)))
        else:
            reply(0xFE, 0)
"#;

/// The findings of a search with the device. `names` are those of the requests and of the replies
/// in its corpus.
fn search_device(mode: &str, names: [&str; 2]) -> (Vec<String>, String) {
    let dir = fresh_path(&format!("fuzz-learned-{mode}-{}", names[0]));
    std::fs::create_dir_all(&dir).expect("room");
    std::fs::write(dir.join("device.py"), DEVICE).expect("room");
    let modbus = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);
    let frame = |body: &[u8]| {
        let mut frame = vec![u8::try_from(body.len()).expect("short")];
        frame.extend(body);
        frame.extend(modbus.checksum(&frame).to_le_bytes());
        let pairs = frame.iter().map(|byte| format!(" {byte:02X}"));
        format!("A5{}", pairs.collect::<String>())
    };
    let mut log = String::new();
    for at in 0..24_u8 {
        let size = at % 7 + 1;
        let values = (0..size).map(|value| value.wrapping_mul(29).wrapping_add(at));
        let reply: Vec<u8> = [0x81, at + 1].into_iter().chain(values).collect();
        let told = [frame(&[1, at * 5, size]), frame(&reply)];
        for (name, (told, ms)) in names.iter().zip(told.iter().zip([100, 112])) {
            log += &format!("[12:00:{at:02}.{ms}] {name}: {told}\n");
        }
    }
    std::fs::write(dir.join("field.log"), log).expect("room");
    let exec = format!("exec python3 -S device.py {mode}");
    let output = Command::new(HILRIG)
        .args(["fuzz", "--exec", &exec, "--virtual", "--cases", "2"])
        .args(["--corpus", "field.log", "--out", "out"])
        .current_dir(&dir)
        .output()
        .expect("it starts");
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    (findings(&dir.join("out")), said)
}

/// The search finds out that the program is the device, also if requests and replies of the corpus
/// are swapped. A refusal is no answer.
#[test]
fn a_device_that_answers_damaged_requests_is_found_with_a_corpus_of_either_direction() {
    let requests_first = ["TX", "RX"];
    for names in [requests_first, ["RX", "TX"]] {
        let (found, said) = search_device("trusts", names);
        assert_eq!(found, ["accepts-corrupt-frame port"], "{said}");
        assert!(said.contains("so it is taken as the device"), "{said}");
    }
    for mode in ["sound", "refuses"] {
        let (found, said) = search_device(mode, requests_first);
        assert_eq!(found, [""; 0], "{mode}: {said}");
        assert!(said.contains("they are also sent damaged"), "{said}");
    }
}

/// A servo: 55, address, code, data and a sum. It replies to 01 with 81 and a value.
const SERVO: &str = r#"
name = "servo"
about = "x"
endian = "little"
latency = "1ms"
line = { baud = 57600, address = 1 }
frame = { sync = [0x55], length = { at = 1, type = "u8", counts = "rest" }, checksum = "sum8" }
message = [
  { name = "read", from = "host", fields = [{ name = "id", type = "u8" }, { type = "u8", value = 1 }] },
  { name = "value", from = "device", fields = [{ name = "id", type = "u8" }, { type = "u8", value = 0x81 }, { name = "angle", type = "u16" }] },
]
on = [{ message = "read", when = "id == own_address", reply = "value" }]
[state]
angle = 300
"#;

/// A driver of two servos. On a single wire it hears its own request first. Without six replies in
/// a row it gives up.
const SERVO_DRIVER: &str = r#"
import os, select, sys, time, tty
port = os.open(os.environ["HILRIG_DIR"] + "/bus", os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
def receive(count):
    data = b""
    while len(data) < count and select.select([port], [], [], 0.05)[0]:
        data += os.read(port, count - len(data))
    return data
def summed(data):
    return data + bytes([sum(data) & 255])
missing = 0
while True:
    for servo in 1, 2:
        request = summed(bytes([0x55, 3, servo, 1]))
        os.write(port, request)
        if SINGLE_WIRE and receive(len(request)) != request:
            reply = b""
        else:
            reply = receive(7)
        is_sound = reply[:4] == bytes([0x55, 5, servo, 0x81]) and summed(reply[:-1]) == reply
        missing = 0 if is_sound else missing + 1
        if missing == 6:
            sys.exit("no reply")
        time.sleep(0.05)
        while select.select([port], [], [], 0)[0]:
            os.read(port, 64)
"#;

/// Exit code and output of a search in virtual time with the driver `driver.py` and `bench.toml`.
fn search_in(name: &str, files: &[(&str, &str)], more: &[&str]) -> (PathBuf, Option<i32>, String) {
    let dir = fresh_path(&format!("fuzz-described-{name}"));
    std::fs::create_dir_all(&dir).expect("room");
    for (file, text) in files {
        std::fs::write(dir.join(file), text).expect("room");
    }
    let mut command = Command::new(HILRIG);
    command.args(["fuzz", "--exec", "exec python3 -S driver.py", "--virtual"]);
    command.args(["--scenario", "bench.toml", "--out", "out", "--shrink", "8"]);
    let output = command.args(more).current_dir(&dir).output();
    let output = output.expect("it starts");
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8(said).expect("the command speaks UTF-8");
    (dir.join("out"), output.status.code(), said)
}

/// Two devices on one wire are used as they are described. With the fault `echo` of the scenario,
/// which is the wiring of its bus, a sound driver has no finding, and its echo is no reply.
#[test]
fn devices_on_one_wire_are_used_as_described_also_on_a_single_wire() {
    let bus = "schema = 1\nname = \"bus\"\nrobot = \"none\"\nduration = \"5s\"\n\
               device.bus = { description = [\n\
               { file = \"servo.toml\", name = \"pan\", address = 1 },\n\
               { file = \"servo.toml\", name = \"tilt\", address = 2 },\n] }\n";
    let echo = "[[fault]]\nkind = \"echo\"\nlink = \"bus\"\ndirection = \"to-device\"\n";
    for (name, fault, is_single) in [("wires", "", "False"), ("single", echo, "True")] {
        let driver = SERVO_DRIVER.replace("SINGLE_WIRE", is_single);
        let bench = format!("{bus}{fault}");
        let files = [
            ("servo.toml", SERVO),
            ("bench.toml", &*bench),
            ("driver.py", &*driver),
        ];
        let (out, code, said) = search_in(name, &files, &["--cases", "6"]);
        assert_eq!(findings(&out), [""; 0], "{name}: {said}");
        assert_eq!(code, Some(0), "{name}: {said}");
        assert!(
            said.contains("format: as servo is described; 2 requests with replies"),
            "{name}: {said}"
        );
    }
}

/// Any three bytes are a frame of the device: the search has no noise, says so, and goes on.
#[test]
fn a_format_without_marker_and_checksum_is_fuzzed() {
    let described = SERVO
        .replace("sync = [0x55], length = { at = 1, type = \"u8\", counts = \"rest\" }, checksum = \"sum8\"", "size = 3")
        .replace("{ name = \"id\", type = \"u8\" }, { type = \"u8\", value = 0x81 }", "{ type = \"u8\", value = 0x81 }")
        .replace("{ type = \"u8\", value = 1 }]", "{ type = \"u8\", value = 1 }, { name = \"what\", type = \"u8\" }]");
    let bench = "schema = 1\nname = \"bus\"\nrobot = \"none\"\nduration = \"5s\"\n\
                 device.bus = { description = \"servo.toml\" }\n";
    let driver = "import os, select, tty\n\
                  port = os.open(os.environ[\"HILRIG_DIR\"] + \"/bus\", os.O_RDWR | os.O_NOCTTY)\n\
                  tty.setraw(port)\n\
                  while True:\n    os.write(port, bytes([1, 1, 5]))\n    \
                  if select.select([port], [], [], 0.1)[0]: os.read(port, 3)\n";
    let files = [
        ("servo.toml", &*described),
        ("bench.toml", bench),
        ("driver.py", driver),
    ];
    let (out, code, said) = search_in("any", &files, &["--cases", "4"]);
    assert_eq!(findings(&out), [""; 0], "{said}");
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("bus: any bytes are a frame of its format, so no damaged frames are sent"),
        "{said}"
    );
}
