//! Replay of a capture into real pseudo-terminals, and its command.

use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use hilrig::capture::{Capture, Interface, Kind, Record, Section};
use hilrig::rig::line::Direction;
use protocols::Instant;
use protocols::avr::{self, ChecksumOrder};
use rustix::process::Signal;

use crate::record::bytes;
use crate::support::*;

/// A capture of one link, with chunks a millisecond apart from 1 ms on; UTC.
fn field(path: &Path, link: &str, chunks: &[(Direction, &[u8])]) {
    let mut out = Vec::new();
    let section = Section {
        about: "clock=utc".to_owned(),
        ..Section::default()
    };
    section.write(&mut out);
    Interface::new(link, 115_200).write(&mut out);
    for (number, (direction, bytes)) in (1..).zip(chunks) {
        let record = Record {
            link: 0,
            sequence: Some(number),
            at: Instant::from_secs(1_795_219_200) + core::time::Duration::from_millis(number),
            direction: *direction,
            kind: Kind::Data,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        };
        record.write(0, &mut out);
    }
    let mut file = File::create(path).expect("fresh");
    file.write_all(&out).expect("there is room");
}

fn shown(path: &Path) -> String {
    path.to_str().expect("UTF-8").to_owned()
}

/// A file of 30,000 bytes is replayed into a recorder's terminal, and a client reads at the other
/// side. The client and the second file receive each byte of the first in order. The replay is
/// twenty times as fast as the recording, faster than the client reads.
#[test]
fn what_was_recorded_is_replayed_and_recorded_again_byte_by_byte() {
    let folder = folder("chain");
    let numbers = (0..30_000_usize).map(|n| (n * 7 + n / 251).to_le_bytes()[0]);
    let all: Vec<u8> = numbers.collect();
    let chunks: Vec<_> = all.chunks(37).map(|c| (Direction::ToMaster, c)).collect();
    let (first, second) = (folder.join("first.pcapng"), folder.join("second.pcapng"));
    field(&first, "lidar", &chunks);
    let [device, program] = ["device", "program"].map(|name| folder.join(name));
    let ends = [&device, &program].map(|path| format!("x=pty:{}", shown(path)));
    let record = Running::start(&["record", "--tap", &ends[0], &ends[1], "-o", &shown(&second)]);
    let mut client = client(&program);
    // As soon as a byte passes, the recorder has noticed that both ports are open. This byte is in
    // its file, too.
    let mut probe = crate::support::client(&device);
    let mut got = Vec::new();
    wait_until("a first byte", || {
        probe.write_all(&[0]).expect("open");
        read_some(&mut client, &mut got);
        !got.is_empty()
    });
    drop(probe);
    wait_until("quiet", || {
        let before = got.len();
        read_some(&mut client, &mut got);
        got.len() == before
    });
    let probes = got.len();

    let to = format!("lidar={}", shown(&device));
    let replay = Running::start(&["replay", &shown(&first), "--to", &to, "--speed", "20"]);
    wait_until("all bytes", || {
        read_some(&mut client, &mut got);
        got.len() >= probes + all.len()
    });
    let (status, said, _) = replay.end();
    assert!(status.success(), "{said}");
    assert!(said.contains("lidar: 30000 B sent, 0 B received"), "{said}");
    record.signal(Signal::TERM);
    let (status, said, _) = record.end();
    assert!(status.success(), "{said}");
    assert_eq!(got[probes..], all);
    let again = Capture::read(&second).expect("written");
    let again = bytes(&again, Direction::ToMaster);
    assert_eq!(again[again.len() - all.len()..], all);
}

/// A request of the program and the device's reply, as a file of the field.
fn request_and_reply(path: &Path) -> [Vec<u8>; 2] {
    let request = avr::Frame::read(36, 2, ChecksumOrder::LowFirst);
    let reply = avr::Frame::write(36, &[0x12, 0x34], ChecksumOrder::LowFirst);
    let [request, reply] = [request, reply].map(|frame| frame.as_bytes().to_vec());
    let chunks = [
        (Direction::ToDevice, &*request),
        (Direction::ToMaster, &*reply),
    ];
    field(path, "base", &chunks);
    [request, reply]
}

/// The capture replaces the program and compares the replies of the device on the port.
fn answered(name: &str, answer: impl Fn(&[u8]) -> Vec<u8>) -> (Option<i32>, String) {
    let folder = folder(name);
    let file = folder.join("field.pcapng");
    let [request, reply] = request_and_reply(&file);
    let port = folder.join("base");
    let to = format!("base=pty:{}", shown(&port));
    let arguments = [
        "replay",
        &shown(&file),
        "--to",
        &to,
        "--as",
        "program",
        "--expect",
    ];
    let replay = Running::start(&arguments);
    let mut device = client(&port);
    let mut heard = Vec::new();
    wait_until("the request", || {
        read_some(&mut device, &mut heard);
        heard.len() >= request.len()
    });
    assert_eq!(heard, request);
    device.write_all(&answer(&reply)).expect("open");
    let (status, said, _) = replay.end();
    (status.code(), said)
}

