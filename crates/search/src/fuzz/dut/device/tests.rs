use std::collections::BTreeSet;

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

/// No law is broken by any shipped description, and most of their requests get replies.
#[test]
fn shipped_devices_keep_the_laws() {
    let (mut broken, mut behaviours) = (Vec::new(), 0);
    for (name, text) in shipped::ALL {
        let description = parse_of(name, text);
        let subject = DescribedDevice::emulated(&description, "hilrig".to_owned()).expect("made");
        let mut fuzzer = Fuzzer::new(&subject, 1, 0, std::collections::BTreeMap::new());
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
}

/// Alters a delivery; the first argument is all bytes received before.
type Alter = fn(&[u8], Vec<u8>) -> Vec<u8>;

/// A device with a defect in what it receives.
struct Defective {
    device: Described,
    alter: Alter,
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
        self.device.transmit(port, buf)
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
    let place = Place {
        name: "defective".to_owned(),
        seed: SEED,
        address: None,
        is_alone: true,
    };
    let device = Defective {
        device: Described::new(description.clone(), place),
        alter,
        before: Vec::new(),
    };
    Emulated::new(Box::new(device), Described::UART)
}

/// CRC-16 of a Modbus frame, bit by bit as its specification computes it.
fn crc(bytes: &[u8]) -> [u8; 2] {
    let mut crc = 0xFFFF_u16;
    for byte in bytes {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ 0xA001
            } else {
                crc >> 1
            };
        }
    }
    crc.to_le_bytes()
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
        let mut fuzzer = Fuzzer::new(&subject, 1, 0, std::collections::BTreeMap::new());
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

fn port_plan(writes: bool) -> PortPlan {
    PortPlan {
        writes,
        seed: 1,
        gap: Duration::from_millis(100),
        slack: Duration::ZERO,
    }
}

/// At a port the same defects are found; a sound device has no finding. The rate is kept.
#[test]
fn a_device_at_a_port_is_compared_with_the_emulated_one() {
    let description = parse_of(
        "modbus-meter",
        shipped::text("modbus-meter").expect("shipped"),
    );
    let nothing: Alter = |_, bytes| bytes;
    let cases = [
        (nothing, ""),
        (trusts, "damage-is-not-answered"),
        (hangs, "answers-again"),
    ];
    for (alter, law) in cases {
        let mut peer = defective(&description, alter);
        let mut port = PortFuzz::new(&description, &mut peer, port_plan(false))
            .expect("a port")
            .expect("it answers");
        let mut laws = BTreeSet::new();
        for _ in 0..300 {
            match port.step().expect("a port") {
                PortStep::Found(fault, inputs) => {
                    laws.insert(fault.law().to_owned());
                    let again = port.repeat(&inputs).expect("inputs");
                    assert_eq!(again.map_err(|again| again.cause), Err(fault.cause));
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
        assert!(wanted.is_subset(&laws), "{laws:?}");
        assert_eq!(law.is_empty(), laws.is_empty(), "{laws:?}");
        let fuzzed = port.fuzzed().clone();
        assert!(fuzzed.answered > 0 && fuzzed.left_out > 0, "{fuzzed:?}");
        let spent = peer.now() - Instant::ZERO;
        let rate = fuzzed.inputs as f64 / spent.as_secs_f64();
        assert!(rate < 10.5, "{rate} inputs per second");
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
/// that gets no bytes.
#[test]
fn inputs_without_an_effect_change_nothing() {
    let scene = Scene::new::<Shape>([], Vec::new()).expect("empty");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
    for (name, text) in shipped::ALL {
        let description = parse_of(name, text);
        let inputs = Inputs::of(&description, false);
        let [mut fed, mut left] = [described(&description), described(&description)];
        let mut rng = Rng::stream(7, "inputs");
        let (mut sent, mut now) = (0, Instant::ZERO);
        for _ in 0..200 {
            let bytes = inputs.next(&mut rng).bytes();
            let is_sent = !bytes.is_empty() && description.is_harmless(&bytes);
            sent += usize::from(is_sent);
            for step in 0..20 {
                now += Duration::from_millis(10);
                for device in [&mut fed, &mut left] {
                    device.poll(now, &mut world.clone());
                    device.transmit(Described::UART, &mut [0; 4096]);
                }
                if is_sent && step == 10 {
                    fed.receive(Described::UART, now, &bytes);
                }
            }
        }
        assert_eq!(fed.values(now, &world), left.values(now, &world), "{name}");
        assert!(sent > 0 || inputs.is_empty(), "{name}: no input");
    }
}
