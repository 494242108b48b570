//! YE8: straight walls in a scan, and the result of the fielded search.

use core::f64::consts::{PI, TAU};

use firmware_core::lines::{Defects, Line, Lines, Settings};
use firmware_core::pose::Point;

use crate::bench::{Bench, SECOND, Wall, cast, closed, square};
use crate::lidar::Dice;

const FIELDED_MERGE: Defects = Defects {
    merges_below_80_deg: true,
    ..Defects::NONE
};

fn with(defects: Defects) -> Settings {
    Settings {
        defects,
        ..Settings::DEFAULT
    }
}

/// Scan of a lidar of 720 points at the origin.
fn scan(walls: &[Wall], sigma_mm: f64, seed: u64) -> Vec<Point> {
    let mut dice = Dice::new(seed);
    let way = |at: u32| f64::from(at) * TAU / 720.0;
    let point = |at| {
        let distance = cast(walls, 0.0, 0.0, way(at)) * 1e3 + sigma_mm * dice.gauss();
        (distance < 5_000.0).then(|| {
            let (x, y) = (libm::cos(way(at)), libm::sin(way(at)));
            Point::new((x * distance) as f32, (y * distance) as f32)
        })
    };
    (0..720).filter_map(point).collect()
}

fn lines(points: &[Point], settings: &Settings) -> Vec<Line> {
    Lines::find(points, settings).as_slice().to_vec()
}

/// Eight corners on a circle of 1.1 m: walls that meet at 135 degrees.
fn octagon() -> Vec<Wall> {
    let corner = |at: u32| f64::from(at) * PI / 4.0 + 0.3;
    let corners: Vec<_> = (0..8)
        .map(|at| [1.1 * libm::cos(corner(at)), 1.1 * libm::sin(corner(at))])
        .collect();
    closed(&corners)
}

/// Distance from each corner of the walls to the nearest end of a line.
fn corner_error_mm(lines: &[Line], walls: &[Wall]) -> f64 {
    let ends = || lines.iter().flat_map(|line| [line.start, line.end]);
    let apart = |wall: &Wall, end: Point| {
        let (x, y) = (f64::from(end.x_mm), f64::from(end.y_mm));
        libm::hypot(x - wall[0] * 1e3, y - wall[1] * 1e3)
    };
    let nearest = |wall: &Wall| ends().map(|end| apart(wall, end)).fold(f64::MAX, f64::min);
    walls.iter().map(nearest).fold(0.0, f64::max)
}

/// In a room of 2 x 2 m, with noise of 5 mm and 50 seeds, the search finds exactly four lines, and
/// every corner within 3 cm.
#[test]
fn ye8_a_square_room_has_four_lines() {
    let mut worst = 0.0_f64;
    for seed in 1..=50 {
        let found = lines(&scan(&square(2.0), 5.0, seed), &Settings::DEFAULT);
        assert_eq!(found.len(), 4, "seed {seed}");
        worst = worst.max(corner_error_mm(&found, &square(2.0)));
    }
    println!("YE8: corners within {worst} mm");
    assert!(worst <= 30.0, "{worst} mm");
}

#[test]
fn ye8_an_octagon_has_eight_lines() {
    for seed in 1..=50 {
        let found = lines(&scan(&octagon(), 5.0, seed), &Settings::DEFAULT);
        assert_eq!(found.len(), 8, "seed {seed}");
        assert!(corner_error_mm(&found, &octagon()) <= 30.0);
    }
}

/// YN-01: the fielded search merges all walls below 79.95 degrees, including 45 degrees. Square
/// corners are not merged, so the defect was not noticed.
#[test]
fn ye8_the_fielded_merge_makes_fewer_of_an_octagon() {
    let found = lines(&scan(&octagon(), 5.0, 1), &with(FIELDED_MERGE));
    println!("YE8, fielded: {} lines of an octagon", found.len());
    assert!(found.len() < 8, "{}", found.len());
    assert_eq!(
        lines(&scan(&square(2.0), 5.0, 1), &with(FIELDED_MERGE)).len(),
        4
    );
}

/// The walls found by the whole robot: a lidar of 364 samples a turn with 5 mm of noise, away from
/// the middle of the room.
#[test]
fn ye8_the_robot_finds_the_walls_of_its_room() {
    use protocols::telemetry::message::{LinesRequest, Telecommand};
    let walls = closed(&[[-0.7, -0.9], [1.3, -0.9], [1.3, 1.1], [-0.7, 1.1]]);
    let mut bench = Bench::new(walls.clone());
    bench.lidar.sigma_mm = 5.0;
    bench.run_for(4 * SECOND);
    bench.send(&Telecommand {
        lines: Some(LinesRequest::default()),
        ..Telecommand::default()
    });
    bench.run_for(SECOND);
    let told = bench.heard.iter().find_map(|(_, it)| it.lines.as_ref());
    let point = |it: protocols::telemetry::message::Pose| Point::new(it.x, it.y);
    let found: Vec<_> = told
        .expect("lines")
        .iter()
        .map(|line| Line {
            start: point(line.start),
            end: point(line.end),
        })
        .collect();
    assert_eq!(found.len(), 4);
    let worst = corner_error_mm(&found, &walls);
    println!("YE8, robot: corners within {worst} mm");
    assert!(worst <= 30.0, "{worst} mm");
}

