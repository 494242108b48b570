//! Localisation of the car on its map by guesses.

use super::{CAMERA_AHEAD_M, Config};
use crate::ackermann::CarPose;
use crate::particles::{LikelihoodField, Localiser, Noise, Settings as ParticleSettings};

/// Noise of the odometry: a fifth of its motion. With the seed's figures, ten times as much, the
/// guesses spread over the hall while the camera looks at a box that is on no map.
const NOISE: Noise = Noise {
    turn_by_turn: 0.04,
    turn_by_way: 0.04,
    way_by_way: 0.04,
    way_by_turn: 0.04,
};

/// Guesses around `start` on the car's map.
pub(super) fn localiser(config: &Config, start: CarPose) -> Localiser {
    let floor = &config.floor;
    let field = LikelihoodField::new(
        floor.width,
        floor.cell_m,
        floor.origin_m,
        &floor.obstacles,
        2.0,
    );
    let camera = CarPose::default().shifted(CAMERA_AHEAD_M);
    let sigma = [0.05, 0.05, 0.02];
    let settings = ParticleSettings {
        noise: NOISE,
        ..ParticleSettings::default()
    };
    Localiser::new(field, settings, camera, start, sigma, config.seed)
}
