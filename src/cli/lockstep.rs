//! A program that runs in lockstep with the rig's time, in the place of the robot's own: firmware
//! on a simulated board, or a node program.

use std::collections::BTreeMap;

use clap::Args;
use nodes::{NodeDevice, NodePort, NodeSpec, Role};

use super::CliError;
use super::firmware::FirmwareArgs;
use crate::realtime::guest::files_named;
use crate::robots::{self, Dut, OpenEnd, PcEnd};
use crate::run::Run;
use crate::scenario::{Scenario, Source};
use crate::show::shell::quoted;

/// Name of the node of a program under test.
const NODE: &str = "program";

/// The program in lockstep.
#[derive(Debug, Args)]
pub(super) struct LockstepArgs {
    #[command(flatten)]
    pub(super) firmware: FirmwareArgs,
    /// Start this shell command as a node program in the place of the robot's own: it speaks the
    /// node protocol on its standard input and output (docs/nodes.md)
    #[arg(long, value_name = "CMD", help_heading = "Your program")]
    pub(super) node: Option<String>,
    /// Allow the node program to send and show nothing, or to fall silent; the run then proves
    /// little
    #[arg(long, requires = "node", help_heading = "Your program")]
    node_may_idle: bool,
}

impl LockstepArgs {
    /// Whether such a program replaces the robot's own.
    pub(super) const fn is_given(&self) -> bool {
        self.firmware.is_given() || self.node.is_some()
    }

    /// Rejects a second program under test, and for `command`, which makes many runs, one that
    /// cannot run in lockstep.
    pub(super) fn check(&self, command: &str, has_exec: bool) -> Result<(), CliError> {
        self.refuse_second(has_exec)?;
        match self.firmware.is_given() {
            true => self.firmware.refuse_real_time(command),
            false => Ok(()),
        }
    }

    /// Rejects a second program under test. The conflicts of `clap` cannot be used: they would
    /// switch off requirements of options, so options of `--exec` would be ignored.
    pub(super) fn refuse_second(&self, has_exec: bool) -> Result<(), CliError> {
        let mut given = self.names(has_exec);
        match (given.next(), given.next()) {
            (Some(first), Some(second)) => Err(CliError::Usage(format!(
                "{second}: {first} is given too, expected one program under test; remove one of \
                 them"
            ))),
            _ => Ok(()),
        }
    }

    /// The options that give a program under test.
    pub(super) fn names(&self, has_exec: bool) -> impl Iterator<Item = &'static str> {
        let given = [
            ("--exec", has_exec),
            ("--firmware", self.firmware.is_given()),
            ("--node", self.node.is_some()),
        ];
        let given = given.into_iter().filter(|(_, is_given)| *is_given);
        given.map(|(name, _)| name)
    }

    /// The same options as text, for a command line.
    pub(super) fn repeat(&self) -> String {
        let node = self.node.as_ref();
        let node = node.map_or(String::new(), |node| format!(" --node {}", quoted(node)));
        let may_idle = if self.node_may_idle {
            " --node-may-idle"
        } else {
            ""
        };
        self.firmware.repeat() + &node + may_idle
    }

    /// The files of the program and their hashes.
    pub(super) fn files(&self) -> BTreeMap<String, String> {
        match &self.node {
            Some(command) => files_named(command),
            None => files_named(&self.firmware.repeat()),
        }
    }

    /// A run of `scenario` with the program; `gdb`: the TCP port on which firmware waits for a
    /// debugger.
    pub(super) fn run(
        &self,
        scenario: Scenario,
        source: &Source,
        gdb: Option<u16>,
    ) -> Result<Run, CliError> {
        match &self.node {
            Some(command) => run_node(scenario, source, command, self.node_may_idle),
            None => self.firmware.run(scenario, source, gdb),
        }
    }
}

/// A run of `scenario` with the node program of `command` at all open ends.
fn run_node(
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
