//! The capture of a replay in its folder: what was played, and what the program sent.

use std::path::Path;

use crate::TOOL;
use crate::capture::divergence::Track;
use crate::capture::{Capture, Interface, Kind, Limits, Record, Recording, Section};
use crate::cli::CliError;
use crate::realtime::playback::Socket;
use crate::rig::line::Direction;
use crate::run::Run;
use crate::scenario::Scenario;
use crate::search::shrink;

/// Name of the capture.
const CAPTURE: &str = "capture.pcapng";

/// Description of the capture; `scenario` is that of the played capture, if it names one.
fn section(scenario: Option<&Scenario>) -> Section {
    Section {
        tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
        about: "clock=replay".to_owned(),
        scenario: scenario.map(Scenario::to_toml).unwrap_or_default(),
    }
}

/// Makes a `run` write its capture into the folder `out`.
pub(super) fn record(
    run: &mut Run,
    scenario: Option<&Scenario>,
    out: &Path,
) -> Result<(), CliError> {
    let path = out.join(CAPTURE);
    let recording = Recording::create(&path, &run.rig, section(scenario), Limits::default());
    let recording = recording.map_err(|error| CliError::write(path.display(), error))?;
    run.rig.add_tap(Box::new(recording));
    Ok(())
}

/// Writes the capture of a replay to ports into the folder `out`.
pub(super) fn write(
    sockets: &[Socket],
    bauds: impl Fn(&str) -> u32,
    scenario: Option<&Scenario>,
    out: &Path,
) -> Result<(), CliError> {
    let mut capture = Capture {
        sections: vec![section(scenario)],
        ..Capture::default()
    };
    for (link, socket) in sockets.iter().enumerate() {
        let name = socket.link();
        capture.links.push(Interface::new(name, bauds(name)));
        let [spoken, got] = socket.passed();
        let records = &mut capture.records;
        for (direction, track) in [(Direction::ToMaster, spoken), (Direction::ToDevice, got)] {
            records.extend(records_of(link, direction, track));
        }
    }
    capture.records.sort_by_key(|record| record.at);
    let path = out.join(CAPTURE);
    safefs::write(&path, shrink::to_bytes(&capture))
        .map_err(|error| CliError::write(path.display(), error))
}

fn records_of(link: usize, direction: Direction, track: &Track) -> Vec<Record> {
    let pieces = track.pieces();
    let records = pieces.map(|(at, bytes)| Record {
        link,
        sequence: None,
        at,
        direction,
        kind: Kind::Data,
        bytes: bytes.to_vec().into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    });
    records.collect()
}
