//! Comparison of a device with its description: an emulated device never differs from its own
//! description, and each planted difference is reported with its kind and place.

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
