extern crate std;

use super::*;
use crate::costmap::Inflation;

const INFLATION: Inflation = Inflation {
    inscribed_m: 0.131,
    radius_m: 0.40,
};

/// A straight corridor from x = -1 m to `end_m`, 1.65 m wide, seen by a camera of 62 degrees.
fn scan(camera: CarPose, end_m: f64) -> Vec<Beam> {
    let beam = |index: i32| {
        let bearing_rad = f64::from(index).to_radians() / 4.0;
        let (sin, cos) = libm::sincos(camera.heading_rad + bearing_rad);
        let to = |from: f64, wall: f64, along: f64| match (wall - from) / along {
            range if range > 0.0 => range,
            _ => f64::INFINITY,
        };
        let aside = if sin > 0.0 { 0.825 } else { -0.825 };
        let ahead = if cos > 0.0 { end_m } else { -1.0 };
        let range_m = to(camera.y_m, aside, sin).min(to(camera.x_m, ahead, cos));
        Beam {
            bearing_rad,
            range_m: if range_m > 10.0 {
                f64::INFINITY
            } else {
                range_m
            },
        }
    };
    (-124..=124).map(beam).collect()
}

fn at(x_m: f64) -> CarPose {
    CarPose {
        x_m,
        ..CarPose::default()
    }
}

fn after(scans: u64) -> Instant {
    Instant::ZERO + DRAW_EVERY * u32::try_from(scans).unwrap()
}

fn costs(survey: &Survey) -> Costmap {
    let plan = survey.plan();
    Costmap::new(
        plan.width,
        plan.cell_m,
        plan.origin_m,
        plan.obstacles,
        INFLATION,
    )
}

/// The checked area ends 4 m ahead of the camera: the car drives there, less its stopping distance,
/// and looks along the corridor. The walls on the map have the right positions.
#[test]
fn the_edge_ahead_is_gone_to() {
    let mut survey = Survey::new(at(0.0));
    for step in 0..10 {
        let found = survey.draw(after(step), at(0.0), &scan(at(0.0), 30.0));
        assert!(found.distance_m(at(0.0)) < 0.02, "{found:?}");
    }
    let map = costs(&survey);
    let wall = |x: f64, y: f64| map.is_obstacle(map.cell([x, y]).unwrap());
    assert!(wall(2.0, 0.82) && wall(2.0, -0.82) && !wall(2.0, 0.5) && !wall(2.0, 0.0));
    let Choice::Look(goal) = survey.next(&map, at(-0.3), false, |_| true) else {
        panic!("no goal");
    };
    assert!(
        (goal.x_m - 3.4).abs() < 0.2 && goal.y_m.abs() < 0.4,
        "{goal:?}"
    );
    assert!(goal.heading_rad.abs() < 0.3 && !survey.is_complete());
    // On the drive to the edge the goal stays the same. If the edge is chosen again later, any
    // heading is accepted.
    let mut again = |is_under_way| survey.next(&map, at(-0.3), is_under_way, |_| true);
    assert_eq!(again(true), Choice::Stay);
    assert_eq!(again(false), Choice::Go(goal));
}

/// The odometry drifts by a degree a metre; the walls keep the map straight.
#[test]
fn the_walls_correct_the_odometry() {
    let mut survey = Survey::new(at(0.0));
    let (mut odometry, mut found) = (at(0.0), at(0.0));
    for step in 0..200_u32 {
        let truth = at(f64::from(step) * 0.04);
        found = survey.draw(after(step.into()), odometry, &scan(truth, 12.0));
        odometry = odometry.then(Motion {
            ahead_m: 0.04,
            left_m: 0.0,
            turn_rad: 0.04_f64.to_radians(),
        });
    }
    assert!((odometry.heading_rad - 8_f64.to_radians()).abs() < 1e-6);
    assert!(
        found.heading_rad.abs() < 0.02 && found.y_m.abs() < 0.08,
        "{found:?}"
    );
    assert!((found.x_m - 7.96).abs() < 0.1, "{found:?}");
}

