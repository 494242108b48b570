//! Comparison of a device with its description: an emulated device never differs from its own
//! description, and each planted difference is reported with its kind and place.

use core::time::Duration;
use std::sync::Arc;

use description::conform::{Conformity, Difference, Strictness, conform, emulated};
use description::peer::{Emulated, Peer};
use description::{Description, shipped};
use protocols::Instant;

fn parse(text: &str) -> Arc<Description> {
    let csv = |_: &str| Ok("t,u\n0,1\n1,2\n".to_owned());
    Description::parse("device.toml", text, &csv).unwrap_or_else(|error| panic!("{error}"))
}

/// The result for the device `real` and the description `said`.
fn compared(said: &str, real: &str) -> Conformity {
    let mut device = emulated(&parse(real), 4_711);
    let found = conform(&parse(said), &mut device, Strictness::EMULATED);
    found.expect("an emulated device has no port to lose")
}

fn differences(said: &str, real: &str) -> Vec<Difference> {
    compared(said, real).differences
}

/// Only answered requests are compared: each request of each device is answered at least once.
#[test]
fn no_device_differs_from_its_own_description() {
    let mut wrong = Vec::new();
    for (name, text) in shipped::ALL {
        let found = compared(text, text);
        let differences = found.differences.iter();
        wrong.extend(differences.map(|one| format!("{name}: {one}")));
        // The meter answers this request only after it was called by another request.
        let is_behind = |one: &&String| *name == "iec-62056-21" && *one == "choice";
        let unproved = found.unproved.iter().filter(|one| !is_behind(one));
        wrong.extend(unproved.map(|one| format!("{name}: {one}: never answered")));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A device whose received bytes are kept.
struct Watched {
    peer: Emulated,
    sent: Vec<Vec<u8>>,
}

impl Peer for Watched {
    fn now(&self) -> Instant {
        self.peer.now()
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String> {
        self.sent.push(bytes.to_vec());
        self.peer.send(bytes)
    }

    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
        self.peer.hear(until)
    }
}

/// Without writes, no sent bytes can be taken for a request with an effect, alone or together with
/// the next ones. A part of a frame is among the bytes of most devices.
#[test]
fn without_writes_nothing_that_is_sent_has_an_effect() {
    let strictness = Strictness {
        writes: false,
        ..Strictness::EMULATED
    };
    let mut halves = 0;
    for (name, text) in shipped::ALL {
        let of = parse(text);
        let mut device = Watched {
            peer: emulated(&of, 4_711),
            sent: Vec::new(),
        };
        conform(&of, &mut device, strictness).expect("a device");
        for pair in device.sent.windows(2) {
            assert!(
                of.is_harmless_before(&pair[0], &pair[1]),
                "{name}: {pair:02X?}"
            );
            let is_half = pair[1].len() > 2 && pair[0] == pair[1][..pair[1].len() / 2];
            halves += usize::from(is_half);
        }
    }
    assert!(halves >= 8, "{halves}");
}

/// A device that only listens, and a device that answers no request, are not observed: neither
/// passes.
#[test]
fn a_comparison_of_nothing_is_void() {
    let head = "name = \"sink\"\nabout = \"a sink\"\nline = { baud = 9600 }\n\
                frame = { terminator = \"\\n\" }\n";
    let sink = format!(
        "{head}message = [{{ name = \"go\", from = \"host\", text = \"GO\" }}]\n\
         on = [{{ message = \"go\", set = {{ ready = \"1\" }} }}]\n[state]\nready = {{ initial = 0 }}\n"
    );
    let asked = format!(
        "{head}message = [{{ name = \"go\", from = \"host\", text = \"GO\" }}, {{ name = \"ok\", from \
         = \"device\", text = \"OK\" }}]\non = [{{ message = \"go\", when = \"ready > 0\", reply = \
         \"ok\" }}]\n[state]\nready = {{ initial = 0 }}\n"
    );
    let answers = asked.replace("when = \"ready > 0\", ", "");
    let streams = format!(
        "{head}message = [{{ name = \"ok\", from = \"device\", text = \"OK\" }}]\n\
         every = [{{ period = \"100ms\", send = \"ok\" }}]\n"
    );
    for (text, is_void) in [
        (sink, true),
        (asked, true),
        (answers, false),
        (streams, false),
    ] {
        let found = compared(&text, &text);
        assert_eq!(found.is_void(), is_void, "{text}\n{found:?}");
    }
}

/// Changes of a description, each with the kind and place of the difference that it causes.
type Planted<'a> = (&'a str, &'a str, &'a str, &'a str);

/// Plants each change into the device and checks that its difference is found, and that no other
/// place is reported with the same kind without reason.
fn all_are_named(name: &str, planted: &[Planted<'_>]) {
    let text = shipped::text(name).expect("shipped");
    for (from, to, kind, place) in planted {
        let real = text.replacen(from, to, 1);
        assert_ne!(real, text, "{from} is not in {name}");
        let found = differences(text, &real);
        let told: Vec<String> = found.iter().map(ToString::to_string).collect();
        let is_named = found
            .iter()
            .any(|one| one.kind.name() == *kind && one.place.contains(place));
        assert!(
            is_named,
            "{name} with {to}: {kind} of {place} is not among {told:#?}"
        );
    }
}

#[test]
fn ten_planted_differences_of_a_modbus_device_are_named() {
    all_are_named(
        "modbus-meter",
        &[
            (
                "latency = \"20ms\"",
                "latency = \"45ms\"",
                "latency",
                "read voltage",
            ),
            ("scale = 0.001", "scale = 0.01", "scale", "power_factor"),
            (
                "name = \"voltage\", type = \"f32\"",
                "name = \"voltage\", type = \"f32\", words = \"little\"",
                "byte-order",
                "voltage",
            ),
            (
                "  { at = 7, name = \"frequency\"",
                "  # { at = 7, name = \"frequency\"",
                "refusal",
                "read frequency",
            ),
            (
                "limits = [100, 300] }",
                "limits = [100, 250] }",
                "refusal",
                "write alarm_voltage",
            ),
            (
                "initial = 20261127",
                "initial = 20261128",
                "value",
                "serial_number",
            ),
            (
                "[registers]\n",
                "[registers]\ngaps = true\n",
                "refusal",
                "behind the last one",
            ),
            (
                "name = \"frequency\", unit",
                "name = \"frequency\", endian = \"little\", unit",
                "byte-order",
                "frequency",
            ),
            (
                "{ at = 3, name = \"label\", type = \"str\", size = 8",
                "{ at = 3, name = \"label\", type = \"str\", size = 6",
                "refusal",
                "read label",
            ),
            ("address = 1", "address = 2", "no-reply", "read voltage"),
        ],
    );
}

#[test]
fn planted_differences_of_devices_with_messages_are_named() {
    all_are_named(
        "cobs-sensor",
        &[
            ("latency = \"2ms\"", "latency = \"4ms\"", "latency", "read"),
            (
                "mean = 21, amplitude = 2",
                "mean = 210, amplitude = 20",
                "scale",
                "reading.temperature",
            ),
            (
                "name = \"pressure\", type = \"f32\"",
                "name = \"pressure\", type = \"f32be\"",
                "byte-order",
                "reading.pressure",
            ),
            (
                "limits = [0, 100], unit",
                "limits = [0, 50], unit",
                "value",
                "reading.heater",
            ),
            (
                "checksum = \"CRC-16/IBM-3740\"",
                "checksum = \"CRC-16/XMODEM\"",
                "no-reply",
                "read",
            ),
            (
                "[[on]]\nmessage = \"heat\"",
                "[[on]]\nmessage = \"heat\"\nwhen = \"percent < 50\"",
                "no-reply",
                "heat",
            ),
        ],
    );
    // Registers of a table that messages read.
    all_are_named(
        "dynamixel-xl430",
        &[
            (
                "scale = 0.1, unit = \"V\"",
                "scale = 0.01, unit = \"V\"",
                "scale",
                "voltage",
            ),
            (
                "type = \"u16\", initial = 1060",
                "type = \"u16be\", initial = 1060",
                "byte-order",
                "model",
            ),
            (
                "initial = 2048, limits = [0, 4095]",
                "initial = 1000, limits = [0, 1023]",
                "value",
                "status.error",
            ),
            (
                "latency = \"500us\"",
                "latency = \"3ms\"",
                "latency",
                "read",
            ),
            ("address = 1", "address = 3", "no-reply", "ping"),
        ],
    );
    all_are_named(
        "gps",
        &[
            ("period = \"1s\"", "period = \"2s\"", "period", "gga"),
            (
                "name = \"lat\", type = \"i32\", scale = 1e-7",
                "name = \"lat\", type = \"i32\", scale = 1e-6",
                "scale",
                "posllh.lat",
            ),
        ],
    );
}

/// A lift that reports ten times a second and moves on command: 0.05 m per report.
const LIFT: &str = r#"
name = "lift"
about = "a lift"
endian = "big"
latency = "3ms"
line = { baud = 57600 }

[frame]
stuffing = "slip"
checksum = "CRC-16/XMODEM"

[state]
target = { initial = 0, limits = [0, 12] }
height = { initial = 0 }
spare = { initial = 0 }
load = { source = { noise = { mean = 126, deviation = 1.5, period = "100ms" } } }
moving = { value = "abs(target - height) > 0.005 ? 1 : 0" }

[[message]]
name = "status"
from = "device"
fields = [
  { type = "u8", value = 0x90 },
  { name = "height", type = "i32", scale = 0.0001 },
  { name = "load", type = "f32" },
  { name = "spare", type = "i16" },
  { name = "moving", type = "u8" },
]

[[message]]
name = "move"
from = "host"
fields = [{ type = "u8", value = 0x11 }, { name = "target", type = "i32", scale = 0.0001 }]

[[message]]
name = "ack"
from = "device"
fields = [{ type = "u8", value = 0x91 }]

[[message]]
name = "nak"
from = "device"
fields = [{ type = "u8", value = 0x92 }, { name = "why", type = "u8" }]

[[message]]
name = "fallen"
from = "device"
fields = [{ type = "u8", value = 0x93 }]

[[every]]
period = "100ms"
set = { height = "height + clamp(target - height, -0.05, 0.05)" }
send = "status"

[[on]]
message = "move"
when = "target > 12 || target < 0"
reply = "nak"
with = { why = "1" }

[[on]]
message = "move"
when = "moving"
reply = "nak"
with = { why = "2" }

[[on]]
message = "move"
set = { target = "target" }
reply = "ack"

[[on]]
event = "break"
reply = "fallen"
"#;

/// Devices that obey a command otherwise than described, with the kind and place of the difference.
/// The first is one that acknowledges and never moves.
const DISOBEDIENT: [(&str, &str, &str, &str); 7] = [
    (
        "+ clamp(target - height, -0.05, 0.05)",
        "",
        "value",
        "status.height after move",
    ),
    (
        "+ clamp(target",
        "- clamp(target",
        "value",
        "status.height after move",
    ),
    (
        "-0.05, 0.05)",
        "-0.01, 0.01)",
        "value",
        "status.height after move",
    ),
    (
        "scale = 0.0001 },\n  { name = \"load\"",
        "scale = 0.001 },\n  { name = \"load\"",
        "value",
        "status.height",
    ),
    ("why = \"2\"", "why = \"3\"", "value", "nak.why"),
    (
        "send = \"status\"",
        "send = \"status\"\nwhen = \"moving == 0\"",
        "period",
        "status after move",
    ),
    (
        "period = \"100ms\"\nset",
        "period = \"150ms\"\nset",
        "period",
        "status",
    ),
];

/// The state after a command is compared where unsolicited messages show it, from each height.
#[test]
fn a_device_that_does_not_follow_a_command_differs() {
    for initial in ["0", "2"] {
        let resting = format!("= {{ initial = {initial}");
        let said = LIFT.replace("target = { initial = 0", &format!("target {resting}"));
        let said = said.replace("height = { initial = 0", &format!("height {resting}"));
        assert_eq!(differences(&said, &said), [], "{initial}");
        for (from, to, kind, place) in DISOBEDIENT {
            let real = said.replacen(from, to, 1);
            assert_ne!(real, said, "{from}");
            let found = differences(&said, &real);
            let is_named =
                |one: &Difference| one.kind.name() == kind && one.place.starts_with(place);
            assert!(found.iter().any(is_named), "{initial}, {to}: {found:#?}");
        }
    }
}

/// The parts that no comparison reached are named with the reason.
#[test]
fn parts_that_were_not_compared_are_named() {
    let unseen = compared(LIFT, LIFT).unseen;
    assert_eq!(
        unseen,
        [
            "fallen: the emulated device never sent it",
            "status.spare: was 0 in every message, so its scale and byte order are unknown",
        ]
    );
    // A command whose effect no message shows.
    let text = "name = \"relay\"\nabout = \"a relay\"\nline = { baud = 9600 }\n\
                frame = { terminator = \"\\n\" }\nstate = { is_on = { initial = 0 } }\n\
                message = [{ name = \"on\", from = \"host\", text = \"ON\" }, { name = \"ok\", from \
                = \"device\", text = \"OK\" }]\n\
                on = [{ message = \"on\", set = { is_on = \"1\" }, reply = \"ok\" }]\n";
    assert_eq!(
        compared(text, text).unseen,
        ["on: no message shows the state after it"]
    );
}

/// A port of a busy computer: it holds old messages, and its reader wakes up late.
struct Busy {
    peer: Emulated,
    stored: Vec<(Instant, Vec<u8>)>,
}

impl Peer for Busy {
    fn now(&self) -> Instant {
        self.peer.now()
    }

    fn lateness(&self) -> Duration {
        Duration::from_secs(1)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String> {
        self.peer.send(bytes)
    }

    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
        if let Some(old) = self.stored.pop() {
            return Ok(Some(old));
        }
        let is_asleep = until > self.now() + Duration::from_millis(200);
        let until = if is_asleep {
            until + Duration::from_millis(900)
        } else {
            until
        };
        let Some((start, mut all)) = self.peer.hear(until)? else {
            return Ok(None);
        };
        while let Some((_, piece)) = self.peer.hear(until)?.filter(|_| is_asleep) {
            all.extend(piece);
        }
        Ok(Some((start, all)))
    }
}

/// Messages count over the time that passed: a busy computer causes no difference and hides none.
#[test]
fn a_busy_computer_changes_no_period() {
    let port = Strictness {
        writes: false,
        slack: Duration::from_millis(20),
    };
    for (period, is_same) in [("100ms", true), ("150ms", false), ("60ms", false)] {
        let real = LIFT.replace(
            "period = \"100ms\"\nset",
            &format!("period = \"{period}\"\nset"),
        );
        let mut peer = emulated(&parse(&real), 4_711);
        let mut stored = Vec::new();
        let until = peer.now() + Duration::from_secs(2);
        while let Some(old) = peer.hear(until).expect("a device") {
            stored.insert(0, old);
        }
        let mut busy = Busy { peer, stored };
        let found = conform(&parse(LIFT), &mut busy, port).expect("a device");
        let kinds: Vec<_> = found
            .differences
            .iter()
            .map(|one| one.kind.name())
            .collect();
        let expected: &[&str] = if is_same { &[] } else { &["period"] };
        assert_eq!(kinds, expected, "{period}: {:#?}", found.differences);
        let is_told = found
            .differences
            .iter()
            .all(|one| one.expected.contains("are allowed"));
        assert!(is_told, "{:#?}", found.differences);
    }
}

/// An emulated device answers at any rate. At a port, a device with another line would not.
#[test]
fn another_line_than_the_described_one_is_a_difference() {
    let meter = shipped::text("modbus-meter").expect("shipped");
    let with = |baud: &str, format: &str| {
        let keys = format!("baud = {baud}\nformat = \"{format}\"");
        meter.replace("baud = 9600", &keys)
    };
    let base = with("9600", "8E1");
    for (baud, format, found) in [
        ("19200", "8E1", "19200 baud, 8E1"),
        ("9600", "8N1", "9600 baud, 8N1"),
        ("9600", "8E2", "9600 baud, 8E2"),
    ] {
        let all = differences(&base, &with(baud, format));
        let wanted = format!("line: line: {found}, expected 9600 baud, 8E1");
        assert_eq!(all.first().map(ToString::to_string), Some(wanted));
    }
    assert_eq!(differences(&base, &base), []);
}
