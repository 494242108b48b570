//! The world's own ray cast against parry2d: another library, another algorithm, the same hits.

use emulators::world::{Point, Scene, Shape};
use proptest::prelude::*;
use protocols::Instant;
use ray_oracle::flat;
use ray_oracle::rival::Rival;

const RANGE_M: f64 = 30.0;

fn place() -> impl Strategy<Value = Point> {
    (-6.0..6.0_f64, -6.0..6.0_f64).prop_map(|(x, y)| Point::new(x, y))
}

fn shape() -> impl Strategy<Value = Shape> {
    let wall = (place(), place())
        .prop_filter("parry2d finds no hit on a wall of no length", |(a, b)| {
            a.distance(*b) > 0.01
        })
        .prop_map(|(from, to)| Shape::Wall { from, to });
    let leg = (place(), 0.005..0.05_f64)
        .prop_map(|(center, radius_m)| Shape::Circle { center, radius_m });
    let pillar =
        (place(), 0.05..2.0_f64).prop_map(|(center, radius_m)| Shape::Circle { center, radius_m });
    prop_oneof![4 => wall, 2 => leg, 1 => pillar]
}

/// Both rays hit nothing, or the distances and incidences are equal. If ray and surface are nearly
/// parallel, rounding errors are multiplied by one over the sine, in parry2d by its square.
fn agree(ours: Option<(f64, f64)>, theirs: Option<(f64, f64)>) -> bool {
    match (ours, theirs) {
        (None, None) => true,
        (Some((distance, incidence)), Some((other, other_incidence))) => {
            let slack = 1e-9 * distance.max(1.0) / incidence.min(1e-2).powi(2) * 1e-4;
            (distance - other).abs() <= slack
                && (incidence - other_incidence).abs() <= slack.max(1e-9)
        }
        _ => false,
    }
}

fn both(shapes: &[Shape], from: Point, angle: f64) -> [Option<(f64, f64)>; 2] {
    let scene = Scene::new(shapes.to_vec(), vec![]).expect("generated shapes are sound");
    let ours = scene.cast_ray(Instant::ZERO, from, angle, RANGE_M);
    [
        ours.map(|hit| (hit.distance, hit.incidence)),
        Rival::new(shapes).cast_ray(from, angle, RANGE_M),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4 * ProptestConfig::default().cases))]

    #[test]
    fn rays_hit_what_parry2d_says_they_hit(
        shapes in prop::collection::vec(shape(), 1..40),
        from in place(),
        angle in -7.0..7.0_f64,
    ) {
        let [ours, theirs] = both(&shapes, from, angle);
        prop_assert!(agree(ours, theirs), "ours {ours:?}, parry2d {theirs:?}");
    }

    /// Rays that start far outside must first enter the grid.
    #[test]
    fn rays_from_outside_hit_what_parry2d_says_they_hit(
        shapes in prop::collection::vec(shape(), 1..40),
        turn in 0.0..core::f64::consts::TAU,
        aim in -0.5..0.5_f64,
    ) {
        let from = Point::new(-20.0 * turn.cos(), -20.0 * turn.sin());
        let [ours, theirs] = both(&shapes, from, turn + aim);
        prop_assert!(agree(ours, theirs), "ours {ours:?}, parry2d {theirs:?}");
    }
}

#[test]
fn a_furnished_flat_looks_the_same_to_parry2d() {
    let shapes = flat::furnished_flat();
    let scene = Scene::new(shapes.clone(), vec![]).expect("the flat is sound");
    let rival = Rival::new(&shapes);
    let mut differing = vec![];
    for (x, y) in [(0.83, 1.61), (1.21, 2.37), (2.41, 1.13), (1.65, 1.5)] {
        let from = Point::new(x, y);
        // A third of a degree and an odd start keep the beams off the corners.
        for beam in 0..1080 {
            let angle = (f64::from(beam) / 3.0 + 0.123).to_radians();
            let ours = scene.cast_ray(Instant::ZERO, from, angle, RANGE_M);
            let ours = ours.map(|hit| (hit.distance, hit.incidence));
            let theirs = rival.cast_ray(from, angle, RANGE_M);
            if !agree(ours, theirs) {
                differing.push((from, beam, ours, theirs));
            }
        }
    }
    assert!(differing.is_empty(), "{differing:?}");
}
