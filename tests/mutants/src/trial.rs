//! Runs the tests against each mutant: the first test that fails, or does not end, has caught it.
//! Only tests that reached the mutant's place without a mutant are tried. Tests of its own module
//! come first: they catch most mutants, in a hundredth of the time. For a value that tests share
//! (`LazyLock`), only the first test is noted; no test of a library shares one.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, mpsc};
use std::time::{Duration, Instant};

use crate::build::{ACTIVE, Built, REACHED, Test};
use crate::list::Mutant;

/// Result of a mutant's trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// A test failed.
    Caught,
    /// The tests did not end.
    Late,
    /// No test failed.
    Missed,
}

/// Number of concurrent trials: as many as the rig's own checks are made for.
const JOBS: usize = 2;
/// Maximum number of tests of a binary that may fail without a mutant: on a busy machine, tests of
/// the clock do.
const FAILING_MAX: usize = 5;
/// Stack of a test, bytes: a function with switches takes several times its own.
const STACK: &str = "67108864";
/// A test counts as late only after this time.
const PATIENCE: Duration = Duration::from_secs(20);

/// A test binary, and the result of its run without a mutant.
struct Binary<'a> {
    folder: &'a Path,
    path: &'a Path,
    time: Duration,
    names: Vec<String>,
    /// The tests that reached each mutant. `None` stands for a thread or process without the name
    /// of a test.
    reached: BTreeMap<usize, BTreeSet<Option<String>>>,
}

