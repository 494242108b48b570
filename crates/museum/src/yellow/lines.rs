//! The search for lines.

use firmware_core::lines::{Line, Lines, Settings};
use firmware_core::pose::{Point, sin_cos};

use super::config;
use crate::{Bug, Observation, Variant};

const LINES: &str = "robot's program, lines";

pub(super) const ROWS: [Bug; 5] = [
    Bug::mutant(
        "YN-01",
        LINES,
        "a cosine is compared with an angle: corners of 45 degrees are not found",
        yn_01,
    ),
    Bug::mutant(
        "YN-02",
        LINES,
        "of two regions that are too short the second one stays: the loop skips it",
        yn_02,
    ),
    Bug::mutant(
        "YN-03",
        LINES,
        "the last point counts twice: two points are a wall",
        yn_03,
    ),
    Bug::mutant(
        "YN-04",
        LINES,
        "the first point is omitted: a wall of three points is not found",
        yn_04,
    ),
    Bug::mutant(
        "YN-05",
        LINES,
        "a line goes from its first to its last point, and ends where the scan begins",
        yn_05,
    ),
];

/// Lines that `id` finds in a scan.
fn found(variant: Variant, id: &str, points: &[Point]) -> Vec<Line> {
    let settings = Settings {
        defects: config(variant, id).defects.lines,
        ..Settings::DEFAULT
    };
    Lines::find(points, &settings).as_slice().to_vec()
}

/// The scan of a regular polygon around the robot: walls 1 m away, a point each half degree.
fn polygon(corners: u16) -> Vec<Point> {
    let sector = 360.0 / f32::from(corners);
    let points = (0..720_u16).map(|half| {
        let degrees = f32::from(half) / 2.0;
        let beside = (degrees % sector - sector / 2.0).to_radians();
        let far = 1_000.0 / sin_cos(beside).1;
        let (sin, cos) = sin_cos(degrees.to_radians());
        Point::new(far * cos, far * sin)
    });
    points.collect()
}

/// Rows with these numbers of points, 100 mm apart; rows are half a metre apart.
fn rows(sizes: &[u16]) -> Vec<Point> {
    let mut x_mm = 1_000.0;
    let mut points = Vec::new();
    for size in sizes {
        for _ in 0..*size {
            points.push(Point::new(x_mm, 1_000.0));
            x_mm -= 100.0;
        }
        x_mm -= 400.0;
    }
    points
}

/// Records the number of lines; `defective` is the catalogue's number for the fielded program.
fn counted(
    (variant, id): (Variant, &str),
    name: &'static str,
    points: &[Point],
    defective: usize,
) -> Observation {
    let mut seen = Observation::default();
    let count = found(variant, id, points).len();
    seen.figure(name, count);
    seen.judged(count == defective)
}

fn yn_01(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let square = found(variant, "YN-01", &polygon(4)).len();
    let octagon = found(variant, "YN-01", &polygon(8)).len();
    seen.figure("walls of a square", square);
    seen.figure("walls of an octagon", octagon);
    seen.judged(square == 4 && octagon < 8)
}

fn yn_02(variant: Variant) -> Observation {
    let name = "lines of two rows of two points";
    counted((variant, "YN-02"), name, &rows(&[2, 2]), 1)
}

fn yn_03(variant: Variant) -> Observation {
    counted((variant, "YN-03"), "lines of two points", &rows(&[2]), 1)
}

fn yn_04(variant: Variant) -> Observation {
    counted((variant, "YN-04"), "lines of three points", &rows(&[3]), 0)
}

/// A wall 1 m ahead, across the beginning of the scan, whose two outermost points lie 50 mm behind
/// it.
fn yn_05(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let (left, right) = (0..=40_u8, 41..=80_u8);
    // 25 mm apart from the middle to 1 m left, then from 1 m right to the middle.
    let ahead = |y_mm: f32, is_end: bool| Point::new(if is_end { 1_050.0 } else { 1_000.0 }, y_mm);
    let left = left.map(|at| ahead(f32::from(at) * 25.0, at == 40));
    let right = right.map(|at| ahead(f32::from(at) * 25.0 - 2_025.0, at == 41));
    let points: Vec<_> = left.chain(right).collect();
    let lines = found(variant, "YN-05", &points);
    let off = |line: &Line| {
        (line.start.x_mm - 1_000.0)
            .abs()
            .max((line.end.x_mm - 1_000.0).abs())
    };
    let worst = lines.iter().map(off).fold(0.0_f32, f32::max);
    seen.figure("lines of one wall", lines.len());
    seen.figure("their ends beside the wall, mm", format!("{worst:.0}"));
    seen.judged(worst > 40.0)
}
