use toml::Spanned;

use super::dice::Draw;
use engine::robots::Arena;
use engine::scenario::WallSpec;

/// The layout of a floor before it is rotated and mirrored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Rectangle,
    /// A rectangle without one corner.
    Angle,
    /// Two rooms with a door.
    TwoRooms,
    /// A corridor with two bends.
    Corridor,
    /// A room with a block at the centre.
    Block,
    /// A corridor along one side, with two rooms beside it.
    Flat,
}

const SHAPES: [Shape; 6] = [
    Shape::Rectangle,
    Shape::Angle,
    Shape::TwoRooms,
    Shape::Corridor,
    Shape::Block,
    Shape::Flat,
];

/// Thickness of the walls between rooms.
const WALL_M: f64 = 0.08;

/// Walls as polylines.
type Lines = Vec<Vec<[f64; 2]>>;

/// The walls of a generated floor that suits `arena`.
pub(super) fn walls(arena: &Arena, dice: &mut Draw) -> Vec<Spanned<WallSpec>> {
    let shape = SHAPES[dice.index(SHAPES.len())];
    let side = arena.side_m;
    let mut share = |least, most| dice.between(least, most) as f64 / 100.0;
    let size = [side * share(78, 92), side * share(78, 92)];
    let corner = [0, 1].map(|axis| (side - size[axis]) * share(30, 70));
    let passage = |dice: &mut Draw| {
        let [least, most] = arena.passage_mm;
        dice.between(least, most) as f64 / 1000.0
    };
    let mut lines = laid_out(shape, size, passage, dice);
    let turn = dice.below(8);
    for point in lines.iter_mut().flatten() {
        for axis in [0, 1] {
            if turn >> axis & 1 == 1 {
                point[axis] = size[axis] - point[axis];
            }
            point[axis] += corner[axis];
        }
        if turn >> 2 == 1 {
            point.swap(0, 1);
        }
        *point = point.map(|metres| (metres * 100.0).round() / 100.0);
    }
    let wall = |path_m| {
        let wall = WallSpec {
            path_m,
            reflectivity: 1.0,
            height_m: None,
            unmapped: false,
            glass: false,
        };
        Spanned::new(0..0, wall)
    };
    let has_length = |line: &Vec<[f64; 2]>| line[0] != line[1];
    let lines = lines.into_iter().filter(has_length);
    lines.map(thick).map(wall).collect()
}

/// The outline of a wall that ends in the room: seen from its end, a line would be invisible. Other
/// paths are returned unchanged.
fn thick(line: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let &[from, to] = &line[..] else {
        return line;
    };
    let [x, y] = [to[0] - from[0], to[1] - from[1]];
    let length = x.hypot(y).max(1e-9);
    let [across_x, across_y] = [-y / length * WALL_M / 2.0, x / length * WALL_M / 2.0];
    let beside = |[x, y]: [f64; 2], side: f64| {
        [x + side * across_x, y + side * across_y].map(|metres| (metres * 1000.0).round() / 1000.0)
    };
    let first = beside(from, 1.0);
    vec![
        first,
        beside(to, 1.0),
        beside(to, -1.0),
        beside(from, -1.0),
        first,
    ]
}

/// The lines of `shape` from the origin to `size`.
fn laid_out(
    shape: Shape,
    [w, h]: [f64; 2],
    passage: impl Fn(&mut Draw) -> f64,
    dice: &mut Draw,
) -> Lines {
    let outline = vec![[0.0, 0.0], [w, 0.0], [w, h], [0.0, h], [0.0, 0.0]];
    let mut share = |least, most| dice.between(least, most) as f64 / 100.0;
    match shape {
        Shape::Rectangle => vec![outline],
        Shape::Angle => {
            let (x, y) = (w * share(50, 70), h * share(50, 70));
            let bent = [[0.0, 0.0], [w, 0.0], [w, y], [x, y], [x, h], [0.0, h]];
            vec![[&bent[..], &bent[..1]].concat()]
        }
        Shape::TwoRooms => {
            let (x, at) = (w * share(40, 60), share(0, 100));
            let door = passage(dice);
            let from = (h - door) * at;
            vec![
                outline,
                vec![[x, 0.0], [x, from]],
                vec![[x, from + door], [x, h]],
            ]
        }
        Shape::Corridor => {
            let (a, b) = (w * share(32, 36), w * share(64, 68));
            let (up, down) = (passage(dice), passage(dice));
            vec![
                outline,
                vec![[a, 0.0], [a, h - up]],
                vec![[b, down], [b, h]],
            ]
        }
        Shape::Block => {
            let [left, right, below, above] = [(); 4].map(|()| passage(dice));
            let (right, above) = (w - right, h - above);
            let block = [[left, below], [right, below], [right, above], [left, above]];
            vec![outline, [&block[..], &block[..1]].concat()]
        }
        Shape::Flat => {
            let (x, left, right) = (w * share(42, 58), share(0, 100), share(0, 100));
            let (y, a, b) = (passage(dice), passage(dice), passage(dice));
            let (a_at, b_at) = ((x - a) * left, x + (w - x - b) * right);
            vec![
                outline,
                vec![[0.0, y], [a_at, y]],
                vec![[a_at + a, y], [b_at, y]],
                vec![[b_at + b, y], [w, y]],
                vec![[x, y], [x, h]],
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of 8 cm along x, from (1, 2) to (3, 2), and a room with its walls' thickness outside.
    #[test]
    fn a_wall_that_ends_in_the_room_has_an_end() {
        let wall = thick(vec![[1.0, 2.0], [3.0, 2.0]]);
        assert_eq!(
            wall,
            [
                [1.0, 2.04],
                [3.0, 2.04],
                [3.0, 1.96],
                [1.0, 1.96],
                [1.0, 2.04]
            ]
        );
        let room = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]];
        assert_eq!(thick(room.clone()), room);
    }
}
