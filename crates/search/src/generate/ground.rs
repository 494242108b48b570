use std::collections::VecDeque;
use std::path::PathBuf;

use emulators::world::{Outline, Point, Pose, World};

use engine::robots;
use engine::scenario::{PillarSpec, Scenario, Source, WorldSpec};

/// Minimum edge of a cell, metres, and maximum number of cells along an edge: a hall gets larger
/// cells.
const CELL_M: f64 = 0.06;
const EDGE_MAX: f64 = 160.0;
/// Number of headings that are tried for a body that is not a disc.
const HEADINGS: u8 = 4;
/// Surfaces within this distance beyond the margin are looked at: more than rounding.
const BEYOND_M: f64 = 0.01;

/// The free space of the true world: a mission from free cell to free cell is possible.
pub(super) struct Ground {
    origin: Point,
    cell_m: f64,
    width: usize,
    height: usize,
    /// Cells in which the robot fits with its margin.
    free: Vec<bool>,
}

/// Cells that can be reached from a cell, with their distances.
pub(super) struct Reach<'a> {
    ground: &'a Ground,
    /// Number of steps to each cell.
    steps: Vec<Option<u32>>,
}

impl Ground {
    /// Examines the world of `scenario` with the margin `margin_m` beside the robot. `None` if the
    /// world cannot be built; its run will report this.
    pub(super) fn of(scenario: &Scenario, margin_m: f64) -> Option<Self> {
        Some(Self::in_world(
            world_of(scenario)?,
            &scenario.world,
            margin_m,
        ))
    }

    /// The same as [`of`](Self::of) for a scenario with one more `pillar` than this one's: only
    /// cells near the pillar are examined again.
    pub(super) fn with_pillar(
        &self,
        scenario: &Scenario,
        pillar: &PillarSpec,
        margin_m: f64,
    ) -> Option<Self> {
        let mut world = world_of(scenario)?;
        let mut ground = Self::empty(&world);
        let is_same = ground.origin == self.origin && ground.cell_m == self.cell_m;
        if !is_same || [ground.width, ground.height] != [self.width, self.height] {
            return Some(Self::in_world(world, &scenario.world, margin_m));
        }
        let range_m = pillar.radius_m + world.footprint().reach_m() + margin_m + BEYOND_M;
        let middles: Vec<Point> = pillar.at_m.iter().map(|&[x, y]| Point::new(x, y)).collect();
        let free = self.free.iter().enumerate().map(|(cell, &free)| {
            let place = ground.middle(cell);
            let is_near = middles
                .iter()
                .any(|middle| middle.distance(place) <= range_m);
            free && (!is_near || is_clear(&mut world, place, margin_m))
        });
        ground.free = free.collect();
        Some(ground)
    }

    /// The cells of `world`, none of them examined.
    fn empty(world: &World) -> Self {
        let bounds = world.scene().bounds();
        let size = [bounds.max.x - bounds.min.x, bounds.max.y - bounds.min.y];
        let cell_m = CELL_M.max(size[0].max(size[1]) / EDGE_MAX);
        let [width, height] = size.map(|length| cells_along(length, cell_m));
        Self {
            origin: bounds.min,
            cell_m,
            width,
            height,
            free: Vec::new(),
        }
    }

    fn in_world(mut world: World, spec: &WorldSpec, margin_m: f64) -> Self {
        let mut ground = Self::empty(&world);
        let (width, height) = (ground.width, ground.height);
        let reach_m = world.footprint().reach_m();
        ground.free = (0..width * height)
            .map(|cell| {
                let place = ground.middle(cell);
                keeps_from_moving(spec, place, reach_m + margin_m)
                    && is_clear(&mut world, place, margin_m)
            })
            .collect();
        ground
    }