#[test]
fn a_device_that_answers_as_captured_passes() {
    let (code, said) = answered("as-captured", <[u8]>::to_vec);
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.ends_with("no divergence: the same bytes as in the capture\n"),
        "{said}"
    );
}

/// The reply was complete 2 ms after the epoch, 1 ms after the file's first record; its fourth byte
/// is the first of the data. AB + 24 + 82 + 13 + 34 = 198.
#[test]
fn a_device_that_answers_otherwise_is_told_with_byte_and_frame() {
    let (code, said) = answered("otherwise", |reply| {
        let mut reply = reply.to_vec();
        reply[3] ^= 1;
        reply
    });
    assert_eq!(code, Some(1), "{said}");
    let (_, told) = said.split_once("DIVERGENCE ").expect("told");
    let told: Vec<&str> = told.lines().map(str::trim).collect();
    let expected = [
        "at 0.001000 s, base to-master, byte 3: expected 0x12, got 0x13",
        "expected: 36: 12 34 (bus frame, bytes 0..=6)",
        "got:      no bus frame (bytes 0..=6); checksum is 0x0197, expected 0x0198: \
         AB 24 82 [13] 34 97 01",
    ];
    assert_eq!(told, expected);
}

/// Each line on standard input sends one piece; nothing is sent without a line.
#[test]
fn a_stepped_replay_sends_one_piece_a_line() {
    let folder = folder("stepped");
    let file = folder.join("field.pcapng");
    let pieces: [&[u8]; 3] = [b"one", b"two", b"three"];
    field(
        &file,
        "lidar",
        &pieces.map(|piece| (Direction::ToMaster, piece)),
    );
    let port = folder.join("lidar");
    let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
    command.args(["replay", &shown(&file), "--step", "--to"]);
    command.arg(format!("lidar=pty:{}", shown(&port)));
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let child = command.stderr(Stdio::piped()).spawn();
    let mut replay = Running(Some(child.expect("the command starts")));
    let child = replay.0.as_mut().expect("running");
    let mut lines = child.stdin.take().expect("piped");
    let mut client = client(&port);
    let (mut got, mut expected) = (Vec::new(), Vec::new());
    for piece in pieces {
        lines.write_all(b"\n").expect("it listens");
        expected.extend_from_slice(piece);
        wait_until("a piece", || {
            read_some(&mut client, &mut got);
            got.len() >= expected.len()
        });
        read_some(&mut client, &mut got);
        assert_eq!(got, expected);
    }
    drop(lines);
    let (status, said, _) = replay.end();
    assert!(status.success(), "{said}");
    let told = "0.000000 s lidar 6F 6E 65\n0.001000 s lidar 74 77 6F\n";
    assert!(said.starts_with(&told.replace(" s ", " ")), "{said}");
    assert!(said.ends_with("lidar: 11 B sent, 0 B received\n"), "{said}");
}

/// The capture replaces the program on the ports of a rig in another process, whose devices reply.
#[test]
fn a_capture_is_played_into_the_ports_of_a_running_rig() {
    let folder = folder("dir");
    let (scenario, source) = in_a_room("1s", "");
    let text = toml::to_string(&scenario).expect("has a TOML form");
    std::fs::write(folder.join("room.toml"), text).expect("writable");
    let file = folder.join("capture.pcapng");
    captured((scenario, source), &file, |_| {});
    let dir = folder.join("ports");
    let room = shown(&folder.join("room.toml"));
    let up = Running::start(&["up", &room, "--dir", &shown(&dir), "--duration", "60s"]);
    wait_until("the ports", || dir.join("base").exists());
    let replay = Running::start(&["replay", &shown(&file), "--dir", &shown(&dir)]);
    let (status, said, error) = replay.end();
    assert!(status.success(), "{said}{error}");
    up.signal(Signal::TERM);
    let (status, told, error) = up.end();
    assert!(status.success(), "{told}{error}");
    let base = said.lines().find(|line| line.trim().starts_with("base: "));
    let words: Vec<&str> = base.expect("the base's link").split_whitespace().collect();
    let [sent, back] = [words[1], words[4]].map(|n| n.parse::<usize>().expect("a number"));
    assert!(sent > 100 && back > 100, "{said}");
}

#[test]
fn a_file_that_is_no_capture_is_refused() {
    let folder = folder("no-capture");
    File::create(folder.join("x.bin"))
        .and_then(|mut f| f.write_all(&[0x55; 64]))
        .expect("written");
    let (status, _, said) = hilrig(&folder, &["replay", "x.bin"]);
    assert_eq!(status.code(), Some(2));
    assert_eq!(
        said,
        "error: x.bin: expected a capture of hilrig; if these are the bytes of a port, import them \
         first: hilrig import x.bin --format raw --baud N -o x.imported.pcapng\n"
    );
}

