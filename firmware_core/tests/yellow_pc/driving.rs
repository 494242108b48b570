//! YE12: the robot drives to a goal.

use firmware_core::map_view::MapView;
use firmware_core::robots::yellow::pc::{
    Failure, Mapping, PcCommand, PcConfig, Planning, TaskState,
};
use protocols::telemetry::message::Telecommand;

use crate::bench::{Bench, pose};
use crate::looking::places;
use crate::mapping::{CORRIDOR, LABYRINTH, mapped, median};
use crate::places::map_of;
use crate::robot::{At, Errors, wrapped};
use crate::world::World;

const PAIRS: usize = 20;

fn world() -> World {
    World::labyrinth(LABYRINTH, CORRIDOR, [0.0, 0.0])
}

/// Starts and goals in the middle of corridors, with enough space for the robot.
fn pairs(world: &World) -> Vec<(At, At)> {
    let all = places(world, 400, 12).into_iter();
    let wide: Vec<At> = all
        .filter(|at| world.clearance([at.x, at.y]) > 0.2)
        .take(2 * PAIRS)
        .collect();
    wide.chunks_exact(2)
        .map(|pair| (pair[0], pair[1]))
        .collect()
}

fn bench(world: &World, start: At, config: PcConfig) -> Bench {
    let (cells, width, origin) = map_of(world);
    let config = PcConfig {
        start: Some(pose(start)),
        ..config
    };
    let mut bench = Bench::new(world.clone(), start, Errors::default(), config);
    bench
        .pc
        .load_map(&MapView::new(width, 100.0, origin, &cells))
        .expect("small");
    bench
}

#[expect(clippy::cast_possible_truncation, reason = "as the command has it")]
fn to(goal: At, heading: Option<f64>) -> PcCommand {
    PcCommand::Navigate {
        x_m: goal.x as f32,
        y_m: goal.y as f32,
        heading_rad: heading.map(|heading| heading as f32),
    }
}

fn navigate(bench: &mut Bench, goal: At) -> f64 {
    bench.command(to(goal, Some(goal.heading)));
    bench.run_task(300)
}

/// Number of arrivals, durations and repeated commands of all pairs.
fn drive_all(config: PcConfig, lost_drives: f64) -> (usize, Vec<f64>, u64) {
    let world = world();
    let (mut arrived, mut times, mut resends) = (0, Vec::new(), 0);
    for (seed, (start, goal)) in (0..).zip(pairs(&world)) {
        let mut bench = bench(&world, start, PcConfig { seed, ..config });
        bench.lost_drives = lost_drives;
        let seconds = navigate(&mut bench, goal);
        let truth = bench.robot.truth;
        let is_there = (truth.x - goal.x).abs() <= 0.05 && (truth.y - goal.y).abs() <= 0.05;
        let looks = wrapped(truth.heading - goal.heading).abs() <= 0.06;
        let is_done = bench.pc.task_state() == TaskState::Done;
        if is_done {
            assert!(is_there && looks, "{truth:?} is not {goal:?}");
            assert!(bench.robot.room > 0.0, "touches a wall");
            arrived += 1;
            times.push(seconds);
        }
        resends += bench.counter("re-sends");
    }
    (arrived, times, resends)
}

#[test]
fn ye12_goals_are_reached_without_contact() {
    let (arrived, times, resends) = drive_all(PcConfig::default(), 0.0);
    println!("median {} resends {resends}", median(times));
    assert_eq!(arrived, PAIRS);
    assert_eq!(resends, 0);
}

#[test]
fn ye12_goals_are_reached_though_a_third_of_the_commands_is_lost() {
    let (arrived, times, resends) = drive_all(PcConfig::default(), 0.3);
    println!("median {} resends {resends}", median(times));
    assert_eq!(arrived, PAIRS);
    assert!(resends > 0, "nothing was lost");
}

/// A checksum does not detect two swapped bytes of an order, so a robot may drive into a wall. In
/// this test the first order of each drive is wrong by half a radian, 29 degrees. Without
/// supervision, 22 of 40 touch a wall, and two never arrive. Telemetry each 200 ms is too late for
/// some that start beside a wall.
#[test]
fn a_robot_that_was_sent_elsewhere_is_told_again() {
    let world = world();
    let (mut told, mut touched) = (0, 0);
    for (seed, (start, goal)) in (0..).zip(pairs(&world)) {
        for off in [0.5, -0.5] {
            let config = PcConfig {
                seed,
                ..PcConfig::default()
            };
            let mut bench = bench(&world, start, config);
            bench.first_drive_off = off;
            navigate(&mut bench, goal);
            assert_eq!(bench.pc.task_state(), TaskState::Done, "{start:?}");
            touched += u32::from(bench.robot.room <= 0.0);
            told += u32::from(bench.counter("re-sends") > 0);
        }
    }
    assert!(told > 20 && touched <= 4, "{told} told, {touched} touched");
}

