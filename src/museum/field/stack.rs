//! The whole program, in its rig or on the bench.

use core::time::Duration;
use std::path::Path;

use emulators::Device;
use emulators::pc::{Action, Connection, Patience, Pc, Script};
use emulators::world::{Point, Pose};
use protocols::{Instant, LineEvent};

use crate::museum::mapper::search::{FIELDED, after_blackout};
use crate::museum::pc::sender::rows_arriving;
use crate::museum::{Observation, Variant};
use crate::run::{Outcome, Run};
use crate::scenario::Scenario;

pub(super) fn f_05(variant: Variant) -> Observation {
    let (mut robot, [sent, whole]) = rows_arriving(variant, Duration::from_secs(20));
    let per_mille = whole * 1000 / sent.max(1);
    let told = format!("{}.{}", per_mille / 10, per_mille % 10);
    robot.seen.figure("rows that arrive whole, per cent", told);
    robot.judged(per_mille < 999)
}

/// A run of `text` for `time`.
fn run(text: String, time: Duration) -> Outcome {
    let (scenario, source) =
        Scenario::parse(Path::new("museum"), text).expect("exhibits are sound scenarios");
    let mut run = Run::new(scenario, &source, None).expect("exhibits can be wired");
    run.go_on_until(Instant::ZERO + time);
    run.judge()
}

/// An L, so that left and right differ; the robot stands.
pub(super) fn f_06(variant: Variant) -> Observation {
    let direction = match variant {
        Variant::Defective => "clockwise",
        Variant::Sound => "counter-clockwise",
    };
    let outcome = run(
        format!(
            "schema = 1\nname = \"f-06\"\nrobot = \"rescue\"\nduration = \"20s\"\n\
             [device.lidar.xv11]\ndirection = \"{direction}\"\n[world]\n\
             start = {{ x_m = 0.7, y_m = 0.9, heading_deg = 90 }}\n[[world.wall]]\n\
             path_m = [[0.2, 0.2], [2.8, 0.2], [2.8, 1.2], [1.3, 1.2], [1.3, 2.7], [0.2, 2.7], \
             [0.2, 0.2]]\n"
        ),
        Duration::from_secs(8),
    );
    let right = outcome.wall_overlap.map_or(0.0, |walls| walls.right);
    let mut seen = Observation::default();
    seen.figure(
        "walls of the map that are true, per cent",
        format!("{:.0}", right * 100.0),
    );
    seen.judged(right < 0.7)
}

/// The search's time before and after a minute without beams.
pub(super) fn f_09(variant: Variant) -> Observation {
    let settings = crate::museum::mapper::settings(variant, "SL-04");
    let settings = firmware_core::slam::Settings {
        budget: FIELDED,
        ..settings
    };
    let mut seen = Observation::default();
    let [before, _] = after_blackout(settings, Duration::ZERO);
    let [after, _] = after_blackout(settings, Duration::from_secs(60));
    seen.figure("a scan's work, ms", before.as_millis());
    seen.figure("after a minute without beams, ms", after.as_millis());
    seen.judged(after > Duration::from_millis(500))
}

/// Nearest that the robot came to the block in the middle.
fn nearest(way: &[(Instant, Pose)], block: Point) -> f64 {
    let from = |(_, pose): &(Instant, Pose)| pose.point().distance(block);
    way.iter().map(from).fold(f64::INFINITY, f64::min)
}

pub(super) fn f_10(variant: Variant) -> Observation {
    let task = match variant {
        Variant::Defective => "[program]\nstart_mode = \"exploration\"\n",
        Variant::Sound => "[mission]\nwaypoints_m = [[1.0, 1.5], [1.5, 2.0], [2.0, 1.5]]\n",
    };
    let outcome = run(
        format!(
            "schema = 1\nname = \"f-10\"\nrobot = \"rescue\"\nduration = \"60s\"\n{task}[world]\n\
             start = {{ x_m = 0.5, y_m = 0.5, heading_deg = 90 }}\n[[world.wall]]\n\
             path_m = [[0.1, 0.1], [2.9, 0.1], [2.9, 2.9], [0.1, 2.9], [0.1, 0.1]]\n\
             [[world.pillar]]\nat_m = [[1.5, 1.5]]\nradius_m = 0.1\n"
        ),
        Duration::from_secs(40),
    );
    let distance = nearest(&outcome.truth, Point::new(1.5, 1.5));
    let mut seen = Observation::default();
    seen.figure("nearest to what stands free, m", format!("{distance:.2}"));
    seen.judged(distance > 0.6)
}

/// The radio is away from 1 s to 30.25 s.
pub(super) fn f_12(variant: Variant) -> Observation {
    let patience = match variant {
        Variant::Defective => Patience {
            reopen: None,
            ..Patience::default()
        },
        Variant::Sound => Patience::default(),
    };
    let mut pc = Pc::with_patience(Script::default(), patience);
    let opened = pc.perform(Instant::ZERO, Action::Open);
    opened.expect("no limit is touched");
    pc.line_event(Pc::AIR, Instant::ZERO, LineEvent::Opened);
    let [away, back] = [1_000, 30_250].map(Instant::from_millis);
    let mut heard = None;
    for ms in 0..60_000 {
        let now = Instant::from_millis(ms);
        pc.tick(now);
        let wants = pc.line_change(Pc::AIR) == Some(LineEvent::Opened);
        if now == away || (wants && now > away && now < back) {
            pc.line_event(Pc::AIR, now, LineEvent::Closed);
        } else if wants {
            pc.line_event(Pc::AIR, now, LineEvent::Opened);
        }
        if now >= back && matches!(pc.connection(), Connection::Connected(_)) {
            heard = Some(now - back);
            break;
        }
    }
    let mut seen = Observation::default();
    let told = heard.map_or("never".to_owned(), |after| format!("{}", after.as_millis()));
    seen.figure("connected again after the radio is back, ms", told);
    seen.judged(heard.is_none_or(|after| after > Duration::from_secs(2)))
}
