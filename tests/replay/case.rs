//! A capture as a regression test: it fails for the defect of the captured program, and passes
//! after the correction.

use std::fs;
use std::path::Path;

use firmware_core::map_view::MapView;
use firmware_core::pose::Pose;
use firmware_core::robots::rescue::Rescue;
use firmware_core::{Inspect, Master, Work};
use hilrig::capture::case::{Case, Judgement};
use hilrig::capture::replay::{Recorded, scenario_of};
use hilrig::capture::{Capture, Section};
use hilrig::rig::Program;
use hilrig::rig::line::Direction;
use proptest::prelude::*;
use protocols::{Instant, LineConfig, Port};

use crate::support::*;

/// Defect of a program.
#[derive(Clone, Copy)]
enum Defect {
    /// From the 200th byte to the base on, one bit of each 50th byte is wrong.
    Mangles,
    /// The program hangs from this time on: it neither receives, nor computes, nor sends.
    HangsAt(Instant),
}

/// The robot's program with a defect.
#[derive(Clone)]
struct Broken {
    inner: Box<dyn Program>,
    defect: Defect,
    sent: usize,
    now: Instant,
}

impl Broken {
    fn of(inner: Box<dyn Program>, defect: Defect) -> Box<dyn Program> {
        Box::new(Self {
            inner,
            defect,
            sent: 0,
            now: Instant::ZERO,
        })
    }

    fn hangs(&self) -> bool {
        matches!(self.defect, Defect::HangsAt(at) if self.now >= at)
    }
}

impl Master for Broken {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        self.now = now;
        if !self.hangs() {
            self.inner.receive(port, now, bytes);
        }
    }

    fn poll(&mut self, now: Instant) {
        self.now = now;
        if !self.hangs() {
            self.inner.poll(now);
        }
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        if self.hangs() {
            return 0;
        }
        let len = self.inner.transmit(port, buf);
        if port == Rescue::BASE && matches!(self.defect, Defect::Mangles) {
            for byte in &mut buf[..len] {
                self.sent += 1;
                if self.sent > 200 && self.sent.is_multiple_of(50) {
                    *byte ^= 0x10;
                }
            }
        }
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        self.inner.poll_at().filter(|_| !self.hangs())
    }

    fn line_config(&self, port: Port) -> LineConfig {
        self.inner.line_config(port)
    }

    fn take_work(&mut self) -> Work {
        self.inner.take_work()
    }
}

impl Inspect for Broken {
    fn estimate(&self) -> Option<(Instant, Pose)> {
        self.inner.estimate()
    }

    fn map(&self) -> Option<MapView<'_>> {
        self.inner.map()
    }

    fn mode(&self) -> &'static str {
        self.inner.mode()
    }

    fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        self.inner.counters(report);
    }
}

/// The case of a run of a program with `defect`, written and read again, and the violated rules.
fn case_of(name: &str, defect: Option<Defect>) -> (Case, Vec<String>) {
    let path = folder(name).join("capture.pcapng");
    let (capture, events) = captured(in_a_room("4s", ""), &path, |rig| {
        if let Some(defect) = defect {
            rig.replace_program(|program| Broken::of(program, defect));
        }
    });
    let scenario = scenario_of(&capture, Path::new("<capture>")).expect("readable");
    let (scenario, source) = scenario.expect("a run says what it ran");
    let recorded = Recorded::of(&capture, None);
    let case = Case::of("regression", &recorded, &scenario, &source).expect("wired");
    let text = case.to_toml();
    assert!(Case::is_meant(&text));
    let (read, _) = Case::parse(Path::new("case.toml"), text.clone()).expect("just written");
    assert_eq!(read.to_toml(), text);
    assert_eq!(read.recorded(Path::new("x")).expect("sound").links.len(), 4);
    let broken = events.iter().filter(|event| event.is_violation());
    let rules = broken.map(|event| format!("{} {}", event.source, event.event.rule));
    let mut rules: Vec<String> = rules.collect();
    rules.sort();
    rules.dedup();
    (read, rules)
}

fn run(case: &Case, defect: Option<Defect>) -> Judgement {
    let (_, source) = Case::parse(Path::new("case.toml"), case.to_toml()).expect("sound");
    let judged = case.run_with(&source, |program| match defect {
        Some(defect) => Broken::of(program, defect),
        None => program,
    });
    judged.expect("it can be played")
}

fn failed(judgement: &Judgement) -> Vec<&str> {
    let checks = judgement.checks.iter();
    let failed = checks.filter(|check| check.status == hilrig::run::check::Status::Fail);
    failed.map(|check| &*check.name).collect()
}