    /// The cells that can be reached from `place`; empty if the robot does not fit there.
    pub(super) fn reach_from(&self, [x, y]: [f64; 2]) -> Reach<'_> {
        let column = cells_along(x - self.origin.x, self.cell_m).saturating_sub(1);
        let row = cells_along(y - self.origin.y, self.cell_m).saturating_sub(1);
        let inside = x > self.origin.x && y > self.origin.y;
        let inside = inside && column < self.width && row < self.height;
        self.spread(inside.then(|| row * self.width + column))
    }

    /// The largest connected part of the world.
    pub(super) fn largest(&self) -> Reach<'_> {
        let mut best = self.spread(None);
        let mut seen = vec![false; self.free.len()];
        for cell in 0..self.free.len() {
            if seen[cell] || !self.free[cell] {
                continue;
            }
            let reach = self.spread(Some(cell));
            for (seen, steps) in seen.iter_mut().zip(&reach.steps) {
                *seen |= steps.is_some();
            }
            if reach.len() > best.len() {
                best = reach;
            }
        }
        best
    }

    fn spread(&self, from: Option<usize>) -> Reach<'_> {
        let mut steps = vec![None; self.free.len()];
        let mut front = VecDeque::new();
        if let Some(from) = from.filter(|&cell| self.free[cell]) {
            steps[from] = Some(0);
            front.push_back((from, 0));
        }
        while let Some((cell, far)) = front.pop_front() {
            let (x, y) = (cell % self.width, cell / self.width);
            let next = [
                (x > 0).then(|| cell - 1),
                (x + 1 < self.width).then(|| cell + 1),
                (y > 0).then(|| cell - self.width),
                (y + 1 < self.height).then(|| cell + self.width),
            ];
            for next in next.into_iter().flatten() {
                if self.free[next] && steps[next].is_none() {
                    steps[next] = Some(far + 1);
                    front.push_back((next, far + 1));
                }
            }
        }
        Reach {
            ground: self,
            steps,
        }
    }

    fn middle(&self, cell: usize) -> Point {
        let at = |index: usize| (index as f64 + 0.5) * self.cell_m;
        Point::new(
            self.origin.x + at(cell % self.width),
            self.origin.y + at(cell / self.width),
        )
    }
}

impl Reach<'_> {
    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.steps.iter().flatten().count()
    }

    /// Centres of the cells, rounded to the centimetre.
    pub(super) fn places(&self) -> Vec<[f64; 2]> {
        let cells = self.steps.iter().enumerate();
        let cells = cells.filter(|(_, steps)| steps.is_some());
        cells
            .map(|(cell, _)| {
                let place = self.ground.middle(cell);
                [place.x, place.y].map(|metres| (metres * 100.0).round() / 100.0)
            })
            .collect()
    }

    /// Length of the path to `place` along the cells; `None` if there is no path.
    pub(super) fn way_m(&self, place: [f64; 2]) -> Option<f64> {
        let there = self.ground.reach_from(place);
        let cell = there.steps.iter().position(|steps| *steps == Some(0))?;
        self.steps[cell].map(|steps| f64::from(steps) * self.ground.cell_m)
    }
}

/// The world of `scenario`; `None` if it cannot be built.
fn world_of(scenario: &Scenario) -> Option<World> {
    let source = Source {
        path: PathBuf::from(&scenario.name),
        text: String::new(),
    };
    let chassis = robots::find(&scenario.robot)?.chassis(scenario, &source);
    scenario.world.build(0, chassis.ok()?, &source).ok()
}

fn cells_along(length: f64, cell_m: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "worlds end after 10 km")]
    #[expect(clippy::cast_sign_loss, reason = "clamped")]
    let cells = (length / cell_m).ceil().max(0.0) as usize;
    cells
}

/// Whether the free distance is at least `margin_m` with each heading.
fn is_clear(world: &mut World, place: Point, margin_m: f64) -> bool {
    let headings = match world.footprint().outline() {
        Outline::Circle { .. } => 1,
        Outline::Polygon(_) => HEADINGS,
    };
    (0..headings).all(|heading| {
        let turn = f64::from(heading) * core::f64::consts::TAU / f64::from(HEADINGS);
        world.teleport(Pose::new(place.x, place.y, turn));
        world.clearance_up_to(margin_m + BEYOND_M) >= margin_m
    })
}

/// Whether a body with the radius `keep_m` at `place` is never hit by moving obstacles.
fn keeps_from_moving(spec: &WorldSpec, place: Point, keep_m: f64) -> bool {
    spec.moving.iter().all(|moving| {
        let moving = moving.get_ref();
        let point = |[x, y]: [f64; 2]| Point::new(x, y);
        let ends = moving.path_m.first().into_iter().chain(&moving.path_m);
        ends.zip(&moving.path_m)
            .all(|(&from, &to)| distance(point(from), point(to), place) >= moving.radius_m + keep_m)
    })
}