/// An edge that remains after repeated drives is given up; then the map is complete.
#[test]
fn the_exploration_ends_by_itself() {
    let mut survey = Survey::new(at(0.0));
    for step in 0..10 {
        survey.draw(after(step), at(0.0), &scan(at(0.0), 30.0));
    }
    let map = costs(&survey);
    let mut goals = 0;
    while survey.next(&map, at(-0.3), false, |_| true) != Choice::Done {
        goals += 1;
        assert!(goals < 50);
    }
    assert!(goals >= 3 && survey.is_complete());
    assert_eq!(survey.next(&map, at(-0.3), false, |_| true), Choice::Done);
    // Nothing is decided before anything was drawn.
    let mut fresh = Survey::new(at(0.0));
    assert_eq!(fresh.next(&map, at(0.0), false, |_| true), Choice::Stay);
    assert!(!fresh.is_complete());
}

/// An area beside the path that the car turned away from has no edge: no point within 0.8 m of the
/// path is one, whatever its surroundings.
#[test]
fn what_lies_beside_the_way_is_no_edge() {
    let mut survey = Survey::new(at(0.0));
    for step in 0..40_u32 {
        let truth = at(f64::from(step) * 0.05);
        survey.draw(after(step.into()), truth, &scan(truth, 30.0));
    }
    assert!(survey.is_beside([1.0, 0.8]) && !survey.is_beside([1.0, 1.0]));
    assert!(!survey.is_beside([3.0, 0.0]));
}

/// The gyroscope of a standing car drifts by a degree a second: the map does not turn with it.
#[test]
fn a_car_that_stands_does_not_turn() {
    let mut survey = Survey::new(at(0.0));
    let mut found = at(0.0);
    for step in 0..200_u32 {
        let odometry = CarPose {
            heading_rad: f64::from(step) * 0.2_f64.to_radians(),
            ..at(0.0)
        };
        found = survey.draw(after(step.into()), odometry, &scan(at(0.0), 12.0));
    }
    assert!(
        found.heading_rad.abs() < 0.02 && found.distance_m(at(0.0)) < 0.02,
        "{found:?}"
    );
}

/// The camera sits 0.309 m before the axle, and a standing car with a drifting gyroscope seems to
/// turn about the axle. A wall straight ahead gives no position along it: the map must not swing
/// with the camera, 60 mm for each 0.2 rad.
#[test]
fn a_car_that_stands_before_a_wall_does_not_wander_along_it() {
    let wall: Vec<Beam> = (-30..=30_i32)
        .map(|degrees| {
            let bearing_rad = f64::from(degrees).to_radians();
            let range_m = 0.85 / libm::cos(bearing_rad);
            Beam {
                bearing_rad,
                range_m,
            }
        })
        .collect();
    let axle = at(-CAMERA_AHEAD_M);
    let mut survey = Survey::new(at(0.0));
    let mut found = at(0.0);
    for step in 0..1_000_u32 {
        // A hundredth of a radian every four seconds, as in an odometer's report.
        let heading_rad = f64::from(step / 20) * 0.01;
        let camera = CarPose {
            heading_rad,
            ..axle
        }
        .shifted(CAMERA_AHEAD_M);
        found = survey.draw(after(step.into()), camera, &wall);
    }
    assert!(found.distance_m(at(0.0)) < 0.005, "{found:?}");
}

/// The map's first cell is 16 m behind and to the right of the camera's, a whole number of cells of
/// 50 mm.
#[test]
fn the_map_lies_around_the_first_cell_of_the_camera() {
    let survey = Survey::new(CarPose {
        x_m: 1.02,
        y_m: -0.01,
        heading_rad: 1.0,
    });
    // 1.02 m is the cell from 1.00 on, -0.01 m the one from -0.05 on.
    let [x, y] = survey.view().origin_mm();
    assert!((x + 15_000.0).abs() < 0.01 && (y + 16_050.0).abs() < 0.01);
    let survey = Survey::new(at(0.0));
    let corners = [[-16.0, -16.0], [15.999, -16.0], [-16.0, 15.999]];
    assert_eq!(
        corners.map(|place| survey.index(place)),
        [Some(0), Some(639), Some(639 * 640)]
    );
    for outside in [[16.0, 0.0], [0.0, 16.0], [-16.001, 0.0], [0.0, -16.001]] {
        assert_eq!(survey.index(outside), None);
        assert!(!survey.is_free(outside) && !survey.is_unknown(outside));
    }
}

