extern crate std;

use std::boxed::Box;

use core::f32::consts::FRAC_PI_2;

use super::*;
use crate::grid::UNKNOWN;

const BODY: Body = Body {
    radius_mm: 160.0,
    clearance_mm: 45.0,
    tick_mm_s: 11.345,
    axle_mm: 260.0,
};

fn fill(map: &mut Grid, [x0, y0, x1, y1]: [usize; 4], value: u8) {
    for y in y0..=y1 {
        for x in x0..=x1 {
            map.set(x, y, value);
        }
    }
}

/// A known room from 0.3 m to 1.5 m. Its right wall has a door of `door` cells of 10 mm, from y =
/// 0.6 m up; the space behind it is unknown.
fn room(door: usize) -> Box<Grid> {
    let mut map = Box::new(Grid::new(10.0));
    fill(&mut map, [27, 27, 152, 152], 255);
    fill(&mut map, [30, 30, 149, 149], 0);
    if door > 0 {
        fill(&mut map, [150, 60, 152, 59 + door], 0);
    }
    map
}

const MIDDLE: Pose = Pose {
    x_mm: 900.0,
    y_mm: 900.0,
    heading: 0.0,
};

fn next(frontiers: &mut Frontiers, map: &Grid) -> Option<View> {
    frontiers.next_view(map, (&BODY, Outlook::SMALL), MIDDLE, &Surroundings::EMPTY)
}

#[test]
fn a_room_without_a_way_out_is_done() {
    assert_eq!(next(&mut Frontiers::new(Sought::Floor), &room(0)), None);
}

/// The view shows the open door, and a body of 205 mm fits there.
#[test]
fn a_door_is_looked_through() {
    let (map, mut frontiers) = (room(60), Frontiers::new(Sought::Floor));
    let view = next(&mut frontiers, &map).expect("a view");
    assert!(frontiers.outlook(&map, view.place).is_worth_a_way());
    let Point { x_mm, y_mm } = view.place;
    assert!((480.0..1320.0).contains(&y_mm) && x_mm > 480.0, "{view:?}");
    assert!(frontiers.take_points() > 100, "rays cost time");
}

/// A crack of 6 cm is no door.
#[test]
fn a_crack_is_not_worth_a_way() {
    assert_eq!(next(&mut Frontiers::new(Sought::Floor), &room(6)), None);
}

/// Known floor behind a wall, with a hole too narrow for the robot, is not a possible view.
#[test]
fn what_cannot_be_reached_is_not_sought() {
    let mut map = room(0);
    fill(&mut map, [153, 30, 280, 149], 0);
    fill(&mut map, [150, 80, 152, 88], 0);
    let view = next(&mut Frontiers::new(Sought::Floor), &map);
    assert!(view.is_none_or(|view| view.place.x_mm < 1500.0), "{view:?}");
}

/// A door that stays unknown, seen from a distance and from near by, is given up; after `forgive`
/// it counts again.
#[test]
fn what_shows_nothing_is_given_up_in_the_end() {
    let (map, mut frontiers) = (room(60), Frontiers::new(Sought::Floor));
    let mut looks = 0;
    while let Some(view) = next(&mut frontiers, &map) {
        frontiers.give_up(&map, view.place, Sought::FloorAndHeat);
        looks += 1;
        assert!(looks < 20, "never ends");
    }
    assert!(looks >= 1, "{looks}");
    frontiers.forgive();
    assert!(next(&mut frontiers, &map).is_some());
}

/// The edges of a view that was not reached are given up, but the robot may feel its walls from
/// another view.
#[test]
fn walls_outlive_a_place_that_is_not_got_to() {
    let (map, mut frontiers) = (room(60), Frontiers::new(Sought::FloorAndHeat));
    let place = next(&mut frontiers, &map).expect("a door").place;
    let outlook = |frontiers: &mut Frontiers| {
        let outlook = frontiers.outlook(&map, place);
        (outlook.unknown > 0, outlook.unfelt > 0)
    };
    assert_eq!(outlook(&mut frontiers), (true, true));
    frontiers.give_up(&map, place, Sought::Floor);
    assert_eq!(outlook(&mut frontiers), (false, true));
    frontiers.give_up(&map, place, Sought::FloorAndHeat);
    assert_eq!(outlook(&mut frontiers), (false, false));
}

/// Of two doors alike the nearer one comes first.
#[test]
fn a_short_way_is_better_than_a_long_one() {
    let mut map = room(0);
    fill(&mut map, [70, 150, 129, 152], 0);
    fill(&mut map, [27, 60, 29, 119], 0);
    let view = |x_mm: f32, y_mm: f32| {
        let pose = Pose::new(x_mm, y_mm, 0.0);
        let mut frontiers = Frontiers::new(Sought::Floor);
        let view = frontiers.next_view(&map, (&BODY, Outlook::SMALL), pose, &Surroundings::EMPTY);
        view.expect("a view").place
    };
    let (left, up) = (view(560.0, 560.0), view(1240.0, 1240.0));
    assert!(left.x_mm + left.y_mm < up.x_mm + up.y_mm, "{left:?} {up:?}");
}

