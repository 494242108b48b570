//! One moment of a run as an SVG picture, for pages without a script. It shows solid shapes,
//! waypoints, the true and the believed path up to the moment, and both poses of the robot.
//!
//! The page defines the colours: the picture uses the classes `shape`, `waypoint`, `truth` and
//! `belief`.

use core::fmt::{self, Write as _};

use emulators::world::Pose;
use protocols::Instant;

use super::report::{failed_at, last_exchanges};
use super::view::{Outline, millimetres};
use engine::run::Outcome;

/// Maximum number of points of a path.
const WAY_MAX: usize = 300;
/// Free space around the world, as a share of its longer side.
const MARGIN: f64 = 0.03;
/// Size of a waypoint, as a share of the longer side.
const DOT: f64 = 0.012;

/// Picture of the first failed check that names its time; otherwise of the end of `outcome`.
/// Without a robot, a table of the last requests and replies.
pub fn of_failure(outcome: &Outcome) -> String {
    let mut out = String::new();
    let end = outcome.ran.as_secs_f64();
    let at = failed_at(outcome).unwrap_or(end).clamp(0.0, end);
    if !outcome.has_body {
        return last_exchanges(outcome, at);
    }
    write_moment(outcome, at, &mut out).expect("a string takes everything");
    out
}

/// Bounds of everything drawn, in x and y. The world may be empty, so the robot is included.
fn bounds(outcome: &Outcome, at: f64) -> [f64; 4] {
    let until = |time: Instant| time.as_secs_f64() <= at;
    let truth = outcome.truth.iter().filter(|(time, _)| until(*time));
    let truth = truth.map(|(_, pose)| *pose);
    let believed = outcome.pairs.iter().filter(|pair| until(pair.at));
    let poses = truth.chain(believed.map(|pair| pair.estimate));
    let reach = 1.3 * reach(&outcome.footprint);
    let robots = poses.flat_map(|pose| {
        let (x, y) = (pose.x, pose.y);
        [[x - reach, y - reach], [x + reach, y + reach]]
    });
    let waypoints = outcome.case.mission.waypoints_m.iter().copied();
    let [x0, y0, x1, y1] = outcome.scene.bounds;
    let world = [[x0, y0], [x1, y1]];
    let world = world.iter().filter(|_| !outcome.scene.shapes.is_empty());
    let places = robots.chain(waypoints).chain(world.copied());
    let wider = |all: Option<[f64; 4]>, [x, y]: [f64; 2]| {
        let [x0, y0, x1, y1] = all.unwrap_or([x, y, x, y]);
        Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)])
    };
    places.fold(None, wider).unwrap_or(outcome.scene.bounds)
}

fn write_moment(outcome: &Outcome, at: f64, out: &mut String) -> fmt::Result {
    let [x0, y0, x1, y1] = bounds(outcome, at);
    let side = (x1 - x0).max(y1 - y0).max(0.1);
    let margin = side * MARGIN;
    // The y axis of an SVG picture points down.
    let corner = [x0 - margin, -y1 - margin];
    let size = [x1 - x0 + 2.0 * margin, y1 - y0 + 2.0 * margin];
    let [x, y, width, height] = [corner[0], corner[1], size[0], size[1]].map(millimetres);
    write!(
        out,
        "<figure class=\"moment\"><svg viewBox=\"{x} {y} {width} {height}\" role=\"img\" \
         aria-label=\"the world {at:.1} s after the start, with the true and the estimated pose\">\
         <g transform=\"scale(1 -1)\"><g class=\"shape\">"
    )?;
    for shape in &outcome.scene.shapes {
        write_outline(shape, out)?;
    }
    out.write_str("</g><g class=\"waypoint\">")?;
    for [x, y] in &outcome.case.mission.waypoints_m {
        let radius = millimetres(side * DOT);
        write!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"/>")?;
    }
    out.write_str("</g>")?;
    let truth = outcome.truth.iter().copied();
    write_robot("truth", truth, at, &outcome.footprint, out)?;
    let believed = outcome.pairs.iter().map(|pair| (pair.at, pair.estimate));
    write_robot("belief", believed, at, &outcome.footprint, out)?;
    write!(
        out,
        "</g></svg><figcaption>{at:.1} s after the start: true pose and path solid, estimated \
         ones dashed</figcaption></figure>"
    )
}

