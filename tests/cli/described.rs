//! One description in all its uses, and each use separately.

use std::process::{Command, Stdio};

use hilrig::description;

use super::{Session, text, wait_until};

/// Runs a command that must end with `code`; returns its standard output.
fn run(session: &Session, line: &[&str], code: i32) -> String {
    let output = session.hilrig(line);
    let (said, told) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{line:?}\n{said}\n{told}");
    said.to_owned()
}

/// The example device: created, emulated for its driver, decoded, dissected, fuzzed, talked to,
/// compared, documented, and learned again from the capture.
#[test]
fn one_description_goes_through_all_uses() {
    let session = Session::new("all-uses");
    let made = run(&session, &["new", "box", "--device"], 0);
    assert_eq!(made, "box.toml\nbox-bench.toml\nbox_driver.py\n");
    run(&session, &["new", "box", "--device"], 2);

    // The fault in its comments is valid. Without a program, nothing is judged.
    let bench = session.read("box-bench.toml");
    let (head, fault) = bench.split_once("# [[fault]]").expect("a fault");
    let fault = fault.replace("\n# ", "\n");
    session.write("faulty.toml", &format!("{head}[[fault]]{fault}"));
    let said = run(&session, &["run", "faulty.toml", "--out", "idle"], 1);
    assert!(said.contains("nothing was judged"), "{said}");

    // Emulated: the driver passes, and its output is the device's values.
    let driver = "python3 box_driver.py";
    let ran = run(
        &session,
        &[
            "run",
            "box-bench.toml",
            "--exec",
            driver,
            "--virtual",
            "--out",
            "out",
        ],
        0,
    );
    assert!(ran.contains("PASS"), "{ran}");
    let capture = "out/capture.pcapng";

    // Decoded: one set, reads, and a report after each.
    let decoded = run(
        &session,
        &[
            "decode",
            capture,
            "--link",
            "box",
            "--description",
            "box.toml",
        ],
        0,
    );
    assert!(
        decoded.matches("report: temperature").count() > 3,
        "{decoded}"
    );
    assert!(decoded.contains("set: target 22.5 C"), "{decoded}");

    // Dissected.
    let lua = run(
        &session,
        &["wireshark", "--description", "box.toml", "--print"],
        0,
    );
    assert!(
        lua.contains("ProtoField.double(\"hilrig.box.temperature\""),
        "the field is there"
    );

    // Fuzzed: the driver handles all input of a few cases; the device, emulated and of a scenario,
    // keeps its laws.
    let wild = ["--description", "box.toml", "--cases", "2", "--out", "fuzz"];
    let times = ["--shrink", "0", "--start", "60s", "--alive", "30s"];
    let said = run(
        &session,
        &[&["fuzz", "--exec", driver][..], &wild, &times].concat(),
        0,
    );
    assert!(said.contains("format: as box is described"), "{said}");
    assert!(!said.contains("no frame was answered"), "{said}");
    let said = run(
        &session,
        &[
            "fuzz",
            "--description",
            "box.toml",
            "--cases",
            "50",
            "--out",
            "f1",
        ],
        0,
    );
    assert!(
        said.starts_with("box: 50 cases, ") && !said.contains(" 0 behaviours"),
        "{said}"
    );
    let of_bench = [
        "--scenario",
        "box-bench.toml",
        "--link",
        "box",
        "--cases",
        "50",
        "--out",
        "f2",
    ];
    let said = run(&session, &[&["fuzz"][..], &of_bench].concat(), 0);
    assert!(
        said.starts_with("box: 50 cases, ") && !said.contains(" 0 behaviours"),
        "{said}"
    );

    // On the ports of a rig.
    let long = session
        .read("box-bench.toml")
        .replace("\"5s\"", "\"10min\"");
    session.write("long.toml", &long);
    let mut up = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    up.args(["up", "long.toml", "--dir", "live", "--until-eof"])
        .current_dir(&session.folder);
    up.stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut rig = up.spawn().expect("starts");
    // The last file that the rig creates: all its ports exist then.
    let note = session.path("live/.hilrig-scenario.toml");
    wait_until("the ports", || note.exists());
    // Compared at the port, with requests that change nothing.
    let found = run(
        &session,
        &[
            "conform",
            "live/box",
            "--description",
            "box.toml",
            "--slack",
            "300ms",
        ],
        0,
    );
    assert!(found.contains("no difference"), "{found}");
    // Fuzzed there, with inputs that change nothing.
    let at_port = ["fuzz", "--description", "box.toml", "--port", "live/box"];
    let few = ["--cases", "12", "--rate", "50", "--out", "f3"];
    let said = run(&session, &[&at_port[..], &few].concat(), 0);
    assert!(
        said.contains("box: 12 inputs, ") && !said.contains(" 0 answered"),
        "{said}"
    );
    // The same command continues in its folder.
    let more = ["--cases", "18", "--rate", "50", "--out", "f3"];
    let said = run(&session, &[&at_port[..], &more].concat(), 0);
    assert!(
        said.contains("continues after 12 inputs") && said.contains("box: 18 inputs, "),
        "{said}"
    );
    // Talked to.
    let talk = [
        "talk",
        "--rig",
        "live",
        "box",
        "--description",
        "box.toml",
        "--timeout",
        "60s",
    ];
    let said = run(&session, &[&talk[..], &["set", "target=25"]].concat(), 0);
    assert!(said.contains("target 25 C, heating on"), "{said}");
    run(&session, &[&talk[..], &["set", "aim=25"]].concat(), 2);
    drop(rig.stdin.take());
    rig.wait().expect("it was started");

    // Compared in virtual time: with its own emulation, and with one that differs.
    run(
        &session,
        &["conform", "box-bench.toml", "--description", "box.toml"],
        0,
    );
    let other = session
        .read("box.toml")
        .replace("latency = \"2ms\"", "latency = \"9ms\"");
    session.write("other.toml", &other);
    let found = run(
        &session,
        &["conform", "box-bench.toml", "--description", "other.toml"],
        1,
    );
    assert!(
        found.contains("latency: read: 2.0 ms (median), expected 9.0 ms"),
        "{found}"
    );

    // Documented.
    let page = run(&session, &["describe", "box.toml", "--html"], 0);
    assert!(
        page.starts_with("<!DOCTYPE html>") && page.contains("<h3>report (device to driver)</h3>")
    );

    // Learned again: the checksum of the frames, from a few of them.
    let learned = session.hilrig(&["learn", capture, "--link", "box", "-o", "learned.toml"]);
    let told = text(&learned.stderr);
    assert_eq!(learned.status.code(), Some(0), "{told}");
    assert!(
        session.read("learned.toml").contains("CRC-16/MODBUS"),
        "{told}"
    );
}

