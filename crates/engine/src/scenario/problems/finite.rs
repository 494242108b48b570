//! Numbers that no quantity can have.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::super::{ScenarioError, Source};

/// The errors for `nan`, `inf` and numbers that are too large to be represented, in a file without
/// other errors: no limits exclude them.
pub(in crate::scenario) fn not_finite(source: &Source) -> Vec<ScenarioError> {
    let (document, _) = DeTable::parse_recoverable(&source.text);
    let mut problems = Vec::new();
    for (key, value) in document.get_ref().iter() {
        look(source, key.get_ref(), value, &mut problems);
    }
    problems
}

fn look(
    source: &Source,
    key: &str,
    value: &Spanned<DeValue<'_>>,
    problems: &mut Vec<ScenarioError>,
) {
    match value.get_ref() {
        DeValue::Float(number) => {
            let text = number.as_str();
            let is_finite = text.parse::<f64>().is_ok_and(f64::is_finite);
            if !is_finite {
                let message = format!("is {text}, expected a finite number");
                problems.push(source.invalid(Some(value.span()), key, message));
            }
        }
        DeValue::Array(values) => {
            for (index, value) in values.iter().enumerate() {
                look(source, &format!("{key}[{index}]"), value, problems);
            }
        }
        DeValue::Table(table) => {
            for (name, value) in table.iter() {
                look(
                    source,
                    &format!("{key}.{}", name.get_ref()),
                    value,
                    problems,
                );
            }
        }
        _ => {}
    }
}