/// The distance of `place` from the line between two points.
fn distance(from: Point, to: Point, place: Point) -> f64 {
    let along = Point::new(to.x - from.x, to.y - from.y);
    let square = along.x * along.x + along.y * along.y;
    let part = (place.x - from.x) * along.x + (place.y - from.y) * along.y;
    let part = if square > 0.0 {
        (part / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    place.distance(Point::new(from.x + part * along.x, from.y + part * along.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two rooms of 2 m, and between them a wall with a gap at the top. The radius of the robot is
    /// 0.16 m.
    fn two_rooms(gap_m: f64) -> Scenario {
        let text = format!(
            "schema = 1\nname = \"two\"\nrobot = \"rescue\"\nduration = \"5s\"\n[world]\n\
             start = {{ x_m = 1.0, y_m = 1.0, heading_deg = 0 }}\n[[world.wall]]\n\
             path_m = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0], [0.0, 0.0]]\n\
             [[world.wall]]\npath_m = [[2.0, 0.0], [2.0, {}]]\n",
            2.0 - gap_m
        );
        Scenario::from_text(&text).expect("sound").0
    }

    /// 0.16 m and 0.1 m on each side: 0.52 m, and a cell of 0.06 m.
    #[test]
    fn a_door_is_a_way_if_the_body_fits_with_its_margin() {
        let way = |gap_m| {
            let ground = Ground::of(&two_rooms(gap_m), 0.1).expect("a world");
            ground.reach_from([1.0, 1.0]).way_m([3.0, 1.0])
        };
        assert_eq!(way(0.45), None);
        // The path is 2 m across, and at least from 1.0 m up to the door at 1.7 m and down again.
        let way = way(0.6).expect("a way");
        assert!((3.3..4.0).contains(&way), "{way}");
    }

    /// Pillars anywhere in the rooms, also in a wall and beyond the walls: the ground with one more
    /// is the ground of its world.
    #[test]
    fn one_more_pillar_changes_only_cells_near_it() {
        let rooms = two_rooms(0.6);
        let ground = Ground::of(&rooms, 0.1).expect("a world");
        let mut changed = 0;
        for at in 0..24_u8 {
            let [x, y] = [f64::from(at % 6) * 0.81 - 0.1, f64::from(at / 6) * 0.63];
            let pillar = PillarSpec {
                at_m: vec![[x, y]],
                radius_m: 0.05 + f64::from(at % 5) * 0.04,
                reflectivity: 1.0,
                height_m: None,
                unmapped: false,
            };
            let mut fuller = rooms.clone();
            let spec = toml::Spanned::new(0..0, pillar.clone());
            fuller.world.pillar.push(spec);
            let with = ground.with_pillar(&fuller, &pillar, 0.1);
            let of = Ground::of(&fuller, 0.1);
            let free = |ground: Option<Ground>| ground.map(|it| (it.width, it.free));
            let (with, of) = (free(with), free(of));
            assert_eq!(with, of, "{at}");
            changed += usize::from(of.is_some_and(|(_, free)| free != ground.free));
        }
        assert!(changed > 12, "{changed}");
    }

    #[test]
    fn a_place_at_a_wall_is_none() {
        let ground = Ground::of(&two_rooms(0.6), 0.1).expect("a world");
        let nearest = |places: Vec<[f64; 2]>| places.iter().fold(9.0, |x, p| p[0].min(x));
        let places = ground.reach_from([1.0, 1.0]).places();
        assert!((0.26..0.33).contains(&nearest(places)));
        assert_eq!(ground.reach_from([0.2, 1.0]).len(), 0);
    }

    #[test]
    fn the_largest_part_is_the_larger_room() {
        let mut closed = two_rooms(0.0);
        closed.world.wall[1].get_mut().path_m = vec![[1.5, 0.0], [1.5, 2.0]];
        let ground = Ground::of(&closed, 0.1).expect("a world");
        let places = ground.largest().places();
        assert!(places.iter().all(|place| place[0] > 1.5), "{places:?}");
    }

    /// A person walks along the wall at y = 1.7: positions within 0.15 + 0.16 + 0.1 m are excluded.
    #[test]
    fn nobody_is_sent_where_somebody_walks() {
        let mut walked = two_rooms(1.9);
        let walker = "path_m = [[0.5, 1.7], [3.5, 1.7]]\nspeed_m_s = 0.5\nradius_m = 0.15";
        walked.world.moving = vec![toml::Spanned::new(
            0..0,
            toml::from_str(walker).expect("one who walks"),
        )];
        let ground = Ground::of(&walked, 0.1).expect("a world");
        let places = ground.reach_from([1.0, 1.0]).places();
        let off = |[x, y]: &[f64; 2]| f64::hypot(x - x.clamp(0.5, 3.5), y - 1.7);
        assert!(!places.is_empty());
        assert!(places.iter().all(|place| off(place) >= 0.41), "{places:?}");
    }
}
