//! The copy of the tree in which all drawn mutants are compiled in, and its tests.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::list::{Genre, Mutant};
use crate::switch::{self, Switched};

/// The environment variable that names the active mutant.
pub const ACTIVE: &str = "ACTIVE_MUTANT";

/// The environment variable that names the file where the tests note which mutants they reach.
pub const REACHED: &str = "REACHED_MUTANTS";

/// The environment variable with the tests to run of a package, as arguments of `cargo test`;
/// without it: all.
const TESTS: &str = "TESTS";

/// The environment variable with tests of other packages that use this one: `PACKAGE:TARGET`, or
/// `PACKAGE` for its unit tests.
const WITH: &str = "WITH";

/// Appended to the package's `lib.rs`. The attribute stands at its top.
const SWITCH: &str = "
/// The number of the active mutant, from 1; 0: none. On request, notes that the current thread has
/// reached the mutants `here`: each test has a thread with its name.
#[doc(hidden)]
pub fn active_mutant(here: &[u32]) -> u32 {
    extern crate std;
    use std::io::Write as _;
    static ACTIVE: std::sync::OnceLock<u32> = std::sync::OnceLock::new();
    static REACHED: std::sync::OnceLock<Option<std::fs::File>> = std::sync::OnceLock::new();
    std::thread_local! {
        static SEEN: std::cell::RefCell<std::vec::Vec<u32>> = std::cell::RefCell::default();
    }
    let reached = REACHED.get_or_init(|| {
        let path = std::env::var_os(\"REACHED_MUTANTS\")?;
        std::fs::OpenOptions::new().append(true).open(path).ok()
    });
    if let Some(mut file) = reached.as_ref() {
        let _ = SEEN.try_with(|seen| {
            let mut seen = seen.borrow_mut();
            for &number in here.iter() {
                if let Err(at) = seen.binary_search(&number) {
                    seen.insert(at, number);
                    let thread = std::thread::current();
                    let line = std::format!(\"{number} {}\\n\", thread.name().unwrap_or(\"?\"));
                    let _ = file.write_all(line.as_bytes());
                }
            }
        });
    }
    *ACTIVE.get_or_init(|| {
        std::env::var(\"ACTIVE_MUTANT\").ok().and_then(|text| text.parse().ok()).unwrap_or(0)
    })
}
";
/// The compiler must not reject a mutant that it proves wrong: that is the task of the tests.
const ALLOWED: &str = "#![allow(warnings, arithmetic_overflow, unconditional_panic)]\n";

/// A test binary, and the folder of its package in the copy, where its tests run.
pub struct Test {
    pub folder: PathBuf,
    pub path: PathBuf,
}

/// Results of the build.
pub struct Built {
    /// The test binaries.
    pub tests: Vec<Test>,
    /// Mutants that are compiled in, by their position in the draw.
    pub switched: Vec<usize>,
    /// Mutants that do not compile.
    pub unviable: Vec<usize>,
    /// Mutants that no switch reaches, or in files that this build leaves out.
    pub unswitched: Vec<usize>,
}

/// Copies the workspace to `out`, with `mutants` of `package` compiled in, and builds its tests.
pub fn all_at_once(package: &str, out: &Path, mutants: &[Mutant]) -> Result<Built, String> {
    let tree = out.join("tree");
    copy_tree(&tree)?;
    let (_, lib) = places(package, &tree)?;
    let target = out.join("target");
    fs::create_dir_all(&target).map_err(|error| format!("{}: {error}", target.display()))?;
    let mut files: BTreeMap<&str, (String, Vec<usize>)> = BTreeMap::new();
    for (at, mutant) in mutants.iter().enumerate() {
        if !files.contains_key(mutant.file.as_str()) {
            // Read from the copy: changes to the original meanwhile have no effect here.
            let file = &mutant.file;
            let text = fs::read_to_string(tree.join(file));
            let text = text.map_err(|error| format!("{file}: {error}"))?;
            files.insert(file, (text, Vec::new()));
        }
        if let Some((_, numbers)) = files.get_mut(mutant.file.as_str()) {
            numbers.push(at);
        }
    }
    let mut copy = Copy {
        package,
        tree: &tree,
        lib,
        // The path as the compiler in the copy sees it.
        target: fs::canonicalize(&target).unwrap_or(target),
        mutants,
        unviable: BTreeSet::new(),
        still_const: BTreeSet::new(),
    };
    let switched = loop {
        let switched = copy.write(&files)?;
        eprintln!("compiling, {} mutants do not so far", copy.unviable.len());
        if !copy.leave_out_what_does_not_compile(&switched)? {
            break switched;
        }
    };
    let tests = copy.tests()?;
    let compiled = sources(&tests);
    let left_out = files.iter().filter(|(file, _)| !compiled.contains(**file));
    let mut unswitched: BTreeSet<usize> = left_out
        .flat_map(|(_, (_, numbers))| numbers.iter().copied())
        .collect();
    unswitched.extend(switched.values().flat_map(|file| &file.unswitched));
    let unswitched: Vec<usize> = unswitched.into_iter().collect();
    let unviable: Vec<usize> = copy.unviable.into_iter().collect();
    let rest = |at: &usize| !unviable.contains(at) && !unswitched.contains(at);
    let switched = (0..mutants.len()).filter(rest).collect();
    Ok(Built {
        tests,
        switched,
        unviable,
        unswitched,
    })
}

/// Copies the tree without its build results.
fn copy_tree(tree: &Path) -> Result<(), String> {
    let _ = fs::remove_dir_all(tree);
    fs::create_dir_all(tree).map_err(|error| format!("{}: {error}", tree.display()))?;
    let done = Command::new("sh")
        .arg("-c")
        .arg("git ls-files -z | xargs -0 cp --no-dereference --parents -t \"$0\"")
        .arg(tree)
        .status();
    if !done.is_ok_and(|status| status.success()) {
        return Err("the tree cannot be copied".to_owned());
    }
    Ok(())
}

/// The folder of `package` in the workspace `tree`, and the file of its library.
fn places(package: &str, tree: &Path) -> Result<(PathBuf, PathBuf), String> {
    let output = Command::new("cargo")
        .args(["metadata", "--locked", "--no-deps", "--format-version", "1"])
        .current_dir(tree)
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("cargo: {error}"))?;
    let metadata: Value = serde_json::from_slice(&output.stdout)
        .map_err(|error| format!("cargo metadata: {error}"))?;
    let all = metadata["packages"].as_array();
    let one = all.and_then(|all| all.iter().find(|one| one["name"] == package));
    let one = one.ok_or_else(|| format!("{package}: not a package of the workspace"))?;
    let manifest = one["manifest_path"].as_str().map(Path::new);
    let targets = one["targets"].as_array();
    let is_lib = |target: &&Value| {
        target["kind"]
            .as_array()
            .is_some_and(|all| all.contains(&"lib".into()))
    };
    let lib = targets.and_then(|all| all.iter().find(is_lib)?["src_path"].as_str());
    let (Some(folder), Some(lib)) = (manifest.and_then(Path::parent), lib) else {
        return Err(format!("{package}: no library"));
    };
    Ok((folder.to_owned(), PathBuf::from(lib)))
}

struct Copy<'a> {
    package: &'a str,
    tree: &'a Path,
    /// The file of its library.
    lib: PathBuf,
    target: PathBuf,
    mutants: &'a [Mutant],
    unviable: BTreeSet<usize>,
    still_const: BTreeSet<String>,
}

impl<'a> Copy<'a> {
    /// Writes all files that have mutants, without those that do not compile.
    fn write(
        &self,
        files: &BTreeMap<&'a str, (String, Vec<usize>)>,
    ) -> Result<BTreeMap<&'a str, Switched>, String> {
        let mut written = BTreeMap::new();
        for (&file, (text, numbers)) in files {
            let viable = numbers.iter().filter(|at| !self.unviable.contains(at));
            let viable: Vec<_> = viable.map(|&at| (at, &self.mutants[at])).collect();
            let switched = switch::switched(text, &viable, &self.still_const)
                .map_err(|error| format!("{file}: {error}"))?;
            fs::write(self.tree.join(file), &switched.text)
                .map_err(|error| format!("{file}: {error}"))?;
            written.insert(file, switched);
        }
        self.write_switch()?;
        Ok(written)
    }

    fn write_switch(&self) -> Result<(), String> {
        let path = &self.lib;
        let wrong = |error| format!("{}: {error}", path.display());
        let text = fs::read_to_string(path).map_err(wrong)?;
        if !text.contains(SWITCH) {
            // After the documentation of the crate, only attributes may follow.
            let at = text.find("\n\n").map_or(0, |at| at + 2);
            let (head, rest) = text.split_at(at);
            fs::write(path, format!("{head}{ALLOWED}{rest}{SWITCH}")).map_err(wrong)?;
        }
        Ok(())
    }

    /// Leaves out mutants that do not compile; returns whether any were left out, so that another
    /// try makes sense.
    fn leave_out_what_does_not_compile(
        &mut self,
        files: &BTreeMap<&str, Switched>,
    ) -> Result<bool, String> {
        let before = (self.unviable.len(), self.still_const.len());
        let mut unexplained = Vec::new();
        for message in self.cargo(self.package, &["check", "--lib"])? {
            if message["reason"] != "compiler-message" || message["message"]["level"] != "error" {
                continue;
            }
            let error = &message["message"];
            if let Some(name) = called_in_a_constant(error) {
                self.still_const.insert(name);
                continue;
            }
            let mut guilty = guilty(error, files);
            if guilty.is_empty() {
                guilty.extend(self.returned_before(error, files));
            }
            if error["code"]["code"] == "E0004"
                && let Some(taken) = self.taken_behind(error, files)
            {
                guilty = vec![taken];
            }
            if guilty.is_empty() && !error["spans"].as_array().is_none_or(Vec::is_empty) {
                unexplained.push(error["rendered"].as_str().unwrap_or("").to_owned());
            }
            self.unviable.extend(guilty);
        }
        let more = before != (self.unviable.len(), self.still_const.len());
        if !more && !unexplained.is_empty() {
            return Err(format!(
                "the copy does not compile:\n{}",
                unexplained.join("\n")
            ));
        }
        Ok(more)
    }

    /// The last made-up return value before an error. In a function that returns an `impl Trait`
    /// this value sets the type, and the compiler then reports the author's own code as the error.
    fn returned_before(&self, error: &Value, files: &BTreeMap<&str, Switched>) -> Option<usize> {
        let spans = error["spans"].as_array()?;
        let span = spans.iter().find(|span| span["is_primary"] == true)?;
        let at = usize::try_from(span["byte_start"].as_u64()?).ok()?;
        let arms = files.get(span["file_name"].as_str()?)?.arms.iter();
        let returned = arms
            .filter(|(arm, mutant)| arm.end <= at && self.mutants[*mutant].genre == Genre::FnValue);
        returned
            .max_by_key(|(arm, _)| arm.end)
            .map(|(_, mutant)| *mutant)
    }

    /// The first removed arm after an error: without it, the `match` that begins there is no longer
    /// complete.
    fn taken_behind(&self, error: &Value, files: &BTreeMap<&str, Switched>) -> Option<usize> {
        let spans = error["spans"].as_array()?;
        let span = spans.iter().find(|span| span["is_primary"] == true)?;
        let at = usize::try_from(span["byte_end"].as_u64()?).ok()?;
        let arms = files.get(span["file_name"].as_str()?)?.arms.iter();
        let taken = arms.filter(|(arm, mutant)| {
            arm.start >= at && self.mutants[*mutant].genre == Genre::MatchArm
        });
        taken
            .min_by_key(|(arm, _)| arm.start)
            .map(|(_, mutant)| *mutant)
    }

    fn tests(&self) -> Result<Vec<Test>, String> {
        let asked = std::env::var(TESTS).unwrap_or_default();
        let mut tests = self.tests_of(self.package, asked.split_ascii_whitespace())?;
        let others = std::env::var(WITH).unwrap_or_default();
        for other in others.split_ascii_whitespace() {
            tests.extend(match other.split_once(':') {
                Some((package, target)) => self.tests_of(package, vec!["--test", target])?,
                None => self.tests_of(other, vec!["--lib"])?,
            });
        }
        Ok(tests)
    }

    fn tests_of<'b>(
        &self,
        package: &str,
        asked: impl IntoIterator<Item = &'b str>,
    ) -> Result<Vec<Test>, String> {
        let (folder, _) = places(package, self.tree)?;
        let mut arguments = vec!["test", "--no-run"];
        arguments.extend(asked);
        let messages = self.cargo(package, &arguments)?;
        // Without one of the test binaries, mutants that only its tests detect would count as
        // missed.
        let broken = messages
            .iter()
            .any(|message| message["reason"] == "build-finished" && message["success"] == false);
        if broken {
            return Err(format!("the tests of {package} do not all compile"));
        }
        let paths = messages
            .iter()
            .filter(|message| message["profile"]["test"] == true)
            .filter_map(|message| message["executable"].as_str());
        let test = |path| Test {
            folder: folder.clone(),
            path: PathBuf::from(path),
        };
        let tests: Vec<Test> = paths.map(test).collect();
        if tests.is_empty() {
            return Err(format!("{package} has no tests that compile"));
        }
        Ok(tests)
    }

    fn cargo(&self, package: &str, arguments: &[&str]) -> Result<Vec<Value>, String> {
        let output = Command::new("cargo")
            .args(arguments)
            .args(["--locked", "--package", package, "--message-format", "json"])
            .args(features(package))
            .current_dir(self.tree)
            .env("CARGO_TARGET_DIR", &self.target)
            .stderr(Stdio::inherit())
            .output()
            .map_err(|error| format!("cargo: {error}"))?;
        let text = String::from_utf8_lossy(&output.stdout);
        Ok(text
            .lines()
            .filter_map(|line| serde_json::from_str(line).ok())
            .collect())
    }
}

