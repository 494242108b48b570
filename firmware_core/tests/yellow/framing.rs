//! YE1: frames of the link in the program.

use firmware_core::Master;
use firmware_core::robots::yellow::Yellow;
use protocols::telemetry::message::{State, Telecommand, Velocities};
use protocols::telemetry::{self};

use crate::bench::{Bench, framed, square};

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

/// A valid frame that is no message, and one with a value that is not a number.
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
