//! Files of findings, and the state from which a search continues.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::case::{Case, Told};
use super::guide::Guide;
use super::harness::HarnessError;
use engine::codec::wire::Stream;
use engine::scenario::{Scenario, Source};
use safefs::Dir;

/// The state of a search: `dut.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Program, scenario, link and seed: a search continues only if they are equal.
    pub of: String,
    /// Number of the next case.
    pub next: u64,
    /// Inputs so far: frames, lines, turns of conversations.
    #[serde(default)]
    pub inputs: u64,
    /// Findings, one per cause.
    pub findings: Vec<Kept>,
    /// Kinds of turns that led to findings: used less often from then on, so that other defects are
    /// found.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub avoided: BTreeSet<String>,
    /// Coverage of a program that counts it, by link.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub guides: BTreeMap<String, Guide>,
}

/// A cause that was found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    /// Name of its folder in `findings`.
    pub folder: String,
    /// Key of the cause.
    pub key: String,
    /// The cause in words.
    pub words: String,
    /// Number of cases.
    pub count: u64,
    /// Number of the first case, from 1; 0: before the first case.
    #[serde(default)]
    pub case: u64,
}

const STATE: &str = "dut.json";

impl State {
    /// Reads the state of the search in `dir`; returns a new state if there is none.
    pub fn read(dir: &Path, of: String) -> Result<Self, HarnessError> {
        let path = dir.join(STATE);
        let text = match safefs::read_text(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Ok(Self {
                    of,
                    next: 0,
                    inputs: 0,
                    findings: Vec::new(),
                    avoided: BTreeSet::new(),
                    guides: BTreeMap::new(),
                });
            }
            Err(error) => return Err(HarnessError::File(path, error)),
        };
        let wrong = |message: String| Err(HarnessError::Content(path.clone(), message));
        match serde_json::from_str::<Self>(&text) {
            Err(error) => wrong(format!("{error}; expected the files of an earlier search")),
            Ok(state) if state.of != of => wrong(
                "is of another program, scenario, link or seed; expected another folder by --out"
                    .to_owned(),
            ),
            Ok(state) => Ok(state),
        }
    }

    /// The state in `dir`, if there is one and it can be read.
    pub fn found(dir: &Path) -> Option<Self> {
        let text = safefs::read_text(&dir.join(STATE)).ok()?;
        serde_json::from_str(&text).ok()
    }

    /// Writes the state in one step: a kill leaves the old state or the new one.
    pub fn write(&self, dir: &Path) -> Result<(), HarnessError> {
        let text = serde_json::to_string_pretty(self).expect("plain data with string keys");
        put(dir, STATE, &text)
    }
}

/// The folder of a finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The folder of the search.
    out: PathBuf,
    /// Name of the finding's folder.
    folder: String,
}

const CASE: &str = "case.toml";
const TOLD: &str = "told.toml";
const CAUSE: &str = "cause.txt";
const CAPTURE: &str = "capture.pcapng";

impl Finding {
    /// Creates `folder` among the findings of the search in `out`.
    pub fn create(out: &Path, folder: &str) -> Result<Self, HarnessError> {
        let (out, folder) = (out.to_owned(), folder.to_owned());
        let finding = Self { out, folder };
        let made = Dir::create(&finding.out).and_then(|out| out.below(finding.file("")));
        made.map_err(|error| HarnessError::File(finding.dir(), error))?;
        Ok(finding)
    }

    /// The folder.
    pub fn dir(&self) -> PathBuf {
        self.out.join(self.file(""))
    }

    /// The path of the file `name`, relative to the folder of the search.
    fn file(&self, name: &str) -> PathBuf {
        let folder = Path::new("findings").join(&self.folder);
        if name.is_empty() {
            folder
        } else {
            folder.join(name)
        }
    }

    /// Writes the case and the program's output, and moves the capture.
    pub fn write_case(&self, case: &Case, said: &str, recording: &str) -> Result<(), HarnessError> {
        put(&self.out, self.file(CASE), &case.scenario.to_toml())?;
        let told = toml::to_string_pretty(&case.told).expect("every field has a TOML form");
        put(&self.out, self.file(TOLD), &told)?;
        put(&self.out, self.file("stderr.txt"), said)?;
        let taken = Dir::open(&self.out).and_then(|out| out.rename(recording, self.file(CAPTURE)));
        taken.map_err(|error| HarnessError::File(self.dir().join(CAPTURE), error))
    }

    /// Writes the cause, with its key on the first line, and the command that repeats it.
    pub fn write_words(&self, key: &str, words: &str, repeat: &str) -> Result<(), HarnessError> {
        put(&self.out, self.file(CAUSE), &format!("{key}\n{words}\n"))?;
        put(&self.out, self.file("repeat.txt"), &format!("{repeat}\n"))
    }

    /// Removes the folder, because the case is not a finding.
    pub(super) fn remove(&self) -> Result<(), HarnessError> {
        let removed = Dir::open(&self.out).and_then(|out| out.remove_tree(self.file("")));
        removed.map_err(|error| HarnessError::File(self.dir(), error))
    }

    /// Reads the case of the finding in `dir` and the key of its cause.
    pub fn read(dir: &Path) -> Result<(Case, Source, String), HarnessError> {
        let path = dir.join(TOLD);
        if !path.exists() {
            let expected = format!("is no finding, expected a folder with {CASE} and {TOLD}");
            return Err(HarnessError::Content(dir.to_owned(), expected));
        }
        let (scenario, source) = Scenario::read(&dir.join(CASE))?;
        let told: Told = toml::from_str(&get(&path)?)
            .map_err(|error| HarnessError::Content(path.clone(), error.to_string()))?;
        if let Some(raw) = &told.raw {
            let stream = Stream::parse(&raw.stream);
            stream.map_err(|error| HarnessError::Content(path, format!("raw.stream: {error}")))?;
        }
        let key = get(&dir.join(CAUSE))?;
        let key = key.lines().next().unwrap_or_default().to_owned();
        Ok((Case { scenario, told }, source, key))
    }
}

fn get(path: &Path) -> Result<String, HarnessError> {
    safefs::read_text(path).map_err(|error| HarnessError::File(path.to_owned(), error))
}

/// Writes the file `name` below `dir`.
fn put(dir: &Path, name: impl AsRef<Path>, text: &str) -> Result<(), HarnessError> {
    let written = Dir::open(dir).and_then(|dir| dir.write(&name, text));
    written.map_err(|error| HarnessError::File(dir.join(name), error))
}