/// Odometry with an error of 1 %. After mapping, the robot drives from end to end of the labyrinth
/// and arrives within 5 cm, because it localises itself during the drive; by odometry alone it does
/// not.
#[test]
fn ye12_a_robot_whose_odometry_drifts_is_told_where_it_is() {
    let beside = |seed, odometry_alone| {
        let mapping = Mapping {
            odometry_alone,
            ..Mapping::default()
        };
        let mut bench = mapped(
            seed,
            PcConfig {
                mapping,
                ..PcConfig::default()
            },
        );
        let [x, y] = bench.world.room(11, 9, CORRIDOR);
        let goal = At { x, y, heading: 1.0 };
        navigate(&mut bench, goal);
        let truth = bench.robot.truth;
        (truth.x - x).abs().max((truth.y - y).abs())
    };
    let ours = [21, 22, 23].map(|seed| beside(seed, false));
    assert!(ours.iter().all(|beside| *beside <= 0.05), "{ours:?}");
    let by_odometry = [21, 22, 23].map(|seed| beside(seed, true));
    assert!(
        by_odometry.iter().any(|beside| *beside > 0.05),
        "{by_odometry:?}"
    );
}

/// A robot stops on its path after 6 cm and 6 degrees that its wheels did not count. It localises
/// itself before the next drive command. With the old pose, it would miss the goal.
#[test]
fn a_robot_that_stops_on_its_way_looks_around_before_it_goes_on() {
    let mut bench = mapped(21, PcConfig::default());
    let [x, y] = bench.world.room(11, 9, CORRIDOR);
    bench.command(to(At { x, y, heading: 0.0 }, None));
    let (driven, count) = (bench.robot.driven, bench.commands.len());
    while bench.robot.driven < driven + 0.4 {
        bench.step();
    }
    bench.robot.roll(0.06, 0.1);
    let told = bench.commands.len();
    bench.run_task(300);
    let later = &bench.commands[told..];
    let next = |is: fn(&Telecommand) -> bool| later.iter().position(|(_, it)| is(it));
    let (look, drive) = (
        next(|it| it.lines.is_some()),
        next(|it| it.desired_pose.is_some()),
    );
    assert!(
        told > count && look.is_some() && look < drive,
        "{look:?} {drive:?}"
    );
    assert_eq!(bench.pc.task_state(), TaskState::Done);
    let At {
        x: at_x, y: at_y, ..
    } = bench.robot.truth;
    assert!(
        (at_x - x).abs().max((at_y - y).abs()) <= 0.05,
        "{at_x} {at_y}"
    );
}

/// Six corridors joined at alternating ends.
const SERPENTINE: &str = "
#############
#           #
# ###########
#           #
########### #
#           #
# ###########
#           #
########### #
#           #
# ###########
#           #
#############
";

/// B8: the course's single roadmap of 100 vertices finds the path through a serpentine in about
/// half of the cases; ours always does.
#[test]
fn ye12_one_roadmap_fails_in_a_serpentine() {
    let found = |planning| {
        let world = World::labyrinth(SERPENTINE, CORRIDOR, [0.0, 0.0]);
        let at = |row| {
            let [x, y] = world.room(11, row, CORRIDOR);
            At { x, y, heading: 0.0 }
        };
        let seeds = (0..10).filter(|seed| {
            let config = PcConfig {
                seed: *seed,
                planning,
                ..PcConfig::default()
            };
            let mut bench = bench(&world, at(11), config);
            bench.run_for(1);
            bench.command(to(at(1), None));
            bench.run_for(1);
            bench.pc.task_state() == TaskState::InProgress
        });
        seeds.count()
    };
    assert_eq!(found(Planning::Retried), 10);
    let once = found(Planning::Once);
    println!("{once} of 10");
    assert!((1..=8).contains(&once), "{once}");
}

/// B8: the command is repeated at most five times, then the drive has failed.
#[test]
fn ye12_a_robot_that_never_obeys_is_told_six_times() {
    let world = world();
    let (start, goal) = pairs(&world)[0];
    let mut bench = bench(&world, start, PcConfig::default());
    bench.lost_drives = 1.0;
    navigate(&mut bench, goal);
    assert_eq!(bench.pc.task_state(), TaskState::Failed(Failure::NoAnswer));
    let is_drive = |(_, command): &&(u64, Telecommand)| command.desired_pose.is_some();
    let times: Vec<u64> = bench
        .commands
        .iter()
        .filter(is_drive)
        .map(|(at, _)| *at)
        .collect();
    assert_eq!(times.len(), 6);
    // After three checks, half a second apart and up to a frame late.
    let gaps = times.windows(2).map(|pair| pair[1] - pair[0]);
    assert!(
        gaps.into_iter().all(|gap| (1_500..=2_400).contains(&gap)),
        "{times:?}"
    );
}
