//! Estimated pose of the robot.

use core::time::Duration;

use emulators::world::{BodyConfig, Pose};
use firmware_core::slam::{Budget, Settings};

use super::lab::{Lab, flat, walls};
use crate::{Observation, Variant};
use engine::run::score::pose_error;

/// Two walls 2 m apart without visible ends: the robot drives 5 m with a lidar of 3 m range.
pub(super) fn f_03(variant: Variant) -> Observation {
    let settings = match variant {
        Variant::Defective => Settings {
            resolution_mm: 40.0,
            seed: 3,
            ..Settings::document()
        },
        Variant::Sound => Settings::core(40.0),
    };
    let corridor = [[0.0, 0.5, 12.0, 0.5], [0.0, 2.5, 12.0, 2.5]];
    let world = walls(
        &corridor,
        BodyConfig::default(),
        Pose::new(3.5, 1.5, 0.0),
        3,
    );
    let mut lab: Lab<300, 100> = Lab::new(world, settings);
    lab.reach_m = 3.0;
    lab.steps(10);
    while lab.world.pose().x < 8.5 {
        lab.steer_to([9.5, 1.5]);
        lab.step();
    }
    let x_mm = lab.world.pose().x * 1000.0;
    let along = |believed: f32| (f64::from(believed) - x_mm).abs();
    let [mapper, wheels] = [lab.mapper.pose().x_mm, lab.reckoned().x_mm].map(along);
    let mut seen = Observation::default();
    seen.figure("error along the corridor, mm", format!("{mapper:.0}"));
    seen.figure("by the wheels alone, mm", format!("{wheels:.0}"));
    // Two per cent of the distance.
    seen.judged(mapper > 100.0)
}

/// Waypoints through both rooms of the flat and back.
const TOUR: [[f64; 2]; 7] = [
    [0.95, 2.25],
    [2.10, 2.25],
    [2.05, 1.30],
    [2.05, 2.25],
    [0.95, 2.25],
    [1.00, 1.00],
    [0.80, 1.40],
];

pub(super) fn f_04(variant: Variant) -> Observation {
    let budgets = [
        (250, "pose error with 250 tries, mm RMS"),
        (1000, "with 1000 tries, mm RMS"),
        (4000, "with 4000 tries, mm RMS"),
    ];
    let mut seen = Observation::default();
    let mut least = f64::INFINITY;
    for (tries, name) in budgets {
        let settings = match variant {
            Variant::Defective => Settings {
                budget: Budget {
                    start: tries,
                    step_up: 0,
                    step_down: 0,
                    max: tries,
                    ..Budget::DOCUMENT
                },
                ..Settings::document()
            },
            Variant::Sound => Settings::default(),
        };
        let mut lab: Lab = Lab::new(flat(BodyConfig::default(), 4), settings);
        lab.steps(10);
        lab.rounds(&TOUR, 200);
        let rms = pose_error(&lab.pairs).map_or(0.0, |error| error.rms_mm);
        seen.figure(name, format!("{rms:.1}"));
        least = least.min(rms);
    }
    seen.judged(least > 8.0)
}

/// A mapper that trusts the odometry: its search has no tries.
fn no_search() -> Settings {
    Settings {
        budget: Budget {
            start: 0,
            max: 0,
            ..Budget::DOCUMENT
        },
        ..Settings::document()
    }
}

/// A person pushes a resting robot for a second; the check is six searches later.
pub(super) fn f_08(variant: Variant) -> Observation {
    let settings = match variant {
        Variant::Defective => no_search(),
        Variant::Sound => Settings::document(),
    };
    let mut lab: Lab = Lab::new(flat(BodyConfig::default(), 7), settings);
    lab.steps(50);
    lab.world.push(0.3, 0.25, 0.0, Duration::from_secs(1));
    lab.steps(5 + 6);
    let error = lab.off_mm(lab.mapper.pose());
    let mut seen = Observation::default();
    seen.figure("error six searches after a push, mm", format!("{error:.0}"));
    seen.judged(error > 50.0)
}

/// One side loses a third of its distance on the floor.
pub(super) fn f_11(variant: Variant) -> Observation {
    let body = BodyConfig {
        slip: [0.3, 0.0],
        ..BodyConfig::default()
    };
    let settings = match variant {
        Variant::Defective => no_search(),
        Variant::Sound => Settings::default(),
    };
    let mut lab: Lab = Lab::new(flat(body, 5), settings);
    lab.steps(10);
    lab.rounds(&TOUR, 150);
    let error = lab.off_mm(lab.mapper.pose());
    let mut seen = Observation::default();
    seen.figure("error after half a minute, mm", format!("{error:.0}"));
    seen.judged(error > 200.0)
}
