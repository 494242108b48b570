//! Verdict of a run: the first cause, four figures, and every check with a sentence that explains
//! it; passed checks are folded.

use core::time::Duration;

use super::talk::Talk;
use super::text::with_jumps;
use super::{row, section};
use crate::html::escape;
use crate::meaning::meaning;
use crate::metrics::Metrics;
use engine::TOOL;
use engine::run::Outcome;
use engine::run::check::{Check, Status};

/// Verdict, first failed check, name of the run, and the command that repeats it.
pub(super) fn header(outcome: &Outcome) -> String {
    let (class, verdict) = match outcome.passed() {
        true => ("pass", "PASS"),
        false => ("fail", "FAIL"),
    };
    let case = &outcome.case;
    let (name, about) = (escape(&case.name), escape(&case.description));
    let (seed, hash, version) = (outcome.seed, &outcome.trace_hash, env!("CARGO_PKG_VERSION"));
    let (ran, cause) = (outcome.ran.as_secs_f64(), cause(outcome));
    let team = team(outcome);
    let again = escape(outcome.again.as_deref().unwrap_or("hilrig run case.toml"));
    format!(
        "<header>\n<h1><span id=\"verdict\" class=\"{class}\">{verdict}</span> {name}</h1>\n\
         {cause}<p>{about}</p>\n<p>seed {seed}, {ran:.1} s, bytes {hash}, {TOOL} {version}; \
         again: <code>{again}</code></p>\n{team}</header>\n"
    )
}

/// Links to the reports of the further robots.
fn team(outcome: &Outcome) -> String {
    let links = outcome.team.iter().map(|(name, _)| {
        let name = escape(name);
        format!("<a href=\"team/{name}/report.html\">{name}</a>")
    });
    let links: Vec<String> = links.collect();
    match &links[..] {
        [] => String::new(),
        links => format!("<p>reports of further robots: {}</p>\n", links.join(", ")),
    }
}

/// The first failed check, and the number of further ones; if none failed, rules that were not
/// observed.
fn cause(outcome: &Outcome) -> String {
    let mut failed = of(&outcome.checks, Status::Fail).chain(outcome.unobserved_rules());
    let Some(first) = failed.next() else {
        return String::new();
    };
    let (name, detail) = (escape(&first.name), with_jumps(&first.detail));
    let meaning = meaning(&first.name).unwrap_or_default();
    let more = match failed.count() {
        0 => String::new(),
        1 => " One more check did not pass.".to_owned(),
        more => format!(" {more} more checks did not pass."),
    };
    let probable = outcome
        .probable_cause
        .as_deref()
        .map_or_else(String::new, |cause| {
            format!(
                "<br><strong>probable cause</strong>: {}.",
                with_jumps(cause)
            )
        });
    let about = match first.status {
        Status::NotObserved => "not observed: ",
        Status::Pass | Status::Fail => "",
    };
    format!(
        "<p id=\"cause\"><strong>{name}</strong>: {about}{detail}.{probable}<br>{meaning}{more}</p>\n"
    )
}

/// Formats a share with one decimal: 99.7 % rounded to a whole number would read 100 %.
pub(super) fn percent(share: f64) -> String {
    format!("{:.1} %", share * 100.0)
}

/// Up to four figures that characterise a run.
pub(super) fn tiles(outcome: &Outcome, talk: Option<&Talk>) -> String {
    // Wall time is not part of the run: it would make each report different.
    let metrics = Metrics::of(outcome, Duration::ZERO);
    let waypoints = (metrics.waypoints > 0)
        .then(|| format!("{} of {}", metrics.waypoints_visited, metrics.waypoints));
    let talked = talk.map(Talk::tiles).unwrap_or_default();
    let tiles = [
        (
            "position error, RMS",
            metrics.pose_rms_mm.map(|mm| format!("{mm:.1} mm")),
        ),
        ("found walls right", metrics.walls_right.map(percent)),
        ("waypoints visited", waypoints),
        ("broken rules", Some(metrics.violations.to_string())),
    ];
    let tiles = talked.into_iter().chain(tiles).filter_map(|(name, value)| {
        let value = value?;
        Some(format!("<li><b>{value}</b> {name}</li>\n"))
    });
    let tiles: String = tiles.collect();
    format!("<ul id=\"tiles\">\n{tiles}</ul>\n")
}

fn of(checks: &[Check], status: Status) -> impl Iterator<Item = &Check> {
    checks.iter().filter(move |check| check.status == status)
}

/// All checks: failed ones, unobserved ones, and passed ones in a fold.
pub(super) fn checks(outcome: &Outcome) -> String {
    let all = &outcome.checks;
    let open = of(all, Status::Fail).chain(of(all, Status::NotObserved));
    let open: String = open.map(check).collect();
    let passed: String = of(all, Status::Pass).map(check).collect();
    let count = of(all, Status::Pass).count();
    let checks = if count == 1 { "check" } else { "checks" };
    let content = format!(
        "<div id=\"checks\">\n<table><tbody>\n{open}</tbody></table>\n\
         <details><summary>{count} {checks} passed</summary>\n\
         <table><tbody>\n{passed}</tbody></table></details></div>\n"
    );
    section("checks", "Verdicts", &content)
}

fn check(check: &Check) -> String {
    let (class, word) = match check.status {
        Status::Pass => ("pass", "ok"),
        Status::Fail => ("fail", "FAIL"),
        Status::NotObserved => ("unseen", "not observed"),
    };
    let meaning = meaning(&check.name).map(|meaning| format!("<br><small>{meaning}</small>"));
    let detail = with_jumps(&check.detail) + &meaning.unwrap_or_default();
    row(class, &[word, &escape(&check.name), &detail])
}
