//! A capture is played to a program as a conversation, and cases made from it fail with a defect
//! and pass without it.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// A meter with two values, of which the second one counts up.
const METER: &str = r#"
schema = 1
name = "meter"
robot = "none"
duration = "6s"
[device.meter.text]
baud = 9600
terminator = "\n"
unknown = "?"
variable = [{ name = "count", source = { counter = "100ms" } }]
command = [{ request = "volts", reply = "230.1 V" }, { request = "watts", reply = "{count} W" }]
"#;

/// Sends questions in turn, and waits a limited time for each answer: DELAY GAP QUESTION,.. TURNS.
/// Without an answer, the client stops for good with `lost` as its fifth word, and repeats the
/// question with `retry`.
const CLIENT: &str = "\
import os, select, sys, time
delay, gap, questions, turns = sys.argv[1:5]
when_lost = sys.argv[5] if len(sys.argv) > 5 else 'exit'
fd = os.open(os.environ['HILRIG_PORT_METER'], os.O_RDWR | os.O_NOCTTY)
patience = float(os.environ.get('PATIENCE', '0.3'))
def ask(question):
    os.write(fd, question.encode() + b'\\n')
    got = b''
    while not got.endswith(b'\\n'):
        if not select.select([fd], [], [], patience)[0]:
            print('no answer to', question, flush=True)
            if when_lost == 'exit':
                sys.exit(1)
            while when_lost == 'lost':
                time.sleep(1)
            return
        got += os.read(fd, 100)
    print(got.decode().strip(), flush=True)
time.sleep(float(delay))
for _ in range(int(turns)):
    for question in questions.split(','):
        ask(question)
        time.sleep(float(gap))
";

/// A folder with a scenario and a client.
pub(crate) struct Bench(pub(crate) PathBuf);

impl Bench {
    pub(crate) fn new(name: &str, scenario: &str, client: &str) -> Self {
        let name = format!("conversation-{name}-{}", std::process::id());
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a fresh folder");
        fs::write(folder.join("s.toml"), scenario).expect("a fresh file");
        fs::write(folder.join("client.py"), client).expect("a fresh file");
        Self(folder)
    }

    /// Exit code and all output.
    pub(crate) fn hilrig(&self, words: &[&str]) -> (Option<i32>, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_hilrig"))
            .current_dir(&self.0)
            .env(
                "PATIENCE",
                if words.contains(&"--virtual") {
                    "0.3"
                } else {
                    "30"
                },
            )
            .args(words)
            .output()
            .expect("the binary is built");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        (
            output.status.code(),
            said + &String::from_utf8_lossy(&output.stderr),
        )
    }

    /// Runs the scenario with the client in virtual time; the capture is in `out`.
    pub(crate) fn run(&self, client: &str, more: &[&str]) -> (Option<i32>, String) {
        let exec = format!("exec python3 client.py {client}");
        let words = [
            "run",
            "s.toml",
            "--out",
            "out",
            "--virtual",
            "--exec",
            &exec,
        ];
        self.hilrig(&[&words[..], more].concat())
    }

    fn replay(&self, client: &str, more: &[&str]) -> (Option<i32>, String) {
        let exec = format!("exec python3 client.py {client}");
        let words = ["replay", "out/capture.pcapng", "--expect", "--exec-may-end"];
        let exec = ["--exec-wait", "60s", "--exec", &exec];
        self.hilrig(&[&words[..], &exec, more].concat())
    }

    /// Whether the case in `file` fails with the broken client and passes with the fixed one.
    fn tells(&self, file: &str, broken: &str, fixed: &str, more: &[&str]) -> (Option<i32>, String) {
        let [broken, fixed] =
            [broken, fixed].map(|words| format!("exec python3 client.py {words}"));
        let words = [
            "case",
            "check",
            file,
            "--virtual",
            "--exec",
            &broken,
            "--exec",
            &fixed,
        ];
        self.hilrig(&[&words[..], more].concat())
    }
}