/// An obstacle in column 200 of row 100 and a free cell in column 190 of row 110: with 12 cells
/// around them, 35 columns from 178 and 35 rows from 88 on. The obstacle is in column 22 of row 12,
/// and the unseen cells beside it, six to each side, are kept off as well.
#[test]
fn a_plan_is_cut_out_around_what_is_known() {
    let mut survey = Survey::new(at(0.0));
    assert_eq!(survey.plan(), FloorPlan::default());
    survey.cells[100 * SIDE + 200] = OBSTACLE;
    survey.cells[110 * SIDE + 190] = FREE;
    let plan = survey.plan();
    assert_eq!((plan.width, plan.obstacles.len()), (35, 35 * 35));
    let is = |found: f64, expected: f64| (found - expected).abs() < 1e-9;
    assert!(
        is(plan.origin_m[0], -7.1) && is(plan.origin_m[1], -11.6),
        "{:?}",
        plan.origin_m
    );
    let at: Vec<usize> = (0..35 * 35)
        .filter(|index| plan.obstacles[*index])
        .collect();
    let mut cross: Vec<usize> = (6..=18).map(|row| row * 35 + 22).collect();
    cross.extend(
        (16..=28)
            .filter(|column| *column != 22)
            .map(|column| 12 * 35 + column),
    );
    cross.sort_unstable();
    assert_eq!(at, cross);
    // At the map's corner there is nothing to be added.
    survey.cells[SIDE * SIDE - 1] = FREE;
    survey.cells[5] = FREE;
    assert_eq!(
        (survey.plan().width, survey.plan().obstacles.len()),
        (640, 640 * 640)
    );
}

/// An unseen region: six cells to each side of a wall's end may be wall. The car keeps off these,
/// but not off the seventh or off free cells. The map's edge is not adjacent to its opposite edge.
#[test]
fn what_nobody_has_seen_beside_a_wall_may_be_wall() {
    let mut survey = Survey::new(at(0.0));
    survey.cells[100 * SIDE + 200] = OBSTACLE;
    survey.cells[100 * SIDE + 202] = FREE;
    let kept_off = |survey: &Survey, cells: core::ops::Range<usize>, is_column: bool| {
        let cell = |at| if is_column { [200, at] } else { [at, 100] };
        let all = cells.filter(|at| survey.is_kept_off(cell(*at)));
        all.collect::<Vec<usize>>()
    };
    let along = [194, 195, 196, 197, 198, 199, 200, 201, 203, 204, 205, 206];
    assert_eq!(kept_off(&survey, 180..220, false), along);
    assert_eq!(
        kept_off(&survey, 80..120, true),
        (94..=106).collect::<Vec<usize>>()
    );
    assert!(!survey.is_kept_off([201, 101]));
    survey.cells[50 * SIDE] = OBSTACLE;
    survey.cells[SIDE - 1] = OBSTACLE;
    assert!(!survey.is_kept_off([SIDE - 1, 49]) && !survey.is_kept_off([0, 1]));
    assert!(survey.is_kept_off([0, 44]) && survey.is_kept_off([SIDE - 7, 0]));
}

