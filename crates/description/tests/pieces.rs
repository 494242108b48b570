//! A device behaves the same whether its bytes arrive in one delivery, in one for each byte, or in
//! several that are processed together.

use core::time::Duration;
use std::sync::Arc;

use description::{Described, Description, Place};
use emulators::device::{Device, next_poll};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::Instant;

/// A device with a message that restarts it. A read is 55 01 sum, a reset 55 02 sum.
fn description(half_duplex: bool, boot: &str, latency: &str) -> Arc<Description> {
    let text = format!(
        r#"
        name = "restarting"
        about = "x"
        latency = "{latency}"
        {boot}
        line = {{ baud = 9600, half_duplex = {half_duplex} }}
        frame = {{ sync = [0x55], size = 3, checksum = "sum8" }}
        state = {{ count = 0 }}
        message = [
          {{ name = "read", from = "host", fields = [{{ type = "u8", value = 1 }}] }},
          {{ name = "reset", from = "host", fields = [{{ type = "u8", value = 2 }}] }},
          {{ name = "value", from = "device", fields = [{{ name = "count", type = "u8" }}] }},
        ]
        on = [
          {{ message = "read", set = {{ count = "count + 1" }}, reply = "value" }},
          {{ message = "reset", restart = true }},
        ]
        after = [{{ message = "read", delay = "3ms", set = {{ count = "count + 16" }} }}]
        "#
    );
    let found = Description::parse("restarting", &text, &|_| Err("no file".to_owned()));
    found.unwrap_or_else(|error| panic!("{error}"))
}

const READ: [u8; 3] = [0x55, 0x01, 0x56];
const RESET: [u8; 3] = [0x55, 0x02, 0x57];

/// The deliveries of bytes that follow each other without a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Deliveries {
    One,
    /// One for each byte, each followed by a poll.
    Each,
    /// One for each byte, and a poll after the last one.
    Together,
}

