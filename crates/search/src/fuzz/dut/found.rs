//! Confirmation and minimisation of a new finding.

use core::cell::RefCell;
use std::path::Path;

use super::case::{Case, Pair, Raw, Turn, is_wiring};
use super::cause::Cause;
use super::finding::Finding;
use super::harness::{Harness, HarnessError, Whose};
use super::plan::{Progress, RECORDINGS, TrialPlan};
use super::speech::Speech;
use super::trial::{self, TrialOutcome};
use crate::shrink::{Effort, fewest};
use safefs::Dir;

/// A new finding before it is stored.
pub(super) struct OpenFinding<'a> {
    pub(super) harness: &'a Harness<'a>,
    pub(super) plan: &'a TrialPlan,
    pub(super) speech: &'a Speech,
    pub(super) cause: &'a Cause,
    pub(super) finding: Finding,
    pub(super) progress: &'a Progress,
    /// The kinds of the remaining turns.
    pub(super) kinds: RefCell<Vec<String>>,
}

impl OpenFinding<'_> {
    /// Writes the finding, confirms it, then minimises it. Returns whether to keep it: a finding
    /// in virtual time, or one that may come from the load of this machine, must be seen again.
    pub(super) fn keep(&self, first: Case, seen: &TrialOutcome) -> Result<bool, HarnessError> {
        let [recording, copy, _] = RECORDINGS;
        // Two causes of the same case share a capture.
        let copied = Dir::open(&self.plan.out)
            .and_then(|out| out.write(copy, out.read(recording, u64::MAX)?));
        let recording = self.plan.out.join(recording);
        copied.map_err(|error| HarnessError::File(recording, error))?;
        self.finding.write_case(&first, &seen.said, copy)?;
        self.write_words("not tried again")?;
        let is_there = matches!(self.harness.whose, Whose::Command { .. });
        if self.cause.is_final() && !is_there {
            return Ok(true);
        }
        let is_virtual = self.harness.supervision.is_some();
        let times = if self.cause.may_be_lateness() { 2 } else { 1 };
        for _ in 0..times {
            match self.again(&first) {
                Ok(true) => {}
                Ok(false) => {
                    self.write_words("not seen when the case was run once more")?;
                    return Ok(!(is_virtual || self.cause.may_be_lateness()));
                }
                Err(HarnessError::Interrupted) => return Ok(!self.cause.may_be_lateness()),
                Err(error) => return Err(error),
            }
        }
        let words = match is_there {
            true => self.shrink(&first)?,
            false => "seen again".to_owned(),
        };
        self.write_words(&words)?;
        Ok(true)
    }

    fn write_words(&self, words: &str) -> Result<(), HarnessError> {
        let words = format!("{}\n{words}", self.cause);
        let repeat = format!(
            "{} --repeat {}",
            self.plan.repeat,
            quoted(&self.finding.dir())
        );
        self.finding.write_words(&self.cause.key(), &words, &repeat)
    }

    /// Whether `case` shows the finding again; if it does, the case is written.
    fn again(&self, case: &Case) -> Result<bool, HarnessError> {
        let recording = self.plan.out.join(RECORDINGS[2]);
        self.progress.tries.set(self.progress.tries.get() + 1);
        let seen = trial::run(self.harness, case, self.speech, &recording)?;
        let key = self.cause.key();
        let is_it = seen.causes.iter().any(|cause| cause.key() == key);
        if is_it {
            let mut case = case.clone();
            if let Some(raw) = case.told.raw.as_mut().filter(|raw| !raw.turn.is_empty()) {
                *raw = seen.held.of(raw);
            }
            self.finding.write_case(&case, &seen.said, RECORDINGS[2])?;
            let turns = case.told.raw.iter().flat_map(|raw| &raw.turn);
            *self.kinds.borrow_mut() = turns.map(|turn| turn.kind.clone()).collect();
        }
        Ok(is_it)
    }

    /// Removes the parts that do not matter; returns a description of the rest.
    fn shrink(&self, first: &Case) -> Result<String, HarnessError> {
        let is_over = || !(self.harness.goes_on)();
        let mut effort = Effort::until(self.plan.tries, &is_over);
        let mut failure = None;
        let mut shows = |case: Case| {
            let is_empty = case.told.raw.as_ref().is_some_and(Raw::is_empty);
            let again = if is_empty {
                Ok(false)
            } else {
                self.again(&case)
            };
            again.unwrap_or_else(|error| {
                failure.get_or_insert(error);
                false
            })
        };
        let (all, left, what) = match &first.told.raw {
            None => {
                // Without its wiring, a sound program fails for another reason.
                let (wiring, faults): (Vec<_>, Vec<_>) =
                    first.scenario.fault.iter().cloned().partition(is_wiring);
                let left = fewest(&faults, &mut effort, |left| {
                    let mut case = first.clone();
                    case.scenario.fault = [&wiring[..], left].concat();
                    shows(case)
                });
                (faults.len(), left.len(), "faults")
            }
            Some(raw) if !raw.turn.is_empty() => {
                let all = raw.turn.len();
                let plain = without_damage(first);
                let is_plain = plain.is_some_and(|plain| effort.spend() && shows(plain));
                let with = |turns: &[Turn]| with_turns(first, turns, is_plain);
                let mut left = raw.turn.clone();
                // Pairs of frames need no turn.
                if !raw.learned.is_empty() && effort.spend() && shows(with(&[])) {
                    left.clear();
                }
                // The last turn is the cause most often.
                for count in [1, 2] {
                    let last = &raw.turn[all.saturating_sub(count)..];
                    if last.len() < left.len() && effort.spend() && shows(with(last)) {
                        left = last.to_vec();
                    }
                }
                if left.len() > 1 {
                    left = fewest(&left, &mut effort, |turns| shows(with(turns)));
                }
                (all, left.len(), "turns")
            }
            Some(_) => {
                let units = units(first);
                let left = fewest(&units, &mut effort, |left| shows(with_units(first, left)));
                (units.len(), left.len(), "frames and stretches of bytes")
            }
        };
        match failure {
            Some(HarnessError::Interrupted) | None => {}
            Some(error) => return Err(error),
        }
        let tries = effort.spent();
        Ok(format!("{left} {what} left of {all}, {tries} tries"))
    }
}

