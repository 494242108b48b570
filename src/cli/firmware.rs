//! `--firmware`: an ELF file on a simulated board instead of the robot's program.

mod qemu;

use core::time::Duration;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use boards::{Board, Machine, PortKind, Tier};
use clap::Args;
use nodes::{NodeDevice, NodePort, Role};
use serde_json::Value;

use super::CliError;
use crate::realtime::exec::{Foreign, pc_end};
use crate::rig::LinkKind;
use crate::robots::{self, Dut, OpenEnd, PcEnd, Wired};
use crate::run::Run;
use crate::scenario::device::firmware::node_of;
use crate::scenario::{Scenario, Source};
use crate::show::shell::quoted;

/// Name of the node; its output is in `node-program.log`.
const NODE: &str = "program";
/// Timeout while gdb may stop the program.
const HELD_MAX: Duration = Duration::from_secs(30 * 24 * 3_600);

/// Firmware as the program under test.
#[derive(Debug, Args)]
#[command(next_help_heading = "Firmware without a board")]
pub(super) struct FirmwareArgs {
    /// Run this ELF file on a simulated board instead of the robot's program
    #[arg(long, value_name = "ELF", requires = "board")]
    firmware: Option<PathBuf>,
    /// Board of the firmware: arduino-uno, arduino-mega, leonardo, mighty-1284p (unmodified AVR
    /// firmware), cortex-m4 (firmware linked with nodes/cortex-m4), mps2-an386, netduinoplus2
    /// (unmodified Cortex-M4 firmware in real time), or a file that ends with .toml
    #[arg(long, value_name = "NAME", requires = "firmware")]
    board: Option<String>,
    /// Connect a port of the rig to one of the board, e.g. gps=serial1; may be given several times
    #[arg(long, value_name = "PORT=NAME", requires = "firmware")]
    wire: Vec<String>,
    /// Allow the firmware to send nothing or to fall silent, e.g. if it only reads; the run then
    /// proves little
    #[arg(long, requires = "firmware")]
    firmware_may_idle: bool,
    /// Allow the watchdog of an AVR board to reset the firmware, e.g. if it restarts on purpose
    #[arg(long, requires = "firmware")]
    firmware_may_reset: bool,
}

impl FirmwareArgs {
    /// Whether firmware replaces the program.
    pub(super) const fn is_given(&self) -> bool {
        self.firmware.is_some()
    }

    /// The same options as text, for a command line.
    pub(super) fn repeat(&self) -> String {
        let (Some(elf), Some(board)) = (&self.firmware, &self.board) else {
            return String::new();
        };
        let wires = self.wire.iter();
        let wires = wires.map(|wire| format!(" --wire {}", quoted(wire)));
        let elf = quoted(&elf.display().to_string());
        let board = quoted(board);
        let allowed = [
            (self.firmware_may_idle, " --firmware-may-idle"),
            (self.firmware_may_reset, " --firmware-may-reset"),
        ];
        let allowed = allowed.iter().filter(|(is_given, _)| *is_given);
        let allowed: String = allowed.map(|(_, option)| *option).collect();
        let wires = wires.collect::<String>();
        format!(" --firmware {elf} --board {board}{wires}{allowed}")
    }

    /// Firmware that runs in real time, as a program at the ports of `scenario`; `None`: it runs in
    /// lockstep.
    pub(super) fn foreign(
        &self,
        scenario: &Scenario,
        source: &Source,
        gdb: Option<u16>,
    ) -> Result<Option<Foreign>, CliError> {
        let (elf, board) = self.loaded()?;
        if self.firmware_may_reset && board.qemu.is_some() {
            return Err(CliError::Usage(format!(
                "--firmware-may-reset: the rig sees no watchdog of the board {}, expected an AVR \
                 board; leave the option out",
                board.name
            )));
        }
        let Some(machine) = board
            .qemu
            .as_ref()
            .filter(|qemu| qemu.firmware == Tier::RealTime)
        else {
            return Ok(None);
        };
        if gdb.is_some() {
            return Err(CliError::Usage(format!(
                "--gdb: the board {} runs in real time, which cannot stand still; expected a board \
                 in lockstep",
                board.name
            )));
        }
        let wired = robots::wire(scenario, source, Dut::External, pc_end(scenario))?;
        let wanted = self.wanted(&wired, &wired.open_ends, &board)?;
        let told = self.wired(&board, &wanted)?;
        warn_of_program(scenario, &board);
        let mut foreign = qemu::foreign(machine, elf, &wired.open_ends, &told)?;
        foreign.may_idle = self.firmware_may_idle;
        Ok(Some(foreign))
    }

    /// Rejects a board whose firmware runs in real time: `command` makes many runs in lockstep.
    pub(super) fn refuse_real_time(&self, command: &str) -> Result<(), CliError> {
        let (_, board) = self.loaded()?;
        let is_real_time = |machine: &Machine| machine.firmware == Tier::RealTime;
        match board.qemu.as_ref().is_some_and(is_real_time) {
            true => Err(CliError::Usage(format!(
                "--firmware: the board {} runs in real time, expected a board in lockstep for \
                 {command}; \"hilrig run\" has both",
                board.name
            ))),
            false => Ok(()),
        }
    }