/// A cell is an obstacle if two more scans had a point in it than had none, and free if one more
/// had none. The count is limited to 10 and to -3, and each scan counts once.
#[test]
fn a_cell_is_what_most_scans_say() {
    let mut survey = Survey::new(at(0.0));
    let place = [1.01, 1.01];
    let mut after = |scans: usize, by: i8| {
        for _ in 0..scans {
            survey.scans += 1;
            survey.count(place, by);
            survey.count(place, by);
        }
        survey.cells[survey.index(place).unwrap()]
    };
    assert_eq!([after(1, 1), after(1, 1)], [UNKNOWN, OBSTACLE]);
    assert_eq!([after(2, -1), after(1, -1)], [OBSTACLE, FREE]);
    assert_eq!(
        [after(20, -1), after(4, 1), after(1, 1)],
        [FREE, FREE, OBSTACLE]
    );
    assert_eq!(
        [after(20, 1), after(10, -1), after(1, -1)],
        [OBSTACLE, OBSTACLE, FREE]
    );
}

/// An obstacle 2 m ahead is entered and the path to it is free up to 1.925 m; one 3.5 m ahead is
/// not entered yet; of a beam of 10 m the first 4 m were checked.
#[test]
fn a_beam_frees_its_way_and_enters_its_end() {
    let looked = |range_m: f64, x_m: f64| {
        let mut survey = Survey::new(at(0.0));
        let bearing_rad = core::f64::consts::FRAC_PI_2;
        let turned = CarPose {
            heading_rad: -bearing_rad,
            ..at(0.52)
        };
        for _ in 0..2 {
            survey.scans += 1;
            let beam = Beam {
                bearing_rad,
                range_m,
            };
            survey.look(turned, &[beam]);
        }
        survey.cells[survey.index([0.5 + x_m, 1e-9]).unwrap()]
    };
    assert_eq!(
        [1.91, 1.96, 2.03].map(|x_m| looked(2.01, x_m)),
        [FREE, UNKNOWN, OBSTACLE]
    );
    assert_eq!(
        [3.42, 3.47, 3.53].map(|x_m| looked(3.51, x_m)),
        [FREE, UNKNOWN, UNKNOWN]
    );
    assert_eq!([3.98, 4.06].map(|x_m| looked(10.0, x_m)), [FREE, UNKNOWN]);
    assert_eq!(
        [2.97, 3.03].map(|x_m| looked(x_m, x_m)),
        [OBSTACLE, UNKNOWN]
    );
}

/// The fifth goal in a row with fewer than 100 new cells ends the exploration.
#[test]
fn four_goals_may_show_nothing() {
    let mut survey = Survey::new(at(0.0));
    let mut show = |cells: usize| {
        survey.cells[..cells].fill(FREE);
        survey.is_in_vain()
    };
    assert!(!show(100));
    assert_eq!([show(100), show(150), show(199), show(199)], [false; 4]);
    assert!(!show(200));
    assert_eq!(
        [200, 200, 200, 200, 299].map(show),
        [false, false, false, false, true]
    );
}

/// Once, with an edge given up, the car drives back to the newest position at least 2.5 m away with
/// enough room.
#[test]
fn the_car_goes_back_once_by_two_and_a_half_metres() {
    let mut survey = Survey::new(at(0.0));
    survey.track = [0.0, 1.0, 2.0, 3.5, 4.5].map(at).to_vec();
    assert_eq!(survey.back(at(4.5), Vec::new(), |_| true), None);
    for _ in 0..3 {
        survey.tried.add([9.0, 0.0]);
    }
    assert_eq!(survey.back(at(4.5), Vec::new(), |_| false), None);
    assert_eq!(
        survey.clone().back(at(4.5), Vec::new(), |_| true),
        Some(at(2.0))
    );
    assert_eq!(
        survey.clone().back(at(4.4), Vec::new(), |_| true),
        Some(at(1.0))
    );
    assert_eq!(
        survey.back(at(4.5), Vec::new(), |pose| pose.x_m < 1.5),
        Some(at(1.0))
    );
    assert_eq!(survey.tried.given_up().count(), 0);
    for _ in 0..3 {
        survey.tried.add([9.0, 0.0]);
    }
    assert_eq!(survey.back(at(4.5), Vec::new(), |_| true), None);
}

