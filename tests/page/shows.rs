//! The page shows the actual run: it is compared with a repetition from its case.

use firmware_core::robots::rescue::Rescue;
use hilrig::robots::rescue::pc_program;
use hilrig::show::view::millimetres;
use serde_json::{Value, json};

use super::browser::Browser;
use super::server::Server;
use super::{again, plain};

/// Number of cells of a map that are not unknown.
const KNOWN: &str =
    "(hilrig.maps.robot ? hilrig.maps.robot.cells.filter((c) => c !== 127).length : 0)";

fn cells(browser: &Browser, map: &str) -> Vec<u8> {
    let cells = browser.value(&format!("Array.from(hilrig.maps.{map}.cells)"));
    let cells = cells.as_array().expect("an array").iter();
    let cell = |cell: &Value| u8::try_from(cell.as_u64().expect("a number"));
    cells.map(|value| cell(value).expect("a byte")).collect()
}

/// The map grows on the page; then the run is paused. Every cell of both maps, the poses and the
/// waypoints equal those of the program, the PC and the world at that nanosecond.
#[test]
fn maps_poses_and_waypoints_are_those_of_the_core_at_that_time() {
    let server = Server::held("rescue-flat", "4");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    // The run starts from the beginning, slowly enough for a browser on a busy machine.
    browser.set("#speed", "0.25");
    browser.wait("hilrig.now.speed === 0.25");
    browser.click("#more summary");
    browser.click("#restart");
    browser.wait("hilrig.stage && hilrig.stage.run === 2 && hilrig.now && hilrig.now.run === 2");
    browser.pause();
    browser.set("#step-ms", "1000");
    let mut known = browser.value(KNOWN).as_u64().expect("a count");
    for _ in 0..3 {
        let next = browser.pause() + 1_000_000_000;
        browser.click("#step");
        browser.wait(&format!("hilrig.now.at_ns === {next}"));
        browser.pause();
        let before = known;
        known = browser.value(KNOWN).as_u64().expect("a count");
        assert!(known > before, "{known} cells after {before}");
    }
    browser.set("#speed", "4");
    browser.click("#play");
    browser.wait("hilrig.now.pc.rows_missing === 0 && hilrig.scan");
    let at_ns = browser.pause();

    let case = server.case();
    let run = again(&case, at_ns);
    assert_eq!(browser.value("hilrig.slow.trace"), run.rig.trace_hash());
    let program = run.rig.program().expect("in this process");
    let map = program.map().expect("it has a map");
    let held: Vec<u8> = map.cells().to_vec();
    assert!(cells(&browser, "robot") == held, "the robot's map differs");
    let pc = run.rig.device::<emulators::pc::Pc>("pc").expect("emulated");
    let received = &pc.map().expect("received").pixels;
    assert!(&cells(&browser, "pc") == received, "the PC's map differs");

    let (_, pose) = program.estimate().expect("it has matched");
    let [x, y, theta] = [pose.x_mm, pose.y_mm, pose.heading].map(f64::from);
    let believed = [x / 1000.0, y / 1000.0, theta].map(millimetres);
    let told = plain(browser.value("hilrig.now.believed"));
    assert_eq!(told, plain(json!(believed)));
    let pose = run.rig.world.pose();
    let truth = [pose.x, pose.y, pose.theta].map(millimetres);
    let told = plain(browser.value("hilrig.now.truth"));
    assert_eq!(told, plain(json!(truth)));
    assert_eq!(browser.value("hilrig.now.mode"), program.mode());

    let robot: &dyn core::any::Any = program;
    let robot: &Rescue = robot.downcast_ref().expect("the rescue robot");
    let waypoints: Vec<[i16; 2]> = robot
        .waypoints()
        .all()
        .iter()
        .map(|w| w.position_mm)
        .collect();
    assert_eq!(waypoints.len(), 7);
    assert_eq!(browser.value("hilrig.now.pc.waypoints"), json!(waypoints));
    assert_eq!(pc_program::waypoints(pc), waypoints);
}

/// A reloaded page begins empty and ends with the same content.
#[test]
fn a_page_that_is_loaded_again_shows_the_same() {
    let server = Server::held("two-rooms", "10");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    browser.wait(&format!("{KNOWN} > 1000"));
    let at_ns = browser.pause();
    let before = cells(&browser, "robot");
    let samples = browser.value("hilrig.samples.length");
    browser.reload();
    assert_eq!(browser.pause(), at_ns);
    assert!(cells(&browser, "robot") == before, "another map");
    assert_eq!(browser.value("hilrig.samples.length"), samples);
}

/// A name made of markup, in a scenario or from a robot's line, is text on the page. (The user can
/// freely choose the link name of a described device, and request any fault kind.)
#[test]
fn text_is_never_markup() {
    let server = Server::held("empty-room", "1");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    browser.click("#tab-log");
    let evil = "<img src=x onerror=window.pwned=1>";
    browser.value(&format!(
        "(hear({{type: 'events', from: 0, events: [{{at: 1, source: {evil:?}, rule: {evil:?}, \
         detail: {evil:?}, violation: true}}]}}), refuse({evil:?}), true)"
    ));
    browser.wait("document.querySelector('#events li').textContent.includes('onerror')");
    assert_eq!(browser.value("document.querySelectorAll('img').length"), 0);
    assert_eq!(browser.value("window.pwned === undefined"), true);
    // The policy forbids even an inline script of the page itself.
    let trap = "'<p onclick=\"window.pwned=1\" id=trap></p>'";
    browser.value(&format!(
        "(document.body.insertAdjacentHTML('beforeend', {trap}), \
         document.getElementById('trap').click(), true)"
    ));
    assert_eq!(browser.value("window.pwned === undefined"), true);
}

/// The slider shows past states of the run: the recorded pose, and a map with fewer cells.
#[test]
fn the_slider_shows_what_was_recorded() {
    let server = Server::held("rescue-flat", "10");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    browser.wait("hilrig.now.at_ns > 30e9");
    browser.pause();
    let now = browser.value(KNOWN).as_u64().expect("a count");
    browser.set("#time", "10000");
    browser.wait("hilrig.past && hilrig.past.maps.robot");
    let known = KNOWN.replace("hilrig.maps", "hilrig.past.maps");
    let then = browser.value(&known).as_u64().expect("a count");
    assert!((1..now).contains(&then), "{then} cells then, {now} now");
    let at = browser.value("hilrig.past.now.at_ns / 1e6").as_f64();
    let at = at.expect("milliseconds");
    assert!((9_300.0..=10_000.0).contains(&at), "{at} ms");
    browser.click("#live");
    assert_eq!(browser.value("hilrig.past"), Value::Null);
}