type Outcome = (Vec<u8>, Vec<(&'static str, u64)>);

/// A device on a wire of its own, in an empty world.
fn alone(description: &Arc<Description>) -> (Described, World) {
    let place = Place {
        name: "x".to_owned(),
        seed: 1,
        address: None,
        is_alone: true,
    };
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
    (Described::new(description.clone(), place), world)
}

/// The bytes that the device sends, and the rules that it sees broken.
fn outcome(description: &Arc<Description>, bytes: &[u8], deliveries: Deliveries) -> Outcome {
    let (mut device, mut world) = alone(description);
    let line = description.line();
    let mut sent = Vec::new();
    let mut now = Instant::ZERO;
    // A line takes a byte when it is free.
    let mut free = Instant::ZERO;
    let mut pass = |device: &mut Described, end: Instant| {
        while now < end {
            let soonest = now + Duration::from_nanos(1);
            now = next_poll(device, now, end);
            if device.may_send(Described::UART) {
                now = now.min(free.max(soonest));
            }
            device.poll(now, &mut world);
            let mut buf = [0; 1];
            if free <= now && device.transmit(Described::UART, &mut buf) > 0 {
                sent.push(buf[0]);
                free = now + line.byte_time();
            }
        }
    };
    let end = Instant::from_millis(100) + line.bytes_time(bytes.len() as u64);
    pass(&mut device, Instant::from_millis(100));
    if deliveries == Deliveries::One {
        pass(&mut device, end);
        device.receive(Described::UART, end, bytes);
    } else {
        for (at, byte) in bytes.iter().enumerate() {
            let ends = line.byte_end(end, (bytes.len() - 1 - at) as u64);
            if deliveries == Deliveries::Each {
                pass(&mut device, ends);
            }
            device.receive(Described::UART, ends, &[*byte]);
        }
    }
    pass(&mut device, Instant::from_millis(500));
    // What arrives afterwards shows the state.
    device.receive(Described::UART, Instant::from_millis(500), &READ);
    pass(&mut device, Instant::from_millis(600));
    let rules = device
        .broken_rules()
        .map_or_else(Vec::new, |rules| rules.iter().collect());
    (sent, rules)
}

#[test]
fn the_number_of_deliveries_changes_nothing() {
    let streams: [&[&[u8]]; 8] = [
        &[&RESET, &READ],
        &[&READ, &RESET, &READ],
        &[&READ, &READ, &READ, &READ],
        &[&RESET, &RESET[..2], &READ],
        &[&READ[..2], &READ],
        &[&READ, &READ[..2]],
        &[&RESET, &[0x55, 0x01, 0x00], &READ, &READ],
        &[&READ, &[0xFF; 20], &READ, &RESET, &READ[..1]],
    ];
    let mut found = Vec::new();
    for half_duplex in [false, true] {
        for boot in ["", "boot = \"2ms\"", "boot = \"20ms\""] {
            for latency in ["0ms", "1ms", "30ms"] {
                let description = description(half_duplex, boot, latency);
                for stream in streams {
                    let bytes = stream.concat();
                    let [one, each, together] =
                        [Deliveries::One, Deliveries::Each, Deliveries::Together]
                            .map(|deliveries| outcome(&description, &bytes, deliveries));
                    let case = format!("{half_duplex} {boot} {latency} {bytes:02X?}");
                    assert_eq!(one, each, "{case}");
                    assert_eq!(together, each, "{case}");
                    found.push(one);
                }
            }
        }
    }
    let rules = found
        .iter()
        .flat_map(|(_, rules)| rules.iter().map(|(rule, _)| *rule));
    let rules: std::collections::BTreeSet<&str> = rules.collect();
    assert!(
        rules.contains("not-ready") && rules.contains("request-before-reply"),
        "{rules:?}"
    );
}

/// An action that is due before a silence ends a request comes first, whenever the device is
/// polled: the reply has the value that the action sets.
#[test]
fn an_action_before_the_end_of_a_silence_comes_first() {
    let begin = "name = \"late\"\nabout = \"x\"\nlatency = \"1ms\"\nline = { baud = 9600, address = 1 }\n\
                 every = [{ period = \"1s\", first = \"102ms\", set = { a = 7 } }]\n";
    // The request ends at 100 ms, its silence of 3.5 bytes 3.6 ms later.
    let cases: [(&str, &[u8], &[u8]); 2] = [
        (
            "protocol = \"modbus-rtu\"\n[registers]\nholding = [{ at = 0, name = \"a\" }]",
            &[0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0A],
            &[0x01, 0x03, 0x02, 0x00, 0x07],
        ),
        (
            r#"
            frame = { silence = 3.5, checksum = "sum8" }
            state = { a = 0 }
            message = [
              { name = "read", from = "host", fields = [{ type = "u8", value = 1 }] },
              { name = "value", from = "device", fields = [{ name = "a", type = "u8" }] },
            ]
            on = [{ message = "read", reply = "value" }]
            "#,
            &[0x01, 0x01],
            &[0x07, 0x07],
        ),
    ];
    for (text, request, reply) in cases {
        let text = format!("{begin}{text}");
        let description = Description::parse("late", &text, &|_| Err("no file".to_owned()));
        let description = description.unwrap_or_else(|error| panic!("{error}"));
        for polls in [&[101, 102, 103, 104, 105, 106, 110, 120][..], &[110, 120]] {
            let (mut device, mut world) = alone(&description);
            device.poll(Instant::from_millis(90), &mut world);
            device.receive(Described::UART, Instant::from_millis(100), request);
            for at in polls {
                device.poll(Instant::from_millis(*at), &mut world);
            }
            let mut sent = [0; 64];
            let len = device.transmit(Described::UART, &mut sent);
            assert!(
                sent[..len].starts_with(reply),
                "{polls:?}: {:02X?}",
                &sent[..len]
            );
        }
    }
}

/// Keys that do nothing without another one are errors with file, line and key; with the other key
/// they are not.
#[test]
fn keys_without_effect_are_refused() {
    let text = |top: &str, frame: &str, rest: &str| {
        format!(
            "name = \"x\"\nabout = \"x\"\nendian = \"little\"\nline = {{ baud = 9600 }}\n{top}\n\
             frame = {{ {frame} }}\nmessage = [{{ name = \"q\", from = \"host\", fields = [{{ type = \"u8\", \
             value = 1 }}] }}, {{ name = \"r\", from = \"device\", fields = [{{ type = \"u8\", value = 2 }}, {{ \
             name = \"t\", type = \"u16\" }}] }}]\n[[on]]\nmessage = \"q\"\nreply = \"r\"\n{rest}\n"
        )
    };
    let (slip, summed) = (
        "stuffing = \"slip\"",
        "stuffing = \"slip\", checksum = \"sum8\"",
    );
    let (t, safe) = ("state.t = 1", "state.t = { initial = 1, safe = 0 }");
    let watched = format!("watchdog = \"1s\"\n{t}");
    let watched_safe = format!("watchdog = \"1s\"\n{safe}");
    let event = "[[on]]\nevent = \"watchdog\"\nreply = \"r\"";
    let refused = "[[on]]\nevent = \"refused\"\nreply = \"r\"";
    let sum = "[faults.sum]\nbad_checksum = true";
    let noise = "[faults.noise]\ngarbage = 5";
    let restarted = "[faults.noise]\ngarbage = 5\nrestart = true";
    for (text, key) in [
        (
            text(t, slip, sum),
            "12: faults.sum.bad_checksum: has no effect",
        ),
        (text(t, summed, sum), ""),
        (
            text(t, slip, noise),
            "12: faults.noise.garbage: has no effect without a restart",
        ),
        (text(t, slip, restarted), ""),
        (
            text(t, slip, event),
            "12: on[1].event: never happens without a watchdog",
        ),
        (text(&watched, slip, event), ""),
        (text(t, slip, refused), "12: on[1].event: never happens"),
        (
            text(safe, slip, ""),
            "5: state.t.safe: has no effect without a watchdog",
        ),
        (text(&watched_safe, slip, ""), ""),
    ] {
        let found = Description::parse("x.toml", &text, &|_| Err(String::new()));
        let error = found
            .err()
            .map(|error| error.to_string())
            .unwrap_or_default();
        let is_wanted = error.contains(&format!("x.toml:{key}")) || key == error;
        assert!(is_wanted && error.lines().count() <= 2, "{error}\n{text}");
    }
    for (key, value) in [
        ("start", "[2]"),
        ("tail", "1"),
        ("closing", "[0x16]"),
        ("head", "2"),
        ("at", "1"),
    ] {
        let frame = "sync = [1], length = { at = 1, type = \"u8\", counts = \"payload\" }";
        let text = text(t, &format!("{frame}, {key} = {value}"), "");
        let error = Description::parse("x.toml", &text, &|_| Err(String::new()));
        let error = error.expect_err(key).to_string();
        let wanted = format!("x.toml:6: frame.{key}: has no effect");
        assert!(error.contains(&wanted), "{error}");
    }
    let registers = "name = \"x\"\nabout = \"x\"\nprotocol = \"modbus-rtu\"\nline = { baud = 9600 }\n\
        [registers]\nholding = [{ at = 0, name = \"a\", safe = 0 }]\n";
    let error = Description::parse("x.toml", registers, &|_| Err(String::new()));
    let error = error
        .err()
        .map(|error| error.to_string())
        .unwrap_or_default();
    assert!(
        error.contains("x.toml:6: registers.holding[0].safe: has no effect"),
        "{error}"
    );
}