/// The base reports a violation by the captured program. It reports the violation again when the
/// case is played, and none after the program is corrected.
#[test]
fn a_broken_rule_fails_the_case_until_the_program_is_mended() {
    let (case, rules) = case_of("case-rule", Some(Defect::Mangles));
    assert!(!rules.is_empty(), "the base must notice");
    assert_eq!(case.expect.never, rules);
    assert!(!case.expect.same_outputs);

    let broken = run(&case, Some(Defect::Mangles));
    let names: Vec<String> = rules
        .iter()
        .map(|rule| format!("never-{}", rule.replace(' ', "-")))
        .collect();
    assert_eq!(failed(&broken), names, "{broken}");
    let mended = run(&case, None);
    assert!(mended.passed(), "{mended}");
}

#[test]
fn a_program_that_hung_fails_the_case_until_it_talks_again() {
    let defect = Defect::HangsAt(Instant::from_millis(1500));
    let (case, _) = case_of("case-hang", Some(defect));
    let broken = run(&case, Some(defect));
    assert!(failed(&broken).contains(&"talks-base"), "{broken}");
    let mended = run(&case, None);
    assert!(mended.passed(), "{mended}");
}

/// A fielded defect, enabled in the scenario: each reply's checksum is stored after the end of the
/// reply buffer. The line does not show it; the case fails until the switch is off. All steps use
/// commands.
#[test]
fn a_fielded_defect_fails_the_case_until_it_is_switched_off() {
    let folder = folder("case-defect");
    let (scenario, _) = in_a_room("1s", "defects = [\"MA-01\"]");
    let text = toml::to_string(&scenario).expect("has a TOML form");
    fs::write(folder.join("room.toml"), text).expect("writable");
    let (status, said, _) = hilrig(&folder, &["run", "room.toml", "--out", "out"]);
    assert_eq!(status.code(), Some(1), "{said}");
    let reason = said.lines().find(|line| line.contains("memory-intact"));
    let reason = reason.expect("the reason why the run failed").to_owned();

    let (status, said, _) = hilrig(&folder, &["case", "from", "out/capture.pcapng"]);
    assert_eq!(status.code(), Some(0), "{said}");
    assert!(!said.contains("the same bytes"), "{said}");
    let (status, said, _) = hilrig(&folder, &["run", "case.toml"]);
    assert_eq!(status.code(), Some(1), "{said}");
    assert_eq!(said.matches("\n  FAIL").count(), 1, "{said}");
    assert!(said.contains(&reason), "{reason}\n{said}");

    // A case from `case from` can be minimised: the same check fails with fewer bytes.
    let (status, said, told) = hilrig(&folder, &["shrink", "case.toml", "--out", "small"]);
    assert_eq!(status.code(), Some(0), "{said}{told}");
    assert!(said.starts_with("memory-intact\n") && said.contains(" lines of bytes left of "));
    let (status, said, _) = hilrig(&folder, &["run", "small/case.toml"]);
    assert_eq!(status.code(), Some(1), "{said}");
    let lines = |file: &str| fs::read_to_string(folder.join(file)).map(|text| text.lines().count());
    let [small, whole] = ["small/case.toml", "case.toml"].map(|file| lines(file).expect("written"));
    assert!(small < whole, "{small} of {whole} lines");

    let text = fs::read_to_string(folder.join("case.toml")).expect("written");
    let mended = text.replacen("defects = [\"MA-01\"]", "defects = []", 1);
    assert_ne!(mended, text);
    fs::write(folder.join("case.toml"), mended).expect("writable");
    let (status, said, _) = hilrig(&folder, &["run", "case.toml"]);
    assert_eq!(status.code(), Some(0), "{said}");
}

/// A run without a fault fixes the program's output: another program fails at its first different
/// byte. The checks of every run must pass again, except the collision check: a corrected program
/// drives another path.
#[test]
fn a_sound_run_becomes_a_case_that_pins_the_outputs() {
    let (case, _) = case_of("case-sound", None);
    assert!(case.expect.same_outputs && case.expect.never.is_empty());
    let asked = |name: &str| case.expect.checks.iter().any(|check| check == name);
    assert!(asked("memory-intact") && !asked("no-collision-at-speed"));
    let same = run(&case, None);
    assert!(same.passed(), "{same}");
    let other = run(&case, Some(Defect::Mangles));
    assert!(failed(&other).contains(&"same-outputs"), "{other}");
    // Byte 250 of the line is the first damaged one, number 249 from zero.
    let detail = &other.checks[0].detail;
    assert!(detail.contains("base to-device, byte 249: "), "{detail}");
}

