//! Results of a million runs in little memory: repeated words are stored once.

use core::num::NonZeroU32;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use super::lines::Line;

/// The stored result of one run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run<'a> {
    /// Name of the scenario.
    pub scenario: &'a str,
    /// Seed of the run.
    pub seed: u64,
    /// The cause of the failure, without the figures.
    pub cause: Option<&'a str>,
    /// The cause of the failure, with the figures.
    pub detail: Option<&'a str>,
    /// Virtual time, milliseconds.
    pub ran_ms: u64,
    trace: Trace<'a>,
    /// Situations that occurred, in order.
    pub reached: &'a [String],
}

impl Run<'_> {
    /// Fingerprint of all bytes.
    pub(crate) fn trace(&self) -> Cow<'_, str> {
        match self.trace {
            Trace::Hash(hash) => Cow::Owned(format!("{hash:016x}")),
            Trace::Text(text) => Cow::Borrowed(text),
        }
    }
}

/// A fingerprint: 16 hexadecimal digits, or another text for a run that panicked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trace<'a> {
    Hash(u64),
    Text(&'a str),
}

impl<'a> Trace<'a> {
    fn of(text: &'a str) -> Self {
        let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        let is_hash = text.len() == 16 && text.bytes().all(is_digit);
        let hash = u64::from_str_radix(text, 16).ok().filter(|_| is_hash);
        hash.map_or(Self::Text(text), Self::Hash)
    }
}

/// The number of a word that is stored once, from 1.
type Id = NonZeroU32;

/// A run in 32 bytes.
#[derive(Clone, Copy, Debug)]
struct Packed {
    /// The fingerprint, or the number of its text.
    trace: u64,
    ran_ms: u64,
    cause: Option<Id>,
    detail: Option<Id>,
    reached: Id,
    is_hash: bool,
}

/// Words that are stored once, in order of their first use.
#[derive(Debug, Default)]
struct Words {
    ids: BTreeMap<Arc<str>, Id>,
    all: Vec<Arc<str>>,
}

impl Words {
    /// The number of `word`; `None` after four thousand million words.
    fn id(&mut self, word: &str) -> Option<Id> {
        if let Some(&id) = self.ids.get(word) {
            return Some(id);
        }
        let id = id_after(self.all.len())?;
        let word = Arc::<str>::from(word);
        self.all.push(Arc::clone(&word));
        self.ids.insert(word, id);
        Some(id)
    }

    fn get(&self, id: Id) -> &str {
        &self.all[index(id)]
    }
}

/// Sets of words that are stored once.
#[derive(Debug, Default)]
struct Sets {
    words: Words,
    ids: BTreeMap<Vec<Id>, Id>,
    /// The words of each set in order.
    all: Vec<Vec<String>>,
}

impl Sets {
    /// The number of the set of `words`; `None` after four thousand million sets.
    fn id<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Option<Id> {
        let set: Option<Vec<Id>> = words.map(|word| self.words.id(word)).collect();
        let mut set = set?;
        set.sort_unstable();
        set.dedup();
        if let Some(&id) = self.ids.get(&set) {
            return Some(id);
        }
        let id = id_after(self.all.len())?;
        let words = set.iter().map(|&id| self.words.get(id).to_owned());
        let mut words: Vec<String> = words.collect();
        words.sort_unstable();
        self.all.push(words);
        self.ids.insert(set, id);
        Some(id)
    }

    fn get(&self, id: Id) -> &[String] {
        &self.all[index(id)]
    }
}

/// The next number after `count` others.
fn id_after(count: usize) -> Option<Id> {
    u32::try_from(count + 1).ok().and_then(Id::new)
}

const fn index(id: Id) -> usize {
    id.get() as usize - 1
}

/// The runs of some scenarios, in order of scenario and seed.
#[derive(Debug)]
pub(super) struct Runs {
    /// Names of the scenarios, in order.
    scenarios: Vec<String>,
    /// The runs of each scenario, by seed.
    done: Vec<BTreeMap<u64, Packed>>,
    causes: Words,
    /// Number of failed runs for each cause.
    failed: Vec<usize>,
    details: Words,
    sets: Sets,
}

impl Runs {
    /// An empty set of runs; `scenarios` are in order.
    pub(super) fn new(scenarios: impl Iterator<Item = String>) -> Self {
        let scenarios: Vec<String> = scenarios.collect();
        Self {
            done: scenarios.iter().map(|_| BTreeMap::new()).collect(),
            scenarios,
            causes: Words::default(),
            failed: Vec::new(),
            details: Words::default(),
            sets: Sets::default(),
        }
    }

    /// Number of runs.
    pub(super) fn len(&self) -> usize {
        self.done.iter().map(BTreeMap::len).sum()
    }

    /// Number of failed runs.
    pub(super) fn failed(&self) -> usize {
        self.failed.iter().sum()
    }

    /// Each cause with its number of failed runs.
    pub(super) fn causes(&self) -> impl Iterator<Item = (&str, usize)> {
        let counted = self.causes.all.iter().zip(&self.failed);
        let some = counted.filter(|(_, runs)| **runs > 0);
        some.map(|(cause, &runs)| (&**cause, runs))
    }

    /// Whether this run is finished.
    pub(super) fn has(&self, scenario: &str, seed: u64) -> bool {
        self.packed(scenario, seed).is_some()
    }

