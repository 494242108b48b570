use emulators::world::HeatPlate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{WorldSpec, point};
use crate::scenario::{ScenarioError, Source};

/// A warm plate on a wall, as a line seen from above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeatSpec {
    /// One end, metres, at most 5 mm from the wall's surface.
    pub from_m: [f64; 2],
    /// The other end, metres.
    pub to_m: [f64; 2],
    /// Temperature, degrees Celsius, -50 to 150; all other surfaces have 22.
    #[schemars(range(min = -50.0, max = 150.0))]
    #[serde(default = "body")]
    pub temperature_c: f64,
}

/// Temperature of a warm body, degrees Celsius.
pub(super) const fn body() -> f64 {
    37.0
}

impl WorldSpec {
    /// The warm plates: those of the maze, then those of the file.
    pub(super) fn heat_plates(&self, source: &Source) -> Result<Vec<HeatPlate>, ScenarioError> {
        let maze = self.maze.iter().flat_map(|maze| maze.get_ref().victims());
        let maze = maze.map(|[from, to]| HeatPlate::new(point(from), point(to), body()));
        let own = self.heat.iter().enumerate().map(|(index, spec)| {
            let heat = spec.get_ref();
            let plate = HeatPlate::new(point(heat.from_m), point(heat.to_m), heat.temperature_c);
            plate.map_err(|error| {
                let key = format!("world.heat[{index}]");
                source.invalid(Some(spec.span()), key, error.to_string())
            })
        });
        let maze = maze.map(|plate| {
            plate.map_err(|error| source.invalid(None, "world.maze", error.to_string()))
        });
        maze.chain(own).collect()
    }
}
