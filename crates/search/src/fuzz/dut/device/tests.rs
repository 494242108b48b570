use std::collections::{BTreeMap, BTreeSet};

use description::{Described, Place, shipped};
use emulators::device::{BrokenRules, Device, Event};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Instant, LineConfig, Port};

use super::super::super::engine::Fuzzer;
use super::*;

fn parse_of(name: &str, text: &str) -> Arc<Description> {
    let found = Description::parse(name, text, &|_| Err("no file".to_owned()));
    found.unwrap_or_else(|error| panic!("{error}"))
}

/// Shipped descriptions without a request that gets a reply: their devices only send.
const SENDERS: [&str; 3] = ["crsf", "ld14p", "ve-direct"];

/// No law is broken by any shipped description, and each one with a request gets a reply.
#[test]
fn shipped_devices_keep_the_laws() {
    let (mut broken, mut behaviours, mut silent) = (Vec::new(), 0, Vec::new());
    for (name, text) in shipped::ALL {
        let description = parse_of(name, text);
        let subject = match DescribedDevice::emulated(&description, "hilrig".to_owned()) {
            Ok(subject) => subject,
            Err(error) => {
                assert!(error.ends_with(FUZZ_DRIVER), "{error}");
                silent.push(*name);
                continue;
            }
        };
        let mut fuzzer = Fuzzer::new(&subject, 1, 0, BTreeMap::new());
        let found = fuzzer.round(24, 1).found;
        behaviours += fuzzer.behaviours();
        broken.extend(found.into_iter().map(|found| {
            let words = subject.in_words(&found.choices);
            format!(
                "{name}: {}: {}\n{words}",
                found.fault.cause, found.fault.detail
            )
        }));
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    assert!(behaviours > 100, "{behaviours}");
    assert_eq!(silent, SENDERS);
}

/// Alters a delivery; the first argument is all bytes received before.
type Alter = fn(&[u8], Vec<u8>) -> Vec<u8>;

/// A device with a defect in its receiver or its transmitter.
struct Defective {
    device: Described,
    alter: Alter,
    /// Alters each byte that it sends.
    send: fn(u8) -> u8,
    before: Vec<u8>,
}

impl Device for Defective {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        let altered = (self.alter)(&self.before, bytes.to_vec());
        self.before.extend(bytes);
        if !altered.is_empty() {
            self.device.receive(port, now, &altered);
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.device.poll(now, world);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        let len = self.device.transmit(port, buf);
        buf[..len]
            .iter_mut()
            .for_each(|byte| *byte = (self.send)(*byte));
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        self.device.poll_at()
    }

    fn line_config(&self, port: Port) -> LineConfig {
        self.device.line_config(port)
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.device.take_events()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        self.device.broken_rules()
    }
}

fn defective(description: &Arc<Description>, alter: Alter) -> Emulated {
    sending(description, alter, |byte| byte)
}

fn sending(description: &Arc<Description>, alter: Alter, send: fn(u8) -> u8) -> Emulated {
    let place = Place {
        name: "defective".to_owned(),
        seed: SEED,
        address: None,
        is_alone: true,
    };
    let device = Defective {
        device: Described::new(description.clone(), place),
        alter,
        send,
        before: Vec::new(),
    };
    Emulated::new(Box::new(device), Described::UART)
}

/// CRC-16 of a Modbus frame, bit by bit as its specification computes it.
fn crc(bytes: &[u8]) -> [u8; 2] {
    let crc = bytes.iter().fold(0xFFFF, |crc, byte| crc_step(crc, *byte));
    crc.to_le_bytes()
}

fn crc_step(crc: u16, byte: u8) -> u16 {
    (0..8).fold(crc ^ u16::from(byte), |crc, _| match crc & 1 {
        1 => crc >> 1 ^ 0xA001,
        _ => crc >> 1,
    })
}

/// A device that does not verify the checksum.
fn trusts(_: &[u8], mut bytes: Vec<u8>) -> Vec<u8> {
    if let Some(len) = bytes.len().checked_sub(2).filter(|len| *len > 2) {
        let sum = crc(&bytes[..len]);
        bytes[len..].copy_from_slice(&sum);
    }
    bytes
}

/// A device that hangs for good after a read of 100 registers or more.
fn hangs(before: &[u8], mut bytes: Vec<u8>) -> Vec<u8> {
    let is_long = |part: &[u8]| matches!(part[1], 3 | 4) && part[4..6] >= [0, 100][..];
    let all = [before, &bytes].concat();
    if all
        .windows(8)
        .any(|part| is_long(part) && part[6..] == crc(&part[..6]))
    {
        bytes.clear();
    }
    bytes
}

/// A device that loses a delivery of a single byte.
fn loses_single_bytes(_: &[u8], mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.len() == 1 {
        bytes.clear();
    }
    bytes
}

/// Each law is found broken in a device with the defect, in virtual time.
#[test]
fn each_law_is_seen_broken() {
    let description = parse_of(
        "modbus-meter",
        shipped::text("modbus-meter").expect("shipped"),
    );
    let cases: [(Alter, &str); 3] = [
        (trusts, "damage-is-not-answered"),
        (hangs, "answers-again"),
        (loses_single_bytes, "pieces-change-nothing"),
    ];
    for (alter, law) in cases {
        let of = description.clone();
        let make: Make = Box::new(move || Ok(defective(&of, alter)));
        let subject = DescribedDevice::new(&description, make, "hilrig".to_owned()).expect("made");
        let mut fuzzer = Fuzzer::new(&subject, 1, 0, BTreeMap::new());
        let mut found = (0..16).flat_map(|_| fuzzer.round(64, 1).found);
        let found = found.find(|found| found.fault.cause == law);
        let found = found.unwrap_or_else(|| panic!("{law} not found"));
        let kept = subject.keep(&found.choices, &found.fault, &mut Effort::tries(100));
        let text = String::from_utf8(kept.files[0].1.clone()).expect("text");
        assert_eq!(parse(&text).expect("inputs").len(), 1, "{text}");
        let again = subject.repeated(&text).expect("inputs");
        assert_eq!(again.map_err(|fault| fault.cause), Err(law.to_owned()));
    }
}

/// A device with one request, 55 01 56, and one reply, 55 81 D6.
fn ping(from: &str) -> Arc<Description> {
    parse_of(
        "ping",
        &format!(
            r#"
            name = "ping"
            about = "x"
            latency = "5ms"
            line = {{ baud = 9600 }}
            frame = {{ sync = [0x55], size = 3, checksum = "sum8" }}
            message = [
              {{ name = "ask", from = "{from}", fields = [{{ type = "u8", value = 1 }}] }},
              {{ name = "answer", from = "device", fields = [{{ type = "u8", value = 0x81 }}] }},
            ]
            {}
            "#,
            match from {
                "host" => "on = [{ message = \"ask\", reply = \"answer\" }]",
                _ => "every = [{ period = \"1s\", send = [\"answer\"] }]",
            }
        ),
    )
}

/// A reply that is no message of the description is found, also when its inputs are sent again.
#[test]
fn a_reply_that_is_not_described_is_found_again() {
    let description = ping("host");
    let of = description.clone();
    // 55 82 D7 has a correct checksum.
    let send = |byte| match byte {
        0x81 | 0xD6 => byte + 1,
        byte => byte,
    };
    let make: Make = Box::new(move || Ok(sending(&of, |_, bytes| bytes, send)));
    let subject = DescribedDevice::new(&description, make, "hilrig".to_owned()).expect("made");
    let again = subject
        .repeated("# request\n55 01 56\nidle\n")
        .expect("inputs");
    let law = again.map_err(|fault| fault.cause);
    assert_eq!(law, Err("replies-are-described".to_owned()));
}

/// A device whose only message answers requests, damaged frames and refused accesses keeps the
/// laws. One that also sends it each second is rejected: a reply cannot be recognised.
#[test]
fn one_message_may_answer_requests_and_report_errors() {
    let text = |more: &str| {
        format!(
            r#"
            name = "one-status"
            about = "x"
            latency = "5ms"
            line = {{ baud = 9600, address = 7 }}
            frame = {{ sync = [0x55], size = 5, checksum = "sum8" }}
            message = [
              {{ name = "read", from = "host", fields = [{{ name = "id", type = "u8" }}, {{ name = "at", type = "u8" }}, {{ type = "u8", value = 1 }}] }},
              {{ name = "clear", from = "host", fields = [{{ name = "id", type = "u8" }}, {{ name = "at", type = "u8" }}, {{ type = "u8", value = 2 }}] }},
              {{ name = "status", from = "device", fields = [{{ name = "id", type = "u8" }}, {{ name = "error", type = "u8" }}, {{ name = "data", type = "bytes", size = 1 }}] }},
            ]
            on = [
              {{ message = "read", when = "id != own_address and id != 254" }},
              {{ message = "read", reply = "status", with = {{ id = "own_address", error = 0, data = "registers(at, 1)" }} }},
              {{ message = "clear", when = "id == own_address", write = {{ at = "at", data = "bytes('0')" }} }},
              {{ event = "refused", reply = "status", with = {{ id = "own_address", error = 8, data = "bytes('0')" }} }},
              {{ event = "bad-frame", reply = "status", with = {{ id = "own_address", error = 16, data = "bytes('0')" }} }},
            ]
            {more}
            [registers]
            bytes = [{{ at = 0, name = "a", type = "u8" }}, {{ at = 1, name = "b", type = "u8" }}]
            "#
        )
    };
    let description = parse_of("one-status", &text(""));
    let subject = DescribedDevice::emulated(&description, "hilrig".to_owned()).expect("replies");
    let mut fuzzer = Fuzzer::new(&subject, 1, 0, BTreeMap::new());
    let found = fuzzer.round(24, 1).found;
    let laws: Vec<_> = found.iter().map(|found| &found.fault).collect();
    assert!(laws.is_empty(), "{laws:?}");
    let often = "every = [{ period = \"1s\", send = \"status\", with = { id = 7, error = 0, data = \"bytes('0')\" } }]";
    let description = parse_of("one-status", &text(often));
    let error = DescribedDevice::emulated(&description, "hilrig".to_owned()).err();
    let error = error.expect("no reply is certain");
    assert!(error.contains(" also by itself, expected "), "{error}");
}

/// A device that answers nothing, and a file without inputs, do not pass.
#[test]
fn without_an_observation_nothing_passes() {
    let deaf: Alter = |_, _| Vec::new();
    let description = ping("host");
    let of = description.clone();
    let make: Make = Box::new(move || Ok(defective(&of, deaf)));
    let made = DescribedDevice::new(&description, make, "hilrig".to_owned());
    let error = made.err().expect("no reply");
    assert!(error.starts_with("ping answers none of the "), "{error}");
    assert!(DescribedDevice::emulated(&ping("device"), "hilrig".to_owned()).is_err());
    for text in ["", "# request\n", "idle\nidle\n"] {
        let error = parse(text).expect_err("no input");
        assert!(error.starts_with("holds no input, expected "), "{error}");
    }
    let mut peer = defective(&description, deaf);
    let port = PortFuzz::new(&description, &mut peer, port_plan(false)).expect("a port");
    assert!(port.is_none());
}

fn port_plan(writes: bool) -> PortPlan {
    PortPlan {
        writes,
        seed: 1,
        gap: Duration::from_millis(100),
        ..PortPlan::default()
    }
}

/// A later run sends other inputs than the first one, counts on, and reports no known cause.
#[test]
fn a_search_at_a_port_continues() {
    let text = shipped::text("modbus-meter").expect("shipped");
    let description = parse_of("modbus-meter", text);
    let run = |plan: PortPlan| {
        let mut peer = Watched {
            peer: conform::emulated(&description, SEED),
            sent: Vec::new(),
        };
        let mut port = PortFuzz::new(&description, &mut peer, plan)
            .expect("a port")
            .expect("it answers");
        (0..10).for_each(|_| assert_eq!(port.step(), Ok(PortStep::Sound)));
        let fuzzed = port.fuzzed().clone();
        let sent: Vec<_> = peer.sent.into_iter().map(|(_, bytes)| bytes).collect();
        (fuzzed, sent)
    };
    let (first, sent) = run(port_plan(false));
    let known = BTreeMap::from([("answers-again".to_owned(), 3)]);
    let (second, others) = run(PortPlan {
        done: first.inputs,
        known: known.clone(),
        ..port_plan(false)
    });
    assert_ne!(sent, others);
    assert_eq!(second.inputs, 2 * first.inputs);
    assert_eq!(second.causes, known);
}

/// A device whose received bytes are kept, each with its time.
struct Watched {
    peer: Emulated,
    sent: Vec<(Instant, Vec<u8>)>,
}

impl Peer for Watched {
    fn now(&self) -> Instant {
        self.peer.now()
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String> {
        self.sent.push((self.peer.now(), bytes.to_vec()));
        self.peer.send(bytes)
    }

    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
        self.peer.hear(until)
    }
}

/// A device that ends a frame by its length: it takes the first of several.
fn takes_the_first(_: &[u8], mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.len() > 8 && bytes[6..8] == crc(&bytes[..6]) {
        bytes.truncate(8);
    }
    bytes
}

/// At a port the same defects are found; a sound device has no finding. The rate is kept by every
/// request, and none could be taken for another function than a read.
#[test]
fn a_device_at_a_port_is_compared_with_the_emulated_one() {
    let description = parse_of(
        "modbus-meter",
        shipped::text("modbus-meter").expect("shipped"),
    );
    let nothing: Alter = |_, bytes| bytes;
    let cases = [
        (nothing, ""),
        (takes_the_first, ""),
        (trusts, "damage-is-not-answered"),
        (hangs, "answers-again"),
    ];
    for (alter, law) in cases {
        let mut peer = Watched {
            peer: defective(&description, alter),
            sent: Vec::new(),
        };
        let mut port = PortFuzz::new(&description, &mut peer, port_plan(false))
            .expect("a port")
            .expect("it answers");
        let mut laws = BTreeSet::new();
        for _ in 0..300 {
            match port.step().expect("a port") {
                PortStep::Found(fault, inputs) => {
                    laws.insert(fault.law().to_owned());
                    let again = port.repeat(&inputs).expect("inputs");
                    assert!(again.is_err(), "{inputs}");
                }
                PortStep::Silent => break,
                PortStep::Sound => {}
                PortStep::Nothing => panic!("no input"),
            }
        }
        let wanted: BTreeSet<String> = [law.to_owned()]
            .into_iter()
            .filter(|law| !law.is_empty())
            .collect();
        assert_eq!(laws, wanted);
        let fuzzed = port.fuzzed().clone();
        assert!(fuzzed.answered > 0 && fuzzed.left_out > 0, "{fuzzed:?}");
        let gaps = peer.sent.windows(2).map(|two| two[1].0 - two[0].0);
        assert!({ gaps }.all(|gap| gap >= Duration::from_millis(100)));
        for (_, bytes) in &peer.sent {
            assert_eq!(other_function(bytes), None, "{bytes:02X?}");
        }
    }
}

/// A description with another register than the device: a finding, and the device is not silent.
#[test]
fn a_device_with_other_registers_is_a_finding() {
    let text = |at: u32| {
        format!(
            "name = \"m\"\nabout = \"x\"\nprotocol = \"modbus-rtu\"\nlatency = \"5ms\"\n\
             line = {{ baud = 9600, address = 1 }}\n[registers]\nholding = [{{ at = {at}, name = \
             \"a\" }}]\n"
        )
    };
    let [described, own] = [0, 100].map(|at| parse_of("m", &text(at)));
    let mut peer = defective(&own, |_, bytes| bytes);
    let port = PortFuzz::new(&described, &mut peer, port_plan(false));
    let mut port = port.expect("a port").expect("it answers");
    let steps: Vec<_> = (0..20).map(|_| port.step().expect("a port")).collect();
    let is_found = |step: &PortStep| matches!(step, PortStep::Found(fault, _) if fault.law() == "replies-as-described");
    assert!(steps.iter().any(is_found), "{steps:?}");
    assert!(!steps.contains(&PortStep::Silent), "{steps:?}");
}

/// Inputs with an effect, such as a reset, are no findings at a sound device.
#[test]
fn effects_at_a_port_are_no_findings() {
    for name in ["grbl", "mt-sics", "modbus-meter"] {
        let description = parse_of(name, shipped::text(name).expect("shipped"));
        let mut peer = defective(&description, |_, bytes| bytes);
        let port = PortFuzz::new(&description, &mut peer, port_plan(true));
        let mut port = port.expect("a port").expect("it answers");
        for _ in 0..60 {
            let step = port.step().expect("a port");
            let is_law = |fault: &Violation| fault.law() == "answers-again";
            assert!(
                !matches!(&step, PortStep::Found(fault, _) if is_law(fault)),
                "{name}: {step:?}"
            );
        }
    }
}

/// The number of bytes of a Modbus request with this function, with address and CRC (application
/// protocol specification V1.1b3, section 6).
fn request_len(bytes: &[u8]) -> Option<usize> {
    let count = |at: usize| bytes.get(at).copied().map(usize::from);
    Some(match *bytes.get(1)? {
        7 | 11 | 12 | 17 => 4,
        24 => 6,
        43 => 7,
        5 | 6 | 8 => 8,
        15 | 16 => 9 + count(6)?,
        20 | 21 => 5 + count(2)?,
        22 => 10,
        23 => 13 + count(10)?,
        _ => return None,
    })
}

/// Whether bytes begin with a request of a function that Modbus defines, other than 1 to 4.
fn holds_other(bytes: &[u8]) -> bool {
    request_len(bytes).is_some_and(|len| bytes.len() >= len)
}

/// The lengths, from 4 on, of the beginnings of `bytes` that end with their own CRC: the CRC over
/// such a beginning is 0.
fn sound_lens(bytes: &[u8]) -> Vec<usize> {
    let (mut sum, mut lens) = (0xFFFF_u16, Vec::new());
    for (len, byte) in (1..).zip(bytes) {
        sum = crc_step(sum, *byte);
        if sum == 0 && len >= 4 {
            lens.push(len);
        }
    }
    lens
}

/// The offset of a frame that could be taken for another function than 1 to 4: by a device that
/// does not verify the CRC, by one that does, or by one with frames of eight bytes. `None` for a
/// plain read.
fn other_function(bytes: &[u8]) -> Option<usize> {
    let is_sound = |frame: &[u8]| sound_lens(frame).contains(&frame.len());
    if bytes.len() == 8 && (1..=4).contains(&bytes[1]) && is_sound(bytes) {
        return None;
    }
    let is_other = |at: usize| {
        let rest = &bytes[at..];
        let Some(function) = rest.get(1).filter(|function| !(1..=4).contains(*function)) else {
            return false;
        };
        let is_begin = at.is_multiple_of(8) && *function > 0;
        is_begin || holds_other(rest) || !sound_lens(&rest[..rest.len().min(256)]).is_empty()
    };
    (0..bytes.len()).find(|at| is_other(*at))
}

/// Of 20,000 inputs for a Modbus device, none that the filter allows holds a frame of another
/// function than a read, at any offset. A weaker filter, which asks only whether a sound device
/// stays unchanged, allows more than a hundred such frames.
#[test]
fn no_input_could_be_taken_for_another_function_than_a_read() {
    let many = r#"
        name = "many"
        about = "x"
        protocol = "modbus-rtu"
        latency = "5ms"
        line = { baud = 9600, address = 6 }
        [registers]
        coils = [{ at = 5, name = "c" }]
        input = [{ at = 16, name = "i", type = "u32" }]
        holding = [{ at = 5, name = "a" }, { at = 6, name = "b" }, { at = 1283, name = "d" }]
        "#;
    let meter = shipped::text("modbus-meter").expect("shipped");
    let (mut sent, mut caught) = (0, 0);
    for (name, text) in [("modbus-meter", meter), ("many", many)] {
        let description = parse_of(name, text);
        let mut asks = description.asks();
        asks.retain(|ask| !ask.changes);
        let next = asks
            .iter()
            .find(|ask| description.may_follow_damage(&ask.bytes));
        let next = next.map_or(&[][..], |ask| &ask.bytes);
        let inputs = Inputs::of(&description, false);
        let mut rng = Rng::stream(1, "inputs");
        for _ in 0..10_000 {
            let bytes = inputs.next(&mut rng).bytes();
            let other = other_function(&bytes);
            caught += usize::from(description.keeps_state(&bytes) && other.is_some());
            if description.is_harmless_before(&bytes, next) {
                sent += 1;
                assert_eq!(other, None, "{name}: {bytes:02X?}");
                // A device that waits for the rest of a frame takes it from the next ones.
                let stream = [&bytes[..], &bytes, next, next].concat();
                let is_plain = bytes.len() == 8 && bytes[6..] == crc(&bytes[..6]);
                let holds = |at: usize| holds_other(&stream[at..]);
                assert!(
                    is_plain || !(0..stream.len()).any(holds),
                    "{name}: {stream:02X?}"
                );
            }
        }
    }
    assert!(sent > 4_000 && caught > 100, "{sent} {caught}");
    // Worked out by hand: a write in front of a read, a write behind one, a broadcast within two.
    let description = parse_of("modbus-meter", meter);
    let read = [0x01, 0x04, 0x00, 0x00, 0x00, 0x01];
    let read = [&read[..], &crc(&read)].concat();
    assert!(description.is_harmless(&read));
    let write = [0x01, 0x06, 0x00, 0x64, 0x00, 0x0A, 0, 0];
    let around = [0x01, 0x03, 0x00, 0x06, 0x00, 0x01, 0, 0];
    for bytes in [
        [&write[..], &read].concat(),
        [&read[..], &write].concat(),
        write.to_vec(),
        vec![0x01, 0x06],
        [&around[..], &read].concat(),
        vec![0x01, 0x41, 0, 0],
    ] {
        assert!(!description.is_harmless(&bytes), "{bytes:02X?}");
    }
}

fn described(description: &Arc<Description>) -> Described {
    let place = Place {
        name: "device".to_owned(),
        seed: 1,
        address: None,
        is_alone: true,
    };
    Described::new(description.clone(), place)
}

/// Inputs without an effect leave all variables of each shipped device as they are in a device
/// that gets no bytes, also if the device does not verify checksums.
#[test]
fn inputs_without_an_effect_change_nothing() {
    let scene = Scene::new::<Shape>([], Vec::new()).expect("empty");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
    for (name, text) in shipped::ALL {
        let description = parse_of(name, text);
        let inputs = Inputs::of(&description, false);
        let [mut fed, mut trusting, mut left] = [(); 3].map(|()| described(&description));
        let mut rng = Rng::stream(7, "inputs");
        let (mut sent, mut now) = (0, Instant::ZERO);
        for _ in 0..200 {
            let bytes = inputs.next(&mut rng).bytes();
            let is_sent = !bytes.is_empty() && description.is_harmless(&bytes);
            sent += usize::from(is_sent);
            for step in 0..20 {
                now += Duration::from_millis(10);
                for device in [&mut fed, &mut trusting, &mut left] {
                    device.poll(now, &mut world.clone());
                    device.transmit(Described::UART, &mut [0; 4096]);
                }
                if is_sent && step == 10 {
                    fed.receive(Described::UART, now, &bytes);
                    let mut repaired = bytes.clone();
                    description.repair(&mut repaired);
                    trusting.receive(Described::UART, now, &repaired);
                }
            }
        }
        let [fed, trusting, left] = [fed, trusting, left].map(|device| device.values(now, &world));
        assert_eq!(fed, left, "{name}");
        assert_eq!(trusting, left, "{name}: without checksums");
        assert!(sent > 0 || inputs.is_empty(), "{name}: no input");
    }
}
