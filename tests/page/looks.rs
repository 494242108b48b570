//! Pages and reports as a reader sees them: every run shows its own content, each control has a
//! label, each direction and each quantity has one name, and nothing needed is out of sight.

use std::path::Path;
use std::process::Command;

use core::time::Duration;

use hilrig::run::Run;
use hilrig::scenario::Scenario;
use hilrig::show::folder as results;
use serde_json::{Value, json};

use super::browser::Browser;
use super::server::{Server, endless, folder};

/// Two devices without a robot. The scenario itself sends the requests.
const DEVICES: &str = include_str!("../browser/two-devices.toml");
/// The sizes of a phone, a notebook and a desktop.
const SIZES: [[u32; 2]; 3] = [[390, 844], [1280, 800], [1920, 1080]];

fn devices(test: &str) -> String {
    let path = folder(test).join("two-devices.toml");
    std::fs::write(&path, DEVICES).expect("can be written");
    path.to_str().expect("plain letters").to_owned()
}

fn report(test: &str, text: &str) -> String {
    let dir = folder(test);
    let (scenario, source) = Scenario::from_text(text).expect("sound");
    let outcome = Run::new(scenario, &source, None).expect("wired").finish();
    results::write(&dir, &outcome, Duration::ZERO).expect("written");
    format!("file://{}/report.html", dir.display())
}

/// The visible text of the page.
fn text(browser: &Browser) -> String {
    let text = browser.value("document.body.innerText");
    text.as_str().expect("text").to_owned()
}

/// Opens the page of a run that stands at `seconds`.
fn standing(server: &Server, seconds: u64) -> Option<Browser> {
    let browser = Browser::paused_at(server)?;
    browser.value(&format!(
        "(send({{do: 'step', ms: {}}}), true)",
        seconds * 1000
    ));
    browser.wait(&format!("hilrig.now.at_ns === {seconds}e9"));
    browser.pause();
    Some(browser)
}

/// Asserts that no visible control lacks a name, and that no direction is written with an arrow or
/// in other words than those of a scenario.
#[track_caller]
fn assert_named(browser: &Browser) {
    let unnamed = browser.value(
        "[...document.querySelectorAll('input, select, button, summary, [role=tab]')] \
         .filter((one) => one.checkVisibility()) \
         .filter((one) => { \
           const label = one.labels?.[0]?.cloneNode(true); \
           label?.querySelectorAll('select, input').forEach((field) => field.remove()); \
           const own = one.labels?.length ? '' : one.innerText; \
           const name = one.ariaLabel || label?.innerText || own; \
           return !/[\\p{L}\\p{N}+\\u2212?]/u.test(name ?? '') \
             || /^(of|as|by|to|what|for)$/i.test((name ?? '').trim()); }) \
         .map((one) => one.outerHTML)",
    );
    assert_eq!(unnamed, json!([]));
    let text = text(browser);
    for other in ["\u{2190}", "\u{2192}", "to the robot", " <\n", " >\n"] {
        assert!(!text.contains(other), "{other:?}: {text}");
    }
}

