//! A recorder between two ports: every byte passes in order and is in the file.

use std::io::Write as _;
use std::path::Path;
use std::process::Command;

use hilrig::capture::{Capture, Kind};
use hilrig::realtime::clock::WallClock;
use hilrig::realtime::tap::{CaptureFile, Recorder, Wire};
use hilrig::realtime::transport::{PortDir, Pty, Transport};
use hilrig::rig::line::Direction;
use protocols::{Instant, LineConfig};
use rustix::process::Signal;

use crate::support::*;

const LINE: LineConfig = LineConfig::new_8n1(115_200);
/// 2026-11-21 00:00:00 UTC.
const EPOCH: Instant = Instant::from_secs(1_795_219_200);

/// All bytes of one direction of the first link.
pub(crate) fn bytes(capture: &Capture, direction: Direction) -> Vec<u8> {
    let records = capture.records.iter();
    let own = records.filter(|r| r.kind == Kind::Data && r.direction == direction);
    own.flat_map(|record| record.bytes.clone()).collect()
}

/// 3000 bytes of all values in one direction and 3000 others back, in pieces of 1 to 97 bytes. The
/// test prints the latency of the recorder. The specified maximum is a millisecond, but no verdict
/// depends on the load of the machine.
#[test]
fn what_passes_two_terminals_is_in_the_file_byte_by_byte() {
    let folder = folder("passes");
    let dir = PortDir::open(&folder.join("ports")).expect("fresh");
    let pty = |name| Pty::open(&dir, name, LINE).expect("a terminal");
    let (a, b) = (pty("a"), pty("b"));
    let mut clients = [client(a.path()), client(b.path())];
    let wire = Wire {
        name: "lidar".to_owned(),
        baud: 115_200,
        ends: [Box::new(a), Box::new(b)],
    };
    let path = folder.join("field.pcapng");
    let file = CaptureFile::create(&path).expect("fresh");
    let recorder = Recorder::new(WallClock::start(), EPOCH, vec![wire], file);
    let mut recorder = recorder.expect("the file can be written");

    let sent: [Vec<u8>; 2] = [7_usize, 11].map(|step| {
        let numbers = (0..3000_usize).map(|n| n * step + n / 256);
        numbers.map(|n| n.to_le_bytes()[0]).collect()
    });
    let mut got = [Vec::new(), Vec::new()];
    let mut done = [0, 0];
    for piece in (1..98).cycle() {
        for from in [0, 1] {
            let end = (done[from] + piece).min(3000);
            clients[from]
                .write_all(&sent[from][done[from]..end])
                .expect("open");
            done[from] = end;
        }
        recorder.turn().expect("both ports stay");
        for to in [0, 1] {
            let wanted = done[1 - to];
            wait_until("the bytes", || {
                recorder.turn().expect("both ports stay");
                read_some(&mut clients[to], &mut got[to]);
                got[to].len() >= wanted
            });
        }
        if done == [3000, 3000] {
            break;
        }
    }
    recorder.finish().expect("written");
    println!("held: {}", recorder.held());

    let capture = Capture::read(&path).expect("written");
    assert_eq!((capture.broken, capture.cut, capture.skipped), (None, 0, 0));
    assert_eq!([&got[1], &got[0]], [&sent[0], &sent[1]]);
    assert_eq!(bytes(&capture, Direction::ToMaster), sent[0]);
    assert_eq!(bytes(&capture, Direction::ToDevice), sent[1]);
    assert!(capture.records.iter().all(|record| record.at >= EPOCH));
    assert_eq!(
        (&*capture.links[0].name, capture.links[0].baud),
        ("lidar", 115_200)
    );
}

/// Starts `hilrig record` between two new terminals; returns clients of both.
fn recording(folder: &Path, out: &str) -> Running {
    let [a, b] = ["a", "b"].map(|name| format!("{name}=pty:{}", folder.join(name).display()));
    Running::start(&["record", "--tap", &a, &b, "-o", out])
}

#[test]
fn a_signal_ends_a_recording_with_a_whole_file() {
    let folder = folder("signal");
    let path = folder.join("field.pcapng");
    let running = recording(&folder, path.to_str().expect("UTF-8"));
    let [mut a, mut b] = ["a", "b"].map(|name| client(&folder.join(name)));
    // The rig sends nothing to a client that it has not noticed yet, so the test writes until the
    // rig replies.
    let mut heard = Vec::new();
    wait_until("a first byte", || {
        a.write_all(b"x").expect("open");
        read_some(&mut b, &mut heard);
        !heard.is_empty()
    });
    running.signal(Signal::INT);
    let (status, said, _) = running.end();
    assert!(status.success(), "{said}");
    assert!(said.starts_with("recorded "), "{said}");
    let capture = Capture::read(&path).expect("written");
    assert_eq!((capture.broken, capture.cut), (None, 0));
    assert!(bytes(&capture, Direction::ToMaster).len() >= heard.len());
}

