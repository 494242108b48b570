//! The line to a model car's board: frames and commands by a slow reference method.

use hilrig::codec::{CarCommand, Pair, wire};
use proptest::prelude::*;
use protocols::car_board::{Command, Decoder, Frame, Level, Readings, Steering};

use crate::protocol::{Protocol, Wire};

impl Wire for Frame {
    fn wire(&self) -> Vec<u8> {
        self.as_bytes().to_vec()
    }
}

impl Wire for Pair {
    fn wire(&self) -> Vec<u8> {
        <CarCommand as wire::Wire>::bytes(self).to_vec()
    }
}

/// From the board.
pub(crate) struct Board;

impl Protocol for Board {
    type Decoder = Decoder;

    const TELLING: &'static [u8] = &[0x00, 0x0F, 0x0D, 0x1C, 0x01];
    const CHECKED: bool = false;

    fn decoder() -> Decoder {
        Decoder::default()
    }

    /// 13 plausible bytes, followed by nothing or by the start of the next frame.
    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let &[
            0,
            15,
            f0,
            f1,
            r0,
            r1,
            l0,
            l1,
            line,
            _,
            _,
            b0,
            b1,
            ref behind @ ..,
        ] = bytes
        else {
            return None;
        };
        let word = |low: u8, high: u8| 256 * u32::from(high) + u32::from(low);
        let ranges = [word(f0, f1), word(r0, r1), word(l0, l1)];
        let is_sound = ranges.iter().all(|cm| *cm <= 1_100)
            && line <= 1
            && (4_000..=10_000).contains(&word(b0, b1));
        let goes_on = match *behind {
            [] => true,
            [next] => next == 0,
            [next, then, ..] => (next, then) == (0, 15),
        };
        (is_sound && goes_on).then_some(13)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        let range = || 0..=1_100_u16;
        let values = (
            range(),
            range(),
            range(),
            0..=1_u8,
            any::<u16>(),
            4_000..=10_000_u16,
        );
        values
            .prop_map(|(front_cm, right_cm, left_cm, line, hall, battery_mv)| {
                let readings = Readings {
                    front_cm,
                    right_cm,
                    left_cm,
                    line,
                    hall,
                    battery_mv,
                };
                readings.encode().as_bytes().to_vec()
            })
            .boxed()
    }
}

/// To the board.
pub(crate) struct Commands;

impl Protocol for Commands {
    type Decoder = <CarCommand as wire::Wire>::Decoder;

    const TELLING: &'static [u8] = &[0x80, 0x94, 0x95, 0x64, 0x65, 0x8A, 0x32];
    const CHECKED: bool = false;

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let [motor, steering] = *bytes.first_chunk()?;
        (motor >= 128 && motor - 128 <= 20 && steering <= 100).then_some(2)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        (-10..=10_i16, -50..=50_i16)
            .prop_map(|(level, value)| {
                let level = Level::new(level).expect("in range");
                let value = Steering::new(value).expect("in range");
                vec![
                    Command::Motor(level).encode(),
                    Command::Steering(value).encode(),
                ]
            })
            .boxed()
    }
}