/// The results of all mutants that are compiled in, by their position in the draw.
pub fn all(built: &Built, drawn: &[Mutant], out: &Path) -> Result<Vec<(usize, Fate)>, String> {
    let binaries = unchanged(built, out)?;
    let next = AtomicUsize::new(0);
    let fates = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..JOBS {
            scope.spawn(|| {
                while let Some(&mutant) = built.switched.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let fate = fate(&binaries, mutant, &drawn[mutant]);
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

/// The mutants that no test reaches, without a trial.
pub fn unreached(built: &Built, out: &Path) -> Result<Vec<usize>, String> {
    let binaries = unchanged(built, out)?;
    let is_reached = |at: &usize| {
        let mut binaries = binaries.iter();
        binaries.any(|binary| binary.reached.contains_key(&(at + 1)))
    };
    let switched = built.switched.iter().copied();
    Ok(switched.filter(|at| !is_reached(at)).collect())
}

/// The binaries with the results of their runs without a mutant, the fastest first.
fn unchanged<'a>(built: &'a Built, out: &Path) -> Result<Vec<Binary<'a>>, String> {
    let mut binaries = Vec::new();
    for Test { folder, path } in &built.tests {
        let notes = std::path::absolute(out.join("reached.txt"));
        let notes = notes.map_err(|error| format!("{}: {error}", out.display()))?;
        fs::write(&notes, "").map_err(|error| format!("{}: {error}", notes.display()))?;
        let started = Instant::now();
        let mut names = names(folder, path)?;
        // With one thread, the thread does not have the test's name.
        let mut all = ["--test-threads", "2", "--exact"]
            .map(str::to_owned)
            .to_vec();
        let mut failing = 0;
        let passed = loop {
            let limit = Duration::from_secs(1200);
            let failed = match run(folder, path, &all, 0, Some(&notes), limit) {
                Outcome::Passed => break true,
                Outcome::Failed(Some(failed)) if failing < FAILING_MAX => failed,
                Outcome::Failed(_) | Outcome::Late => break false,
            };
            eprintln!("{failed} fails without a mutant, and is left out");
            names.retain(|name| *name != failed);
            all.extend(["--skip".to_owned(), failed]);
            failing += 1;
        };
        if !passed {
            eprintln!("{} fails without a mutant, and is left out", path.display());
            continue;
        }
        let time = started.elapsed();
        let text = fs::read(&notes).map_err(|error| format!("{}: {error}", notes.display()))?;
        let mut reached: BTreeMap<usize, BTreeSet<Option<String>>> = BTreeMap::new();
        for line in String::from_utf8_lossy(&text).lines() {
            let (number, thread) = line.split_once(' ').unwrap_or((line, ""));
            let number: usize = number.parse().map_err(|_| format!("a note: {line}"))?;
            let test = names.iter().find(|name| *name == thread).cloned();
            reached.entry(number).or_default().insert(test);
        }
        eprintln!("{} s for {}", time.as_secs(), path.display());
        binaries.push(Binary {
            folder,
            path,
            time,
            names,
            reached,
        });
    }
    if binaries.is_empty() {
        return Err("all tests fail without a mutant".to_owned());
    }
    binaries.sort_by_key(|binary| binary.time);
    Ok(binaries)
}

/// The names of the tests of a binary.
fn names(folder: &Path, path: &Path) -> Result<Vec<String>, String> {
    let output = Command::new(path)
        .args(["--list", "--format", "terse"])
        .current_dir(folder)
        .output()
        .map_err(|error| format!("{}: {error}", path.display()))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let names = text.lines().filter_map(|line| line.strip_suffix(": test"));
    Ok(names.map(str::to_owned).collect())
}

/// Tries the tests that reached the mutant; no other test can catch it.
fn fate(binaries: &[Binary], at: usize, mutant: &Mutant) -> Fate {
    let module = module(&mutant.file);
    for is_own in [true, false] {
        for binary in binaries {
            let Some(reached) = binary.reached.get(&(at + 1)) else {
                continue;
            };
            let by_whichever = reached.contains(&None);
            let of_it = binary.names.iter().filter(|name| {
                name.contains(&module) == is_own
                    && (by_whichever || reached.contains(&Some((*name).clone())))
            });
            let mut tests: Vec<String> = of_it.cloned().collect();
            if tests.is_empty() {
                continue;
            }
            tests.push("--exact".to_owned());
            let patience = PATIENCE.max(4 * binary.time);
            match run(binary.folder, binary.path, &tests, at + 1, None, patience) {
                Outcome::Late => return Fate::Late,
                Outcome::Failed(_) => return Fate::Caught,
                Outcome::Passed => {}
            }
        }
    }
    Fate::Missed
}

/// The module of a file as a path, the prefix of its unit tests' names.
fn module(file: &str) -> String {
    let inside = file.split_once("src/").map_or(file, |(_, inside)| inside);
    inside.trim_end_matches(".rs").replace('/', "::") + "::"
}

/// Result of a run.
enum Outcome {
    Passed,
    /// The first test that failed, if it is known.
    Failed(Option<String>),
    /// The run did not end in time.
    Late,
}

/// Runs the given tests of `binary` for at most `limit`. The first failure ends the run.
fn run(
    folder: &Path,
    binary: &Path,
    arguments: &[String],
    active: usize,
    notes: Option<&Path>,
    limit: Duration,
) -> Outcome {
    let child = Command::new(binary)
        .args(arguments)
        .current_dir(folder)
        .env("RUST_MIN_STACK", STACK)
        .env(ACTIVE, active.to_string())
        .envs(notes.map(|notes| (REACHED, notes)))
        .env("CARGO_MANIFEST_DIR", folder)
        // With CI set, tests fail if a tool is missing.
        .env_remove("CI")
        .envs([("INSTA_UPDATE", "no"), ("PROPTEST_RNG_SEED", "1")])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .process_group(0)
        .spawn();
    let Ok(mut child) = child else {
        return Outcome::Failed(None);
    };
    let lines = child.stdout.take().map(|out| BufReader::new(out).lines());
    let (failed, heard) = mpsc::channel();
    std::thread::spawn(move || {
        let mut lines = lines.into_iter().flatten().map_while(Result::ok);
        let failure = lines.find_map(|line| {
            let name = line.strip_prefix("test ")?.strip_suffix(" ... FAILED")?;
            Some(name.trim_end_matches(" - should panic").to_owned())
        });
        let _ = failed.send(failure);
    });
    let outcome = match heard.recv_timeout(limit) {
        Ok(None) if child.wait().is_ok_and(|status| status.success()) => Outcome::Passed,
        Ok(failure) => Outcome::Failed(failure),
        Err(_) => Outcome::Late,
    };
    end(&mut child);
    outcome
}

/// Ends `child` and all processes that it started.
fn end(child: &mut Child) {
    let group = format!("-{}", child.id());
    let _ = Command::new("kill")
        .args(["-KILL", "--", &group])
        .stderr(Stdio::null())
        .status();
    let _ = child.wait();
}
