//! The three example devices of the documentation, as a driver sees them.

use core::time::Duration;
use std::sync::Arc;

use description::{Described, Description, From, Place};
use emulators::device::{Device, next_poll};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Decode as _, Instant};

fn shipped(name: &str) -> Arc<Description> {
    let text = description::shipped::text(name).expect("a shipped file");
    let found = Description::parse(name, text, &|_| Err("no file".to_owned()));
    found.unwrap_or_else(|error| panic!("{error}"))
}

/// Every file of the folder is shipped and valid.
#[test]
fn every_shipped_description_is_sound() {
    let folder = format!("{}/../../devices", env!("CARGO_MANIFEST_DIR"));
    let files = std::fs::read_dir(folder).expect("the folder").flatten();
    let names = files.map(|file| file.file_name().into_string().expect("a name"));
    let mut names: Vec<_> = names.filter(|name| name.ends_with(".toml")).collect();
    names.sort();
    let known = description::shipped::ALL
        .iter()
        .map(|(name, _)| format!("{name}.toml"));
    assert_eq!(names, known.collect::<Vec<_>>());
    for (name, _) in description::shipped::ALL {
        assert_eq!(shipped(name).name(), *name);
    }
}

fn world() -> World {
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free")
}

/// A driver at the other end of an ideal line.
struct Driver {
    device: Described,
    world: World,
    now: Instant,
}

impl Driver {
    fn new(name: &str) -> Self {
        let place = Place {
            name: name.to_owned(),
            seed: 1,
            address: None,
            is_alone: true,
        };
        let device = Described::new(shipped(name), place);
        Self {
            device,
            world: world(),
            now: Instant::ZERO,
        }
    }

    /// The bytes received within `time`.
    fn listen(&mut self, time: Duration) -> Vec<u8> {
        let end = self.now + time;
        let mut out = Vec::new();
        while self.now < end {
            self.now = next_poll(&self.device, self.now, end);
            self.device.poll(self.now, &mut self.world);
            let mut buf = [0; 512];
            let len = self.device.transmit(Described::UART, &mut buf);
            out.extend_from_slice(&buf[..len]);
        }
        out
    }

    /// The reply to `request` within a tenth of a second.
    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        self.now += self
            .device
            .description()
            .line()
            .bytes_time(request.len() as u64);
        self.device.receive(Described::UART, self.now, request);
        self.listen(Duration::from_millis(100))
    }

    fn rules(&mut self) -> Vec<&'static str> {
        let events = self.device.take_events().into_iter();
        events.map(|event| event.rule).collect()
    }
}

/// CRC-16/MODBUS as its specification computes it, bit by bit.
fn with_crc(bytes: &[u8]) -> Vec<u8> {
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
    [bytes, &crc.to_le_bytes()].concat()
}

/// Requests and responses by hand from the application protocol specification.
#[test]
fn the_meter_answers_modbus() {
    let mut meter = Driver::new("modbus-meter");
    // Serial number 20261127 = 0x01352907 and energy 0 in one read of four registers.
    let found = meter.ask(&with_crc(&[1, 4, 0, 8, 0, 4]));
    assert_eq!(
        found,
        with_crc(&[1, 4, 8, 0, 0, 0, 0, 0x01, 0x35, 0x29, 0x07])
    );
    // Half of the serial number.
    let found = meter.ask(&with_crc(&[1, 4, 0, 11, 0, 1]));
    assert_eq!(found, with_crc(&[1, 4, 2, 0x29, 0x07]));
    // Voltage near 230 V, as IEEE 754.
    let found = meter.ask(&with_crc(&[1, 4, 0, 0, 0, 2]));
    let voltage = f32::from_be_bytes([found[3], found[4], found[5], found[6]]);
    assert!((voltage - 230.0).abs() < 3.0, "{voltage}");
    // The relay cuts the current.
    assert_eq!(
        meter.ask(&with_crc(&[1, 4, 0, 2, 0, 2])),
        with_crc(&[1, 4, 4, 0x40, 0x60, 0, 0])
    );
    let off = with_crc(&[1, 5, 0, 0, 0, 0]);
    assert_eq!(meter.ask(&off), off);
    assert_eq!(
        meter.ask(&with_crc(&[1, 1, 0, 0, 0, 1])),
        with_crc(&[1, 1, 1, 0])
    );
    assert_eq!(
        meter.ask(&with_crc(&[1, 4, 0, 2, 0, 2])),
        with_crc(&[1, 4, 4, 0, 0, 0, 0])
    );
    // An alarm at 245.5 V, written by function 16, read back by 3; and one by mask, 22.
    let write = meter.ask(&with_crc(&[1, 16, 0, 1, 0, 1, 2, 0x09, 0x97]));
    assert_eq!(write, with_crc(&[1, 16, 0, 1, 0, 1]));
    assert_eq!(
        meter.ask(&with_crc(&[1, 3, 0, 1, 0, 1])),
        with_crc(&[1, 3, 2, 0x09, 0x97])
    );
    let mask = with_crc(&[1, 22, 0, 2, 0, 0xF0, 0, 0x0F]);
    assert_eq!(meter.ask(&mask), mask);
    // The masked write gives (100 & 0xF0) | (0x0F & 0x0F) = 0x6F.
    assert_eq!(
        meter.ask(&with_crc(&[1, 3, 0, 2, 0, 1])),
        with_crc(&[1, 3, 2, 0, 0x6F])
    );
    // Write the label, read it and one more by function 23: "ab" then "ne 1".
    let found = meter.ask(&with_crc(&[1, 23, 0, 3, 0, 2, 0, 3, 0, 1, 2, b'a', b'b']));
    assert_eq!(found, with_crc(&[1, 23, 4, b'a', b'b', b'n', b'e']));
    assert_eq!(meter.rules(), [""; 0]);
}