    /// A run of `scenario` with the firmware at its open ends. `gdb`: the TCP port on which it
    /// waits for a debugger.
    pub(super) fn run(
        &self,
        scenario: Scenario,
        source: &Source,
        gdb: Option<u16>,
    ) -> Result<Run, CliError> {
        let (elf, board) = self.loaded()?;
        // Wired as for a native program: the run differs only in the program.
        let mut wired = robots::wire(&scenario, source, Dut::External, PcEnd::Scripted)?;
        let ends = core::mem::take(&mut wired.open_ends);
        let mut spec = match &board.qemu {
            Some(machine) => {
                let told = robots::of(&scenario, source)?.board_settings(&scenario, source)?;
                let words = qemu::words(&wired.rig, &ends, &self.wires()?, board.clock_hz, &told)?;
                qemu::node(NODE, machine, elf, &words, gdb)?
            }
            None => {
                warn_of_program(&scenario, &board);
                let wanted = self.wanted(&wired, &ends, &board)?;
                by_character(&mut wired, &ends);
                let mut spec = node_of(NODE, elf, &board, self.wired(&board, &wanted)?)
                    .map_err(|message| CliError::Usage(format!("--firmware: {message}")))?;
                if let Some(port) = gdb {
                    spec.settings.insert("gdb".to_owned(), port.into());
                }
                spec
            }
        };
        spec.role = Role::Program;
        spec.may_idle = self.firmware_may_idle;
        spec.may_reset = self.firmware_may_reset;
        spec.seed = scenario.seed;
        spec.ports = ends
            .iter()
            .map(|end| NodePort {
                name: end.name.clone(),
                line: end.line,
                carries_messages: kind_of(&wired, end).is_some_and(LinkKind::carries_messages),
            })
            .collect();
        if let Some(port) = gdb {
            spec.patience = HELD_MAX;
            eprintln!("waiting for gdb: target remote :{port}");
        }
        let places: Vec<usize> = ends.iter().map(|end| end.node).collect();
        let program = Box::new(NodeDevice::new(spec));
        wired.rig.seat(NODE, program, &places);
        Ok(Run::with_rig(scenario, wired.rig, wired.instruments))
    }

    /// The firmware's file and its board.
    fn loaded(&self) -> Result<(&Path, Board), CliError> {
        let (Some(elf), Some(board)) = (&self.firmware, &self.board) else {
            return Err(CliError::Usage("--firmware: is missing".to_owned()));
        };
        let board = Board::load(board, Path::new(""));
        let board = board.map_err(|error| CliError::Usage(format!("--board: {error}")))?;
        Ok((elf, board))
    }

    /// The ports of the rig that are to be connected to the board.
    fn wanted(
        &self,
        wired: &Wired,
        ends: &[OpenEnd],
        board: &Board,
    ) -> Result<Vec<(String, PortKind)>, CliError> {
        let wires = self.wires()?;
        let mut wanted = Vec::new();
        for end in ends {
            // An optional port stays open unless it is named.
            let is_wired = wires.contains_key(&end.name);
            let is_named = is_wired || board.unit(&end.name).is_some();
            match kind_of(wired, end) {
                Some(LinkKind::Pin | LinkKind::Datagram) if is_wired => {
                    return Err(CliError::Usage(format!(
                        "--wire: port \"{}\" of the rig carries levels or packets, and a board has \
                         ports for UARTs, I2C and SPI only; leave it out",
                        end.name
                    )));
                }
                Some(LinkKind::Pin | LinkKind::Datagram) => {}
                _ if !is_named && end.is_optional => {}
                Some(LinkKind::I2c) => wanted.push((end.name.clone(), PortKind::I2c)),
                _ => wanted.push((end.name.clone(), PortKind::Uart)),
            }
        }
        Ok(wanted)
    }

    /// The position on the board of each port of the rig.
    fn wired(&self, board: &Board, wanted: &[(String, PortKind)]) -> Result<Value, CliError> {
        let told = board.wire(wanted, &self.wires()?);
        told.map_err(|error| CliError::Usage(format!("--wire: {error}")))
    }

    fn wires(&self) -> Result<BTreeMap<String, String>, CliError> {
        let wire = |text: &String| match text.split_once('=') {
            Some((port, to)) if !port.is_empty() && !to.is_empty() => {
                Ok((port.to_owned(), to.to_owned()))
            }
            _ => Err(CliError::Usage(format!(
                "--wire: is \"{text}\", expected a port of the rig and one of the board, e.g. \
                 gps=serial1"
            ))),
        };
        let mut wires = BTreeMap::new();
        for (port, to) in self.wire.iter().map(wire).collect::<Result<Vec<_>, _>>()? {
            if let Some(first) = wires.insert(port.clone(), to.clone()) {
                return Err(CliError::Usage(format!(
                    "--wire: port \"{port}\" of the rig is connected twice, to \"{first}\" and to \
                     \"{to}\"; leave one out"
                )));
            }
        }
        Ok(wires)
    }
}

/// Lets the lines of `ends` deliver single characters: of a frame that arrives at once, a board's
/// receiver would keep three.
fn by_character(wired: &mut Wired, ends: &[OpenEnd]) {
    for end in ends {
        if let Some(link) = wired.rig.link_mut(&end.link) {
            link.lines.iter_mut().for_each(|line| line.piece = 1);
        }
    }
}

/// Warns about settings of the robot's program: other firmware does not know them.
fn warn_of_program(scenario: &Scenario, board: &Board) {
    if scenario.program.has_settings() {
        eprintln!(
            "warning: program: its settings do not reach firmware on the board {}, which runs with \
             its own; only the robot's program on the board cortex-m4 gets them",
            board.name
        );
    }
}

fn kind_of(wired: &Wired, end: &OpenEnd) -> Option<LinkKind> {
    wired.rig.link(&end.link).map(|link| link.kind)
}
