//! Pause, step, speed, another seed.

use super::browser::Browser;
use super::server::Server;

/// Steps are exact to the nanosecond, and nothing moves between them.
#[test]
fn a_paused_run_moves_by_steps() {
    let server = Server::held("empty-room", "1");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    let before = browser.pause();
    browser.set("#step-ms", "100");
    browser.click("#step");
    browser.wait(&format!("hilrig.now.at_ns === {}", before + 100_000_000));
    browser.set("#step-ms", "10");
    browser.click("#step");
    browser.click("#step");
    browser.wait(&format!("hilrig.now.at_ns === {}", before + 120_000_000));
    browser.click("#play");
    browser.wait(&format!("hilrig.now.at_ns > {}", before + 1_000_000_000));
}

/// A restart is a new run, from zero, with the requested seed.
#[test]
fn a_run_begins_anew_with_another_seed() {
    let server = Server::held("empty-room", "30");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    browser.wait("hilrig.now.at_ns > 5e9 && hilrig.stage.seed === 1");
    browser.set("#speed", "1");
    browser.wait("hilrig.now.speed === 1");
    browser.click("#more summary");
    browser.set("#seed", "7");
    browser.click("#restart");
    browser.wait("hilrig.stage && hilrig.stage.seed === 7 && hilrig.stage.run === 2");
    browser.wait("hilrig.now && hilrig.now.run === 2");
    assert!(server.case().contains("seed = 7"));
}

/// The server ends and another one replaces it: the page reconnects by itself.
#[test]
fn a_page_comes_back_when_its_server_does() {
    let first = Server::held("empty-room", "1");
    let Some(browser) = Browser::at(&first) else {
        return;
    };
    let port = first.host.rsplit_once(':').expect("a port").1.to_owned();
    drop(first);
    browser.wait("!hilrig.connected");
    let path = super::server::scenario("two-rooms");
    let _second = Server::start(&[&path, "--port", &port]);
    browser.wait("hilrig.connected && hilrig.stage && hilrig.stage.name === 'two-rooms'");
}