/// Each mistake has its exception code (section 7) and its rule.
#[test]
fn mistakes_of_a_driver_are_refused_and_named() {
    let mut meter = Driver::new("modbus-meter");
    let mut refused = |request: &[u8], expected: &[u8], rule: &str| {
        // A rule broken again within a second is counted, not logged again.
        meter.listen(Duration::from_millis(1_100));
        let found = meter.ask(&with_crc(request));
        let wanted = if expected.is_empty() {
            Vec::new()
        } else {
            with_crc(expected)
        };
        assert_eq!((found, meter.rules()), (wanted, vec![rule]), "{request:?}");
    };
    refused(&[1, 4, 0, 12, 0, 1], &[1, 0x84, 2], "unknown-register");
    refused(&[1, 4, 0, 10, 0, 9], &[1, 0x84, 2], "unknown-register");
    refused(&[1, 6, 0, 1, 0, 1], &[1, 0x86, 3], "out-of-range");
    refused(&[1, 2, 0, 0, 0, 1], &[1, 0x82, 1], "unknown-function");
    refused(&[1, 3, 0, 0, 0, 0], &[1, 0x83, 3], "bad-request");
    refused(&[2, 3, 0, 0, 0, 1], &[], "wrong-address");
    meter.listen(Duration::from_millis(1_100));
    let mut wrong = with_crc(&[1, 3, 0, 0, 0, 1]);
    wrong[6] ^= 1;
    assert_eq!(
        (meter.ask(&wrong), meter.rules()),
        (Vec::new(), vec!["bad-checksum"])
    );
    assert_eq!(
        (meter.ask(&[1, 3]), meter.rules()),
        (Vec::new(), vec!["frame-cut-off"])
    );
    // The device executes a broadcast and does not reply.
    assert!(meter.ask(&with_crc(&[0, 6, 0, 2, 0, 200])).is_empty());
    assert_eq!(
        meter.ask(&with_crc(&[1, 3, 0, 2, 0, 1])),
        with_crc(&[1, 3, 2, 0, 200])
    );
    meter.listen(Duration::from_millis(1_100));
    // Two requests without a pause form one invalid frame.
    let one = with_crc(&[1, 3, 0, 0, 0, 1]);
    assert!(meter.ask(&[&one[..], &one].concat()).is_empty());
    assert_eq!(meter.rules(), ["missing-pause"]);
    // A damaged second one is a damaged frame.
    meter.listen(Duration::from_millis(1_100));
    let mut damaged = [&one[..], &one].concat();
    damaged[12] ^= 1;
    assert!(meter.ask(&damaged).is_empty());
    assert_eq!(meter.rules(), ["bad-checksum"]);
}

/// The sentence contains the state: 45319 s are 12:35:19, 48.1173 degrees are 48 degrees 7.038
/// minutes. The test computes the checksum of the fixed part independently.
#[test]
fn the_receiver_speaks_nmea_and_ubx_on_one_line() {
    let mut gps = Driver::new("gps");
    let text = String::from_utf8(gps.listen(Duration::from_millis(1_500))).expect("text");
    let lines: Vec<_> = text.split("\r\n").collect();
    assert!(
        lines[0].starts_with("$GPGGA,123520.00,4807.0380,N,01131.0020,E,1,08,0.9,54"),
        "{text}"
    );
    assert!(
        lines[1].starts_with("$GPRMC,123520.00,A,4807.0380,N,01131.0020,E,"),
        "{text}"
    );
    let (body, sum) = lines[1][1..].split_once('*').expect("a checksum");
    let expected = body.bytes().fold(0, |sum, byte| sum ^ byte);
    assert_eq!(format!("{expected:02X}"), sum);
    // UBX-NAV-POSLLH is polled by an empty message; checksum by hand: 1, 3, 3, 3 and 1, 4, 7, 10.
    let found = gps.ask(&[0xB5, 0x62, 1, 2, 0, 0, 3, 10]);
    assert_eq!(found[..6], [0xB5, 0x62, 1, 2, 28, 0]);
    let int = |at: usize| i32::from_le_bytes(found[at..at + 4].try_into().expect("four"));
    assert_eq!(
        [int(6), int(10), int(14)],
        [45_320_000, 115_167_000, 481_173_000]
    );
    let [a, b] = found[2..34].iter().fold([0_u8; 2], |[a, b], &byte| {
        let a = a.wrapping_add(byte);
        [a, b.wrapping_add(a)]
    });
    assert_eq!(found[34..], [a, b]);
    assert_eq!(gps.rules(), [""; 0]);
}

