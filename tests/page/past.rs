//! Past times: the page's state for a past time equals the state of the core at that time.

use emulators::rng::Rng;
use hilrig::Shared;
use hilrig::rig::line::Direction;
use hilrig::rig::trace::{Side, Tap};
use hilrig::run::Run;
use hilrig::show::view::millimetres;
use protocols::Instant;
use serde_json::{Value, json};

use super::browser::Browser;
use super::server::Server;
use super::{again, plain};

/// Counters of the bytes on each direction of each link.
struct Bytes(Shared<[u64; 32]>);

impl Tap for Bytes {
    fn record(&mut self, link: usize, to: Direction, side: Side, _: Instant, bytes: &[u8]) {
        if side == Side::Received {
            self.0.lock()[2 * link + to as usize] += bytes.len() as u64;
        }
    }
}

/// Asserts that `hilrig.past` on the page equals the present state of `run`.
fn assert_shown(browser: &Browser, run: &Run, counts: &[u64]) {
    let shown = |what: &str| plain(browser.value(&format!("hilrig.past.{what}")));
    let (instruments, rig) = (run.instruments(), &run.rig);
    assert_eq!(shown("slow.trace"), rig.trace_hash());
    let pose = rig.world.pose();
    let truth = [pose.x, pose.y, pose.theta].map(millimetres);
    assert_eq!(shown("now.truth"), plain(json!(truth)));
    let believed = run
        .estimate()
        .map(|(_, pose)| [pose.x, pose.y, pose.theta].map(millimetres));
    assert_eq!(shown("now.believed"), plain(json!(believed)));
    let station = instruments.station(rig).expect("the PC is emulated");
    assert_eq!(shown("now.pc"), plain(json!(station.view(rig.now()))));
    assert_eq!(shown("slow.axes"), plain(json!(instruments.axes(rig))));
    assert_eq!(shown("slow.panels"), plain(json!(instruments.panels(rig))));
    let tallies = "slow.lanes.flatMap((lane) => [lane['to-master'], lane['to-device']])";
    let bytes = shown(&format!("{tallies}.map((way) => way.tally.bytes)"));
    assert_eq!(bytes, plain(json!(counts[..2 * rig.links().len()])));
    let checks = run.checks();
    let details: Vec<&str> = checks.iter().map(|check| &*check.detail).collect();
    assert_eq!(
        shown("checks.checks.map((check) => check.detail)"),
        plain(json!(details))
    );
    if let Some(map) = instruments.map(rig) {
        let cells = browser.value("Array.from(hilrig.past.maps.robot.cells)");
        assert!(cells == json!(map.cells()), "another map");
    }
    // The plots use the same axis: a sample at that time, if there is one, has the same figures.
    let told = "hilrig.samples.find((one) => one[0] === hilrig.past.now.at_ns / 1e6)";
    let columns = "hilrig.series.map((one, index) => [one.group, one.name, index])";
    let axes = instruments.axes(rig).into_iter();
    for axis in axes {
        let column = format!(
            "{columns}.find((one) => one[0] === 'axes' && one[1] === {:?})[2]",
            format!("{} set-point", axis.name)
        );
        let value = browser.value(&format!(
            "({told} ?? [0, 0, 0, 0, []])[4][{column}] ?? null"
        ));
        let expected = (axis.set_point * 1000.0).round() / 1000.0;
        let is_it = value.is_null() || plain(value.clone()) == json!(expected);
        assert!(is_it, "{value}, {expected}");
    }
}

/// Compares the page at random times with a new run from the saved session.
#[test]
fn all_that_is_shown_of_a_time_is_what_the_core_was_then() {
    let server = Server::held("rescue-flat", "30");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    // The run is played to its end: the case of an unfinished mission would have fewer
    // expectations.
    browser.wait("hilrig.now.over");
    browser.pause();
    let mut rng = Rng::stream(20_261_122, "times");
    let mut times: Vec<u64> = (0..10).map(|_| rng.below(20_000)).collect();
    times.sort_unstable();
    let mut run = again(&server.case(), 0);
    let counts = Shared::new([0; 32]);
    run.rig.add_tap(Box::new(Bytes(counts.clone())));
    for at_ms in times {
        browser.set("#time", &at_ms.to_string());
        browser.wait("hilrig.past && wanted === null && !asking");
        let at_ns = browser
            .value("hilrig.past.now.at_ns")
            .as_u64()
            .expect("a time");
        let far = (at_ms * 1_000_000).saturating_sub(at_ns);
        assert!(far < 800_000_000, "{at_ns} for {at_ms} ms");
        run.go_on_until(Instant::from_nanos(at_ns));
        assert_shown(&browser, &run, &*counts.lock());
    }
    browser.click("#live");
    assert_eq!(browser.value("hilrig.past"), Value::Null);
}

/// A waypoint is added, the run continues, all waypoints are deleted. The run then continues from a
/// time in between in another way. Earlier actions are kept and later ones dropped, and a
/// repetition of the session gives the same bytes.
#[test]
fn a_run_goes_on_from_an_earlier_time_in_another_way() {
    let server = Server::held_on("rescue-flat", "4", "branch");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    browser.wait("hilrig.now.pc.confirmed && hilrig.now.at_ns > 5e9");
    browser.pause();
    browser.set("#add-x", "900");
    browser.set("#add-y", "900");
    browser.click("#add button");
    browser.wait("hilrig.now.pc.waypoints.some(([x, y]) => x === 900 && y === 900)");
    browser.set("#step-ms", "1000");
    let then = browser.pause() + 1_000_000_000;
    browser.click("#step");
    browser.wait(&format!("hilrig.now.at_ns === {then}"));
    browser.pause();
    browser.click("#step");
    browser.wait(&format!("hilrig.now.at_ns === {}", then + 1_000_000_000));
    browser.click("#clear");
    browser.wait("hilrig.now.pc.waypoints.length === 0");

    browser.value(&format!("(goTo({}), true)", then / 1_000_000));
    browser.wait("hilrig.past && wanted === null && !asking");
    let at_ns = browser
        .value("hilrig.past.now.at_ns")
        .as_u64()
        .expect("a time");
    browser.click("#branch");
    browser.wait("hilrig.stage && hilrig.stage.run === 2 && hilrig.now && hilrig.now.run === 2");
    assert_eq!(browser.pause(), at_ns);
    assert!(at_ns <= then);
    let added = "hilrig.now.pc.waypoints.some(([x, y]) => x === 900 && y === 900)";
    assert_eq!(browser.value(added), true);
    let run = again(&server.case(), at_ns);
    assert_eq!(browser.value("hilrig.slow.trace"), run.rig.trace_hash());
    // The run continues from there and keeps all earlier events.
    browser.click("#step");
    browser.wait(&format!("hilrig.now.at_ns === {}", at_ns + 1_000_000_000));
    let at_ns = browser.pause();
    let run = again(&server.case(), at_ns);
    assert_eq!(browser.value("hilrig.slow.trace"), run.rig.trace_hash());
    assert_eq!(browser.value("hilrig.samples[0][0]"), 0);
}
