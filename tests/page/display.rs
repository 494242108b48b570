//! The robot's display on the page: its picture, and the effect of a click.

use hilrig::show::render;
use serde_json::json;

use super::again;
use super::browser::Browser;
use super::server::Server;

/// All pixels of the page's picture, red, green and blue.
const PIXELS: &str = "Array.from(document.getElementById('screen').getContext('2d')\
    .getImageData(0, 0, 480, 272).data).filter((_, index) => index % 4 !== 3)";

/// A click on the settings tab shows the settings. Every pixel is equal to the robot's display at
/// that nanosecond, and the saved session contains the same tap.
#[test]
fn a_click_on_the_robots_display_touches_it() {
    let server = Server::held_on("rescue-flat", "4", "display");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    browser.wait("hilrig.maps.display && !document.getElementById('display').hidden");
    let touch = "(() => { const box = document.getElementById('screen').getBoundingClientRect(); \
        document.getElementById('screen').dispatchEvent(new MouseEvent('click', { \
        clientX: box.left + 400.5 * box.width / 480, \
        clientY: box.top + 256.5 * box.height / 272 })); return true; })()";
    browser.value(touch);
    browser.wait("hilrig.events.some((event) => event.rule === 'tapped')");
    let tapped = "hilrig.events.find((event) => event.rule === 'tapped').detail";
    let tapped = browser.value(tapped);
    // Mouse events have whole pixels of a page on which the picture is smaller.
    let near = |x: i32| (399..=401).contains(&x);
    let places = tapped
        .as_str()
        .and_then(|text| text.strip_prefix("at ")?.split_once(", "));
    let place = places.and_then(|(x, y)| Some((x.parse().ok()?, y.parse::<i32>().ok()?)));
    let is_near = place.is_some_and(|(x, y)| near(x) && near(y + 144));
    assert!(is_near, "{tapped}");
    // The drawing arrived in frames, all valid.
    let drawn = "hilrig.slow.lanes.find((lane) => lane.name === 'display')['to-device'].tally";
    browser.wait(&format!("{drawn}.frames > 100 && {drawn}.errors === 0"));
    let at = browser.value("hilrig.now.at_ns").as_u64().expect("a time");
    browser.wait(&format!("hilrig.now.at_ns > {at} + 2e9"));

    let at_ns = browser.pause();
    let run = again(&server.case(), at_ns);
    assert_eq!(browser.value("hilrig.slow.trace"), run.rig.trace_hash());
    let panel = run.instruments().display(&run.rig).expect("it has one");
    let held = render::display(panel);
    assert!(
        browser.value(PIXELS) == json!(held.pixels().as_flattened()),
        "other pixels"
    );
    // The tab is lit: not the gray of a button.
    assert_ne!(held.get(330, 245), held.get(10, 245));
}
