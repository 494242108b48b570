//! What is kept of a finding, and of a search so that it can continue.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::case::{Case, Told};
use super::guide::Guide;
use super::harness::HarnessError;
use engine::codec::wire::Stream;
use engine::scenario::{Scenario, Source};
use safefs::Dir;

/// Where a search stands: `dut.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// The program, the scenario, the link and the seed: what must be the same to continue.
    pub of: String,
    /// Number of the next case.
    pub next: u64,
    /// Inputs so far: frames, lines, turns of conversations.
    #[serde(default)]
    pub inputs: u64,
    /// What was found, a cause once.
    pub findings: Vec<Kept>,
    /// Kinds of turns that led to findings: rarer from then on, so that others are found.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub avoided: BTreeSet<String>,
    /// What was learnt of a program that counts what it reaches, by link.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub guides: BTreeMap<String, Guide>,
}

/// A cause that was found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    /// Name of its folder in `findings`.
    pub folder: String,
    /// Its key.
    pub key: String,
    /// In words.
    pub words: String,
    /// In how many cases.
    pub count: u64,
    /// In which case it was first seen, counted from 1; 0: before the first one.
    #[serde(default)]
    pub case: u64,
}

const STATE: &str = "dut.json";

impl State {
    /// The state of the search in `dir`; a new one if there was none.
    pub fn read(dir: &Path, of: String) -> Result<Self, HarnessError> {
        let path = dir.join(STATE);
        let text = match fs::read_to_string(&path) {
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
            Err(error) => wrong(format!("{error}; expected what an earlier search left")),
            Ok(state) if state.of != of => wrong(
                "is of another program, scenario, link or seed; expected another folder by --out"
                    .to_owned(),
            ),
            Ok(state) => Ok(state),
        }
    }

    /// The state that a search left in `dir`, if it can be read.
    pub fn found(dir: &Path) -> Option<Self> {
        let text = fs::read_to_string(dir.join(STATE)).ok()?;
        serde_json::from_str(&text).ok()
    }

    /// Writes it so that a killed process leaves the old one or the new one.
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
    /// Makes `folder` among the findings of the search in `out`.
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

    /// The file `name` of the finding, seen from the folder of the search.
    fn file(&self, name: &str) -> PathBuf {
        let folder = Path::new("findings").join(&self.folder);
        if name.is_empty() {
            folder
        } else {
            folder.join(name)
        }
    }

    /// Writes the case and what its program said, and takes the capture.
    pub fn write_case(&self, case: &Case, said: &str, recording: &str) -> Result<(), HarnessError> {
        put(&self.out, self.file(CASE), &case.scenario.to_toml())?;
        let told = toml::to_string_pretty(&case.told).expect("every field has a TOML form");
        put(&self.out, self.file(TOLD), &told)?;
        put(&self.out, self.file("stderr.txt"), said)?;
        let taken = Dir::open(&self.out).and_then(|out| out.rename(recording, self.file(CAPTURE)));
        taken.map_err(|error| HarnessError::File(self.dir().join(CAPTURE), error))
    }

    /// Writes the cause, its key on the first line, and the command that repeats it.
    pub fn write_words(&self, key: &str, words: &str, repeat: &str) -> Result<(), HarnessError> {
        put(&self.out, self.file(CAUSE), &format!("{key}\n{words}\n"))?;
        put(&self.out, self.file("repeat.txt"), &format!("{repeat}\n"))
    }

    /// Removes the folder: it was none.
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
    fs::read_to_string(path).map_err(|error| HarnessError::File(path.to_owned(), error))
}

/// Writes the file `name` below `dir`.
fn put(dir: &Path, name: impl AsRef<Path>, text: &str) -> Result<(), HarnessError> {
    let written = Dir::open(dir).and_then(|dir| dir.write(&name, text));
    written.map_err(|error| HarnessError::File(dir.join(name), error))
}
