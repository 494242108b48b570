//! The few walls that a ray can meet first, by the place of its origin and its direction.
//!
//! A lidar casts thousands of rays from almost the same place. The floor is divided into square
//! places, and each place's directions into sectors. A sector lists the nearest primitives that any
//! ray from the place may meet in these directions, each with a lower bound of its distance. A ray
//! tests them in this order, and stops at a hit nearer than all further bounds. If the list is too
//! short, the [grid](super::grid) answers.
//!
//! A bound errs on one side only, and each primitive is tested exactly. So the result is the same
//! as that of a test of every primitive, to the last bit.

use core::f64::consts::{SQRT_2, TAU};
use core::sync::atomic::{AtomicU32, Ordering};
use std::sync::{LazyLock, OnceLock};

use super::geometry::{Bounds, Crossing, Point, Primitive, Ray};

/// Side of a place. A robot crosses it in a second, some thousand rays.
const PLACE_M: f64 = 0.25;
/// Sectors of a full turn.
const SECTORS: usize = 256;
/// Primitives that a sector lists.
const LISTED: usize = 6;
/// Rays for each primitive before a place is prepared, which costs about as much.
const RAYS_PER_PRIMITIVE: u32 = 2;
/// Limits beyond which a scene has no such places: the lists of a place take 26 kB.
const PRIMITIVES_MAX: usize = 1024;
const PLACES_MAX: f64 = 16_384.0;
/// Prepared places of one scene at most.
const PREPARED_MAX: u32 = 256;
/// Slack of places in metres, and of directions in radians: far above all rounding.
const MARGIN: f64 = 1e-6;
/// Directions beyond this many turns have too few binary places left.
const TURNS_MAX: f64 = 1024.0;
/// The sine between two edges of a sector exceeds the greater one by less than this.
const BULGE: f64 = 1e-4;

/// Directions of the sectors' edges.
static EDGES: LazyLock<[Point; SECTORS + 1]> = LazyLock::new(|| {
    let mut edge = 0.0;
    [(); SECTORS + 1].map(|()| {
        let (sin, cos) = libm::sincos(edge * TAU / SECTORS as f64);
        edge += 1.0;
        Point::new(cos, sin)
    })
});

/// The places of a scene.
#[derive(Debug)]
pub(super) struct Places {
    corner: Point,
    columns: usize,
    places: Vec<Place>,
    prepared: AtomicU32,
}

/// One place.
#[derive(Debug, Default)]
struct Place {
    /// Rays so far.
    rays: AtomicU32,
    sectors: OnceLock<Box<[Sector]>>,
}

/// The primitives that a ray in these directions may meet.
#[derive(Clone, Debug)]
struct Sector {
    /// The nearest primitives: a lower bound of the distance, metres, and the index of each.
    listed: [(f64, u32); LISTED],
    /// Lower bound of the distance of all others.
    rest: f64,
}

impl Places {
    /// The places of a scene with these primitives within `bounds`; none if it is too large.
    pub(super) fn new(primitives: &[Primitive], bounds: Bounds) -> Self {
        let [width, height] = [bounds.max.x - bounds.min.x, bounds.max.y - bounds.min.y]
            .map(|size| (size / PLACE_M).floor() + 1.0);
        let is_small = !primitives.is_empty() && primitives.len() <= PRIMITIVES_MAX;
        let mut places = Vec::new();
        let columns = whole(width);
        if is_small && width * height <= PLACES_MAX {
            places.resize_with(columns * whole(height), Place::default);
        }
        Self {
            corner: bounds.min,
            columns,
            places,
            prepared: AtomicU32::new(0),
        }
    }

