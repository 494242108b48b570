use toml::Spanned;

use super::dice::Draw;
use super::ground::Ground;
use engine::scenario::{Scenario, WorldSpec};

/// Maximum number of moved walls and pieces of furniture.
const MOVES_MAX: u64 = 4;
/// Maximum displacement to each side, centimetres.
const MOVE_CM: u64 = 20;
/// Objects closer than this are joined, metres.
const JOINED_M: f64 = 0.02;
/// Minimum share of the ground that must stay within reach, in tenths.
const LEFT_OF_10: usize = 6;

/// Moves walls, doors, furniture and moving obstacles in the world of `made`, within the square of
/// `side_m`. Most of the ground stays within reach from the start.
pub(super) fn change(made: &mut Scenario, margin_m: f64, side_m: Option<f64>, dice: &mut Draw) {
    let start = made.world.start_pose();
    let reached = |scenario: &Scenario| {
        let ground = Ground::of(scenario, margin_m)?;
        Some(ground.reach_from([start.x, start.y]).len())
    };
    let Some(before) = reached(made).filter(|&cells| cells > 0) else {
        return;
    };
    for _ in 0..dice.between(1, MOVES_MAX) {
        let mut changed = made.clone();
        move_something(&mut changed.world, dice);
        let fits = side_m.is_none_or(|side| is_within(&changed.world, side));
        let is_left = |cells: usize| cells * 10 >= before * LEFT_OF_10;
        if fits && reached(&changed).is_some_and(is_left) {
            *made = changed;
        }
    }
}

fn move_something(world: &mut WorldSpec, dice: &mut Draw) {
    let centimetres = |dice: &mut Draw| {
        let by = dice.below(2 * MOVE_CM + 1) as f64 - MOVE_CM as f64;
        by / 100.0
    };
    let by = [centimetres(dice), centimetres(dice)];
    let kinds = [
        world.wall.len(),
        world.polygon.len(),
        world.pillar.len(),
        world.moving.len(),
    ];
    let kinds: Vec<usize> = (0..4).filter(|&kind| kinds[kind] > 0).collect();
    if kinds.is_empty() {
        return;
    }
    match kinds[dice.index(kinds.len())] {
        0 => {
            let index = dice.index(world.wall.len());
            move_wall(world, index, by[0], dice);
        }
        1 => {
            let index = dice.index(world.polygon.len());
            move_polygon(world, index, by, dice);
        }
        2 => {
            let index = dice.index(world.pillar.len());
            let pillar = world.pillar[index].get_ref();
            if pillar.at_m.is_empty() {
                return;
            }
            let place = dice.index(pillar.at_m.len());
            // A post stays with its wall: a lidar sees only the post of a pane of glass.
            if !touches(world, pillar.at_m[place], pillar.radius_m, Of::Pillar) {
                let place = &mut world.pillar[index].get_mut().at_m[place];
                *place = moved(*place, by);
            }
        }
        _ => {
            let walkers = world.moving.len();
            let walker = world.moving[dice.index(walkers)].get_mut();
            for place in &mut walker.path_m {
                *place = moved(*place, by);
            }
            walker.speed_m_s = rounded(walker.speed_m_s * dice.between(50, 120) as f64 / 100.0);
        }
    }
}

/// Changes a wall. A wall that ends in the room becomes longer or shorter, as at a door. Of any
/// other wall a free side is moved. A wall that is invisible to lidars does not move: the robot
/// cannot know the end of a pane without a frame.
fn move_wall(world: &mut WorldSpec, index: usize, by: f64, dice: &mut Draw) {
    let wall = world.wall[index].get_ref();
    if wall.glass || wall.height_m.is_some() {
        return;
    }
    let path = &wall.path_m;
    let last = path.len().saturating_sub(1);
    let ends = [(0, 1), (last, last.saturating_sub(1))];
    let is_closed = path.first() == path.last();
    let is_free = |&(end, _): &(usize, usize)| !touches(world, path[end], 0.0, Of::Wall(index));
    let free: Vec<(usize, usize)> = match path.len() > 1 && !is_closed {
        true => ends.into_iter().filter(is_free).collect(),
        false => Vec::new(),
    };
    if free.is_empty() {
        let side = dice.index(last.max(1));
        if is_closed || (side > 0 && side + 1 < last) {
            move_side(&mut world.wall[index].get_mut().path_m, side, by);
        }
        return;
    }
    let (end, inner) = free[dice.index(free.len())];
    let along = direction(path[inner], path[end]);
    let path = &mut world.wall[index].get_mut().path_m;
    path[end] = moved(path[end], along.map(|part| part * by));
}

