//! The fuzzer: rounds of cases. A round depends only on the seed and on the pool at its beginning,
//! so that the number of processors does not change the result.

use core::cell::Cell;
use core::panic::AssertUnwindSafe;
use core::sync::atomic::{AtomicU64, Ordering};
use std::collections::BTreeMap;
use std::panic::{self, catch_unwind};
use std::thread;

use emulators::rng::Rng;

use super::havoc;
use super::subject::{Behaviour, MARKS, Subject, Violation, law};
use crate::campaign::words_of_panic;
use engine::workers;

/// Maximum number of stored causes per law: if a law is broken in more ways, the first ones show
/// the defect.
const CAUSES_MAX: usize = 5;
/// Maximum number of stored choices.
const POOL_MAX: usize = 20_000;
/// Number of cases that a thread takes at once.
const CHUNK: u64 = 16;

/// The first case of a cause.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirstCase {
    /// The violated law.
    pub fault: Violation,
    /// The choices that led to the case.
    pub choices: Vec<u8>,
    /// Number of the case.
    pub case: u64,
}

/// The result of a round.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Round {
    /// Choices with new behaviour, in order; they have been added to the pool.
    pub new: Vec<Vec<u8>>,
    /// The first case of each new cause.
    pub found: Vec<FirstCase>,
}

/// A fuzzer of one subject.
pub struct Fuzzer<'a> {
    subject: &'a dyn Subject,
    seed: u64,
    cases: u64,
    pool: Vec<Vec<u8>>,
    seen: Coverage,
    /// Number of occurrences of each cause.
    causes: BTreeMap<String, u64>,
}

/// A case with new behaviour or a violation.
struct Tried {
    case: u64,
    choices: Vec<u8>,
    marks: Vec<u32>,
    fault: Option<Violation>,
}

impl<'a> Fuzzer<'a> {
    /// A fuzzer that has already run `cases` cases with the result `causes`.
    pub fn new(
        subject: &'a dyn Subject,
        seed: u64,
        cases: u64,
        causes: BTreeMap<String, u64>,
    ) -> Self {
        Self {
            subject,
            seed,
            cases,
            pool: Vec::new(),
            seen: Coverage::default(),
            causes,
        }
    }

    /// Number of cases so far.
    pub const fn cases(&self) -> u64 {
        self.cases
    }

    /// Number of different behaviours so far.
    pub const fn behaviours(&self) -> usize {
        self.seen.count
    }

    /// Number of occurrences of each cause.
    pub const fn causes(&self) -> &BTreeMap<String, u64> {
        &self.causes
    }

    /// Runs `choices`, and adds them to the pool if their behaviour is new. They do not count as a
    /// case.
    pub fn add(&mut self, choices: Vec<u8>) -> Round {
        let mut behaviour = Behaviour::default();
        let tried = self.attempt(self.cases, choices, &mut behaviour);
        let mut round = Round::default();
        self.take(tried, &mut round);
        round
    }

    /// Runs up to `most` cases on `jobs` threads.
    pub fn round(&mut self, most: u64, jobs: usize) -> Round {
        // Rounds begin at multiples of their length, also after a shortened round.
        let length = self.subject.round();
        let end = self.cases + (length - self.cases % length).min(most);
        let next = AtomicU64::new(self.cases);
        let worker = || {
            let (mut looked, mut behaviour) = (Vec::new(), Behaviour::default());
            loop {
                let from = next.fetch_add(CHUNK.min(length), Ordering::Relaxed);
                if from >= end {
                    return looked;
                }
                for case in from..end.min(from + CHUNK.min(length)) {
                    let mut rng = Rng::stream(self.seed ^ case << 20, self.subject.name());
                    let choices = havoc::mutated(&self.pool, &mut rng);
                    let tried = self.attempt(case, choices, &mut behaviour);
                    if tried.fault.is_some() || self.seen.lacks(&tried.marks) {
                        looked.push(tried);
                    }
                }
            }
        };
        let mut looked = if jobs <= 1 {
            worker()
        } else {
            thread::scope(|scope| {
                let threads: Vec<_> = (0..jobs).map(|_| workers::spawn(scope, worker)).collect();
                let each = threads.into_iter().map(|thread| thread.join());
                each.flat_map(|looked| looked.expect("panics of cases are caught"))
                    .collect()
            })
        };
        looked.sort_by_key(|tried| tried.case);
        let mut round = Round::default();
        looked
            .into_iter()
            .for_each(|tried| self.take(tried, &mut round));
        self.cases = end;
        round
    }

