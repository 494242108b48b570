//! The robot's own touch display, which a scenario may give it.

use emulators::touch_panel::{self, Tap, TouchPanel};
use firmware_core::robots::rescue::{Display, Rescue};

use super::line_of;
use crate::rig::line::End;
use crate::robots::Wired;
use crate::scenario::{DeviceSpec, Scenario, ScenarioError, Source, TapSpec};

/// Name of the device, and of its link.
pub(super) const NAME: &str = "display";

/// Whether the robot has one.
pub(super) fn has_one(scenario: &Scenario) -> bool {
    scenario.device.contains_key(NAME)
}

/// What the program has to draw on.
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
    let Some(DeviceSpec::TouchPanel(spec)) = scenario.device.get(NAME) else {
        return Ok(());
    };
    let outside = spec.tap.iter().find(|tap| {
        let [x, y] = tap.place.map(usize::from);
        x >= touch_panel::WIDTH || y >= touch_panel::HEIGHT
    });
    if let Some(TapSpec { place: [x, y], .. }) = outside {
        let (width, height) = (touch_panel::WIDTH, touch_panel::HEIGHT);
        let message = format!("is {x}, {y}, expected a place on {width} x {height} pixels");
        let key = "device.display.touch-panel.tap";
        return Err(source.invalid(source.find("place"), key, message));
    }
    let taps = spec.tap.iter().map(|tap| Tap {
        at: tap.at.instant(),
        place: tap.place,
    });
    let node = wired.rig.add_device(NAME, TouchPanel::new(taps.collect()));
    let device = End {
        node,
        port: TouchPanel::UART,
    };
    let port = Rescue::DISPLAY;
    let master = match program {
        Some(node) => End { node, port },
        None => wired.open_end(NAME, line_of(port), "the robot's display, optional"),
    };
    wired.rig.connect(NAME, device, master, 64);
    Ok(())
}