/// The files that the test binaries were compiled from: the compiler notes them beside each, as
/// paths in the copy.
fn sources(tests: &[Test]) -> BTreeSet<String> {
    let notes = tests.iter().map(|test| test.path.with_extension("d"));
    let texts = notes.filter_map(|path| fs::read_to_string(path).ok());
    texts
        .flat_map(|text| {
            let names = text.lines().filter_map(|line| line.strip_suffix(':'));
            names.map(str::to_owned).collect::<Vec<_>>()
        })
        .collect()
}

/// Features of `package` that the workspace's tests enable and the package alone does not: its
/// heap.
fn features(package: &str) -> &'static [&'static str] {
    match package {
        "hilrig-firmware" => &["--features", "host"],
        _ => &[],
    }
}

/// The function that an error reports as not constant, where only constants are allowed.
fn called_in_a_constant(error: &Value) -> Option<String> {
    let text = error["message"].as_str()?;
    if error["code"]["code"] != "E0015" {
        return None;
    }
    let path = text.split('`').nth(1)?;
    Some(path.rsplit("::").next().unwrap_or(path).to_owned())
}

/// The mutants in whose arms an error lies; otherwise those with arms on the same line.
fn guilty(error: &Value, files: &BTreeMap<&str, Switched>) -> Vec<usize> {
    let mut inside = Vec::new();
    let mut around = Vec::new();
    let spans = error["spans"].as_array().into_iter().flatten();
    // What a macro of another crate has made stands where the macro was called.
    let spans = spans.flat_map(|span| {
        core::iter::successors(Some(span), |span| {
            Some(&span["expansion"]["span"]).filter(|span| span.is_object())
        })
    });
    for span in spans {
        let (Some(file), Some(from), Some(to)) = (
            span["file_name"].as_str(),
            span["byte_start"]
                .as_u64()
                .and_then(|at| usize::try_from(at).ok()),
            span["byte_end"]
                .as_u64()
                .and_then(|at| usize::try_from(at).ok()),
        ) else {
            continue;
        };
        let Some(switched) = files.get(file) else {
            continue;
        };
        let meets = |arm: &Range<usize>| arm.start < to && from < arm.end;
        inside.extend(
            switched
                .arms
                .iter()
                .filter(|(arm, _)| meets(arm))
                .map(|(_, at)| *at),
        );
        // From the arm's start to the end of its line: the expression to which the arm belongs.
        around.extend(
            switched
                .arms
                .iter()
                .filter(|(arm, _)| same_line(&switched.text, arm.end, from))
                .map(|(_, at)| *at),
        );
    }
    if inside.is_empty() { around } else { inside }
}

fn same_line(text: &str, one: usize, other: usize) -> bool {
    let (low, high) = (one.min(other), one.max(other));
    text.get(low..high)
        .is_some_and(|between| !between.contains('\n'))
}
