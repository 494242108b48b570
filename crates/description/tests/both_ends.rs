//! Host and device with different frame formats, and times without any action.

use core::time::Duration;
use std::sync::Arc;

use description::{Described, Description, From, Place, Record, Value};
use emulators::device::{Device, next_poll};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Decode as _, Instant};

fn parse(text: &str) -> Arc<Description> {
    let none = |_: &str| Err("no file".to_owned());
    Description::parse("test.toml", text, &none).unwrap_or_else(|error| panic!("{error}"))
}

fn device(text: &str) -> Described {
    let place = Place {
        name: "dev".to_owned(),
        seed: 1,
        address: None,
        is_alone: true,
    };
    Described::new(parse(text), place)
}

fn world() -> World {
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free")
}

/// The output of the device until `millis`.
fn said(device: &mut Described, millis: u64) -> String {
    let (mut world, mut now) = (world(), Instant::ZERO);
    let end = Instant::from_millis(millis);
    let mut out = Vec::new();
    while now < end {
        now = next_poll(device, now, end);
        device.poll(now, &mut world);
        let mut buf = [0; 256];
        let len = device.transmit(Described::UART, &mut buf);
        out.extend_from_slice(&buf[..len]);
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// The host ends its lines with LF, the device ends them with CR LF. Only the host's format applies
/// to the bytes that the device receives, although the device's format comes first.
#[test]
fn a_device_hears_the_formats_of_the_host() {
    let mut device = device(
        r#"
        name = "lines"
        about = "two ends of lines"
        line = { baud = 9600 }
        frame = [{ name = "out", terminator = "\r\n" }, { name = "in", terminator = "\n" }]
        message = [
          { name = "ask", from = "host", frame = "in", text = "?" },
          { name = "ok", from = "device", frame = "out", text = "ok" },
        ]
        on = [{ message = "ask", reply = "ok" }]
        "#,
    );
    device.receive(Described::UART, Instant::from_millis(1), b"?\n");
    assert_eq!(said(&mut device, 100), "ok\r\n");
}

/// Replies without frames, of a device whose requests have markers: a silence ends only the
/// replies.
#[test]
fn a_silence_may_end_the_frames_of_one_end() {
    let mut device = device(
        r#"
        name = "counter"
        about = "replies without a frame"
        endian = "big"
        line = { baud = 9600 }
        frame = [{ name = "in", start = "<", end = ">>" }, { name = "out", silence = 3.5 }]
        message = [
          { name = "get", from = "host", frame = "in", text = "GET" },
          { name = "is", from = "device", frame = "out", fields = [{ name = "n", type = "u16", calc = "0x4142" }] },
        ]
        on = [{ message = "get", reply = "is" }]
        "#,
    );
    device.receive(Described::UART, Instant::from_millis(1), b"<GET>>");
    assert_eq!(said(&mut device, 100), "AB");
}

/// The checksum is 0x0201 ^ 0x0403 = 0x0602, low byte first; the checksum's own two bytes count as
/// 0.
#[test]
fn a_checksum_within_what_it_covers_counts_as_0() {
    let description = parse(
        r#"
        name = "sum"
        about = "a sum in the middle"
        endian = "little"
        line = { baud = 9600 }
        frame = { size = 6, checksum = { algorithm = "xor16", at = 2, to = 0 } }
        message = [{ name = "four", from = "device", fields = [{ name = "n", type = "u8", repeat = 4 }] }]
        every = [{ period = "1s", send = "four" }]
        "#,
    );
    assert_eq!(
        description.frame_of(0, &[1, 2, 3, 4]),
        Some(vec![1, 2, 2, 6, 3, 4])
    );
    // A single value is repeated for each element.
    let mut values = Record::default();
    values.set("n", Value::Int(7));
    let frame = description.frame(&description.messages()[0], &values);
    assert_eq!(frame, Some(vec![7, 7, 0, 0, 7, 7]));
}

/// Timers expire while the device has no power. The device must not request a poll, or time would
/// stop.
#[test]
fn a_device_that_is_off_asks_for_no_poll_until_it_is_back() {
    let mut device = device(
        r#"
        name = "ticks"
        about = "a line each 10 ms"
        watchdog = "50ms"
        line = { baud = 9600 }
        frame = { terminator = "\n" }
        message = [
          { name = "tick", from = "device", text = "t" },
          { name = "hello", from = "host", text = "h" },
        ]
        every = [{ period = "10ms", send = "tick" }]
        on = [{ message = "hello" }]
        "#,
    );
    assert_eq!(said(&mut device, 25), "t\nt\n");
    device.receive(Described::UART, Instant::from_millis(25), b"h\nh");
    device.poll(Instant::from_millis(25), &mut world());
    let off = Instant::from_millis(26);
    device.set_fault(off, "off", None, true);
    device.poll(off, &mut world());
    device.receive(Described::UART, off, b"h\n");
    for millis in [26, 40, 90, 5_000] {
        let now = Instant::from_millis(millis);
        device.poll(now, &mut world());
        assert!(device.poll_at().is_none_or(|at| at > now), "{millis} ms");
    }
    let back = Instant::from_millis(6_000);
    device.set_fault(back, "off", None, false);
    assert_eq!(device.poll_at().map(|at| at.max(back)), Some(back));
}

/// A request immediately after the last byte of a reply, on a half-duplex line. Byte times are
/// rounded down one by one.
#[test]
fn a_request_right_behind_a_reply_is_heard() {
    let mut device = device(
        r#"
        name = "bus"
        about = "half duplex"
        latency = "500us"
        line = { baud = 115200, half_duplex = true }
        frame = { size = 7 }
        message = [
          { name = "ask", from = "host", fields = [{ name = "n", type = "u8" }, { type = "pad", size = 6 }] },
          { name = "is", from = "device", fields = [{ name = "n", type = "u8" }, { type = "pad", size = 6 }] },
        ]
        on = [{ message = "ask", reply = "is" }]
        "#,
    );
    let line = device.description().line();
    let mut world = world();
    let heard = Instant::ZERO + line.bytes_time(7);
    device.receive(Described::UART, heard, b"A\0\0\0\0\0\0");
    let due = heard + Duration::from_micros(500);
    device.poll(heard, &mut world);
    device.poll(due, &mut world);
    let mut buf = [0; 16];
    assert_eq!(device.transmit(Described::UART, &mut buf), 7);
    // The line passes the bytes on one by one, then those of the request.
    let mut now = due;
    for _ in 0..14 {
        now += line.byte_time();
    }
    device.receive(Described::UART, now, b"B\0\0\0\0\0\0");
    device.poll(now, &mut world);
    device.poll(now + Duration::from_micros(500), &mut world);
    assert_eq!(device.transmit(Described::UART, &mut buf), 7);
    assert!(
        device
            .take_events()
            .iter()
            .all(|event| event.rule != "request-before-reply")
    );
    // A request before the end of the reply is lost.
    let early = now + Duration::from_micros(600);
    device.receive(Described::UART, early, b"C\0\0\0\0\0\0");
    device.poll(early, &mut world);
    assert!(
        device
            .take_events()
            .iter()
            .any(|event| event.rule == "request-before-reply")
    );
}

/// A delayed action can read the fields of its message, also in its condition.
#[test]
fn what_is_due_later_sees_its_message() {
    let mut device = device(
        r#"
        name = "later"
        about = "an echo after a while"
        line = { baud = 9600 }
        frame = { terminator = "\n" }
        message = [
          { name = "say", from = "host", text = "say {n:d}" },
          { name = "said", from = "device", text = "said {n:d}" },
        ]
        after = [{ message = "say", delay = "20ms", when = "n > 1", send = "said", with = { n = "n * 2" } }]
        "#,
    );
    device.receive(Described::UART, Instant::from_millis(1), b"say 1\nsay 2\n");
    assert_eq!(said(&mut device, 100), "said 4\n");
}

/// A field that takes the rest fills a frame of known size.
#[test]
fn a_field_takes_the_rest_of_a_frame_of_known_size() {
    let description = parse(
        r#"
        name = "fixed"
        about = "frames of nine bytes"
        line = { baud = 9600 }
        frame = { sync = [0xFF], size = 9, checksum = { algorithm = "lrc", from = 1 } }
        message = [
          { name = "any", from = "both", fields = [{ name = "data", type = "bytes", size = "rest" }] },
        ]
        on = [{ message = "any", reply = "any" }]
        "#,
    );
    let message = &description.messages()[0];
    let values = message.example(&mut |_| 0);
    assert_eq!(values.get("data"), Some(&Value::Bytes(vec![0; 7])));
    assert_eq!(
        description.frame(message, &values),
        Some(vec![0xFF, 0, 0, 0, 0, 0, 0, 0, 0])
    );
}

/// An empty line is a message if the description defines it: a terminal sends it to get a prompt.
#[test]
fn an_empty_line_can_be_a_message() {
    let text = r#"
        name = "prompt"
        about = "lines"
        line = { baud = 9600 }
        frame = [{ name = "in", terminator = "\r" }, { name = "out", terminator = "\r\n> " }]
        message = [
          { name = "enter", from = "host", frame = "in", text = "" },
          { name = "ready", from = "device", frame = "out", text = "ready" },
        ]
        on = [{ message = "enter", reply = "ready" }]
        "#;
    // A message without `frame` has the first format.
    for text in [text, &text.replace(r#"frame = "in", "#, "")] {
        let mut device = device(text);
        device.receive(Described::UART, Instant::from_millis(1), b"\r");
        assert_eq!(said(&mut device, 100), "ready\r\n> ");
    }
}

/// Each end sends lines that fit the other end's format as well: the sender determines the format.
/// If a capture has mixed up its ends, the other formats are tried too.
#[test]
fn a_line_has_the_format_of_the_end_that_sent_it() {
    let description = parse(
        r#"
        name = "lines"
        about = "two ends of lines"
        line = { baud = 9600 }
        frame = [{ name = "in", terminator = "\n" }, { name = "out", terminator = "\r\n" }]
        message = [
          { name = "any", from = "host", frame = "in", text = "{what:s}" },
          { name = "ok", from = "device", frame = "out", text = "ok" },
        ]
        on = [{ message = "any", reply = "ok" }]
        "#,
    );
    let words = |from, bytes: &[u8]| {
        let mut cutter = description.cutter_for(from);
        let frames: Vec<_> = cutter.push(bytes).flatten().collect();
        let words = frames
            .iter()
            .map(|frame| description.words_for(frame, from));
        words.collect::<Vec<_>>()
    };
    assert_eq!(words(From::Device, b"ok\r\n"), ["ok"]);
    assert_eq!(words(From::Host, b"ok\n"), ["any: what \"ok\""]);
    assert_eq!(words(From::Device, b"G0\n"), [""; 0]);
}

/// A telegram of a P1 port: the checksum covers its markers, and a line end stands behind it.
/// CRC-16/ARC of "/a!" by the catalogue's definition, bit by bit.
#[test]
fn a_checksum_can_cover_markers() {
    let description = parse(
        r#"
        name = "p1"
        about = "telegrams"
        line = { baud = 115200 }
        frame = { start = "/", end = "!", tail = 6, closing = "\r\n", checksum = { algorithm = "CRC-16/ARC", encoding = "hex", endian = "big", before = "/", extra = "!" } }
        message = [{ name = "told", from = "device", text = "{what:s}" }]
        every = [{ period = "1s", send = "told" }]
        "#,
    );
    let mut crc = 0_u16;
    for byte in b"/a!" {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0xA001 } else { 0 };
        }
    }
    let frame = description.frame_of(0, b"a").expect("fits");
    assert_eq!(frame, format!("/a!{crc:04X}\r\n").into_bytes());
    let found = |bytes: &[u8]| description.cutter().push(bytes).flatten().count();
    assert_eq!(found(&frame), 1);
    let (sum, _) = frame.split_at(frame.len() - 2);
    assert_eq!(found(&[sum, b"xx"].concat()), 0);
}

/// A long frame of M-Bus (EN 13757-2): 68 L L 68, C, A, CI, sum, 16; digits lowest byte first.
#[test]
fn a_length_can_stand_twice() {
    let description = parse(
        r#"
        name = "m-bus"
        about = "long frames"
        line = { baud = 2400, format = "8E1" }
        frame = { sync = [0x68], length = { at = 1, again = 2, type = "u8", without = 2 }, end = [0x16], checksum = { algorithm = "sum8", from = 4 } }
        message = [{ name = "data", from = "device", fields = [{ type = "u8", value = 0x68 }, { type = "u8", value = 8 }, { name = "serial", type = "bcdle", size = 4 }] }]
        every = [{ period = "1s", send = "data" }]
        "#,
    );
    let mut values = Record::default();
    values.set("serial", Value::Int(12_345_678));
    let message = &description.messages()[0];
    let frame = description.frame(message, &values).expect("fits");
    // The checksum is the low byte of 08 + 78 + 56 + 34 + 12 = 11C.
    let wanted = [0x68, 5, 5, 0x68, 8, 0x78, 0x56, 0x34, 0x12, 0x1C, 0x16];
    assert_eq!(frame, wanted);
    let found = |bytes: &[u8]| description.cutter().push(bytes).flatten().count();
    assert_eq!(found(&frame), 1);
    let mut other = frame.clone();
    other[2] = 6;
    assert_eq!(found(&other), 0);
}

/// The length is in some bits of a field of one byte, or of two; the other bits belong to the
/// message. Frames worked out by hand have 55, the field, the tag, in the reply 07, and the sum of
/// all.
#[test]
fn a_length_may_share_its_field_with_the_message() {
    for (kind, mask, values, ask, tell) in [
        (
            "u8",
            "0x1F",
            ["0x20", "0x40"],
            &[0x55, 0x24, 0x01, 0x7A][..],
            &[0x55, 0x45, 0x01, 0x07, 0xA2][..],
        ),
        (
            "u16be",
            "0x03FF",
            ["0x4000", "0x8400"],
            &[0x55, 0x40, 0x05, 0x01, 0x9B],
            &[0x55, 0x84, 0x06, 0x01, 0x07, 0xE7],
        ),
    ] {
        let [asks, tells] = values;
        let text = format!(
            r#"
            name = "shared"
            about = "a length beside flags"
            line = {{ baud = 9600 }}
            frame = {{ sync = [0x55], length = {{ at = 1, type = "{kind}", mask = {mask}, \
             counts = "frame" }}, checksum = "sum8" }}
            message = [
              {{ name = "ask", from = "host", fields = [{{ type = "{kind}", value = {asks} }}, \
               {{ name = "tag", type = "u8" }}] }},
              {{ name = "tell", from = "device", fields = [{{ type = "{kind}", value = {tells} }}, \
               {{ name = "tag", type = "u8" }}, {{ type = "u8", value = 7 }}] }},
            ]
            on = [{{ message = "ask", reply = "tell" }}]
            "#
        )
        .replace("\\\n", "");
        let of = parse(&text);
        let mut cutter = of.cutter();
        let frame = cutter.push(ask).next().expect("a frame").expect("sound");
        let (message, record) = of.message(&frame, From::Host).expect("known");
        assert_eq!(
            (message.name(), record.get("tag")),
            ("ask", Some(&Value::Int(1)))
        );
        assert_eq!(of.frame(message, &record).as_deref(), Some(ask));
        let (mut device, mut world) = (device(&text), world());
        device.receive(Described::UART, Instant::ZERO, ask);
        let (mut now, end) = (Instant::ZERO, Instant::from_millis(200));
        let mut out = Vec::new();
        while now < end {
            device.poll(now, &mut world);
            let mut buf = [0; 64];
            let len = device.transmit(Described::UART, &mut buf);
            out.extend_from_slice(&buf[..len]);
            now = next_poll(&device, now, end);
        }
        assert_eq!(out, tell, "{kind}");
        let wrong = text.replace(&format!("value = {asks}"), &format!("value = {asks} + 1"));
        let wrong = wrong
            .replace("0x20 + 1", "0x21")
            .replace("0x4000 + 1", "0x4001");
        let none = |_: &str| Err("no file".to_owned());
        let error = Description::parse("test.toml", &wrong, &none).expect_err("bits of the length");
        assert!(
            error.to_string().contains("0 in the bits of the length"),
            "{error}"
        );
    }
}

/// LIN 2.2A: the sum with carry of 4A 55 93 E5 is 19, inverted E6; with the protected identifier A3
/// it is BC, inverted 43. The sync byte 55 belongs to neither.
#[test]
fn a_checksum_of_lin_covers_what_its_name_says() {
    for (name, sum) in [("lin-classic", 0xE6), ("lin-enhanced", 0x43)] {
        let of = parse(&format!(
            "name = \"lin\"\nabout = \"LIN slave\"\nline = {{ baud = 19200 }}\n\
             frame = {{ sync = [0x55], size = 7, checksum = \"{name}\" }}\n\
             message = [{{ name = \"frame\", from = \"device\", fields = [\
             {{ name = \"pid\", type = \"u8\" }}, {{ name = \"data\", type = \"bytes\", size = 4 }}] }}]\n\
             every = [{{ period = \"100ms\", send = \"frame\" }}]\n"
        ));
        let frame = of
            .frame_of(0, &[0xA3, 0x4A, 0x55, 0x93, 0xE5])
            .expect("fits");
        assert_eq!(frame, [0x55, 0xA3, 0x4A, 0x55, 0x93, 0xE5, sum], "{name}");
    }
}
