extern crate std;

use std::vec::Vec;

use super::*;
use crate::ackermann::CarPose;
use crate::costmap::{Costmap, Inflation};

const INFLATION: Inflation = Inflation {
    inscribed_m: 0.165,
    radius_m: 0.40,
};

fn car() -> Lattice {
    Lattice::new(PrimitiveSet::car(), &outline())
}

/// Outline of the car: the floor that it covers, around its middle.
fn outline() -> Outline {
    Outline::rectangle(0.23, 0.23, 0.165)
}

fn at(x_m: f64, y_m: f64, heading_deg: f64) -> CarPose {
    CarPose {
        x_m,
        y_m,
        heading_rad: heading_deg.to_radians(),
    }
}

fn to(pose: CarPose) -> Goal {
    Goal {
        pose,
        with_heading: true,
    }
}

/// A map in cells of 5 cm with obstacles where `is_wall` says so, metres.
fn map(size_m: [f64; 2], is_wall: impl Fn(f64, f64) -> bool) -> Costmap {
    #[expect(clippy::cast_possible_truncation, reason = "some hundred")]
    let [width, height] = size_m.map(|m| (m / 0.05).round() as usize);
    let cells = (0..width * height).map(|at| {
        let (x, y) = ((at % width) as f64, (at / width) as f64);
        is_wall((x + 0.5) * 0.05, (y + 0.5) * 0.05)
    });
    Costmap::new(width, 0.05, [0.0; 2], cells.collect(), INFLATION)
}

/// Specification A6: costs and lengths of the car's primitives.
#[test]
fn the_primitives_are_those_of_the_car() {
    let set = PrimitiveSet::car();
    assert_eq!(set.all().len(), 80);
    let found = |start: u32| {
        let of = set.of(start);
        of.map(|one| (one.end.0, one.end.1, one.base_cost()))
            .collect::<Vec<_>>()
    };
    let straight = [([1, 0], 0, 125), ([7, 0], 0, 875), ([-1, 0], 0, 1_250)];
    assert_eq!(found(0)[..3], straight);
    assert_eq!(found(0)[3..], [([14, 2], 1, 3_566), ([14, -2], 15, 3_566)]);
    let slanted = [([5, 2], 1, 674), ([5, 2], 1, 674), ([-5, -2], 1, 6_740)];
    assert_eq!(found(1)[..3], slanted);
    assert_eq!(found(1)[3..], [([14, 8], 2, 4_066), ([14, 3], 0, 3_606)]);
    assert_eq!(
        found(2)[2..],
        [
            ([-5, -5], 2, 8_840),
            ([10, 13], 3, 4_136),
            ([13, 9], 1, 3_982)
        ]
    );
    // By mirror and quarter turns.
    assert_eq!(found(3)[3..], [([8, 14], 2, 4_066), ([3, 14], 4, 3_606)]);
    assert_eq!(found(4)[4..], [([2, 14], 3, 3_566)]);
    assert_eq!(found(9)[0], ([-5, -2], 9, 674));
    for (start, lengths) in [
        (0, [0.713, 0.713]),
        (1, [0.813, 0.721]),
        (2, [0.827, 0.796]),
    ] {
        for (one, expected) in set.of(start).skip(3).zip(lengths) {
            assert!(
                (one.length_m() - expected).abs() < 0.001,
                "{} {expected}",
                one.length_m()
            );
        }
    }
    // Curvature: with the smallest wheelbase, 0.25 m, a primitive needs at most 10.8 degrees of
    // steering.
    for (index, one) in set.all().iter().enumerate() {
        for pair in one.poses.windows(2) {
            let way = libm::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
            let bend = crate::ackermann::wrapped(pair[1][2] - pair[0][2]).abs() / way;
            let steering = libm::atan(0.25 * bend).to_degrees();
            assert!(steering < 10.9, "primitive {index}: {steering}");
        }
    }
    // Primitives of slanted headings that occur twice in the file are tried once.
    let tried: usize = (0..16).map(|angle| car().actions(angle).len()).sum();
    assert_eq!(tried, 68);
}

/// AP11: a corridor of 1.2 m with a corner. The outline never overlaps an obstacle, all motions are
/// the car's, and no pass is worse than the one before.
#[test]
fn ap11_a_corridor_with_a_corner_is_planned() {
    let is_wall =
        |x: f64, y: f64| !(y < 1.3 && y > 0.1 || x > 8.7 && x < 9.9) || x < 0.1 || y > 9.9;
    let map = map([10.0, 10.0], is_wall);
    let plan = car().plan(
        &map,
        at(0.6, 0.7, 0.0),
        to(at(9.3, 9.0, 90.0)),
        Limits::default(),
    );
    let plan = plan.unwrap();
    assert_eq!(plan.bound, 1.0);
    assert_eq!(plan.passes.len(), 21);
    assert!(
        plan.passes.windows(2).all(|pair| pair[0].1 >= pair[1].1),
        "{:?}",
        plan.passes
    );
    assert_sound(&plan, &map);
    let last = plan.poses.last().unwrap();
    assert!(
        last.distance_m(at(9.3, 9.0, 90.0)) < 0.05
            && (last.heading_rad.to_degrees() - 90.0).abs() < 1e-6
    );
}

