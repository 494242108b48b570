//! The car's board and its odometer, each in a world of its own.

use core::time::Duration;

use emulators::Device as _;
use emulators::car_board::{BoardConfig, CarBoard};
use emulators::odometer::{Odometer, OdometerConfig, Overrun, PolledEncoder, Program};
use emulators::world::World;
use protocols::car_board::{Command, Level, Steering};
use protocols::odometer::Dialect;
use protocols::{Decode as _, Instant};

use super::program::{car, drive};
use crate::{Observation, Variant};
use engine::codec::{CAR_COMMAND, ODOMETER};

/// 60 edges a turn of a wheel of 32 mm.
const EDGES_PER_M: f64 = 298.415_518;

/// Edges counted for each true one in 20 s at a speed; the edges are polled every 10 ms or counted
/// one by one.
fn counted(variant: Variant, speed_m_s: f64) -> f64 {
    let mut encoder = PolledEncoder::default();
    #[expect(clippy::cast_possible_truncation, reason = "a few thousand")]
    let edges = |look: u32| (f64::from(look) * 0.010 * speed_m_s * EDGES_PER_M) as i64;
    let mut before = 0;
    for look in 1..=2_000 {
        let now = edges(look);
        if variant.is_defective() {
            encoder.look(now, false);
        } else {
            (before..=now).for_each(|edge| encoder.look(edge, false));
        }
        before = now;
    }
    encoder.count() as f64 / edges(2_000) as f64
}

pub(super) fn af_11(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let slow = counted(variant, 0.22);
    let [half, fast] = [0.45, 0.90].map(|speed| counted(variant, speed));
    seen.figure("counted at 0.22 m/s", format!("{slow:.2}"));
    seen.figure("counted at 0.45 m/s", format!("{half:.2}"));
    seen.figure("counted at 0.90 m/s", format!("{fast:.2}"));
    seen.judged((0.4..0.6).contains(&half) && fast < 0.0)
}

/// Lines that the board sends until `end`.
fn lines(board: &mut Odometer, world: &mut World, end: Instant) -> Vec<Vec<u8>> {
    let mut lines = Vec::new();
    let mut decoder = protocols::odometer::Decoder::default();
    while let Some(now) = board.poll_at().filter(|now| *now < end) {
        world.advance(now);
        board.poll(now, world);
        let mut buf = [0; 600];
        let len = board.transmit(Odometer::UART, &mut buf);
        let new = decoder.push(&buf[..len]).flatten();
        lines.extend(new.map(|line| line.as_bytes().to_vec()));
    }
    lines
}

/// 0.22 m/s at 0.4 rad of steering turn by 0.22 * tan 0.4 / 0.258 m = 0.36 rad/s.
pub(super) fn af_12(variant: Variant) -> Observation {
    let dialect = match variant {
        Variant::Defective => Dialect::AsCoded,
        Variant::Sound => Dialect::Fixed,
    };
    let mut world = car();
    let mut board = Odometer::new(OdometerConfig {
        program: Program::Pose(dialect),
        ..OdometerConfig::default()
    });
    lines(&mut board, &mut world, Instant::from_millis(500));
    drive(&mut world, 0.4);
    let turning = lines(&mut board, &mut world, Instant::from_secs(3));
    let mut seen = Observation::default();
    let last = turning.last().cloned().unwrap_or_default();
    seen.bytes("odometer", &ODOMETER, &last);
    let content = last.strip_suffix(b"\r\n").unwrap_or_default();
    let rate = dialect.read(content).map_or(0.0, |it| it.rate_rad_s);
    seen.figure("0.36 rad/s are told as", format!("{rate:.2}"));
    seen.judged(rate < 0.1)
}

/// For a second, another task takes 12 ms of each loop.
pub(super) fn af_13(variant: Variant) -> Observation {
    let mut world = car();
    let mut board = Odometer::new(OdometerConfig {
        overrun: match variant {
            Variant::Defective => Overrun::Hangs,
            Variant::Sound => Overrun::IsLate,
        },
        ..OdometerConfig::default()
    });
    let [begin, end] = [1, 2].map(Instant::from_secs);
    lines(&mut board, &mut world, begin);
    board.set_fault(begin, "slow", Some(12.0), true);
    lines(&mut board, &mut world, end);
    board.set_fault(end, "slow", Some(12.0), false);
    let after = lines(&mut board, &mut world, Instant::from_secs(4)).len();
    let mut seen = Observation::default();
    seen.figure("lines in the two seconds after", after);
    seen.judged(after == 0)
}

/// A board under a car, and the commands that it receives at the start.
fn driven(config: BoardConfig, commands: [u8; 2], time: Duration) -> (World, Observation) {
    let mut world = car();
    let mut board = CarBoard::new(config);
    let mut seen = Observation::default();
    seen.bytes("host", &CAR_COMMAND, &commands);
    board.receive(CarBoard::UART, Instant::ZERO, &commands);
    let end = Instant::ZERO + time;
    while let Some(now) = board.poll_at().filter(|now| *now < end) {
        world.advance(now);
        board.poll(now, &mut world);
        let mut buf = [0; 64];
        board.transmit(CarBoard::UART, &mut buf);
    }
    world.advance(end);
    (world, seen)
}

fn commands(level: i16, value: i16) -> [u8; 2] {
    let level = Level::new(level).unwrap_or_default();
    let value = Steering::new(value).unwrap_or_default();
    [
        Command::Motor(level).encode(),
        Command::Steering(value).encode(),
    ]
}

pub(super) fn af_14(variant: Variant) -> Observation {
    let config = BoardConfig {
        dead_man: match variant {
            Variant::Defective => None,
            Variant::Sound => Some(Duration::from_secs(1)),
        },
        ..BoardConfig::default()
    };
    let (world, mut seen) = driven(config, commands(2, 8), Duration::from_secs(5));
    let speed = world.axis_speed("drive").unwrap_or_default();
    let told = format!("{speed:.2}");
    seen.figure("speed 5 s after the host's last command, m/s", told);
    seen.judged(speed > 0.2)
}

/// 6 degrees turn the car by 0.22 * tan 6 degrees / 0.258 m = 5.1 degrees a second; the straight
/// direction lies between 7 and 8.
pub(super) fn af_15(variant: Variant) -> Observation {
    let value = match variant {
        Variant::Defective => 0,
        Variant::Sound => 8,
    };
    let time = Duration::from_secs(5);
    let (world, mut seen) = driven(BoardConfig::default(), commands(2, value), time);
    let turned = world.pose().theta.to_degrees();
    seen.figure("turned in 5 s, degrees", format!("{turned:.0}"));
    seen.judged(turned > 20.0)
}
