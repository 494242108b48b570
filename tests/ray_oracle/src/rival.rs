//! The same shapes in parry2d.

use emulators::world::{Point, Shape};
use parry2d_f64::math::{Pose, Vector};
use parry2d_f64::query::{Ray, RayCast};
use parry2d_f64::shape::{Compound, SharedShape};

/// Walls and circles in a compound of parry2d, hollow as ours.
pub struct Rival(Compound);

impl Rival {
    /// Takes over all shapes.
    #[must_use]
    pub fn new(shapes: &[Shape]) -> Self {
        let mut parts = Vec::new();
        let at = |p: &Point| Vector::new(p.x, p.y);
        for shape in shapes {
            match shape {
                Shape::Wall { from, to } => {
                    parts.push((Pose::IDENTITY, SharedShape::segment(at(from), at(to))));
                }
                Shape::Polygon { corners } => {
                    for (index, from) in corners.iter().enumerate() {
                        let to = &corners[(index + 1) % corners.len()];
                        parts.push((Pose::IDENTITY, SharedShape::segment(at(from), at(to))));
                    }
                }
                Shape::Circle { center, radius_m } => {
                    let place = Pose::from_translation(at(center));
                    parts.push((place, SharedShape::ball(*radius_m)));
                }
            }
        }
        Self(Compound::new(parts))
    }

    /// Distance, metres, and cosine of the incidence.
    #[must_use]
    pub fn cast_ray(&self, from: Point, angle: f64, range: f64) -> Option<(f64, f64)> {
        let (sin, cos) = angle.sin_cos();
        let ray = Ray::new(Vector::new(from.x, from.y), Vector::new(cos, sin));
        let hit = self.0.cast_local_ray_and_get_normal(&ray, range, false)?;
        Some((hit.time_of_impact, hit.normal.dot(ray.dir).abs()))
    }
}