/// A wall with a bend, 1 m ahead of the robot. Its middle is set back so that both halves of 1.5 m
/// enclose this angle. 2 * atan(1.5 / 0.1312) = 170 degrees, so the bend is 131 mm deep: more than
/// the tolerance of 60 mm.
fn bend(degrees: f64) -> Vec<Wall> {
    let depth = 1.5 / libm::tan((degrees / 2.0).to_radians());
    let middle = [0.0, 1.0 + depth];
    vec![
        [1.5, 1.0, middle[0], middle[1]],
        [middle[0], middle[1], -1.5, 1.0],
    ]
}

/// D2: walls above 170 degrees are merged: 171 is merged, 169 is not.
#[test]
fn d2_171_degrees_are_merged_and_169_are_not() {
    assert_eq!(
        lines(&scan(&bend(171.0), 0.0, 1), &Settings::DEFAULT).len(),
        1
    );
    assert_eq!(
        lines(&scan(&bend(169.0), 0.0, 1), &Settings::DEFAULT).len(),
        2
    );
    // Settings that the PC may request.
    let strict = Settings {
        merge_deg: 175.0,
        ..Settings::DEFAULT
    };
    assert_eq!(lines(&scan(&bend(171.0), 0.0, 1), &strict).len(), 2);
}

/// Groups of these numbers of points from right to left, 100 mm apart; groups are 500 mm apart.
fn groups(sizes: &[u16]) -> Vec<Point> {
    let mut x = 1_000.0;
    let mut points = Vec::new();
    for size in sizes {
        for _ in 0..*size {
            points.push(Point::new(x, 1_000.0));
            x -= 100.0;
        }
        x -= 400.0;
    }
    points
}

/// D2: regions of two points are dropped, those of three are kept.
#[test]
fn d2_two_points_are_no_line_and_three_are() {
    for (sizes, count) in [(&[2][..], 0), (&[3], 1), (&[2, 3, 2, 2, 4, 1], 2), (&[], 0)] {
        assert_eq!(
            lines(&groups(sizes), &Settings::DEFAULT).len(),
            count,
            "{sizes:?}"
        );
    }
}

/// YN-02: of two consecutive regions that are too short, the second is skipped and stays. YN-03: a
/// region of two counts as three. YN-04: one of three counts as two.
#[test]
fn the_fielded_search_miscounts_its_points() {
    let count = |sizes: &[u16], defects| lines(&groups(sizes), &with(defects)).len();
    let skips = Defects {
        skips_behind_erased: true,
        ..Defects::NONE
    };
    assert_eq!((count(&[2, 2], skips), count(&[2, 5, 2], skips)), (1, 1));
    let duplicates = Defects {
        duplicates_last: true,
        ..Defects::NONE
    };
    assert_eq!((count(&[2], duplicates), count(&[1], duplicates)), (1, 0));
    let drops = Defects {
        drops_first: true,
        ..Defects::NONE
    };
    assert_eq!((count(&[3], drops), count(&[4], drops)), (0, 1));
}

/// A distance of 299 mm is no gap, one of 301 mm is.
#[test]
fn a_gap_ends_a_region() {
    let row = |gap: f32| {
        let x = [0.0, 100.0, 200.0, 200.0 + gap, 300.0 + gap, 400.0 + gap];
        x.map(|x: f32| Point::new(-x, 1_000.0))
    };
    assert_eq!(lines(&row(299.0), &Settings::DEFAULT).len(), 1);
    assert_eq!(lines(&row(301.0), &Settings::DEFAULT).len(), 2);
}

/// A wall across the scan's beginning is one line, 2 m long. With chords (YN-05), its halves are
/// two lines unless they are merged, and the ends of a line are two noisy points.
#[test]
fn a_wall_across_the_beginning_is_one() {
    let points = scan(&[[1.0, -1.0, 1.0, 1.0]], 5.0, 4);
    let found = lines(&points, &Settings::DEFAULT);
    assert_eq!(found.len(), 1);
    let length = found[0].start.distance_mm(found[0].end);
    assert!((length - 2_000.0).abs() < 40.0, "{length}");
    assert!(found[0].start.y_mm < 0.0 && found[0].end.y_mm > 0.0);
    let off = |line: &Line| (line.start.x_mm - 1_000.0).abs() + (line.end.x_mm - 1_000.0).abs();
    let chords = Defects {
        draws_chords: true,
        ..Defects::NONE
    };
    let (mut fitted, mut drawn) = (0.0, 0.0);
    for seed in 1..=50 {
        let points = scan(&[[1.0, -1.0, 1.0, 1.0]], 5.0, seed);
        fitted += off(&lines(&points, &Settings::DEFAULT)[0]);
        drawn += off(&lines(&points, &with(chords))[0]);
    }
    assert!(fitted * 3.0 < drawn, "{fitted} {drawn}");
}

/// A saw of 30 walls: 20 lines are sent, the others counted.
#[test]
fn more_than_twenty_lines_are_counted() {
    let points = groups(&[3; 30]);
    let found = Lines::find(&points, &Settings::DEFAULT);
    assert_eq!((found.as_slice().len(), found.left_out()), (20, 10));
    let found = Lines::find(&groups(&[3; 80]), &Settings::DEFAULT);
    assert_eq!((found.as_slice().len(), found.left_out()), (20, 60));
}
