//! The PC's map at the start, and its rule of localisation, as the scenario gives them.

use firmware_core::grid::{FREE, OBSTACLE, UNKNOWN};
use firmware_core::local_map::CELL_MM;
use firmware_core::map_view::MapView;
use firmware_core::robots::yellow::pc::{PcProgram, Votes};

use crate::scenario::plan::read_saved;
use crate::scenario::{Scenario, ScenarioError, Source, VotesSpec};

/// Deviation of a cell's edge that counts as equal, metres.
const SAME_M: f64 = 1e-6;

impl From<VotesSpec> for Votes {
    fn from(spec: VotesSpec) -> Self {
        match spec {
            VotesSpec::Best => Self::Best,
            VotesSpec::Added => Self::Added,
            VotesSpec::Multiplied => Self::Multiplied,
        }
    }
}

/// Loads the map of `[program] map`, if there is one.
///
/// # Errors
/// If the files cannot be read, or hold no map that the program can use.
pub(super) fn load(
    program: &mut PcProgram,
    scenario: &Scenario,
    source: &Source,
) -> Result<(), ScenarioError> {
    let Some(path) = &scenario.program.map else {
        return Ok(());
    };
    let wrong = |message: String| source.invalid(source.find("map"), "program.map", message);
    let map = read_saved(path).map_err(wrong)?;
    let path = path.display();
    let cell_m = f64::from(CELL_MM) / 1e3;
    if (map.resolution_m - cell_m).abs() > SAME_M {
        let found = map.resolution_m;
        return Err(wrong(format!(
            "{path} has cells of {found} m, expected {cell_m} m as in map.yaml of a run of yellow"
        )));
    }
    if !map.cells.contains(&Some(true)) || !map.cells.contains(&Some(false)) {
        return Err(wrong(format!(
            "{path} has no walls or no free cells, expected map.yaml of a run of yellow"
        )));
    }
    let cells = map.cells.iter().map(|cell| match cell {
        None => UNKNOWN,
        Some(true) => OBSTACLE,
        Some(false) => FREE,
    });
    let cells: Vec<u8> = cells.collect();
    #[expect(clippy::cast_possible_truncation, reason = "millimetres fit an f32")]
    let origin_mm = map.origin_m.map(|along| (along * 1e3) as f32);
    let view = MapView::new(map.width, CELL_MM, origin_mm, &cells);
    let loaded = program.load_map_with_walls(&view);
    loaded.map_err(|_| {
        wrong(format!(
            "{path} is too large, expected at most 102.4 m by 102.4 m"
        ))
    })
}
