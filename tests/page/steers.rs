//! An operator's actions on the page reach the robot, and the saved session repeats them.

use fantoccini::actions::KeyAction;
use hilrig::robots::rescue::pc_program;
use serde_json::json;

use super::again;
use super::browser::Browser;
use super::server::Server;

/// A room without a mission, with the PC connected.
fn room(name: &str) -> Option<(Server, Browser)> {
    let room = super::server::endless("empty-room", name);
    let server = Server::start(&[&room, "--speed", "2", "--paused"]);
    let browser = Browser::at(&server)?;
    browser.wait("hilrig.now.pc.connection === 'connected' && hilrig.now.pc.size_mm");
    browser.click("[data-mode=stop]");
    browser.click("#clear");
    browser.wait("hilrig.now.pc.waypoints.length === 0 && hilrig.now.pc.confirmed");
    Some((server, browser))
}

fn waypoints(browser: &Browser) -> Vec<[i64; 2]> {
    let list = browser.value("hilrig.now.pc.waypoints");
    serde_json::from_value(list).expect("places")
}

/// Whether two positions are equal, on a canvas with pixels of about 4 mm.
fn near(found: [i64; 2], expected: [i32; 2]) -> bool {
    let far = |axis: usize| found[axis].abs_diff(i64::from(expected[axis])) > 8;
    !far(0) && !far(1)
}

/// Click, click, drag, right click: the lists of the page, of the robot, and of the repeated
/// session are equal.
#[test]
fn waypoints_are_added_dragged_and_deleted_by_mouse() {
    let Some((server, browser)) = room("waypoints") else {
        return;
    };
    browser.click_map([900, 900]);
    browser.wait("hilrig.now.pc.waypoints.length === 1");
    browser.click_map([1500, 2000]);
    browser.wait("hilrig.now.pc.waypoints.length === 2");
    browser.click_map([2000, 900]);
    browser.wait("hilrig.now.pc.waypoints.length === 3 && hilrig.now.pc.confirmed");
    browser.wait("document.querySelectorAll('#waypoints li').length === 3");

    browser.drag_map([1500, 2000], [1200, 1700]);
    browser.wait("hilrig.now.pc.waypoints[1][0] < 1300 && hilrig.now.pc.confirmed");
    browser.right_click_map([900, 900]);
    browser.wait("hilrig.now.pc.waypoints.length === 2 && hilrig.now.pc.confirmed");
    let list = waypoints(&browser);
    assert!(near(list[0], [1200, 1700]), "{list:?}");
    assert!(near(list[1], [2000, 900]), "{list:?}");

    let at_ns = browser.pause();
    let list = browser.value("hilrig.now.pc.waypoints");
    let run = again(&server.case(), at_ns);
    assert_eq!(browser.value("hilrig.slow.trace"), run.rig.trace_hash());
    let pc = run.rig.device::<emulators::pc::Pc>("pc").expect("emulated");
    assert_eq!(json!(pc_program::waypoints(pc)), list);
}

/// The buttons and the keys of the map: a step of the zoom is a factor of 1.4, an arrow key moves
/// the picture, and "fit" shows everything again.
#[test]
fn r141_the_map_zooms_and_pans() {
    let Some((_server, browser)) = room("zoom") else {
        return;
    };
    let figure = |name: &str| browser.value(name).as_f64().expect("a figure");
    browser.value("(fitAll(), draw(), 0)");
    let (scale, x) = (figure("frame.scale"), figure("frame.x"));
    browser.click("#zoom-in");
    browser.wait(&format!("Math.abs(frame.scale / {scale} - 1.4) < 0.01"));
    let zoomed = figure("frame.x");
    browser.value("(canvas.focus(), 0)");
    browser.key(KeyAction::Down { value: '\u{E014}' });
    browser.key(KeyAction::Up { value: '\u{E014}' });
    browser.wait(&format!("frame.x > {zoomed}"));
    browser.click("#zoom-fit");
    browser.wait(&format!(
        "Math.abs(frame.scale / {scale} - 1) < 1e-6 && Math.abs(frame.x - {x}) < 1e-6"
    ));
}

/// UI-06 in a real browser: a click beside the map has no effect.
#[test]
fn a_click_beside_the_map_is_refused_in_words() {
    let Some((_server, browser)) = room("beside") else {
        return;
    };
    browser.set("#add-x", "-50");
    browser.set("#add-y", "100");
    browser.click("#add button");
    browser.wait("hilrig.refused.includes('not on the map')");
    assert!(waypoints(&browser).is_empty());
}

/// Modes by their buttons, then manual driving: forward while the key is down, and at rest after
/// it.
#[test]
fn modes_are_ordered_and_keys_drive() {
    let Some((_server, browser)) = room("drive") else {
        return;
    };
    browser.click("[data-mode=exploration]");
    browser.wait("hilrig.now.pc.state.mode === 'exploration'");
    browser.click("[data-mode=stop]");
    browser.wait("hilrig.now.pc.state.mode === 'stop'");

    browser.click("#drive");
    browser.wait("hilrig.now.pc.state.mode === 'manual'");
    let turn = "hilrig.now.truth[2]";
    let before = browser.value(turn).as_f64().expect("an angle");
    browser.key(KeyAction::Down { value: 'a' });
    browser.wait("hilrig.now.pc.state.to[0] === -8 && hilrig.now.pc.state.to[1] === 8");
    browser.wait(&format!("Math.abs({turn} - {before}) > 0.2"));
    browser.key(KeyAction::Up { value: 'a' });
    browser.wait("hilrig.now.pc.state.to[0] === 0 && hilrig.now.pc.state.to[1] === 0");
    browser.click("#drive");
    assert_eq!(
        browser.value("document.getElementById('drive').getAttribute('aria-pressed')"),
        "false"
    );
}

/// If a page closes while a key is down, its server orders the robot to stop.
#[test]
fn a_page_that_is_gone_does_not_drive_on() {
    let Some((server, browser)) = room("gone") else {
        return;
    };
    browser.click("#drive");
    browser.key(KeyAction::Down { value: 'd' });
    browser.wait("hilrig.now.pc.state.to[0] === 8");
    browser.go("about:blank");
    let mut page = server.page().expect("there is room");
    let stopped = page.hear("now", |now| now["pc"]["state"]["to"] == json!([0, 0]));
    assert!(stopped.is_some());
}

/// A fault added by click strikes, is counted on its line, can be ended, and is in the saved
/// session.
#[test]
fn a_fault_by_click_strikes_and_joins_the_session() {
    let Some((server, browser)) = room("faults") else {
        return;
    };
    browser.click("#tab-faults");
    browser.click("#wiring [aria-label='base to-master']");
    browser.set("#fault-kind", "flip");
    browser.set("#fault-keys [name=rate]", "0.02");
    browser.set("#fault-s", "0");
    browser.click("#inject");
    let hits = "hilrig.slow.lanes.find((lane) => lane.name === 'base')['to-master'].tally.faults";
    browser.wait(&format!("{hits} > 3"));
    browser.wait("document.querySelector('#faults button')");
    browser.click("#faults button");
    browser.wait("hilrig.slow.faults.length === 1 && hilrig.slow.faults[0].state === 'over'");

    let at_ns = browser.pause();
    let case = server.case();
    assert!(case.contains("[[fault]]"), "{case}");
    let run = again(&case, at_ns);
    assert_eq!(browser.value("hilrig.slow.trace"), run.rig.trace_hash());
}
