//! `odometer`: lines of a microcontroller that counts a wheel and integrates a gyroscope, in all
//! their dialects.
//!
//! The text of a line determines its dialect: `#` begins one without a sum, a sum without a point
//! is a CRC, and a time without a point is in milliseconds. A line is a frame if its sum or CRC
//! holds by the rules of its dialect. The words also state whether the fielded host accepts it.

use protocols::odometer::{
    Dialect, LINE_MAX, LineError, Measurement, Raw, Reading, passes_exact_sum,
};
use protocols::{Candidate, Decoder, Format, FrameError};

use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Choices, Wire};

/// Lines of an odometer.
pub static ODOMETER: Codec =
    Codec::of::<Odometer>("Lines of a microcontroller with wheel encoder and gyroscope")
        .with_floor(Floor {
            check_bits: 32,
            ..Floor::CHECKED
        })
        .with_lua(Lua {
            source: include_str!("lua/odometer.lua"),
            judge: "judge_odometer",
            tell: "tell_odometer",
            fields: &FIELDS,
        });

const FIELDS: [LuaField; 6] = [
    field(
        "odo_dialect",
        "string",
        "hilrig.odometer.dialect",
        "Dialect",
    ),
    field(
        "odo_distance",
        "double",
        "hilrig.odometer.distance",
        "Distance (m)",
    ),
    field(
        "odo_rate",
        "double",
        "hilrig.odometer.rate",
        "Turn rate (rad/s)",
    ),
    field("odo_yaw", "double", "hilrig.odometer.yaw", "Heading (rad)"),
    field("odo_time", "double", "hilrig.odometer.time", "Time (s)"),
    field("odo_figure", "double", "hilrig.odometer.figure", "Figure"),
];

/// The lines.
#[derive(Clone, Copy, Debug)]
pub struct Odometer;

/// A valid line.
#[derive(Clone, Debug)]
pub struct Line {
    bytes: Vec<u8>,
    meaning: Option<Meaning>,
}

#[derive(Clone, Copy, Debug)]
enum Meaning {
    Pose(Dialect, Reading),
    Raw(Raw),
}

/// Lines that are valid in their dialect.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineFormat;

impl Format for LineFormat {
    type Frame = Line;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        if !matches!(bytes.first(), Some(b'#' | b'-' | b'0'..=b'9')) {
            return Candidate::Noise;
        }
        let end = bytes.iter().position(|byte| !is_within_a_line(*byte));
        match end.map(|at| (at, bytes[at])) {
            Some((at, b'\n')) => match meaning(content(&bytes[..=at])) {
                Ok(_) => Candidate::Complete(at + 1),
                Err(error) => Candidate::Rejected(frame_error(error, &bytes[..=at])),
            },
            Some((at, other)) => Candidate::Rejected(implausible(at, other)),
            None if bytes.len() < LINE_MAX => Candidate::Incomplete,
            None => Candidate::Rejected(FrameError::Length {
                max: number(LINE_MAX),
                found: number(bytes.len()),
            }),
        }
    }

    fn frame(&self, bytes: &[u8]) -> Line {
        Line {
            bytes: bytes.to_vec(),
            meaning: meaning(content(bytes)).ok(),
        }
    }
}

/// Whether a byte can stand before the end of a line.
const fn is_within_a_line(byte: u8) -> bool {
    matches!(byte, b'0'..=b'9' | b'A'..=b'F' | b'*' | b'.' | b'-' | b'#' | b'\r')
}

/// A line without its end.
fn content(line: &[u8]) -> &[u8] {
    let line = line.strip_suffix(b"\n").unwrap_or(line);
    line.strip_suffix(b"\r").unwrap_or(line)
}

fn meaning(content: &[u8]) -> Result<Meaning, LineError> {
    if content.starts_with(b"#") {
        return Raw::read(content).map(Meaning::Raw);
    }
    let dialect = dialect_of(content);
    dialect
        .read(content)
        .map(|reading| Meaning::Pose(dialect, reading))
}

/// The dialect of five fields, by their points.
fn dialect_of(content: &[u8]) -> Dialect {
    let mut fields = content.split(|byte| *byte == b'*').skip(3);
    let mut has_point = || fields.next().is_some_and(|field| field.contains(&b'.'));
    match [has_point(), has_point()] {
        [_, false] => Dialect::Fixed,
        [true, true] => Dialect::Seed,
        [false, true] => Dialect::AsCoded,
    }
}

/// Error of an invalid line, at its position.
fn frame_error(error: LineError, line: &[u8]) -> FrameError {
    let field_at = |field: usize| {
        let mut stars = line.iter().enumerate().filter(|(_, byte)| **byte == b'*');
        let star = field.checked_sub(1).and_then(|before| stars.nth(before));
        star.map_or(0, |(at, _)| at + 1)
    };
    match error {
        LineError::Crc { expected, found } => FrameError::Checksum {
            expected: expected.into(),
            found: found.into(),
        },
        LineError::Sum { .. } => implausible(field_at(4), b'.'),
        LineError::Number { field } => {
            let at = field_at(field);
            implausible(at, line.get(at).copied().unwrap_or_default())
        }
        _ => implausible(line.len() - 1, b'\n'),
    }
}

fn implausible(at: usize, found: u8) -> FrameError {
    FrameError::Implausible {
        at: number(at),
        found: found.into(),
    }
}

