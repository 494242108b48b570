//! The robot's own touch display, which is optional in a scenario.

use firmware_core::robots::rescue::{Display, Rescue};

use super::line_of;
use crate::rig::line::End;
use crate::robots::Wired;
use crate::scenario::{Scenario, ScenarioError, Source};

/// Name of the device, and of its link.
pub(super) const NAME: &str = "display";

/// Whether the robot has a display.
pub(super) fn has_one(scenario: &Scenario) -> bool {
    scenario.device.contains_key(NAME)
}

/// The display of the program.
pub(super) fn fitted(scenario: &Scenario) -> Display {
    if has_one(scenario) {
        Display::Touch
    } else {
        Display::None
    }
}

/// Adds the display, if there is one.
pub(super) fn connect(
    wired: &mut Wired,
    scenario: &Scenario,
    source: &Source,
    program: Option<usize>,
) -> Result<(), ScenarioError> {
    let Some(spec) = scenario.device.get(NAME) else {
        return Ok(());
    };
    let built = spec.build(NAME, scenario.seed, source)?;
    let info = built.ports[0];
    let node = wired.rig.add_boxed_device(NAME, built.device);
    let device = End {
        node,
        port: info.port,
    };
    let port = Rescue::DISPLAY;
    let master = match program {
        Some(node) => End { node, port },
        None => wired.open_end(NAME, line_of(port), info.connect),
    };
    wired.set_optional(master, true);
    let rig = &mut wired.rig;
    rig.connect_by(info.kind, NAME, device, master, info.piece);
    Ok(())
}