#[test]
fn a_robot_off_its_map_finds_nothing() {
    let mut frontiers = Frontiers::new(Sought::Floor);
    let pose = Pose::new(-50.0, 900.0, 0.0);
    let view = frontiers.next_view(
        &room(60),
        (&BODY, Outlook::SMALL),
        pose,
        &Surroundings::EMPTY,
    );
    assert_eq!(view, None);
    let off = Point::new(f32::NAN, 0.0);
    assert_eq!(frontiers.outlook(&room(60), off), Outlook::default());
}

/// Behind a crack of one cell the map draws the flank of the board, 6 cm of it, and then nothing.
#[test]
fn the_flank_behind_a_crack_is_no_floor() {
    let mut map = room(0);
    fill(&mut map, [153, 30, 158, 149], 60);
    fill(&mut map, [150, 87, 152, 92], 0);
    assert_eq!(next(&mut Frontiers::new(Sought::Floor), &map), None);
}

/// The walls are one map cell thick, with free ones on both sides: most of a cell is free.
#[test]
fn a_thin_board_is_a_wall_and_can_be_felt() {
    let mut map = Box::new(Grid::new(10.0));
    fill(&mut map, [24, 24, 155, 155], 60);
    fill(&mut map, [28, 28, 151, 151], 255);
    fill(&mut map, [29, 29, 150, 150], 0);
    let mut frontiers = Frontiers::new(Sought::FloorAndHeat);
    let view = next(&mut frontiers, &map).expect("a wall to feel");
    let outlook = frontiers.outlook(&map, view.place);
    assert_eq!((outlook.unknown, outlook.is_to_be_felt()), (0, true));
}

/// A strip of wall that only two rays meet, 8 cm, is too narrow for a heat plate. This also holds
/// at the stage where only many unknown cells count.
#[test]
fn a_strip_of_a_wall_is_not_worth_a_way() {
    let outlook = |unknown, unfelt| Outlook { unknown, unfelt };
    let worth = [outlook(0, 2), outlook(5, 2), outlook(0, 3), outlook(6, 0)];
    assert_eq!(
        worth.map(Outlook::is_worth_a_way),
        [false, false, true, true]
    );
    let gain = |least| outlook(29, 3).gain(least);
    assert_eq!(gain(Outlook::SMALL), Some(29 + 12));
    assert_eq!(
        (gain(Outlook::LARGE), gain(Outlook::NEVER)),
        (Some(12), Some(12))
    );
}

#[test]
fn a_place_that_showed_nothing_is_left_alone_until_it_is_forgiven() {
    let (map, mut frontiers) = (room(60), Frontiers::new(Sought::Floor));
    let first = next(&mut frontiers, &map).expect("a view");
    frontiers.showed_nothing(&map, first.place);
    let second = next(&mut frontiers, &map).expect("another view");
    let apart = second.place.distance_mm(first.place);
    assert!(apart > 120.0, "{apart} mm");
    frontiers.forgive();
    assert_eq!(next(&mut frontiers, &map), Some(first));
}

/// A felt wall 0.3 m away adds known cells once; feeling the same wall again adds none.
#[test]
fn walls_that_were_felt_are_known_once_more() {
    let map = room(0);
    let mut frontiers = Frontiers::new(Sought::FloorAndHeat);
    let mut known = |bearings: &[f32]| {
        frontiers.feel(&map, Point::new(1_200.0, 900.0), bearings.iter().copied());
        frontiers.known_cells(&map)
    };
    let [before, one, again, two] = [&[][..], &[0.0], &[0.0], &[0.0, 0.7]].map(&mut known);
    assert!(
        before > 0 && one > before && again == one && two > one,
        "{before} {one} {two}"
    );
}

/// A board of 2 cm is as thick as a planner's cell. A robot that has passed one side may count both
/// as felt, and then never finds a victim on the other side. In the end the search distinguishes
/// its faces: of the 48 rays, 16 go to a face of 0.6 m from 0.16 m away.
#[test]
fn a_board_has_two_faces_in_the_end() {
    let mut map = room(0);
    fill(&mut map, [60, 90, 119, 92], 255);
    let mut frontiers = Frontiers::new(Sought::FloorAndHeat);
    let places = [740.0, 1_090.0].map(|y_mm| Point::new(900.0, y_mm));
    let along = |side: f32| (-6..=6_i8).map(move |n| f32::from(n) / 5.0 + side * FRAC_PI_2);
    let outlook = |frontiers: &mut Frontiers| places.map(|at| frontiers.outlook(&map, at).unfelt);
    let before = outlook(&mut frontiers);
    assert!(before.into_iter().all(|rays| rays >= 12), "{before:?}");
    frontiers.feel(&map, places[0], along(1.0));
    let after = outlook(&mut frontiers);
    assert!(after.into_iter().all(|rays| rays < 8), "{after:?}");
    frontiers.forgive();
    let [below, above] = outlook(&mut frontiers);
    assert!(below == 0 && above >= 12, "{below} {above}");
    frontiers.feel(&map, places[1], along(-1.0));
    assert_eq!(outlook(&mut frontiers), [0, 0]);
}