/// A run of devices without a robot must not show an empty map without any byte. Its page shows
/// each request with its reply and the time between them. The meter's reply: a silence of 3.5
/// characters ends the request, then 20 ms and 9 bytes of 10 bits at 9600 baud. The sonar's reply:
/// 30 ms and 5 bytes. Values of the devices are beside them.
#[test]
fn devices_without_a_robot_show_requests_and_replies() {
    let server = Server::start(&[&devices("devices"), "--paused"]);
    let Some(browser) = standing(&server, 9) else {
        return;
    };
    browser.wait("document.querySelectorAll('#exchanges tr').length >= 18");
    assert_eq!(browser.value("canvas.checkVisibility()"), false);
    assert_eq!(browser.value("$('layers').checkVisibility()"), false);
    let rows = "[...document.querySelectorAll('#exchanges tr')] \
                .map((row) => [...row.cells].map((cell) => cell.innerText.replace('\\n', ' ')))";
    let rows: Vec<Vec<String>> = serde_json::from_value(browser.value(rows)).expect("texts");
    let of = |link: &str| {
        let own = rows.iter().filter(|row| row[1] == link);
        own.map(|row| [&*row[2], &*row[3], &*row[4]])
            .collect::<Vec<_>>()
    };
    let (meter, sonar) = (of("meter"), of("sonar"));
    assert!(
        meter[0][0].ends_with(" 01 04 00 00 00 02 71 CB"),
        "{meter:?}"
    );
    assert!(meter[0][1].contains(" 01 04 04 "), "{meter:?}");
    assert!(sonar[0][0].contains("gain 1"), "{sonar:?}");
    assert!(sonar[0][1].contains("ok 1"), "{sonar:?}");
    let millis = |row: &[&str; 3]| {
        row[2]
            .trim_end_matches(" ms")
            .parse::<f64>()
            .expect("a time")
    };
    assert!((millis(&meter[0]) - 33.021).abs() < 0.1, "{meter:?}");
    assert!((millis(&sonar[0]) - 35.208).abs() < 0.1, "{sonar:?}");
    // The cut of one second takes two replies of the meter; the sonar does not know one request.
    let missing = |rows: &[[&str; 3]]| rows.iter().filter(|row| row[2] == "no reply").count();
    assert_eq!([missing(&meter), missing(&sonar)], [2, 3]);
    let shown = text(&browser);
    for word in [
        "Devices",
        "without a reply",
        "alarm_voltage",
        "gain",
        "reply time",
    ] {
        assert!(shown.contains(word), "{word}: {shown}");
    }
    for word in [
        "unknown",
        "not in the rig",
        "nothing to compare",
        "waypoint",
        "Robot",
    ] {
        assert!(!shown.contains(word), "{word}: {shown}");
    }
    let plots = browser.value("model().plots.map(({ name, at }) => [name, at.length])");
    assert_eq!(
        plots,
        json!([["reply time meter", 14], ["reply time sonar", 8]])
    );
    assert_named(&browser);
    // The button of a request jumps to its time. The page then shows that past state, with fewer
    // requests.
    browser.value("(document.querySelector('#exchanges tr:nth-child(2) button').click(), true)");
    browser.wait("hilrig.past && document.querySelectorAll('#exchanges tr').length < 4");
    for size in SIZES {
        browser.look(size);
        browser.value("(goLive(), draw(), true)");
        let across = "document.documentElement.scrollWidth <= innerWidth";
        assert_eq!(browser.value(across), true, "{size:?}");
        assert_eq!(
            browser.value("$('talk').checkVisibility()"),
            true,
            "{size:?}"
        );
    }
}

/// The same in the report: the requests are text of the file, and the plot is on the time line.
#[test]
fn a_report_without_a_robot_shows_requests_and_replies() {
    let url = report("devices-report", DEVICES);
    let Some(browser) = Browser::start() else {
        return;
    };
    browser.go(&url);
    let shown = text(&browser);
    for word in [
        "01 04 00 00 00 02 71 CB",
        "gain 1",
        "ok 1",
        "no reply",
        "alarm_voltage",
    ] {
        assert!(shown.contains(word), "{word}: {shown}");
    }
    assert_eq!(
        browser.value("document.getElementById('world').checkVisibility()"),
        false
    );
    let wide = "document.getElementById('lanes').clientWidth / innerWidth";
    assert!(
        browser.value(wide).as_f64() > Some(0.9),
        "half of the report is empty"
    );
    assert_named(&browser);
    browser.click("#exchanges .jump");
    let time = "Number(document.getElementById('time').value)";
    assert!(
        browser
            .value(time)
            .as_f64()
            .is_some_and(|at| (at - 1.0).abs() < 0.1)
    );
}

/// The page of a robot of one's own must not hide its goal or name values that the robot does not
/// have. The goal is drawn on the map and listed as the next one.
#[test]
fn the_goals_of_a_custom_robot_are_shown() {
    let server = Server::start(&[&endless("custom-robot", "goals"), "--paused"]);
    let Some(browser) = standing(&server, 1) else {
        return;
    };
    let pixel = "(() => { draw(); const [x, y] = view.toPixel(frame, 2.2, 1.0); \
                 return [...canvas.getContext('2d').getImageData(x - 7, y, 1, 1).data]; })()";
    // The colour of waypoints, #cc79a7.
    assert_eq!(browser.value(pixel), json!([0xCC, 0x79, 0xA7, 255]));
    assert_eq!(
        browser.value("document.getElementById('goals').innerText"),
        "2.20 m, 1.00 m: next"
    );
    let shown = text(&browser);
    for word in [
        "unknown",
        "not in the rig",
        "nothing to compare",
        "Connect",
        "PC",
    ] {
        assert!(!shown.contains(word), "{word}: {shown}");
    }
    assert_named(&browser);
}

