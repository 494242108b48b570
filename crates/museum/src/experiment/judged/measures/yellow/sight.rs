//! Scans of Yellow's lidar from points in a labyrinth, and its localisation by them.

use emulators::rng::Rng;
use emulators::world::{BodyConfig, Fixture, Point as Place, Pose as Truth, Scene, Shape, World};
use firmware_core::cell_map::CellMap;
use firmware_core::lines::{Lines, Settings};
use firmware_core::local_map::{Segment, local_map};
use firmware_core::pose::{Point, Pose};

use super::correlation::{Global, Rule};
use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case};

/// The labyrinth of `yellow-map`: walls from corner to corner, metres.
pub(super) const LABYRINTH: &[&[[f64; 2]]] = &[
    &[
        [0.05, 0.05],
        [3.05, 0.05],
        [3.05, 2.45],
        [0.05, 2.45],
        [0.05, 0.05],
    ],
    &[[1.85, 0.65], [0.65, 0.65], [0.65, 1.85]],
    &[[2.45, 0.65], [2.45, 1.25], [1.25, 1.25]],
    &[[1.85, 1.25], [1.85, 1.85]],
    &[[1.25, 1.85], [1.25, 2.45]],
    &[[2.45, 1.85], [3.05, 1.85]],
];
/// Two rooms alike on a corridor whose ends are alike as well.
const ALIKE: &[&[[f64; 2]]] = &[&[
    [0.05, 0.05],
    [5.65, 0.05],
    [5.65, 0.85],
    [4.05, 0.85],
    [4.05, 1.05],
    [4.85, 1.05],
    [4.85, 2.65],
    [3.25, 2.65],
    [3.25, 0.85],
    [1.65, 0.85],
    [1.65, 1.05],
    [2.45, 1.05],
    [2.45, 2.65],
    [0.85, 2.65],
    [0.85, 0.85],
    [0.05, 0.85],
    [0.05, 0.05],
]];
/// Standard deviation of the average of five distances (page 3), as a part of the distance: a
/// single one of the rig's lidar has 0.0025.
const NOISE: f64 = 0.001_12;
/// Directions of a scan, and the sensor's range.
const BEAMS: u16 = 360;
const RANGE_M: f64 = 5.0;

/// A world that contains only walls.
pub(super) fn world(walls: &[&[[f64; 2]]], seed: u64) -> World {
    let place = |[x, y]: [f64; 2]| Place::new(x, y);
    let fixtures = walls.iter().flat_map(|path| {
        path.windows(2).map(move |ends| {
            Fixture::from(Shape::Wall {
                from: place(ends[0]),
                to: place(ends[1]),
            })
        })
    });
    let scene = Scene::new(fixtures, Vec::new()).expect("sound walls");
    World::new(
        scene,
        BodyConfig::default(),
        Truth::new(-9.0, -9.0, 0.0),
        seed,
    )
    .expect("the robot stands outside")
}

/// The lines that a robot sees, in its own frame; distances are `scale` times as long.
pub(super) fn lines(world: &World, at: Truth, scale: f64, dice: &mut Rng) -> Vec<Segment> {
    let beam = |degree: u16| {
        let bearing = f64::from(degree).to_radians();
        let hit = world.cast_ray(at.point(), at.theta + bearing, RANGE_M)?;
        let far = hit.distance * (1.0 + NOISE * dice.gauss()) * scale;
        let (sin, cos) = libm::sincos(bearing);
        #[expect(clippy::cast_possible_truncation, reason = "millimetres")]
        let point = Point::new((1e3 * far * cos) as f32, (1e3 * far * sin) as f32);
        Some(point)
    };
    let points: Vec<Point> = (0..BEAMS).filter_map(beam).collect();
    let lines = Lines::find(&points, &Settings::DEFAULT);
    let segment = |line: &firmware_core::lines::Line| Segment::new(line.start, line.end);
    lines.as_slice().iter().map(segment).collect()
}

/// A pose of the program.
pub(super) fn believed(at: Truth) -> Pose {
    #[expect(clippy::cast_possible_truncation, reason = "millimetres")]
    let [x, y, heading] = [1e3 * at.x, 1e3 * at.y, at.theta].map(|value| value as f32);
    Pose::new(x, y, heading)
}