/// A niche of 3 by 3 planner's cells in the wall at the other end of a hall is unknown: a few
/// cells. From 0.5 m away it is a view. From 2.4 m away the path of 80 cells would require 6 + 80 /
/// 4 = 26 unknown cells.
#[test]
fn a_few_cells_are_not_worth_a_long_way() {
    let mut map = Box::new(Grid::new(10.0));
    fill(&mut map, [3, 27, 296, 104], 255);
    fill(&mut map, [6, 30, 293, 101], 0);
    fill(&mut map, [285, 60, 293, 74], UNKNOWN);
    let looks = |x_mm: f32| {
        let pose = Pose::new(x_mm, 660.0, 0.0);
        let mut frontiers = Frontiers::new(Sought::Floor);
        let nothing = Surroundings::EMPTY;
        frontiers.next_view(&map, (&BODY, Outlook::SMALL), pose, &nothing)
    };
    assert!(looks(2_300.0).is_some());
    assert_eq!(looks(300.0), None);
}

/// On a floor of 28 m a door justifies a path of 20 m, 667 cells, just as one of 3 m.
#[test]
fn a_door_is_worth_any_way() {
    let worth = [0, 3, 80, 96, 667, u16::MAX].map(Outlook::worth_a_way_of);
    assert_eq!(worth, [6, 6, 26, 30, 30, 30]);
}

/// A door of 380 mm, through which the body of 320 mm only just fits, into a corridor. The
/// corridor's upper end is unseen and cannot be seen from the room.
#[test]
fn a_way_that_the_body_only_just_fits_through_is_the_last_resort() {
    let mut map = room(0);
    fill(&mut map, [153, 27, 243, 280], 255);
    fill(&mut map, [153, 30, 240, 280], 0);
    fill(&mut map, [150, 30, 152, 67], 0);
    let view = next(&mut Frontiers::new(Sought::Floor), &map).expect("a view");
    assert!(view.place.x_mm > 1_500.0, "{view:?}");
    fill(&mut map, [150, 60, 152, 67], 255);
    assert_eq!(next(&mut Frontiers::new(Sought::Floor), &map), None);
}

/// From the middle of the room each of the 48 rays crosses 20 to 28 cells to the wall.
#[test]
fn each_step_of_a_ray_is_work() {
    let (map, mut frontiers) = (room(0), Frontiers::new(Sought::Floor));
    frontiers.outlook(&map, MIDDLE.position());
    let steps = frontiers.steps - SCENE_STEPS;
    assert!((48 * 20..=48 * 29).contains(&steps), "{steps}");
    let points = frontiers.take_points();
    assert_eq!(points, (SCENE_STEPS + steps) / 32);
    assert_eq!(frontiers.steps, (SCENE_STEPS + steps) % 32);
    assert_eq!(frontiers.take_points(), 0);
}

/// The floor below the robot is unknown, four cells of 30 mm to each side: the search wave starts
/// from the fifth cell. With one more unknown cell there is no start.
#[test]
fn a_robot_sets_out_from_the_floor_beside_it() {
    let finds = |cells: usize| {
        let mut map = room(60);
        let (first, last) = (3 * (30 - cells), 3 * (30 + cells) + 2);
        fill(&mut map, [first, first, last, last], UNKNOWN);
        next(&mut Frontiers::new(Sought::Floor), &map).is_some()
    };
    assert_eq!([1, 4, 5].map(finds), [true, true, false]);
}

/// Five of nine map cells make a planner's cell free or unknown, two solid ones prevent both; a
/// cell of neither kind may be a wall to feel.
#[test]
fn a_coarse_cell_is_what_most_of_it_is() {
    let kind = |free: usize, unknown: usize, solid: usize| {
        let mut map = Box::new(Grid::new(10.0));
        let others = [70; 9].into_iter().enumerate().map(|(at, other)| match at {
            _ if at < free => 0,
            _ if at < free + unknown => UNKNOWN,
            _ if at < free + unknown + solid => 255,
            _ => other + UNKNOWN - 69,
        });
        for (at, value) in others.enumerate() {
            map.set(30 + at % 3, 60 + at / 3, value);
        }
        let (cell, map) = (Cell { x: 10, y: 20 }, &*map);
        let scene = Scene::of(map, &Frontiers::new(Sought::FloorAndHeat));
        [&scene.free, &scene.unknown, &scene.walls].map(|cells| cells.has(cell))
    };
    let (free, unknown, wall) = (
        [true, false, false],
        [false, true, false],
        [false, false, true],
    );
    assert_eq!([kind(9, 0, 0), kind(5, 3, 1), kind(5, 0, 0)], [free; 3]);
    assert_eq!([kind(0, 9, 0), kind(3, 5, 1), kind(0, 5, 0)], [unknown; 3]);
    assert_eq!(
        [kind(5, 2, 2), kind(2, 5, 2), kind(4, 4, 1), kind(0, 0, 9)],
        [wall; 4]
    );
}
