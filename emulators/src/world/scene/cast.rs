//! Ray casts: fixtures by their places or the grid, then obstacles.

use protocols::Instant;

use super::{Hit, Scene};
use crate::world::geometry::{Point, Ray};

impl Scene {
    /// First hit of a ray at time `at`, within `max_range` metres.
    pub fn cast_ray(&self, at: Instant, from: Point, angle: f64, max_range: f64) -> Option<Hit> {
        self.cast(at, (Ray::new(from, angle), angle), max_range)
    }

    /// As [`cast_ray`](Self::cast_ray), for a direction whose unit vector is known: the sine and
    /// cosine of the angle by `libm::sincos`.
    pub fn cast_ahead(
        &self,
        at: Instant,
        (from, angle, dir): (Point, f64, Point),
        max_range: f64,
    ) -> Option<Hit> {
        self.cast(at, (Ray { from, dir }, angle), max_range)
    }

    fn cast(&self, at: Instant, (ray, angle): (Ray, f64), max_range: f64) -> Option<Hit> {
        let inner = &*self.inner;
        let primitives = &inner.fixed.primitives;
        let fixed = inner
            .places
            .cross(primitives, (ray, angle), max_range)
            .unwrap_or_else(|_| inner.grid.cross(primitives, ray, max_range));
        let mut limit = max_range;
        let mut hit = fixed.map(|(index, crossing)| {
            limit = crossing.distance;
            Hit::new(crossing, inner.fixed.reflectivity[index])
        });
        for moving in &inner.moving {
            let placed = moving.placed(at);
            let ray = ray.seen_from(placed.origin);
            if !ray.passes_origin(moving.reach()) {
                continue;
            }
            for (primitive, reflectivity) in placed.surfaces() {
                if let Some(crossing) = primitive.cross(ray, limit).filter(|c| c.distance < limit) {
                    limit = crossing.distance;
                    hit = Some(Hit::new(crossing, reflectivity));
                }
            }
        }
        hit
    }
}