/// A register map becomes a device; a wrong one is refused with its place, and nothing is written.
#[test]
fn a_register_map_becomes_a_device() {
    let session = Session::new("register-map");
    session.write(
        "map.csv",
        "Address,Name,Type,Scale,Unit\n40001,Set point,int16,0.1,C\n",
    );
    let line = ["new", "oven", "--device", "--from", "map.csv"];
    assert_eq!(run(&session, &line, 0), "oven.toml\noven-bench.toml\n");
    let page = run(&session, &["describe", "oven.toml"], 0);
    assert!(page.contains("set\\_point"), "{page}");
    run(
        &session,
        &["conform", "oven-bench.toml", "--description", "oven.toml"],
        0,
    );
    session.write(
        "probe.ksy",
        "meta: {id: sample, endian: le}\nseq:\n  - {contents: [0xAA]}\n  - {id: heat, type: u2, doc-ref: x}\n",
    );
    let output = session.hilrig(&["new", "probe", "--device", "--from", "probe.ksy"]);
    let told = text(&output.stderr);
    assert!(
        told.contains("left out: line 4: seq.heat.doc-ref: has no counterpart"),
        "{told}"
    );
    run(
        &session,
        &["conform", "probe-bench.toml", "--description", "probe.toml"],
        0,
    );
    session.write("wrong.csv", "at,type\n1,quark\n");
    let output = session.hilrig(&["new", "other", "--device", "--from", "wrong.csv"]);
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(
        told.contains("wrong.csv: line 2: type: is \"quark\", expected a type as u16"),
        "{told}"
    );
    // Windows-1252, as a spreadsheet may save it.
    std::fs::write(session.path("latin.csv"), b"at,unit\n0,V\n1,\xB0C\n").expect("a file");
    let output = session.hilrig(&["new", "other", "--device", "--from", "latin.csv"]);
    let told = text(&output.stderr);
    assert!(
        told.contains("latin.csv: line 3: a character is not UTF-8"),
        "{told}"
    );
    assert!(!session.path("other.toml").exists());
}

