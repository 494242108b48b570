//! Every command that writes, in folders that another user prepared: with links, hard links to
//! files elsewhere, pipes and files of other owners. Nothing outside of the folder changes.

use std::fs;
use std::os::unix::fs::{MetadataExt as _, symlink};
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, FileType, Mode, mknodat};

use super::thorough::{few, is_thorough};
use super::verbs::{Bench, VERBS, Verb};

/// Existing objects at the path of a file that the command writes.
const TRAPS: [&str; 5] = ["link", "hard link", "dangling link", "pipe", "other owner"];
/// Another user, if the tests run as root.
const OTHER: u32 = 12_345;
const PRECIOUS: &str = "precious";

/// Files that must not change.
struct Victims(PathBuf);

impl Victims {
    fn new(bench: &Bench) -> Self {
        let folder = bench.session.path("victims");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(folder.join("folder")).expect("can be made");
        fs::write(folder.join("folder/a"), PRECIOUS).expect("can be written");
        Self(folder)
    }

    /// A separate file for each trap: hard links share their content.
    fn file(&self, number: usize) -> PathBuf {
        let file = self.0.join(number.to_string());
        fs::write(&file, PRECIOUS).expect("can be written");
        file
    }

    fn assert_whole(&self, line: &str) {
        for entry in fs::read_dir(&self.0).expect("is there") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                let names = fs::read_dir(&path).expect("is there").count();
                assert_eq!(
                    names, 1,
                    "{line}: something came into a folder behind a link"
                );
                assert_eq!(
                    fs::read_to_string(path.join("a")).expect("is there"),
                    PRECIOUS
                );
            } else {
                let meta = fs::symlink_metadata(&path).expect("is there");
                assert!(meta.is_file(), "{line}: {path:?}");
                let text = fs::read_to_string(&path).expect("readable");
                assert_eq!(text, PRECIOUS, "{line}: {path:?}");
            }
        }
    }
}

fn set(victims: &Victims, number: usize, path: &Path, trap: &str) {
    fs::create_dir_all(path.parent().expect("below the folder")).expect("can be made");
    let victim = victims.file(number);
    match trap {
        "link" => symlink(victim, path),
        "hard link" => fs::hard_link(victim, path),
        "dangling link" => symlink(victims.0.join("folder/new"), path),
        "pipe" => {
            mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a free name");
            Ok(())
        }
        _ => fs::write(path, "another user's").and_then(|()| {
            // Only root can change the owner of a file; without root, the path is occupied
            // nevertheless.
            let is_root = fs::metadata("/proc/self").is_ok_and(|me| me.uid() == 0);
            match is_root {
                true => std::os::unix::fs::chown(path, Some(OTHER), Some(OTHER)),
                false => Ok(()),
            }
        }),
    }
    .expect("a free name");
}

