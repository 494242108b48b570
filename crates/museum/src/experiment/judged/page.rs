//! The page with all rows, as Markdown and as HTML.

use core::fmt::Write as _;

use super::super::table::rounded;
use super::{Band, Judged, JudgedBand, Model, Report, Row, Verdict, rows};
use show::html::escape;

/// Reports in the order of the page.
const REPORTS: [Report; 3] = [Report::Rescue, Report::Car, Report::Yellow];

/// The beginning of the page.
const HEAD: &str = "# The reports' figures in the rig\n\n\
    The three robots come from three student reports. This page has rows for their figures, tables and\n\
    measured statements. Each row is measured in virtual time over ten seeds, or by the medians of twenty\n\
    seeds where it says that. A band holds if its share of the runs lies inside:\n\
    all, or nine of ten. A row whose bands all hold is **reproduced**, else it **differs**. A row whose\n\
    values follow from the rig's own settings is **by construction**: it shows that the rig is consistent,\n\
    and does not count. A row that shows nothing measurable is **refused**. Column \"rig\" has the median\n\
    and the quartiles, for reading only.\n\n\
    The limits of a band come from the scatter of the report's own figure or from a physical reason, never\n\
    from a run of the rig. With a planted change of the model the row has the other verdict. That proves\n\
    the row, not each of its bands. For a row that differs, the planted change is the cause that was found;\n\
    an open row has no such change yet. A row may differ because **the report is in error**: its paragraph has the\n\
    evidence.\n\n\
    The command writes this page, an HTML page with a plot for each row, and, with `--json`, all values:\n\n\
    ```sh\nhilrig experiment --all --out experiments\n\
    hilrig experiment --all --planted\n\
    hilrig experiment --all --rows rescue-push,car-wall\n```\n\n\
    The exit code is 1 if a row that must be reproduced differs.\n\n";

/// First line of a page of planted changes.
const PLANTED: &str = "PLANTED CHANGES: the model of each row is wrong on purpose.";

/// Addition to the verdict on a row that shows an error of the report.
const REFUTED: &str = ", the report is in error";

/// The page as Markdown: the sums, a table of all rows, and a section for each row.
pub fn markdown(judged: &[Judged], model: Model) -> String {
    let mut page = match model {
        Model::Sound => String::from(HEAD),
        Model::Planted => format!("{PLANTED}\n\n{HEAD}"),
    };
    let mut add = |text: &str| page.push_str(text);
    add(&sums(judged));
    add("\n| row | report | place | verdict |\n|---|---|---|---|\n");
    for one in judged {
        let row = one.row;
        add(&format!(
            "| [{0}](#{0}) | {1} | {2} | {3} |\n",
            row.name,
            row.report.name(),
            row.place,
            shown(one)
        ));
    }
    for report in REPORTS {
        let of_report = judged.iter().filter(|one| one.row.report == report);
        for (index, one) in of_report.enumerate() {
            if index == 0 {
                add(&format!("\n## The report of the {}\n", titled(report)));
            }
            add(&section(one));
        }
    }
    page
}

fn titled(report: Report) -> &'static str {
    match report {
        Report::Rescue => "rescue robot (2015)",
        Report::Car => "model car (2016)",
        Report::Yellow => "Yellow (2019)",
    }
}

/// Number of rows for each verdict, as text.
fn sums(judged: &[Judged]) -> String {
    let of = |verdict: Verdict| judged.iter().filter(|one| one.verdict == verdict).count();
    let measured = of(Verdict::Reproduced) + of(Verdict::Differs);
    let is_error = |one: &&Judged| one.verdict == Verdict::Differs && one.row.refuted;
    let errors = judged.iter().filter(is_error).count();
    let mut text = format!(
        "Figures, tables and statements: {}. Measured: {measured}, of which reproduced: {}, different: {},\n\
         of which {errors} show an error of the report.\n\
         By construction, as they follow from the rig's own settings: {}. Refused, as they show nothing that\n\
         a run could measure: {}.",
        judged.len(),
        of(Verdict::Reproduced),
        of(Verdict::Differs),
        of(Verdict::ByConstruction),
        of(Verdict::Refused),
    );
    if of(Verdict::NotRun) > 0 {
        write!(
            text,
            "\n**Interrupted: {} rows were not run.**",
            of(Verdict::NotRun)
        )
        .expect("a string takes everything");
    }
    if judged.len() < rows().len() {
        write!(
            text,
            "\n**Partial: {} of {} rows.**",
            judged.len(),
            rows().len()
        )
        .expect("a string takes everything");
    }
    let few = judged.iter().filter(|one| one.is_of_few_seeds()).count();
    if few > 0 {
        write!(
            text,
            "\n**Partial: {few} rows have fewer than {} seeds.**",
            super::SEEDS
        )
        .expect("a string takes everything");
    }
    text + "\n"
}

