//! Overlays of a robot besides its map: on the page during the run, and in the report afterwards.

use std::path::Path;

use core::time::Duration;

use hilrig::run::Run;
use hilrig::scenario::Scenario;
use hilrig::show::folder as results;
use serde_json::{Value, json};

use super::browser::Browser;
use super::server::{Server, folder};
use super::{again, plain};

const PICTURE: &str = "document.getElementById('world').toDataURL()";
/// Labels of the overlay switches.
const SWITCHES: &str = "[...document.querySelectorAll('#overlays label')]";

fn names(list: &Value) -> Vec<&str> {
    let names = list.as_array().expect("a list").iter();
    names.map(|name| name.as_str().expect("a name")).collect()
}

/// IR beams, lidar walls, roadmap and planned path equal those of the robot and its PC program at
/// that nanosecond. Each can be switched off. The local map can be selected, and has the PC
/// program's size.
#[test]
fn what_a_robot_sees_and_plans_is_shown() {
    let server = Server::held("yellow-map", "30");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    let way = "hilrig.overlays.some((overlay) => overlay.name === 'way')";
    let at_ns = browser.pause_when(&format!("{way} && hilrig.maps.local"));
    let run = again(&server.case(), at_ns);
    assert_eq!(browser.value("hilrig.slow.trace"), run.rig.trace_hash());
    let overlays = run.instruments().overlays(&run.rig);
    let told = plain(browser.value("hilrig.overlays"));
    assert_eq!(told, plain(json!(overlays)));
    let shown = browser.value(&format!("{SWITCHES}.map((label) => label.dataset.name)"));
    let expected = ["infrared", "lidar lines", "roadmap", "way"];
    assert_eq!(names(&shown), expected);
    for overlay in &overlays {
        let count = overlay.lines().len() + overlay.points().len();
        assert!(count > 0 && overlay.left_out() < 5_000, "{}", overlay.name);
    }

    let with = browser.value(PICTURE);
    for name in expected {
        let switch =
            format!("({SWITCHES}.find((l) => l.dataset.name === '{name}').click(), draw())");
        browser.value(&switch);
        assert_ne!(browser.value(PICTURE), with, "{name} is not drawn");
        browser.value(&switch);
        assert!(browser.value(PICTURE) == with, "{name} is not drawn again");
    }
    browser.set("#map", "local");
    browser.value("draw()");
    assert_ne!(browser.value(PICTURE), with);
    let layers = run.instruments().layers(&run.rig);
    let (_, local) = layers.first().expect("a local map");
    let size = browser.value("[hilrig.maps.local.width, hilrig.maps.local.height]");
    assert_eq!(size, json!([local.width(), local.height()]));
    // The states of the robot and of the PC program.
    assert_eq!(
        browser.value("hilrig.now.mode"),
        json!(run.instruments().mode(&run.rig))
    );
    let panels = browser.value("document.getElementById('panels').textContent");
    let panels = panels.as_str().expect("text");
    for word in [
        "task",
        "map",
        "state told",
        "right front",
        "roadmap vertices",
    ] {
        assert!(panels.contains(word), "{word}: {panels}");
    }
}

/// A box of 1 m that faces along y: its right side is at x = 0.2, its front at y = 0.8. A circle of
/// the same reach would have neither.
#[test]
fn a_robot_is_drawn_as_the_outline_that_it_has() {
    let server = Server::held("yellow-reactive", "1");
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    let disc = browser.value("hilrig.stage.footprint");
    assert_eq!(disc, json!({"circle": [0, 0, 0.12]}));
    let red = |x: f64, y: f64| {
        let pixel = browser.value(&format!(
            "(() => {{ const canvas = document.createElement('canvas'); \
             canvas.width = canvas.height = 200; const context = canvas.getContext('2d'); \
             const frame = hilrigView.fit(canvas, [-1, -1, 1, 1], 0); \
             const footprint = {{ polygon: [0.8, 0.2, -0.2, 0.2, -0.2, -0.2, 0.8, -0.2] }}; \
             hilrigView.drawRobot(context, frame, [0, 0, Math.PI / 2], footprint, '#ff0000'); \
             const [px, py] = hilrigView.toPixel(frame, {x}, {y}); \
             return context.getImageData(px, py, 1, 1).data[3]; }})()"
        ));
        pixel.as_u64().expect("a byte") > 100
    };
    assert_eq!([red(0.2, 0.4), red(-0.2, 0.4), red(0.1, 0.8)], [true; 3]);
    assert_eq!(
        [red(0.1, -0.2), red(0.8, 0.0), red(-0.8, 0.0)],
        [true, false, false]
    );
}

/// The report of a run, opened from disk: the plans at a time can be switched off, and the local
/// map is available.
#[test]
fn a_report_shows_what_was_seen_and_planned() {
    let dir = folder("report-overlays");
    let text = include_str!("../../scenarios/yellow-map.toml").replace("\"300s\"", "\"20s\"");
    let (scenario, source) = Scenario::parse(Path::new("<case>"), text).expect("sound");
    let outcome = Run::new(scenario, &source, None).expect("wired").finish();
    let layers: Vec<_> = outcome.layers.iter().map(|(name, _)| *name).collect();
    assert_eq!(layers, ["local"]);
    results::write(&dir, &outcome, Duration::ZERO).expect("written");
    let Some(browser) = Browser::start() else {
        return;
    };
    browser.go(&format!("file://{}/report.html", dir.display()));
    let with = browser.value(PICTURE);
    let switch = format!("{SWITCHES}.find((label) => label.dataset.name === 'way').click()");
    browser.value(&format!("({switch}, true)"));
    assert_ne!(browser.value(PICTURE), with);
    browser.value(&format!("({switch}, true)"));
    assert!(browser.value(PICTURE) == with);
    browser.set("#map", "local");
    assert_ne!(browser.value(PICTURE), with);
    // Before the first scan there was neither a roadmap nor a path.
    browser.set("#map", "");
    browser.set("#time", "1");
    let early = browser.value(PICTURE);
    browser.value(&format!("({switch}, true)"));
    assert!(browser.value(PICTURE) == early);
    browser.value("console.error('the end')");
    assert_eq!(browser.console("the end"), Vec::<String>::new());
}
