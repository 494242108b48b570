//! Wheels and odometry.

use firmware_core::navigation::HALT;
use firmware_core::odometry::fielded::change;
use firmware_core::pc_link::{PcLink, View};
use firmware_core::pose::{Pose, PoseChange, WirePose};
use firmware_core::scan::Scan;
use protocols::pcui::diagnosis::{Diagnosis, Readings, Text};
use protocols::pcui::message::{Message, Mode, State};
use protocols::{Decode, Instant, pcui};

use super::{mapper, settings};
use crate::pc::waypoints;
use crate::robot::config;
use crate::{Observation, Variant};

/// Pose of a robot that started at the origin with heading `psi_deg`, after its wheels turned by
/// `ticks`.
fn moved(variant: Variant, id: &str, psi_deg: i16, ticks: [i32; 2]) -> Pose {
    let config = config(variant, id);
    let start = Pose::from_wire(WirePose {
        x_mm: 0,
        y_mm: 0,
        psi_deg,
    });
    let psi = f32::from(psi_deg);
    start.then(change(&config.wheels, config.defects.odometry, psi, ticks))
}

/// At psi 90 the robot faces +y. A tick is 0.45379 mm.
pub(super) fn sl_07(variant: Variant) -> Observation {
    let pose = moved(variant, "SL-07", 90, [-100, -100]);
    let mut seen = Observation::default();
    seen.figure(
        "y after 100 ticks backwards, mm",
        format!("{:+.1}", pose.y_mm),
    );
    seen.judged(pose.y_mm > 0.0)
}

pub(super) fn sl_08(variant: Variant) -> Observation {
    let pose = moved(variant, "SL-08", 720, [100, 99]);
    let way = libm::hypotf(pose.x_mm, pose.y_mm);
    let mut seen = Observation::default();
    seen.figure(
        "distance of 100 and 99 ticks at psi 720, mm",
        format!("{way:.2}"),
    );
    seen.judged(way < 1.0)
}

pub(super) fn sl_09(variant: Variant) -> Observation {
    let pose = moved(variant, "SL-09", 90, [100, 50]);
    let mut seen = Observation::default();
    seen.figure("x after 100 and 50 ticks, mm", format!("{:+.2}", pose.x_mm));
    seen.judged(pose.x_mm < 0.0)
}

/// An eighth of a turn each 50 ms, clockwise, the direction in which psi increases.
pub(super) fn sl_13(variant: Variant) -> Observation {
    let config = config(variant, "SL-13");
    let mut link = PcLink::new(config.pc_link);
    let (map, list) = (mapper(config.mapping), waypoints(variant, "SL-13"));
    let mut decoder = pcui::Decoder::default();
    let mut seen = Observation::default();
    let mut told = 0;
    for step in 0..92 * 8_u16 {
        let psi_deg = 90 + i32::from(step) * 45;
        let view = View {
            map: map.grid(),
            pose: Pose::new(
                1000.0,
                1000.0,
                core::f32::consts::PI - (psi_deg as f32).to_radians(),
            ),
            state: State {
                mode: Mode::Manual,
                speed: HALT,
                speed_mm_s: [0; 2],
                set_point: HALT,
            },
            waypoints: &list,
            diagnosis: Diagnosis::default(),
            victims: &[],
            readings: Readings::NONE,
            message: Text::default(),
        };
        link.tick(Instant::from_millis(50 * u64::from(step)), &view);
        let mut buf = [0; 4096];
        let len = link.transmit(&mut buf);
        for frame in decoder.push(&buf[..len]).flatten() {
            if let Ok(Message::Map(properties)) = frame.message() {
                told = properties.psi_deg;
                if step == 92 * 8 - 1 {
                    seen.bytes("robot", &engine::codec::PCUI, frame.as_bytes());
                }
            }
        }
    }
    seen.figure("psi sent after 92 turns, deg", told);
    seen.judged(told < 0)
}

/// Half a metre of driving while nothing is drawn.
pub(super) fn sl_14(variant: Variant) -> Observation {
    let settings = settings(variant, "SL-14");
    let mut mapper = mapper(settings);
    let step = PoseChange {
        forward_mm: 50.0,
        ..PoseChange::NONE
    };
    for _ in 0..10 {
        mapper.predict(step);
        mapper.locate(&Scan::EMPTY);
    }
    let before = mapper.pose();
    mapper.integrate(&Scan::EMPTY, [0, 0]);
    let jump = before.change_to(mapper.pose()).distance_mm();
    let mut seen = Observation::default();
    let way = settings.start.change_to(before).distance_mm();
    seen.figure(
        "distance believed while mapping is off, mm",
        format!("{way:.0}"),
    );
    seen.figure(
        "jump of the pose when it is switched on, mm",
        format!("{jump:.0}"),
    );
    seen.judged(jump > 400.0)
}
