//! The capture of a run: true to the bytes on the lines, and readable by other programs.

use core::time::Duration;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use hilrig::Shared;
use hilrig::capture::{Capture, Kind, Limits, Recording, about, about_live};
use hilrig::rig::fault::{Damage, FaultId, Strike, Window};
use hilrig::rig::line::Direction;
use hilrig::rig::trace::{Side, Tap};
use hilrig::run::Run;
use protocols::{Instant, LineConfig, LineEvent};

use super::in_a_room;

/// All chunks of one line, on each side, with their times.
type Chunks = Vec<(usize, Direction, u64, Vec<u8>)>;

/// Stores the input of the trace.
#[derive(Default)]
struct Witness {
    sent: Shared<Chunks>,
    received: Shared<Chunks>,
}

impl Tap for Witness {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        let chunks = match side {
            Side::Sent => &self.sent,
            Side::Received => &self.received,
        };
        let chunk = (link, to, at.as_nanos(), bytes.to_vec());
        chunks.lock().push(chunk);
    }
}

fn folder(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).expect("the target folder can be written");
    dir
}

/// Two seconds of the rescue robot with one strike of each kind, a cut and a latency on the base's
/// line, and a radio line that was opened.
fn faulty_run() -> Run {
    let (scenario, source) = in_a_room("2s", "[expect]\n");
    let mut run = Run::new(scenario, &source, None).expect("wired");
    let base = run.rig.link_mut("base").expect("the robot has one");
    let line = base.line_mut(Direction::ToMaster);
    line.latency = Duration::from_micros(500);
    let damages = [
        Damage::Flip { bit: 3 },
        Damage::Drop,
        Damage::Insert { value: 0xEE },
        Damage::Duplicate,
    ];
    for (byte, damage) in (100..).step_by(10).zip(damages) {
        line.faults.add_strike(Strike { byte, damage });
    }
    line.faults.add_cut(
        FaultId(0),
        Window {
            from: Instant::from_millis(900),
            until: Instant::from_millis(1000),
        },
    );
    run
}

fn record(mut run: Run, path: &Path, limits: Limits) -> Run {
    let about = about(run.scenario());
    let recording = Recording::create(path, &run.rig, about, limits);
    run.rig
        .add_tap(Box::new(recording.expect("can be written")));
    while !run.is_over() {
        run.step();
    }
    run.rig.finish_taps().expect("all was written");
    run
}

/// Compares the capture with a second record, made from the trace's own calls: both sides of every
/// chunk, to the nanosecond. Chunks in flight at the end are not in the file.
#[test]
fn a_capture_holds_both_sides_of_every_chunk() {
    let path = folder("capture-true").join("capture.pcapng");
    let witness = Witness::default();
    let books = [witness.sent.clone(), witness.received.clone()];
    let mut run = faulty_run();
    run.rig.add_tap(Box::new(witness));
    let run = record(run, &path, Limits::default());
    let capture = Capture::read(&path).expect("readable");
    assert_eq!((capture.broken, capture.cut, capture.skipped), (None, 0, 0));

    let data = capture.records.iter().filter(|r| r.kind == Kind::Data);
    let (mut sent, mut received) = (Chunks::new(), Chunks::new());
    for record in data {
        let (link, to) = (record.link, record.direction);
        let rate = LineConfig::new_8n1(capture.links[link].baud);
        let pieces = record.chunks(rate).into_iter();
        let pieces: Chunks = pieces
            .map(|(at, bytes)| (link, to, at.as_nanos(), bytes.to_vec()))
            .collect();
        match &record.sent {
            Some(left) if left.bytes == record.bytes => {
                let early = record.at.as_nanos() - left.at.as_nanos();
                let pieces = pieces.iter().cloned();
                sent.extend(pieces.map(|chunk| (link, to, chunk.2 - early, chunk.3)));
            }
            Some(left) => sent.push((link, to, left.at.as_nanos(), left.bytes.to_vec())),
            None => sent.extend(pieces.iter().cloned()),
        }
        received.extend(pieces);
    }
    // Bytes leave in another order than they arrive, but in the same order on each line.
    for (index, link) in run.rig.links().iter().enumerate() {
        for to in [Direction::ToMaster, Direction::ToDevice] {
            let of_line = |chunks: &Chunks| -> Chunks {
                let own = chunks
                    .iter()
                    .filter(|chunk| (chunk.0, chunk.1) == (index, to));
                own.cloned().collect()
            };
            let arrived = of_line(&books[1].lock());
            assert_eq!(of_line(&received), arrived, "{} {}", link.name, to.name());
            let (captured, mut truth) = (of_line(&sent), of_line(&books[0].lock()));
            let on_the_way = truth.split_off(captured.len());
            assert_eq!(captured, truth, "{} {}", link.name, to.name());
            assert!(on_the_way.len() <= 64, "{}", on_the_way.len());
        }
    }
    let times: Vec<Instant> = capture.records.iter().map(|record| record.at).collect();
    assert!(times.is_sorted());
    let numbers = capture.records.iter().map(|record| record.sequence);
    assert!(numbers.eq((0..).map(Some).take(capture.records.len())));
}

