//! Behaviour of a described device that uses every feature, and of several devices on one wire.

use core::time::Duration;
use std::sync::Arc;

use description::wire::Wire;
use description::{Described, Description, From, Place, Record, Value, shipped};
use emulators::device::{Device, next_poll};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Decode as _, Instant};

const EVERYTHING: &str = include_str!("data/everything.toml");

fn described(text: &str) -> Arc<Description> {
    let csv = |_: &str| Ok("t,u\n0,1\n1,2\n".to_owned());
    Description::parse("test.toml", text, &csv).unwrap_or_else(|error| panic!("{error}"))
}

fn unit(description: &Arc<Description>, name: &str, address: u32) -> (String, Described) {
    let place = Place {
        name: name.to_owned(),
        seed: 1,
        address: Some(address),
        is_alone: false,
    };
    (name.to_owned(), Described::new(description.clone(), place))
}

/// A driver at the other end of an ideal line.
struct Driver {
    wire: Wire,
    description: Arc<Description>,
    world: World,
    now: Instant,
}

impl Driver {
    fn new(text: &str, addresses: &[u32]) -> Self {
        let description = described(text);
        let units = addresses
            .iter()
            .map(|at| unit(&description, &format!("d{at}"), *at));
        let wire = Wire::new(units.collect()).expect("devices");
        let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
        let now = Instant::ZERO;
        Self {
            wire,
            description,
            world,
            now,
        }
    }

    fn listen(&mut self, millis: u64) -> Vec<u8> {
        let end = self.now + Duration::from_millis(millis);
        let mut out = Vec::new();
        while self.now < end {
            self.now = next_poll(&self.wire, self.now, end);
            self.wire.poll(self.now, &mut self.world);
            let mut buf = [0; 512];
            let len = self.wire.transmit(Described::UART, &mut buf);
            out.extend_from_slice(&buf[..len]);
        }
        out
    }

    fn send(&mut self, bytes: &[u8]) {
        let line = self.description.line();
        self.now += line.bytes_time(bytes.len() as u64);
        self.wire.receive(Described::UART, self.now, bytes);
    }

    /// Sends a message; returns the device's frames within 60 ms, in words.
    fn say(&mut self, message: &str, fields: &[(&str, Value)]) -> Vec<String> {
        let known = self.description.messages().iter();
        let message = known
            .into_iter()
            .find(|known| known.name() == message)
            .expect("a message");
        let mut values = Record::default();
        for (name, value) in fields {
            values.set(name, value.clone());
        }
        let frame = self.description.frame(message, &values).expect("fits");
        self.send(&frame);
        self.words(60)
    }

    fn words(&mut self, millis: u64) -> Vec<String> {
        let bytes = self.listen(millis);
        let mut cutter = self.description.cutter();
        let frames: Vec<_> = cutter.push(&bytes).flatten().collect();
        let words = frames.iter().map(|frame| {
            let (message, values) = self
                .description
                .message(frame, From::Device)
                .expect("known");
            message.words(&values)
        });
        words.collect()
    }

    fn rules(&mut self) -> Vec<&'static str> {
        self.wire
            .take_events()
            .into_iter()
            .map(|event| event.rule)
            .collect()
    }
}

fn int(value: i128) -> Value {
    Value::Int(value)
}

