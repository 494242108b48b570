//! A campaign as one HTML file that opens anywhere, without a network.

use core::fmt::{self, Write as _};
use core::time::Duration;

use super::{CampaignPlan, Change, Comparison, Failures, Merged};
use crate::html::Escaped;

const HEAD: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
    <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
    <title>hilrig campaign</title><style>\
    body{font:15px/1.5 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;\
    color:#222;background:#fff}table{border-collapse:collapse;width:100%}\
    th,td{border:1px solid #ccc;padding:.3em .6em;text-align:left;vertical-align:top}\
    th{background:#f2f2f2}td.n{text-align:right}code{font-size:.9em;white-space:pre-wrap}\
    .bad{color:#a00}.good{color:#070}\
    td{overflow-wrap:anywhere}\
    @media(prefers-color-scheme:dark){:root{color-scheme:dark}body{color:#e6e6e6;background:#16191d}\
    th{background:#22262b}th,td{border-color:#363c44}.bad{color:#ff8a80}.good{color:#66d19e}}\
    @media(max-width:600px){body{margin:1em auto}table,tbody,tr,td{display:block;border:0}\
    th{display:none}tr{border-top:1px solid #888;padding:.4em 0}td{padding:.1em 0}\
    td.n{text-align:left;font-weight:bold}}</style>";

/// The page of `merged`.
pub(crate) fn page(merged: &Merged) -> String {
    let mut out = String::from(HEAD);
    write_page(merged, &mut out).expect("a string takes everything");
    out
}

/// The page of a campaign of which only the `failures` are known; `far` says how far it is. It
/// loads itself anew in each `period`, if there is one.
pub(crate) fn live_page(
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
    out.write_str("</table></html>\n")
}

/// What is run: scenarios, seeds, what is varied.
fn write_plan(plan: &CampaignPlan, out: &mut String) -> fmt::Result {
    let names: Vec<&str> = plan.scenarios.keys().map(String::as_str).collect();
    write!(
        out,
        "{}, seeds {} to {}, varied: {}.",
        Escaped(&names.join(", ")),
        plan.seeds.start,
        plan.seeds.end.saturating_sub(1),
        Escaped(&plan.vary)
    )
}

fn write_page(merged: &Merged, out: &mut String) -> fmt::Result {
    let verdict = match merged.failed {
        0 => "<b class=\"good\">all pass</b>".to_owned(),
        failed => format!("<b class=\"bad\">{failed} fail</b>"),
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
    write_groups(merged, out)?;
    if let Some(comparison) = &merged.comparison {
        write_comparison(comparison, out)?;
    }
    out.write_str("<h2>Situations that must come up</h2><table><tr><th>what<th>runs")?;
    for count in &merged.situations {
        let class = if count.runs == 0 { "n bad" } else { "n" };
        let name = Escaped(&count.situation);
        write!(out, "<tr><td>{name}<td class=\"{class}\">{}", count.runs)?;
    }
    out.write_str("</table></html>\n")
}

fn write_groups(merged: &Merged, out: &mut String) -> fmt::Result {
    out.write_str(
        "<h2>Failures by cause</h2><table><tr><th>cause<th>runs<th>first<th>what it says\
         <th>smallest case",
    )?;
    for group in &merged.groups {
        let (scenario, seed) = &group.first;
        write!(
            out,
            "<tr><td>{}<td class=\"n\">{}<td>{} seed {seed}<td>{}<td>",
            Escaped(&group.cause),
            group.runs,
            Escaped(scenario),
            Escaped(&group.detail)
        )?;
        if let (Some(case), Some(left)) = (&group.case, &group.left) {
            let (case, left) = (Escaped(case), Escaped(left));
            write!(out, "<a href=\"{case}\">{case}</a><br>{left}<br>")?;
            write!(out, "<code>hilrig run {case}</code>")?;
        }
    }
    out.write_str("</table>")
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