    /// The primitive that `ray` in the direction `angle` meets first within `limit`: `Ok` with the
    /// result of [`Grid::cross`](super::grid::Grid::cross), or `Err` if only the grid knows it.
    #[inline]
    pub(super) fn cross(
        &self,
        primitives: &[Primitive],
        (ray, angle): (Ray, f64),
        limit: f64,
    ) -> Result<Option<(usize, Crossing)>, Unlisted> {
        let sectors = self.sectors_at(primitives, ray.from).ok_or(Unlisted)?;
        if angle.is_nan() || angle.abs() > TURNS_MAX * TAU {
            return Err(Unlisted);
        }
        let sector = &sectors[sector_of(angle)];
        // Plain numbers, which stay in registers.
        let (mut distance, mut incidence, mut first) = (limit, 0.0, NOTHING);
        for &(bound, index) in &sector.listed {
            if distance < bound {
                break;
            }
            let index = index as usize;
            let Some(found) = primitives[index].cross(ray, distance) else {
                continue;
            };
            if found.distance < distance || index < first {
                (distance, incidence, first) = (found.distance, found.incidence, index);
            }
        }
        // A hit at the bound of an unlisted primitive may not be the first one.
        if distance < sector.rest {
            let crossing = Crossing {
                distance,
                incidence,
            };
            return Ok((first != NOTHING).then_some((first, crossing)));
        }
        Err(Unlisted)
    }

    /// The sectors of the place at `from`, if it is prepared.
    #[inline]
    fn sectors_at(&self, primitives: &[Primitive], from: Point) -> Option<&[Sector]> {
        let column = (from.x - self.corner.x) * (1.0 / PLACE_M);
        let row = (from.y - self.corner.y) * (1.0 / PLACE_M);
        // A negative or absurd coordinate is in no place.
        if !(column >= 0.0 && column < self.columns as f64 && row >= 0.0) {
            return None;
        }
        let (column, row) = (whole(column), whole(row));
        let place = self.places.get(row.saturating_mul(self.columns) + column)?;
        if let Some(sectors) = place.sectors.get() {
            return Some(sectors);
        }
        self.prepare(place, primitives, (column, row))
    }

    /// Prepares a place after enough rays.
    #[cold]
    fn prepare<'a>(
        &self,
        place: &'a Place,
        primitives: &[Primitive],
        (column, row): (usize, usize),
    ) -> Option<&'a [Sector]> {
        let rays = place.rays.fetch_add(1, Ordering::Relaxed);
        let enough = u32::try_from(primitives.len()).ok()? * RAYS_PER_PRIMITIVE;
        if rays < enough || self.prepared.load(Ordering::Relaxed) >= PREPARED_MAX {
            return None;
        }
        self.prepared.fetch_add(1, Ordering::Relaxed);
        let middle = |corner: f64, cell: usize| corner + (cell as f64 + 0.5) * PLACE_M;
        let middle = Point::new(middle(self.corner.x, column), middle(self.corner.y, row));
        Some(place.sectors.get_or_init(|| sectors(primitives, middle)))
    }
}

/// No primitive.
const NOTHING: usize = usize::MAX;

/// The sectors have no answer: only the grid knows it.
#[derive(Debug)]
pub(super) struct Unlisted;

/// The sectors of the place around `middle`, taken as the circle around it.
fn sectors(primitives: &[Primitive], middle: Point) -> Box<[Sector]> {
    let empty = Sector {
        listed: [(f64::INFINITY, 0); LISTED],
        rest: f64::INFINITY,
    };
    let mut sectors = vec![empty; SECTORS].into_boxed_slice();
    for (index, primitive) in (0..).zip(primitives) {
        let view = View::of(primitive, middle);
        for number in view.first..view.first + view.count {
            let number = number % SECTORS;
            sectors[number].add(index, view.bound(number));
        }
    }
    sectors
}

impl Sector {
    /// Adds a primitive that is at least `bound` metres away.
    fn add(&mut self, index: u32, bound: f64) {
        let mut added = (bound, index);
        for listed in &mut self.listed {
            if added.0 < listed.0 {
                core::mem::swap(&mut added, listed);
            }
        }
        self.rest = self.rest.min(added.0);
    }
}

/// A primitive as seen from anywhere in a place.
struct View {
    /// First sector and number of sectors in which it may be met.
    first: usize,
    count: usize,
    /// Least distance from the place.
    distance: f64,
    /// Direction of a wall, and the distance of the place from its whole line.
    line: Option<(Point, f64)>,
}

