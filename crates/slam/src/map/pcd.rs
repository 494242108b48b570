//! Point clouds for PCL and similar tools: PCD 0.7 as text, metres, with normals where known.

use core::fmt::Write as _;
use std::path::Path;

use super::MapError;
use crate::mapping::WallPoint;

/// Maximum plausible coordinate, metres.
const FAR_M: f32 = 1e5;

/// The text of a file with these points.
pub fn text(walls: &[WallPoint]) -> String {
    let count = walls.len();
    let mut out = format!(
        "VERSION .7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\n\
         TYPE F F F F F F\nCOUNT 1 1 1 1 1 1\nWIDTH {count}\nHEIGHT 1\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA ascii\n"
    );
    for WallPoint {
        at: [x, y],
        normal: [nx, ny],
    } in walls
    {
        for (number, behind) in [(x, " "), (y, " 0 "), (nx, " "), (ny, " 0\n")] {
            write_rounded(&mut out, *number);
            out.push_str(behind);
        }
    }
    out
}

/// Largest number that [`write_rounded`] takes apart.
const PLAIN_MAX: f32 = 1e6;

/// Writes a number as `{:.3}` does: an `f64` holds a thousand times an `f32` exactly. The standard
/// library's formatting takes a tenth of the time of a whole building.
fn write_rounded(out: &mut String, number: f32) {
    let thousandths = (f64::from(number) * 1000.0).round_ties_even().abs();
    let written = if number.abs() <= PLAIN_MAX {
        #[expect(clippy::cast_possible_truncation, reason = "at most 1e9")]
        #[expect(clippy::cast_sign_loss, reason = "its absolute value")]
        let thousandths = thousandths as u32;
        let sign = if number.is_sign_negative() { "-" } else { "" };
        let (whole, part) = (thousandths / 1000, thousandths % 1000);
        write!(out, "{sign}{whole}.{part:03}")
    } else {
        write!(out, "{number:.3}")
    };
    written.expect("a string takes everything");
}

/// Reads a file.
///
/// # Errors
/// If the file is not a PCD text file, or has no points with x and y.
pub fn read(path: &Path) -> Result<Vec<WallPoint>, MapError> {
    let fail = |what: String| MapError {
        path: path.to_owned(),
        what,
    };
    let bytes = std::fs::read(path).map_err(|error| fail(format!("cannot be read: {error}")))?;
    parse(&String::from_utf8_lossy(&bytes)).map_err(fail)
}

fn parse(text: &str) -> Result<Vec<WallPoint>, String> {
    let mut fields: Vec<&str> = Vec::new();
    let mut lines = (1..).zip(text.lines());
    loop {
        let Some((_, line)) = lines.next() else {
            return Err("has no line DATA, expected a PCD file".to_owned());
        };
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("FIELDS") => fields = words.collect(),
            Some("DATA") => match words.next() {
                Some("ascii") => break,
                other => {
                    let form = other.unwrap_or("nothing");
                    return Err(format!("is in the form {form}, expected DATA ascii"));
                }
            },
            _ => {}
        }
    }
    let column = |name: &str| fields.iter().position(|field| *field == name);
    let (Some(x), Some(y)) = (column("x"), column("y")) else {
        return Err("has no fields x and y, expected FIELDS x y z".to_owned());
    };
    let normal = column("normal_x").zip(column("normal_y"));
    let mut walls = Vec::new();
    for (number, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let numbers: Vec<f32> = line
            .split_ascii_whitespace()
            .map(|word| word.parse().unwrap_or(f32::NAN))
            .collect();
        let two = |x: usize, y: usize| Some([*numbers.get(x)?, *numbers.get(y)?]);
        let at = two(x, y).filter(|at| at.iter().all(|metres| metres.abs() < FAR_M));
        let at = at.ok_or_else(|| format!("line {number}: expected a point in metres"))?;
        let normal = normal.and_then(|(x, y)| two(x, y)).unwrap_or_default();
        walls.push(WallPoint {
            at,
            normal: unit(normal),
        });
    }
    Ok(walls)
}

/// The vector scaled to length 1; zero stays zero.
fn unit([x, y]: [f32; 2]) -> [f32; 2] {
    let length = (x * x + y * y).sqrt();
    if length > 0.5 && length < 2.0 {
        [x / length, y / length]
    } else {
        [0.0; 2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cloud_names_its_number_of_points_and_is_read_again() {
        let walls = [([1.0, 2.0], [0.6, -0.8]), ([-0.5, 0.25], [0.0, 0.0])];
        let walls = walls.map(|(at, normal)| WallPoint { at, normal });
        let text = text(&walls);
        assert!(text.contains("WIDTH 2\n") && text.contains("POINTS 2\nDATA ascii\n"));
        assert!(text.ends_with("1.000 2.000 0 0.600 -0.800 0\n-0.500 0.250 0 0.000 0.000 0\n"));
        assert_eq!(parse(&text), Ok(walls.to_vec()));
    }

    /// The standard library is the judge of ties, signs, limits, and 100,000 patterns of bits.
    #[test]
    fn numbers_are_rounded_as_the_standard_library_does() {
        let odd = [
            0.0,
            -0.0,
            0.0625,
            0.1875,
            -0.0005,
            999.9995,
            1e6,
            1e7,
            f32::NAN,
            f32::MIN,
        ];
        let spread = (0..100_000_u32).map(|index| f32::from_bits(index.wrapping_mul(0x9E37_79B9)));
        for number in odd.into_iter().chain(spread) {
            let mut written = String::new();
            write_rounded(&mut written, number);
            assert_eq!(written, format!("{number:.3}"));
        }
    }

    /// Files of other programs have other orders of fields, and no normals.
    #[test]
    fn clouds_of_others_are_read_or_refused_in_words() {
        let wall = WallPoint {
            at: [1.0, 2.0],
            normal: [0.0; 2],
        };
        assert_eq!(parse("FIELDS y rgb x\nDATA ascii\n2 7 1\n"), Ok(vec![wall]));
        for (text, words) in [
            ("FIELDS x y\n", "has no line DATA"),
            (
                "FIELDS x y\nDATA binary\n",
                "is in the form binary, expected DATA ascii",
            ),
            ("FIELDS a b\nDATA ascii\n", "has no fields x and y"),
            (
                "FIELDS x y\nDATA ascii\n1 2\n1 wall\n",
                "line 4: expected a point in metres",
            ),
        ] {
            let error = parse(text).expect_err("no cloud");
            assert!(error.contains(words), "{error}");
        }
    }
}