fn number(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

impl Wire for Odometer {
    type Decoder = Decoder<LineFormat, LINE_MAX>;
    const NAME: &'static str = "odometer";

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn bytes(line: &Line) -> &[u8] {
        &line.bytes
    }

    fn words(line: &Line) -> String {
        match line.meaning {
            None => "no figures".to_owned(),
            Some(Meaning::Raw(raw)) => {
                let shown = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}");
                let (rates, field) = (shown(raw.rates), shown(raw.field));
                let accelerations = shown(raw.accelerations);
                let distance = raw.distance;
                format!("{distance} m, rates {rates}, accelerations {accelerations}, field {field}")
            }
            Some(Meaning::Pose(dialect, reading)) => {
                let Reading {
                    distance_m,
                    rate_rad_s,
                    yaw_rad,
                    time_s,
                } = reading;
                let exact = match dialect {
                    Dialect::Fixed => "",
                    _ if passes_exact_sum(content(&line.bytes)) => ", sum exact",
                    _ => ", sum rounded",
                };
                let told = format!("{distance_m:.3} m, {rate_rad_s:.3} rad/s, {yaw_rad:.3} rad");
                format!("{told}, {time_s:.3} s{exact}")
            }
        }
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let dialect = match choices.byte() % 4 {
            0 => Dialect::Fixed,
            1 => Dialect::AsCoded,
            2 => Dialect::Seed,
            _ => return build_raw(choices, out),
        };
        let mut figure = |unit: f32| f32::from(choices.word().cast_signed()) / unit;
        let measured = Measurement {
            distance_m: figure(100.0),
            rate_rad_s: figure(1000.0),
            yaw_rad: figure(1000.0),
            time_ms: u32::from(choices.word()) | u32::from(choices.word()) << 16,
        };
        out.extend(dialect.line(&measured).as_bytes());
    }

    /// Writes the sum or CRC of the figures, if it has the same number of digits.
    fn repair(frame: &mut [u8]) {
        if let Some(end) = frame.len().checked_sub(2) {
            frame[end..].copy_from_slice(b"\r\n");
        }
        let wanted = match meaning(content(frame)) {
            Err(LineError::Crc { expected, .. }) => format!("{expected:04X}"),
            Err(LineError::Sum { expected, .. }) => format!("{expected:.2}"),
            _ => return,
        };
        let len = content(frame).len();
        let end = len.saturating_sub(1);
        let begin = frame[..end].iter().rposition(|byte| *byte == b'*');
        if let Some(sum) = begin.and_then(|begin| frame.get_mut(begin + 1..end))
            && sum.len() == wanted.len()
        {
            sum.copy_from_slice(wanted.as_bytes());
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let end = bytes.iter().position(|byte| *byte == b'\n')?;
        let line = str::from_utf8(&bytes[..end]).ok()?;
        let line = line.strip_suffix('\r').unwrap_or(line);
        let holds = match line.strip_prefix('#') {
            Some(rest) => figures(rest)?.len() == 10,
            None => holds_slowly(line)?,
        };
        (holds && end < LINE_MAX).then_some(end + 1)
    }

    /// The dialect and the line's length.
    fn kind(line: &Line) -> u64 {
        let dialect = match line.meaning {
            Some(Meaning::Pose(dialect, _)) => dialect as u64,
            _ => 3,
        };
        (dialect << 8) | (line.bytes.len() as u64 / 4)
    }
}

fn build_raw(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
    out.push(b'#');
    for _ in 0..10 {
        let figure = f64::from(choices.word().cast_signed()) / 100.0;
        out.extend(format!("{figure:.2}*").as_bytes());
    }
    out.extend(b"\r\n");
}

/// Whether five fields have the sum or CRC of their dialect; `None` if they are not five figures.
fn holds_slowly(line: &str) -> Option<bool> {
    let (covered, sum) = line.strip_suffix('*')?.rsplit_once('*')?;
    let time = covered.rsplit('*').next()?;
    let covered = &line[..=covered.len()];
    let [distance, rate, yaw, time_figure] = figures(covered)?[..] else {
        return None;
    };
    if !sum.contains('.') {
        let digits = sum
            .bytes()
            .all(|byte| matches!(byte, b'0'..=b'9' | b'A'..=b'F'));
        let found = u32::from_str_radix(sum, 16).ok()?;
        return Some(digits && sum.len() == 4 && found == crc_slowly(covered.as_bytes()));
    }
    let found = figures(&format!("{sum}*"))?[0];
    // In milliseconds, the sketch adds the rate a second time to the sum, with a wrong factor.
    let factor = if time.contains('.') { 1.0 } else { 0.0125 };
    let expected = distance + rate * factor + yaw + time_figure;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "to 32 bits, which is meant"
    )]
    let largest = expected.abs().max(time_figure) as f32;
    let unit = f64::from(largest.next_up()) - f64::from(largest);
    Some((expected - found).abs() <= 5.0 * 0.005 + unit)
}

/// Figures with a `*` behind each, as an Arduino prints them.
fn figures(text: &str) -> Option<Vec<f64>> {
    let fields = text.strip_suffix('*')?.split('*');
    let figure = |field: &str| {
        let digits = field.strip_prefix('-').unwrap_or(field);
        let is_plain = digits.chars().all(|it| it.is_ascii_digit() || it == '.')
            && !digits.starts_with('.')
            && !digits.ends_with('.')
            && !digits.is_empty();
        field.parse().ok().filter(|_| is_plain)
    };
    fields.map(figure).collect()
}

/// The remainder of `bytes` behind two bytes of ones, bit by bit.
fn crc_slowly(bytes: &[u8]) -> u32 {
    let bits = bytes
        .iter()
        .flat_map(|byte| (0..8).rev().map(move |at| byte >> at & 1));
    bits.fold(0xFFFF, |rest, bit| {
        let carry = rest >> 15 & 1 ^ u32::from(bit);
        (rest << 1 & 0xFFFF) ^ (carry * 0x1021)
    })
}
