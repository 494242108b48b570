//! `--node`: a node program instead of the robot's program.

use nodes::{NodeDevice, NodePort, NodeSpec, Role};

use super::super::CliError;
use crate::robots::{self, Dut, OpenEnd, PcEnd};
use crate::run::Run;
use crate::scenario::{Scenario, Source};

/// Name of the node of a program under test.
const NODE: &str = "program";

/// A run of `scenario` with the node program of `command` at all open ends.
pub(super) fn run(
    scenario: Scenario,
    source: &Source,
    command: &str,
    may_idle: bool,
) -> Result<Run, CliError> {
    // Wired as for a native program: the run differs only in the program.
    let mut wired = robots::wire(&scenario, source, Dut::External, PcEnd::Scripted)?;
    let ends = core::mem::take(&mut wired.open_ends);
    let port = |end: &OpenEnd| NodePort {
        name: end.name.clone(),
        line: end.line,
        carries_messages: wired
            .rig
            .link(&end.link)
            .is_some_and(|link| link.kind.carries_messages()),
    };
    let spec = NodeSpec {
        role: Role::Program,
        may_idle,
        seed: scenario.seed,
        ports: ends.iter().map(port).collect(),
        ..NodeSpec::new(NODE, command)
    };
    let places: Vec<usize> = ends.iter().map(|end| end.node).collect();
    let program = Box::new(NodeDevice::new(spec));
    wired.rig.seat(NODE, program, &places);
    Ok(Run::with_rig(scenario, wired.rig, wired.instruments))
}
