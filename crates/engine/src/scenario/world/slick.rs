use emulators::world::{Bounds, Point, SlickFloor, SlickFloorError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use crate::scenario::{ScenarioError, Source};

/// A rectangle of floor with little grip: wheels that drive or brake too hard spin or slide there;
/// encoders count the rotation of the wheels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlickSpec {
    /// Lower left corner, metres.
    pub min_m: [f64; 2],
    /// Upper right corner, metres.
    pub max_m: [f64; 2],
    /// Maximum acceleration there as a share of gravity (9.81 m/s²), 0 to 1; wet ice has 0.05.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub grip: f64,
}

impl SlickSpec {
    fn build(&self) -> Result<SlickFloor, SlickFloorError> {
        let corner = |[x, y]: [f64; 2]| Point::new(x, y);
        let bounds = Bounds {
            min: corner(self.min_m),
            max: corner(self.max_m),
        };
        SlickFloor::new(bounds, self.grip)
    }
}

/// The slick areas in the world.
///
/// # Errors
/// If an area is invalid.
pub(super) fn build(
    specs: &[Spanned<SlickSpec>],
    source: &Source,
) -> Result<Vec<SlickFloor>, ScenarioError> {
    let place = |(index, spec): (usize, &Spanned<SlickSpec>)| {
        spec.get_ref().build().map_err(|error| {
            let key = format!("world.slick[{index}]");
            source.invalid(Some(spec.span()), key, error.to_string())
        })
    };
    specs.iter().enumerate().map(place).collect()
}
