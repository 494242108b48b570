//! The map of one scan, and the roadmap.

use emulators::rng::Rng;
use emulators::world::Pose as Truth;
use firmware_core::grid::{FREE, OBSTACLE};
use firmware_core::local_map::local_map;
use firmware_core::prm::{Dice, plan_once};

use super::sight::{LABYRINTH, believed, lines, map, middles, world};
use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_seed};

/// Page 4: the map of one scan.
pub(in super::super) const LOCAL_MAP: Measure = Measure {
    name: "yellow-local-map",
    planted: "an orientation that is 15 degrees wrong",
    perform: local,
};

fn local(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let turn = model.pick(0.0_f64, 15.0).to_radians();
    let found = by_seed(plan, tell, |seed| {
        let mut dice = Rng::stream(seed, "places");
        let world = world(LABYRINTH, seed);
        let (mut right, mut all, mut behind, mut free) = (0.0, 0.0_f64, 0.0, 0.0_f64);
        for [x, y] in middles() {
            let at = Truth::new(x, y, dice.range(-3.0, 3.0));
            let lines = lines(&world, at, 1.0, &mut dice);
            let seen = believed(Truth::new(x, y, at.theta + turn));
            let Ok(map) = local_map(seen, &lines) else {
                return [f64::NAN; 2];
            };
            for (cell, value) in map.iter() {
                let centre = map.centre_of(cell);
                let [cx, cy] = [centre.x_mm, centre.y_mm].map(|mm| f64::from(mm) / 1_000.0);
                let far = libm::hypot(cx - x, cy - y);
                let bearing = libm::atan2(cy - y, cx - x);
                let hit = world.cast_ray(at.point(), bearing, 6.0);
                let wall_at = hit.map_or(6.0, |hit| hit.distance);
                match value {
                    OBSTACLE => {
                        all += 1.0;
                        // A wall is on the border of its cells, and its ends beside the ray.
                        right += f64::from(u8::from(near_wall([cx, cy])));
                    }
                    FREE => {
                        free += 1.0;
                        behind += f64::from(u8::from(far > wall_at + 0.15));
                    }
                    _ => {}
                }
            }
        }
        [right / all.max(1.0), behind / free.max(1.0)]
    });
    let mut measured = Measured::default();
    measured.value(
        "wall cells that are true (share)",
        found.iter().map(|one| one[0]),
    );
    measured.value(
        "free cells behind a wall (share)",
        found.iter().map(|one| one[1]),
    );
    measured
}

/// Whether a wall of the labyrinth is within a cell of a point.
fn near_wall([x, y]: [f64; 2]) -> bool {
    LABYRINTH
        .iter()
        .flat_map(|path| path.windows(2))
        .any(|ends| {
            let [[x0, y0], [x1, y1]] = [ends[0], ends[1]];
            let within = |value: f64, one: f64, other: f64| {
                let (low, high) = (one.min(other), one.max(other));
                (low - 0.1..=high + 0.1).contains(&value)
            };
            within(x, x0, x1) && within(y, y0, y1)
        })
}

/// Pages 4 and 5: the roadmap on a map with grown walls.
pub(in super::super) const ROADMAP: Measure = Measure {
    name: "yellow-roadmap",
    planted: "corridors a cell narrower",
    perform: roadmap,
};

fn roadmap(of: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let found = by_seed(of, tell, |seed| {
        let mut dice = Rng::stream(seed, "places");
        let mut map = map(&world(LABYRINTH, seed), &middles(), &mut dice);
        if model == Model::Planted {
            map = map.eroded().eroded();
        }
        let open = map.eroded();
        let free: Vec<_> = open.iter().filter(|(_, value)| *value == FREE).collect();
        let (mut once, mut beside, mut cells) = (0.0, 0.0, 0.0_f64);
        let pairs = 20_u32;
        for pair in 0..pairs {
            let mut any = || {
                let index = dice.below(free.len().max(1) as u64);
                free.get(usize::try_from(index).unwrap_or(0))
                    .map(|(cell, _)| *cell)
            };
            let Some((from, to)) = any().zip(any()) else {
                return [0.0, 1.0];
            };
            let mut own = Dice::new(seed * 100 + u64::from(pair));
            let (_, way) = plan_once(&map, from, to, &mut own);
            once += f64::from(u8::from(way.is_some()));
            for cell in way.into_iter().flatten() {
                cells += 1.0;
                let is_beside = cell.block().any(|near| map.get(near) == OBSTACLE);
                beside += f64::from(u8::from(is_beside && cell != from && cell != to));
            }
        }
        let share = |count: f64| count / f64::from(pairs);
        [share(once), beside / cells.max(1.0)]
    });
    let mut measured = Measured::default();
    measured.value(
        "paths found with 100 vertices (share)",
        found.iter().map(|one| one[0]),
    );
    measured.value(
        "via points beside a wall (share)",
        found.iter().map(|one| one[1]),
    );
    measured
}