/// Writes the path until `at`, seconds, and the robot at its end.
fn write_robot(
    class: &str,
    poses: impl Iterator<Item = (Instant, Pose)>,
    at: f64,
    footprint: &Outline,
    out: &mut String,
) -> fmt::Result {
    let way: Vec<Pose> = poses
        .take_while(|(time, _)| time.as_secs_f64() <= at)
        .map(|(_, pose)| pose)
        .collect();
    let Some(last) = way.last() else {
        return Ok(());
    };
    write!(out, "<g class=\"{class}\"><polyline points=\"")?;
    let step = way.len().div_ceil(WAY_MAX);
    for pose in way.iter().step_by(step).chain([last]) {
        write!(out, "{},{} ", millimetres(pose.x), millimetres(pose.y))?;
    }
    let degrees = (last.theta.to_degrees() * 10.0).round() / 10.0;
    write!(
        out,
        "\"/><g transform=\"translate({} {}) rotate({degrees})\">",
        millimetres(last.x),
        millimetres(last.y)
    )?;
    write_outline(footprint, out)?;
    let ahead = 1.3 * reach(footprint);
    write_outline(&Outline::Wall([0.0, 0.0, millimetres(ahead), 0.0]), out)?;
    out.write_str("</g></g>")
}

/// Distance from the robot's centre to its front edge, metres.
fn reach(footprint: &Outline) -> f64 {
    match footprint {
        Outline::Circle([_, _, radius]) => *radius,
        Outline::Polygon(flat) => flat.iter().step_by(2).copied().fold(0.0, f64::max),
        Outline::Wall([.., x, _]) => *x,
    }
}

fn write_outline(outline: &Outline, out: &mut String) -> fmt::Result {
    match outline {
        Outline::Wall([x0, y0, x1, y1]) => {
            write!(
                out,
                "<line x1=\"{x0}\" y1=\"{y0}\" x2=\"{x1}\" y2=\"{y1}\"/>"
            )
        }
        Outline::Polygon(flat) => {
            out.write_str("<polygon points=\"")?;
            for corner in flat.chunks_exact(2) {
                write!(out, "{},{} ", corner[0], corner[1])?;
            }
            out.write_str("\"/>")
        }
        Outline::Circle([x, y, radius]) => {
            write!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"/>")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::run::check::{Check, Status};

    /// A run of one second: the robot stands at 1.5 m, 1.2 m, facing along y, between a wall and a
    /// pillar. A check failed at 0.4 s.
    fn outcome() -> Outcome {
        let text = "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"1s\"\n\
             [mission]\nwaypoints_m = [[2.0, 2.5]]\n\
             [world]\nstart = { x_m = 1.5, y_m = 1.2, heading_deg = 90 }\n\
             wall = [{ path_m = [[0, 0], [3, 0]] }]\n\
             pillar = [{ at_m = [[0.5, 3.0]], radius_m = 0.1 }]\n";
        let mut outcome = engine::run::judge(text).expect("a sound scenario");
        outcome.checks = vec![Check {
            name: "collision".to_owned(),
            status: Status::Fail,
            detail: "at 0.400000".to_owned(),
        }];
        outcome
    }

    /// Bounds 0..3 by 0..3.1: the longer side is 3.1 m, its margin 0.093 m.
    #[test]
    fn the_world_is_drawn_in_metres_with_y_upwards() {
        let drawn = of_failure(&outcome());
        for part in [
            "viewBox=\"-0.093 -3.193 3.186 3.286\"",
            "<line x1=\"0\" y1=\"0\" x2=\"3\" y2=\"0\"/>",
            "<circle cx=\"0.5\" cy=\"3\" r=\"0.1\"/>",
            "<circle cx=\"2\" cy=\"2.5\" ",
            "translate(1.5 1.2) rotate(90)",
            "0.4 s after the start",
        ] {
            assert!(drawn.contains(part), "{part} in {drawn}");
        }
    }

    /// A shrunk world in which only the robot is left.
    #[test]
    fn a_robot_in_an_empty_world_is_in_the_picture() {
        let mut outcome = outcome();
        outcome.scene.shapes.clear();
        outcome.case.mission.waypoints_m.clear();
        outcome.truth = vec![(Instant::ZERO, Pose::new(10.0, 20.0, 0.0))];
        outcome.pairs.clear();
        outcome.footprint = Outline::Circle([0.0, 0.0, 1.0]);
        // 10 +- 1.3 and 20 +- 1.3, and a margin of 0.078.
        let drawn = of_failure(&outcome);
        assert!(
            drawn.contains("viewBox=\"8.622 -21.378 2.756 2.756\""),
            "{drawn}"
        );
    }

    /// A failure without a time shows the end of the run; the path then includes its last point.
    #[test]
    fn a_failure_without_a_time_is_shown_in_the_end() {
        let mut outcome = outcome();
        outcome.checks[0].detail = "never".to_owned();
        let last = outcome.truth.last().expect("it has a way").0;
        let moved = Pose::new(1.0, 0.5, 0.0);
        outcome.truth = vec![(Instant::ZERO, Pose::new(1.5, 1.2, 0.0)), (last, moved)];
        let drawn = of_failure(&outcome);
        assert!(drawn.contains("points=\"1.5,1.2 1,0.5 1,0.5 \""), "{drawn}");
        assert!(drawn.contains("1.0 s after the start"), "{drawn}");
    }
}