/// One command makes the case and the test that runs it; another command runs the case.
#[test]
fn a_command_turns_a_capture_into_a_test() {
    let folder = folder("case-command");
    captured(in_a_room("2s", ""), &folder.join("capture.pcapng"), |_| {});
    let arguments = [
        "case",
        "from",
        "capture.pcapng",
        "-o",
        "stall.toml",
        "--test",
        "stall.rs",
    ];
    let (status, said, _) = hilrig(&folder, &arguments);
    assert_eq!(status.code(), Some(0), "{said}");
    assert!(
        said.starts_with("stall.toml expects:\n  the program sends the same bytes\n"),
        "{said}"
    );
    assert!(
        said.ends_with("run it with: hilrig run stall.toml\n"),
        "{said}"
    );
    let test = fs::read_to_string(folder.join("stall.rs")).expect("written");
    insta::assert_snapshot!(test, @r#"
    //! Runs a saved case; made by `hilrig case from`.

    use std::path::Path;

    #[test]
    fn case_stall_holds() {
        let (case, source) = hilrig::capture::case::Case::read(Path::new("stall.toml")).expect("a case");
        let judgement = case.run(&source).expect("it can be played");
        assert!(judgement.passed(), "{judgement}");
    }
    "#);
    let (status, said, _) = hilrig(&folder, &["run", "stall.toml", "--junit", "junit.xml"]);
    assert_eq!(status.code(), Some(0), "{said}");
    assert!(
        said.starts_with("PASS stall\n  ok   same-outputs"),
        "{said}"
    );
    let junit = fs::read_to_string(folder.join("junit.xml")).expect("written");
    assert!(junit.contains("testsuite name=\"stall\""), "{junit}");
    // A file that cannot be read is a failure in the report, and the others run.
    fs::write(folder.join("broken.toml"), "schema = \"none\"\n").expect("writable");
    let arguments = ["run", "broken.toml", "stall.toml", "--junit", "both.xml"];
    let (status, said, _) = hilrig(&folder, &arguments);
    assert_eq!(status.code(), Some(2), "{said}");
    let junit = fs::read_to_string(folder.join("both.xml")).expect("written");
    let names = ["stall", "broken.toml"].map(|name| format!("testsuite name=\"{name}\""));
    assert!(names.iter().all(|name| junit.contains(name)), "{junit}");
    assert!(junit.contains("failures=\"1\""), "{junit}");
}

/// A case from the first version of the format: half a second of the robot in its room, cut from a
/// longer run. Every later version must be able to run it. Only its expectations are fixed, not the
/// bytes that programs send.
#[test]
fn a_case_of_version_1_still_runs() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/replay/cases/v1.toml");
    let (case, source) = Case::read(&path).expect("a case");
    let judgement = case.run(&source).expect("it can be played");
    assert!(judgement.passed(), "{judgement}");
    assert!(judgement.checks.len() >= 2, "{judgement}");
}

/// Writes `capture` to `path`.
fn write(capture: &Capture, path: &Path) {
    let mut bytes = Vec::new();
    capture.sections[0].write(&mut bytes);
    capture.links.iter().for_each(|link| link.write(&mut bytes));
    for record in &capture.records {
        record.write(u32::try_from(record.link).expect("few links"), &mut bytes);
    }
    fs::write(path, bytes).expect("writable");
}

/// Three seconds of a lidar's output, as a user's dump of one line: no scenario, no replies. The
/// third packet has a wrong bit.
fn lidar_dump(folder: &Path) {
    let path = folder.join("dump.pcapng");
    let (mut capture, _) = captured(in_a_room("3s", ""), &path, |_| {});
    capture.sections[0] = Section::default();
    capture.records.retain(|record| {
        capture.links[record.link].name == "lidar" && record.direction == Direction::ToMaster
    });
    let packets = capture.records.iter_mut();
    let third = packets
        .filter(|record| record.bytes.first() == Some(&0xFA))
        .nth(2);
    let third = third.expect("three seconds are longer");
    let mut bytes = third.bytes.to_vec();
    bytes[5] ^= 1;
    third.bytes = bytes.into();
    write(&capture, &path);
}

/// A dump of one line has no replies, so it tests no program: only a regression of the decoder can
/// be detected.
#[test]
fn a_dump_of_one_direction_becomes_a_case_of_its_decoder() {
    let folder = folder("case-decoder");
    lidar_dump(&folder);
    let (status, said, told) = hilrig(&folder, &["case", "from", "dump.pcapng", "-o", "d.toml"]);
    assert_eq!(status.code(), Some(0), "{told}");
    assert!(
        said.contains("the decoder of xv11 finds the same in lidar to-master"),
        "{said}"
    );
    assert!(said.contains("today: PASS d"), "{said}");
    let (status, said, _) = hilrig(&folder, &["run", "d.toml"]);
    assert_eq!(status.code(), Some(0), "{said}");

    let text = fs::read_to_string(folder.join("d.toml")).expect("written");
    assert!(
        text.contains(" BAD 22 bytes ") && text.contains("checksum"),
        "{text}"
    );
    // A changed expectation has the same effect as another decoder, which finds other words or
    // another cause.
    let other = text.replacen(" rpm, from 8 deg: ", " rpm, from 9 deg: ", 1);
    assert_ne!(other, text);
    fs::write(folder.join("d.toml"), other).expect("writable");
    let (status, said, _) = hilrig(&folder, &["run", "d.toml"]);
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("FAIL decodes-lidar-to-master "), "{said}");
    assert!(
        said.contains("from 9 deg") && said.contains("from 8 deg"),
        "{said}"
    );
    let cause = text.replacen(
        "diagnosis = []",
        "diagnosis = [\"sent bytes come back\"]",
        1,
    );
    assert_ne!(cause, text);
    fs::write(folder.join("d.toml"), cause).expect("writable");
    let (status, said, _) = hilrig(&folder, &["run", "d.toml"]);
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("FAIL diagnosis-lidar-to-master"), "{said}");
}

