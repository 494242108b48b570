//! Drawing of a scan into the map.

use firmware_core::grid::UNKNOWN;
use firmware_core::pose::Point;

use super::{mapper, room, scan_of, settings};
use crate::{Observation, Variant};

/// A hundred scans of a robot that spins in an unknown room.
pub(super) fn sl_05(variant: Variant) -> Observation {
    let mut mapper = mapper(settings(variant, "SL-05"));
    let walls = room([1000.0, 1000.0]);
    (0..100).for_each(|_| mapper.draw(&walls, [-20, 20]));
    let cells = mapper.grid().rows().as_flattened();
    let drawn = cells.iter().filter(|&&cell| cell > UNKNOWN).count();
    let erased = cells.iter().filter(|&&cell| cell < UNKNOWN).count();
    let mut seen = Observation::default();
    seen.figure("cells drawn as wall in 20 s of spinning", drawn);
    seen.figure("cells erased", erased);
    seen.judged(drawn == 0 && erased > 0)
}

/// A wall that stays in view: 5000 scans with each weight.
pub(super) fn sl_06(variant: Variant) -> Observation {
    let ceilings: Vec<String> = (2..=10)
        .map(|weight| {
            let mut settings = settings(variant, "SL-06");
            (settings.weight, settings.weight_min) = (weight, 1);
            // Two cells wide: the wall is one cell of 255.
            settings.hole_mm = 20.0;
            let mut mapper = mapper(settings);
            let ahead = scan_of(&[Point::new(105.0, 5.0)]);
            (0..5000).for_each(|_| mapper.draw(&ahead, [0, 0]));
            mapper.grid().get(160, 150).unwrap_or(0).to_string()
        })
        .collect();
    let ceilings = ceilings.join(", ");
    let mut seen = Observation::default();
    seen.figure("wall after 5000 scans, weights 2 to 10", &ceilings);
    seen.judged(ceilings == "128, 170, 192, 204, 213, 219, 224, 227, 230")
}

pub(super) fn sl_12(variant: Variant) -> Observation {
    let mut mapper = mapper(settings(variant, "SL-12"));
    let ahead = scan_of(&[Point::new(105.0, 5.0)]);
    (0..50).for_each(|_| mapper.draw(&ahead, [0, 0]));
    let cell = mapper.grid().get(160, 150).unwrap_or(0);
    let mut seen = Observation::default();
    seen.figure("the wall's cell after 50 scans", cell);
    seen.judged(cell <= UNKNOWN)
}
