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

/// A number that is not negative, rounded down. By way of 32 bits, because a cast to 64 bits
/// without sign takes three times the instructions.
#[inline]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast of a float saturates"
)]
const fn whole(value: f64) -> usize {
    value as u32 as usize
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::geometry::{Circle, Segment};
    use super::*;

    /// The specification: test every primitive and keep the nearest, or the first of equally near
    /// ones.
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

    /// Directions along the lattice, along the edges of sectors, and any others.
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

        /// Each answer of a prepared place equals that of a test of all surfaces.
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

    fn wall(from: (f64, f64), to: (f64, f64)) -> Primitive {
        let [from, to] = [from, to].map(|(x, y)| Point::new(x, y));
        Primitive::Segment(Segment::new(from, to).expect("long"))
    }

    fn circle(x: f64, y: f64, radius: f64) -> Primitive {
        let center = Point::new(x, y);
        Primitive::Circle(Circle { center, radius })
    }

    /// All of a place lies within 0.176778 m of its middle, and a sector has 1.40625 degrees. A
    /// wall across at 2 m, a metre to either side, is 1.823222 m away, seen 26.565 + 4.534 degrees
    /// to either side. The slanted wall of 5 m has its end at (2, 1.5) from the middle, 2.5 m away,
    /// and its line 0.7 m. A wall whose line crosses the place has no line. The middle of the
    /// second circle is 2.5 m away, at 143.13 degrees, with a reach of 0.426778 m.
    #[test]
    fn a_primitive_is_seen_in_its_sectors_from_its_distance_on() {
        let near = |found: f64, expected: f64| (found - expected).abs() < 2e-6;
        let view = |primitive: Primitive, middle: (f64, f64)| {
            View::of(&primitive, Point::new(middle.0, middle.1))
        };
        for (primitive, middle, first, count, distance, line) in [
            (
                wall((2.0, -1.0), (2.0, 1.0)),
                (0.0, 0.0),
                233,
                46,
                1.823_222,
                1.823_222,
            ),
            (
                wall((-2.0, 1.0), (-2.0, -1.0)),
                (0.0, 0.0),
                105,
                46,
                1.823_222,
                1.823_222,
            ),
            (
                wall((1.0, 2.0), (4.0, 6.0)),
                (-1.0, 0.5),
                23,
                12,
                2.323_222,
                0.523_222,
            ),
            (
                wall((4.0, 6.0), (1.0, 2.0)),
                (-1.0, 0.5),
                23,
                12,
                2.323_222,
                0.523_222,
            ),
            (
                wall((1.0, 1.0), (3.0, 3.0)),
                (0.0, 0.1),
                24,
                12,
                1.168_585,
                0.0,
            ),
            (circle(3.0, 0.0, 0.5), (0.0, 0.0), 246, 20, 2.323_222, 0.0),
            (circle(-1.0, 3.5, 0.25), (1.0, 2.0), 94, 15, 2.073_222, 0.0),
        ] {
            let view = view(primitive, middle);
            assert_eq!(
                (view.first % SECTORS, view.count),
                (first, count),
                "{primitive:?}"
            );
            assert!(
                near(view.distance, distance),
                "{primitive:?} {}",
                view.distance
            );
            let line_m = view.line.map_or(0.0, |(_, line_m)| line_m);
            assert!(near(line_m, line), "{primitive:?} {line_m}");
        }
        // Around a place within a circle, and around one that a wall touches.
        let within = view(circle(0.1, 0.0, 2.0), (0.0, 0.0));
        assert_eq!((within.first, within.count), (0, SECTORS));
        assert!(near(within.distance, 1.723_222) && within.line.is_none());
        let touched = view(wall((0.17, -1.0), (0.17, 1.0)), (0.0, 0.0));
        assert_eq!(
            (touched.first, touched.count, touched.distance),
            (0, SECTORS, 0.0)
        );
    }

    /// The wall at 2 m in the sector straight ahead: its own distance. At 28.1 to 29.5 degrees the
    /// greater sine is 0.8820, and 1.823222 m by it are 2.0671 m.
    #[test]
    fn a_wall_is_farther_away_in_slanted_sectors() {
        let near = |found: f64, expected: f64| (found - expected).abs() < 1e-6;
        let square = View::of(&wall((2.0, -1.0), (2.0, 1.0)), Point::default());
        let bounds = [0, 20, 30, 250].map(|sector| square.bound(sector));
        let by_hand = [1.823_219, 2.067_093, 2.460_316, 1.836_850];
        assert!(
            bounds.iter().zip(by_hand).all(|(a, b)| near(*a, b)),
            "{bounds:?}"
        );
        let slanted = View::of(&wall((1.0, 2.0), (4.0, 6.0)), Point::new(-1.0, 0.5));
        assert!(near(slanted.bound(20), 2.323_219) && near(slanted.bound(30), 2.754_878));
        let round = View::of(&circle(3.0, 0.0, 0.5), Point::default());
        assert!(near(round.bound(0), 2.323_219) && near(round.bound(77), 2.323_219));
    }

    /// A reach of 2.5 m at 5 m is 30 degrees; from within it is a quarter turn.
    #[test]
    fn directions_fall_into_sectors() {
        let at = Point::new(3.0, 4.0);
        assert!((half_width(at, 2.5) - TAU / 12.0).abs() < 1e-12);
        assert!((half_width(at, 9.0) - TAU / 4.0).abs() < 1e-12);
        let sector = |degrees: f64| sector_of(degrees.to_radians());
        assert_eq!([0.1, 1.4, 1.5, 90.1, 359.9].map(sector), [0, 0, 1, 64, 255]);
        assert_eq!([-0.1, -90.1, -359.9, 450.1].map(sector), [255, 191, 0, 64]);
    }

    /// Six are listed, the nearest first; the rest begins with the seventh.
    #[test]
    fn a_sector_lists_its_nearest() {
        let mut sector = Sector {
            listed: [(f64::INFINITY, 0); LISTED],
            rest: f64::INFINITY,
        };
        for (index, bound) in (10..).zip([5.0, 3.0, 8.0, 1.0, 7.0, 2.0]) {
            sector.add(index, bound);
            assert_eq!(sector.rest, f64::INFINITY);
        }
        sector.add(16, 9.0);
        assert_eq!(sector.rest, 9.0);
        sector.add(17, 4.0);
        let expected = [
            (1.0, 13),
            (2.0, 15),
            (3.0, 11),
            (4.0, 17),
            (5.0, 10),
            (7.0, 14),
        ];
        assert_eq!((sector.listed, sector.rest), (expected, 8.0));
    }

    fn bounds_of(width: f64, height: f64) -> Bounds {
        let min = Point::new(1.0, -2.0);
        let max = Point::new(1.0 + width, -2.0 + height);
        Bounds { min, max }
    }

    /// 4 m by 2 m are 17 by 9 places of a quarter of a metre. 128 by 128 are the most, with 1024
    /// primitives.
    #[test]
    fn a_small_scene_has_places() {
        let walls = |count: usize| vec![wall((1.0, -2.0), (2.0, -2.0)); count];
        let places = |count: usize, width: f64, height: f64| {
            let places = Places::new(&walls(count), bounds_of(width, height));
            (places.columns, places.places.len())
        };
        assert_eq!(places(1, 4.0, 2.0), (17, 17 * 9));
        assert_eq!(
            (places(1024, 4.0, 2.0).1, places(1025, 4.0, 2.0).1),
            (153, 0)
        );
        assert_eq!(
            (places(1, 31.9, 31.9).1, places(1, 32.0, 31.9).1),
            (16_384, 0)
        );
        assert_eq!((places(1, 31.9, 32.0).1, places(0, 4.0, 2.0).1), (0, 0));
    }

    /// Two rays for each wall are counted at their own place, and the next one prepares it, seen
    /// from its middle. Beyond the scene there is no place.
    #[test]
    fn a_ray_counts_at_its_place() {
        let walls = [
            wall((1.0, -2.0), (5.0, -2.0)),
            wall((5.0, -2.0), (5.0, 0.0)),
        ];
        let places = Places::new(&walls, bounds_of(4.0, 2.0));
        let at = Point::new(1.8, -1.6);
        for rays in 1..=4 {
            assert!(places.sectors_at(&walls, at).is_none());
            // Column 3 from 1.75 m, row 1 from -1.75 m.
            let counted = places
                .places
                .iter()
                .map(|place| place.rays.load(Ordering::Relaxed));
            let counted: Vec<u32> = counted.collect();
            assert_eq!((counted[17 + 3], counted.iter().sum::<u32>()), (rays, rays));
        }
        let prepared = places.sectors_at(&walls, at).expect("enough rays");
        let expected = sectors(&walls, Point::new(1.875, -1.625));
        for (found, expected) in prepared.iter().zip(&expected) {
            assert_eq!((found.listed, found.rest), (expected.listed, expected.rest));
        }
        assert_eq!(places.prepared.load(Ordering::Relaxed), 1);
        for (x, y) in [(0.9, -1.0), (5.3, -1.0), (3.0, -2.1), (3.0, 0.3)] {
            for _ in 0..9 {
                assert!(places.sectors_at(&walls, Point::new(x, y)).is_none());
            }
        }
    }

    #[test]
    fn no_more_than_256_places_are_prepared() {
        let walls = [wall((1.0, -2.0), (2.0, -2.0))];
        let places = Places::new(&walls, bounds_of(5.0, 5.0));
        let mut prepared = 0;
        for place in 0..300_u32 {
            let at = |cell: u32, corner: f64| corner + 0.25 * f64::from(cell) + 0.1;
            let at = Point::new(at(place % 20, 1.0), at(place / 20, -2.0));
            let asked = (0..3).filter(|_| places.sectors_at(&walls, at).is_some());
            prepared += asked.count();
        }
        assert_eq!(prepared, 256);
    }
}
