//! Is the world's own ray cast at least three times as fast as parry2d? Otherwise parry2d should
//! take its place.
//!
//! Both cast the same 360-beam revolutions from places all over a furnished two-room flat of
//! 3 m x 3 m and of an office of 12 m x 12 m, from angle to distance and incidence. parry2d holds
//! walls and legs in one compound with its bounding volume hierarchy.

use core::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use emulators::world::{Point, Scene, Shape};
use protocols::Instant;
use ray_oracle::flat;
use ray_oracle::rival::Rival;

const RANGE_M: f64 = 6.0;

fn ray_casts(c: &mut Criterion) {
    compare(c, "flat", flat::furnished_flat(), 3.0);
    compare(c, "office", office(), 12.0);
}

fn compare(c: &mut Criterion, name: &str, shapes: Vec<Shape>, side_m: f64) {
    let rays = revolutions(side_m);
    let rival = Rival::new(&shapes);
    let scene = Scene::new(shapes, vec![]).expect("the shapes are sound");
    let mut group = c.benchmark_group(name);
    group.throughput(Throughput::Elements(rays.len() as u64));
    group.bench_function("ours", |b| {
        b.iter(|| {
            for &(from, angle) in &rays {
                black_box(scene.cast_ray(Instant::ZERO, from, angle, RANGE_M));
            }
        });
    });
    group.bench_function("parry2d", |b| {
        b.iter(|| {
            for &(from, angle) in &rays {
                black_box(rival.cast_ray(from, angle, RANGE_M));
            }
        });
    });
    group.finish();
}

/// 360 beams from each of 49 places on a lattice over the floor.
fn revolutions(side_m: f64) -> Vec<(Point, f64)> {
    let mut rays = Vec::new();
    for place in 0..49 {
        let (column, row) = (f64::from(place % 7), f64::from(place / 7));
        let at = |step: f64| (step + 0.613) / 7.3 * side_m;
        let from = Point::new(at(column), at(row));
        rays.extend((0..360).map(|degree| (from, f64::from(degree).to_radians())));
    }
    rays
}

/// 16 such flats side by side: 12 m x 12 m.
fn office() -> Vec<Shape> {
    let mut shapes = Vec::new();
    for flat in 0..16 {
        let (dx, dy) = (f64::from(flat % 4) * 3.0, f64::from(flat / 4) * 3.0);
        shapes.extend(
            flat::furnished_flat()
                .into_iter()
                .skip(1)
                .map(|shape| moved(shape, dx, dy)),
        );
    }
    shapes.push(flat::rectangle(0.0, 0.0, 12.0, 12.0));
    shapes
}

fn moved(shape: Shape, dx: f64, dy: f64) -> Shape {
    let by = |p: Point| Point::new(p.x + dx, p.y + dy);
    match shape {
        Shape::Wall { from, to } => Shape::Wall {
            from: by(from),
            to: by(to),
        },
        Shape::Polygon { corners } => Shape::Polygon {
            corners: corners.into_iter().map(by).collect(),
        },
        Shape::Circle { center, radius_m } => Shape::Circle {
            center: by(center),
            radius_m,
        },
    }
}

criterion_group!(benches, ray_casts);
criterion_main!(benches);
