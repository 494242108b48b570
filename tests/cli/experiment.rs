//! The figures of the reports, judged.

use serde_json::Value;

use super::{Session, text};

/// Runs a command that must end with `code`; its output.
fn run(session: &Session, line: &str, code: i32) -> (String, String) {
    let words: Vec<&str> = line.split(' ').collect();
    let output = session.hilrig(&words);
    let (said, told) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{line}\n{said}\n{told}");
    (said.to_owned(), told.to_owned())
}

/// Two rows that are measured and one that is refused, by one seed: the pages, the plots, and the
/// words that this is not all. With the planted changes, the verdicts are the other ones.
#[test]
fn rows_of_the_reports_are_judged() {
    let session = Session::new("experiment");
    let line = "experiment --all --rows rescue-ramp,rescue-byte,rescue-blocks --seeds 1 --out o";
    let (said, told) = run(&session, line, 0);
    assert!(
        said.contains("1 reproduced, 1 differ, 0 by construction, 1 refused, 0 not run"),
        "{said}"
    );
    assert!(said.contains("partial: not all rows"), "{said}");
    // 10 bits of 460800 a second.
    assert!(
        said.contains("time of a byte (us): 0 of 1 runs inside 17.35 to 17.37, median 21.701"),
        "{said}"
    );
    assert!(told.contains("3 of 3: rescue-byte differs"), "{told}");
    for file in [
        "partial.md",
        "partial.html",
        "rescue-ramp.svg",
        "rescue-byte.svg",
    ] {
        assert!(session.path("o").join(file).is_file(), "{file}");
    }
    let page = std::fs::read_to_string(session.path("o/partial.md")).expect("a page");
    assert!(page.contains("**Partial: 3 of "), "{page}");
    assert!(!session.path("o/experiments.md").exists());
    run(&session, &format!("{line} --planted"), 0);
    let planted = std::fs::read_to_string(session.path("o/planted.md")).expect("a page");
    assert!(planted.starts_with("PLANTED CHANGES: "), "{planted}");
    let kept = std::fs::read_to_string(session.path("o/partial.md")).expect("a page");
    assert_eq!(kept, page);

    let (said, _) = run(&session, &format!("{line} --json"), 0);
    let said: Value = serde_json::from_str(&said).expect("JSON");
    let row = &said["result"]["rows"][2];
    assert_eq!(
        (&row["verdict"], &row["is_expected"]),
        (&"differs".into(), &true.into())
    );
    assert_eq!(said["result"]["is_partial"], true);
    assert_eq!(said["result"]["planted"], false);
}

#[test]
fn an_unknown_row_is_an_error_that_names_the_rows() {
    let session = Session::new("experiment-errors");
    let (_, told) = run(&session, "experiment --all --rows rescue-pus", 2);
    assert!(
        told.contains("--rows: unknown row \"rescue-pus\"; expected one of rescue-parts, "),
        "{told}"
    );
    // Options of `--all` are errors without it, and beside a named experiment.
    for line in [
        "experiment --rows rescue-push",
        "experiment --planted",
        "experiment push --all",
        "experiment push --rows rescue-push",
        "experiment push --planted",
    ] {
        run(&session, line, 2);
    }
}
