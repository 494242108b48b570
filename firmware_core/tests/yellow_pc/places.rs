//! YE11: localisation of the robot on a map.

use firmware_core::map_view::MapView;
use firmware_core::pose::Pose;
use firmware_core::robots::yellow::pc::{Estimate, PcCommand, PcConfig, TaskState, Votes};

use crate::bench::{Bench, pose};
use crate::looking::places;
use crate::mapping::truth;
use crate::robot::{At, Errors};
use crate::world::World;

/// Rooms and corridors that are all different.
const UNLIKE: &str = "
###########
#   #     #
# # # ### #
#   #   # #
### # # # #
#     #   #
###########
";

/// Four equal rooms on a corridor whose ends differ.
const ALIKE: &str = "
#################
#   #   #   #   #
#   #   #   #   #
#   #   #   #   #
# ### ### ### ###
#               #
# ###############
#   #############
#################
";
const ROOM: usize = 10;
/// Distance from room to room, metres.
const ALIKE_M: f64 = 2.2;

/// The true map of a world: cells, width and origin.
pub(crate) fn map_of(world: &World) -> (Vec<u8>, usize, [f32; 2]) {
    let walls = truth(world);
    let low = walls.iter().fold([i64::MAX; 2], |low, (x, y)| {
        [low[0].min(*x), low[1].min(*y)]
    });
    let high = walls.iter().fold([i64::MIN; 2], |top, (x, y)| {
        [top[0].max(*x), top[1].max(*y)]
    });
    let mut cells = Vec::new();
    for y in low[1]..=high[1] {
        for x in low[0]..=high[0] {
            let middle = [x as f64 * 0.1 + 0.05, y as f64 * 0.1 + 0.05];
            let (bx, by) = world.block_of(middle);
            cells.push(match (walls.contains(&(x, y)), world.is_solid(bx, by)) {
                (true, _) => 255,
                (_, true) => 127,
                _ => 0,
            });
        }
    }
    let width = usize::try_from(high[0] - low[0] + 1).expect("positive");
    (cells, width, low.map(|along| along as f32 * 100.0))
}

/// A bench whose robot does not know its pose, with the true map loaded.
fn bench(world: &World, at: At, seed: u64, votes: Votes) -> Bench {
    let (cells, width, origin) = map_of(world);
    let config = PcConfig {
        seed,
        votes,
        ..PcConfig::default()
    };
    let errors = Errors {
        way: 0.005,
        turn: -0.005,
        range: 0.005,
    };
    let mut bench = Bench::new(world.clone(), at, errors, config);
    bench.robot.odometry = At {
        x: 7.0,
        y: -3.0,
        heading: 1.0,
    };
    bench
        .pc
        .load_map(&MapView::new(width, 100.0, origin, &cells))
        .expect("small");
    bench.command(PcCommand::Localise);
    bench
}

fn is_right(found: Pose, truth: Pose) -> bool {
    let off = found.position().distance_mm(truth.position());
    let turn = firmware_core::pose::normalised(found.heading - truth.heading);
    off <= 142.0 && turn.abs().to_degrees() <= 3.0
}

fn first(bench: &mut Bench) -> Estimate {
    for _ in 0..1_000 {
        bench.step();
        if let Some(estimate) = bench.pc.estimate() {
            return estimate;
        }
    }
    panic!("nothing after 10 s: {}", bench.pc.status());
}

/// Numbers of found and of flagged positions out of `count`, and the sorted ratios.
fn unlike(votes: Votes, count: usize) -> (usize, usize, Vec<f32>) {
    let world = World::labyrinth(UNLIKE, ROOM, [0.02, 0.07]);
    let (mut right, mut flagged, mut ratios) = (0, 0, Vec::new());
    for (seed, at) in (0..).zip(places(&world, count, 3)) {
        let estimate = first(&mut bench(&world, at, seed, votes));
        right += usize::from(is_right(estimate.pose, pose(at)));
        flagged += usize::from(estimate.is_ambiguous());
        ratios.push(estimate.ratio);
    }
    ratios.sort_by(f32::total_cmp);
    (right, flagged, ratios)
}

#[test]
fn ye11_unlike_places_are_told_apart() {
    let (right, flagged, ratios) = unlike(Votes::Best, 40);
    println!(
        "{right} of 40 right, {flagged} flagged, median ratio {:.2}",
        ratios[20]
    );
    assert!(right >= 36, "{right}");
    // A flagged position costs only the time of another scan.
    assert!(flagged <= 8, "{flagged}");
}

#[test]
fn ye11_votes_find_fewer_places() {
    let [added, multiplied] = [Votes::Added, Votes::Multiplied].map(|votes| unlike(votes, 40).0);
    println!("{added} and {multiplied} of 40 right");
    assert!(added < 36 && multiplied < 36, "{added} {multiplied}");
    assert!(multiplied <= added, "{added} {multiplied}");
}

/// Positions in the second room that look the same in the third to a lidar without noise.
fn alike(world: &World) -> Vec<At> {
    let candidates = places(world, 1_500, 4).into_iter();
    let ranges = |x: f64, at: &At| -> Vec<f64> {
        let angle = |degree: i32| f64::from(degree).to_radians();
        (0..360)
            .map(|degree| world.ray([x, at.y], angle(degree)))
            .collect()
    };
    let second = candidates.filter(|at| {
        let [x, y] = [at.x - world.origin[0], at.y - world.origin[1]];
        (2.3..4.4).contains(&x) && y > 2.4
    });
    let alike = second.filter(|at| {
        let pair = ranges(at.x, at).into_iter().zip(ranges(at.x + ALIKE_M, at));
        pair.filter(|(one, other)| (one - other).abs() > 0.05)
            .count()
            == 0
    });
    alike.take(25).collect()
}

#[test]
fn ye11_places_alike_are_flagged_and_told_apart_by_another_look() {
    let world = World::labyrinth(ALIKE, ROOM, [0.02, 0.07]);
    let places = alike(&world);
    let (mut flagged, mut second, mut done) = (0, 0, 0);
    for (seed, at) in (0..).zip(&places) {
        let mut bench = bench(&world, *at, seed, Votes::Best);
        let estimate = first(&mut bench);
        flagged += usize::from(estimate.is_ambiguous());
        bench.run_task(300);
        let is_right = bench
            .pc
            .believed_pose()
            .is_some_and(|found| is_right(found, pose(bench.robot.truth)));
        let is_done = bench.pc.task_state() == TaskState::Done && is_right;
        done += usize::from(is_done);
        second += usize::from(is_done && bench.counter("ambiguous") == 1);
    }
    let count = places.len();
    println!("{count} alike: {flagged} flagged, {second} right after two looks, {done} in the end");
    assert!(count >= 20, "{count}");
    assert!(flagged * 10 >= count * 9, "{flagged}");
    assert!(second * 10 >= count * 8, "{second}");
}
