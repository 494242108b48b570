//! What a capture says of the links of a program, and where the program parts from it.

use crate::capture::replay::Played;
use crate::cli::CliError;
use crate::robots::{self, Dut, PcEnd};
use crate::scenario::{Scenario, Source};

/// Where what the program asks first differs from the capture, as a cause.
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

/// The links at which the captured robot's program is, if it is known which robot that was: what
/// reaches the PC is not for it.
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
