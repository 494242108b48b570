//! `hilrig fidelity`: both columns, and an exit code that a script can trust.

use hilrig::capture::{Interface, Kind, Record, Section};
use hilrig::rig::line::Direction;
use protocols::Instant;

use super::captures::capture;
use super::{Session, text};

/// Published figures of the real capture: the emulation agrees with them, and the table shows the
/// comparison.
#[test]
fn the_emulated_lidar_agrees_with_the_published_figures() {
    let output = Session::new("fidelity").hilrig(&["fidelity", "xv11"]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let row = |name: &str| {
        let line = said.lines().find(|line| line.starts_with(name));
        line.unwrap_or_else(|| panic!("no {name} in\n{said}"))
    };
    assert!(row("figure").contains("published    emulated"));
    assert!(row("checksums with a dropped carry").ends_with("+-1       ok"));
    assert!(row("coast-down from 290 to 185 rpm").ends_with("+-15 %    ok"));
    assert!(row("noise from 400 mm").ends_with("+-30 %    ok"));
    assert!(row("boot text, characters alike").contains("211         211"));
    assert!(said.ends_with(" 0 differ\n"), "{said}");
}

#[test]
fn a_lidar_of_another_firmware_does_not_pass_for_this_one() {
    let output = Session::new("fidelity-21").hilrig(&["fidelity", "xv11", "--profile", "fw2.1"]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("DIFFERS"), "{said}");
}

/// The figures measured from the real bytes are the recorded ones. The first 20 turns are too few
/// for the blind test: that is no success.
#[test]
fn the_real_capture_has_the_published_figures() {
    let Some(bytes) = capture("xv11/xevel_hand_in_box_fw24.bin") else {
        return;
    };
    let session = Session::new("fidelity-real");
    std::fs::write(session.folder.join("real.bin"), &bytes).expect("writable");
    std::fs::write(session.folder.join("short.bin"), &bytes[..20 * 1_980]).expect("writable");
    let run = |file, more: &[&str]| {
        let arguments = [&["fidelity", "xv11", "--capture", file], more].concat();
        let output = session.hilrig(&arguments);
        (output.status.code(), text(&output.stdout).to_owned())
    };
    let (code, said) = run("real.bin", &["--against", "none"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("11451"), "{said}");
    let (code, said) = run("short.bin", &["--seed", "5"]);
    assert_eq!(code, Some(1), "{said}");
    let lines = said
        .lines()
        .filter(|line| line.ends_with("NOT COMPARED: too few windows"));
    assert_eq!(lines.count(), 3, "{said}");
}

/// A capture compared with itself; whole turns of firmware 2.1 are read as well.
#[test]
fn any_other_capture_is_read() {
    let Some(bytes) = capture("xv11/xevel_sparkfun_noshield_fw21.bin") else {
        return;
    };
    let session = Session::new("fidelity-any");
    std::fs::write(session.folder.join("a.bin"), bytes).expect("writable");
    let same = [
        "fidelity",
        "xv11",
        "--capture",
        "a.bin",
        "--against",
        "a.bin",
    ];
    assert_eq!(session.hilrig(&same).status.code(), Some(0));
    let output = session.hilrig(&[
        "fidelity",
        "xv11",
        "--capture",
        "a.bin",
        "--against",
        "none",
    ]);
    assert_eq!(output.status.code(), Some(0));
    // 30,366 bytes are 21 turns of 1446 bytes.
    let said = text(&output.stdout);
    let turns = said.lines().find(|line| line.starts_with("turns of 1446"));
    assert!(turns.is_some_and(|line| line.contains("  21")), "{said}");
}

#[test]
fn a_file_that_is_no_capture_is_refused() {
    let session = Session::new("fidelity-none");
    session.write("notes.txt", "no lidar");
    let output = session.hilrig(&["fidelity", "xv11", "--capture", "notes.txt"]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        text(&output.stderr),
        "error: notes.txt: no packet in 8 bytes, expected the bytes of an XV-11 as it sends them\n"
    );
    let output = session.hilrig(&["fidelity", "xv11", "--capture", "nowhere.bin"]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        text(&output.stderr),
        "error: cannot read nowhere.bin: No such file or directory (os error 2)\n"
    );
}

/// Read as plain bytes, the file's own blocks would cut a packet in every record. Bytes to the
/// lidar, and bytes on another line, are not the lidar's.
#[test]
fn of_a_capture_only_what_the_lidar_sent_is_read() {
    // First packet of the capture "hand in box", fw 2.4.
    let packet =
        b"\xFA\xA0\x4E\x4A\x27\x01\x05\x04\x27\x01\xD7\x03\x26\x01\x29\x04\x26\x01\xF0\x03\
        \x3C\x5C";
    let mut capture = Vec::new();
    Section::default().write(&mut capture);
    Interface::new("base", 1_000_000).write(&mut capture);
    Interface::new("lidar", 115_200).write(&mut capture);
    let mut add = |link, direction, bytes: &[u8]| {
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(1),
            direction,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        record.write(link, &mut capture);
    };
    for chunk in packet.repeat(50).chunks(15) {
        add(1, Direction::ToMaster, chunk);
        add(1, Direction::ToDevice, b"\xFA");
        add(0, Direction::ToMaster, b"\xAB\x24\x0A\xD9\x00");
    }
    let session = Session::new("fidelity-pcapng");
    std::fs::write(session.folder.join("c.pcapng"), &capture).expect("writable");
    std::fs::write(session.folder.join("raw.bin"), packet.repeat(50)).expect("writable");
    let table = |file: &str| {
        let arguments = ["fidelity", "xv11", "--capture", file, "--against", "none"];
        let output = session.hilrig(&arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stdout).to_owned()
    };
    assert_eq!(table("c.pcapng"), table("raw.bin"));
    // Without a whole turn there is no blind test: that is no success.
    let output = session.hilrig(&["fidelity", "xv11", "--capture", "raw.bin"]);
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stdout);
    assert!(
        said.ends_with("not compared, fewer than 8 steady turns\n"),
        "{said}"
    );
}

/// After a change of the ledger, run `hilrig fidelity --markdown` and copy its table to the page.
#[test]
fn the_page_holds_the_ledger() {
    let session = Session::new("fidelity-ledger");
    let output = session.hilrig(&["fidelity", "--markdown"]);
    let table = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0));
    assert!(
        include_str!("../../docs/fidelity.md").contains(table),
        "{table}"
    );
}

