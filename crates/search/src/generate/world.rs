use toml::Spanned;

use super::changes;
use super::dice::{Dice, Draw};
use super::ground::Ground;
use super::rooms;
use engine::robots::{self, Arena, Robot};
use engine::scenario::{PillarSpec, Scenario, Span, StartSpec, WorldSpec};

/// Number of unsuitable generated floors after which the scenario's own world is used.
const FLOORS: u8 = 4;
/// Minimum number of free cells for a mission: a square metre.
const CELLS_MIN: usize = 250;
/// Maximum number of added obstacles.
const OBSTACLES_MAX: u64 = 3;
/// Minimum share of the ground that obstacles leave within reach, in tenths.
const LEFT_OF_10: usize = 8;
/// Maximum number of waypoints, and minimum distance between two consecutive ones.
const WAYPOINTS_MAX: u64 = 4;
const APART_M: f64 = 0.5;
/// Number of tries for a waypoint at this distance.
const DRAWS: u8 = 8;

/// The place of a mission.
pub(super) struct Place {
    arena: Arena,
    ground: Ground,
    start: [f64; 2],
    /// Positions that can be reached.
    free: Vec<[f64; 2]>,
}

/// Generates another world for `made`, or moves objects in its world; returns the place of the
/// mission. `None` if the robot defines no arena, or does not fit into the world: `made` is then
/// unchanged.
pub(super) fn vary(made: &mut Scenario, dice: &mut Dice) -> Option<Place> {
    let arena = robots::find(&made.robot).and_then(Robot::arena)?;
    let dice = &mut dice.world;
    let own = made.clone();
    if dice.below(2) == 0 {
        for _ in 0..FLOORS {
            *made = own.clone();
            let world = &mut made.world;
            (world.plan, world.maze) = (None, None);
            (world.polygon, world.pillar) = (Vec::new(), Vec::new());
            (world.moving, world.push) = (Vec::new(), Vec::new());
            world.wall = rooms::walls(&arena, dice);
            if let Some((ground, cells)) = start_on_the_largest_part(made, &arena)
                && cells >= CELLS_MIN
            {
                return furnish(made, arena, ground, 1, dice);
            }
        }
        *made = own.clone();
    }
    changes::change(made, arena.margin_m, Some(arena.side_m), dice);
    let place =
        Ground::of(made, arena.margin_m).and_then(|ground| furnish(made, arena, ground, 0, dice));
    if place.is_none() {
        *made = own;
    }
    place
}

/// Changes the world of a mission that is led by its steps: another maze of the same size, or
/// another world if the mission needs no object at a fixed position.
pub(super) fn vary_around(made: &mut Scenario, dice: &mut Dice) {
    if let Some(maze) = &mut made.world.maze {
        maze.get_mut().seed = dice.world.below(1 << 32);
    } else if made.mission.waypoints_m.is_empty() && made.world.heat.is_empty() {
        vary(made, dice);
    }
}

/// Places the robot into the largest connected part; returns the ground and the number of cells of
/// that part.
fn start_on_the_largest_part(made: &mut Scenario, arena: &Arena) -> Option<(Ground, usize)> {
    // This position is outside all walls.
    put(&mut made.world, [-arena.side_m; 2], 0);
    let ground = Ground::of(made, arena.margin_m)?;
    let largest = ground.largest();
    let (start, cells) = (*largest.places().first()?, largest.len());
    put(&mut made.world, start, 0);
    Some((ground, cells))
}

fn put(world: &mut WorldSpec, [x_m, y_m]: [f64; 2], heading_deg: u64) {
    let start = StartSpec {
        x_m,
        y_m,
        heading_deg: heading_deg as f64,
    };
    world.start = Spanned::new(0..0, start);
}

/// Adds at least `least` obstacles, and draws the start pose.
fn furnish(
    made: &mut Scenario,
    arena: Arena,
    mut ground: Ground,
    least: u64,
    dice: &mut Draw,
) -> Option<Place> {
    let start = made.world.start_pose();
    let start = [start.x, start.y];
    for _ in 0..dice.between(least, OBSTACLES_MAX) {
        let reach = ground.reach_from(start);
        let (before, places) = (reach.len(), reach.places());
        if places.is_empty() {
            return None;
        }
        let mut fuller = made.clone();
        let pillar = obstacle(&arena, &places, dice);
        fuller.world.pillar.push(pillar.clone());
        // Rejects an obstacle at the robot's pose, or one that cuts off too much ground.
        if let Some(left) = ground.with_pillar(&fuller, pillar.get_ref(), arena.margin_m)
            && left.reach_from(start).len() * 10 >= before * LEFT_OF_10
        {
            (*made, ground) = (fuller, left);
        }
    }
    let free = ground.reach_from(start).places();
    if free.is_empty() {
        return None;
    }
    let start = free[dice.index(free.len())];
    put(&mut made.world, start, dice.below(360));
    Some(Place {
        arena,
        ground,
        start,
        free,
    })
}

fn obstacle(arena: &Arena, places: &[[f64; 2]], dice: &mut Draw) -> Spanned<PillarSpec> {
    let [least, most] = arena.obstacle_mm;
    let pillar = PillarSpec {
        at_m: vec![places[dice.index(places.len())]],
        radius_m: dice.between(least, most) as f64 / 1000.0,
        reflectivity: 1.0,
        height_m: None,
        unmapped: false,
    };
    Spanned::new(0..0, pillar)
}

impl Place {
    /// Draws the waypoints of a mission, in order.
    pub(super) fn waypoints(&self, dice: &mut Draw) -> Vec<[f64; 2]> {
        let mut waypoints: Vec<[f64; 2]> = Vec::new();
        let mut from = self.start;
        for _ in 0..dice.between(1, WAYPOINTS_MAX) {
            let mut next = self.free[dice.index(self.free.len())];
            for _ in 0..DRAWS {
                if (next[0] - from[0]).hypot(next[1] - from[1]) >= APART_M {
                    break;
                }
                next = self.free[dice.index(self.free.len())];
            }
            waypoints.push(next);
            from = next;
        }
        waypoints
    }

    /// Time that the robot needs for `waypoints` in order, including the path from the last one to
    /// the first one, and for half of this path again.
    pub(super) fn time_for(&self, waypoints: &[[f64; 2]]) -> Span {
        let froms = waypoints.last().into_iter().chain(waypoints);
        let ways = froms.zip(waypoints).map(|(&from, &to)| {
            let way = self.ground.reach_from(from).way_m(to);
            way.unwrap_or_default()
        });
        let seconds = ways.sum::<f64>() / self.arena.pace_m_s;
        #[expect(clippy::cast_possible_truncation, reason = "a way of metres")]
        #[expect(clippy::cast_sign_loss, reason = "a length")]
        // The mission is repeated after a third of the time.
        Span::from_millis((seconds * 1500.0) as u64)
    }
}