/// A log and a capture of another tool name the command that imports them, and that works.
#[test]
fn a_file_of_another_tool_is_to_be_imported_first() {
    let folder = folder("foreign-capture");
    std::fs::write(folder.join("bus.log"), "TX: 01 03 AB\nRX: 01 83 02\n").expect("written");
    // A pcap of the link type USER0: its head, and one packet of two bytes.
    let words: [u32; 10] = [0xA1B2_C3D4, 0x0004_0002, 0, 0, 0xFFFF, 147, 1, 0, 2, 2];
    let mut pcap: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    pcap.extend([0xAB, 0x24]);
    std::fs::write(folder.join("bus.pcap"), pcap).expect("written");
    for (file, format) in [("bus.log", "hex"), ("bus.pcap", "pcap")] {
        for command in [&["replay", file][..], &["case", "from", file]] {
            let (status, _, said) = hilrig(&folder, command);
            assert_eq!(status.code(), Some(2));
            let expected = format!(
                "error: {file}: expected a capture of hilrig, found {format}; import it first: \
                 hilrig import {file} -o bus.imported.pcapng\n"
            );
            assert_eq!(said, expected);
        }
        let (status, _, said) = hilrig(&folder, &["import", file, "-o", "bus.imported.pcapng"]);
        assert_eq!(status.code(), Some(0), "{said}");
    }
    // Without dates, the log is a case of a program of your own.
    hilrig(&folder, &["import", "bus.log", "-o", "bus.pcapng"]);
    let (status, said, error) = hilrig(&folder, &["case", "from", "bus.pcapng"]);
    assert_eq!(status.code(), Some(0), "{error}");
    assert!(
        said.contains("run it with: hilrig run case.toml --exec CMD"),
        "{said}"
    );
    let rule = ["case", "from", "bus.pcapng", "--expect", "talks=lime"];
    let (status, _, said) = hilrig(&folder, &rule);
    assert_eq!(status.code(), Some(2));
    let expected =
        "error: --expect: the link is \"lime\", did you mean \"line\"? Expected one of line\n";
    assert_eq!(said, expected);
}

#[test]
fn a_capture_without_a_robot_asks_for_one() {
    let folder = folder("no-robot");
    request_and_reply(&folder.join("field.pcapng"));
    let (status, _, said) = hilrig(&folder, &["replay", "field.pcapng"]);
    assert_eq!(status.code(), Some(2));
    assert_eq!(
        said,
        "error: field.pcapng: does not contain its scenario: expected --scenario FILE\n"
    );
}

/// All steps by commands: the replay of a run's capture reproduces its outputs.
#[test]
fn a_runs_capture_is_replayed_by_the_command() {
    let folder = folder("command");
    captured(in_a_room("2s", ""), &folder.join("capture.pcapng"), |_| {});
    let (status, said, _) = hilrig(&folder, &["replay", "capture.pcapng", "--expect"]);
    assert_eq!(status.code(), Some(0), "{said}");
    let last = said.lines().last();
    let expected = "no divergence: the same bytes as in the capture, at most 0 ns apart in time";
    assert_eq!(last, Some(expected));
}

/// A client that opens the port, reads and closes it early causes a message and ends the replay;
/// its directory is then free again. As a conversation, the request is missing; by time, bytes are
/// left.
#[test]
fn a_client_that_closes_early_ends_the_replay_with_a_word() {
    let folder = folder("closed");
    let file = folder.join("field.pcapng");
    let [request, _] = request_and_reply(&file);
    let port = folder.join("ports/base");
    let to = format!("base=pty:{}", shown(&port));
    let words = ["replay", &shown(&file), "--to", &to, "--expect"];
    let replay = Running::start(&words);
    let client = client(&port);
    // The port is open long enough to be noticed: an opening between two polls leaves no sign.
    let mut looks = 0;
    wait_until("some looks", || {
        looks += 1;
        looks > 100
    });
    drop(client);
    let (status, said, told) = replay.end();
    assert_eq!(status.code(), Some(1), "{said}{told}");
    assert!(
        told.contains("base: the client closed the port; 0 of 1 requests"),
        "{told}"
    );
    assert!(
        said.contains("base: 0 of 1 requests were made\nDIVERGENCE"),
        "{said}"
    );

    // The directory can be used again, and a client that sends its request gets its conversation.
    let replay = Running::start(&words);
    let mut client = crate::support::client(&port);
    client.write_all(&request).expect("open");
    let mut heard = Vec::new();
    wait_until("the reply", || {
        read_some(&mut client, &mut heard);
        heard.len() >= request.len() + 2
    });
    let (status, said, told) = replay.end();
    assert_eq!(status.code(), Some(0), "{said}{told}");

    let long: Vec<u8> = vec![7; 3000];
    let chunks: Vec<_> = (0..9).map(|_| (Direction::ToMaster, &long[..])).collect();
    field(&file, "base", &chunks);
    let replay = Running::start(&["replay", &shown(&file), "--to", &to, "--by-time"]);
    let client = crate::support::client(&port);
    looks = 0;
    wait_until("some looks", || {
        looks += 1;
        looks > 100
    });
    drop(client);
    let (status, said, told) = replay.end();
    assert_eq!(status.code(), Some(1), "{said}{told}");
    assert!(
        told.contains("base: the client closed the port; "),
        "{told}"
    );
}