/// Runs the command, which must end, and explain an error.
fn run(bench: &Bench, line: &str, code: i32) {
    let output = bench.command(line).output().expect("starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!said.contains("panicked"), "{line}: {said}");
    let found = output.status.code();
    assert!(
        found == Some(code) || found == Some(2),
        "{line}: {output:?}"
    );
    assert!(
        found != Some(2) || said.contains("error: "),
        "{line}: {said}"
    );
}

/// Names of temporary files that commands use while they run.
const PASSING: [&str; 3] = [
    "ports/.hilrig-ports",
    "ports/.hilrig-scenario.toml",
    "ports/control",
];

/// Slow commands that write with the same functions as others.
const LONG: [&str; 3] = ["demo", "experiment", "slam"];

#[test]
fn nothing_outside_of_a_prepared_folder_changes() {
    let bench = Bench::new("prepared");
    let is_wanted = |verb: &&Verb| verb.writes && (is_thorough() || !LONG.contains(&verb.name));
    for verb in VERBS.iter().filter(is_wanted) {
        bench.clear();
        run(&bench, verb.line, verb.code);
        let names = bench.files().into_iter().map(|(name, _)| name.into());
        let mut names: Vec<PathBuf> = names.collect();
        if verb.line.contains("--dir ports") {
            names.extend(PASSING.map(|name| bench.session.path(name)));
        }
        assert!(!names.is_empty(), "{}", verb.line);
        for shift in few(1, 0..TRAPS.len()) {
            with_traps(&bench, verb, &names, shift);
        }
        behind_links(&bench, verb, &names);
    }
}

/// Runs the command with a trap at the path of each of its files, and of its temporary files.
fn with_traps(bench: &Bench, verb: &Verb, names: &[PathBuf], shift: usize) {
    bench.clear();
    let _ = fs::remove_dir_all(bench.session.path("ports"));
    let victims = Victims::new(bench);
    for (index, name) in names.iter().enumerate() {
        let part = format!("{}.part", name.display());
        for (half, path) in [name, Path::new(&part)].into_iter().enumerate() {
            let trap = TRAPS[(index + half + shift) % TRAPS.len()];
            set(&victims, 2 * index + half, path, trap);
        }
    }
    run(bench, verb.line, verb.code);
    victims.assert_whole(verb.line);
    let _ = fs::remove_dir_all(bench.session.path("ports"));
}

/// Runs the command with links in place of the folders in which it writes, except `o`: first the
/// upper folders, then those inside them.
fn behind_links(bench: &Bench, verb: &Verb, names: &[PathBuf]) {
    let o = bench.session.path("o");
    let mut folders: Vec<&Path> = names.iter().filter_map(|name| name.parent()).collect();
    folders.sort();
    folders.dedup();
    folders.retain(|folder| *folder != o);
    let depth = |folder: &Path| folder.components().count();
    let mut depths: Vec<usize> = folders.iter().map(|folder| depth(folder)).collect();
    depths.sort_unstable();
    depths.dedup();
    for level in depths {
        bench.clear();
        let victims = Victims::new(bench);
        let links = folders.iter().filter(|folder| depth(folder) == level);
        for link in links.clone() {
            fs::create_dir_all(link.parent().expect("below the session")).expect("can be made");
            let _ = fs::remove_dir_all(link);
            symlink(victims.0.join("folder"), link).expect("a free name");
        }
        run(bench, verb.line, verb.code);
        victims.assert_whole(verb.line);
        links.for_each(|link| drop(fs::remove_file(link)));
    }
}

/// A pipe in the place of a file that a command reads from a folder holds no command up, although
/// its writer never comes: this one comes only to a reader that waits, and ends it.
#[test]
fn a_pipe_in_the_place_of_a_file_of_a_folder_is_an_error() {
    let bench = Bench::new("pipes");
    let path = |name: &str| bench.session.path(name);
    let rows = [
        ("o/result/capture.pcapng", "export o/result -o o/a.csv"),
        ("o/result/capture.pcapng", "slam o/result --out o/slam"),
        ("o/fuzz/fuzz.json", "fuzz pcui --cases 1 --out o/fuzz"),
        (
            "o/fuzz/stream.txt",
            "fuzz pcui --repeat o/fuzz --out o/again",
        ),
        ("o/map/map.yaml", "map diff o/map o/map"),
        ("o/map/map.pgm", "map diff o/map o/map"),
        (
            "o/night/plan.json",
            "campaign s.toml --seeds 0..1 --out o/night",
        ),
    ];
    for (name, line) in rows {
        bench.clear();
        let pipe = path(name);
        fs::create_dir_all(pipe.parent().expect("below o")).expect("can be made");
        if name.ends_with("map.pgm") {
            let yaml = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n\
                        occupied_thresh: 0.65\nfree_thresh: 0.2\n";
            fs::write(path("o/map/map.yaml"), yaml).expect("can be written");
        }
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a free name");
        let writer = pipe.clone();
        // If no reader waits, this thread does, until the end of the tests.
        std::thread::spawn(move || drop(fs::File::options().write(true).open(writer)));
        let output = bench.command(line).output().expect("starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        let named = format!("{name}: ");
        assert!(said.contains(&named), "{line}: {said}");
        assert!(said.contains("is not a file"), "{line}: {said}");
    }
}

/// A record of ports is data: the names in it are not followed.
#[test]
fn s1_a_prepared_record_deletes_nothing() {
    let bench = Bench::new("prepared-record");
    let dir = bench.session.path("prepared");
    fs::create_dir(&dir).expect("can be made");
    let precious = bench.session.path("precious");
    symlink("some-target", &precious).expect("a free name");
    let absolute = format!("{} some-target\n", precious.display());
    let record = absolute + "../precious some-target\n./../precious some-target\n";
    fs::write(dir.join(".hilrig-ports"), record).expect("can be written");
    run(&bench, "up s.toml --dir prepared --duration 100ms", 0);
    assert!(
        precious.is_symlink(),
        "a link outside of the directory is gone"
    );
    assert!(!dir.join(".hilrig-ports").exists());
}

/// With any limit of descriptors, a command ends with an error or completes.
#[test]
fn s7_few_descriptors_are_no_panic() {
    let bench = Bench::new("descriptors");
    let lines = [
        "run s.toml --out o/run",
        "ui s.toml --duration 100ms",
        "up s.toml --dir ports --duration 100ms",
        "run s.toml --exec true --out o/exec",
        "campaign s.toml --seeds 0..1 --out o/campaign",
        "record --tap a=pty:a b=pty:b -o o/recorded.pcapng --duration 100ms",
    ];
    for most in 4..12 {
        for line in lines {
            bench.clear();
            let hilrig = env!("CARGO_BIN_EXE_hilrig");
            let limited = format!("ulimit -n {most}; exec {hilrig} {line}");
            let mut command = std::process::Command::new("sh");
            command
                .args(["-c", &limited])
                .current_dir(&bench.session.folder);
            let output = command.output().expect("starts");
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(!said.contains("panicked"), "{most}: {line}: {said}");
            assert!(
                matches!(output.status.code(), Some(0..=3 | 127)),
                "{most}: {line}: {output:?}"
            );
        }
    }
}

/// Only the user who runs the rig may steer it.
#[test]
fn s3_the_control_socket_is_for_its_owner() {
    let bench = Bench::new("prepared-socket");
    let meta = fs::metadata(bench.session.path("live/control")).expect("is there");
    assert_eq!(meta.mode() & 0o777, 0o600);
}
