//! A campaign as a self-contained HTML file.

use core::fmt::{self, Write as _};
use core::time::Duration;

use super::strip::class;
use super::{CampaignPlan, Change, Comparison, Failures, Merged};
use show::html::Escaped;

const HEAD: &str = concat!(
    "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
     <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
     <title>hilrig campaign</title>\n<style>\n",
    include_str!("page.css"),
    "</style>\n<main>\n"
);

/// The page of `merged`.
pub fn page(merged: &Merged) -> String {
    let mut out = String::from(HEAD);
    write_page(merged, &mut out).expect("a string takes everything");
    out
}

/// The page of a running campaign with its `failures` so far; `far` describes the progress. The
/// page reloads itself after each `period`, if given.
pub fn live_page(
    plan: &CampaignPlan,
    far: &str,
    failures: &[Failures<'_>],
    period: Option<Duration>,
) -> String {
    let mut out = String::from(HEAD);
    write_live_page(plan, far, failures, period, &mut out).expect("a string takes everything");
    out
}

fn write_live_page(
    plan: &CampaignPlan,
    far: &str,
    failures: &[Failures<'_>],
    period: Option<Duration>,
    out: &mut String,
) -> fmt::Result {
    if let Some(period) = period {
        let seconds = period.as_secs();
        write!(out, "<meta http-equiv=\"refresh\" content=\"{seconds}\">")?;
    }
    out.write_str("<h1>Campaign</h1><p>")?;
    write_plan(plan, out)?;
    write!(out, "<p>{}", Escaped(far))?;
    out.write_str("<h2>Failures by cause</h2><table><tr><th>cause<th>runs<th>first")?;
    for failures in failures {
        let (scenario, seed) = failures.first;
        write!(
            out,
            "<tr><td>{}<td class=\"n\">{}<td>{} seed {seed}",
            Escaped(failures.cause),
            failures.runs,
            Escaped(scenario)
        )?;
    }
    out.write_str("</table></main>\n</html>\n")
}

/// Writes the plan: scenarios, seeds, variations.
fn write_plan(plan: &CampaignPlan, out: &mut String) -> fmt::Result {
    let names: Vec<&str> = plan.scenarios.keys().map(String::as_str).collect();
    write!(
        out,
        "{}, seeds {} to {}, varied: {}, profile {}.",
        Escaped(&names.join(", ")),
        plan.seeds.start,
        plan.seeds.end.saturating_sub(1),
        Escaped(&plan.vary),
        Escaped(&plan.profile_name())
    )
}

fn write_page(merged: &Merged, out: &mut String) -> fmt::Result {
    let goals = merged.missed_goals().count();
    let verdict = match (merged.failed, goals, merged.unobserved_rules().count()) {
        (0, 0, 0) => "<b class=\"good\">all pass</b>".to_owned(),
        (0, 0, rules) => format!("<b class=\"bad\">{rules} rules not observed</b>"),
        (0, goals, _) => format!("<b class=\"bad\">{goals} goals not reached</b>"),
        (failed, ..) => format!("<b class=\"bad\">{failed} fail</b>"),
    };
    out.write_str("<h1>Campaign</h1><p>")?;
    write_plan(&merged.plan, out)?;
    write!(
        out,
        " {} runs, {:.1} h of virtual time: {verdict}.",
        merged.runs,
        merged.ran_ms as f64 / 3.6e6
    )?;
    if merged.missing > 0 {
        write!(
            out,
            " <span class=\"bad\">{} runs are missing.</span>",
            merged.missing
        )?;
    }
    write!(out, "<p>Trace <code>{}</code>", merged.trace)?;
    write_causes(merged, out)?;
    if let Some(comparison) = &merged.comparison {
        write_comparison(comparison, out)?;
    }
    write_situations(merged, out)?;
    out.write_str("</main>\n</html>\n")
}

/// Writes a card for each cause, the most frequent first.
fn write_causes(merged: &Merged, out: &mut String) -> fmt::Result {
    if merged.groups.is_empty() {
        return Ok(());
    }
    out.write_str("<h2>Failures by cause</h2>")?;
    let names: Vec<&str> = merged.groups.iter().map(|group| &*group.cause).collect();
    merged.strip.write(&names, out)?;
    out.write_str("<ol class=\"causes\">")?;
    for (number, group) in merged.groups.iter().enumerate() {
        let (scenario, seed) = &group.first;
        write!(
            out,
            "<li class=\"{}\"><h3>{}</h3><p><b>{} of {} runs</b> <progress max=\"{}\" value=\"{}\" \
             aria-label=\"share of all runs\"></progress><p>{}",
            class(Some(number)),
            Escaped(&group.cause),
            group.runs,
            merged.runs,
            merged.runs,
            group.runs,
            Escaped(&group.detail),
        )?;
        out.write_str(group.picture.as_deref().unwrap_or_default())?;
        if let (Some(case), Some(left)) = (&group.case, &group.left) {
            let (case, left) = (Escaped(case), Escaped(left));
            write!(
                out,
                "<p>smallest case: <a href=\"{case}\">{case}</a>, {left}"
            )?;
            let exec = Escaped(merged.plan.exec.as_deref().unwrap_or_default());
            write!(out, "<p><code>hilrig run {case}{exec}</code>")?;
        }
        write!(
            out,
            "<details><summary>first: {} seed {seed}</summary><p>",
            Escaped(scenario)
        )?;
        for (scenario, seed) in &group.others {
            write!(out, "{} seed {seed}, ", Escaped(scenario))?;
        }
        match group.runs - 1 - group.others.len() {
            0 => out.write_str("no others</details>")?,
            more => write!(out, "and {more} others</details>")?,
        }
    }
    out.write_str("</ol>")
}

/// Writes the situations that never occurred, and a folded list of the others.
fn write_situations(merged: &Merged, out: &mut String) -> fmt::Result {
    let (met, never): (Vec<_>, Vec<_>) = merged.situations.iter().partition(|one| one.runs > 0);
    let lists: [(&str, Vec<&str>); 3] = [
        ("Not reached in any run", merged.missed_goals().collect()),
        (
            "Not observed in any run",
            merged.unobserved_rules().collect(),
        ),
        (
            "Not judged, no generated mission has it",
            merged.lost_rules().collect(),
        ),
    ];
    for (what, names) in lists.iter().filter(|(_, names)| !names.is_empty()) {
        let names = names.join(", ");
        write!(out, "<p class=\"bad\">{what}: {}.", Escaped(&names))?;
    }
    out.write_str("<h2>Situations that must come up</h2>")?;
    if !never.is_empty() {
        out.write_str("<p class=\"bad\">Never occurred: ")?;
        let names: Vec<&str> = never.iter().map(|one| &*one.situation).collect();
        write!(out, "{}.", Escaped(&names.join(", ")))?;
    }
    write!(out, "<details><summary>{} occurred</summary>", met.len())?;
    out.write_str("<table><tr><th>what<th>runs")?;
    for count in met {
        let name = Escaped(&count.situation);
        write!(out, "<tr><td>{name}<td class=\"n\">{}", count.runs)?;
    }
    out.write_str("</table></details>")
}

fn write_comparison(comparison: &Comparison, out: &mut String) -> fmt::Result {
    let words = comparison.in_words();
    write!(
        out,
        "<h2>Since the earlier campaign</h2><p>{}",
        Escaped(&words)
    )?;
    for note in comparison.left_out() {
        write!(out, "<p class=\"bad\">{}", Escaped(&note))?;
    }
    out.write_str("<table><tr><th>cause<th>is<th>runs now<th>runs before<th>how often")?;
    for cause in &comparison.causes {
        let class = match cause.change {
            Change::New | Change::StillFailing => "bad",
            Change::NotKnown => "",
            Change::Fixed => "good",
        };
        write!(
            out,
            "<tr><td>{}<td class=\"{class}\">{}<td class=\"n\">{}<td class=\"n\">{}<td>{}",
            Escaped(&cause.cause),
            cause.change,
            cause.now.runs,
            cause.earlier.runs,
            Escaped(&cause.in_words())
        )?;
    }
    out.write_str("</table>")
}
