//! The page's PC program on a port, with a robot in another process.

use serde_json::{Value, json};

use super::server::{Process, Server, folder, scenario};

/// Three processes: the rig on pseudo-terminals, the robot's program, the page. The map arrives
/// over the radio; a waypoint is sent and confirmed; the page reconnects by itself to a restarted
/// rig.
#[test]
fn the_program_runs_against_a_robot_on_a_port() {
    let dir = folder("remote");
    let dir = dir.to_str().expect("plain letters");
    let rig = || {
        let mut up = Process::start(&["up", &scenario("empty-room"), "--dir", dir, "--pc"]);
        up.line("pc ");
        (up, Process::start(&["dut", "--dir", dir]))
    };
    let first = rig();
    let server = Server::start(&["--pc", &format!("{dir}/pc")]);
    let mut page = server.page().expect("there is room");
    let connected = |now: &Value| now["pc"]["connection"] == "connected";
    let now = page.hear("now", connected).expect("shown");
    assert_eq!(now["truth"], json!(null));
    page.hear("now", |now| !now["pc"]["size_mm"].is_null());
    page.hear("now", |now| now["pc"]["rows_missing"].as_u64() < Some(250));
    assert!(page.send(r#"{"do":"clear"}"#) && page.send(r#"{"do":"add","at":[900,1200]}"#));
    page.hear("now", |now| {
        now["pc"]["confirmed"] == true && now["pc"]["waypoints"] == json!([[900, 1200]])
    });
    assert!(page.send(r#"{"do":"pause"}"#));
    let refused = page.hear("refused", |_| true).expect("told");
    assert!(
        refused["why"]
            .as_str()
            .is_some_and(|why| why.contains("no rig"))
    );

    drop(first);
    page.hear("now", |now| !connected(now));
    let _second = rig();
    assert!(page.hear("now", connected).is_some());
    page.hear("now", |now| now["pc"]["heard_ms"].as_u64() < Some(1_000));
}

/// A robot that reports about itself over the radio: its battery, conditions and errors are on the
/// page of its PC.
#[test]
fn what_the_robot_says_of_itself_is_on_the_page_of_its_pc() {
    let dir = folder("remote-diagnosis");
    let text = std::fs::read_to_string(scenario("empty-room")).expect("shipped");
    let said = format!("{text}\n[program]\ndiagnosis = true\n");
    let file = dir.join("says.toml");
    std::fs::write(&file, said).expect("room");
    let [dir, file] = [&dir, &file].map(|path| path.to_str().expect("plain letters"));
    let mut up = Process::start(&["up", file, "--dir", dir, "--pc"]);
    up.line("pc ");
    let _program = Process::start(&["dut", "--dir", dir]);
    let server = Server::start(&["--pc", &format!("{dir}/pc")]);
    let mut page = server.page().expect("there is room");
    let value = |slow: &Value, name: &str| {
        let panel = &slow["panels"][0];
        let rows = panel["rows"]
            .as_array()
            .filter(|_| panel["name"] == "robot says")?;
        let row = rows.iter().find(|row| row["name"] == name)?;
        Some(row["value"].clone())
    };
    // The program may begin before its base sends, and says so.
    let is_well = |slow: &Value| value(slow, "conditions") == Some(json!("none"));
    let told = page.hear("slow", is_well).expect("shown");
    let battery = value(&told, "battery");
    let millivolts = battery.and_then(|value| value.as_str()?.parse::<u32>().ok());
    assert!(
        millivolts.is_some_and(|mv| (6_000..14_000).contains(&mv)),
        "{told}"
    );
}

/// The same with yellow, the other robot with a PC program: it is ordered to drive by its sensors,
/// confirms this, and is driven manually.
#[test]
fn yellows_pc_runs_against_a_robot_on_a_port() {
    let dir = folder("remote-yellow");
    let dir = dir.to_str().expect("plain letters");
    let mut up = Process::start(&["up", &scenario("yellow-map"), "--dir", dir, "--pc"]);
    up.line("pc ");
    let _program = Process::start(&["dut", "--dir", dir]);
    let port = format!("{dir}/pc");
    let server = Server::start(&["--pc", &port, "--robot", "yellow"]);
    let mut page = server.page().expect("there is room");
    let stage = page.hear("stage", |_| true).expect("shown");
    assert_eq!(stage["footprint"], json!({"circle": [0.0, 0.0, 0.12]}));
    let does = |mode: &'static str| move |now: &Value| now["pc"]["state"]["mode"] == mode;
    assert!(page.hear("now", does("off")).is_some());
    assert!(page.send(r#"{"do":"mode","mode":"reactive"}"#));
    assert!(page.hear("now", does("auto-reactive")).is_some());
    assert!(page.send(r#"{"do":"mode","mode":"stop"}"#));
    assert!(page.hear("now", does("off")).is_some());
    assert!(page.send(r#"{"do":"drive","axes":[-0.1,0.1]}"#));
    assert!(page.hear("now", does("manual")).is_some());
    let believed = page.hear("now", |now| now["believed"].is_array());
    assert!(believed.is_some());
}
