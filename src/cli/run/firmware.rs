//! `--firmware`: an ELF file on a simulated board instead of the robot's program.

use core::time::Duration;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use boards::{Board, PortKind};
use clap::Args;
use nodes::{NodeDevice, NodePort, Role};

use super::super::CliError;
use super::super::exec::quoted;
use crate::realtime::exec::pc_end;
use crate::rig::LinkKind;
use crate::robots::{self, Dut, OpenEnd};
use crate::run::Run;
use crate::scenario::device::firmware::node_of;
use crate::scenario::{Scenario, Source};

/// Name of the node; its output is in `node-program.log`.
const NODE: &str = "program";
/// Timeout while gdb may stop the program.
const HELD_MAX: Duration = Duration::from_secs(30 * 24 * 3_600);

/// Firmware as the program under test.
#[derive(Debug, Args)]
#[command(next_help_heading = "Firmware without a board")]
pub(super) struct FirmwareArgs {
    /// Run this ELF file, unmodified, on a simulated AVR board in the place of the robot's program
    #[arg(long, value_name = "ELF", requires = "board", conflicts_with = "exec")]
    firmware: Option<PathBuf>,
    /// Its board: arduino-uno, arduino-mega, leonardo, mighty-1284p, or a file that ends with .toml
    #[arg(long, value_name = "NAME", requires = "firmware")]
    board: Option<String>,
    /// Connect a port of the rig to one of the board, e.g. gps=serial1; may be given several times
    #[arg(long, value_name = "PORT=NAME", requires = "firmware")]
    wire: Vec<String>,
    /// Wait for gdb on this TCP port; the rig's time stands while gdb holds the program
    #[arg(long, value_name = "PORT", requires = "firmware", value_parser = clap::value_parser!(u16).range(1..))]
    gdb: Option<u16>,
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
        format!(
            " --firmware {elf} --board {board}{}",
            wires.collect::<String>()
        )
    }

    /// A run of `scenario` with the firmware at its open ends.
    pub(super) fn run(&self, scenario: Scenario, source: &Source) -> Result<Run, CliError> {
        let (Some(elf), Some(board)) = (&self.firmware, &self.board) else {
            return Err(CliError::Usage("--firmware: is missing".to_owned()));
        };
        let board = Board::load(board, Path::new(""))
            .map_err(|error| CliError::Usage(format!("--board: {error}")))?;
        let pc = pc_end(&scenario);
        let mut wired = robots::wire(&scenario, source, Dut::External, pc)?;
        let ends = core::mem::take(&mut wired.open_ends);
        let kind = |end: &OpenEnd| wired.rig.link(&end.link).map(|link| link.kind);
        let wires = self.wires()?;
        let mut wanted = Vec::new();
        for end in &ends {
            // An optional port stays open unless it is named.
            let is_wired = wires.contains_key(&end.name);
            let is_named = is_wired || board.unit(&end.name).is_some();
            match kind(end) {
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
        let told = board
            .wire(&wanted, &wires)
            .map_err(|error| CliError::Usage(format!("--wire: {error}")))?;
        let mut spec = node_of(NODE, elf, &board, told)
            .map_err(|message| CliError::Usage(format!("--firmware: {message}")))?;
        spec.role = Role::Program;
        spec.seed = scenario.seed;
        spec.ports = ends
            .iter()
            .map(|end| NodePort {
                name: end.name.clone(),
                line: end.line,
                carries_messages: kind(end).is_some_and(LinkKind::carries_messages),
            })
            .collect();
        if let Some(port) = self.gdb {
            spec.settings.insert("gdb".to_owned(), port.into());
            spec.patience = HELD_MAX;
            eprintln!("waiting for gdb: target remote :{port}");
        }
        let places: Vec<usize> = ends.iter().map(|end| end.node).collect();
        let program = Box::new(NodeDevice::new(spec));
        wired.rig.seat(NODE, program, &places);
        Ok(Run::with_rig(scenario, wired.rig, wired.instruments))
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
        self.wire.iter().map(wire).collect()
    }
}
