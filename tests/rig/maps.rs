//! Maps that a person can judge: one world each, as text beside its figures.

use hilrig::show::render;
use hilrig::slam::map::RosMap;
use hilrig::slam::map::diff::{Reach, diff};

use super::{failures, run_to_end, shipped};

fn story(name: &str) -> String {
    let outcome = run_to_end(shipped(name));
    assert_eq!(failures(&outcome), Vec::<String>::new(), "{name}");
    let error = outcome.pose_error.expect("the program is in this process");
    let walls = outcome
        .wall_overlap
        .expect("the program is in this process");
    let map = outcome.map.expect("the program is in this process");
    let robot = outcome.truth.last().map(|&(_, pose)| pose);
    format!(
        "{:.1} s, pose error {:.0} mm {:.1} deg RMS, walls {:.2} found {:.2} right\n{}",
        outcome.ran.as_secs_f64(),
        error.rms_mm,
        error.rms_deg,
        walls.found,
        walls.right,
        render::text(map.view(), 6, robot)
    )
}

#[test]
fn an_empty_room_is_four_walls() {
    insta::assert_snapshot!(story("empty-room"));
}

#[test]
fn two_rooms_have_a_door() {
    insta::assert_snapshot!(story("two-rooms"));
}

#[test]
fn legs_are_in_the_map() {
    insta::assert_snapshot!(story("legs"));
}

#[test]
fn an_island_has_four_sides() {
    insta::assert_snapshot!(story("island"));
}

#[test]
fn an_l_is_not_mirrored() {
    insta::assert_snapshot!(story("l-shape"));
}

#[test]
fn who_walks_by_leaves_no_wall() {
    insta::assert_snapshot!(story("moving-obstacle"));
}

/// Two runs with different noise draw the same rooms: without alignment, walls differ by half a
/// cell of 10 mm on average, and hardly a wall is missing in either.
#[test]
fn two_seeds_draw_the_same_rooms() {
    let map = |seed| {
        let (scenario, source) = shipped("l-shape");
        let run = crate::Run::new(scenario, &source, Some(seed)).expect("can be wired");
        let grid = run.finish().map.expect("the program is in this process");
        RosMap::of_grid(grid.view())
    };
    let as_they_lie = Reach {
        shift_m: 0.0,
        turn: 0.0,
    };
    let found = diff(&map(1), &map(2), as_they_lie).expect("walls");
    assert!(
        found.wall_error_mm <= 10.0 && found.overlap() >= 0.97,
        "{found:?}"
    );
}
