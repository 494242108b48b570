//! The links of a program in a capture.

use crate::cli::CliError;
use crate::robots::{self, Dut, PcEnd};
use crate::scenario::{Scenario, Source};

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
