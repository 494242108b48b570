//! report.html from disk, in a real browser without a network.

use std::path::Path;

use core::time::Duration;

use fantoccini::actions::KeyAction;
use hilrig::run::Run;
use hilrig::run::check::Status;
use hilrig::scenario::Scenario;
use hilrig::show::folder as results;

use super::browser::Browser;
use super::server::folder;

/// The right arrow key, as WebDriver names it.
const RIGHT: char = '\u{E014}';

/// The first seconds of the demo with a fault, and an expectation on the map that they cannot meet.
fn case() -> String {
    let text = include_str!("../../scenarios/rescue-flat.toml");
    let text = text.replace("\"180s\"", "\"9s\"");
    let fault = "[[fault]]\nlink = \"base\"\ndirection = \"to-device\"\nkind = \"flip\"\n\
                 rate = 0.01\nfrom = \"2s\"\nuntil = \"3s\"\n";
    format!("{text}\n{fault}")
}

/// The file is opened without a server and requests no further resource. It shows the verdicts,
/// jumps to an event, continues by key, and hides layers. The console stays empty; the browser
/// would report violations of the policy there.
#[test]
fn a_report_opens_from_disk_without_a_network() {
    let dir = folder("report");
    let (scenario, source) = Scenario::parse(Path::new("<case>"), case()).expect("sound");
    let outcome = Run::new(scenario, &source, None).expect("wired").finish();
    results::write(&dir, &outcome, Duration::ZERO).expect("written");
    let Some(browser) = Browser::start() else {
        return;
    };
    browser.go(&format!("file://{}/report.html", dir.display()));

    assert_eq!(
        browser.value("document.getElementById('verdict').textContent"),
        "FAIL"
    );
    let rows = "document.querySelectorAll('#checks tr').length";
    assert_eq!(browser.value(rows), outcome.checks.len());
    let failed = "document.querySelector('#checks tr.fail td:nth-child(2)').textContent";
    let mut checks = outcome.checks.iter();
    let first = checks.find(|check| check.status == Status::Fail);
    assert_eq!(browser.value(failed), first.expect("too short a run").name);

    let time = "Number(document.getElementById('time').value)";
    // The report opens at the first failed check: the fault acts from 2 s to 3 s.
    let failed = browser.value(time).as_f64().expect("a time");
    assert!((2.0..=3.5).contains(&failed), "{failed}");
    let event = "Number(document.querySelector('#events .jump').dataset.at)";
    let at = browser.value(event).as_f64().expect("a time");
    assert!(at < 8.0, "{at}");
    let seen = "document.getElementById('world').toDataURL()";
    let at_first = browser.value(seen);
    browser.click("#events .jump");
    let shown = browser.value(time).as_f64().expect("a time");
    // The slider has steps of 50 ms.
    assert!((shown - at).abs() <= 0.025, "{shown} for {at}");
    assert_ne!(browser.value(seen), at_first);

    browser.value("document.getElementById('time').focus()");
    browser.key(KeyAction::Down { value: RIGHT });
    browser.key(KeyAction::Up { value: RIGHT });
    let on = browser.value(time).as_f64().expect("a time");
    assert!((on - shown - 0.05).abs() < 1e-6, "{shown} to {on}");

    let with = browser.value(seen);
    browser.click("#show-world");
    assert_ne!(browser.value(seen), with);

    assert_eq!(
        browser.value("performance.getEntriesByType('resource').length"),
        0
    );
    browser.value("console.error('the end')");
    assert_eq!(browser.console("the end"), Vec::<String>::new());

    // The display's picture equals display.png, compared at its middle and a corner.
    let picture = outcome.display.as_ref().expect("the demo has one");
    for [x, y] in [[240, 136], [3, 3], [280, 90]] {
        let pixel = "document.getElementById('display').getContext('2d')";
        let pixel = browser.value(&format!("[...{pixel}.getImageData({x}, {y}, 1, 1).data]"));
        let [red, green, blue] = picture.get(x, y).expect("inside");
        assert_eq!(pixel, serde_json::json!([red, green, blue, 255]));
    }
}