    /// Runs one case. Marks are those that were not set before the round; some may be known.
    fn attempt(&self, case: u64, choices: Vec<u8>, behaviour: &mut Behaviour) -> Tried {
        behaviour.clear();
        let fault = judged(self.subject, &choices, behaviour);
        let marks = if fault.is_some() || self.seen.lacks(behaviour.marks()) {
            behaviour.marks().to_vec()
        } else {
            Vec::new()
        };
        Tried {
            case,
            choices,
            marks,
            fault,
        }
    }

    fn take(&mut self, tried: Tried, round: &mut Round) {
        if let Some(fault) = &tried.fault {
            let known = self.causes.contains_key(&fault.cause);
            let alike = self.causes.keys().filter(|cause| law(cause) == fault.law());
            if known || alike.count() < CAUSES_MAX {
                *self.causes.entry(fault.cause.clone()).or_default() += 1;
            }
            if !known && self.causes.contains_key(&fault.cause) {
                round.found.push(FirstCase {
                    fault: fault.clone(),
                    choices: tried.choices.clone(),
                    case: tried.case,
                });
            }
        }
        if self.seen.add(&tried.marks) && self.pool.len() < POOL_MAX {
            self.pool.push(tried.choices.clone());
            round.new.push(tried.choices);
        }
    }
}

/// Runs `choices` and returns the violation; a panic counts as one.
pub(super) fn judged(
    subject: &dyn Subject,
    choices: &[u8],
    behaviour: &mut Behaviour,
) -> Option<Violation> {
    caught(|| subject.run(choices, behaviour)).err()
}

thread_local! {
    /// Whether this thread is running a case: its panic is a finding and is reported as such.
    static TRIES: Cell<bool> = const { Cell::new(false) };
}

/// Runs `run`; a panic becomes a violation.
pub(super) fn caught(run: impl FnOnce() -> Result<(), Violation>) -> Result<(), Violation> {
    let before = TRIES.replace(true);
    let judged = catch_unwind(AssertUnwindSafe(run));
    TRIES.set(before);
    judged.unwrap_or_else(|panic| {
        let (cause, detail) = words_of_panic(panic.as_ref());
        Err(Violation::new(cause, detail))
    })
}

/// Suppresses the output of panics in cases: they become findings.
pub fn silence_panics() {
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |about| {
        if !TRIES.get() {
            usual(about);
        }
    }));
}

/// The set of all marks.
struct Coverage {
    bits: Vec<u64>,
    count: usize,
}

impl Default for Coverage {
    fn default() -> Self {
        Self {
            bits: vec![0; MARKS as usize / 64],
            count: 0,
        }
    }
}

impl Coverage {
    const fn place(mark: u32) -> (usize, u64) {
        (mark as usize / 64, 1 << (mark % 64))
    }

    /// Whether one of `marks` is new.
    fn lacks(&self, marks: &[u32]) -> bool {
        marks.iter().any(|&mark| {
            let (word, bit) = Self::place(mark);
            self.bits[word] & bit == 0
        })
    }

    /// Adds `marks`; returns whether one is new.
    fn add(&mut self, marks: &[u32]) -> bool {
        let before = self.count;
        for &mark in marks {
            let (word, bit) = Self::place(mark);
            self.count += usize::from(self.bits[word] & bit == 0);
            self.bits[word] |= bit;
        }
        self.count > before
    }
}

#[cfg(test)]
mod tests;
