//! A described master and a described device on one line: values arrive, and each kind of wrong
//! reply is reported by its rule.

use core::time::Duration;
use std::sync::Arc;

use description::master::{Master, MasterPlan};
use description::{Described, Description, Place, shipped};
use emulators::device::{Device, earliest};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Instant, Port};

fn parse(text: &str) -> Arc<Description> {
    let nothing = |_: &str| Err("no file".to_owned());
    Description::parse("device", text, &nothing).unwrap_or_else(|error| panic!("{error}"))
}

fn plan(requests: &[&str]) -> MasterPlan {
    MasterPlan {
        requests: requests.iter().map(|&request| request.to_owned()).collect(),
        period: Duration::from_millis(200),
        timeout: Duration::from_millis(100),
    }
}

/// Runs both ends of a line for five seconds; `alter` changes the bytes of the device.
fn run(master: &mut Master, device: &mut Described, alter: fn(usize, u8) -> u8) {
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    let mut world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
    let line = device.line_config(Port(0));
    // Bytes on their way to the device and to the master, and when each line is free.
    let mut lines = [Vec::new(), Vec::new()];
    let mut free_at = [Instant::ZERO; 2];
    let (mut now, end, mut count) = (Instant::ZERO, Instant::from_secs(5), 0);
    while now < end {
        master.poll(now, &mut world);
        device.poll(now, &mut world);
        let mut buf = [0; 64];
        for (index, ends) in [(0, &mut *master as &mut dyn Device), (1, device)] {
            let len = ends.transmit(Port(0), &mut buf);
            for byte in &buf[..len] {
                free_at[index] = free_at[index].max(now) + line.byte_time();
                let byte = match index {
                    1 => alter(count, *byte),
                    _ => *byte,
                };
                count += index;
                lines[index].push((free_at[index], byte));
            }
        }
        let arrivals = lines.iter().flatten().map(|(at, _)| Some(*at));
        let polls = [master.poll_at(), device.poll_at()];
        let next = earliest(arrivals.chain(polls)).unwrap_or(end);
        now = next.max(now + Duration::from_micros(1)).min(end);
        for (at, byte) in lines[0].extract_if(.., |(at, _)| *at <= now) {
            device.receive(Port(0), at, &[byte]);
        }
        for (at, byte) in lines[1].extract_if(.., |(at, _)| *at <= now) {
            master.receive(Port(0), at, &[byte]);
        }
    }
}

fn device(text: &str) -> Described {
    let place = Place {
        name: "meter".to_owned(),
        seed: 1,
        address: None,
        is_alone: true,
    };
    Described::new(parse(text), place)
}

const SENSOR: &str = r#"
name = "sensor"
about = "A sensor"
line = { baud = 9600 }
frame = { sync = [0x55], length = { at = 1, type = "u8" }, checksum = "sum8" }
state = { level = { initial = 40 } }
message = [
  { name = "get", from = "host", fields = [{ type = "u8", value = 1 }] },
  { name = "level", from = "device", fields = [{ type = "u8", value = 2 }, { name = "level", type = "u8" }] },
]
on = [{ message = "get", reply = "level" }]
"#;

/// The rules that the device breaks in the view of the master, each once or more.
#[test]
fn each_wrong_reply_is_reported_by_its_rule() {
    let meter = shipped::text("modbus-meter").expect("shipped");
    let slow = SENSOR.replace("line =", "latency = \"150ms\"\nline =");
    let silent = SENSOR.replace(
        "reply = \"level\" }",
        "when = \"level == 0\", reply = \"level\" }",
    );
    let other = SENSOR.replace("value = 2", "value = 3");
    let none: fn(usize, u8) -> u8 = |_, byte| byte;
    type Case<'a> = (
        &'a str,
        &'a str,
        &'a str,
        fn(usize, u8) -> u8,
        &'a [&'a str],
    );
    let cases: [Case<'_>; 6] = [
        (SENSOR, SENSOR, "get", none, &[]),
        (SENSOR, &slow, "get", none, &["no-reply"]),
        (SENSOR, &silent, "get", none, &["no-reply"]),
        (SENSOR, &other, "get", none, &["no-reply", "unknown-reply"]),
        (
            SENSOR,
            SENSOR,
            "get",
            |at, byte| byte ^ u8::from(at == 3),
            &["bad-checksum", "no-reply"],
        ),
        (meter, meter, "read input 60000 1", none, &["refused"]),
    ];
    for (said, real, request, alter, wanted) in cases {
        let mut master = Master::new(parse(said), &plan(&[request])).expect("a request");
        run(&mut master, &mut device(real), alter);
        let rules = master.broken_rules().expect("a log");
        let mut rules: Vec<&str> = rules.iter().map(|(rule, _)| rule).collect();
        rules.sort_unstable();
        assert_eq!(rules, wanted, "{request}\n{real}");
    }
}