/// Radius of the circle around the middle of a place that contains the place.
const REACH_M: f64 = PLACE_M * SQRT_2 / 2.0 + MARGIN;

impl View {
    fn of(primitive: &Primitive, middle: Point) -> Self {
        let distance = primitive.nearest(middle).1 - REACH_M;
        let around = Self {
            first: 0,
            count: SECTORS,
            distance: 0.0,
            line: None,
        };
        if distance <= MARGIN {
            return around;
        }
        let to = |point: Point| Point::new(point.x - middle.x, point.y - middle.y);
        match primitive {
            Primitive::Segment(wall) => {
                let [one, other] = wall.ends().map(to);
                let cross = one.x * other.y - one.y * other.x;
                let turn = libm::atan2(cross, one.x * other.x + one.y * other.y);
                let angle = libm::atan2(one.y, one.x);
                let [wide, other_wide] = [one, other].map(|end| half_width(end, REACH_M));
                let along = wall.along();
                let line_m = (one.x * along.y - one.y * along.x).abs() - REACH_M;
                Self {
                    distance,
                    line: (line_m > 0.0).then_some((along, line_m)),
                    ..around
                }
                .between(
                    (angle - wide).min(angle + turn - other_wide),
                    (angle + wide).max(angle + turn + other_wide),
                )
            }
            Primitive::Circle(circle) => {
                let middle = to(circle.center);
                let reach = circle.radius + REACH_M;
                // A place within the circle sees it all around.
                if middle.distance(Point::default()) <= reach + MARGIN {
                    return Self { distance, ..around };
                }
                let angle = libm::atan2(middle.y, middle.x);
                let wide = half_width(middle, reach);
                Self { distance, ..around }.between(angle - wide, angle + wide)
            }
        }
    }

    /// Limits the sectors to those of the directions from `least` to `greatest`.
    fn between(self, least: f64, greatest: f64) -> Self {
        // Above zero, to round in one direction.
        let place = |angle: f64| whole((angle + 2.0 * TAU) * (SECTORS as f64 / TAU));
        let (first, last) = (place(least - MARGIN), place(greatest + MARGIN));
        Self {
            first,
            count: (last - first + 1).min(SECTORS),
            ..self
        }
    }

    /// Lower bound of the distance in a sector.
    fn bound(&self, sector: usize) -> f64 {
        let mut bound = self.distance;
        if let Some((along, line_m)) = self.line {
            let sine = |edge: &Point| (edge.x * along.y - edge.y * along.x).abs();
            let sine = sine(&EDGES[sector]).max(sine(&EDGES[sector + 1])) + BULGE;
            bound = bound.max(line_m / sine);
        }
        bound * (1.0 - MARGIN) - MARGIN
    }
}

/// Half of the angle at which a circle of `reach` around `middle` is seen.
fn half_width(middle: Point, reach: f64) -> f64 {
    libm::asin((reach / middle.distance(Point::default())).min(1.0))
}

/// The sector of a direction.
#[inline]
fn sector_of(angle: f64) -> usize {
    // Above zero, to round in one direction.
    whole((angle + TURNS_MAX * TAU) * (SECTORS as f64 / TAU)) % SECTORS
}

