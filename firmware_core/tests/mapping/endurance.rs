//! Minutes of rounds in the same direction (seed figure S5, field report F-01): does the map turn?

use core::f64::consts::FRAC_PI_2;

use firmware_core::slam::{Defects, Settings};

use crate::measure::{Run, Sense};
use crate::world::{World, flat};

/// Heading error at rest, in degrees, after minutes of rounds through the left room.
fn heading_error(settings: Settings, sense: Sense, minutes: u32) -> f32 {
    const ROUND: [[f64; 2]; 4] = [
        [450.0, 900.0],
        [450.0, 1900.0],
        [1250.0, 1900.0],
        [1250.0, 900.0],
    ];
    let world = World::new(flat(), [1000.0, 1000.0, FRAC_PI_2], 11);
    let mut run: Run = Run::new(world, settings);
    run.sense = sense;
    run.steps(10);
    let mut goals = ROUND.iter().cycle();
    let mut goal = ROUND[0];
    for _ in 0..minutes * 300 {
        if run.world.steer_to(goal) {
            goal = *goals.next().expect("endless");
        }
        run.step();
    }
    run.stop();
    run.world
        .truth()
        .change_to(run.pose())
        .turn
        .to_degrees()
        .abs()
}

/// The failure of the report after its 20 minutes of wall following. The weight is fixed at 10 of
/// 256, as fielded; there is no motion compensation, and the mapper is not synchronised with the
/// lidar's turn. Measured: 8.6, 10.8 and 15.5 degrees after 5, 10 and 20 minutes.
#[test]
fn without_the_cures_the_map_turns_by_ten_degrees_in_20_minutes() {
    let defects = Defects {
        constant_weight: true,
        ..Defects::FIELDED
    };
    let settings = Settings {
        defects,
        ..Settings::document()
    };
    let error = heading_error(settings, Sense::Unsynchronised, 20);
    assert!(error >= 10.0, "{error}");
}

/// The remedy is the mapping mode. Measured: 0.30 degrees over the same 20 minutes.
#[test]
fn the_cores_map_stays_for_20_minutes() {
    let error = heading_error(Settings::default(), Sense::Deskewed, 20);
    assert!(error <= 1.0, "{error}");
}

/// With constant weight and without motion compensation: 0.6, 2.8 and 3.5 degrees after 5, 10 and
/// 20 minutes; with both remedies 0.5 after 20.
#[test]
fn without_motion_compensation_the_map_turns() {
    let defects = Defects {
        constant_weight: true,
        ..Defects::default()
    };
    let settings = Settings {
        defects,
        ..Settings::document()
    };
    let error = heading_error(settings, Sense::Raw, 10);
    assert!(error > 1.5, "{error}");
}

#[test]
fn the_documents_map_stays_with_the_cures() {
    let error = heading_error(Settings::document(), Sense::Deskewed, 5);
    assert!(error <= 1.0, "{error}");
}
