//! The whole program, in its rig or on the bench.

use core::time::Duration;
use std::path::Path;

use emulators::Device;
use emulators::pc::{Action, Pc, Script};
use emulators::world::{Point, Pose};
use protocols::{Instant, LineEvent};

use crate::client::properties;
use crate::mapper::search::{FIELDED, after_blackout};
use crate::pc::sender::rows_arriving;
use crate::{Observation, Variant};
use engine::robots::rescue::pc_program::fielded::Client;
use engine::run::{Outcome, Run};
use engine::scenario::Scenario;

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

/// An L-shaped room, so that left and right differ; the robot stands still.
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

/// Time of the search before and after a minute without beams.
pub(super) fn f_09(variant: Variant) -> Observation {
    let settings = crate::mapper::settings(variant, "SL-04");
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

/// Share, in percent, of a circle of 0.5 m around the pillar that the robot approached to within
/// 0.25 m.
fn visited(way: &[(Instant, Pose)], middle: Point) -> usize {
    const PLACES: u16 = 36;
    let places = (0..PLACES).map(|place| {
        let angle = f64::from(place) * core::f64::consts::TAU / f64::from(PLACES);
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        Point::new(middle.x + 0.5 * cos, middle.y + 0.5 * sin)
    });
    let came = |place: &Point| {
        let mut poses = way.iter().map(|(_, pose)| pose.point());
        poses.any(|point| point.distance(*place) <= 0.25)
    };
    places.filter(came).count() * 100 / usize::from(PLACES)
}

/// Both variants explore for 40 s, which is one round; then the PC of the sound variant sends a
/// list.
pub(super) fn f_10(variant: Variant) -> Observation {
    let list = match variant {
        Variant::Defective => "",
        Variant::Sound => {
            "[[mission.step]]\nat = \"40s\"\ndo = { waypoints-m = \
             [[1.0, 1.5], [1.5, 2.0], [2.0, 1.5], [1.5, 1.0], [1.0, 1.5]] }\n\
             [[mission.step]]\nat = \"41s\"\ndo = { mode = \"waypoint\" }\n"
        }
    };
    let outcome = run(
        format!(
            "schema = 1\nname = \"f-10\"\nrobot = \"rescue\"\nduration = \"120s\"\n\
             [program]\nstart_mode = \"exploration\"\n{list}[world]\n\
             start = {{ x_m = 0.5, y_m = 0.5, heading_deg = 90 }}\n[[world.wall]]\n\
             path_m = [[0.1, 0.1], [2.9, 0.1], [2.9, 2.9], [0.1, 2.9], [0.1, 0.1]]\n\
             [[world.pillar]]\nat_m = [[1.5, 1.5]]\nradius_m = 0.1\n"
        ),
        Duration::from_secs(100),
    );
    let visited = visited(&outcome.truth, Point::new(1.5, 1.5));
    let mut seen = Observation::default();
    seen.figure(
        "visited around the free-standing obstacle, per cent",
        visited,
    );
    seen.judged(visited < 95)
}

/// The PC program at its port: the fielded one or ours.
enum Desk {
    Fielded(Client),
    Sound(Box<Pc>),
}

impl Desk {
    fn new(variant: Variant) -> Self {
        match variant {
            Variant::Defective => Self::Fielded(Client::default()),
            Variant::Sound => {
                let mut pc = Pc::new(Script::default());
                let opened = pc.perform(Instant::ZERO, Action::Open);
                opened.expect("no limit is touched");
                Self::Sound(Box::new(pc))
            }
        }
    }

    /// Advances time; returns whether the program requests a connection.
    fn calls(&mut self, now: Instant) -> bool {
        match self {
            Self::Fielded(_) => now == Instant::ZERO,
            Self::Sound(pc) => {
                pc.tick(now);
                pc.line_change(Pc::AIR) == Some(LineEvent::Opened)
            }
        }
    }

    fn told(&mut self, now: Instant, event: LineEvent) {
        match self {
            Self::Fielded(client) if event == LineEvent::Closed => client.closed_by_far_end(),
            Self::Fielded(_) => {}
            Self::Sound(pc) => pc.line_event(Pc::AIR, now, event),
        }
    }

    fn hears(&mut self, now: Instant, bytes: &[u8]) {
        match self {
            Self::Fielded(client) => client.receive(bytes),
            Self::Sound(pc) => pc.receive(Pc::AIR, now, bytes),
        }
    }

    /// The x coordinate of the displayed pose.
    fn shown_x_mm(&self) -> Option<i32> {
        match self {
            Self::Fielded(client) => client.pose().map(|[x, _, _]| x),
            Self::Sound(pc) => {
                let (_, map) = pc.record().map_properties?;
                Some(i32::from(map.position_mm[0]))
            }
        }
    }
}

/// The robot sends its pose every 50 ms. The radio is absent from 1 s to 30.25 s.
pub(super) fn f_12(variant: Variant) -> Observation {
    let mut desk = Desk::new(variant);
    let [away, back] = [1_000, 30_250].map(Instant::from_millis);
    let (mut is_connected, mut before, mut after) = (false, None, None);
    for (ms, x_mm) in (0..60_000).zip((0..600).flat_map(|second| [second; 100])) {
        let now = Instant::from_millis(ms);
        let is_near = now < away || now >= back;
        if desk.calls(now) || (is_connected && !is_near) {
            is_connected = is_near;
            let event = if is_near {
                LineEvent::Opened
            } else {
                LineEvent::Closed
            };
            desk.told(now, event);
        }
        if is_connected && ms % 50 == 0 {
            let pose = properties(10, [3_000, 3_000], [x_mm, 0], 90);
            desk.hears(now, &pose);
        }
        let is_true = desk.shown_x_mm() == Some(i32::from(x_mm));
        if is_true && now < away {
            before.get_or_insert(now);
        }
        if is_true && now >= back {
            after = Some(now - back);
            break;
        }
    }
    let mut seen = Observation::default();
    seen.figure("a pose is shown before", before.is_some());
    let told = after.map_or("never".to_owned(), |after| format!("{}", after.as_millis()));
    seen.figure("the pose shown is true again after, ms", told);
    seen.judged(before.is_some() && after.is_none_or(|after| after > Duration::from_secs(2)))
}
