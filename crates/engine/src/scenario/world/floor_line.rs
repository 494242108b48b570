use emulators::world::{FloorLine, FloorLineError, Point};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use crate::scenario::{ScenarioError, Source};

/// A straight line on the floor for light sensors under a bumper. It is not an obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FloorLineSpec {
    /// One end of its middle, metres.
    pub from_m: [f64; 2],
    /// The other end, metres.
    pub to_m: [f64; 2],
    /// Its width, metres, 0.001 to 1; the width of a strip of tape if not given.
    #[serde(default = "tape")]
    #[schemars(range(min = 0.001, max = 1.0))]
    pub width_m: f64,
}

const fn tape() -> f64 {
    0.019
}

impl FloorLineSpec {
    fn build(&self) -> Result<FloorLine, FloorLineError> {
        let [from, to] = [self.from_m, self.to_m].map(|[x, y]| Point::new(x, y));
        FloorLine::new(from, to, self.width_m)
    }
}

/// The lines in the world.
///
/// # Errors
/// If a line is invalid.
pub(super) fn build(
    specs: &[Spanned<FloorLineSpec>],
    source: &Source,
) -> Result<Vec<FloorLine>, ScenarioError> {
    let line = |(index, spec): (usize, &Spanned<FloorLineSpec>)| {
        spec.get_ref().build().map_err(|error| {
            let key = format!("world.line[{index}]");
            source.invalid(Some(spec.span()), key, error.to_string())
        })
    };
    specs.iter().enumerate().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    fn built(line: &str) -> Result<emulators::world::World, ScenarioError> {
        let text = format!(
            "schema = 1\nname = \"t\"\nrobot = \"apollo13\"\nduration = \"1s\"\n\
             [world]\nstart = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n[[world.line]]\n{line}"
        );
        let (scenario, source) = Scenario::from_text(&text).expect("sound");
        scenario.world.build(1, None, &source)
    }

    /// Checks the extent of a line: 4 cm on either side of its middle, not beyond its ends.
    #[test]
    fn d1_a_line_is_where_the_scenario_says() {
        let line = "from_m = [2, 0]\nto_m = [2, 3]\nwidth_m = 0.08\n";
        let world = built(line).expect("it can be");
        let at = |x, y| world.scene().is_on_line(Point::new(x, y));
        assert_eq!([at(1.97, 1.0), at(2.03, 2.9)], [true; 2]);
        assert_eq!([at(1.95, 1.0), at(2.05, 1.0), at(2.0, 3.1)], [false; 3]);
    }

    #[test]
    fn a_line_that_is_too_wide_is_refused() {
        let refused = built("from_m = [2, 0]\nto_m = [2, 3]\nwidth_m = 2\n");
        let told = refused.map(drop).expect_err("refused").to_string();
        assert!(
            told.contains("world.line[0]") && told.contains("0.001"),
            "{told}"
        );
    }
}
