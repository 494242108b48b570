//! Final commands and state of the robot, for any kind of robot.

use crate::html::escape;
use engine::robots::{Axis, Panel, PanelRow};
use engine::run::Outcome;

use super::{row, table};

/// Axes as a table and each panel folded; empty if the robot has neither.
pub(super) fn section(outcome: &Outcome) -> String {
    let mut content = String::new();
    if !outcome.axes.is_empty() {
        content += &table("axes", outcome.axes.iter().map(axis));
    }
    // Without a robot, the run is about its devices.
    let open = if outcome.has_body { "" } else { " open" };
    content.extend(outcome.panels.iter().map(|one| panel(one, open)));
    if content.is_empty() {
        return content;
    }
    let title = match outcome.has_body {
        true => "The robot at the end",
        false => "The devices at the end",
    };
    super::section("robot", title, &content)
}

fn axis(axis: &Axis) -> String {
    let unit = escape(axis.unit);
    let told = format!("set-point {} {unit}", figure(axis.set_point));
    let limit = axis.limit.map(|limit| format!("limit {}", figure(limit)));
    let does = axis
        .actual
        .map(|actual| format!("actual {} {unit}", figure(actual)));
    let cells = [
        escape(&axis.name),
        told,
        does.unwrap_or_default(),
        limit.unwrap_or_default(),
    ];
    row("", &cells.each_ref().map(String::as_str))
}

/// Formats at most three decimals, never `-0`.
fn figure(value: f64) -> String {
    ((value * 1000.0).round() / 1000.0 + 0.0).to_string()
}

fn panel(panel: &Panel, open: &str) -> String {
    let values = |one: &PanelRow| {
        let address = one
            .address
            .map_or(String::new(), |address| address.to_string());
        let value = escape(&format!("{} {}", one.value, one.unit));
        row("", &[&address, &escape(&one.name), value.trim_end()])
    };
    let (name, rows): (_, String) = (escape(&panel.name), panel.rows.iter().map(values).collect());
    format!(
        "<details class=\"panel\"{open}><summary>{name}</summary>\n<table><tbody>\n{rows}</tbody>\
         </table></details>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Text from a robot of another crate is escaped.
    #[test]
    fn names_and_values_are_escaped() {
        let shown = axis(&Axis {
            name: "<b>".into(),
            unit: "rad",
            set_point: -0.000_01,
            limit: Some(0.5),
            actual: None,
        });
        let cells = "<td>&lt;b&gt;</td><td>set-point 0 rad</td><td></td><td>limit 0.5</td>";
        assert!(shown.contains(cells), "{shown}");
        let shown = panel(
            &Panel {
                name: "a&b".to_owned(),
                rows: vec![PanelRow {
                    name: "speed".into(),
                    address: Some(10),
                    value: "<3".to_owned(),
                    unit: "m/s".into(),
                }],
            },
            "",
        );
        assert!(shown.contains("<summary>a&amp;b</summary>"), "{shown}");
        assert!(
            shown.contains("<td>10</td><td>speed</td><td>&lt;3 m/s</td>"),
            "{shown}"
        );
    }
}