/// Moves free-standing furniture; of other furniture, a side that touches nothing. The frame of a
/// pane does not move.
fn move_polygon(world: &mut WorldSpec, index: usize, by: [f64; 2], dice: &mut Draw) {
    let corners = &world.polygon[index].get_ref().corners_m;
    if is_frame(world, corners) {
        return;
    }
    let is_free = |&place: &[f64; 2]| !touches(world, place, 0.0, Of::Polygon(index));
    if corners.iter().all(is_free) {
        for corner in &mut world.polygon[index].get_mut().corners_m {
            *corner = moved(*corner, by);
        }
        return;
    }
    let next = |side: usize| corners[(side + 1) % corners.len()];
    let middle = |side: usize| [0, 1].map(|axis| (corners[side][axis] + next(side)[axis]) / 2.0);
    let sides: Vec<usize> = (0..corners.len())
        .filter(|&side| is_free(&middle(side)))
        .collect();
    if sides.is_empty() {
        return;
    }
    let side = sides[dice.index(sides.len())];
    let corners = &mut world.polygon[index].get_mut().corners_m;
    corners.push(corners[0]);
    move_side(corners, side, by[0]);
    if side + 2 == corners.len() {
        corners[0] = corners[side + 1];
    }
    corners.pop();
}

/// Whether a pane of glass ends at the outline of `corners`.
fn is_frame(world: &WorldSpec, corners: &[[f64; 2]]) -> bool {
    let panes = world.wall.iter().map(Spanned::get_ref);
    let panes = panes.filter(|wall| wall.glass);
    let mut ends = panes.flat_map(|pane| pane.path_m.first().into_iter().chain(pane.path_m.last()));
    ends.any(|&end| is_near_outline(corners, 0.0, end))
}

/// Moves the side from corner `side` of `path` to the next one at right angles; in a closed path
/// both ends move.
fn move_side(path: &mut [[f64; 2]], side: usize, by: f64) {
    let Some(last) = path.len().checked_sub(1).filter(|&last| side < last) else {
        return;
    };
    let is_closed = path[0] == path[last];
    let [x, y] = direction(path[side], path[side + 1]);
    for corner in [side, side + 1] {
        path[corner] = moved(path[corner], [-y * by, x * by]);
    }
    if is_closed && side == 0 {
        path[last] = path[0];
    } else if is_closed && side + 1 == last {
        path[0] = path[last];
    }
}

/// The object of a point: an object does not touch itself.
#[derive(Clone, Copy, PartialEq)]
enum Of {
    Wall(usize),
    Polygon(usize),
    Pillar,
}

/// Whether an object with the radius `reach_m` at `place` touches a wall or a polygon; unless it is
/// a pillar, pillars count too.
fn touches(world: &WorldSpec, place: [f64; 2], reach_m: f64, of: Of) -> bool {
    let near = |from: [f64; 2], to: [f64; 2]| line_distance(from, to, place) <= reach_m + JOINED_M;
    let along = |path: &[[f64; 2]]| path.windows(2).any(|pair| near(pair[0], pair[1]));
    let walls = world.wall.iter().enumerate();
    let mut walls = walls.filter(|&(index, _)| of != Of::Wall(index));
    let polygons = world.polygon.iter().enumerate();
    let mut polygons = polygons.filter(|&(index, _)| of != Of::Polygon(index));
    let mut posts = world.pillar.iter().filter(|_| of != Of::Pillar);
    walls.any(|(_, wall)| along(&wall.get_ref().path_m))
        || polygons
            .any(|(_, polygon)| is_near_outline(&polygon.get_ref().corners_m, reach_m, place))
        || posts.any(|pillar| {
            let pillar = pillar.get_ref();
            let is_near =
                |&at: &[f64; 2]| line_distance(at, at, place) <= pillar.radius_m + JOINED_M;
            pillar.at_m.iter().any(is_near)
        })
}

/// Whether an object with the radius `reach_m` at `place` touches the outline of `corners`.
fn is_near_outline(corners: &[[f64; 2]], reach_m: f64, place: [f64; 2]) -> bool {
    let next = corners.iter().cycle().skip(1);
    let mut sides = corners.iter().zip(next);
    sides.any(|(&from, &to)| line_distance(from, to, place) <= reach_m + JOINED_M)
}

