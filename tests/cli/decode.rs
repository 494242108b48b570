//! `hilrig decode`: its output for captures and dumps, valid and damaged.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Command, Stdio};

use hilrig::capture::{Interface, Kind, Record, Section};
use hilrig::rig::line::Direction;
use protocols::{Instant, LineEvent, xv11};

use super::captures::capture;
use super::{Session, text};

/// First packet of the capture "hand in box", fw 2.4, at byte 710.
const PACKET: [u8; xv11::FRAME_LEN] = [
    0xFA, 0xA0, 0x4E, 0x4A, 0x27, 0x01, 0x05, 0x04, 0x27, 0x01, 0xD7, 0x03, 0x26, 0x01, 0x29, 0x04,
    0x26, 0x01, 0xF0, 0x03, 0x3C, 0x5C,
];
/// Vectors of the fielded register bus: read ten registers from 36 on; set the motors.
const READ: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
const WRITE: [u8; 8] = [0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C];

fn record(link: usize, micros: u64, direction: Direction, bytes: &[u8]) -> Record {
    Record {
        link,
        sequence: None,
        at: Instant::from_micros(micros),
        direction,
        kind: Kind::Data,
        bytes: bytes.to_vec().into(),
        sent: None,
        pieces: Vec::new(),
        comment: String::new(),
    }
}

/// Three links: a lidar whose packet comes in two records, a bus with a damaged frame and a fault,
/// a radio that is asked for its version.
fn sample() -> Vec<u8> {
    let mut out = Vec::new();
    Section::default().write(&mut out);
    for (name, baud) in [("lidar", 115_200), ("base", 1_000_000), ("radio", 460_800)] {
        Interface::new(name, baud).write(&mut out);
    }
    let (up, down) = (Direction::ToMaster, Direction::ToDevice);
    let mut bad = WRITE;
    bad[3] = 0x15;
    let fault = Record {
        comment: "fault: byte 8 flip bit 0".to_owned(),
        ..record(1, 2_500, down, &bad)
    };
    let closed = Record {
        kind: Kind::Line(LineEvent::Closed),
        // A comment of another tool may contain line breaks; the output has one line per record.
        comment: "port\nclosed".to_owned(),
        ..record(2, 90_000, up, &[])
    };
    let bus = [READ, READ].concat();
    let records = [
        record(0, 1_000, up, &PACKET[..10]),
        record(1, 1_500, down, &bus),
        record(
            1,
            1_600,
            down,
            &[&READ[..], &WRITE[..], &WRITE, &WRITE].concat(),
        ),
        record(0, 2_000, up, &PACKET[10..]),
        record(0, 2_200, up, &PACKET),
        record(2, 2_300, down, b"AT+VERSION"),
        fault,
        record(1, 3_000, down, &WRITE),
        closed,
    ];
    for one in records {
        let link = u32::try_from(one.link).expect("few");
        one.write(link, &mut out);
    }
    out
}

/// Every line in the order of time, a frame at the time of its last byte. Figures by hand: 0x4A4E
/// is 297.22 in 64ths, the readings are 0x127 and 0x126; the damaged frame's sum is 0x25D.
#[test]
fn a_capture_is_told_frame_by_frame_in_the_order_of_time() {
    let session = Session::new("decode");
    fs::write(session.folder.join("c.pcapng"), sample()).expect("writable");
    let output = session.hilrig(&["decode", "c.pcapng"]);
    let read = "read 10 from 36: encoder_left encoder_right speed_left_is speed_right_is";
    let write = "46: speed_left_to=20 ticks/40 ms speed_right_to=-20 ticks/40 ms motor_standby=0";
    let packet = "297.22 rpm, from 0 deg: 295 295 294 294 mm";
    let expected = [
        format!("0.001500 base to-device @0 {read}"),
        format!("0.001500 base to-device @5 {read}"),
        format!("0.001600 base to-device @10 {read}"),
        format!("0.001600 base to-device @15 {write}"),
        format!("0.001600 base to-device @23 {write}"),
        format!("0.001600 base to-device @31 {write}"),
        format!("0.002000 lidar to-master @0 {packet}"),
        format!("0.002200 lidar to-master @22 {packet}"),
        "0.002300 radio to-device @0 AT command \"AT+VERSION\": Version".to_owned(),
        "0.002500 base to-device @39 EVENT fault: byte 8 flip bit 0".to_owned(),
        format!("0.003000 base to-device @47 {write}"),
        "0.090000 radio to-master @0 EVENT port closed".to_owned(),
    ];
    let lines: Vec<String> = text(&output.stdout).lines().map(str::to_owned).collect();
    let is_bad = |line: &&String| line.contains("BAD");
    let bad_lines: Vec<_> = lines.iter().filter(is_bad).collect();
    assert_eq!(bad_lines.len(), 1, "{lines:#?}");
    assert!(
        bad_lines[0].starts_with("0.002500 base to-device @39 BAD 8 bytes"),
        "{bad_lines:?}"
    );
    assert!(
        bad_lines[0].contains("checksum is 0x025c, expected 0x025d"),
        "{bad_lines:?}"
    );
    let sound: Vec<_> = lines.iter().filter(|line| !is_bad(line)).cloned().collect();
    assert_eq!(sound, expected);
    assert_eq!(output.status.code(), Some(0));

    let only = session.hilrig(&["decode", "c.pcapng", "--link", "lidar"]);
    assert_eq!(text(&only.stdout).lines().count(), 2);
}

