//! YE9: the local map of one scan.

use std::collections::BTreeSet;

use firmware_core::local_map::{Segment, local_map};
use firmware_core::pose::{Point, Pose};

use crate::bench::pose;
use crate::chance::Chance;
use crate::mapping::{CORRIDOR, LABYRINTH, cells, drawn, is_near};
use crate::robot::{At, Errors, Robot};
use crate::world::{World, cell};

fn segments(robot: &mut Robot, world: &World) -> Vec<Segment> {
    let lines = robot.look(world).into_iter();
    let point = |end: protocols::telemetry::message::Pose| Point::new(end.x, end.y);
    lines
        .map(|line| Segment::new(point(line.start), point(line.end)))
        .collect()
}

/// Cells of all faces that a lidar without noise hits, a ray each tenth of a degree.
fn visible(world: &World, at: At) -> BTreeSet<(i64, i64)> {
    let rays = (0..3_600).filter_map(|tenth| {
        let angle = f64::from(tenth).to_radians() / 10.0;
        let range = world.ray([at.x, at.y], angle) + 0.001;
        let (sin, cos) = libm::sincos(angle);
        let hit = [at.x + range * cos, at.y + range * sin];
        (range < 5.0).then(|| hit.map(cell))
    });
    rays.map(|[x, y]| (x, y)).collect()
}

/// Positions in the open with enough space for the robot.
pub(crate) fn places(world: &World, count: usize, seed: u64) -> Vec<At> {
    let mut chance = Chance::new(seed);
    let open = world.open();
    let mut places = Vec::new();
    while places.len() < count {
        let block = open[chance.index(open.len())];
        let [x, y] = block.map(|along| along + chance.between(-0.05, 0.05));
        let heading = chance.between(-3.1, 3.1);
        if world.clearance([x, y]) > 0.15 {
            places.push(At { x, y, heading });
        }
    }
    places
}

#[test]
fn ye9_walls_of_one_look_are_where_they_are() {
    let world = World::labyrinth(LABYRINTH, CORRIDOR, [0.03, -0.04]);
    let range = 0.005;
    let (mut precisions, mut recalls) = (Vec::new(), Vec::new());
    for (seed, at) in (0..).zip(places(&world, 40, 1)) {
        let errors = Errors {
            range,
            ..Errors::default()
        };
        let mut robot = Robot::new(at, errors, seed);
        let map = local_map(pose(at), &segments(&mut robot, &world)).expect("small");
        let view = map.view().expect("walls");
        let (truth, seen) = (visible(&world, at), cells(&view, 255));
        let all = crate::mapping::truth(&world);
        let right = seen.iter().filter(|cell| is_near(&all, **cell)).count();
        let found = truth.iter().filter(|cell| is_near(&seen, **cell)).count();
        precisions.push(right as f64 / seen.len() as f64);
        recalls.push(found as f64 / truth.len() as f64);
        // No cell behind a wall: the middle of a free cell is visible, except for one cell at the
        // edges.
        for (x, y) in cells(&view, 0) {
            let is_seen = (-1..=1).any(|dx| {
                (-1..=1).any(|dy| {
                    let middle = [(x + dx) as f64 * 0.1 + 0.05, (y + dy) as f64 * 0.1 + 0.05];
                    let (dx, dy) = (middle[0] - at.x, middle[1] - at.y);
                    dx.hypot(dy) <= world.ray([at.x, at.y], libm::atan2(dy, dx))
                })
            });
            assert!(is_seen, "free cell {x} {y} is behind a wall, seed {seed}");
        }
    }
    let least = |parts: &[f64]| parts.iter().copied().fold(1.0, f64::min);
    let mean = |parts: &[f64]| parts.iter().sum::<f64>() / parts.len() as f64;
    println!(
        "precision {:.3}, recall {:.3}",
        least(&precisions),
        least(&recalls)
    );
    assert!(least(&precisions) >= 0.9, "{precisions:?}");
    // At flat angles, points on far walls are too far apart for a line.
    assert!(
        mean(&recalls) >= 0.9 && least(&recalls) >= 0.85,
        "{recalls:?}"
    );
}

/// Worked out by hand: a wall 1 m ahead and 2 m wide, seen from the middle of a cell.
#[test]
fn ye9_a_wall_ahead_frees_the_cone_before_it() {
    let wall = Segment::new(Point::new(1_000.0, -990.0), Point::new(1_000.0, 990.0));
    let map = local_map(Pose::new(50.0, 50.0, 0.0), &[wall]).expect("small");
    let view = map.view().expect("a wall");
    let walls: BTreeSet<(i64, i64)> = (-10..=10).map(|y| (10, y)).collect();
    assert_eq!(cells(&view, 255), walls);
    let free = cells(&view, 0);
    assert!(free.contains(&(9, 0)) && free.contains(&(0, 0)));
    // Half a metre ahead, the cone is a metre wide; cells behind the wall are unknown.
    assert!(free.contains(&(5, 4)) && !free.contains(&(5, 6)) && !free.contains(&(11, 0)));
    insta::assert_snapshot!("local_map", drawn(&view));
    // A margin of five cells on all sides.
    assert_eq!(view.origin_mm(), [-500.0, -1_500.0]);
}