/// A repeated command must not overwrite hours of another recording.
#[test]
fn a_file_that_is_there_already_is_not_overwritten() {
    let folder = folder("again");
    let path = folder.join("field.pcapng");
    std::fs::write(&path, "precious").expect("writable");
    let name = path.to_str().expect("UTF-8");
    let (status, _, said) = recording(&folder, name).end();
    assert_eq!(status.code(), Some(2));
    assert_eq!(
        said,
        format!(
            "error: --out {name}: there is a file already, expected a free name: \
             move it away or choose another\n"
        )
    );
    assert_eq!(std::fs::read(&path).expect("there"), b"precious");
}

#[test]
fn a_disk_without_room_is_told_at_once() {
    let folder = folder("full");
    let (status, _, said) = recording(&folder, "/dev/full").end();
    assert_eq!(status.code(), Some(2));
    assert_eq!(
        said.lines().last(),
        Some(
            "error: cannot write /dev/full: No space left on device (os error 28); \
             its first 0 bytes are a whole capture"
        )
    );
}

/// A limit on the file size replaces a disk that becomes full in the middle of a block: 8 KiB, in
/// units of 1024 bytes. The limit's signal is ignored, because a full disk sends none.
#[test]
fn a_disk_that_fills_up_leaves_a_whole_file() {
    let folder = folder("fills");
    let path = folder.join("field.pcapng");
    let mut command = Command::new("bash");
    command.args(["-c", "trap '' XFSZ; ulimit -f 8; exec \"$@\"", "bash"]);
    command.args([env!("CARGO_BIN_EXE_hilrig"), "record", "--tap"]);
    for name in ["a", "b"] {
        command.arg(format!("{name}=pty:{}", folder.join(name).display()));
    }
    command.args(["-o", path.to_str().expect("UTF-8")]);
    let mut running = Running::of(command);
    let [mut a, mut b] = ["a", "b"].map(|name| client(&folder.join(name)));
    wait_until("the limit", || {
        let _ = a.write_all(&[0x55; 500]);
        read_some(&mut b, &mut Vec::new());
        running
            .0
            .as_mut()
            .expect("ours")
            .try_wait()
            .expect("ours")
            .is_some()
    });
    let (status, _, said) = running.end();
    assert_eq!(status.code(), Some(2), "{said}");
    assert!(
        said.contains("field.pcapng: File too large (os error 27)"),
        "{said}"
    );
    let capture = Capture::read(&path).expect("written");
    assert_eq!((capture.broken, capture.cut), (None, 0));
    assert_eq!(capture.links.len(), 1);
    // What fits the 8 KiB is kept: more than half of them are recorded bytes.
    let kept: usize = capture.records.iter().map(|one| one.bytes.len()).sum();
    assert!(kept > 4 << 10, "{kept}");
    assert!(
        said.contains(&format!("a whole capture with {kept} of the ")),
        "{said}"
    );
}

#[test]
fn a_port_that_goes_away_ends_a_recording_with_a_whole_file() {
    let folder = folder("vanishes");
    let path = folder.join("field.pcapng");
    let dir = PortDir::open(&folder.join("ports")).expect("fresh");
    let mut device = Pty::open(&dir, "a", LINE).expect("a terminal");
    let a = format!("a={}", device.path().display());
    let b = format!("b=pty:{}", folder.join("b").display());
    let out = path.to_str().expect("UTF-8");
    let running = Running::start(&["record", "--tap", &a, &b, "-o", out]);
    let mut program = client(&folder.join("b"));
    let mut heard = Vec::new();
    wait_until("a first byte", || {
        let _ = device.read(&mut [0; 8]);
        device.write(b"y");
        read_some(&mut program, &mut heard);
        !heard.is_empty()
    });
    let name = device.path().display().to_string();
    drop(device);
    let (status, _, said) = running.end();
    assert_eq!(status.code(), Some(2), "{said}");
    let expected = format!("error: {name}: the port went away: expected it to stay until the end");
    assert!(said.contains(&expected), "{said}");
    let capture = Capture::read(&path).expect("written");
    assert_eq!((capture.broken, capture.cut), (None, 0));
    let recorded = bytes(&capture, Direction::ToMaster);
    assert!(recorded.len() >= heard.len() && recorded.iter().all(|&byte| byte == b'y'));
}

#[test]
fn a_rate_for_an_unknown_link_is_refused() {
    let folder = folder("rate");
    let arguments = [
        "record",
        "--tap",
        "a=/dev/null",
        "b=/dev/null",
        "--baud",
        "c=9600",
    ];
    let (status, _, said) = hilrig(&folder, &[&arguments[..], &["-o", "x"]].concat());
    assert_eq!(status.code(), Some(2));
    assert_eq!(said, "error: --baud c: no such link; expected one of a\n");
}
