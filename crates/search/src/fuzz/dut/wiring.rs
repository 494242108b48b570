//! The rig of a case, and the ports on the ends of its links.

use std::path::{Path, PathBuf};

use engine::robots::{self, Dut, OpenEnd, PcEnd, Wired};
use engine::run::Run;
use engine::scenario::{Scenario, ScenarioError, Source};
use realtime::transport::{Note, PortDir, Pty, Serial, Transport, TransportError};

/// The rig of `scenario`, its open ends, and the end of `link` that replaces a device.
pub(super) fn wire(
    source: &Source,
    scenario: &Scenario,
    link: Option<&str>,
) -> Result<(Run, Vec<OpenEnd>, Option<usize>), ScenarioError> {
    let mission = &scenario.mission;
    let is_scripted = !mission.waypoints_m.is_empty() || !mission.step.is_empty();
    let wired = |pc| robots::wire(scenario, source, Dut::External, pc);
    let has =
        |wired: &Wired| link.is_none_or(|link| wired.open_ends.iter().any(|end| end.link == link));
    let wired = match wired(PcEnd::Scripted)? {
        scripted if is_scripted && has(&scripted) => scripted,
        _ => wired(PcEnd::External)?,
    };
    let Wired {
        mut rig,
        open_ends: ends,
        instruments,
    } = wired;
    let raw = link.and_then(|link| rig.replace_device(link));
    if let (Some(node), Some(end)) = (raw, ends.iter().find(|end| Some(&*end.link) == link)) {
        rig.set_line_config(node, end.line);
    }
    let run = Run::with_rig(scenario.clone(), rig, instruments);
    Ok((run, ends, raw))
}

/// An end of a link with its port.
pub(super) type Placed = (OpenEnd, Box<dyn Transport>);

/// A new pseudo-terminal in `dir` for each end.
pub(super) fn terminals(
    dir: &Path,
    ends: &[OpenEnd],
    scenario: &Scenario,
) -> Result<(PortDir, Vec<Placed>), TransportError> {
    let mut dir = PortDir::open(dir)?;
    let mut ports: Vec<Placed> = Vec::new();
    for end in ends {
        let port = Pty::open(&dir, &end.name, end.line)?;
        ports.push((end.clone(), Box::new(port)));
    }
    dir.leave_note(Note::Scenario, &scenario.to_toml())?;
    Ok((dir, ports))
}

/// The existing ports in `dir`.
pub(super) fn serials(dir: &Path, ends: &[OpenEnd]) -> Result<Vec<Placed>, TransportError> {
    let mut ports: Vec<Placed> = Vec::new();
    for end in ends {
        let path: PathBuf = dir.join(&end.name);
        if path.exists() {
            let port = Serial::open(&path, end.line)?;
            ports.push((end.clone(), Box::new(port)));
        }
    }
    Ok(ports)
}