#[test]
fn a_capture_says_what_the_faults_did() {
    let path = folder("capture-faults").join("capture.pcapng");
    record(faulty_run(), &path, Limits::default());
    let capture = Capture::read(&path).expect("readable");
    let said = |what: &str| {
        let found = capture.records.iter().filter(|r| r.comment.contains(what));
        found.count()
    };
    for strike in [
        "byte 100 flip bit 3",
        "byte 110 drop",
        "byte 120 insert 0xee",
        "byte 130 duplicate",
    ] {
        assert_eq!(said(strike), 1, "{strike}");
    }
    assert!(said("line cut") > 0);
    assert_eq!(capture.sections[0].fact("clock"), Some("virtual"));
    assert_eq!(capture.sections[0].fact("scenario"), Some("test"));
    let names: Vec<&str> = capture.links.iter().map(|link| &*link.name).collect();
    assert!(
        names.contains(&"lidar") && names.contains(&"base"),
        "{names:?}"
    );
}

/// Long runs must not fill the disk: the newest file has the plain name, and the oldest files are
/// removed.
#[test]
fn a_long_recording_puts_files_aside_and_keeps_the_newest() {
    let dir = folder("capture-rotation");
    let path = dir.join("capture.pcapng");
    let limits = Limits {
        file_bytes: 20_000,
        files: 2,
        ..Limits::default()
    };
    record(faulty_run(), &path, limits);
    let mut numbers = Vec::new();
    let entries = fs::read_dir(&dir).expect("exists");
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.expect("readable").path())
        .collect();
    // The names of earlier files sort before the newest: a digit before a letter.
    paths.sort();
    assert_eq!(paths.len(), 3, "{paths:?}");
    for path in paths {
        let capture = Capture::read(&path).expect("readable");
        assert_eq!((capture.broken, capture.cut), (None, 0));
        assert!(!capture.links.is_empty());
        numbers.extend(capture.records.iter().filter_map(|record| record.sequence));
    }
    assert!(numbers.is_sorted_by(|a, b| a + 1 == *b));
}

/// V5: an hour of the rescue robot takes two files. The recording is read completely from either
/// file. A file of another recording in the same folder is not treated as a part of it.
#[test]
fn a_recording_of_several_files_is_read_as_one() {
    let dir = folder("capture-parts");
    let (one, several) = (dir.join("one.pcapng"), dir.join("several.pcapng"));
    record(faulty_run(), &one, Limits::default());
    let limits = |files| Limits {
        file_bytes: 20_000,
        files,
        ..Limits::default()
    };
    record(faulty_run(), &several, limits(100));
    let whole = Capture::read(&one).expect("readable");
    let count = fs::read_dir(&dir).expect("exists").count() - 1;
    assert!(count > 3, "{count} files");
    for name in ["several.pcapng", "several.1.pcapng", "several.3.pcapng"] {
        let (read, files) = Capture::read_recording(&dir.join(name)).expect("readable");
        assert_eq!(
            (read.records == whole.records, files),
            (true, count),
            "{name}"
        );
        assert_eq!(
            (&read.links, &read.sections),
            (&whole.links, &whole.sections)
        );
    }
    let (_, files) = Capture::read_recording(&one).expect("readable");
    assert_eq!(files, 1);

    // A missing file ends the recording: later files may belong to another one.
    fs::remove_file(dir.join("several.2.pcapng")).expect("there");
    let read = |name: &str| Capture::read_recording(&dir.join(name)).expect("readable");
    assert_eq!(read("several.pcapng").1, count - 2);
    assert_eq!(read("several.1.pcapng").1, 1);

    // Files of an earlier recording; the newest has the name of a missing file.
    fs::copy(dir.join("several.1.pcapng"), dir.join("several.2.pcapng")).expect("writable");
    assert_eq!(read("several.pcapng").1, count - 2);
    fs::write(dir.join("several.2.pcapng"), "no capture").expect("writable");
    assert_eq!(read("several.3.pcapng").1, count - 2);
}

