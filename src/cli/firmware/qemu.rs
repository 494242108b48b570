//! Firmware for a Cortex-M in QEMU.

use core::time::Duration;
use std::collections::BTreeMap;
use std::path::Path;

use boards::{Machine, check_image};
use nodes::NodeSpec;
use serde_json::Value;

use super::super::CliError;
use crate::realtime::exec::{Foreign, port_variable};
use crate::rig::Rig;
use crate::robots::OpenEnd;
use crate::scenario::device::firmware::elf_path;

/// Wall time in which QEMU opens its ports.
const START: Duration = Duration::from_secs(10);

fn wrong(message: String) -> CliError {
    CliError::Usage(format!("--firmware: {message}"))
}

/// The path of an image for a Cortex-M.
fn image(elf: &Path) -> Result<String, CliError> {
    let path = elf_path(elf).map_err(wrong)?;
    check_image(elf).map_err(wrong)?;
    Ok(path)
}

/// The command line of firmware with the board layer: its ports, the processor, its settings.
pub(super) fn words(
    rig: &Rig,
    ends: &[OpenEnd],
    wires: &BTreeMap<String, String>,
    clock_hz: u32,
    settings: &[(&str, String)],
) -> Result<Vec<String>, CliError> {
    if let Some(port) = wires
        .keys()
        .find(|port| ends.iter().all(|end| end.name != **port))
    {
        let known: Vec<_> = ends.iter().map(|end| end.name.as_str()).collect();
        return Err(CliError::Usage(format!(
            "--wire: the rig has no port \"{port}\", expected one of {}",
            known.join(", ")
        )));
    }
    let name_of = |end: &OpenEnd| wires.get(&end.name).unwrap_or(&end.name).clone();
    let mut taken = BTreeMap::new();
    for end in ends {
        let name = name_of(end);
        if let Some(first) = taken.insert(name.clone(), &end.name) {
            return Err(CliError::Usage(format!(
                "--wire: the ports \"{first}\" and \"{}\" of the rig are both connected to the port \
                 \"{name}\" of the firmware, expected one; connect the other elsewhere",
                end.name
            )));
        }
    }
    let ports = ends.iter().map(|end| {
        let lines = rig.links().iter().flat_map(|link| &link.lines);
        let mut lines = lines.filter(|line| line.from.node == end.node);
        let piece = lines.next().map_or(1, |line| line.piece);
        let is_wired = wires.contains_key(&end.name);
        let key = match end.is_optional && !is_wired {
            true => "optional",
            false => "port",
        };
        format!("{key}={}:{piece}", name_of(end))
    });
    let [scan, one_try, point] =
        [rig.cpu.per_scan, rig.cpu.per_try, rig.cpu.per_point].map(|cost| cost.as_nanos());
    let processor = [
        format!("cost={scan}:{one_try}:{point}"),
        format!("clock={clock_hz}"),
    ];
    let settings = settings.iter().map(|(key, value)| format!("{key}={value}"));
    Ok(ports.chain(processor).chain(settings).collect())
}

/// The node program: QEMU with the firmware.
pub(super) fn node(
    name: &str,
    machine: &Machine,
    elf: &Path,
    words: &[String],
    gdb: Option<u16>,
) -> Result<NodeSpec, CliError> {
    let elf = image(elf)?;
    let command = machine.lockstep(&elf, words, gdb).map_err(wrong)?;
    Ok(NodeSpec::new(name, &command))
}

/// The program at the rig's ports: QEMU with the firmware, in real time. `wires` has the UART of
/// each port.
pub(super) fn foreign(
    machine: &Machine,
    elf: &Path,
    ends: &[OpenEnd],
    wires: &Value,
) -> Result<Foreign, CliError> {
    let elf = image(elf)?;
    let wired = ends.iter().filter_map(|end| {
        let number = wires.get(&end.name)?.get("number")?.as_u64()?;
        Some((end, u8::try_from(number).ok()?))
    });
    let wired: Vec<_> = wired.collect();
    let ports: Vec<_> = wired
        .iter()
        .map(|(end, number)| (*number, port_variable(&end.name)))
        .collect();
    Ok(Foreign {
        command: machine.real_time(&elf, &ports).map_err(wrong)?,
        name: String::new(),
        robot: 0,
        others: Vec::new(),
        wait: START,
        may_end: false,
        may_idle: false,
        needs: wired.iter().map(|(end, _)| end.name.clone()).collect(),
        // Its output is that of QEMU: warnings about the machine.
        prints: false,
        has_lines: false,
        supervision: None,
    })
}
