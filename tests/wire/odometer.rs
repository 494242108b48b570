//! Lines of an odometer: validity by dialect, by a slow reference method.

use hilrig::codec::{Line, Odometer, wire};
use proptest::prelude::*;
use protocols::odometer::{Dialect, Measurement};

use crate::protocol::{Protocol, Wire};

impl Wire for Line {
    fn wire(&self) -> Vec<u8> {
        <Odometer as wire::Wire>::bytes(self).to_vec()
    }
}

/// All dialects on one line.
pub(crate) struct Lines;

/// The CRC by its definition: 1021, highest bit first, from FFFF.
fn crc(bytes: &[u8]) -> u16 {
    let mut rest = 0xFFFF_u16;
    for byte in bytes {
        for mask in [128, 64, 32, 16, 8, 4, 2, 1] {
            let carry = (rest >= 0x8000) != (byte & mask != 0);
            rest = rest.wrapping_mul(2);
            if carry {
                rest ^= 0x1021;
            }
        }
    }
    rest
}

/// A figure: digits with at most one point between them, and an optional minus.
fn figure(text: &str) -> Option<f64> {
    let plain = text.strip_prefix('-').unwrap_or(text);
    let (whole, decimals) = plain.split_once('.').unwrap_or((plain, "0"));
    let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|it| it.is_ascii_digit());
    (is_digits(whole) && is_digits(decimals)).then(|| text.parse().expect("digits"))
}

fn holds(line: &str) -> Option<bool> {
    let fields: Vec<&str> = line.strip_suffix('*')?.split('*').collect();
    if let Some(first) = fields[0].strip_prefix('#') {
        let all = core::iter::once(first).chain(fields[1..].iter().copied());
        return Some(fields.len() == 10 && all.map(figure).all(|it| it.is_some()));
    }
    let [distance, rate, yaw, time, sum] = fields[..] else {
        return None;
    };
    let figures = [distance, rate, yaw, time].map(figure);
    let [Some(distance), Some(rate), Some(yaw), Some(at)] = figures else {
        return None;
    };
    if !sum.contains('.') {
        let covered = &line[..line.len() - sum.len() - 1];
        return Some(sum == format!("{:04X}", crc(covered.as_bytes())));
    }
    let counted_twice = if time.contains('.') {
        1.0
    } else {
        25.0 / 2000.0
    };
    let expected = distance + rate * counted_twice + yaw + at;
    // 32-bit floats have 24 bits below the highest one.
    let largest = expected.abs().max(at);
    let mut unit = 2_f64.powi(-149);
    while unit * 16_777_216.0 <= largest {
        unit *= 2.0;
    }
    let off = (expected - figure(sum)?).abs();
    // Next to a power of two, the largest value is rounded to 32 bits first.
    let rounded = (largest / unit).round_ties_even() >= 16_777_216.0;
    Some(off <= 0.025 + if rounded { 2.0 * unit } else { unit })
}

impl Protocol for Lines {
    type Decoder = <Odometer as wire::Wire>::Decoder;

    const TELLING: &'static [u8] = b"#*.-0123456789ABCDEF\r\n";

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let end = bytes.iter().take(160).position(|byte| *byte == 10)?;
        let line = str::from_utf8(&bytes[..end]).ok()?;
        let line = line.strip_suffix('\r').unwrap_or(line);
        holds(line)?.then_some(end + 1)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        let measured = (
            -500.0..500.0_f32,
            -10.0..10.0_f32,
            -100.0..100.0_f32,
            prop_oneof![0..200_000_u32, any::<u32>()],
        );
        let dialects = [Dialect::Seed, Dialect::AsCoded, Dialect::Fixed];
        let pose = (measured, proptest::sample::select(dialects.to_vec())).prop_map(
            |((distance_m, rate_rad_s, yaw_rad, time_ms), dialect)| {
                let measured = Measurement {
                    distance_m,
                    rate_rad_s,
                    yaw_rad,
                    time_ms,
                };
                dialect.line(&measured).as_bytes().to_vec()
            },
        );
        let raw = any::<[i16; 10]>().prop_map(|figures| {
            let fields = figures.map(|figure| format!("{:.2}*", f64::from(figure) / 100.0));
            format!("#{}\r\n", fields.concat()).into_bytes()
        });
        prop_oneof![3 => pose, 1 => raw].boxed()
    }
}
