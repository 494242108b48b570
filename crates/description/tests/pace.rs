//! A described device hears whole requests at once. That shortcut changes nothing: bytes, times and
//! events equal those of a device that hears the same bytes one by one.

use core::time::Duration;
use std::sync::Arc;

use description::{Described, Description, From, Place, shipped};
use emulators::device::{Device as _, byte_end, next_poll};
use emulators::rng::Rng;
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::Instant;

/// Requests of one run.
const REQUESTS: usize = 24;

fn parse(text: &str) -> Arc<Description> {
    let nothing = |file: &str| Err(format!("no {file}"));
    Description::parse("pace.toml", text, &nothing)
        .unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn world() -> World {
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free")
}

/// `text` on a line of the other kind.
fn with_half_duplex(text: &str) -> Option<String> {
    let mut table: toml::Table = text.parse().ok()?;
    let line = table.get_mut("line")?.as_table_mut()?;
    let is_half = line.get("half_duplex").and_then(toml::Value::as_bool);
    line.insert("half_duplex".to_owned(), (is_half != Some(true)).into());
    toml::to_string(&table).ok()
}

/// Deliveries: the time at which the last byte ends, and the bytes. The pauses between requests are
/// shorter and longer than a reply. Some requests are damaged or cut off.
fn deliveries(of: &Description, rng: &mut Rng) -> Vec<(Instant, Vec<u8>)> {
    let mut choose = |below: u64| rng.below(below.max(1));
    let asked: Vec<_> = of
        .messages()
        .iter()
        .filter(|one| one.from() != From::Device)
        .collect();
    let registers = of.requests(&["read"]).unwrap_or_default();
    let line = of.line();
    let (mut all, mut now) = (Vec::new(), Instant::from_millis(20));
    for number in 0..REQUESTS {
        let request = |number: usize, choose: &mut dyn FnMut(u64) -> u64| {
            if let Some(message) = asked.get(number % asked.len().max(1)) {
                let example = message.example(&mut |below| choose(below));
                let answered = of.answered(message, &example);
                let values = answered.first().unwrap_or(&example);
                return of.frame(message, values).unwrap_or_default();
            }
            let register = registers.get(number % registers.len().max(1));
            register.map_or_else(|| vec![0x55, 0xAA], |one| one.bytes.clone())
        };
        let mut bytes = request(number, &mut choose);
        match choose(8) {
            0 => {
                let at = choose(bytes.len() as u64);
                bytes[usize::try_from(at).expect("few")] ^= 1 << choose(8);
            }
            1 => bytes.truncate(bytes.len() / 2 + 1),
            _ => {}
        }
        now += line.bytes_time(bytes.len() as u64);
        all.push((now, bytes));
        let short = line.bytes_time(choose(24));
        now += match choose(4) {
            0 => Duration::from_micros(choose(900)),
            1 | 2 => short,
            _ => Duration::from_millis(choose(120)),
        };
    }
    all
}

/// Delivers `bytes`, the last of which ends at `now`, at once or byte by byte.
fn deliver(device: &mut Described, now: Instant, bytes: &[u8], is_whole: bool) {
    if is_whole {
        return device.receive(Described::UART, now, bytes);
    }
    let line = device.description().line();
    for (index, byte) in bytes.iter().enumerate() {
        let end = byte_end(now, line, index, bytes.len());
        device.receive(Described::UART, end, &[*byte]);
    }
}

/// The bytes that the device sends with their times, and its events.
fn run(
    of: &Arc<Description>,
    fault: Option<&str>,
    all: &[(Instant, Vec<u8>)],
    is_whole: bool,
) -> (Vec<(Instant, Vec<u8>)>, Vec<String>) {
    let place = Place {
        name: "pace".to_owned(),
        seed: 7,
        address: None,
        is_alone: true,
    };
    let mut device = Described::new(of.clone(), place);
    let mut world = world();
    if let Some(fault) = fault {
        device.set_fault(Instant::ZERO, fault, None, true);
    }
    let (mut sent, mut events) = (Vec::new(), Vec::new());
    let mut now = Instant::ZERO;
    let end = (
        all.last().expect("requests").0 + Duration::from_millis(300),
        Vec::new(),
    );
    for (at, bytes) in all.iter().chain([&end]) {
        while now < *at {
            now = next_poll(&device, now, *at);
            if now == *at && !bytes.is_empty() {
                deliver(&mut device, now, bytes, is_whole);
            }
            device.poll(now, &mut world);
            let mut buf = [0; 512];
            let count = device.transmit(Described::UART, &mut buf);
            if count > 0 {
                sent.push((now, buf[..count].to_vec()));
            }
        }
        events.extend(
            device
                .take_events()
                .iter()
                .map(|event| format!("{event:?}")),
        );
    }
    (sent, events)
}

#[test]
fn a_request_at_once_and_byte_by_byte_have_the_same_effect() {
    let (mut replies, mut complaints) = (0, 0);
    for (name, text) in shipped::ALL {
        let texts = [Some((*text).to_owned()), with_half_duplex(text)];
        for text in texts.into_iter().flatten() {
            let of = parse(&text);
            let rng = &mut Rng::stream(11, name);
            let whole = deliveries(&of, rng);
            let names = Described::new(
                of.clone(),
                Place {
                    name: String::new(),
                    seed: 1,
                    address: None,
                    is_alone: true,
                },
            );
            let faults = names.known_faults();
            let drawn = faults.get(usize::try_from(rng.below(faults.len() as u64)).expect("few"));
            for fault in [None, drawn.copied()] {
                let (sent, events) = run(&of, fault, &whole, true);
                replies += sent.len();
                complaints += events.len();
                assert_eq!(
                    (sent, events),
                    run(&of, fault, &whole, false),
                    "{name} {fault:?}\n{text}"
                );
            }
        }
    }
    assert!(replies > 500 && complaints > 100, "{replies} {complaints}");
}