/// Two waypoints at one place must not look like one, and the page must mark the waypoint under the
/// pointer.
#[test]
fn waypoints_are_told_apart_and_marked_under_the_pointer() {
    let server = Server::start(&[&endless("empty-room", "marked"), "--paused"]);
    let Some(browser) = standing(&server, 2) else {
        return;
    };
    browser
        .value("(hilrig.now.pc.waypoints = [[900, 900], [1500, 1500], [902, 900]], draw(), true)");
    let marks = "view.clustered(frame, metres(hilrig.now.pc.waypoints)).map((mark) => mark[2])";
    assert_eq!(browser.value(marks), json!([[0, 2], [1]]));
    let listed = "document.querySelectorAll('#waypoints .marked').length";
    assert_eq!(browser.value(listed), 0);
    browser.hover_map([1500, 1500]);
    browser.wait("marked === 1 && canvas.classList.contains('on-waypoint')");
    let index = "[...document.querySelectorAll('#waypoints li')] \
                 .findIndex((item) => item.classList.contains('marked'))";
    assert_eq!(browser.value(index), 1);
    browser.hover_map([1500, 1800]);
    browser.wait("marked === null");
}

/// Each thing has only one name on the page, and no part of the page must be found by scrolling.
/// All rows of the wires are in sight, and so is the button of each kind of fault.
#[test]
fn a_robots_page_has_one_name_for_each_thing_and_hides_nothing() {
    let server = Server::start(&[&endless("rescue-flat", "fold"), "--paused"]);
    let Some(browser) = standing(&server, 3) else {
        return;
    };
    assert_named(&browser);
    // A mode's button does not begin like another one's.
    let alike = "(() => { const words = [...document.querySelectorAll('#modes button')] \
                 .map((one) => one.innerText.slice(0, 6)); return words.length - new Set(words).size; })()";
    assert_eq!(browser.value(alike), 0);
    let names = "[...document.querySelectorAll('#facts dt')].map((one) => one.innerText)";
    let names = browser.value(names);
    for name in ["position error", "heading error", "age of the estimate"] {
        assert!(
            names
                .as_array()
                .is_some_and(|all| all.contains(&json!(name))),
            "{names}"
        );
        let plot = format!("hilrig.series.some((one) => one.name === {name:?})");
        assert_eq!(browser.value(&plot), true, "{name}");
    }
    for size in SIZES {
        browser.look(size);
        browser.value("(showTab('wire'), draw(), true)");
        browser.wait("document.querySelectorAll('#wires tr').length >= 12");
        let hidden = "(() => { const box = $('wires-box'); return Math.max(box.scrollHeight - box.clientHeight, \
             innerWidth < 600 ? 0 : box.scrollWidth - box.clientWidth); })()";
        assert!(
            browser.value(hidden).as_i64() < Some(20),
            "{size:?}: rows of the wires are hidden"
        );
        assert_named(&browser);
        browser.value("(showTab('faults'), true)");
        let out_of_sight = "(() => { const bad = []; \
            for (const { value } of [...$('fault-kind').options]) { \
              $('fault-kind').value = value; showKind(); $('fault-times').open = true; \
              const { innerWidth } = window, panel = $('panel-faults'); \
              $('fault-go').scrollIntoView({ block: 'nearest' }); panel.scrollTop = 0; \
              const edge = innerWidth < 1024 ? Infinity : panel.getBoundingClientRect().bottom; \
              if ($('inject').getBoundingClientRect().bottom > edge) bad.push(value); } \
            return bad; })()";
        assert_eq!(browser.value(out_of_sight), json!([]), "{size:?}");
        assert_named(&browser);
    }
}