/// The body of a request by hand: 01, tag 0x0102 low byte first, the CRC of CRC-16/IBM-3740.
#[test]
fn the_sensor_speaks_floats_in_cobs() {
    let mut sensor = Driver::new("cobs-sensor");
    let description = sensor.device.description().clone();
    let say = |body: &[u8]| description.frame_of(0, body).expect("fits");
    // 0x0000 0x3F80 is 1.0; crc("123456789") = 0x29B1 is the check of the algorithm itself.
    let request = say(&[1, 2, 1]);
    assert_eq!(request.last(), Some(&0));
    let reply = sensor.ask(&request);
    let mut cutter = description.cutter();
    let frame = cutter.push(&reply).next().expect("a frame").expect("sound");
    let (message, values) = description.message(&frame, From::Device).expect("known");
    let words = message.words(&values);
    assert!(
        words.starts_with("reading: tag 258, temperature 21"),
        "{words}"
    );
    assert!(words.ends_with("hPa, heater 0 %"), "{words}");
    // Heat at 50 %; after five seconds of silence the heater is off again.
    sensor.ask(&say(&[2, 0, 0, 0, 0, 0x48, 0x42]));
    let heater = |sensor: &Driver| {
        let rows = sensor.device.values(sensor.now, &sensor.world);
        rows.into_iter()
            .find(|row| row.1 == "heater")
            .map(|row| row.3)
    };
    assert_eq!(heater(&sensor).as_deref(), Some("50 %"));
    sensor.listen(Duration::from_secs(5));
    assert_eq!(heater(&sensor).as_deref(), Some("0 %"));
    assert_eq!(sensor.rules(), ["made-safe"]);
    // 200 % is a violation; the variable is limited to 100 %.
    sensor.ask(&say(&[2, 0, 0, 0, 0, 0x48, 0x43]));
    assert_eq!(heater(&sensor).as_deref(), Some("100 %"));
    assert_eq!(sensor.rules(), ["out-of-range", "value-cut"]);
}

/// Common faults of all devices, and faults of the description.
#[test]
fn faults_change_what_a_driver_reads() {
    let mut meter = Driver::new("modbus-meter");
    let current = |meter: &mut Driver| {
        let found = meter.ask(&with_crc(&[1, 4, 0, 2, 0, 2]));
        let bytes = found.get(3..7).map(|bytes| bytes.try_into().expect("four"));
        bytes.map(f32::from_be_bytes)
    };
    let known: Vec<_> = meter.device.known_faults().to_vec();
    assert_eq!(
        known,
        [
            "off",
            "restart",
            "stuck",
            "garbage",
            "wrong",
            "slow",
            "wrong-current"
        ]
    );
    let set = |meter: &mut Driver, fault: &str, figure, begins| {
        let now = meter.now;
        meter.device.set_fault(now, fault, figure, begins);
        meter.device.poll(now, &mut meter.world);
    };
    assert_eq!(current(&mut meter), Some(3.5));
    set(&mut meter, "wrong-current", None, true);
    assert_eq!(current(&mut meter), Some(-3.5));
    set(&mut meter, "wrong-current", None, false);
    set(&mut meter, "wrong", Some(2.0), true);
    assert_eq!(current(&mut meter), Some(7.0));
    // What a driver sets is no reading: 250 V in units of 0.1 V.
    let alarm = meter.ask(&with_crc(&[1, 3, 0, 1, 0, 1]));
    assert_eq!(alarm, with_crc(&[1, 3, 2, 0x09, 0xC4]));
    set(&mut meter, "wrong", None, false);
    assert_eq!(current(&mut meter), Some(3.5));
    // 1000 Hz in units of 0.01 Hz are more than 16 bits.
    assert_eq!(meter.rules(), [""; 0]);
    set(&mut meter, "wrong", Some(20.0), true);
    let frequency = meter.ask(&with_crc(&[1, 4, 0, 7, 0, 1]));
    assert_eq!(frequency, with_crc(&[1, 4, 2, 0xFF, 0xFF]));
    assert_eq!(meter.rules(), ["value-cut"]);
    set(&mut meter, "wrong", None, false);
    // 20 ms times 10 exceed the driver's timeout.
    set(&mut meter, "slow", None, true);
    assert_eq!(current(&mut meter), None);
    meter.listen(Duration::from_millis(300));
    set(&mut meter, "slow", None, false);
    set(&mut meter, "off", None, true);
    assert_eq!(current(&mut meter), None);
    set(&mut meter, "off", None, false);
    assert_eq!(current(&mut meter), Some(3.5));
    assert_eq!(meter.rules(), ["off", "restarted"]);
}
