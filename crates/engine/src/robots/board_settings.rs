//! Settings of a robot's program as words for firmware on a simulated board.

use core::fmt::Display;

use firmware_core::robots::board_settings::Report;

use crate::scenario::{Scenario, ScenarioError, Source};

/// Writes the words of a configuration.
type Tell<C> = fn(&C, &mut Report<'_>);
/// Changes a configuration by one word.
type Set<C> = fn(&mut C, &str, &str) -> Result<(), &'static str>;

/// Keys and values that turn `default` into `config`; `None` if no words can do this. Enabled
/// defects of the program, selected by `is_own`, come last.
pub(super) fn words<C: PartialEq>(
    scenario: &Scenario,
    (config, default): (&C, C),
    (tell, set): (Tell<C>, Set<C>),
    is_own: impl Fn(&str) -> bool,
) -> Option<Vec<(&'static str, String)>> {
    let mut words = Vec::new();
    let mut report = |key, value: &dyn Display| words.push((key, value.to_string()));
    tell(config, &mut report);
    let defects = scenario.program.defects.iter().map(|id| id.get_ref());
    let defects = defects.filter(|id| is_own(id));
    words.extend(defects.map(|id| ("defect", id.clone())));
    let mut heard = default;
    let are_known = words
        .iter()
        .all(|(key, value)| set(&mut heard, key, value).is_ok());
    (are_known && heard == *config).then_some(words)
}

/// Error of a scenario with settings that have no words.
pub(super) fn untold(source: &Source) -> ScenarioError {
    let message = "cannot be passed to firmware on a simulated board, expected none; build the \
                   firmware with these settings in Config::DEFAULT";
    source.invalid(source.find("tuning"), "program.tuning", message)
}