/// The plan's motions follow each other, and the outline overlaps no obstacle at any of them.
fn assert_sound(plan: &Plan, map: &Costmap) {
    for pair in plan.poses.windows(2) {
        assert!(pair[0].distance_m(pair[1]) < 0.12, "{pair:?}");
    }
    for pose in &plan.poses {
        let cell = map.cell([pose.x_m, pose.y_m]).unwrap();
        for y in cell[1] - 7..=cell[1] + 7 {
            for x in cell[0] - 7..=cell[0] + 7 {
                let pose = [pose.x_m, pose.y_m, pose.heading_rad];
                let overlaps = outline().overlaps(pose, map.middle_m([x, y]), 0.05);
                assert!(
                    !(overlaps && map.is_obstacle([x, y])),
                    "{pose:?} in {x} {y}"
                );
            }
        }
    }
}

/// The least cost by Dijkstra's search over the same lattice, without any estimate: the reference.
fn least_cost(lattice: &Lattice, map: &Costmap, start: [i32; 3], goal: [i32; 3]) -> Option<u32> {
    use core::cmp::Reverse;
    use std::collections::{BTreeMap, BinaryHeap};
    let mut done: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    let mut open = BinaryHeap::from([Reverse((0_u32, start))]);
    while let Some(Reverse((cost, at))) = open.pop() {
        if at == goal {
            return Some(cost);
        }
        if done.contains_key(&at) {
            continue;
        }
        done.insert(at, cost);
        for action in lattice.actions(at[2] as u32) {
            if let Some(step) = action.cost(map, [at[0], at[1]]) {
                let next = [
                    at[0] + action.end[0],
                    at[1] + action.end[1],
                    action.end_angle as i32,
                ];
                open.push(Reverse((cost + step, next)));
            }
        }
    }
    None
}