/// Files of other tools are recognised and decoded, or refused with a message; --format raw reads
/// them as bytes.
#[test]
fn files_of_other_tools_are_decoded_as_what_they_are() {
    let session = Session::new("decode-foreign");
    let write = |name: &str, bytes: &[u8]| {
        fs::write(session.folder.join(name), bytes).expect("writable");
    };
    let read = "read 10 from 36: encoder_left";
    let packets = |link_type: u8| {
        let mut file = b"\xD4\xC3\xB2\xA1\x02\0\x04\0\0\0\0\0\0\0\0\0\xFF\xFF\0\0".to_vec();
        file.extend([link_type, 0, 0, 0]);
        file.extend([1, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 5, 0, 0, 0]);
        file.extend(READ);
        file
    };
    write("a.hex", b"AB 24 0A 00 D9\n");
    write("a.xxd", b"00000000: ab24 0a00 d9   .$...\n");
    write("user0.pcap", &packets(147));
    write("ethernet.pcap", &packets(1));
    for (name, form) in [
        ("a.hex", "hex"),
        ("a.xxd", "hexdump"),
        ("user0.pcap", "pcap"),
    ] {
        let output = session.hilrig(&["decode", name]);
        let said = text(&output.stdout);
        assert!(said.contains(read), "{name}: {said}");
        let error = text(&output.stderr);
        assert!(
            error.contains(&format!("{name} is read as {form}")),
            "{error}"
        );
    }
    let output = session.hilrig(&["decode", "a.hex", "--format", "raw"]);
    assert!(
        text(&output.stdout).contains("text \"AB 24"),
        "{}",
        text(&output.stdout)
    );
    let output = session.hilrig(&["decode", "ethernet.pcap"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("Ethernet"),
        "{}",
        text(&output.stderr)
    );
    write("log.txt", b"motor: idle\nmotor: on\n");
    let output = session.hilrig(&["decode", "log.txt", "--diagnose"]);
    assert!(
        text(&output.stdout).contains("this is text, 2 lines"),
        "{}",
        text(&output.stdout)
    );
}

/// Bytes of an unknown protocol are printed unchanged, with the known facts of the line; --as
/// decodes them with a given protocol.
#[test]
fn an_unknown_protocol_is_not_taken_for_a_known_one() {
    let session = Session::new("decode-unknown");
    let pairs = b"\x8C\x3A\xFE".repeat(30);
    fs::write(session.folder.join("d.bin"), &pairs).expect("writable");
    let output = session.hilrig(&["decode", "d.bin"]);
    assert!(
        text(&output.stdout).contains("@0 DATA 90 bytes 8C 3A FE"),
        "{}",
        text(&output.stdout)
    );
    let error = text(&output.stderr);
    assert!(
        error.contains("of no known protocol") && error.contains("entropy"),
        "{error}"
    );
    let output = session.hilrig(&["decode", "d.bin", "--as", "car-command", "--summary"]);
    assert!(text(&output.stdout).contains("90 bytes of car-command, 60 of them"));
    let output = session.hilrig(&["decode", "d.bin", "--summary"]);
    assert!(text(&output.stdout).contains("1 pieces of 90 to 90 bytes"));
}

/// A slave from the capture's own scenario is decoded with its own register names.
#[test]
fn an_own_slave_is_decoded_with_its_own_names() {
    let session = Session::new("decode-own-slave");
    let scenario = "schema = 1\nname = \"own\"\nrobot = \"none\"\nduration = \"1s\"\n\
                    [device.grip.registers]\nbaud = 115200\nregister = [\n\
                    { address = 36, name = \"force\", width = \"i16\", initial = 7 },\n\
                    { address = 46, name = \"grip-to\", width = \"u8\", access = \"write\" },\n]\n";
    let mut out = Vec::new();
    let section = Section {
        scenario: scenario.to_owned(),
        ..Section::default()
    };
    section.write(&mut out);
    Interface::new("grip", 115_200).write(&mut out);
    record(0, 1_000, Direction::ToDevice, &READ).write(0, &mut out);
    record(0, 2_000, Direction::ToDevice, &WRITE).write(0, &mut out);
    fs::write(session.folder.join("c.pcapng"), out).expect("writable");
    let output = session.hilrig(&["decode", "c.pcapng"]);
    let said = text(&output.stdout);
    assert!(said.contains("read 10 from 36: force\n"), "{said}");
    assert!(said.contains("46: grip-to=20 EC 00\n"), "{said}");
}

/// A description may have different frames for each direction: the figures count the frames of the
/// line's direction.
#[test]
fn frames_are_counted_by_the_way_they_go() {
    let session = Session::new("decode-two-ways");
    let two = "name = \"two-ways\"\nabout = \"other frames each way\"\nline = { baud = 9600 }\n\
               frame = [{ name = \"out\", terminator = \"\\n\" }, \
               { name = \"in\", start = \"<\", end = \">\" }]\nmessage = [\n\
               { name = \"ask\", from = \"host\", frame = \"in\", text = \"?\" },\n\
               { name = \"ok\", from = \"device\", frame = \"out\", text = \"ok\" },\n]\n\
               on = [{ message = \"ask\", reply = \"ok\" }]\n";
    session.write("two.toml", two);
    let mut out = Vec::new();
    Section::default().write(&mut out);
    Interface::new("box", 9_600).write(&mut out);
    record(0, 1_000, Direction::ToDevice, b"<?\n>").write(0, &mut out);
    record(0, 2_000, Direction::ToMaster, b"<?\n>").write(0, &mut out);
    fs::write(session.folder.join("c.pcapng"), out).expect("writable");
    let line = ["decode", "c.pcapng", "--description", "two.toml"];
    let output = session.hilrig(&[&line[..], &["--json"]].concat());
    let said = text(&output.stdout);
    for framed in ["\"framed\": 3,", "\"framed\": 4,"] {
        assert_eq!(said.matches(framed).count(), 1, "{output:?}");
    }
    let output = session.hilrig(&[&line[..], &["--summary"]].concat());
    let said = text(&output.stdout);
    for framed in [
        "4 bytes of two-ways, 3 of them",
        "4 bytes of two-ways, 4 of them",
    ] {
        assert_eq!(said.matches(framed).count(), 1, "{output:?}");
    }
}

#[test]
fn a_wrong_link_a_missing_file_and_a_wrong_protocol_are_named() {
    let session = Session::new("decode-errors");
    fs::write(session.folder.join("c.pcapng"), sample()).expect("writable");
    for (arguments, wanted) in [
        (
            &["decode", "c.pcapng", "--link", "imu"][..],
            "only: lidar, base, radio",
        ),
        (&["decode", "none.bin"], "cannot read none.bin"),
        (
            &["decode", "c.pcapng", "--protocol", "modbus"],
            "bus-high-first",
        ),
        (
            &["decode", "c.pcapng", "--follow", "--summary"],
            "--summary",
        ),
    ] {
        let output = session.hilrig(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let error = text(&output.stderr);
        assert!(error.contains(wanted), "{arguments:?}: {error}");
    }
}

/// A file that ends in the middle of a block, and one with a changed byte: the valid part is
/// printed, with the position of the damage.
#[test]
fn a_cut_or_broken_capture_is_told_up_to_the_damage() {
    let session = Session::new("decode-broken");
    let bytes = sample();
    fs::write(session.folder.join("cut.pcapng"), &bytes[..bytes.len() - 7]).expect("writable");
    let output = session.hilrig(&["decode", "cut.pcapng"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(
        text(&output.stderr).contains("not a complete block"),
        "{}",
        text(&output.stderr)
    );
    assert!(text(&output.stdout).contains("lidar"));

    let mut broken = bytes.clone();
    let last = broken.len() - 1;
    broken[last] = 0xFF;
    fs::write(session.folder.join("broken.pcapng"), broken).expect("writable");
    let output = session.hilrig(&["decode", "broken.pcapng"]);
    let error = text(&output.stderr);
    assert!(
        error.contains("is broken at byte") && error.contains("ends with length"),
        "{error}"
    );
}

/// A reader that closes the pipe is no error.
#[test]
fn a_closed_pipe_ends_the_command_quietly() {
    let session = Session::new("decode-pipe");
    let many = PACKET.repeat(20_000);
    fs::write(session.folder.join("many.bin"), many).expect("writable");
    let mut child = Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .args(["decode", "many.bin"])
        .current_dir(&session.folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let stdout = child.stdout.take().expect("piped");
    let mut line = String::new();
    BufReader::with_capacity(64, stdout)
        .read_line(&mut line)
        .expect("a line");
    let output = child.wait_with_output().expect("ends");
    assert!(line.starts_with("- raw to-master @0 297.22 rpm"), "{line}");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(!text(&output.stderr).contains("panicked"));
}

/// A capture that grows while it is decoded, its last record torn in two writes.
#[test]
fn a_growing_capture_is_followed() {
    let session = Session::new("decode-follow");
    let bytes = sample();
    let path = session.folder.join("c.pcapng");
    let mut file = fs::File::create(&path).expect("writable");
    let (first, last) = bytes.split_at(bytes.len() - 40);
    file.write_all(first).expect("written");
    let mut child = Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .args(["decode", "c.pcapng", "--follow", "--duration", "10min"])
        .current_dir(&session.folder)
        .stdout(Stdio::piped())
        .spawn()
        .expect("starts");
    let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    // The existing records are printed once the file has not grown for a while.
    let told = lines.next().expect("a line").expect("readable");
    assert!(told.contains("read 10 from 36"), "{told}");
    file.write_all(last).expect("written");
    let closed = lines
        .map_while(Result::ok)
        .find(|line| line.contains("port closed"));
    assert!(closed.is_some());
    child.kill().expect("still there");
    child.wait().expect("our own child");
}

/// Counts made by an independent script over the three real captures; all of its figures.
#[test]
fn the_real_captures_have_the_figures_of_an_independent_count() {
    let invalid_box = "12 x 0x25, 225 x 0x21, 137 x 0x02, 80 x 0x03, 219 x 0x35, 1 x 0x06, \
                       117 x 0x22, 12 x 0x50, 1996 x 0x52";
    let hand_in_box = [
        "252146 bytes of xv11",
        "11451 good frames, 1 bad-checksum candidates, 224 bytes outside frames",
        "rpm min 49.80 median 296.92 mean",
        "max 351.12",
        "index steps: 10938 x 1, 258 x 46, 240 x 45, ",
        " 2 x 44",
        "42875 ok, 130 strength warnings, 2799 invalid",
        "ok: 153..600 mm, strength 58..1202",
        "strength warnings: 157..542 mm, strength 10..315",
        "boot text at byte 251935: \"OK\\n\\rPiccolo Laser Distance Scanner\\n\\rCopyright (c) \
         2009-2010 Neato Robotics, Inc.\\n\\rAll Rights Reserved\\n\\r\\n\\rLoader\\tV2.4.13386\\n\\r\
         CPU\\tF2802x/c600\\n\\rSerial\\tAAA42410AA-0004165\\n\\rLastCal\\t[2010140429]\\n\\r\
         Runtime\\tV2.4.13386\\n\\r#\"",
    ];
    let one_run = [
        "1446 bytes of xv11-turn",
        "1 good frames",
        "period words: 0xd198\n",
        "178 ok, 59 strength warnings, 123 invalid",
        "ok: 149..3279 mm, strength 6..642",
        "strength warnings: 143..647 mm, strength 19..274",
    ];
    let sparkfun = [
        "30366 bytes of xv11-turn",
        "21 good frames",
        "period words: 0xd18b 0xd191 0xd192 0xd193 0xd194 0xd195",
        "bytes from header to header: 1446",
        "3452 ok, 1321 strength warnings, 2787 invalid",
        "ok: 146..3303 mm, strength 5..819",
        "strength warnings: 142..648 mm, strength 6..326",
    ];
    let invalid_one = "7 x 0x21, 86 x 0x35, 13 x 0x03, 16 x 0x02, 1 x 0x25";
    let invalid_fun = "119 x 0x21, 2377 x 0x35, 220 x 0x03, 32 x 0x25, 35 x 0x02, 4 x 0x23";
    for (name, figures, invalid) in [
        ("xevel_hand_in_box_fw24.bin", &hand_in_box[..], invalid_box),
        ("xevel_onerun_noshield_fw21.bin", &one_run[..], invalid_one),
        (
            "xevel_sparkfun_noshield_fw21.bin",
            &sparkfun[..],
            invalid_fun,
        ),
    ] {
        let Some(bytes) = capture(&format!("xv11/{name}")) else {
            return;
        };
        let session = Session::new(&format!("decode-{name}"));
        fs::write(session.folder.join(name), bytes).expect("writable");
        let output = session.hilrig(&["decode", name, "--summary"]);
        let said = text(&output.stdout);
        for figure in figures.iter().copied().chain(invalid.split(", ")) {
            assert!(said.contains(figure), "{name}: {figure:?} in\n{said}");
        }
        let output = session.hilrig(&["decode", name, "--diagnose"]);
        let said = text(&output.stdout);
        assert_eq!(
            said, "raw to-master: no systematic damage found\n",
            "{name}"
        );
    }
}

/// A field capture of a host that lost each NUL byte and turned CR into LF.
#[test]
fn a_host_that_strips_nul_is_named_with_its_evidence() {
    let Some(bytes) = capture("../data/neato/slamrs_out.bin") else {
        return;
    };
    let expected = format!(
        "raw to-master: NUL bytes are missing: the host strips 0x00 (0 times, some {} by chance)\n\
         raw to-master: the host turns CR into LF (0 times 0x0D, 1741 times 0x0A, its neighbours \
         138 times)\n",
        bytes.len() / 256
    );
    let session = Session::new("decode-nul");
    fs::write(session.folder.join("field.bin"), bytes).expect("writable");
    let output = session.hilrig(&["decode", "field.bin", "--diagnose"]);
    assert_eq!(text(&output.stdout), expected);
}

/// Frames of a description, which only pauses end, with the checksum in the other order: the bytes
/// of the checksum are swapped, and each frame has one expected checksum, its own.
#[test]
fn a_swapped_checksum_of_a_description_is_named() {
    let session = Session::new("decode-swapped");
    let described = |order: &str| {
        format!(
            "name = \"hand\"\nabout = \"a device\"\nline = {{ baud = 9600 }}\n\
             frame = {{ silence = 3.5, checksum = {{ algorithm = \"CRC-16/MODBUS\", endian = \
             \"{order}\" }} }}\n[[message]]\nname = \"all\"\nfrom = \
             \"both\"\nfields = [{{ name = \"data\", type = \"bytes\", size = \"rest\" }}]\n[[on]]\nmessage = \"all\"\nreply = \"all\"\n"
        )
    };
    session.write("big.toml", &described("big"));
    session.write("little.toml", &described("little"));
    // The read of two registers from the Modbus specification's examples, ten times.
    let line = |number: u32| format!("[{number}.5] RX: 01 03 00 00 00 02 C4 0B\n");
    session.write("log.txt", &(1..=10).map(line).collect::<String>());
    let decode = |file: &str, more: &[&str]| {
        let output =
            session.hilrig(&[&["decode", "log.txt", "--description", file], more].concat());
        text(&output.stdout).to_owned()
    };
    let wrong = decode("big.toml", &["--diagnose"]);
    assert!(
        wrong.contains(
            "the checksum's bytes are swapped (10 frames hold with the other order, 0 with the \
             expected one)"
        ),
        "{wrong}"
    );
    let right = decode("little.toml", &["--diagnose"]);
    assert!(right.contains("no systematic damage found"), "{right}");
    let frames = decode("big.toml", &[]);
    assert_eq!(frames.matches("checksum is").count(), 10, "{frames}");
}

/// A run's own capture: every line in both directions, no diagnosis, and hardly an invalid byte.
#[test]
fn a_runs_own_capture_is_not_accused() {
    let session = Session::new("decode-own");
    let output = session.hilrig(&["demo", "--out", "out"]);
    assert_eq!(output.status.code(), Some(0));
    let output = session.hilrig(&["decode", "out/capture.pcapng", "--diagnose"]);
    for line in text(&output.stdout).lines() {
        assert!(line.ends_with("no systematic damage found"), "{line}");
    }
    assert!(text(&output.stdout).lines().count() >= 5);

    let output = session.hilrig(&["decode", "out/capture.pcapng"]);
    let told = text(&output.stdout);
    let times = told.lines().map(|line| {
        let time = line.split(' ').next().expect("a word");
        time.replace('.', "").parse::<u64>().expect("microseconds")
    });
    assert!(times.is_sorted());
    assert!(told.lines().count() > 20_000);
}