/// A number that is not negative, rounded down.
#[inline]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast of a float saturates"
)]
const fn whole(value: f64) -> usize {
    value as usize
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::geometry::{Circle, Segment};
    use super::*;

    /// The specification: test everything, keep the nearest, the first of equals.
    fn naive(primitives: &[Primitive], ray: Ray, limit: f64) -> Option<(usize, Crossing)> {
        let all = primitives
            .iter()
            .map(|primitive| primitive.cross(ray, limit))
            .enumerate();
        let hits = all.filter_map(|(index, crossing)| Some((index, crossing?)));
        hits.reduce(|a, b| if b.1.distance < a.1.distance { b } else { a })
    }

    /// Coordinates on a coarse lattice, so that walls meet, overlap and end at corners of places;
    /// and a few anywhere.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![
            3 => (-12..=12_i32).prop_map(|step| f64::from(step) * 0.125),
            1 => -3.0..3.0_f64,
        ]
    }

    fn point() -> impl Strategy<Value = Point> {
        (coordinate(), coordinate()).prop_map(|(x, y)| Point::new(x, y))
    }

    fn primitive() -> impl Strategy<Value = Primitive> {
        let wall = (point(), point()).prop_filter_map("no length", |(a, b)| {
            Segment::new(a, b).map(Primitive::Segment)
        });
        let circle = (point(), prop_oneof![Just(0.25), 0.005..1.5_f64])
            .prop_map(|(center, radius)| Primitive::Circle(Circle { center, radius }));
        prop_oneof![3 => wall, 1 => circle]
    }

    /// Directions along the lattice, along edges of sectors, and any.
    fn angle() -> impl Strategy<Value = f64> {
        let edge = TAU / SECTORS as f64;
        prop_oneof![
            (-600..=600_i32).prop_map(move |number| f64::from(number) * edge),
            (-8..=8_i32).prop_map(|n| f64::from(n) * core::f64::consts::FRAC_PI_4),
            -4.0..4.0_f64,
        ]
    }

    /// A place in the middle of the lattice, and its rays: from its corners, edges and inside.
    fn rays() -> impl Strategy<Value = Vec<(Point, f64)>> {
        let part = || prop_oneof![Just(0.0), Just(0.249_999_999), 0.0..0.25_f64];
        let ray = (part(), part(), angle()).prop_map(|(x, y, angle)| (Point::new(x, y), angle));
        prop::collection::vec(ray, 20..60)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8 * ProptestConfig::default().cases))]

        /// Each answer of a prepared place is that of a test of everything.
        #[test]
        fn a_place_finds_what_testing_everything_finds(
            primitives in prop::collection::vec(primitive(), 1..40),
            rays in rays(),
            limit in prop_oneof![Just(6.0), Just(f64::INFINITY), 0.0..3.0_f64],
        ) {
            let bounds = Bounds::around(Point::default(), 1.5);
            let places = Places::new(&primitives, bounds);
            for _ in 0..=primitives.len() {
                for _ in 0..RAYS_PER_PRIMITIVE {
                    places.sectors_at(&primitives, Point::default());
                }
            }
            prop_assert!(places.sectors_at(&primitives, Point::default()).is_some());
            for (from, angle) in rays {
                let ray = Ray::new(from, angle);
                if let Ok(found) = places.cross(&primitives, (ray, angle), limit) {
                    prop_assert_eq!(found, naive(&primitives, ray, limit));
                }
            }
        }
    }

    /// A room of four walls, 4 m wide: every ray from its middle gets an answer after eight others,
    /// and none from outside.
    #[test]
    fn a_room_is_known_after_a_few_rays() {
        let corners = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)];
        let corners = corners.map(|(x, y)| Point::new(x, y));
        let wall = |at: usize| Segment::new(corners[at], corners[(at + 1) % 4]).expect("long");
        let walls = [0, 1, 2, 3].map(|at| Primitive::Segment(wall(at)));
        let places = Places::new(&walls, Bounds::around(Point::default(), 2.0));
        let cast = |x: f64, angle: f64| {
            let ray = Ray::new(Point::new(x, 0.1), angle);
            places.cross(&walls, (ray, angle), 9.0)
        };
        assert!((0..8).all(|_| cast(0.1, 0.0).is_err()));
        for degree in -720..720 {
            let found = cast(0.1, f64::from(degree).to_radians()).expect("prepared");
            assert!(found.is_some_and(|(_, crossing)| crossing.distance < 3.0));
        }
        assert!(cast(0.1, f64::NAN).is_err() && cast(0.1, 1e5).is_err());
        assert!(cast(-2.1, 0.0).is_err() && cast(f64::NAN, 0.0).is_err());
    }
}
