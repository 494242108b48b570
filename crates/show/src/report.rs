//! report.html: the result of a run for any browser, without a network. It shows expectations and
//! verdicts, world, map and paths at any time, the lines, and the events.
//!
//! The report is one self-contained file. Text is part of the page itself, so that a reader can
//! search and print it without the script; the script draws the rest from JSON. All text from a
//! scenario or a line is escaped, and a content security policy allows only the report's own
//! script. The same case produces the same bytes.

mod data;
mod faults;
mod robot;
mod talk;
mod text;
mod verdict;

use core::time::Duration;

use crate::html::escape;
use crate::metrics::Metrics;
use crate::view;
use engine::rig::Logged;
use engine::rig::trace;
use engine::run::Outcome;
use talk::Talk;
use text::with_jumps;

const SCRIPT: &str = include_str!("report/report.js");
const STYLE: &str = include_str!("report/report.css");
const STAGE: &str = include_str!("report/stage.html");

/// Maximum number of listed events; events.txt has all of them.
const EVENTS_MAX: usize = 500;
/// Maximum number of faults whose beginning is marked on the time line.
const FAULTS_MAX: usize = 200;

/// The report of `outcome`.
pub fn html(outcome: &Outcome) -> String {
    let events = listed(&outcome.events);
    let talk = Talk::of(outcome);
    // Without "<", the data cannot end the element that holds it.
    let data = data::json(outcome, &events, talk.as_ref()).replace('<', "\\u003c");
    let nonce = trace::fingerprint(data.as_bytes());
    let policy = format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; \
         base-uri 'none'; form-action 'none'"
    );
    let name = escape(&outcome.case.name);
    let title = format!("{name} seed {}", outcome.seed);
    let rest = [
        display(outcome),
        robot::section(outcome),
        event_list(outcome, &events),
        faults::list(&outcome.case.fault),
        figures(outcome),
        counters(outcome),
    ];
    let body = [
        verdict::header(outcome),
        "<main>\n".to_owned(),
        verdict::tiles(outcome, talk.as_ref()),
        stage(outcome),
        talk.as_ref().map(Talk::section).unwrap_or_default(),
        format!("<div id=\"rest\">\n{}</div>\n</main>\n", rest.concat()),
    ]
    .concat();
    let (drawing, lanes) = (view::SCRIPT, view::LANES);
    format!(
        r#"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style nonce="{nonce}">
{STYLE}</style>
</head>
<body>
{body}<script type="application/json" id="run">{data}</script>
<script nonce="{nonce}">
{drawing}</script>
<script nonce="{nonce}">
{lanes}</script>
<script nonce="{nonce}">
{SCRIPT}</script>
</body>
</html>
"#
    )
}

/// Earliest time, seconds, of those failed checks of `outcome` that name a time.
pub(crate) fn failed_at(outcome: &Outcome) -> Option<f64> {
    data::failures(outcome).next()
}

/// A table of the last requests and replies of a run without a robot, until `at`, seconds.
pub(crate) fn last_exchanges(outcome: &Outcome, at: f64) -> String {
    talk::moment(outcome, at)
}

/// World, map, links over time, and the verdicts beside them; without world and map if there is no
/// robot.
fn stage(outcome: &Outcome) -> String {
    let stage = match outcome.has_body {
        true => STAGE.to_owned(),
        false => STAGE
            .replace("World, map and links over time", "Links over time")
            .replace("<div id=\"view\">", "<div id=\"view\" hidden>")
            .replace("id=\"stage\"", "id=\"stage\" class=\"bare\""),
    };
    // Inserted last, so that nothing in the text of a check is replaced.
    stage.replace("<!-- checks -->", &verdict::checks(outcome))
}

/// The listed events: violations before notes if there are too many.
fn listed(events: &[Logged]) -> Vec<&Logged> {
    let violations = events.iter().filter(|logged| logged.is_violation());
    let notes = events.iter().filter(|logged| !logged.is_violation());
    let mut listed: Vec<_> = violations.chain(notes).take(EVENTS_MAX).collect();
    listed.sort_by_key(|logged| logged.event.at);
    listed
}