/// Tags that are open in a page, without those that need no end tag.
fn open_tags(page: &str) -> Vec<String> {
    let mut open: Vec<String> = Vec::new();
    for tag in page.split('<').skip(1) {
        let tag = tag.split('>').next().unwrap_or_default();
        let name = tag.split(' ').next().unwrap_or_default().to_owned();
        match name.strip_prefix('/') {
            Some(ended) => assert_eq!(open.pop().as_deref(), Some(ended), "{tag}"),
            None if ["meta", "!DOCTYPE"].contains(&name.as_str()) => {}
            None => open.push(name),
        }
    }
    open
}

#[test]
fn every_shipped_description_has_its_page() {
    for (name, text) in description::shipped::ALL {
        let nothing = |_: &str| Err(String::new());
        let of = description::Description::parse(name, text, &nothing).expect("sound");
        assert_eq!(open_tags(&of.html()), Vec::<String>::new(), "{name}");
        let page = of.markdown();
        assert!(page.starts_with(&format!("# {name}\n")));
        for message in of.messages() {
            let heading = format!("\n### {} (", message.name().replace('_', "\\_"));
            assert!(page.contains(&heading), "{name} has no {heading}");
        }
        // Each row of a table has as many cells as its head.
        let rows: Vec<&str> = page.lines().filter(|line| line.starts_with('|')).collect();
        let cells = |row: &str| row.replace("\\|", "").matches('|').count();
        for pair in rows.windows(2).filter(|pair| pair[1].starts_with("|---")) {
            assert_eq!(cells(pair[0]), cells(pair[1]), "{name}: {pair:?}");
        }
    }
}

/// The message names the option, the file, the line and the key.
#[test]
fn a_wrong_description_is_told_with_its_place_by_every_command() {
    let session = Session::new("wrong-description");
    let text_of = description::shipped::text("modbus-meter").expect("shipped");
    session.write("wrong.toml", &text_of.replace("baud = 9600", "baud = 96"));
    session.write("bytes", "x");
    for line in [
        &["describe", "wrong.toml"][..],
        &["talk", "nowhere", "--description", "wrong.toml"],
        &["conform", "--description", "wrong.toml"],
        &["wireshark", "--print", "--description", "wrong.toml"],
        &["decode", "bytes", "--description", "wrong.toml"],
        &["fuzz", "--exec", "true", "--description", "wrong.toml"],
        &["fuzz", "--description", "wrong.toml"],
        &["fuzz", "--description", "wrong.toml", "--port", "nowhere"],
    ] {
        let output = session.hilrig(line);
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line:?}: {told}");
        let place = "wrong.toml:10: line.baud: is 96, expected 300 to 4000000";
        assert!(told.contains(place), "{line:?}: {told}");
    }
}

/// The schema of descriptions contains every table that the docs name.
#[test]
fn the_schema_of_descriptions_is_printed() {
    let session = Session::new("device-schema");
    let schema: serde_json::Value =
        serde_json::from_str(&run(&session, &["schema", "--device"], 0)).expect("JSON");
    for key in [
        "line",
        "frame",
        "message",
        "state",
        "registers",
        "on",
        "every",
        "after",
        "faults",
    ] {
        assert!(schema["properties"][key].is_object(), "{key}");
    }
}
