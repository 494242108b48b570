//! Error messages: each names the position, the found value and the expected one.

use core::error::Error;

use emulators::pc::{RowError, ScriptError};
use emulators::world::body::chassis::ActuatorKind;
use emulators::world::scene::{Cause, FloorLineError, Part, SceneError, SlickFloorError};
use emulators::world::{
    BodyError, Bounds, Command, CommandError, FootprintError, Point, Pose, WorldError,
};

#[test]
fn a_scene_names_the_part_at_fault() {
    let of = |part, cause| SceneError { part, cause }.to_string();
    let fixture = |cause| of(Part::Fixture(2), cause);
    assert_eq!(
        fixture(Cause::NotFinite),
        "fixture 2: a coordinate or radius is not a finite number"
    );
    assert_eq!(
        fixture(Cause::TooShort { length_m: 0.0 }),
        "fixture 2: a wall of 0 m; expected at least 0.000001 m"
    );
    assert_eq!(
        fixture(Cause::TooFewCorners { found: 2 }),
        "fixture 2: a polygon of 2 corners; expected at least 3"
    );
    assert_eq!(
        fixture(Cause::Radius { found: -1.0 }),
        "fixture 2: a radius of -1 m; expected at least 0.000001 m"
    );
    assert_eq!(
        fixture(Cause::Reflectivity { found: 101.0 }),
        "fixture 2: a reflectivity of 101; expected 0 to 100"
    );
    assert_eq!(
        fixture(Cause::Height { found: 0.0 }),
        "fixture 2: a height of 0 m; expected more than 0"
    );
    assert_eq!(
        fixture(Cause::TooMany { limit: 9 }),
        "fixture 2: more than 9 walls and circles"
    );
    let around = |reach| Bounds::around(Point::new(1.0, 2.0), reach);
    let cause = Cause::OutOfBounds {
        found: around(3.0),
        bounds: around(2.5),
    };
    assert_eq!(
        fixture(cause),
        "fixture 2: it reaches from (-2, -1) to (4, 5) m; \
         expected within (-1.5, -0.5) to (3.5, 4.5) m"
    );
}

#[test]
fn an_obstacle_names_what_is_wrong_with_its_path() {
    let of = |cause| {
        let part = Part::Obstacle(0);
        SceneError { part, cause }.to_string()
    };
    assert_eq!(
        of(Cause::NoWaypoints),
        "obstacle 0: a path without way-points; expected at least 1"
    );
    assert_eq!(
        of(Cause::TimesNotRising { waypoint: 4 }),
        "obstacle 0: way-point 4 is not later than the one before it"
    );
    assert_eq!(
        of(Cause::OpenLoop),
        "obstacle 0: a looping path must end where it begins"
    );
    let cause = Cause::TooFast {
        found_m_s: 7.0,
        limit_m_s: 5.0,
    };
    assert_eq!(
        of(cause),
        "obstacle 0: a speed of 7 m/s; expected at most 5 m/s"
    );
}

#[test]
fn a_floor_says_what_it_cannot_have() {
    assert_eq!(
        SlickFloorError::Corners.to_string(),
        "the first corner is not the lower left one"
    );
    let grip = SlickFloorError::Grip { found: 3.5 }.to_string();
    assert!(grip.starts_with("grip is 3.5, expected 0 to "), "{grip}");
    assert_eq!(
        FloorLineError::NotFinite.to_string(),
        "a coordinate is not finite"
    );
    let width = FloorLineError::Width { found: 9.0 }.to_string();
    assert!(width.starts_with("width is 9 m, expected "), "{width}");
}

#[test]
fn a_body_names_the_figure_that_physics_cannot_work_with() {
    let body = BodyError {
        field: "radius_m",
        found: 0.0,
        min: 0.01,
        max: 2.0,
    };
    let said = "body.radius_m is 0; expected 0.01 to 2";
    assert_eq!(body.to_string(), said);
    assert_eq!(WorldError::Body(body).to_string(), said);
    assert_eq!(
        WorldError::StartNotFinite.to_string(),
        "the start pose is not a finite number"
    );
    let blocked = WorldError::StartBlocked {
        start: Pose::new(1.5, -2.0, 0.0),
        overlap_m: 0.03,
    };
    assert_eq!(
        blocked.to_string(),
        "at its start (1.5, -2) m the robot stands 0.030 m deep in a surface"
    );
    let starts = [
        (
            FootprintError::Radius { found: 9.0 },
            "the radius is 9 m; expected ",
        ),
        (
            FootprintError::Corners { found: 2 },
            "2 corners; expected 3 to ",
        ),
        (
            FootprintError::Reach { corner: 1 },
            "corner 1 is more than ",
        ),
        (FootprintError::Side { side: 3 }, "side 3 is shorter than "),
        (
            FootprintError::Crossing { sides: [0, 2] },
            "sides 0 and 2 touch or cross each other",
        ),
    ];
    for (error, start) in starts {
        assert!(error.to_string().starts_with(start), "{error}");
    }
}

#[test]
fn an_actuator_is_named_with_those_that_there_are() {
    let unknown = CommandError::UnknownActuator {
        wanted: "\"wing\"".to_owned(),
        known: vec!["left".to_owned(), "right".to_owned()],
    };
    assert_eq!(
        unknown.to_string(),
        "there is no actuator \"wing\"; expected one of: left, right"
    );
    let unfit = CommandError::Unfit {
        actuator: "left".to_owned(),
        kind: ActuatorKind::Motor,
        command: Command::Angle(0.5),
    };
    assert_eq!(
        unfit.to_string(),
        "left is a motor and cannot follow an angle, expected power or speed_m_s"
    );
    assert_eq!(ActuatorKind::Steering.to_string(), "steering");
    let endless = CommandError::NotFinite {
        actuator: "left".to_owned(),
    };
    let endless: &dyn Error = &endless;
    assert_eq!(
        endless.to_string(),
        "left was given a value that is not finite"
    );
}

#[test]
fn what_a_pc_gets_or_plays_says_what_does_not_fit() {
    assert_eq!(
        RowError::Layer(3).to_string(),
        "layer 3, but the map has only layer 0"
    );
    let row = RowError::Row {
        height: 800,
        found: 801,
    };
    assert_eq!(row.to_string(), "row 801, but the map has 800 rows");
    let width = RowError::Width {
        expected: 800,
        found: 799,
    };
    assert_eq!(width.to_string(), "799 pixels in a row of 800");
    let starts = [
        (ScriptError::Steps { found: 7 }, "7 steps, at most "),
        (
            ScriptError::Waypoints {
                step: 1,
                found: 101,
            },
            "step 1: 101 waypoints, at most 100 fit a frame",
        ),
        (
            ScriptError::Raw { step: 2, found: 5 },
            "step 2: 5 bytes, at most ",
        ),
    ];
    for (error, start) in starts {
        assert!(error.to_string().starts_with(start), "{error}");
    }
}
