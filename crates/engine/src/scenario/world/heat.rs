use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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

/// A warm body, degrees Celsius.
pub(super) const fn body() -> f64 {
    37.0
}