/// A file that cannot be renamed stands for any error of a disk: the operator of a live run must
/// see the error while the run continues, not hours later at its end.
#[test]
fn what_stops_a_recording_is_told_while_the_run_goes_on() {
    let dir = folder("capture-trouble");
    fs::create_dir_all(dir.join("capture.1.pcapng/in the way")).expect("writable");
    let limits = Limits {
        file_bytes: 20_000,
        ..Limits::default()
    };
    let (scenario, source) = in_a_room("60s", "[expect]\n");
    let mut run = Run::new(scenario, &source, None).expect("wired");
    let about = about_live(run.scenario(), Instant::from_secs(1));
    let recording = Recording::create(&dir.join("capture.pcapng"), &run.rig, about, limits);
    run.rig
        .add_tap(Box::new(recording.expect("can be written")));
    // Gathered pieces are written each half second, at most four pieces ahead of the disk.
    let mut trouble = None;
    for second in 1..=10 {
        run.go_on_until(Instant::from_secs(second));
        trouble = trouble.or(run.rig.take_tap_trouble());
    }
    let trouble = trouble.expect("it was stopped in the first seconds");
    assert!(trouble.starts_with("the capture ends here: "), "{trouble}");
    assert_eq!(run.rig.take_tap_trouble(), None, "told once");
    let error = run.rig.finish_taps().expect_err("and again at the end");
    assert!(trouble.ends_with(&error.to_string()), "{error}");
}

/// Wireshark is the judge of the format: names, rates, direction, nanoseconds, comments, payload.
#[test]
fn tshark_reads_a_capture() {
    let path = folder("capture-tshark").join("capture.pcapng");
    record(faulty_run(), &path, Limits::default());
    let fields = [
        "frame.time_epoch",
        "frame.interface_name",
        "frame.packet_flags_direction",
        "frame.comment",
        "rtacser.eventtype",
    ];
    let mut tshark = Command::new("tshark");
    tshark
        .args(["-n", "-T", "fields", "-E", "separator=|", "-r"])
        .arg(&path);
    tshark.args(fields.iter().flat_map(|field| ["-e", *field]));
    let output = match tshark.output() {
        Ok(output) => output,
        Err(error) if std::env::var_os("CI").is_none() => {
            // Past the test runner's capture of output; an error of a closed one cannot be
            // reported.
            let _ = writeln!(std::io::stderr(), "SKIPPED: no tshark: {error}");
            return;
        }
        Err(error) => panic!("tshark: {error}"),
    };
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let capture = Capture::read(&path).expect("readable");
    assert_eq!(text.lines().count(), capture.records.len(), "{errors}");
    for (line, record) in text.lines().zip(&capture.records) {
        let columns: Vec<&str> = line.split('|').collect();
        let nanos = record.at.as_nanos();
        let time = format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000);
        assert_eq!(columns[0], time);
        assert_eq!(columns[1], capture.links[record.link].name);
        let direction = u32::from_str_radix(columns[2].trim_start_matches("0x"), 16);
        let to_device = record.direction == Direction::ToDevice;
        assert_eq!(direction, Ok(1 + u32::from(to_device)), "{line}");
        assert_eq!(columns[3], record.comment);
        let event = match record.kind {
            Kind::Data if to_device => "1",
            Kind::Data => "2",
            Kind::Line(LineEvent::Opened | LineEvent::Closed) => "0",
            other => panic!("{other:?}"),
        };
        let number = columns[4].trim_start_matches("0x").trim_start_matches('0');
        assert_eq!(number, event.trim_start_matches('0'), "{line}");
    }
}
