//! The folder that a fuzzer writes and continues from.
//!
//! ```text
//! fuzz.json                     the subject, the number of cases, the number of each cause
//! corpus/TARGET/000017.txt      choices with new behaviour, in order, with their case in words
//! findings/LAW-1A2B3C4D/        a finding: the small case, cause.txt, repeat.txt
//! ```

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::subject::{Kept, Subject, law};
use crate::error::{StoreError, failed};
use engine::hex;
use safefs::Dir;

/// The subject of the fuzzer: a search continues only if it is equal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FuzzPlan {
    /// Name and version of the tool.
    pub tool: String,
    /// Seed of all mutations.
    pub seed: u64,
    /// Text of the scenario, if one is fuzzed.
    pub scenario: Option<String>,
    /// The parts of the scenario that vary, as on the command line.
    pub vary: String,
    /// Fault profile, as in [`CampaignPlan`](crate::campaign::CampaignPlan::profile).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Defects that were switched on.
    pub defects: Vec<String>,
}

/// The progress with one target.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Progress {
    cases: u64,
    causes: BTreeMap<String, u64>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    plan: FuzzPlan,
    targets: BTreeMap<String, Progress>,
}

/// Writes the file `name` below `dir`.
fn put(dir: &Path, name: impl AsRef<Path>, bytes: &[u8]) -> Result<(), StoreError> {
    let written = Dir::open(dir).and_then(|dir| dir.write(&name, bytes));
    written.map_err(failed(&dir.join(name)))
}

/// First word of a corpus file; the choices follow in hexadecimal.
const CHOICES: &str = "# choices ";

/// The folder of a fuzzer.
#[derive(Debug)]
pub struct Folder {
    dir: PathBuf,
    state: State,
}

impl Folder {
    /// Opens or creates `dir` to continue with `plan`.
    ///
    /// # Errors
    /// If the folder cannot be written, or belongs to another plan.
    pub fn create(dir: &Path, plan: FuzzPlan) -> Result<Self, StoreError> {
        let made = Dir::create(dir).and_then(|dir| dir.below("findings"));
        made.map_err(failed(dir))?;
        let path = dir.join("fuzz.json");
        let targets = if path.exists() {
            let text = safefs::read_text(&path).map_err(failed(&path))?;
            let wrong = |message: String| StoreError::Content {
                path: path.clone(),
                message,
            };
            let state: State = serde_json::from_str(&text)
                .map_err(|error| wrong(format!("{error}, expected the state of a fuzzer")))?;
            if state.plan != plan {
                let expected = "the same --seed, --scenario, --description, --vary, --profile, --defect and version";
                let message = format!("is of another run, expected {expected}, or another --out");
                return Err(wrong(message));
            }
            state.targets
        } else {
            BTreeMap::new()
        };
        let (dir, state) = (dir.to_owned(), State { plan, targets });
        Ok(Self { dir, state })
    }

    /// The number of earlier cases of `target`, and the number of each cause.
    pub fn progress(&self, target: &str) -> (u64, BTreeMap<String, u64>) {
        let progress = self.state.targets.get(target).cloned().unwrap_or_default();
        (progress.cases, progress.causes)
    }

    /// Stores the progress with `target`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(
        &mut self,
        target: &str,
        cases: u64,
        causes: &BTreeMap<String, u64>,
    ) -> Result<(), StoreError> {
        let causes = causes.clone();
        let progress = Progress { cases, causes };
        self.state.targets.insert(target.to_owned(), progress);
        let text = serde_json::to_string_pretty(&self.state).expect("plain data");
        // In one step: a kill leaves the old or the new state.
        put(&self.dir, "fuzz.json", (text + "\n").as_bytes())
    }

    fn corpus_of(&self, subject: &dyn Subject) -> PathBuf {
        self.dir.join("corpus").join(subject.name())
    }

    /// The stored choices for `subject`, in order.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn pool(&self, subject: &dyn Subject) -> Result<Vec<Vec<u8>>, StoreError> {
        match self.corpus_of(subject) {
            dir if dir.exists() => read_corpus(&dir, subject),
            _ => Ok(Vec::new()),
        }
    }

    /// Stores the choices with the number `number` in the pool of `subject`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn keep_choices(
        &self,
        subject: &dyn Subject,
        number: usize,
        choices: &[u8],
    ) -> Result<(), StoreError> {
        let dir = Path::new("corpus").join(subject.name());
        let mut text = CHOICES.to_owned();
        hex::push_digits(&mut text, choices);
        text += "\n";
        text += &subject.in_words(choices);
        let name = dir.join(format!("{number:06}.txt"));
        put(&self.dir, name, text.as_bytes())
    }

    /// Stores a finding; returns its folder.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn keep_finding(&self, subject: &dyn Subject, kept: &Kept) -> Result<PathBuf, StoreError> {
        let case = kept.files.first().map_or(&[][..], |(_, bytes)| bytes);
        let hash = engine::rig::trace::fingerprint(case).to_ascii_uppercase();
        let hash: String = hash.chars().take(8).collect();
        let name = format!("{}-{hash}", file_name(law(&kept.fault.cause)));
        let folder = Path::new("findings").join(name);
        let dir = self.dir.join(&folder);
        for (name, bytes) in &kept.files {
            put(&self.dir, folder.join(name), bytes)?;
        }
        let said = format!("{}\n{}\n", kept.fault.cause, kept.fault.detail);
        put(&self.dir, folder.join("cause.txt"), said.as_bytes())?;
        let repeat = subject.repeat(&dir) + "\n";
        put(&self.dir, folder.join("repeat.txt"), repeat.as_bytes())?;
        Ok(dir)
    }
}

/// A file name of lower-case letters, digits and dashes.
fn file_name(law: &str) -> String {
    let kept = law.chars().take(40).map(|c| match c {
        'a'..='z' | '0'..='9' => c,
        'A'..='Z' => c.to_ascii_lowercase(),
        _ => '-',
    });
    kept.collect()
}

/// Reads the choices in all files of `dir`, in order of file names: files of a fuzzer, and
/// hand-written cases.
///
/// # Errors
/// If a file cannot be read or parsed.
pub fn read_corpus(dir: &Path, subject: &dyn Subject) -> Result<Vec<Vec<u8>>, StoreError> {
    let entries = fs::read_dir(dir).map_err(failed(dir))?;
    let mut paths = Vec::new();
    for entry in entries {
        paths.push(entry.map_err(failed(dir))?.path());
    }
    paths.retain(|path| path.extension().is_some_and(|name| name == "txt"));
    paths.sort();
    let mut corpus = Vec::new();
    for path in paths {
        let text = safefs::read_text(&path).map_err(failed(&path))?;
        let first = text
            .lines()
            .next()
            .and_then(|line| line.strip_prefix(CHOICES));
        let choices = match first {
            Some(digits) => hex::bytes(digits.trim_end()).map(Some).ok_or_else(|| {
                format!("line 1: expected pairs of hexadecimal digits behind \"{CHOICES}\"")
            }),
            None => subject.choices_of(&text),
        };
        let choices = choices.map_err(|message| StoreError::Content { path, message })?;
        corpus.extend(choices);
    }
    Ok(corpus)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_law_becomes_a_name_that_every_file_system_takes() {
        assert_eq!(file_name("panic"), "panic");
        assert_eq!(file_name("at <A/B> 5"), "at--a-b--5");
    }
}