/// The next scan is due 0.2 s after the last one.
#[test]
fn five_scans_a_second_are_drawn() {
    let mut survey = Survey::new(at(0.0));
    assert!(survey.is_due(Instant::ZERO));
    survey.draw(after(1), at(0.0), &[]);
    let ms = |ms| Instant::ZERO + Duration::from_millis(ms);
    assert_eq!([399, 400].map(|at| survey.is_due(ms(at))), [false, true]);
}

/// Two edges nearer than 0.6 m are the same; the third try is the last.
#[test]
fn an_edge_is_tried_three_times() {
    let mut tried = Tried::default();
    assert!(tried.add([0.0, 0.0]) && !tried.add([0.3, 0.5]) && tried.add([0.0, 0.6]));
    assert_eq!(tried.given_up().count(), 0);
    assert!(!tried.add([-0.59, 0.0]));
    assert_eq!(tried.given_up().collect::<Vec<_>>(), [[0.0, 0.0]]);
    assert!(edges::are_same([1.0, 2.0], [1.3, 2.5]) && !edges::are_same([1.0, 2.0], [1.4, 2.5]));
}

/// A corridor of 1 m between walls, free from `from_m` to `to_m`, unknown beyond.
#[expect(clippy::cast_possible_truncation, reason = "some hundred cells")]
fn corridor(from_m: f64, to_m: f64) -> Survey {
    let mut survey = Survey::new(at(0.0));
    let column = |m: f64| usize::try_from((m * 20.0).round() as i64 + 320).unwrap();
    for y in 309..=330 {
        let value = if (310..330).contains(&y) {
            FREE
        } else {
            OBSTACLE
        };
        survey.cells[y * SIDE..][column(from_m)..column(to_m)].fill(value);
    }
    survey
}

/// The next goal of a car at 0 in a corridor, and the edge.
fn goes(heading_rad: f64, from_m: f64, to_m: f64) -> (CarPose, [f64; 2]) {
    let survey = corridor(from_m, to_m);
    let pose = CarPose {
        heading_rad,
        ..at(0.01)
    };
    edges::next(&survey, &costs(&survey), pose, |_| true).expect("there are two edges")
}

/// An edge behind costs 12 m more: 1.6 m behind is as good as 13.6 m ahead. An edge at a right
/// angle, to either side, costs 6 m more. An edge nearer than 1.5 m, which is 30 cells, costs 8 m
/// more.
#[test]
fn an_edge_behind_or_too_near_costs_metres() {
    let is_ahead = |heading_rad, from_m, to_m| goes(heading_rad, from_m, to_m).1[0] > 0.0;
    assert!(is_ahead(0.0, -1.6, 13.3) && !is_ahead(0.0, -1.6, 13.9));
    let aside = core::f64::consts::FRAC_PI_2;
    assert!(is_ahead(aside, -4.0, 3.8) && !is_ahead(aside, -4.0, 4.3));
    assert!(is_ahead(aside, -9.3, 1.0) && !is_ahead(aside, -8.6, 1.0));
    assert!(is_ahead(-aside, -4.0, 1.55) && !is_ahead(aside, -4.0, 1.5));
}

/// The goal lies 0.6 m before the edge, on the path to it, and looks along the path. Without room
/// there, the car stops earlier.
#[test]
fn the_goal_lies_before_the_edge() {
    let (goal, edge) = goes(0.0, -1.6, 8.0);
    assert!(
        (edge[0] - 7.975).abs() < 1e-6 && edge[1].abs() < 0.08,
        "{edge:?}"
    );
    assert!(
        (goal.x_m - 7.4).abs() < 0.06 && goal.y_m.abs() < 0.08,
        "{goal:?}"
    );
    assert!(goal.heading_rad.abs() < 0.2, "{goal:?}");
    let (goal, edge) = goes(core::f64::consts::PI, -8.0, 1.6);
    assert!((edge[0] + 7.975).abs() < 1e-6, "{edge:?}");
    assert!((goal.x_m + 7.4).abs() < 0.06, "{goal:?}");
    assert!(goal.heading_rad.abs() > 2.9, "{goal:?}");
    let survey = corridor(-1.6, 8.0);
    let near = |pose: CarPose| pose.x_m < 5.0;
    let found = edges::next(&survey, &costs(&survey), at(0.01), near).expect("there is room");
    assert!((found.0.x_m - 4.975).abs() < 1e-6, "{found:?}");
    let barred = edges::next(&survey, &costs(&survey), at(0.01), |_| false).unwrap_err();
    let mut ends: Vec<f64> = barred.iter().map(|[x_m, _]| *x_m).collect();
    ends.sort_by(f64::total_cmp);
    assert!(
        (ends[0] + 1.575).abs() < 0.03 && (ends[1] - 7.975).abs() < 0.03,
        "{ends:?}"
    );
}

