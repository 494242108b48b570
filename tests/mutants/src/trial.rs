//! Each mutant against the tests: the first binary that fails, or does not end, has seen it. The
//! tests of its own module come first: they see most, in a hundredth of the time.

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, mpsc};
use std::time::{Duration, Instant};

use crate::build::{ACTIVE, Built};
use crate::list::Mutant;

/// What became of a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// A test failed.
    Caught,
    /// The tests did not end.
    Late,
    /// Nobody saw it.
    Missed,
}

/// Trials at a time: as many as the rig's own checks are made for.
const JOBS: usize = 2;
/// Nobody is late before this.
const PATIENCE: Duration = Duration::from_secs(60);

/// The fate of every mutant that is compiled in, by its place in the draw.
pub fn all(built: &Built, drawn: &[Mutant]) -> Result<Vec<(usize, Fate)>, String> {
    let tests = by_time(built)?;
    let next = AtomicUsize::new(0);
    let fates = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..JOBS {
            scope.spawn(|| {
                while let Some(&mutant) = built.switched.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let fate = fate(&built.folder, &tests, mutant, &drawn[mutant]);
                    let mut fates = fates.lock().unwrap_or_else(|held| held.into_inner());
                    fates.push((mutant, fate));
                    eprintln!(
                        "{}/{} {fate:?} {}",
                        fates.len(),
                        built.switched.len(),
                        drawn[mutant].name
                    );
                }
            });
        }
    });
    let mut fates = fates.into_inner().unwrap_or_else(|held| held.into_inner());
    fates.sort_by_key(|(mutant, _)| *mutant);
    Ok(fates)
}

/// The tests with how long each takes when nothing is changed, the quickest first.
fn by_time(built: &Built) -> Result<Vec<(&Path, Duration)>, String> {
    let mut tests = Vec::new();
    for test in &built.tests {
        let started = Instant::now();
        let limit = Duration::from_secs(1200);
        match run(&built.folder, test, None, 0, limit) {
            Some(true) => tests.push((test.as_path(), started.elapsed())),
            _ => return Err(format!("{} fails without a mutant", test.display())),
        }
    }
    tests.sort_by_key(|(_, time)| *time);
    Ok(tests)
}

fn fate(folder: &Path, tests: &[(&Path, Duration)], at: usize, mutant: &Mutant) -> Fate {
    let own = module(&mutant.file);
    for only in [Some(own.as_str()), None] {
        for &(test, time) in tests {
            match run(folder, test, only, at + 1, PATIENCE.max(4 * time)) {
                None => return Fate::Late,
                Some(false) => return Fate::Caught,
                Some(true) => {}
            }
        }
    }
    Fate::Missed
}

/// The path of a file's module, as the names of its unit tests begin.
fn module(file: &str) -> String {
    let inside = file.split_once("src/").map_or(file, |(_, inside)| inside);
    inside.trim_end_matches(".rs").replace('/', "::") + "::"
}

/// Whether `test` passed, or those of its tests whose names have `only` in them; `None` if it had
/// not ended by `limit`. The first test that fails ends it.
fn run(
    folder: &Path,
    test: &Path,
    only: Option<&str>,
    active: usize,
    limit: Duration,
) -> Option<bool> {
    let child = Command::new(test)
        .args(only)
        .current_dir(folder)
        .env(ACTIVE, active.to_string())
        .env("CARGO_MANIFEST_DIR", folder)
        .envs([
            ("CI", "true"),
            ("INSTA_UPDATE", "no"),
            ("PROPTEST_RNG_SEED", "1"),
        ])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .process_group(0)
        .spawn();
    let mut child = child.ok()?;
    let lines = BufReader::new(child.stdout.take()?).lines();
    let (failed, heard) = mpsc::channel();
    std::thread::spawn(move || {
        let failure = lines
            .map_while(Result::ok)
            .any(|line| line.ends_with("... FAILED"));
        let _ = failed.send(failure);
    });
    let failure = heard.recv_timeout(limit);
    let passed = match failure {
        Ok(false) => Some(child.wait().is_ok_and(|status| status.success())),
        Ok(true) => Some(false),
        Err(_) => None,
    };
    end(&mut child);
    passed
}

/// Ends `child` with all that it started.
fn end(child: &mut Child) {
    let group = format!("-{}", child.id());
    let _ = Command::new("kill")
        .args(["-KILL", "--", &group])
        .stderr(Stdio::null())
        .status();
    let _ = child.wait();
}
