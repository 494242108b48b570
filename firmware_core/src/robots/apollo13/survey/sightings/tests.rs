extern crate std;

use std::vec::Vec;

use super::*;
use crate::random::Pcg32;

/// A camera of 525 pixels before a wall that is `depth_m` away in its middle and nearer by `slope`
/// for each metre to the left; each of the 640 inverse depths has an error of 0.00143 / m.
fn scan(depth_m: f64, slope: f64, seed: u64) -> Vec<[f64; 2]> {
    let mut random = Pcg32::new(seed);
    (0..640)
        .map(|column| {
            let t = (319.5 - f64::from(column)) / 525.0;
            // z = depth - slope z t.
            let inverse = (1.0 + slope * t) / depth_m + random.normal(0.001_43);
            [libm::atan(t), libm::sqrt(1.0 + t * t) / inverse]
        })
        .collect()
}

/// 6 m ahead single depths have an error of 36 * 1.43 = 51 mm. 0.6 m to either side are 52 columns:
/// the mean of the 40 nearest to either side has an error of 51 / 9 = 5.7 mm.
#[test]
fn a_wall_far_ahead_is_as_straight_as_it_is() {
    for (slope, seed) in [(0.0, 1), (0.2, 2), (-0.2, 3)] {
        let places = sightings(scan(6.0, slope, seed).into_iter(), 9.0);
        assert_eq!(places.len(), 640);
        let middle = &places[100..540];
        let off = |it: &Sighting| it.at[0] + slope * it.at[1] - 6.0;
        let squares: f64 = middle.iter().map(|it| off(it) * off(it)).sum();
        let rms_m = libm::sqrt(squares / middle.len() as f64);
        assert!(rms_m < 0.010, "{rms_m}");
        // The wall runs along (-slope, 1).
        let along = middle.iter().filter_map(|it| it.along);
        let askew = along.map(|[x, y]| (x + slope * y).abs());
        assert!(askew.fold(0.0, f64::max) < 0.1);
    }
}

/// A pillar's edge: 2 m to the left of the middle, 3 m to the right. No point is moved between
/// them.
#[test]
fn no_place_lies_between_a_pillar_and_what_is_behind() {
    let [near, far] = [scan(2.0, 0.0, 4), scan(3.0, 0.0, 5)];
    let both = near[..320].iter().chain(&far[320..]).copied();
    for it in sightings(both, 9.0) {
        let is_near = (it.at[0] - 2.0).abs() < 0.03;
        assert!(is_near || (it.at[0] - 3.0).abs() < 0.06, "{it:?}");
        assert_eq!(is_near, it.at[1] > 0.0);
    }
}

/// A few points without neighbours stay unchanged; invalid readings are left out.
#[test]
fn what_has_no_neighbours_stays_where_it_is() {
    let seen = [[0.1, 2.0], [0.0, f64::INFINITY], [-0.1, 1.0], [-0.2, 12.0]];
    let places = sightings(seen.into_iter(), 9.0);
    assert_eq!(places.len(), 2);
    // A point at 2 m and 0.1 rad is 1.990 m ahead, 0.1997 to the left.
    assert!((places[0].at[0] - 1.990).abs() < 1e-3 && (places[0].at[1] - 0.1997).abs() < 1e-3);
    assert!(places.iter().all(|it| it.along.is_none()));
    // The deviation is 4 mm plus 1.5 mm times the square of the depth in metres, here 1.990; the
    // second depth is 0.995.
    assert!((places[0].sigma - 0.009_94).abs() < 1e-5);
    assert!((places[1].sigma - 0.005_485).abs() < 1e-5);
    assert!(sightings(core::iter::empty(), 9.0).is_empty());
}

/// A camera of 525 pixels before an even wall, without noise.
fn even(depth_m: f64) -> Vec<Sighting> {
    let seen = (0..640).map(|column| {
        let t = (319.5 - f64::from(column)) / 525.0;
        [libm::atan(t), libm::sqrt(1.0 + t * t) * depth_m]
    });
    sightings(seen, 99.0)
}

/// 6 m ahead 81 points count, and their mean has an error of 36 * 1.43 mm / 9. The very first point
/// is the end of a run of 41, 20 from its middle, with a mean square of (41^2 - 1) / 12 = 140: its
/// error is sqrt((1 + 400 / 140) / 41) = 0.30673 of 51.48 mm. 12 m ahead 80 columns are 1.83 m,
/// more than 1.2 m, so 41 points count. Straight ahead at 1 m the error is the minimum, 4 mm.
#[test]
fn a_place_is_as_sure_as_the_mean_of_its_neighbours() {
    let is = |found: f64, expected: f64| (found - expected).abs() < 2e-6;
    let wall = even(6.0);
    assert!(is(wall[320].sigma, 0.005_72), "{:?}", wall[320]);
    assert!(is(wall[0].sigma, 0.015_790), "{:?}", wall[0]);
    assert!(is(wall[639].sigma, 0.015_790), "{:?}", wall[639]);
    assert!(
        is(even(12.0)[320].sigma, 0.032_159),
        "{:?}",
        even(12.0)[320]
    );
    assert!(is(even(1.0)[320].sigma, 0.004));
    let across = wall[320].along.expect("it is a wall");
    assert!(across[0].abs() < 1e-9 && is(across[1].abs(), 1.0));
}

/// 3, 4 and 5: a point at exactly the reach is within it, at a reach 1 mm shorter it is not.
#[test]
fn the_reach_is_a_distance() {
    assert!(is_within([3.0, 4.0], 5.0) && is_within([3.0, -4.0], 5.002));
    assert!(!is_within([3.0, 4.0], 4.999) && !is_within([-3.0, 4.0], 2.5));
    assert!(is_within([0.3, 0.4], 5.0));
}

/// Columns without a depth, each tenth of a wall, are left out as neighbours.
#[test]
fn what_has_no_depth_is_left_out() {
    let wall = scan(3.0, 0.1, 6);
    let kept = wall.iter().enumerate().filter(|(at, _)| at % 10 != 0);
    let kept: Vec<[f64; 2]> = kept.map(|(_, seen)| *seen).collect();
    let holed = wall
        .iter()
        .enumerate()
        .map(|(at, [bearing, range])| match at % 10 {
            0 => [*bearing, f64::INFINITY],
            _ => [*bearing, *range],
        });
    let places = |all: Vec<Sighting>| all.iter().map(|it| it.at).collect::<Vec<_>>();
    assert_eq!(
        places(sightings(holed, 9.0)),
        places(sightings(kept.into_iter(), 9.0))
    );
}

/// Columns 16 cm apart on a wall 8 m ahead: five to either side span 1.6 m, longer than the
/// straight limit, but fewer neighbours are not used.
#[test]
fn five_neighbours_to_either_side_are_asked_however_far_they_are() {
    let wall = (-10..=10).map(|column| {
        let t = f64::from(column) * 0.02;
        [libm::atan(t), 8.0 * libm::sqrt(1.0 + t * t)]
    });
    let places = sightings(wall, 9.0);
    assert_eq!(places.len(), 21);
    let middle = &places[10];
    let along = middle.along.expect("it is of a line");
    assert!((along[1].abs() - 1.0).abs() < 1e-6, "{along:?}");
    assert!((middle.at[0] - 8.0).abs() < 1e-6, "{middle:?}");
}
