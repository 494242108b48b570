//! A campaign as a self-contained HTML file.

use core::fmt::{self, Write as _};
use core::time::Duration;

use super::strip::class;
use super::{CampaignPlan, Change, Comparison, Demand, Failures, Merged};
use show::html::Escaped;
use show::meaning::meaning;

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
    out.write_str("<h1>Campaign</h1>")?;
    let failed: usize = failures.iter().map(|failures| failures.runs).sum();
    match failed {
        0 => out.write_str("<p id=\"verdict\">no failure so far<p>")?,
        failed => write!(
            out,
            "<p id=\"verdict\" class=\"fail\"><b>\u{2717}</b> {failed} runs failed so far<p>"
        )?,
    }
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
    out.write_str("<h1>Campaign</h1>")?;
    write_verdict(merged, out)?;
    write_causes(merged, out)?;
    if let Some(comparison) = &merged.comparison {
        write_comparison(comparison, out)?;
    }
    write_situations(merged, out)?;
    out.write_str("<h2>Plan</h2><p>")?;
    write_plan(&merged.plan, out)?;
    write!(
        out,
        " {} of virtual time.<p>Trace <code>{}</code>",
        merged.virtual_time(),
        merged.trace
    )?;
    out.write_str("</main>\n</html>\n")
}

/// Writes one word in green or red, and the reasons of a failure. A situation that never occurred
/// is a failure only on demand.
fn write_verdict(merged: &Merged, out: &mut String) -> fmt::Result {
    let reasons = reasons(merged);
    let (class, word) = match reasons.is_empty() {
        true => ("pass", "\u{2713} PASS"),
        false => ("fail", "\u{2717} FAIL"),
    };
    let passed = merged.runs - merged.failed;
    write!(
        out,
        "<p id=\"verdict\" class=\"{class}\"><b>{word}</b> {passed} of {} runs passed",
        merged.runs
    )?;
    for reason in reasons {
        write!(out, "<br>{}", Escaped(&reason))?;
    }
    Ok(())
}

/// Why a campaign failed; empty if it passed.
fn reasons(merged: &Merged) -> Vec<String> {
    let mut reasons = Vec::new();
    if merged.failed > 0 {
        let causes = match merged.groups.len() {
            1 => "1 cause".to_owned(),
            causes => format!("{causes} causes"),
        };
        reasons.push(format!("{} failed, with {causes}", runs(merged.failed)));
    }
    let needed = merged.missed_situations();
    let needed = needed.filter(|_| merged.demand == Demand::Needed);
    let lists: [(&str, Vec<&str>); 3] = [
        ("no run had", needed.collect()),
        ("no run reached", merged.missed_goals().collect()),
        ("no run observed", merged.unobserved_rules().collect()),
    ];
    let lists = lists.into_iter().filter(|(_, names)| !names.is_empty());
    reasons.extend(lists.map(|(what, names)| format!("{what}: {}", names.join(", "))));
    if merged.missing > 0 {
        let verb = if merged.missing == 1 { "is" } else { "are" };
        reasons.push(format!("{} {verb} missing", runs(merged.missing)));
    }
    reasons
}

fn runs(count: usize) -> String {
    match count {
        1 => "1 run".to_owned(),
        count => format!("{count} runs"),
    }
}

/// The reason why a cause has no picture.
const fn no_picture(plan: &CampaignPlan, case: Option<&String>) -> &'static str {
    match (case, &plan.exec) {
        (None, _) => "<p>No picture: the folder has no case of this failure.",
        (Some(_), Some(_)) => {
            "<p>No picture: the failure needs the program under test. The command below writes a \
             report of it."
        }
        (Some(_), None) => {
            "<p>No picture: the smallest case did not run to its end. The command below shows why."
        }
    }
}

/// Name of a failed check, and its requirement.
fn named(cause: &str) -> String {
    match meaning(cause) {
        Some(meaning) => format!("check {cause}. {meaning}"),
        None => format!("check {cause}"),
    }
}

/// Writes a card for each cause, the most frequent first.
fn write_causes(merged: &Merged, out: &mut String) -> fmt::Result {
    if merged.groups.is_empty() {
        return Ok(());
    }
    out.write_str("<h2>Failures by cause, the most frequent first</h2>")?;
    let names: Vec<&str> = merged.groups.iter().map(|group| &*group.cause).collect();
    merged.strip.write(&names, out)?;
    out.write_str("<ol class=\"causes\">")?;
    for (number, group) in merged.groups.iter().enumerate() {
        let (scenario, seed) = &group.first;
        write!(
            out,
            "<li class=\"{}\"><h3>{}</h3><p><small>{}</small><p><b>{} of {} runs</b> <progress \
             max=\"{}\" value=\"{}\" aria-label=\"share of all runs\"></progress>",
            class(Some(number)),
            Escaped(&group.detail),
            Escaped(&named(&group.cause)),
            group.runs,
            merged.runs,
            merged.runs,
            group.runs,
        )?;
        let picture = group.picture.as_deref();
        out.write_str(picture.unwrap_or(no_picture(&merged.plan, group.case.as_ref())))?;
        if let (Some(case), Some(left)) = (&group.case, &group.left) {
            let (case, left) = (Escaped(case), Escaped(left));
            let which = match group.is_minimised {
                true => "smallest case",
                false => "case of the first run",
            };
            write!(out, "<p>{which}: <a href=\"{case}\">{case}</a>. {left}")?;
            let exec = Escaped(merged.plan.exec.as_deref().unwrap_or_default());
            write!(out, "<p><code>hilrig run {case}{exec}</code>")?;
            if !group.is_minimised {
                write!(
                    out,
                    "<p>make it small: <code>hilrig shrink {case}{exec}</code>"
                )?;
            }
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

/// Writes the situations that the runs covered, and those that no run covered. They are no part of
/// the verdict.
fn write_situations(merged: &Merged, out: &mut String) -> fmt::Result {
    let met = merged.situations.iter().filter(|one| one.runs > 0);
    let met: Vec<_> = met.collect();
    let never: Vec<&str> = merged.missed_situations().collect();
    let lost: Vec<&str> = merged.lost_rules().collect();
    if merged.situations.is_empty() {
        return Ok(());
    }
    out.write_str("<h2>Coverage</h2>")?;
    let situations = match merged.demand {
        Demand::Listed => {
            "Situations that did not occur in these runs, a failure with --all-situations only"
        }
        Demand::Needed => "Situations that did not occur in these runs, a failure",
    };
    let lists = [
        (situations, never),
        ("Not judged, because no generated mission has it", lost),
    ];
    for (what, names) in lists.iter().filter(|(_, names)| !names.is_empty()) {
        write!(out, "<p>{what}: {}.", Escaped(&names.join(", ")))?;
    }
    write!(out, "<details><summary>Occurred: {}</summary>", met.len())?;
    out.write_str("<table><tr><th>situation, goal or rule<th>runs")?;
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
