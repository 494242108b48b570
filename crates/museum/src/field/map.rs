//! Effects on the map.

use emulators::world::{BodyConfig, Pose};
use firmware_core::grid::UNKNOWN;
use firmware_core::slam::{Defects, Settings};

use super::lab::{Lab, Sense, flat, walls};
use crate::{Observation, Variant};

/// Waypoints of a round through the left room of the flat.
const ROUND: [[f64; 2]; 4] = [[0.75, 0.95], [0.75, 1.75], [1.2, 1.75], [1.2, 0.95]];

pub(super) fn f_01(variant: Variant) -> Observation {
    let (defects, sense) = match variant {
        Variant::Defective => (
            Defects {
                constant_weight: true,
                ..Defects::FIELDED
            },
            Sense::Unsynchronised,
        ),
        Variant::Sound => (Defects::NONE, Sense::Deskewed),
    };
    let settings = Settings {
        defects,
        ..Settings::document()
    };
    let mut lab: Lab = Lab::new(flat(BodyConfig::default(), 11), settings);
    lab.sense = sense;
    lab.steps(10);
    lab.rounds(&ROUND, 5 * 300);
    lab.drive([0.0; 2]);
    lab.steps(5);
    let error = lab.pairs.last().map_or(0.0, |pair| pair.error_deg());
    let mut seen = Observation::default();
    seen.figure(
        "the map has turned after 5 minutes, deg",
        format!("{error:.1}"),
    );
    seen.judged(error > 3.0)
}

/// One minute without driving.
pub(super) fn f_02(variant: Variant) -> Observation {
    let defects = match variant {
        Variant::Defective => Defects {
            truncating_rounding: true,
            weight_down_to_one: true,
            ..Defects::NONE
        },
        Variant::Sound => Defects::NONE,
    };
    let settings = Settings {
        defects,
        ..Settings::document()
    };
    let mut lab: Lab = Lab::new(flat(BodyConfig::default(), 2), settings);
    lab.drive([-20.0, 20.0]);
    // The wheels reach their speed before the first scan is drawn.
    lab.scan();
    lab.steps(300);
    let cells = lab.mapper.grid().rows().as_flattened();
    let drawn = cells.iter().filter(|&&cell| cell > UNKNOWN).count();
    let mut seen = Observation::default();
    seen.figure("cells drawn as wall in a minute of spinning", drawn);
    seen.judged(drawn == 0)
}

/// A drive at 0.3 m/s past a wall at 45 degrees on the right; a turn of the lidar begins and ends
/// in this direction. The figure is the spread of the wall's points in the scans, across the wall.
pub(super) fn f_07(variant: Variant) -> Observation {
    let body = BodyConfig {
        full_speed_m_s: 0.3,
        ..BodyConfig::default().ideal()
    };
    let start = Pose::new(0.0, 0.0, core::f64::consts::FRAC_PI_2);
    let world = walls(&[[0.1, -0.2, 2.3, 2.0]], body, start, 1);
    let mut lab: Lab = Lab::new(world, Settings::document());
    lab.sense = match variant {
        Variant::Defective => Sense::Raw,
        Variant::Sound => Sense::Deskewed,
    };
    lab.drive([26.5; 2]);
    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
    for turn in 0..20 {
        let scan = lab.scan();
        let pose = super::lab::believed(lab.world.pose());
        let near = scan
            .points()
            .iter()
            .filter(|point| point.x_mm.abs() < 300.0);
        for point in near.filter(|_| turn >= 5) {
            let place = pose.to_world(*point);
            // The wall is x - y = 300.
            let across = (place.x_mm - place.y_mm - 300.0) / core::f32::consts::SQRT_2;
            least = least.min(across);
            most = most.max(across);
        }
    }
    let cells = ((most - least) / 10.0).ceil();
    let mut seen = Observation::default();
    seen.figure("thickness of a wall, cells of 10 mm", format!("{cells:.0}"));
    seen.judged(cells >= 3.0)
}
