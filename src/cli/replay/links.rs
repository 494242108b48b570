//! The links of a program in a capture, and the program's first difference from the capture.

use crate::capture::replay::Played;
use crate::cli::CliError;
use crate::robots::{self, Dut, PcEnd};
use crate::scenario::{Scenario, Source};

/// The first different request of the program, as a cause.
pub(super) fn parted(links: &[Played]) -> Option<String> {
    let talks = links.iter().filter_map(|one| one.talk.as_ref());
    let parted = talks.filter_map(|talk| talk.divergence.as_ref());
    let first = parted.min_by_key(|one| one.at)?;
    let words = first.to_string();
    let line = words.lines().next().unwrap_or_default();
    Some(format!(
        "the program asks otherwise than in the capture: {line}"
    ))
}

/// The links of the captured robot's program, if the robot is known: bytes to the PC are not for
/// the program.
pub(super) fn own_links(
    robot: Option<&(Scenario, Source)>,
) -> Result<Option<Vec<String>>, CliError> {
    let Some((scenario, source)) = robot else {
        return Ok(None);
    };
    let wired = robots::wire(scenario, source, Dut::External, PcEnd::Scripted)?;
    let ends = wired.open_ends.into_iter();
    Ok(Some(ends.map(|end| end.link).collect()))
}
