//! A log that is watched during mapping.

use core::fmt::Write as _;

use super::browser::Browser;
use super::server::{Process, Server, folder};

/// A robot in the middle of a room of 6 m by 4 m that turns on the spot, 5 degrees a second: 60
/// scans, one every second, as a CARMEN log.
fn room() -> String {
    let mut log = String::new();
    for scan in 0..60 {
        let heading = f64::from(scan) * 5_f64.to_radians();
        log.push_str("FLASER 180");
        for beam in 0..180 {
            let bearing = heading + (f64::from(beam) - 89.5).to_radians();
            let (sin, cos) = libm::sincos(bearing);
            let (to_x, to_y) = (3.0 / cos.abs(), 2.0 / sin.abs());
            write!(log, " {:.3}", to_x.min(to_y)).expect("a text");
        }
        let pose = format!("0 0 {heading:.5}");
        writeln!(log, " {pose} {pose} {scan}.0 host {scan}.0").expect("a text");
    }
    let path = folder("log").join("room.log");
    std::fs::write(&path, log).expect("can be written");
    path.to_str().expect("plain letters").to_owned()
}

/// Guards against a page that shows another map than the saved one, or no map.
#[test]
fn a_log_is_watched_while_it_is_mapped() {
    let (log, out) = (room(), folder("log-out"));
    let out = out.to_str().expect("plain letters");
    let process = Process::start(&["slam", &log, "--out", out, "--ui"]);
    let mut server = Server::of_process(process);
    let Some(browser) = Browser::at(&server) else {
        return;
    };
    browser.wait("hilrig.now?.over === true && hilrig.maps.mapper?.width > 0");
    assert_eq!(browser.value("hilrig.now.mode"), "60 of 60 scans");
    assert_eq!(
        browser.value("document.body.className"),
        "log no-pc no-goals"
    );
    // The wall ahead, the free floor in front of it, and unknown cells behind it.
    let cell = |x: f64| {
        let at = format!(
            "(() => {{ const {{ width, resolution_m: edge, origin_m: [x, y], cells }} = \
             hilrig.maps.mapper; return cells[Math.floor(-y / edge) * width + \
             Math.floor(({x} - x) / edge)]; }})()"
        );
        browser.value(&at).as_u64().expect("a cell")
    };
    let wall = [2.98, 3.02].map(cell).into_iter().max();
    assert!(wall > Some(190), "{wall:?}");
    assert!(cell(2.0) < 64, "{}", cell(2.0));
    assert_eq!(cell(3.2), 127);
    // Half a minute earlier, half of the scans were known.
    browser.value("goTo(30000)");
    browser.wait("hilrig.past !== null");
    let mode = browser.value("hilrig.past.now.mode");
    let mode = mode.as_str().expect("words").to_owned();
    let scans: Option<u32> = mode.split(' ').next().and_then(|count| count.parse().ok());
    assert!(scans.is_some_and(|count| count < 60), "{mode}");
    browser.click("#play");
    browser.wait("hilrig.refused.includes('over')");
    assert!(server.process().end());
    let poses = std::fs::read_to_string(format!("{out}/trajectory.tum")).expect("was written");
    assert_eq!(
        poses.lines().filter(|line| !line.starts_with('#')).count(),
        60
    );
}
