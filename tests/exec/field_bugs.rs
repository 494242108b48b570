//! A bug of a driver at its own device, from a capture to a small case: the device sends status
//! frames by itself, and one of them makes the faulty driver crash.

use std::fs;

use crate::conversation::Bench;

const BENCH: &str = "schema = 1\nname = \"probe\"\nrobot = \"none\"\nduration = \"0.8s\"\n\
    device.probe = { description = \"probe.toml\" }\n";

/// Status frames, of which the fifth has another value; a reply with the same first byte.
const PROBE: &str = r#"
name = "probe"
about = "A probe with a warning"
endian = "big"
latency = "4ms"
line = { baud = 57600, format = "8N1" }
[frame]
stuffing = "hdlc"
checksum = "CRC-16/GENIBUS"
[state]
seq = { initial = 0 }
[[message]]
name = "status"
from = "device"
fields = [{ type = "u8", value = 0x90 }, { name = "seq", type = "u8" }, { name = "warn", type = "u8", calc = "seq == 5 ? 4 : 0" }]
[[message]]
name = "who"
from = "host"
fields = [{ type = "u8", value = 0x12 }, { type = "u8", value = 1 }]
[[message]]
name = "it_is"
from = "device"
fields = [{ type = "u8", value = 0x93 }, { type = "u8", value = 7 }]
[[every]]
period = "100ms"
set = { seq = "seq + 1" }
send = "status"
[[on]]
message = "who"
reply = "it_is"
"#;

/// Asks WAIT seconds after the opening, TIMES times; `faulty` crashes at an unknown warning.
const CLIENT: &str = "\
import os, select, sys, time
wait, mode, times = float(sys.argv[1]), sys.argv[2], int(sys.argv[3])
fd, buf = os.open(os.environ['HILRIG_PORT_PROBE'], os.O_RDWR | os.O_NOCTTY), b''
def frames():
    global buf
    if select.select([fd], [], [], 0.05)[0]:
        buf += os.read(fd, 200)
    *whole, buf = buf.split(b'~')
    for frame in filter(None, whole):
        if len(frame) < 4 or frame[0] not in (0x90, 0x93):
            sys.exit('bad frame ' + frame.hex())
        if frame[0] == 0x90 and mode == 'faulty':
            {0: 'none'}[frame[2]]
        yield frame[0]
def ask():
    os.write(fd, bytes.fromhex('7e120197c07e'))
    end = time.monotonic() + 0.1
    while time.monotonic() < end:
        if 0x93 in list(frames()):
            return
    sys.exit('no answer')
begin = time.monotonic()
while time.monotonic() < begin + wait:
    list(frames())
for _ in range(times):
    ask()
while time.monotonic() < begin + 0.7:
    list(frames())
";

fn exec(words: &str) -> String {
    format!("exec python3 client.py {words}")
}

#[test]
fn a_crash_in_the_field_becomes_a_small_case() {
    let bench = Bench::new("field", BENCH, CLIENT);
    fs::write(bench.0.join("probe.toml"), PROBE).expect("a fresh file");
    let sound = exec("0.25 sound 1");
    let captured = [
        "run",
        "s.toml",
        "--out",
        "out",
        "--virtual",
        "--exec",
        &sound,
    ];
    let (code, said) = bench.hilrig(&[&captured[..], &["--exec-may-end"]].concat());
    assert_eq!(code, Some(0), "{said}");
    // The answer keeps its delay, whenever the driver asks; the same in real time.
    let capture = "out/capture.pcapng";
    let replay = [
        "replay",
        capture,
        "--expect",
        "--exec-may-end",
        "--exec-wait",
        "60s",
    ];
    for (words, more) in [
        ("0 sound 1", "--virtual"),
        ("0.197 sound 1", "--virtual"),
        ("0.5 sound 1", "--virtual"),
        ("0.2 sound 1", "--out=hilrig-out/replay"),
    ] {
        let exec = exec(words);
        let (code, said) = bench.hilrig(&[&replay[..], &["--exec", &exec, more]].concat());
        assert_eq!(code, Some(0), "{words}: {said}");
        assert!(
            said.contains("sent the requests of the capture\n"),
            "{said}"
        );
    }
    // A replay leaves a capture as well, in virtual and in real time.
    for words in [&["--virtual"][..], &[]] {
        let exec = exec("0.1 sound 3");
        let (code, said) = bench.hilrig(&[&replay[..], &["--exec", &exec], words].concat());
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("of the capture, and 2 more\n"), "{said}");
        let played = "hilrig-out/replay/capture.pcapng";
        let (_, said) = bench.hilrig(&["decode", played, "--description", "probe.toml"]);
        let asked = said.matches("to-device @").count() - said.matches("EVENT").count();
        assert!(
            asked == 3 && said.contains("status: seq 5, warn 4"),
            "{said}"
        );
    }
    let faulty = exec("0.25 faulty 1");
    let both = ["--virtual", "--exec", &faulty, "--exec", &sound];
    let from = [
        "case",
        "from",
        capture,
        "--play",
        "conversation",
        "--expect",
        "exits=0",
    ];
    let (_, said) = bench.hilrig(&[&from[..], &["--virtual", "--exec", &faulty]].concat());
    assert!(said.contains("the case is red today"), "{said}");
    let (code, said) = bench.hilrig(&[&["case", "check", "case.toml"][..], &both].concat());
    assert_eq!(code, Some(0), "{said}");
    let crash = "probable cause: the program gave up with exit code 1 at ";
    let words = "; its last words: KeyError: 4\n";
    assert!(said.contains(crash) && said.contains(words), "{said}");
    // Without the answer, each program ends with exit code 1; this is another failure.
    let small = [
        "shrink",
        "case.toml",
        "--out",
        "small",
        "--virtual",
        "--exec",
        &faulty,
    ];
    let (code, said) = bench.hilrig(&[&small[..], &["--sound", &sound]].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("exit code 1: KeyError: 4\n"), "{said}");
    let (code, said) = bench.hilrig(&[&["case", "check", "small/case.toml"][..], &both].concat());
    assert_eq!(code, Some(0), "{said}");
    let kept = fs::read_to_string(bench.0.join("small/case.toml")).expect("written");
    let (all, few) = (
        fs::read_to_string(bench.0.join("case.toml")).expect("written"),
        kept,
    );
    assert!(few.lines().count() < all.lines().count(), "{few}");
    let (code, said) = bench.hilrig(&[&small[..], &["--sound", &faulty]].concat());
    assert!(
        code == Some(2) && said.contains("--sound: fails with the whole case"),
        "{said}"
    );
    let (code, said) = bench.hilrig(&[&["case", "check", capture][..], &both].concat());
    assert!(
        code == Some(2) && said.contains("is a capture; `hilrig case from`"),
        "{said}"
    );
}
