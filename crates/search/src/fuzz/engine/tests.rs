use std::path::Path;

use super::super::subject::Kept;
use super::*;
use crate::shrink::Effort;

/// A lock of three bytes that reports the number of correct bytes: random guessing needs some 2^24
/// cases, guided search some ten thousand.
struct Lock;

const KEY: [u8; 3] = [0x5A, 0x17, 0xC3];

impl Subject for Lock {
    fn name(&self) -> &str {
        "lock"
    }

    fn round(&self) -> u64 {
        64
    }

    fn tries(&self) -> u32 {
        0
    }

    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Violation> {
        let fit = choices.iter().zip(KEY).take_while(|(a, b)| **a == *b);
        let fit = fit.count();
        behaviour.note(&[fit as u64]);
        match fit {
            3 if choices.len() > 3 && choices[3] > 0x7F => panic!("jammed at {}", choices[3]),
            3 => Err(Violation::new("opens", format!("{choices:?}"))),
            _ => Ok(()),
        }
    }

    fn seeds(&self) -> Vec<Vec<u8>> {
        vec![Vec::new()]
    }

    fn in_words(&self, _: &[u8]) -> String {
        String::new()
    }

    fn keep(&self, _: &[u8], fault: &Violation, _: &mut Effort<'_>) -> Kept {
        Kept {
            fault: fault.clone(),
            files: Vec::new(),
        }
    }

    fn case_file(&self) -> &'static str {
        ""
    }

    fn repeat(&self, _: &Path) -> String {
        String::new()
    }

    fn choices_of(&self, _: &str) -> Result<Option<Vec<u8>>, String> {
        Ok(None)
    }

    fn repeated(&self, _: &str) -> Result<Result<(), Violation>, String> {
        Ok(Ok(()))
    }
}

/// The results of all rounds up to `cases`.
fn rounds(fuzzer: &mut Fuzzer<'_>, cases: u64, jobs: usize) -> Round {
    let mut all = Round::default();
    while fuzzer.cases() < cases {
        let round = fuzzer.round(cases - fuzzer.cases(), jobs);
        all.new.extend(round.new);
        all.found.extend(round.found);
    }
    all
}

fn fuzzer() -> Fuzzer<'static> {
    Fuzzer::new(&Lock, 1, 0, BTreeMap::new())
}

#[test]
fn what_is_new_is_climbed_on_to_what_is_wrong() {
    let mut fuzzer = fuzzer();
    let all = rounds(&mut fuzzer, 100_000, 1);
    let causes: Vec<&str> = all.found.iter().map(|found| &*found.fault.cause).collect();
    assert!(causes.contains(&"opens"), "{causes:?}");
    assert!(causes.contains(&"panic: jammed at #"), "{causes:?}");
    assert_eq!((fuzzer.behaviours(), all.new.len()), (4, 4));
}

#[test]
fn it_makes_no_difference_how_many_processors_try() {
    let alone = rounds(&mut fuzzer(), 60_000, 1);
    assert_eq!(rounds(&mut fuzzer(), 60_000, 3), alone);
    assert!(alone.new.len() > 2, "{alone:?}");
}

/// Stopped at the end of a round, and continued with the stored pool.
#[test]
fn a_fuzzer_that_was_stopped_goes_on_as_if_it_had_not() {
    let whole = rounds(&mut fuzzer(), 60_000, 1);
    let mut first = fuzzer();
    let before = rounds(&mut first, 64 * 100, 1);
    let mut second = Fuzzer::new(&Lock, 1, first.cases(), first.causes().clone());
    for choices in before.new.clone() {
        second.add(choices);
    }
    let after = rounds(&mut second, 60_000, 1);
    assert_eq!([before.new, after.new].concat(), whole.new);
    assert_eq!([before.found, after.found].concat(), whole.found);
}