/// Every kind of entry once: a start, a refusal, registers read and written, a mode with a periodic
/// report, a delay, a bad frame, an unexpected message, a watchdog.
#[test]
fn a_device_does_what_its_description_says() {
    let mut driver = Driver::new(EVERYTHING, &[5]);
    // 10 ms of start, then 5 ms later the report of `[[after]]`, with its text.
    assert_eq!(driver.words(14), [""; 0]);
    assert_eq!(
        driver.words(10),
        ["report: level 1.5 bar, mode 0, label \"hello\""]
    );
    // 1060 is 0x0424, low byte first; the flags are those of the calculation.
    let read = |start, count| [("start", int(start)), ("count", int(count))];
    assert_eq!(
        driver.say("read", &read(0, 2)),
        ["data: flags ready, count 2, bytes [24 04]"]
    );
    assert_eq!(driver.say("read", &read(0, 17)), ["error: code 7"]);
    assert_eq!(driver.rules(), ["out-of-range", "too-many"]);
    // A goal of 100 counts, 50 degrees; then a goal beyond its limits, and an address without
    // register.
    let write = |start, data: &[u8]| [("start", int(start)), ("data", Value::Bytes(data.to_vec()))];
    assert_eq!(
        driver.say("write", &write(8, &[100, 0, 0, 0])),
        ["error: code 0"]
    );
    assert_eq!(
        driver.say("read", &read(8, 4)),
        ["data: flags ready, count 4, bytes [64 00 00 00]"]
    );
    assert_eq!(
        driver.say("write", &write(8, &[0, 0, 1, 0])),
        ["error: code 2"]
    );
    assert_eq!(driver.say("write", &write(0, &[1])), ["error: code 2"]);
    assert_eq!(driver.say("write", &write(4, &[1])), ["error: code 2"]);
    assert_eq!(driver.rules(), ["write-read-only", "unknown-register"]);
    // Mode 1 sends a report after 50 ms, and each second from 110 ms on.
    assert_eq!(
        driver.say("set_mode", &[("to", int(1))]),
        ["report: level 1.5 bar, mode 1, label \"plain\""]
    );
    // In the meantime the watchdog has set the safe level.
    let words = driver.words(1_200);
    assert_eq!(words, ["report: level 0 bar, mode 1, label \"plain\""]);
    // The second value beyond its limits within a second is logged with its count.
    assert_eq!(driver.rules(), ["made-safe", "out-of-range"]);
    // A bad checksum of the header.
    driver.send(&[0xFF, 0xFE, 1, 0, 9, 0]);
    assert_eq!(driver.words(40), ["error: code 1"]);
    assert_eq!(driver.rules(), ["bad-checksum"]);
}

/// Three devices on one wire, one of them without power: it does not answer its requests; the
/// others continue.
#[test]
fn devices_share_a_wire() {
    let meter = shipped::text("modbus-meter").expect("shipped");
    let mut driver = Driver::new(meter, &[1, 2, 3]);
    let ask = |driver: &mut Driver, address: u8| {
        let frame = driver
            .description
            .frame_of(0, &[address, 4, 0, 10, 0, 2])
            .expect("fits");
        driver.send(&frame);
        driver.listen(100)
    };
    for address in [1, 2, 3] {
        assert_eq!(ask(&mut driver, address)[..3], [address, 4, 4]);
    }
    assert!(driver.wire.known_faults().contains(&"d2.off"));
    let now = driver.now;
    driver.wire.set_fault(now, "d2.off", None, true);
    assert!(ask(&mut driver, 2).is_empty());
    assert_eq!(ask(&mut driver, 3)[0], 3);
    driver.wire.set_fault(driver.now, "d2.off", None, false);
    assert_eq!(ask(&mut driver, 2)[0], 2);
    assert!(ask(&mut driver, 9).is_empty());

    let description = described(meter);
    let twins = [unit(&description, "a", 1), unit(&description, "b", 1)];
    let error = Wire::new(twins.into()).err().expect("twins").0;
    assert_eq!(
        error,
        "\"b\" and \"a\" have the address 1, expected one for each"
    );
}