/// A decoder's case has no robot; expectations of a program need one.
#[test]
fn a_case_without_a_robot_expects_nothing_of_a_program() {
    let folder = folder("case-no-robot");
    lidar_dump(&folder);
    let (status, _, told) = hilrig(&folder, &["case", "from", "dump.pcapng", "-o", "d.toml"]);
    assert_eq!(status.code(), Some(0), "{told}");
    let text = fs::read_to_string(folder.join("d.toml")).expect("written");
    let text = text.replacen("same_outputs = false", "same_outputs = true", 1);
    fs::write(folder.join("d.toml"), text).expect("writable");
    let (status, _, told) = hilrig(&folder, &["run", "d.toml"]);
    assert_eq!(status.code(), Some(2), "{told}");
    assert_eq!(
        told,
        "error: d.toml: expected a [scenario] with the robot whose program is tested\n"
    );
}

/// The program of a live run was a foreign one. Its case can be run with that program. Without it,
/// the robot's own program is tested, and a message must say so.
#[test]
fn a_case_of_a_foreign_program_says_which_program_it_tests() {
    let folder = folder("case-foreign");
    let path = folder.join("live.pcapng");
    let (mut capture, _) = captured(in_a_room("2s", ""), &path, |_| {});
    let about = capture.sections[0]
        .about
        .replace("clock=virtual", "clock=utc");
    capture.sections[0].about = about;
    write(&capture, &path);
    let expected = "the built-in program of the robot rescue was tested, not the captured \
                    program; --exec CMD tests yours";
    for command in [
        &["case", "from", "live.pcapng", "-o", "live.toml"][..],
        &["run", "live.toml"],
    ] {
        let (_, said, told) = hilrig(&folder, command);
        assert!(said.contains(expected), "{command:?}: {said}{told}");
    }
    let (case, _) = Case::read(&folder.join("live.toml")).expect("written");
    assert!(case.is_foreign);
}

#[test]
fn a_case_that_makes_no_sense_is_refused_with_its_line() {
    let folder = folder("case-refused");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/replay/cases/v1.toml");
    let text = fs::read_to_string(path).expect("there");
    let says = |text: &str| {
        fs::write(folder.join("c.toml"), text).expect("writable");
        let (status, _, said) = hilrig(&folder, &["run", "c.toml"]);
        assert_eq!(status.code(), Some(2), "{said}");
        said
    };
    let future = says(&text.replacen("case = 1", "case = 2", 1));
    assert!(
        future.contains("c.toml:1: case: is 2, expected 1"),
        "{future}"
    );
    let misspelt = says(&text.replacen("end_ns", "end_us", 1));
    assert!(
        misspelt.contains("end_us: is an unknown key, did you mean \"end_ns\"?"),
        "{misspelt}"
    );
    let begin = "to_program = \"\"\"\n";
    let bytes = says(&text.replacen(begin, &format!("{begin}12 XY\n"), 1));
    let expected = "line 1: expected bytes of two hex digits, e.g. AB240A, or !\n";
    assert!(
        bytes.starts_with("error: c.toml: link ") && bytes.ends_with(expected),
        "{bytes}"
    );
}

proptest! {
    /// A file may have any content: lines of the shipped case are cut, doubled, mixed and replaced.
    #[test]
    fn no_text_of_a_case_panics(
        edits in prop::collection::vec((0_usize..400, 0_usize..4, "[ -~]{0,30}"), 1..6)
    ) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/replay/cases/v1.toml");
        let text = fs::read_to_string(path).expect("there");
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        for (place, kind, with) in edits {
            let place = place % lines.len();
            match kind {
                0 => { lines.remove(place); }
                1 => lines.insert(place, with),
                2 => lines[place] = with,
                _ => { let line = lines[place].clone(); lines.insert(place, line); }
            }
        }
        if let Ok((case, source)) = Case::parse(Path::new("c.toml"), lines.join("\n")) {
            let _ = case.recorded(&source.path);
        }
    }
}