/// The verdict, and whether it is unexpected.
fn shown(one: &Judged) -> String {
    let error = match one.verdict {
        Verdict::Differs if one.row.refuted => REFUTED,
        _ => "",
    };
    let name = format!("{}{error}", one.verdict.name());
    match one.is_as_expected() {
        true => name,
        false => format!("**{name}, unexpected**"),
    }
}

fn section(one: &Judged) -> String {
    let row = one.row;
    let mut text = format!("\n### {}\n\n{}: {}\n", row.name, row.place, row.what);
    if let Some(refused) = &row.refused {
        write!(text, "\nRefused: {refused}\n").expect("a string takes everything");
        return text;
    }
    if !one.bands.is_empty() {
        text.push_str("\n| value | report | band | rig: median (quartiles) | runs inside |\n|---|---|---|---|---|\n");
        for judged in &one.bands {
            text.push_str(&line(judged));
        }
    }
    text.push_str(&because(row));
    let seeds = match one.verdict {
        Verdict::NotRun => String::new(),
        _ => format!(" {} seeds.", one.seeds),
    };
    write!(text, "\nVerdict: {}.{seeds}\n", shown(one)).expect("a string takes everything");
    text
}

/// A band's line of the table: its first three columns do not depend on a run.
fn line(judged: &JudgedBand) -> String {
    let values = judged.values.len();
    let [low, high] = judged.quartiles();
    let ours = match values {
        0 => "no value".to_owned(),
        1 => rounded(judged.median()),
        _ => format!(
            "{} ({} to {})",
            rounded(judged.median()),
            rounded(low),
            rounded(high)
        ),
    };
    let holds = if judged.holds { "yes" } else { "**no**" };
    format!(
        "{} | {ours} | {holds}, {} of {values} |\n",
        static_line(judged.band),
        judged.inside()
    )
}

fn static_line(band: &Band) -> String {
    let share = match band.share {
        1.0 => "all runs".to_owned(),
        share => format!("{} % of the runs", rounded(100.0 * share)),
    };
    format!(
        "| {} | {} | {} to {}, {share}",
        band.of,
        band.report,
        rounded(band.least),
        rounded(band.most)
    )
}

/// Sources of the bands, the note, and the planted change.
fn because(row: &Row) -> String {
    let mut text = String::from("\nBands: ");
    let mut said: Vec<&str> = Vec::new();
    for band in &row.bands {
        if !said.contains(&band.because.as_str()) {
            said.push(&band.because);
        }
    }
    text.push_str(&said.join(" "));
    text.push('\n');
    if !row.note.is_empty() {
        write!(text, "\n{}\n", row.note).expect("a string takes everything");
    }
    if row.open {
        text.push_str("\nOpen: no change of the model was found that reproduces the row.\n");
    } else if let Some(measure) = row.measure() {
        let verdict = if row.differs {
            "is reproduced"
        } else {
            "differs"
        };
        write!(
            text,
            "\nWith a planted change, the row {verdict}: {}.\n",
            measure.planted
        )
        .expect("a string takes everything");
    }
    text
}

/// The parts of the page that do not depend on a run, row by row: for the test that holds the
/// documentation.
pub fn static_part() -> Vec<(&'static str, Vec<String>)> {
    let of = |row: &'static Row| {
        let mut parts = vec![format!("{}: {}", row.place, row.what)];
        parts.extend(row.refused.iter().map(|why| format!("Refused: {why}")));
        parts.extend(row.bands.iter().map(static_line));
        if row.refused.is_none() {
            parts.push(because(row).trim().to_owned());
            let verdict = match (row.differs, row.given) {
                (true, _) => "differs",
                (false, true) => "by construction",
                (false, false) => "reproduced",
            };
            let error = if row.refuted { REFUTED } else { "" };
            parts.push(format!("Verdict: {verdict}{error}."));
        }
        (row.name.as_str(), parts)
    };
    rows().iter().map(of).collect()
}