/// The map from scans at all `places`.
pub(super) fn map(world: &World, places: &[[f64; 2]], dice: &mut Rng) -> CellMap {
    let mut map = CellMap::new(100.0, 5, 100_000);
    for [x, y] in places {
        let at = Truth::new(*x, *y, 0.0);
        let lines = lines(world, at, 1.0, dice);
        let local = local_map(believed(at), &lines).expect("a small map");
        map.merge(&local).expect("a small map");
    }
    map
}

/// Middles of the corridors of [`LABYRINTH`], 0.6 m apart.
pub(super) fn middles() -> Vec<[f64; 2]> {
    let rows = (0..4).flat_map(|row| (0..5).map(move |column| (column, row)));
    let middle =
        |(column, row): (i32, i32)| [0.35 + 0.6 * f64::from(column), 0.35 + 0.6 * f64::from(row)];
    rows.map(middle).collect()
}

/// Pages 5 and 7: localisation by a single scan.
pub(in super::super) const LOCALISED: Measure = Measure {
    name: "yellow-localised",
    planted: "a map without the margin of the published program",
    perform: localised,
};

/// Number of places of each seed.
const PLACES: usize = 20;
/// Places of the second room alike, and of its brother.
const ROOM: [[f64; 2]; 2] = [[1.25, 1.85], [3.65, 1.85]];
/// Unknown cells around the walls of the published program's map: row `yellow-margin`.
const MARGIN: i32 = 9;

fn localised(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let margin = model.pick(MARGIN, 0);
    let rights = by_case(plan, tell, &[true, false], |is_unique, seed| {
        let mut dice = Rng::stream(seed, "places");
        let walls = if is_unique { LABYRINTH } else { ALIKE };
        let world = world(walls, seed);
        let looks = match is_unique {
            true => middles(),
            false => alike_looks(),
        };
        let map = map(&world, &looks, &mut dice);
        let global = Global::new(&map, margin);
        let mut right = [0_u32; 2];
        for _ in 0..PLACES {
            let from: &[[f64; 2]] = if is_unique { &looks } else { &ROOM };
            let index = usize::try_from(dice.below(from.len() as u64)).unwrap_or(0);
            let [x, y] = from[index].map(|at| at + dice.range(-0.1, 0.1));
            let heading = dice.range(-core::f64::consts::PI, core::f64::consts::PI);
            let at = Truth::new(x, y, heading);
            let lines = lines(&world, at, 1.0, &mut dice);
            for (right, rule) in right.iter_mut().zip([Rule::Multiplied, Rule::Added]) {
                let found = global.localised(&lines, rule).map(|found| {
                    let centre = map.centre_of(found.cell);
                    #[expect(clippy::cast_possible_truncation, reason = "an angle")]
                    let heading = found.heading_deg.to_radians() as f32;
                    Pose::new(centre.x_mm, centre.y_mm, heading)
                });
                *right += u32::from(found.is_some_and(|found| is_right(found, at)));
            }
        }
        right.map(|right| f64::from(right) / PLACES as f64)
    });
    let mut measured = Measured::default();
    let names = [
        [
            "unique places found (share)",
            "unique places found, votes added (share)",
        ],
        [
            "places alike found (share)",
            "places alike found, votes added (share)",
        ],
    ];
    for (names, rights) in names.into_iter().zip(rights) {
        for (rule, name) in names.into_iter().enumerate() {
            measured.value(name, rights.iter().map(|right| right[rule]));
        }
    }
    measured
}

/// Looks that show both rooms and the corridor.
fn alike_looks() -> Vec<[f64; 2]> {
    let corridor = (0..9).map(|step| [0.45 + 0.6 * f64::from(step), 0.45]);
    let rooms = [1.25, 3.65].into_iter();
    let rooms = rooms.flat_map(|x| [[x, 0.95], [x, 1.4], [x, 1.85], [x + 0.6, 1.85]]);
    corridor.chain(rooms).collect()
}

/// Within a cell and a half of 10 cm along both axes, and ten degrees.
fn is_right(found: Pose, at: Truth) -> bool {
    let off = [
        f64::from(found.x_mm) - 1e3 * at.x,
        f64::from(found.y_mm) - 1e3 * at.y,
    ];
    let turned = emulators::world::wrap_angle(f64::from(found.heading) - at.theta);
    off.iter().all(|off| off.abs() <= 150.0) && turned.to_degrees().abs() <= 10.0
}