/// P5: maps with random blocks, until 12 had a path. The cost of each pass is within its factor of
/// the least one, the last cost is the least one, and the outline overlaps no obstacle. If the
/// planner finds no path, there is none.
#[test]
fn p5_plans_are_within_their_bounds_on_random_maps() {
    let lattice = car();
    let (mut planned, mut state) = (0, 1_u64);
    let mut dice = move |below: u64| {
        // Knuth's linear generator: any maps are suitable.
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    let mut number = 0;
    while planned < 12 {
        number += 1;
        let blocks: Vec<[f64; 2]> = (0..5)
            .map(|_| [0, 1].map(|_| dice(50) as f64 * 0.1))
            .collect();
        let is_wall = |x: f64, y: f64| {
            let is_in = |[bx, by]: &[f64; 2]| (x - bx).abs() < 0.3 && (y - by).abs() < 0.3;
            blocks.iter().any(is_in) || !(0.1..4.9).contains(&x) || !(0.1..4.9).contains(&y)
        };
        let map = map([5.0, 5.0], is_wall);
        let (start, goal) = (at(0.5, 0.5, 45.0), at(4.4, 4.4, 45.0));
        let optimum = least_cost(&lattice, &map, [10, 10, 2], [88, 88, 2]);
        match lattice.plan(&map, start, to(goal), Limits::default()) {
            Ok(plan) => {
                planned += 1;
                let optimum = optimum.unwrap();
                for (bound, cost) in &plan.passes {
                    assert!(
                        f64::from(*cost) <= bound * f64::from(optimum),
                        "map {number}: {cost}"
                    );
                }
                assert_eq!(plan.cost, optimum, "map {number}");
                assert_sound(&plan, &map);
            }
            Err(NoPlan::NoWay) => assert_eq!(optimum, None, "map {number}"),
            Err(NoPlan::Start) => assert!(!lattice.is_free(&map, [10, 10], 2)),
            Err(NoPlan::Goal) => assert!(!lattice.is_free(&map, [88, 88], 2)),
            Err(other) => panic!("map {number}: {other}"),
        }
    }
    assert!(number <= 150, "{number} maps were drawn");
}

/// P5: across 20 m by 20 m between 60 blocks. The effort is counted in expanded poses; no pass is
/// worse than the one before.
#[test]
fn p5_a_map_of_20_m_is_planned_promptly() {
    let lattice = car();
    let blocks: Vec<[f64; 2]> = (1..=60)
        .map(|number| {
            // Weyl's sequence: even over the floor, and no pattern.
            let part = |by: f64| (f64::from(number) * by).fract() * 16.0 + 2.0;
            [part(0.754_877_666), part(0.569_840_291)]
        })
        .collect();
    let is_wall = |x: f64, y: f64| {
        let is_in = |[bx, by]: &[f64; 2]| (x - bx).abs() < 0.4 && (y - by).abs() < 0.4;
        blocks.iter().any(is_in) || !(0.1..19.9).contains(&x) || !(0.1..19.9).contains(&y)
    };
    let map = map([20.0, 20.0], is_wall);
    let goal = to(at(19.0, 19.0, 45.0));
    let plan = lattice.plan(&map, at(1.0, 1.0, 45.0), goal, Limits::PROMPT);
    let plan = plan.unwrap();
    assert_sound(&plan, &map);
    assert!(plan.expansions <= 60_000, "{}", plan.expansions);
    assert!(plan.passes.is_sorted_by(|one, next| one.1 >= next.1));
}

#[test]
fn what_cannot_be_planned_is_said() {
    let lattice = car();
    let is_wall = |x: f64, _: f64| (2.0..2.2).contains(&x);
    let map = map([4.0, 2.0], is_wall);
    let plan = |start, goal| {
        lattice
            .plan(&map, start, to(goal), Limits::default())
            .map(drop)
    };
    let (left, right) = (at(1.0, 1.0, 0.0), at(3.0, 1.0, 0.0));
    assert_eq!(plan(left, right), Err(NoPlan::NoWay));
    assert_eq!(plan(at(1.9, 1.0, 0.0), left), Err(NoPlan::Start));
    assert_eq!(plan(left, at(2.1, 1.0, 0.0)), Err(NoPlan::Goal));
    assert_eq!(plan(at(f64::NAN, 0.0, 0.0), left), Err(NoPlan::Start));
    assert_eq!(plan(left, left), Ok(()));
    let few = Limits {
        expansions_max: 3,
        ..Limits::default()
    };
    let far = lattice.plan(&map, left, to(at(1.0, 1.5, 180.0)), few);
    assert_eq!(far.map(drop), Err(NoPlan::Limit));
    let coarse = Costmap::new(10, 0.1, [0.0; 2], [false; 100].into(), INFLATION);
    assert_eq!(
        lattice
            .plan(&coarse, left, to(left), Limits::default())
            .map(drop),
        Err(NoPlan::Resolution)
    );
}

/// The heading nearest to an angle, without whole turns: each of sixteen is 22.5 degrees.
#[test]
fn a_heading_is_the_nearest_one() {
    let set = PrimitiveSet::car();
    let of = |degrees: f64| set.angle(degrees.to_radians());
    assert_eq!([11.0, 12.0, 348.0, -12.0, 371.0].map(of), [0, 1, 15, 15, 0]);
    assert_eq!([-371.0, -373.0].map(of), [0, 15]);
    assert!((set.heading_rad(12).to_degrees() - 270.0).abs() < 1e-9);
}

/// A plan across a free floor of 3 m, from the left to the right.
fn crossing(limits: Limits) -> Plan {
    let floor = map([3.0, 2.0], |_, _| false);
    car()
        .plan(&floor, at(0.62, 1.02, 0.0), to(at(1.62, 1.02, 0.0)), limits)
        .unwrap()
}

/// Each pass lowers its factor by the step, and the last one is 1. A factor below 1 becomes 1, and
/// an infinite one becomes 1000.
#[test]
fn passes_lower_their_factor_to_one() {
    let bounds = |first_bound, bound_step| {
        let plan = crossing(Limits {
            first_bound,
            bound_step,
            ..Limits::default()
        });
        // A metre at 0.4 m/s.
        assert!(plan.passes.iter().all(|(_, cost)| *cost >= 2_500));
        assert_eq!(
            (plan.cost, plan.bound),
            (2_500, plan.passes.last().unwrap().0)
        );
        plan.passes
            .iter()
            .map(|(bound, _)| *bound)
            .collect::<Vec<_>>()
    };
    assert_eq!(bounds(1.5, 0.25), [1.5, 1.25, 1.0]);
    assert_eq!(bounds(1.6, 0.4), [1.6, 1.200_000_000_000_000_2, 1.0]);
    assert_eq!(bounds(0.2, 0.4), [1.0]);
    assert_eq!(bounds(f64::INFINITY, 999.5), [1_000.0, 1.0]);
    assert_eq!(bounds(1.02, 0.0).len(), 3);
}

/// With any heading allowed the car drives straight on: 20 cells of 5 cm at 0.4 m/s.
#[test]
fn a_place_is_reached_with_any_heading() {
    let floor = map([3.0, 2.0], |_, _| false);
    let goal = Goal {
        pose: at(1.62, 1.02, 180.0),
        with_heading: false,
    };
    let plan = car()
        .plan(&floor, at(0.62, 1.02, 0.0), goal, Limits::default())
        .unwrap();
    assert_eq!(plan.cost, 2_500);
    assert_eq!(plan.poses.last().unwrap().heading_rad, 0.0);
}
