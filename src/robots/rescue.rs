//! The rescue robot.
use super::{Actuators, Dut, PcEnd, Watch, Wired};
use crate::rig::Rig;
use crate::scenario::{Scenario, ScenarioError, Source};
use core::time::Duration;
use emulators::world::World;

/// What the checkers watch.
pub const WATCH: Watch = Watch {
    command_link: "base",
    silence_max: Duration::from_millis(1100),
};

pub(super) fn wire(
    _: &Scenario,
    _: &Source,
    _: World,
    _: Dut,
    _: PcEnd,
) -> Result<Wired, ScenarioError> {
    todo!()
}
pub(super) fn actuators(_: &Rig) -> Option<Actuators> {
    None
}
pub(super) fn map_received(_: &Rig) -> Option<bool> {
    None
}