/// The right half of a report must not be empty, and each quantity has only one notation.
#[test]
fn a_report_fills_its_width_and_names_each_quantity_once() {
    let text_of = include_str!("../../scenarios/rescue-flat.toml").replace("\"180s\"", "\"9s\"");
    let url = report("report-width", &text_of);
    let Some(browser) = Browser::start() else {
        return;
    };
    browser.go(&url);
    browser.look([1280, 800]);
    let right = "(() => { const bottom = (id) => document.getElementById(id) \
                 .getBoundingClientRect().bottom; return bottom('checks') / bottom('view'); })()";
    assert!(
        browser.value(right).as_f64() > Some(0.75),
        "the right half is empty"
    );
    assert_named(&browser);
    // A share is in percent at each place.
    let shown = browser.value("document.body.textContent");
    let shown = shown.as_str().expect("text");
    let shares: Vec<_> = shown.match_indices("walls right").collect();
    assert!(shares.len() >= 2, "tile and figure");
    let tile = "[...document.querySelectorAll('#tiles li')].find((one) => \
                one.innerText.includes('walls right')).querySelector('b').innerText";
    let figure = "[...document.querySelectorAll('#figures tr')].find((one) => \
                  one.innerText.includes('walls right')).cells[1].innerText";
    assert_eq!(browser.value(tile), browser.value(figure));
    let legend = "document.querySelectorAll('.legend li').length";
    assert!(
        browser.value(legend).as_u64() >= Some(4),
        "the legend is one line"
    );
    for size in SIZES {
        browser.look(size);
        let across = "document.documentElement.scrollWidth <= innerWidth";
        assert_eq!(browser.value(across), true, "{size:?}");
    }
}

/// The page of a campaign over `text`.
fn campaign(test: &str, text: &str) -> String {
    let dir = folder(test);
    let (scenario, out) = (dir.join("case.toml"), dir.join("out"));
    std::fs::write(&scenario, text).expect("can be written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    command
        .arg("campaign")
        .arg(&scenario)
        .args(["--seeds", "1..3"]);
    let ran = command.arg("--out").arg(&out).output().expect("runs");
    let said = String::from_utf8_lossy(&ran.stdout);
    assert!(Path::new(&out).join("campaign.html").exists(), "{said}");
    format!("file://{}/campaign.html", out.display())
}

/// A page must not say in green that all passed and in red that a failure came up. The verdict is
/// the first thing below the title, in one word; a failure comes with its cause as a sentence and
/// with what was on the wires.
#[test]
fn a_campaign_says_its_verdict_first_and_shows_the_failure() {
    let rule = "\n[[expect.rule]]\nname = \"gain-stays-small\"\n\
                never = { register = { device = \"sonar\", name = \"gain\", op = \">\", value = 6 } }\n";
    let [good, bad] = [
        campaign("campaign-good", DEVICES),
        campaign("campaign-bad", &format!("{DEVICES}{rule}")),
    ];
    let Some(browser) = Browser::start() else {
        return;
    };
    let first = "document.querySelector('h1').nextElementSibling";
    let red = "[...document.querySelectorAll('.bad, .fail')].map((one) => one.innerText)";
    browser.go(&good);
    let verdict = format!("[{first}.className, {first}.innerText]");
    assert_eq!(
        browser.value(&verdict),
        json!(["pass", "\u{2713} PASS 2 of 2 runs passed"])
    );
    assert_eq!(browser.value(red), json!([]));
    browser.go(&bad);
    let said = browser.value(&verdict);
    assert_eq!(said[0], "fail");
    let words = said[1].as_str().expect("text");
    assert!(
        words.starts_with("\u{2717} FAIL 0 of 2 runs passed"),
        "{words}"
    );
    let card = browser.value("document.querySelector('.causes li').innerText");
    let card = card.as_str().expect("text");
    let title = browser.value("document.querySelector('.causes h3').innerText");
    let title = title.as_str().expect("text");
    assert!(title.contains("gain") && title.contains(' '), "{title}");
    for part in [
        "2 of 2 runs",
        "rule-gain-stays-small",
        "the last requests and replies",
        "gain 7",
    ] {
        assert!(card.contains(part), "{part}: {card}");
    }
    assert_ne!(
        browser.value("document.querySelector('.moment table')"),
        Value::Null
    );
}
