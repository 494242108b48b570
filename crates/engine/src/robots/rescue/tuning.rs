//! Values of a scenario that replace the program's own.

use firmware_core::navigation::{WallFollowing, WallLaw};
use firmware_core::robots::rescue::{Config, Infrared, Smear};
use firmware_core::slam::{Budget, Fading};

use crate::scenario::tuning::{FadingSpec, TuningSpec, WallsSpec};

/// Applies the values.
pub(super) fn tune(config: &mut Config, tuning: &TuningSpec) {
    let mapping = &mut config.mapping;
    if let Some(points) = tuning.points {
        mapping.search.points = points;
    }
    if let Some(tries) = tuning.tries {
        mapping.budget = Budget {
            start: tries,
            max: tries,
            step_up: 0,
            step_down: 0,
            ..mapping.budget
        };
    }
    if let Some(hole_mm) = tuning.hole_mm {
        mapping.hole_mm = hole_mm.into();
    }
    if let Some(weight) = tuning.weight {
        mapping.weight = weight;
    }
    match tuning.fading {
        None | Some(FadingSpec::Linear) => {}
        Some(FadingSpec::None) => mapping.defects.constant_weight = true,
        Some(FadingSpec::Quadratic) => mapping.fading = Fading::Quadratic,
    }
    if tuning.smear {
        config.smear = Smear::Kept;
    }
    if tuning.infrared {
        config.infrared = Infrared::Read;
    }
    let body = &mut config.navigation.body;
    if let Some(radius_mm) = tuning.radius_mm {
        body.radius_mm = radius_mm.into();
    }
    if let Some(clearance_mm) = tuning.clearance_mm {
        body.clearance_mm = clearance_mm.into();
    }
    match tuning.walls {
        None => {}
        Some(WallsSpec::Nearest) => config.navigation.wall.law = WallLaw::Nearest,
        Some(WallsSpec::Beam) => config.navigation.wall = WallFollowing::DOCUMENT,
    }
}
