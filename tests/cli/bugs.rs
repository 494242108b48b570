//! The museum from the command line: its list, the output of a reproduction, its error messages.

use super::{Session, text};

#[test]
fn the_list_names_all_rows_by_place_and_counts_them() {
    let output = Session::new("bugs-list").hilrig(&["bugs"]);
    assert_eq!(output.status.code(), Some(0));
    let said = text(&output.stdout);
    let places = said
        .lines()
        .filter(|line| !line.is_empty() && !line.starts_with(' '));
    // Of rescue: base, bus, lidar, mapper, odometry, PC link, navigation, PC program; five of the
    // field report. Of yellow: link, lidar, states, manoeuvres, motion, reactive drive, lines; the
    // PC's link, maps, navigation. Four of apollo13. The sum.
    assert_eq!(places.count(), 13 + 10 + 4 + 1, "{said}");
    assert!(said.contains("\nyellow: PC's program, maps\n"), "{said}");
    let rows = said.lines().filter(|line| {
        let id = line.strip_prefix("  ").unwrap_or_default();
        id.starts_with(|c: char| c.is_ascii_uppercase())
    });
    assert_eq!(rows.count(), 176, "{said}");
    assert!(said.contains("176 defects, 169 reproducible"), "{said}");
}

/// AV-02: bytes of the field-bug catalogue.
#[test]
fn one_defect_is_shown_with_its_bytes_beside_the_sound_program() {
    let output = Session::new("bugs-one").hilrig(&["bugs", "av-02"]);
    assert_eq!(output.status.code(), Some(0));
    insta::assert_snapshot!(text(&output.stdout));
}

#[test]
fn a_reproduction_as_json_holds_both_sides() {
    let output = Session::new("bugs-json").hilrig(&["bugs", "PU-01", "UI-03", "--json"]);
    assert_eq!(output.status.code(), Some(0));
    let shown: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let shown = &shown["result"]["bugs"];
    assert_eq!(shown[0]["id"], "PU-01");
    assert_eq!(shown[0]["defective"]["figures"]["frames received"], "0");
    assert_eq!(shown[0]["sound"]["figures"]["frames received"], "1");
    assert_eq!(shown[1]["holds"], true);
}

#[test]
fn a_mistyped_number_is_refused_with_its_neighbours() {
    let output = Session::new("bugs-typo").hilrig(&["bugs", "AV-3c"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.contains("\"AV-3c\"") && said.contains("AV-03c"),
        "{said}"
    );
}

#[test]
fn a_row_that_is_not_live_is_refused_with_its_reason() {
    let output = Session::new("bugs-not").hilrig(&["bugs", "PU-22"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(said.contains("PU-22 cannot be reproduced: "), "{said}");
}