/// A Modbus master reads each value and writes one.
#[test]
fn values_are_read_and_written() {
    let text = shipped::text("modbus-meter").expect("shipped");
    let plan = plan(&["read", "write alarm_voltage=251"]);
    let mut master = Master::new(parse(text), &plan).expect("requests");
    let mut meter = device(text);
    run(&mut master, &mut meter, |_, byte| byte);
    let rules: Vec<_> = master.broken_rules().expect("a log").iter().collect();
    assert_eq!(rules, []);
    let value = |name: &str| {
        let mut values = master.values().iter();
        values
            .find(|(known, ..)| known == name)
            .map(|(_, value, _)| value.clone())
    };
    assert_eq!(
        value("alarm_voltage").and_then(|value| value.as_f64()),
        Some(251.0)
    );
    assert!(
        value("voltage")
            .and_then(|value| value.as_f64())
            .is_some_and(|v| v > 200.0)
    );
}

#[test]
fn a_wrong_request_is_refused_with_its_index() {
    let requests = plan(&["get", "set level=3"]);
    let error = Master::new(parse(SENSOR), &requests).err().expect("wrong");
    assert_eq!(error.0, 1);
    assert!(
        error.1.contains("there is no message \"set\""),
        "{}",
        error.1
    );
    assert!(Master::new(parse(SENSOR), &plan(&[])).is_err());
}

/// A sensor answers a request, and sends the same message again, or another one without a request.
/// A message that the device also sends by itself is not reported.
#[test]
fn a_reply_that_was_not_asked_for_is_reported() {
    let other = "{ name = \"other\", from = \"device\", fields = [{ type = \"u8\", value = 3 }] },\n]\non =";
    let known = SENSOR.replace("]\non =", other);
    let twice = known.replace("reply = \"level\"", "reply = [\"level\", \"level\"]");
    let then_other = known.replace("reply = \"level\"", "reply = [\"level\", \"other\"]");
    let first_other = known.replace("reply = \"level\"", "reply = [\"other\", \"level\"]");
    let by_itself = format!("{known}every = [{{ period = \"70ms\", send = \"other\" }}]\n");
    let is_both = format!("{known}every = [{{ period = \"70ms\", send = \"level\" }}]\n");
    for (said, real, wanted) in [
        (&known, &known, &[][..]),
        (&known, &twice, &["unasked-reply"]),
        (&known, &then_other, &["unasked-reply"]),
        (&known, &first_other, &["unknown-reply"]),
        (&by_itself, &by_itself, &[]),
        (&by_itself, &then_other, &[]),
        (&is_both, &twice, &[]),
        // A reply of several messages.
        (&twice, &twice, &[]),
        (&then_other, &then_other, &[]),
        (&first_other, &first_other, &[]),
        (&then_other, &known, &[]),
        (&then_other, &twice, &["unasked-reply"]),
    ] {
        let mut master = Master::new(parse(said), &plan(&["get"])).expect("a request");
        run(&mut master, &mut device(real), |_, byte| byte);
        let rules = master.broken_rules().expect("a log");
        let rules: Vec<&str> = rules.iter().map(|(rule, _)| rule).collect();
        assert_eq!(rules, wanted, "{real}");
    }
}

/// A register of the device's own cannot be written, in whatever table it lies: nothing is sent to
/// another table.
#[test]
fn a_write_to_a_read_only_register_is_refused() {
    let text = "name = \"x\"\nabout = \"x\"\nprotocol = \"modbus-rtu\"\nline = { baud = 9600 }\n\
        [registers]\ninput = [{ at = 0, name = \"rpm\", initial = 5 }]\n\
        discrete = [{ at = 0, name = \"door\" }]\ncoils = [{ at = 0, name = \"motor\" }, { at = 1, name \
        = \"lock\", access = \"read\" }]\nholding = [{ at = 0, name = \"speed\" }, { at = 1, name = \
        \"serial\", access = \"read\" }]\n";
    let of = parse(text);
    for name in ["rpm", "door", "lock", "serial"] {
        let error = of
            .requests(&["write", &format!("{name}=1")])
            .expect_err("refused");
        let wanted = format!(
            "the register \"{name}\" is read-only, expected one of: motor, speed; `read {name}` reads it"
        );
        assert_eq!(error, wanted);
    }
    assert_eq!(
        of.requests(&["write", "motor=1", "speed=2"])
            .map(|all| all.len()),
        Ok(2)
    );
}
