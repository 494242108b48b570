use core::fmt::Write as _;

use super::dice::Draw;
use crate::robots::Arena;
use crate::scenario::WorldSpec;

/// A room in which each of some places is free or taken by an obstacle.
pub(super) struct Room {
    arena: Arena,
    start: [f64; 2],
    heading_deg: u64,
    /// Where they are, and their radii in mm.
    obstacles: Vec<([f64; 2], u64)>,
    /// Places to go to.
    pub(super) free: Vec<[f64; 2]>,
}

impl Room {
    pub(super) fn draw(arena: Arena, world: &mut Draw) -> Self {
        let mut places = arena.places_m.to_vec();
        let start = places.remove(world.index(places.len()));
        let heading_deg = world.below(360);
        let mut obstacles = Vec::new();
        for _ in 0..world.below(3) {
            let place = places.remove(world.index(places.len()));
            let nudge = [world.below(11), world.below(11)];
            let nudge = nudge.map(|cm| (cm as f64 - 5.0) / 100.0);
            let [least, most] = arena.obstacle_mm;
            let size_mm = world.between(least, most);
            obstacles.push(([place[0] + nudge[0], place[1] + nudge[1]], size_mm));
        }
        Self {
            arena,
            start,
            heading_deg,
            obstacles,
            free: places,
        }
    }

    /// The world as its text in a scenario says it.
    pub(super) fn world(&self) -> WorldSpec {
        let Arena { side_m, wall_m, .. } = self.arena;
        let mut text = format!(
            "start = {{ x_m = {:.2}, y_m = {:.2}, heading_deg = {} }}\n\
             bounds = {{ min_m = [0, 0], max_m = [{side_m:?}, {side_m:?}] }}\n[[wall]]\n\
             path_m = {wall_m:?}\n",
            self.start[0], self.start[1], self.heading_deg
        );
        for ([x, y], size_mm) in &self.obstacles {
            let radius = *size_mm as f64 / 1000.0;
            write!(
                text,
                "[[pillar]]\nat_m = [[{x:.2}, {y:.2}]]\nradius_m = {radius:.3}\n"
            )
            .expect("a string takes everything");
        }
        toml::from_str(&text).expect("a room as people write it")
    }
}
