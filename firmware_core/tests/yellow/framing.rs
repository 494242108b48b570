//! YE1: frames of the link in the program.

use firmware_core::Master;
use firmware_core::robots::yellow::Yellow;
use protocols::telemetry::message::{State, Telecommand, Velocities};
use protocols::telemetry::{self, PAYLOAD_MAX};
use protocols::{Decode, telemetry::Decoder};

use crate::bench::{Bench, framed, square};
use crate::lidar::Dice;

fn command() -> Telecommand {
    Telecommand {
        timestamp_ms: 0x7E7D,
        velocities: Some(Velocities {
            linear_m_s: 0.25,
            angular_rad_s: -1.0,
        }),
        ..Telecommand::default()
    }
}

/// Number of telecommands that a robot accepts from these bytes.
fn taken(id: Option<&str>, bytes: &[u8]) -> u64 {
    let mut bench = match id {
        None => Bench::new(square(2.0)),
        Some(id) => Bench::with_defect(square(2.0), id),
    };
    bench.robot.receive(Yellow::TELEMETRY, bench.now, bytes);
    bench.counter("telecommands")
}

#[test]
fn ye1_any_payload_goes_round() {
    let mut dice = Dice::new(3);
    for len in [0, 1, 2, 0x7D, 0x7E, 100, 0x7E7D % 3_200, PAYLOAD_MAX] {
        let payload: Vec<u8> = (0..len)
            .map(|_| match dice.uniform() {
                it if it < 0.2 => 0x7E,
                it if it < 0.4 => 0x7D,
                it => (it * 256.0) as u8,
            })
            .collect();
        let mut frame = [0; telemetry::FRAME_MAX];
        let count = telemetry::encode(&payload, &mut frame).expect("fits");
        let mut decoder = Decoder::default();
        let decoded = decoder.push(&frame[..count]).next();
        let decoded = decoded.and_then(Result::ok).expect("one frame");
        assert_eq!(decoded.payload(), payload);
    }
}

/// Every byte of a frame except its start is set to every other value: that frame is dropped, the
/// next one accepted. A wrong length may include bytes of the next frame, whose start ends the
/// damaged one.
#[test]
fn ye1_a_corrupt_frame_is_dropped_and_the_next_one_taken() {
    let good = framed(&command());
    for at in 1..good.len() {
        for flip in 1..=255_u8 {
            let mut bytes = good.clone();
            bytes[at] ^= flip;
            bytes.extend(&good);
            assert_eq!(taken(None, &bytes), 1, "byte {at}, {flip:02X}");
        }
    }
}

/// YF-01: the fielded robot accepts a frame with a wrong checksum.
#[test]
fn ye1_the_fielded_robot_takes_corrupt_frames() {
    let mut bytes = framed(&command());
    let at = bytes.len() - 2;
    bytes[at] ^= 0x01;
    assert_eq!(taken(None, &bytes), 0);
    assert_eq!(taken(Some("YF-01"), &bytes), 1);
}

/// YF-02: a lost byte costs two frames, because the start of the second one counts as data.
#[test]
fn a_lost_byte_costs_the_fielded_robot_two_frames() {
    let good = framed(&command());
    let mut bytes = good.clone();
    bytes.remove(8);
    bytes.extend(&good);
    assert_eq!(taken(None, &bytes), 1);
    assert_eq!(taken(Some("YF-02"), &bytes), 0);
}

/// YF-03: bytes that arrive before the program has processed a frame are lost.
#[test]
fn the_fielded_robot_is_deaf_behind_a_frame() {
    let good = framed(&command());
    let two = [&good[..], &good[..]].concat();
    assert_eq!(taken(None, &two), 2);
    assert_eq!(taken(Some("YF-03"), &two), 1);
    let mut bench = Bench::with_defect(square(2.0), "YF-03");
    for _ in 0..2 {
        bench.robot.receive(Yellow::TELEMETRY, bench.now, &good);
        bench.step();
    }
    assert_eq!(bench.counter("telecommands"), 2);
}

/// A valid frame that is no message, and a message with a value that is not a number, change
/// nothing.
#[test]
fn what_means_nothing_changes_nothing() {
    let mut bench = Bench::new(square(2.0));
    let mut frame = [0; 16];
    let len = telemetry::encode(&[0xFF, 0xFF], &mut frame).expect("fits");
    bench
        .robot
        .receive(Yellow::TELEMETRY, bench.now, &frame[..len]);
    bench.drive(f32::NAN, f32::INFINITY);
    bench.order(State::Manual);
    bench.run_for(core::time::Duration::from_secs(1));
    assert_eq!(bench.counter("radio bad messages"), 1);
    assert_eq!(bench.counter("telecommands refused"), 1);
    assert_eq!((bench.mode(), bench.speed()), ("manual", [0.0; 2]));
}
