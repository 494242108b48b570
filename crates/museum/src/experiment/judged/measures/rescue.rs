//! Measures of the rescue robot.

mod drives;
mod filter;
mod link;
mod mapping;
mod radio;
mod search;

pub(super) use drives::{STRAIGHT, WINDING};
pub(super) use filter::{FILTER, PUSH, RAMP};
pub(super) use link::{BYTES, LARGE, LIDAR, ODOMETER, RANGE, SMEAR};
pub(super) use mapping::{CORRIDOR, MISSION, PEOPLE, TURNING};
pub(super) use radio::{BUILDING, RADIO, TRANSFER};
pub(super) use search::{POINTS, REGULATOR, SEARCH_TIME, SEARCH_TIME_360, TRIES, WEIGHTS};

use engine::scenario::{MapperSpec, Scenario, TuningSpec};

/// Weight of a map update of the report's mapper, of 256: 10, on the report's scale of 0 to 100
/// (page 16).
const WEIGHT: u16 = 26;

/// Gives the robot the report's mapper with `tuning`.
fn as_reported(scenario: &mut Scenario, tuning: TuningSpec) {
    let tuning = TuningSpec {
        weight: tuning.weight.or(Some(WEIGHT)),
        ..tuning
    };
    scenario.program.mapper = MapperSpec::Document;
    scenario.program.tuning = Some(toml::Spanned::new(0..0, tuning));
}