/// The captured client starts after a second and sends both questions three times. Other clients
/// start at once, start later, are slower, use another order, or send each question twice: they
/// have the same conversation, in both kinds of time.
#[test]
fn a_client_with_another_timing_has_the_same_conversation() {
    let bench = Bench::new("timing", METER, CLIENT);
    let (code, said) = bench.run("1 0.05 volts,watts 3", &["--exec-may-end"]);
    assert_eq!(code, Some(0), "{said}");
    for client in [
        "1 0.05 volts,watts 3",
        "0 0.05 volts,watts 3",
        "4 0.05 volts,watts 3",
        "1 0.7 volts,watts 3",
        "0 0.01 watts,volts 3",
        "0 0.05 volts,volts,watts 3",
    ] {
        let (code, said) = bench.replay(client, &["--virtual"]);
        assert_eq!(code, Some(0), "{client}: {said}");
        assert!(
            said.contains("no divergence: the program sent the requests"),
            "{said}"
        );
    }
    let (code, said) = bench.replay("0.2 0.05 volts,watts 3", &[]);
    assert_eq!(code, Some(0), "real time: {said}");
    // Playback by time fails here: it does not answer a request at once.
    let (code, said) = bench.replay("0 0.05 volts,watts 3", &["--virtual", "--by-time"]);
    assert_eq!(code, Some(1), "{said}");
}

