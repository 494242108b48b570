//! A floor plan for ray casts.

use emulators::world::{Point, Shape};

/// Two rooms of together 3 m x 3 m with a door, cupboards, a bed, a table, chairs: 60 walls and
/// 20 legs.
#[must_use]
pub fn furnished_flat() -> Vec<Shape> {
    let mut shapes = vec![
        rectangle(0.0, 0.0, 3.0, 3.0),
        wall(1.6, 0.0, 1.6, 1.1),
        wall(1.7, 0.0, 1.7, 1.1),
        wall(1.6, 1.1, 1.7, 1.1),
        wall(1.6, 1.9, 1.6, 3.0),
        wall(1.7, 1.9, 1.7, 3.0),
        wall(1.6, 1.9, 1.7, 1.9),
        wall(2.3, 1.4, 2.6, 1.7),
        wall(0.2, 2.0, 0.5, 2.2),
    ];
    for (x, y, width, depth) in [
        (0.0, 0.0, 0.4, 0.3),
        (0.5, 0.0, 0.6, 0.25),
        (0.0, 2.6, 0.9, 0.4),
        (1.2, 2.75, 0.4, 0.25),
        (1.35, 0.3, 0.25, 0.5),
        (1.7, 0.0, 0.5, 0.35),
        (2.6, 0.0, 0.4, 0.9),
        (1.7, 2.7, 0.6, 0.3),
        (2.75, 2.2, 0.25, 0.8),
        (0.0, 1.2, 0.2, 0.6),
        (2.9, 1.2, 0.1, 0.5),
        (1.62, 1.12, 0.06, 0.05),
    ] {
        shapes.push(rectangle(x, y, x + width, y + depth));
    }
    for (x, y) in [(0.7, 1.3), (1.1, 0.9), (0.5, 0.6), (2.2, 2.2), (2.3, 0.7)] {
        for (dx, dy) in [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)] {
            let center = Point::new(x + dx, y + dy);
            shapes.push(Shape::Circle {
                center,
                radius_m: 0.015,
            });
        }
    }
    shapes
}

fn wall(x0: f64, y0: f64, x1: f64, y1: f64) -> Shape {
    Shape::Wall {
        from: Point::new(x0, y0),
        to: Point::new(x1, y1),
    }
}

/// A rectangle by two opposite corners, metres.
#[must_use]
pub fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Shape {
    let corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        .map(|(x, y)| Point::new(x, y))
        .to_vec();
    Shape::Polygon { corners }
}