/// A driver that asks for an address that no device of the link has gets no answer; this must be
/// reported. The devices are a Modbus slave, a servo with messages, and a module that ignores
/// messages for others. Each is tested alone and with others on the wire, of which one is off. A
/// broadcast asks no address. The checksums are those of the documents: CRC by `frame_of`, servo
/// ID+LEN+.. inverted, module the sum of all bytes.
#[test]
fn a_request_for_no_address_of_the_link_is_counted_once() {
    let modbus = |address: u8| {
        let meter = described(shipped::text("modbus-meter").expect("shipped"));
        meter.frame_of(0, &[address, 4, 0, 10, 0, 2]).expect("fits")
    };
    let servo = |id: u8| {
        let sum = 2_u8.wrapping_add(1).wrapping_add(id);
        vec![0xFF, 0xFF, id, 2, 1, !sum]
    };
    let module = |id: u8| {
        let body = [id, 6, 1, 0, 0, 0, 0, 0];
        [&body[..], &[body.iter().sum()]].concat()
    };
    type Ask<'a> = &'a dyn Fn(u8) -> Vec<u8>;
    let kinds: [(&str, Ask<'_>, u8); 3] = [
        ("modbus-meter", &modbus, 0),
        ("feetech-sts3215", &servo, 254),
        ("tmcl", &module, 1),
    ];
    for (kind, ask, to_all) in kinds {
        let text = shipped::text(kind).expect("shipped");
        for (addresses, known) in [(&[1][..], "1"), (&[1, 2], "1, 2"), (&[1, 2, 3], "1, 2, 3")] {
            let mut driver = Driver::new(text, addresses);
            if addresses.len() == 1 {
                let description = described(text);
                let place = Place {
                    name: "d1".to_owned(),
                    seed: 1,
                    address: None,
                    is_alone: true,
                };
                let alone = ("d1".to_owned(), Described::new(description, place));
                driver.wire = Wire::new(vec![alone]).expect("a device");
            } else {
                driver.wire.set_fault(driver.now, "d2.off", None, true);
                driver.listen(1);
                assert_eq!(driver.rules(), ["off"]);
            }
            let asked = addresses
                .iter()
                .map(|own| u8::try_from(*own).expect("small"));
            for address in asked.chain([to_all]) {
                driver.send(&ask(address));
                driver.listen(200);
            }
            assert_eq!(driver.rules(), [""; 0], "{kind} {addresses:?}");
            for _ in 0..5 {
                driver.send(&ask(9));
                assert!(driver.listen(200).is_empty());
            }
            let counts = driver.wire.broken_rules().expect("a count").iter();
            assert_eq!(counts.collect::<Vec<_>>(), [("wrong-address", 5)], "{kind}");
            let first = &driver.wire.take_events()[0].detail;
            let wanted = format!("asked address 9, which no device of this link has ({known})");
            assert_eq!(*first, wanted, "{kind}");
        }
    }
}

/// Three kinds of devices on one wire. `set` (1) is for the pot, which allows 0 to 100. The lamp
/// knows `set` with other limits, the fan does not know it. A frame for one device breaks no rule
/// of another one. A frame that no device knows, or with a wrong checksum, breaks one rule.
#[test]
fn a_frame_for_one_device_breaks_no_rule_of_another() {
    let kind = |name: &str, code: u8, most: u8| {
        let text = format!(
            r#"name = "{name}"
about = "a device on a shared wire"
line = {{ baud = 9600, address = 1 }}
[frame]
size = 4
checksum = "sum8"
[[message]]
name = "set"
from = "host"
fields = [
  {{ name = "id", type = "u8" }},
  {{ type = "u8", value = {code} }},
  {{ name = "level", type = "u8", limits = [0, {most}] }},
]
[state]
level = 0
[[on]]
message = "*"
when = "id != own_address"
[[on]]
message = "set"
set = {{ level = "level" }}
"#
        );
        described(&text)
    };
    let kinds = [
        ("pot", 7, kind("pot", 1, 100)),
        ("lamp", 8, kind("lamp", 1, 1)),
        ("fan", 9, kind("fan", 2, 100)),
    ];
    let units = kinds.iter().map(|(name, at, kind)| unit(kind, name, *at));
    let mut driver = Driver::new(shipped::text("modbus-meter").expect("shipped"), &[1]);
    driver.wire = Wire::new(units.collect()).expect("devices");
    let sums = |bytes: [u8; 3], off: u8| {
        let sum = bytes.iter().fold(off, |sum, byte| sum.wrapping_add(*byte));
        [bytes[0], bytes[1], bytes[2], sum]
    };
    for (bytes, off, rules) in [
        // For the pot, within its limits and beyond the lamp's.
        ([7, 1, 50], 0, &[][..]),
        ([9, 2, 50], 0, &[]),
        // For no device.
        ([3, 1, 50], 0, &["wrong-address"]),
        ([7, 1, 101], 0, &["out-of-range"]),
        ([8, 1, 2], 0, &["out-of-range"]),
        ([7, 5, 0], 0, &["unknown-message"]),
        ([7, 1, 50], 1, &["bad-checksum"]),
    ] {
        driver.send(&sums(bytes, off));
        driver.listen(20);
        assert_eq!(driver.rules(), rules, "{bytes:?}");
    }
    let at = |name: &str| {
        let values = driver.wire.values(driver.now, &driver.world);
        values
            .into_iter()
            .find(|row| row.1 == name)
            .map(|row| row.2)
    };
    assert_eq!(at("pot.level"), Some(Value::Int(101)));
    assert_eq!(at("lamp.level"), Some(Value::Int(2)));
}

/// A Modbus ASCII request in the form of the serial line specification, its LRC by hand: the sum of
/// 01 04 00 0A 00 02 is 0x11, and 0x100 - 0x11 is 0xEF.
#[test]
fn a_modbus_device_speaks_ascii() {
    let meter = shipped::text("modbus-meter").expect("shipped");
    let ascii = meter
        .replace("modbus-rtu", "modbus-ascii")
        .replace("baud = 9600", "baud = 9600\nformat = \"7E1\"");
    let mut driver = Driver::new(&ascii, &[1]);
    driver.send(b":0104000A0002EF\r\n");
    // The value is 0x01352907; the sum of 01 04 04 01 35 29 07 is 0x6F.
    assert_eq!(driver.listen(100), b":0104040135290791\r\n");
    driver.send(b":0104000A0002EE\r\n");
    assert!(driver.listen(100).is_empty());
    assert_eq!(driver.rules(), ["bad-checksum"]);
}

/// A copy of a device continues like the original, as checkpoints require.
#[test]
fn a_copy_goes_on_alike() {
    let mut driver = Driver::new(EVERYTHING, &[5]);
    driver.listen(300);
    let mut copy = Driver {
        wire: driver.wire.clone(),
        description: driver.description.clone(),
        world: driver.world.clone(),
        now: driver.now,
    };
    let sent = driver.say("set_mode", &[("to", int(1))]);
    assert_eq!(copy.say("set_mode", &[("to", int(1))]), sent);
    assert_eq!(copy.listen(3_000), driver.listen(3_000));
}

/// A camera that takes frames of seven bytes behind FF, and a relay that takes five behind 55.
fn camera_and_relay() -> Driver {
    let kind = |name: &str, frame: &str, fields: &str| {
        described(&format!(
            "name = \"{name}\"\nabout = \"on a shared wire\"\nendian = \"big\"\n\
             line = {{ baud = 9600, address = 1 }}\nframe = {{ {frame} }}\n[state]\nlevel = 0\n[[message]]\nname = \"set\"\nfrom = \"host\"\n\
             fields = [{{ name = \"id\", type = \"u8\" }}, {{ type = \"u8\", value = 1 }}, {fields}]\n\
             [[on]]\nmessage = \"set\"\nset = {{ level = \"level\" }}\n"
        ))
    };
    let long = "sync = [0xFF], size = 7, checksum = { algorithm = \"sum8\", from = 1 }";
    let camera = "{ name = \"level\", type = \"u16\" }, { name = \"more\", type = \"u8\" }";
    let camera = kind("camera", long, camera);
    let relay = kind(
        "relay",
        "sync = [0x55], size = 5, checksum = \"xor\"",
        "{ name = \"level\", type = \"u8\" }",
    );
    let mut driver = Driver::new(shipped::text("modbus-meter").expect("shipped"), &[1]);
    let units = [unit(&camera, "camera", 1), unit(&relay, "relay", 2)];
    driver.wire = Wire::new(units.into()).expect("devices");
    driver
}

/// The byte that begins a frame of one device lies anywhere in a frame of the other one, which the
/// other one knows: no rule is broken, whatever pause follows.
#[test]
fn bytes_of_a_known_frame_are_no_error_for_the_other_devices() {
    let camera = |level: [u8; 2], more: u8| {
        let body = [1, 1, level[0], level[1], more];
        let sum = body.iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
        [&[0xFF][..], &body, &[sum]].concat()
    };
    let frames = [
        camera([0x55, 3], 4),
        camera([0, 0x55], 9),
        camera([1, 2], 0x55),
        // The checksum is the byte that begins a frame of the relay.
        camera([0x50, 0], 3),
        camera([0x55, 0x55], 0x55),
        // The relay's frame contains FF.
        vec![0x55, 2, 1, 0xFF, 0x55 ^ 2 ^ 1 ^ 0xFF],
    ];
    for pause in [0, 1, 12, 100] {
        for order in 0..frames.len() {
            let mut driver = camera_and_relay();
            for turn in 0..3 * frames.len() {
                driver.send(&frames[(turn * (order + 1) + order) % frames.len()]);
                driver.listen(pause);
            }
            driver.listen(3_000);
            assert_eq!(driver.rules(), [""; 0], "{pause} {order}");
        }
    }
    // Bytes that no device knows are an error, once.
    let mut damaged = camera([0, 3], 4);
    damaged[6] ^= 1;
    for (bytes, rules) in [
        (damaged, &["bad-checksum"][..]),
        (vec![0x55, 2, 1, 9], &["frame-cut-off"]),
        (vec![0x55, 2, 9, 9, 0x55 ^ 2], &["unknown-message"]),
    ] {
        let mut driver = camera_and_relay();
        driver.send(&frames[0]);
        driver.send(&bytes);
        driver.listen(3_000);
        assert_eq!(driver.rules(), rules, "{bytes:02X?}");
    }
}

/// A log condenses violations that follow one another. Their number is that of the violations, also
/// with several devices on a wire.
#[test]
fn devices_on_one_wire_count_each_violation() {
    let mut driver = camera_and_relay();
    for _ in 0..25 {
        driver.send(&[0x55, 2, 1, 7, 0]);
        driver.listen(200);
    }
    let counts = |driver: &Driver| {
        let all = driver.wire.broken_rules().expect("a count").iter();
        all.collect::<Vec<_>>()
    };
    assert_eq!(counts(&driver), [("bad-checksum", 25)]);
    assert!(driver.rules().len() < 10);
    // Violations of both devices, and notes, which do not count.
    driver.send(&[0x55, 2, 2, 7, 0x55 ^ 2 ^ 2 ^ 7]);
    driver.listen(100);
    driver.send(&[0xFF, 1, 1, 0, 3, 4, 0]);
    driver.listen(1_000);
    driver
        .wire
        .set_fault(driver.now, "relay.restart", None, true);
    driver.listen(1_000);
    let wanted = [("bad-checksum", 26), ("unknown-message", 1)];
    assert_eq!(counts(&driver), wanted);
    let (moments, lost) = driver.wire.broken_rules().expect("a count").since(0);
    assert_eq!((moments.count() > 27, lost), (true, 0));
}

/// A receiver that waits for the first byte of a frame logs no byte before it. The bytes are
/// counted until a frame comes, also a frame of another device on the wire.
#[test]
fn bytes_without_any_frame_are_counted() {
    let mut driver = camera_and_relay();
    assert_eq!(driver.wire.unframed(), 0);
    driver.send(&[0x54, 2, 2, 7]);
    driver.listen(200);
    assert_eq!((driver.wire.unframed(), driver.rules().len()), (4, 0));
    driver.send(&[0x55, 2, 2, 7, 0x55 ^ 2 ^ 2 ^ 7]);
    driver.listen(200);
    assert_eq!(driver.wire.unframed(), 0);
}

/// A line without an end is one violation, however long it is and however it is delivered, and its
/// rest is no message. The text of a long line is shortened.
#[test]
fn a_line_without_an_end_is_one_violation() {
    let of = "name = \"motor\"\nabout = \"Lines\"\nline = { baud = 19200 }\nframe.terminator = \"\\r\\n\"\n\
              message = [{ name = \"get\", from = \"host\", text = \"G\" }, { name = \"ok\", from = \
              \"device\", text = \"OK\" }]\non = [{ message = \"get\", reply = \"ok\" }]\n";
    for size in [1, 7, 600, 3_002, 4_000] {
        for end in ["\r\n", ""] {
            let mut driver = Driver::new(of, &[1]);
            let long = format!("{}{end}", "x".repeat(3_000));
            for piece in long.as_bytes().chunks(size) {
                driver.send(piece);
                driver.listen(1);
            }
            driver.listen(if end.is_empty() { 3_000 } else { 0 });
            driver.send(b"G\r\n");
            assert_eq!(driver.listen(100), b"OK\r\n", "{size} {end:?}");
            let events = driver.wire.take_events();
            let rules: Vec<_> = events.iter().map(|event| event.rule).collect();
            assert_eq!(rules, ["bad-length"], "{size} {end:?}");
        }
    }
    let mut driver = Driver::new(of, &[1]);
    driver.send(format!("{}\r\n", "x".repeat(900)).as_bytes());
    driver.listen(100);
    let events = driver.wire.take_events();
    assert_eq!(events[0].rule, "unknown-message");
    let detail = &events[0].detail;
    assert!(
        detail.len() < 300 && detail.contains("characters)"),
        "{detail}"
    );
}