/// One client asks a misspelt question, another one omits a question.
#[test]
fn a_client_that_asks_something_else_is_told_apart_in_words() {
    let bench = Bench::new("parts", METER, CLIENT);
    let (code, said) = bench.run("0.2 0.05 volts,watts 3", &["--exec-may-end"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = bench.replay("1 0.1 volts,wats 3", &["--virtual"]);
    assert_eq!(code, Some(1), "{said}");
    // Byte 9 of the line, from zero: "volts\nwat" is before it.
    let place = "meter to-device, byte 9: expected 0x74, got 0x73";
    let sides = "  expected: text \"watts\\n\"\n  got:      text \"wats\\n\"\n";
    assert!(said.contains(place) && said.contains(sides), "{said}");
    let (code, said) = bench.replay("0 0.05 volts,watts 2", &["--virtual"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("got:      nothing more\n  4 of 6 requests were made"),
        "{said}"
    );
}

/// From 2 s to 3 s no request reaches the meter. One client stops permanently, the other repeats
/// its request. The case from the capture of the first client distinguishes them: with the devices
/// as well as with the capture as partner.
#[test]
fn the_case_of_a_client_that_fell_silent_is_red_until_it_goes_on() {
    let fault = "[[fault]]\nkind = \"cut\"\nlink = \"meter\"\ndirection = \"to-device\"\n\
                 from = \"2s\"\nuntil = \"3s\"\n";
    let bench = Bench::new("silent", &format!("{METER}{fault}"), CLIENT);
    let (broken, fixed) = (
        "0.1 0.1 volts,watts 99 lost",
        "0.1 0.1 volts,watts 99 retry",
    );
    for seed in ["1", "2"] {
        bench.run(broken, &["--seed", seed]);
        for play in ["devices", "conversation"] {
            let exec = format!("exec python3 client.py {broken}");
            let from = [
                "case",
                "from",
                "out/capture.pcapng",
                "--play",
                play,
                "--virtual",
            ];
            let (code, said) = bench.hilrig(&[&from[..], &["--exec", &exec]].concat());
            assert_eq!(code, Some(0), "{said}");
            assert!(
                said.contains("the program sends on meter to the end"),
                "{said}"
            );
            assert!(said.contains("the case is red today"), "{said}");
            assert!(!said.contains("the same bytes"), "{said}");
            let (code, said) = bench.tells("case.toml", broken, fixed, &[]);
            assert_eq!(code, Some(0), "{play}: {said}");
            assert!(
                said.starts_with("red  exec python3") && said.contains("\ngreen  "),
                "{said}"
            );
            assert!(said.contains("FAIL talks-meter"), "{said}");
        }
    }
    // With the clients exchanged, the case reports an error.
    let (code, said) = bench.tells("case.toml", fixed, broken, &[]);
    assert_eq!(code, Some(1), "{said}");
}

/// A base whose 40th answer announces 64 more bytes. One client believes this and is stuck until so
/// many bytes have arrived, although it continues sending requests.
const BASE: &str = r#"
schema = 1
name = "base"
robot = "none"
duration = "4s"
expect = { violations_max = 0 }
[[fault]]
kind = "flip"
link = "base"
direction = "to-master"
byte = 282
bit = 6
[device.base.registers]
baud = 115200
register = [{ address = 4, name = "ahead", width = "u16", initial = 900 }]
"#;

/// Reads a register repeatedly. The register protocol: AB, register, length, data, sum.
const FRAMES: &str = "\
import os, select, sys, time
trusts = sys.argv[1] == 'trusts'
fd = os.open(os.environ['HILRIG_PORT_BASE'], os.O_RDWR | os.O_NOCTTY)
buffer, ahead = bytearray(), None
def pump():
    global ahead
    if select.select([fd], [], [], 0.02)[0]:
        buffer.extend(os.read(fd, 200))
    while len(buffer) >= 3:
        length = buffer[2] & 0x7F
        if buffer[0] != 0xAB or (length > 2 and not trusts):
            del buffer[0]
            continue
        if len(buffer) < 5 + length:
            return
        frame = bytes(buffer[:5 + length])
        if sum(frame[:-2]) & 0xFFFF == frame[-2] | frame[-1] << 8:
            del buffer[:5 + length]
            ahead = frame[3] | frame[4] << 8
        else:
            del buffer[0]
while True:
    request = bytes([0xAB, 4, 2, 0xB1, 0])
    os.write(fd, request)
    ahead, begin = None, time.monotonic()
    while ahead is None and time.monotonic() - begin < 0.1:
        pump()
    if ahead is None and trusts:
        # In a hurry: two requests at once, against the rules of the base.
        os.write(fd, request + request)
    time.sleep(0.02)
";

#[test]
fn the_case_of_a_parser_that_trusts_a_length_is_red_until_it_does_not() {
    let bench = Bench::new("length", BASE, FRAMES);
    let (code, said) = bench.run("trusts", &[]);
    assert_eq!(code, Some(1), "{said}");
    let exec = ["--virtual", "--exec", "exec python3 client.py trusts"];
    let from = ["case", "from", "out/capture.pcapng"];
    let (code, said) = bench.hilrig(&[&from[..], &exec].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("failed in the captured run: violations"),
        "{said}"
    );
    let (code, said) = bench.tells("case.toml", "trusts", "checks", &[]);
    assert_eq!(code, Some(0), "{said}");
    // The capture alone shows it, too: the damaged frame changes the program's behaviour.
    let damage = ["--play", "conversation", "--expect", "ignores-damage"];
    let (code, said) = bench.hilrig(&[&from[..], &exec, &damage].concat());
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = bench.tells("case.toml", "trusts", "checks", &[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("FAIL ignores-damage-base"), "{said}");
}

/// A scanner that sends a line of 38 bytes every 10 ms. A client that does not read for 1.5 s loses
/// bytes: a port holds only 4,095. One client exits with an error at the cut line that follows.
#[test]
fn the_case_of_a_client_that_dies_of_an_overflow_is_red_until_it_does_not() {
    let scanner = "schema = 1\nname = \"scan\"\nrobot = \"none\"\nduration = \"3s\"\n\
        [device.scan.text]\nbaud = 115200\nterminator = \"\\n\"\n\
        periodic = { line = \"scan=0123456789,0123456789,0123456789\", period = \"10ms\" }\n\
        [[device.scan.text.command]]\nrequest = \"stop\"\nreply = \"stopped\"\n";
    let client = "import os, sys, time\n\
        fd = os.open(os.environ['HILRIG_PORT_SCAN'], os.O_RDWR | os.O_NOCTTY)\n\
        buffer, lines = b'', 0\n\
        while True:\n    \
            buffer += os.read(fd, 4096)\n    \
            *whole, buffer = buffer.split(b'\\n')\n    \
            print(len(whole), flush=True)\n    \
            for line in whole:\n        \
                lines += 1\n        \
                if len(line) != 37 and sys.argv[1] == 'dies' and lines > 1:\n            \
                    sys.exit(3)\n    \
            if lines > 99 and lines < 1000:\n        \
                time.sleep(1.5)\n        \
                lines += 1000\n";
    let bench = Bench::new("overflow", scanner, client);
    let (code, said) = bench.run("dies", &[]);
    assert_eq!(code, Some(1), "{said}");
    for play in ["devices", "conversation"] {
        let from = [
            "case",
            "from",
            "out/capture.pcapng",
            "--play",
            play,
            "--virtual",
        ];
        let exec = ["--exec", "exec python3 client.py dies"];
        let (code, said) = bench.hilrig(&[&from[..], &exec].concat());
        assert_eq!(code, Some(0), "{said}");
        let (code, said) = bench.tells("case.toml", "dies", "lives", &[]);
        assert_eq!(code, Some(0), "{play}: {said}");
    }
}

/// Rules given by a person, and a reference program.
#[test]
fn what_is_right_is_said_by_rules_or_by_a_reference() {
    let bench = Bench::new("rules", METER, CLIENT);
    let sound = "0.2 0.05 volts,watts 3";
    let (code, said) = bench.run(sound, &["--exec-may-end"]);
    assert_eq!(code, Some(0), "{said}");
    let from = |words: &[&str], client: &str| {
        let exec = format!("exec python3 client.py {client}");
        let from = [
            "case",
            "from",
            "out/capture.pcapng",
            "--play",
            "conversation",
        ];
        let exec = ["--virtual", "--exec-may-end", "--exec", &exec];
        bench.hilrig(&[&from[..], words, &exec].concat()).1
    };
    for (rule, color) in [
        ("prints=230.1", "green"),
        ("prints=231", "red"),
        ("never-prints=no answer", "green"),
        ("exits=0", "green"),
        ("exits=1", "red"),
        ("sends=meter:766F6C74730A", "green"),
        ("never-sends=766F6C74730A", "red"),
        ("recovers=300ms", "green"),
        ("recovers=20ms", "red"),
    ] {
        let said = from(&["--expect", rule], sound);
        assert!(
            said.contains(&format!("the case is {color} today")),
            "{rule}: {said}"
        );
    }
    let said = from(&[], sound);
    assert!(said.contains("nothing else: define"), "{said}");
    let reference = format!("exec python3 client.py {sound}");
    let said = from(&["--sound", &reference], "0.2 0.05 volts,volts 3");
    assert!(said.contains("the case is red today"), "{said}");
    assert!(said.contains("FAIL prints-as-reference"), "{said}");
    // The case stores that the program may end.
    for more in [&["--exec-may-end"][..], &[]] {
        let (code, said) = bench.tells("case.toml", "0.2 0.05 watts 6", sound, more);
        assert_eq!(code, Some(0), "{more:?}: {said}");
    }
}

/// The command in report, JUnit file and output repeats the same bytes.
#[test]
fn the_command_that_repeats_a_failure_repeats_it() {
    let bench = Bench::new("again", METER, CLIENT);
    let (code, said) = bench.run("0.2 0.05 volts,amps 9", &["--call-cost", "7us"]);
    assert_eq!(code, Some(1), "{said}");
    let trace = |said: &str| {
        let line = said.lines().find(|line| line.contains("  trace "));
        line.expect("each run says it").to_owned()
    };
    let exec = "exec python3 client.py 0.2 0.05 volts,amps 9";
    let again = format!("hilrig run out/case.toml --exec '{exec}' --virtual --call-cost 7us");
    let report = fs::read_to_string(bench.0.join("out/report.html")).expect("written");
    assert!(report.contains(&again.replace('\'', "&#39;")), "{again}");
    let junit = fs::read_to_string(bench.0.join("out/junit.xml")).expect("written");
    assert!(
        junit.contains(&format!("again: {again}").replace('\'', "&apos;")),
        "{junit}"
    );
    let words = ["run", "out/case.toml", "--out", "second", "--virtual"];
    let (_, second) = bench.hilrig(&[&words[..], &["--call-cost", "7us", "--exec", exec]].concat());
    assert_eq!(trace(&second), trace(&said));
}