/// `case` without its experiments with damaged replies and requests; `None` if it has none.
fn without_damage(case: &Case) -> Option<Case> {
    let mut case = case.clone();
    let raw = case.told.raw.as_mut()?;
    let learned = core::mem::take(&mut raw.learned);
    (raw.damage.take().is_some() || !learned.is_empty()).then_some(case)
}

fn with_turns(case: &Case, turns: &[Turn], is_plain: bool) -> Case {
    let plain = without_damage(case).filter(|_| is_plain);
    let mut case = plain.unwrap_or_else(|| case.clone());
    if let Some(raw) = &mut case.told.raw {
        raw.turn = turns.to_vec();
    }
    case
}

/// A part of a raw case that can be removed.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Unit {
    Pair(Pair),
    /// A line of the stream.
    Piece(String),
}

fn units(case: &Case) -> Vec<Unit> {
    let Some(raw) = &case.told.raw else {
        return Vec::new();
    };
    let pairs = raw.pair.iter().cloned().map(Unit::Pair);
    let lines = raw.stream.lines().map(|line| Unit::Piece(line.to_owned()));
    pairs.chain(lines).collect()
}

fn with_units(case: &Case, units: &[Unit]) -> Case {
    let mut case = case.clone();
    if let Some(raw) = &mut case.told.raw {
        (raw.pair, raw.stream) = (Vec::new(), String::new());
        for unit in units {
            match unit {
                Unit::Pair(pair) => raw.pair.push(pair.clone()),
                Unit::Piece(line) => {
                    raw.stream += line;
                    raw.stream.push('\n');
                }
            }
        }
    }
    case
}

/// `path` quoted for a shell.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::super::case::{Hex, Told};
    use super::*;
    use engine::scenario::Scenario;

    #[test]
    fn a_case_is_taken_apart_and_put_together_again() {
        let text = "schema = 1\nname = \"a\"\nrobot = \"rescue\"\nduration = \"5s\"\n\
            [world]\nstart = { x_m = 1.5, y_m = 1.5, heading_deg = 90 }\n[[world.wall]]\n\
            path_m = [[0.3, 0.3], [2.7, 0.3]]\n";
        let parsed = Scenario::parse(Path::new("<test>"), text.to_owned());
        let pair = Pair {
            good: Hex(vec![1, 2]),
            damaged: Hex(vec![1, 3]),
            noise: Hex(vec![9, 9]),
        };
        let raw = Raw {
            pair: vec![pair],
            stream: "AB 04\nidle\nFF\n".to_owned(),
            ..Raw::default()
        };
        let case = Case {
            scenario: parsed.expect("sound").0,
            told: Told {
                raw: Some(raw),
                ..Told::default()
            },
        };
        let all = units(&case);
        assert_eq!(all.len(), 4);
        assert_eq!(with_units(&case, &all), case);
        let less = with_units(&case, &[all[0].clone(), all[3].clone()]);
        let raw = less.told.raw.expect("as before");
        assert_eq!((raw.pair.len(), raw.stream.as_str()), (1, "FF\n"));
    }

    #[test]
    fn a_path_with_a_quote_is_one_word_for_a_shell() {
        assert_eq!(quoted(Path::new("/a b/c'd")), "'/a b/c'\\''d'");
    }
}
