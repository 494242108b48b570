//! Where missions that are made by chance take place.

use crate::robots::Arena;

/// A room of 2.4 m in the map of 3 m, without one corner.
pub(super) const ARENA: Arena = Arena {
    side_m: 3.0,
    wall_m: &[
        [0.3, 0.3],
        [2.7, 0.3],
        [2.7, 1.9],
        [1.9, 1.9],
        [1.9, 2.7],
        [0.3, 2.7],
        [0.3, 0.3],
    ],
    places_m: &[
        [0.8, 0.8],
        [1.5, 0.8],
        [2.2, 0.8],
        [0.8, 1.5],
        [1.5, 1.5],
        [2.2, 1.4],
        [0.8, 2.2],
        [1.4, 2.2],
    ],
    obstacle_mm: [25, 120],
};