fn line_distance(from: [f64; 2], to: [f64; 2], place: [f64; 2]) -> f64 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let off = [place[0] - from[0], place[1] - from[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let part = (off[0] * along[0] + off[1] * along[1]) / square.max(1e-12);
    let part = part.clamp(0.0, 1.0);
    (off[0] - part * along[0]).hypot(off[1] - part * along[1])
}

/// The unit vector from one point to another.
fn direction(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    let [x, y] = [to[0] - from[0], to[1] - from[1]];
    let length = x.hypot(y).max(1e-9);
    [x / length, y / length]
}

fn moved([x, y]: [f64; 2], by: [f64; 2]) -> [f64; 2] {
    [rounded(x + by[0]), rounded(y + by[1])]
}

/// Rounds to the millimetre, as in hand-written files.
fn rounded(metres: f64) -> f64 {
    (metres * 1000.0).round() / 1000.0
}

fn is_within(world: &WorldSpec, side: f64) -> bool {
    let walls = world.wall.iter().flat_map(|wall| &wall.get_ref().path_m);
    let polygons = world.polygon.iter();
    let corners = polygons.flat_map(|polygon| &polygon.get_ref().corners_m);
    let mut points = walls.chain(corners).flatten();
    points.all(|metres| (0.05..=side - 0.05).contains(metres))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room with a wall that ends in it, and a free-standing table.
    fn world() -> WorldSpec {
        let text = "start = { x_m = 0.5, y_m = 0.5, heading_deg = 0 }\n[[wall]]\n\
            path_m = [[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0], [0.0, 0.0]]\n[[wall]]\n\
            path_m = [[1.0, 0.0], [1.0, 1.2]]\n[[polygon]]\n\
            corners_m = [[2.0, 1.0], [2.4, 1.0], [2.4, 1.4], [2.0, 1.4]]\n[[polygon]]\n\
            corners_m = [[2.6, 0.0], [3.0, 0.0], [3.0, 0.4], [2.6, 0.4]]\n";
        toml::from_str(text).expect("sound")
    }

    fn zeros() -> Draw {
        super::super::Dice::of_bytes(&[]).world
    }

    #[test]
    fn a_wall_that_ends_in_the_room_grows_at_its_free_end() {
        let mut world = world();
        move_wall(&mut world, 1, 0.15, &mut zeros());
        assert_eq!(world.wall[1].get_ref().path_m, [[1.0, 0.0], [1.0, 1.35]]);
    }

    /// A pane of glass from a wall to its post, and the post: both stay together.
    #[test]
    fn a_pane_and_its_post_stay_together() {
        let mut world = world();
        world.wall[1].get_mut().glass = true;
        let text = "start = { x_m = 0.5, y_m = 0.5, heading_deg = 0 }\n\
            [[pillar]]\nat_m = [[1.0, 1.22]]\nradius_m = 0.03\n";
        world.pillar = toml::from_str::<WorldSpec>(text).expect("sound").pillar;
        let before = world.clone();
        move_wall(&mut world, 1, 0.15, &mut zeros());
        assert_eq!(world, before);
        world.wall.truncate(2);
        world.polygon.clear();
        let only_pane = world.wall.pop().expect("the pane");
        world.wall = vec![only_pane];
        let before = world.clone();
        // No side and no furniture can move: each draw selects the pane or the post.
        for byte in 0..=255 {
            move_something(
                &mut world,
                &mut super::super::Dice::of_bytes(&[byte; 64]).world,
            );
        }
        let pillar = |world: &WorldSpec| world.pillar[0].get_ref().at_m.clone();
        assert_eq!(pillar(&world), pillar(&before));
    }

    /// A pane that begins 4 cm before a wall is joined to it: 20 cm longer, it would protrude from
    /// the other side of the wall without a post.
    #[test]
    fn a_pane_and_a_threshold_stay_as_they_are() {
        let mut before = world();
        before.wall[1].get_mut().path_m = vec![[0.04, 1.0], [0.6, 1.0]];
        let moved = |before: &WorldSpec| {
            let mut after = before.clone();
            move_wall(&mut after, 1, 0.2, &mut zeros());
            after != *before
        };
        assert!(moved(&before));
        before.wall[1].get_mut().glass = true;
        assert!(!moved(&before));
        let threshold = before.wall[1].get_mut();
        (threshold.glass, threshold.height_m) = (false, Some(0.04));
        assert!(!moved(&before));
    }

    /// A pane at the centre of the narrow side of a block, 4 cm from its corners: without the block
    /// its end would be free and invisible to lidars. Without the pane the block is furniture.
    #[test]
    fn the_frame_of_a_pane_stays_with_it() {
        let mut world = world();
        world.wall[1].get_mut().path_m = vec![[2.2, 0.0], [2.2, 1.0]];
        let moved = |world: &WorldSpec| {
            let mut after = world.clone();
            move_polygon(&mut after, 0, [0.1, 0.1], &mut zeros());
            after != *world
        };
        assert!(moved(&world));
        world.wall[1].get_mut().glass = true;
        assert!(!moved(&world));
        world.wall[1].get_mut().path_m[1] = [2.2, 0.97];
        assert!(moved(&world));
    }

    /// The side along y = 0 moves to its left, into the room. The path stays closed.
    #[test]
    fn a_side_of_a_room_moves_across_itself() {
        let mut world = world();
        move_wall(&mut world, 0, 0.1, &mut zeros());
        let path = &world.wall[0].get_ref().path_m;
        assert_eq!(path[..2], [[0.0, 0.1], [3.0, 0.1]]);
        assert_eq!(path[4], path[0]);
    }

    #[test]
    fn a_table_moves_and_a_cupboard_at_the_wall_changes_its_depth() {
        let mut world = world();
        move_polygon(&mut world, 0, [0.1, -0.2], &mut zeros());
        assert_eq!(world.polygon[0].get_ref().corners_m[0], [2.1, 0.8]);
        // The first side that touches nothing is the upper one, from right to left; moved to its
        // left, it comes down.
        move_polygon(&mut world, 1, [0.1, 0.0], &mut zeros());
        let corners = &world.polygon[1].get_ref().corners_m;
        assert_eq!(
            corners[..],
            [[2.6, 0.0], [3.0, 0.0], [3.0, 0.3], [2.6, 0.3]]
        );
    }
}