fn section(id: &str, title: &str, content: &str) -> String {
    format!(
        "<section aria-labelledby=\"h-{id}\">\n<h2 id=\"h-{id}\">{title}</h2>\n\
         {content}</section>\n"
    )
}

fn table(id: &str, rows: impl Iterator<Item = String>) -> String {
    let rows: String = rows.collect();
    format!("<table id=\"{id}\"><tbody>\n{rows}</tbody></table>\n")
}

fn row(class: &str, cells: &[&str]) -> String {
    let cells: String = cells
        .iter()
        .map(|cell| format!("<td>{cell}</td>"))
        .collect();
    format!("<tr class=\"{class}\">{cells}</tr>\n")
}

fn display(outcome: &Outcome) -> String {
    if outcome.display.is_none() {
        return String::new();
    }
    let canvas = "<canvas id=\"display\" role=\"img\" aria-label=\"The robot's display\">\
                  </canvas>\n";
    section("display", "The robot's display at the end", canvas)
}

fn event_list(outcome: &Outcome, events: &[&Logged]) -> String {
    let items = events.iter().map(|logged| {
        let class = if logged.is_violation() { "fail" } else { "" };
        format!(
            "<li class=\"{class}\">{}</li>\n",
            with_jumps(&logged.to_string())
        )
    });
    let items: String = items.collect();
    let more = more(outcome.events.len(), events.len(), "events.txt");
    let list = format!("<ol id=\"events\" tabindex=\"0\">\n{items}</ol>\n{more}");
    section("events", "Events", &list)
}

/// A note that the list is incomplete; empty if it is complete.
fn more(all: usize, shown: usize, file: &str) -> String {
    if all == shown {
        return String::new();
    }
    format!("<p>{shown} of {all}; {file} has all of them.</p>\n")
}

fn figures(outcome: &Outcome) -> String {
    // Wall time is not part of the run: it would make each report different.
    let metrics = Metrics::of(outcome, Duration::ZERO);
    let share = |value: Option<f64>| value.map(verdict::percent);
    let figure = |value: Option<f64>, unit: &str| value.map(|value| format!("{value:.1}{unit}"));
    let rows = [
        ("position error, RMS", figure(metrics.pose_rms_mm, " mm")),
        ("position error, worst", figure(metrics.pose_max_mm, " mm")),
        ("heading error, RMS", figure(metrics.heading_rms_deg, "°")),
        ("walls found", share(metrics.walls_found)),
        ("found walls right", share(metrics.walls_right)),
        (
            "waypoints visited",
            (metrics.waypoints > 0)
                .then(|| format!("{} of {}", metrics.waypoints_visited, metrics.waypoints)),
        ),
        ("broken rules", Some(metrics.violations.to_string())),
    ];
    if !outcome.has_body {
        return String::new();
    }
    let rows = rows
        .into_iter()
        .filter_map(|(name, value)| Some(row("", &[name, &value?])));
    section("figures", "Figures", &table("figures", rows))
}

fn counters(outcome: &Outcome) -> String {
    let counters = outcome.counters.iter().filter(|&(_, &value)| value > 0);
    let rows = counters.map(|(name, value)| row("", &[&escape(name), &value.to_string()]));
    let rows: Vec<String> = rows.collect();
    if rows.is_empty() {
        return String::new();
    }
    section(
        "counters",
        "The program's counters",
        &table("counters", rows.into_iter()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Inlined text must not end its element.
    #[test]
    fn nothing_inlined_ends_its_element() {
        for part in [SCRIPT, view::SCRIPT, view::LANES] {
            assert!(!part.to_lowercase().contains("</script"));
            assert!(!part.contains("<!--"));
        }
        assert!(!STYLE.to_lowercase().contains("</style"));
    }
}