    /// The result of this run, if it is finished.
    pub(super) fn get(&self, scenario: &str, seed: u64) -> Option<Run<'_>> {
        let (number, packed) = self.packed(scenario, seed)?;
        Some(self.unpacked(number, seed, packed))
    }

    /// All runs in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = Run<'_>> {
        self.done
            .iter()
            .enumerate()
            .flat_map(move |(number, done)| {
                let unpacked = move |(&seed, packed)| self.unpacked(number, seed, packed);
                done.iter().map(unpacked)
            })
    }

    /// Adds a result, or replaces the earlier result of the run. Returns false if the scenario is
    /// unknown or the numbers are used up.
    pub(super) fn insert(&mut self, line: &Line<'_>) -> bool {
        let Some(number) = self.number(&line.scenario) else {
            return false;
        };
        let Some((packed, seed)) = self.pack(line) else {
            return false;
        };
        self.failed.resize(self.causes.all.len(), 0);
        if let Some(cause) = packed.cause {
            self.failed[index(cause)] += 1;
        }
        let before = self.done[number].insert(seed, packed);
        if let Some(cause) = before.and_then(|before| before.cause) {
            self.failed[index(cause)] -= 1;
        }
        true
    }

    fn pack(&mut self, line: &Line<'_>) -> Option<(Packed, u64)> {
        let reached = self.sets.id(line.reached())?;
        let kept = |words: &mut Words, text: Option<&str>| match text {
            Some(text) => words.id(text).map(Some),
            None => Some(None),
        };
        let (trace, is_hash) = match Trace::of(&line.trace) {
            Trace::Hash(hash) => (hash, true),
            Trace::Text(text) => (kept(&mut self.details, Some(text))??.get().into(), false),
        };
        let packed = Packed {
            trace,
            ran_ms: line.ran_ms,
            cause: kept(&mut self.causes, line.cause())?,
            detail: kept(&mut self.details, line.detail())?,
            reached,
            is_hash,
        };
        Some((packed, line.seed))
    }

    fn unpacked(&self, number: usize, seed: u64, packed: &Packed) -> Run<'_> {
        let text = |id: Id| self.details.get(id);
        let trace = if packed.is_hash {
            Trace::Hash(packed.trace)
        } else {
            let id = u32::try_from(packed.trace).ok().and_then(Id::new);
            Trace::Text(id.map_or("", text))
        };
        Run {
            scenario: &self.scenarios[number],
            seed,
            cause: packed.cause.map(|id| self.causes.get(id)),
            detail: packed.detail.map(text),
            ran_ms: packed.ran_ms,
            trace,
            reached: self.sets.get(packed.reached),
        }
    }

    fn number(&self, scenario: &str) -> Option<usize> {
        let found = self
            .scenarios
            .binary_search_by(|name| (**name).cmp(scenario));
        found.ok()
    }

    fn packed(&self, scenario: &str, seed: u64) -> Option<(usize, &Packed)> {
        let number = self.number(scenario)?;
        Some((number, self.done[number].get(&seed)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::Record;

    fn record(scenario: &str, seed: u64, cause: Option<&str>) -> Record {
        Record {
            scenario: scenario.to_owned(),
            seed,
            cause: cause.map(str::to_owned),
            detail: cause.map(|cause| format!("{cause}: at {seed} ms")),
            ran_ms: 2000,
            trace: "00c4aaee66d71f17".to_owned(),
            reached: ["turns", "lost"].map(str::to_owned).into(),
        }
    }

    fn runs() -> Runs {
        Runs::new(["hall", "room"].map(str::to_owned).into_iter())
    }

    /// At this size a million runs fit into 100 MB: a key takes 8 more bytes, and a tree of sorted
    /// entries is a little more than half full.
    #[test]
    fn a_run_that_passes_is_kept_in_32_bytes() {
        assert_eq!(size_of::<Packed>(), 32);
        let mut runs = runs();
        for seed in 0..1000 {
            assert!(runs.insert(&Line::of(&record("room", seed, None))));
        }
        assert_eq!((runs.len(), runs.failed()), (1000, 0));
        assert_eq!((runs.sets.all.len(), runs.sets.words.all.len()), (1, 2));
        assert_eq!((runs.causes.all.len(), runs.details.all.len()), (0, 0));
    }

    /// A fingerprint keeps its leading zeros; any other text is kept unchanged.
    #[test]
    fn what_is_kept_is_what_was_given() {
        let mut runs = runs();
        for trace in [
            "00c4aaee66d71f17",
            "",
            "7",
            "00C4AAEE66D71F17",
            "+0c4aaee66d71f17",
        ] {
            let mut given = record("room", 7, Some("settled"));
            given.trace = trace.to_owned();
            assert!(runs.insert(&Line::of(&given)));
            let kept = runs.get("room", 7).expect("it is done");
            assert_eq!(Line::of_kept(&kept).text(), Line::of(&given).text());
        }
    }

    /// Room 1 fails, then passes when it is run again.
    #[test]
    fn of_a_run_done_twice_the_later_counts() {
        let mut runs = runs();
        for (scenario, seed, cause) in [
            ("room", 1, Some("settled")),
            ("hall", 9, Some("settled")),
            ("room", 0, Some("panic")),
            ("room", 1, None),
        ] {
            assert!(runs.insert(&Line::of(&record(scenario, seed, cause))));
        }
        let causes: Vec<_> = runs.causes().collect();
        assert_eq!(causes, [("settled", 1), ("panic", 1)]);
        assert_eq!((runs.len(), runs.failed()), (3, 2));
        let order: Vec<_> = runs.iter().map(|run| (run.scenario, run.seed)).collect();
        assert_eq!(order, [("hall", 9), ("room", 0), ("room", 1)]);
        assert!(!runs.insert(&Line::of(&record("attic", 0, None))));
    }
}