#[test]
fn the_ledger_of_a_device_names_its_oracle() {
    let session = Session::new("fidelity-device");
    let output = session.hilrig(&["fidelity", "odometer"]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(
        said.starts_with("odometer: chip: both published sketches"),
        "{said}"
    );
    let output = session.hilrig(&["fidelity", "odometre"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.contains("unknown device \"odometre\"; expected one of xv11,"),
        "{said}"
    );
    // Options that would be ignored are refused.
    for option in ["--against=none", "--profile=fw2.1", "--seed=2"] {
        let output = session.hilrig(&["fidelity", "rplidar", option]);
        assert_eq!(output.status.code(), Some(2), "{option}");
        let said = text(&output.stderr);
        assert!(said.contains("has no effect on \"rplidar\""), "{said}");
    }
}

/// A log of the CO2 sensor MH-Z19B, with request and reply of its manual. The described device
/// agrees with it, and each changed log differs in its own figure.
#[test]
fn a_device_is_compared_with_a_log_of_the_real_one() {
    let session = Session::new("fidelity-log");
    let log = |latency_ms: u32, reply: &str| -> String {
        let rows = (0..6).map(|n| {
            let [asked, replied] = [n * 700, n * 700 + latency_ms];
            let time = |ms: u32| format!("10:00:{:02}.{:03}", ms / 1_000, ms % 1_000);
            let request = "FF 01 86 00 00 00 00 00 79";
            let (asked, replied) = (time(asked), time(replied));
            match reply {
                "" if n > 0 => format!("{asked} TX: {request}\n"),
                "" => format!("{asked} TX: {request}\n{replied} RX: FF\n"),
                reply => format!("{asked} TX: {request}\n{replied} RX: {reply}\n"),
            }
        });
        rows.collect()
    };
    let sound = "FF 86 02 60 47 00 00 00 D1";
    for (name, log, code, expected) in [
        ("sound", log(24, sound), 0, "5 figures judged, 0 differ"),
        ("slow", log(250, sound), 1, "latency, median"),
        (
            "short",
            log(24, "FF 86 02 60"),
            1,
            "replies of the captured length",
        ),
        ("mute", log(24, ""), 1, "requests with a reply"),
        // The second byte is the command in each model; it is shown, and not judged.
        (
            "other",
            log(24, "FF 87 02 60 47 00 00 00 D0"),
            0,
            "byte 1 is 87, emulated 86",
        ),
    ] {
        session.write("field.log", &log);
        let output = session.hilrig(&["fidelity", "mh-z19", "--capture", "field.log"]);
        let said = text(&output.stdout);
        assert_eq!(output.status.code(), Some(code), "{name}\n{said}");
        let line = said.lines().find(|line| line.contains(expected));
        let line = line.unwrap_or_else(|| panic!("{name}: no {expected} in\n{said}"));
        assert_eq!(code == 1, line.ends_with("DIFFERS"), "{name}\n{said}");
    }
    // Without a byte of the device, nothing is compared.
    session.write("field.log", "10:00:00.000 TX: FF 01 86 00 00 00 00 00 79\n");
    let output = session.hilrig(&["fidelity", "mh-z19", "--capture", "field.log"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("no byte from a device"));
}