/// Around 2 times 2 unknown cells there are 8 adjacent cells, around 3 times 3 there are 12, the
/// minimum of an edge.
#[test]
fn twelve_cells_make_an_edge() {
    let found = |side: usize| {
        let mut survey = corridor(-1.0, 1.0);
        for y in 310..330 {
            let row = &mut survey.cells[y * SIDE..][..SIDE];
            (row[300], row[339]) = (OBSTACLE, OBSTACLE);
            if (318..318 + side).contains(&y) {
                row[325..325 + side].fill(UNKNOWN);
            }
        }
        edges::next(&survey, &costs(&survey), at(0.01), |_| true).is_ok()
    };
    assert_eq!([0, 2, 3].map(found), [false, false, true]);
}

/// A beam of 1 m along y from a cell's middle frees the cells up to a cell and a half before its
/// end, 0.925 m. A beam beside it, by 0.0125 rad or more, frees cells of its own. A point farther
/// than 3 m is not entered, and its beam frees up to 4 m.
#[test]
fn a_beam_frees_cells_along_its_own_bearing() {
    let camera = CarPose {
        x_m: 0.025,
        y_m: 0.025,
        heading_rad: core::f64::consts::FRAC_PI_2,
    };
    let looked = |beams: &[(f64, f64)]| {
        let mut survey = Survey::new(camera);
        let beams: Vec<Beam> = beams
            .iter()
            .map(|&(bearing_rad, range_m)| Beam {
                bearing_rad,
                range_m,
            })
            .collect();
        survey.scans = 1;
        survey.look(camera, &beams);
        survey
    };
    let seen =
        |survey: &Survey, x_m: f64, y_m: f64| survey.index([x_m, y_m]).map(|at| survey.seen[at]);
    let one = looked(&[(0.0, 1.0)]);
    let along = |y_m| seen(&one, 0.025, y_m);
    assert_eq!([0.03, 0.5, 0.92].map(along), [Some(-1); 3]);
    assert_eq!([0.98, 1.02, 1.08].map(along), [Some(0), Some(1), Some(0)]);
    assert_eq!(
        [seen(&one, 0.5, 0.025), seen(&one, -0.5, 0.025)],
        [Some(0); 2]
    );
    let aside = looked(&[(core::f64::consts::FRAC_PI_2, 0.5)]);
    assert_eq!(
        [seen(&aside, -0.475, 0.025), seen(&aside, -0.2, 0.025)],
        [Some(1), Some(-1)]
    );
    let far = looked(&[(0.0, 3.1)]);
    assert_eq!(
        [seen(&far, 0.025, 3.125), seen(&far, 0.025, 3.0)],
        [Some(0), Some(-1)]
    );
    let nothing = looked(&[(0.0, f64::INFINITY)]);
    assert_eq!(
        [seen(&nothing, 0.025, 3.98), seen(&nothing, 0.025, 4.08)],
        [Some(-1), Some(0)]
    );
    // At 3.9 m, beams 0.0124 rad apart are 48 mm from each other, beams 0.013 rad apart 51 mm.
    let both = |beside: f64| seen(&looked(&[(0.0, 9.0), (-beside, 9.0)]), 0.06, 3.9);
    assert_eq!([both(0.012_4), both(0.013)], [Some(0), Some(-1)]);
}

