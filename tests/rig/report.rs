//! report.html as text: its content, no data of other runs, and no markup from outside texts. Its
//! display in a browser: `tests/page/report.rs`.

use hilrig::show::report;

use super::{in_a_room, run_to_end};

/// A scenario that requires too much of the map, has a name with an attacker's markup, and has a
/// fault on a line.
const WOUNDED: &str = "description = \"<img src=x onerror=alert(1)></script>\"\n\
    [expect]\nwall_overlap_min = 1.0\nviolations_max = 0\n\
    [device.display.touch-panel]\n\
    [[fault]]\nlink = \"base\"\ndirection = \"to-device\"\nkind = \"flip\"\nrate = 0.01\n\
    from = \"2s\"\nuntil = \"3s\"\n";

fn wounded() -> String {
    report::html(&run_to_end(in_a_room("6s", WOUNDED)))
}

/// The report must not contain wall time, addresses or hashing of the host.
#[test]
fn the_same_case_makes_the_same_report() {
    assert!(wounded() == wounded());
}

#[test]
fn a_report_says_what_was_demanded_and_what_came_of_it() {
    let html = wounded();
    assert!(html.contains("<span id=\"verdict\" class=\"fail\">FAIL</span>"));
    assert!(html.contains("<tr class=\"fail\"><td>FAIL</td><td>wall-overlap</td>"));
    assert!(html.contains("<tr class=\"pass\"><td>ok</td><td>bytes-conserved</td>"));
    // All strikes of the fault with a rate are in one row, with the damaged bytes.
    let row = "<td>flip</td><td>base</td><td>to-device</td><td><details><summary>";
    assert_eq!(html.matches(row).count(), 1);
}

/// The description cannot end or begin an element; the policy forbids all loads.
#[test]
fn nothing_of_the_scenario_is_markup() {
    let html = wounded();
    assert!(html.contains("<p>&lt;img src=x onerror=alert(1)&gt;&lt;/script&gt;</p>"));
    assert!(!html.contains("<img"));
    assert_eq!(html.matches("</script>").count(), 4);
    assert!(html.contains("content=\"default-src 'none'; script-src 'nonce-"));
    assert!(!html.contains("://"), "an address");
}

/// The cause stands first; passed checks are folded after it.
#[test]
fn a_failing_report_begins_with_its_cause() {
    let html = wounded();
    let at = |what: &str| html.find(what).unwrap_or_else(|| panic!("no {what}"));
    let cause = at("<p id=\"cause\"><strong>wall-overlap</strong>: ");
    assert!(at("id=\"verdict\"") < cause && cause < at("id=\"tiles\""));
    assert!(at("id=\"tiles\"") < at("<canvas id=\"world\""));
    assert!(at("<tr class=\"fail\">") < at("checks passed</summary>"));
    assert!(at("checks passed</summary>") < at("<tr class=\"pass\">"));
    assert!(html.contains("The walls of the map match the walls of the world."));
}
