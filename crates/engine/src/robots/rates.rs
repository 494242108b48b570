//! Faults of a wrong rate that is the rate of their line.

use super::wiring::stand_in;
use super::{Dut, PcEnd, Robot, WirePlan, wire_without_start};
use crate::scenario::{FaultKind, Scenario, ScenarioError, Source};

/// Warnings for wrong rates that change nothing, as long as no device changes its own rate.
pub(super) fn warnings(
    robot: &dyn Robot,
    scenario: &Scenario,
    source: &Source,
) -> Vec<ScenarioError> {
    let faults = scenario.fault.iter().enumerate();
    let wrong: Vec<_> = faults
        .filter(|(_, fault)| fault.kind == FaultKind::WrongBaud && fault.baud.is_some())
        .collect();
    if wrong.is_empty() {
        return Vec::new();
    }
    let Some(world) = stand_in(robot, scenario, source) else {
        return Vec::new();
    };
    let wired = wire_without_start(WirePlan {
        scenario,
        source,
        world,
        dut: Dut::External,
        pc: PcEnd::External,
    });
    // The run reports the errors of the wiring.
    let Ok(wired) = wired else {
        return Vec::new();
    };
    let warning = |(index, fault): (usize, &crate::scenario::FaultSpec)| {
        let link = wired.rig.link(fault.link.as_deref()?)?;
        let line = link.line(fault.direction?.into());
        let [sender, receiver] = wired.rig.line_configs(line);
        if !fault.is_at_rate(sender.baud) || sender.baud != receiver.baud {
            return None;
        }
        let span = source.find_in_list("fault", index, "baud");
        let message = format!(
            "has no effect: {} is the rate of the line, expected another one",
            sender.baud
        );
        Some(source.invalid(span, format!("fault[{index}].baud"), message))
    };
    wrong.into_iter().filter_map(warning).collect()
}