/// The page as HTML, with the plots beside it.
pub fn html(judged: &[Judged], model: Model) -> String {
    let mut body = String::new();
    let (planted, before) = match model {
        Model::Sound => ("", ""),
        Model::Planted => (PLANTED, "planted-"),
    };
    for one in judged {
        let row = one.row;
        write!(
            body,
            "<section id=\"{0}\"><h2>{0}: {1}</h2><p>{2}, {3}: {4}</p>",
            escape(&row.name),
            escape(one.verdict.name()),
            escape(row.report.name()),
            escape(&row.place),
            escape(&row.what)
        )
        .expect("a string takes everything");
        if let Some(refused) = &row.refused {
            write!(body, "<p>{}</p>", escape(refused)).expect("a string takes everything");
        }
        if !one.bands.is_empty() {
            body.push_str(
                "<table><tr><th>value</th><th>report</th><th>band</th><th>rig: median (quartiles)</th><th>runs inside</th></tr>",
            );
            for judged in &one.bands {
                let line = line(judged).replace("**", "");
                let cells = line.trim().trim_matches('|').split('|');
                let cells = cells.map(|cell| format!("<td>{}</td>", escape(cell.trim())));
                write!(body, "<tr>{}</tr>", cells.collect::<String>())
                    .expect("a string takes everything");
            }
            body.push_str("</table>");
        }
        if one.plot.is_some() {
            write!(
                body,
                "<img src=\"{before}{0}.svg\" alt=\"plot of {0}\">",
                escape(&row.name)
            )
            .expect("a string takes everything");
        }
        for text in because(row).split("\n\n").filter(|_| row.refused.is_none()) {
            write!(body, "<p>{}</p>", escape(text.trim())).expect("a string takes everything");
        }
        body.push_str("</section>\n");
    }
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <title>The reports' figures in the rig</title><style>\
         body{{font-family:sans-serif;max-width:60em;margin:auto;padding:1em}}\
         td,th{{border:1px solid #ccc;padding:.2em .5em;text-align:left}}\
         table{{border-collapse:collapse}}img{{max-width:100%}}</style></head><body>\
         <p><b>{planted}</b></p><h1>The reports' figures in the rig</h1><p>{}</p>\n{body}</body></html>\n",
        escape(&sums(judged).replace("**", ""))
    )
}

#[cfg(test)]
mod tests {
    use super::super::{Plan, judge, select};
    use super::*;

    const PAGE: &str = include_str!("../../../../../docs/experiments.md");

    /// The section of a row in the documentation.
    fn section_of(name: &str) -> &'static str {
        let title = format!("### {name}\n");
        let (_, rest) = PAGE
            .split_once(&title)
            .unwrap_or_else(|| panic!("{name} is missing"));
        rest.split("\n#").next().unwrap_or_default()
    }

    /// The documentation is a page that the command wrote. It has each row with its source, its
    /// bands, its reasons and the expected verdict, in the same order. `tests/run.sh --all`
    /// compares the values as well.
    #[test]
    fn the_page_of_the_documentation_has_all_rows() {
        assert!(PAGE.starts_with(HEAD));
        for (name, parts) in static_part() {
            for part in parts {
                assert!(
                    section_of(name).contains(&part),
                    "{name}: the page lacks {part}"
                );
            }
        }
        let titles = PAGE.lines().filter_map(|line| line.strip_prefix("### "));
        assert!(titles.eq(rows().iter().map(|row| row.name.as_str())));
        assert!(!PAGE.contains("unexpected") && !PAGE.contains("Partial"));
    }

    /// Rows with a short run.
    const QUICK: [&str; 6] = [
        "rescue-lidar",
        "rescue-ramp",
        "rescue-byte",
        "car-heights",
        "yellow-local-map",
        "yellow-roadmap",
    ];

    /// Quick rows have the expected verdict, and the other one with their planted change.
    #[test]
    fn a_planted_change_turns_the_verdict() {
        let rows = select(&QUICK.map(str::to_owned)).expect("known rows");
        let plan = Plan {
            first_seed: 1,
            seeds: 2,
            jobs: 1,
        };
        for (model, is_expected) in [(Model::Sound, true), (Model::Planted, false)] {
            judge(&rows, &plan, model, &|_, _, _| {}, &mut |one| {
                let values = one.bands.iter().map(|band| (&band.band.of, band.median()));
                let values: Vec<_> = values.collect();
                assert_eq!(
                    one.is_as_expected(),
                    is_expected,
                    "{}: {values:?}",
                    one.row.name
                );
                assert!(one.is_of_few_seeds());
            });
        }
    }

    /// An interrupted page says so, and which rows it lacks.
    #[test]
    fn a_page_that_is_not_whole_says_so() {
        let rows = select(&[]).expect("all rows");
        let judged: Vec<Judged> = rows.iter().map(|row| Judged::not_run(row)).collect();
        let page = markdown(&judged, Model::Sound);
        assert!(page.contains(&format!("Interrupted: {} rows were not run", judged.len())));
        assert!(page.contains("Verdict: not run."));
        let planted = markdown(&judged[..1], Model::Planted);
        assert!(planted.contains(&format!("Partial: 1 of {} rows", judged.len())));
        assert!(planted.starts_with("PLANTED CHANGES") && !page.contains("PLANTED"));
    }
}