/// A position within 0.9 m of the driven track was passed, except where the car still is.
#[test]
fn what_lies_beside_the_track_was_passed() {
    let mut survey = Survey::new(at(0.0));
    survey.track = (0..4).map(|n| at(f64::from(n) * 3.0)).collect();
    let is_beside = |x_m, y_m| survey.is_beside([x_m, y_m]);
    assert!(is_beside(6.0, 0.89) && is_beside(6.0, -0.89) && is_beside(6.5, 0.7));
    assert!(!is_beside(6.0, 0.91) && !is_beside(6.7, 0.7) && !is_beside(9.0, 0.0));
    assert!(is_beside(0.0, 0.0) && !is_beside(1.5, 0.0));
}

/// A car that moves to and fro within a metre has not passed that position, however often; an open
/// area there may be its next goal. A metre on, the car has passed.
#[test]
fn who_moves_to_and_fro_has_not_passed() {
    let mut survey = Survey::new(at(0.0));
    survey.track = (0..10).map(|n| at(f64::from(n) * 0.6)).collect();
    assert!(survey.is_beside([3.8, 0.0]) && !survey.is_beside([4.9, 0.7]));
    for _ in 0..10 {
        survey.track.extend([at(5.0), at(5.4)]);
    }
    assert!(survey.is_beside([3.8, 0.0]) && !survey.is_beside([4.9, 0.7]));
    survey.track.push(at(6.2));
    assert!(survey.is_beside([4.9, 0.7]));
}

/// An edge given up beside the path is checked once more after the car has gone back: then it
/// counts as an edge again.
#[test]
fn what_was_given_up_beside_the_way_counts_after_going_back() {
    let mut survey = Survey::new(at(0.0));
    survey.track = (0..20).map(|n| at(f64::from(n) * 0.5)).collect();
    for _ in 0..3 {
        survey.tried.add([6.0, 0.5]);
    }
    let is_beside = |survey: &Survey, x_m| survey.is_beside([x_m, 0.5]);
    assert!(is_beside(&survey, 6.0) && is_beside(&survey, 6.8));
    assert!(survey.back(at(9.5), Vec::new(), |_| true).is_some());
    assert!(!is_beside(&survey, 6.0) && !is_beside(&survey, 6.8) && is_beside(&survey, 7.0));
}

/// A car that drove 2 m, with a position each 0.25 m, and reverses by 1.25 m has the last positions
/// ahead of it again: they no longer count as passed. When it drives forward they count again.
#[test]
fn who_backs_out_has_not_come_by() {
    let mut survey = Survey::new(at(0.0));
    let mut after_steps = |steps: &mut dyn Iterator<Item = i32>| {
        for step in steps {
            survey.draw(after(0), at(f64::from(step) * 0.25), &[]);
        }
        survey.track.len()
    };
    assert_eq!(after_steps(&mut (0..=8)), 9);
    assert_eq!(after_steps(&mut (3..8).rev()), 4);
    assert_eq!(after_steps(&mut (4..=8)), 9);
}

/// Before an edge without room to stand the car drives back some of its path and tries the edge
/// again, once.
#[test]
fn who_is_barred_from_an_edge_goes_back() {
    let mut survey = Survey::new(at(0.0));
    survey.track = (0..20).map(|n| at(f64::from(n) * 0.5)).collect();
    let mut back = |barred: Vec<[f64; 2]>| survey.back(at(9.5), barred, |_| true);
    assert_eq!(back(Vec::new()), None);
    let goal = back(alloc::vec![[6.0, 0.5]]).expect("a place on its way");
    assert!((goal.x_m - 7.0).abs() < 1e-9);
    assert_eq!(back(alloc::vec![[6.0, 0.5]]), None);
    assert!(!survey.is_beside([6.0, 0.5]));
}

