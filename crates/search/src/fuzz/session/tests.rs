use std::collections::BTreeMap;

use super::super::engine::Fuzzer;
use super::step::{parse, to_text};
use super::*;

/// Hand-written lines.
const TEXT: &str = "\
lidar FA A0
wait 120 ms
reply count 7E
reply acknowledged
reply flip 03 05
base
reply late 10
";

#[test]
fn a_session_is_read_as_it_is_written() {
    let ports = ["lidar", "base"];
    let steps = parse(TEXT, &ports).expect("a session");
    assert_eq!(to_text(&steps, &ports), TEXT);
    assert_eq!(parse("# nothing\n\n", &ports), Ok(Vec::new()));
}

#[test]
fn a_line_that_is_no_step_is_named() {
    for (text, said) in [
        (
            "wait 5 ms\nradio 00",
            "line 2: \"radio 00\", expected lidar or base with",
        ),
        ("lidar 0", "line 1: \"lidar 0\""),
        ("wait long", "line 1: \"wait long\""),
        ("reply count", "line 1: \"reply count\""),
    ] {
        let error = parse(text, &["lidar", "base"]).expect_err(text);
        assert!(error.starts_with(said), "{error}");
    }
}

/// The causes that `subject` reaches within `cases` cases, or until one begins with `law`.
fn broken(subject: &dyn Subject, cases: u64, law: &str) -> Vec<String> {
    let mut fuzzer = Fuzzer::new(subject, 1, 0, BTreeMap::new());
    for choices in subject.seeds() {
        fuzzer.add(choices);
    }
    let is_found = |cause: &String| !law.is_empty() && cause.starts_with(law);
    while fuzzer.cases() < cases && !fuzzer.causes().keys().any(is_found) {
        fuzzer.round(cases - fuzzer.cases(), 1);
    }
    fuzzer.causes().keys().cloned().collect()
}

/// Far more cases than any of the defects below requires: a wrong judge or model would be noticed
/// here.
#[test]
fn nothing_is_found_in_sound_programs() {
    for subject in programs(&[]).expect("none is unknown") {
        assert_eq!(
            broken(subject.as_ref(), 2000, ""),
            [""; 0],
            "{}",
            subject.name()
        );
    }
}

/// Rows: a defect of the fielded programs, and the law that detects it.
const FIRST: [(&str, &str); 11] = [
    (
        "AV-02",
        "motors-stop-in-silence: after a write that began at register 4",
    ),
    (
        "H-AV-1",
        "motors-stop-in-silence: after a write that began at register 46",
    ),
    ("H-AV-2", "set-points-are-as-written"),
    ("AV-03b", "what-is-not-there-is-refused: write"),
    ("MA-02", "writes-stay-in-their-buffers: reply buffer"),
    ("MA-05", "an-answer-fits-its-question: a read"),
    ("XV-03", "writes-stay-in-their-buffers: distances"),
    ("PU-01", "radio-frames-are-heard"),
    ("PU-03", "the-radio-is-not-deaf"),
    ("PU-07", "the-program-goes-on"),
    ("UI-01", "rows-show-what-was-told: one that was never told"),
];

#[test]
fn defects_that_mattered_in_the_field_are_found_from_nothing() {
    for (id, law) in FIRST {
        let defects = [id.to_owned()];
        let programs = programs(&defects).expect("known");
        let subject = programs
            .iter()
            .find(|subject| !subject.defects().is_empty());
        let causes = broken(subject.expect("one has it").as_ref(), 4000, law);
        assert!(
            causes.iter().any(|cause| cause.starts_with(law)),
            "{id}: {causes:?}"
        );
    }
}

/// The decisive bytes remain: a header with the length -32768.
#[test]
fn a_finding_comes_out_as_the_bytes_that_matter() {
    let defects = ["PU-03".to_owned()];
    let subject = Sessions(rescue::Robot::new(&defects));
    // A typical finding: the header, surrounded by irrelevant steps.
    let text = "lidar FA A0\nradio 50 43 55 49 5F 4D 53 47 10 80 01 02 03 04 53 54 41 07\n\
                wait 600 ms\nreply cut 03\nwait 200 ms\n";
    let steps = parse(text, &Sessions::<rescue::Robot>::names()).expect("a session");
    let fault = subject
        .judged(&steps, &mut Tape::default())
        .expect_err("deaf");
    let small = subject.smallest(&steps, &fault.cause, &mut Effort::tries(1000));
    assert_eq!(
        Sessions::<rescue::Robot>::text(&small),
        "radio 50 43 55 49 5F 4D 53 47 00 80\n"
    );
}