/// The camera's track is stored each 20 cm.
#[test]
fn the_track_is_kept_each_twenty_centimetres() {
    let mut survey = Survey::new(at(0.0));
    let kept = [0.0, 0.1, 0.19, 0.21, 0.3, 0.4, 0.42].map(|x_m| {
        survey.draw(after(0), at(x_m), &[]);
        survey.track.len()
    });
    assert_eq!(kept, [1, 1, 1, 2, 2, 2, 3]);
}

/// The same corridors for a car 5 m farther on, along x and along y: the search for the edge starts
/// at the car.
#[test]
fn where_an_edge_lies_is_seen_from_the_car() {
    let quarter = core::f64::consts::FRAC_PI_2;
    for is_turned in [false, true] {
        let is_ahead = |heading_rad: f64, from_m: f64, to_m: f64| {
            let mut survey = corridor(5.0 + from_m, 5.0 + to_m);
            let mut pose = CarPose {
                heading_rad,
                ..at(5.01)
            };
            if is_turned {
                let cells = survey.cells.clone();
                for (index, cell) in cells.iter().enumerate() {
                    survey.cells[index % SIDE * SIDE + index / SIDE] = *cell;
                }
                pose = CarPose {
                    x_m: pose.y_m,
                    y_m: pose.x_m,
                    heading_rad: quarter - heading_rad,
                };
            }
            let (_, edge) = edges::next(&survey, &costs(&survey), pose, |_| true).unwrap();
            edge[usize::from(is_turned)] > 5.0
        };
        assert!(is_ahead(0.0, -4.0, 5.0) && !is_ahead(quarter * 2.0, -4.0, 5.0));
    }
}

/// A look from (0.025, 0.025) m along y, in cells of 5 cm, in steps of half a cell: up to one and a
/// half cells before its end the space is free; a point farther than 3 m is not entered, and 4 m
/// are cleared.
#[test]
fn a_look_passes_cells_up_to_its_end() {
    let camera = CarPose {
        x_m: 0.025,
        y_m: 0.025,
        heading_rad: core::f64::consts::FRAC_PI_2,
    };
    let seen = |beams: &[[f64; 2]]| {
        let beams: Vec<Beam> = beams
            .iter()
            .map(|[bearing_rad, range_m]| Beam {
                bearing_rad: *bearing_rad,
                range_m: *range_m,
            })
            .collect();
        let mut survey = Survey::new(camera);
        survey.scans = 1;
        survey.look(camera, &beams);
        move |x: i32, y: i32| {
            let middle = |cell: i32| (f64::from(cell) + 0.5) * CELL_M;
            survey.seen[survey.index([middle(x), middle(y)]).unwrap()]
        }
    };
    let near = seen(&[[0.0, 1.01]]);
    let along: Vec<i8> = (-1..22).map(|y| near(0, y)).collect();
    let expected = [&[0][..], &[-1; 19], &[0, 1, 0]].concat();
    assert_eq!(along, expected);
    assert!((0..22).all(|y| near(1, y) == 0 && near(-1, y) == 0));
    let (entered, too_far) = (seen(&[[0.0, 3.0]]), seen(&[[0.0, 3.06]]));
    assert_eq!((entered(0, 60), too_far(0, 61)), (1, 0));
    let far = seen(&[[0.0, f64::INFINITY]]);
    assert_eq!([79, 81, 90].map(|y| far(0, y)), [-1, 0, 0]);
    // Beams that end less than a cell apart, 0.0125 rad, are one: 2.5 m on they are 3 cm apart.
    let aside = |bearing: f64| seen(&[[0.0, 9.0], [bearing, 9.0]])(-1, 50);
    assert_eq!([0.0124, 0.0125].map(aside), [0, -1]);
    let third = seen(&[[0.0, 9.0], [0.0125, 9.0], [0.0249, 9.0]]);
    assert_eq!([third(-1, 70), third(-2, 70)], [-1, 0]);
    let right = seen(&[[0.0, 9.0], [-0.02, 9.0]]);
    assert_eq!(right(1, 60), -1);
}
