//! Programs as subjects: sessions of bytes, pauses and damaged replies, each a readable text.
//!
//! ```text
//! base AB 2E 83 14 EC 00 02 5C      bytes on a port, back to back
//! wait 1200 ms
//! reply count 7E                    damages the next reply in this way
//! ```

mod base;
mod pc;
mod rescue;
mod step;
mod tape;

use std::path::Path;

use super::engine::caught;
use super::subject::{Behaviour, Kept, Subject, Violation};
use crate::shrink::{Effort, fewest};
use show::shell::word;
use step::Step;
use tape::Tape;

/// A program on a test bench.
trait Bench: Sync {
    /// Name of the subject.
    const NAME: &'static str;
    /// The program's input ports with their baud rates.
    const PORTS: &'static [(&'static str, u32)];

    /// The session that `choices` create.
    fn steps(&self, choices: &[u8]) -> Vec<Step>;

    /// Runs a session and judges it.
    fn judge(
        &self,
        steps: &[Step],
        behaviour: &mut Behaviour,
        tape: &mut Tape,
    ) -> Result<(), Violation>;

    /// Simpler variants of `step`, the simplest first.
    fn plainer(&self, step: &Step) -> Vec<Step>;

    /// Numbers of the active defects.
    fn defects(&self) -> &[String];
}

/// The programs that can be fuzzed, with the defects `defects`.
///
/// # Errors
/// The first of `defects` that no program has.
pub fn programs(defects: &[String]) -> Result<Vec<Box<dyn Subject>>, String> {
    let known = |id: &&String| !(base::knows(id) || rescue::knows(id) || pc::knows(id));
    if let Some(unknown) = defects.iter().find(known) {
        return Err(unknown.clone());
    }
    Ok(vec![
        Box::new(Sessions(base::Base::new(defects))),
        Box::new(Sessions(rescue::Robot::new(defects))),
        Box::new(Sessions(pc::Client::new(defects))),
    ])
}

/// Names of the programs.
pub const PROGRAMS: [&str; 3] = [base::Base::NAME, rescue::Robot::NAME, pc::Client::NAME];

/// A bench as a subject.
struct Sessions<B>(B);

const SESSION: &str = "session.txt";
const CAPTURE: &str = "capture.pcapng";

impl<B: Bench> Sessions<B> {
    fn judged(&self, steps: &[Step], tape: &mut Tape) -> Result<(), Violation> {
        caught(|| self.0.judge(steps, &mut Behaviour::default(), tape))
    }

    fn fails(&self, steps: &[Step], cause: &str) -> bool {
        let judged = self.judged(steps, &mut Tape::default());
        judged.is_err_and(|fault| fault.cause == cause)
    }

    /// Minimises to the fewest and simplest steps with the same violation.
    fn smallest(&self, steps: &[Step], cause: &str, effort: &mut Effort<'_>) -> Vec<Step> {
        let mut best = fewest(steps, effort, |left| self.fails(left, cause));
        loop {
            let before = best.clone();
            for at in 0..best.len() {
                self.make_plainer(&mut best, at, cause, effort);
            }
            if best == before {
                return best;
            }
            best = fewest(&best, effort, |left| self.fails(left, cause));
        }
    }

    fn make_plainer(&self, best: &mut [Step], at: usize, cause: &str, effort: &mut Effort<'_>) {
        loop {
            let was = best[at].clone();
            let plainer = self.0.plainer(&was);
            let taken = plainer.into_iter().filter(|step| *step != was).any(|step| {
                best[at] = step;
                effort.spend() && self.fails(best, cause)
            });
            if !taken {
                best[at] = was;
                return;
            }
        }
    }

    fn names() -> Vec<&'static str> {
        B::PORTS.iter().map(|(name, _)| *name).collect()
    }

    fn text(steps: &[Step]) -> String {
        step::to_text(steps, &Self::names())
    }
}

impl<B: Bench> Subject for Sessions<B> {
    fn name(&self) -> &str {
        B::NAME
    }

    fn round(&self) -> u64 {
        256
    }

    fn tries(&self) -> u32 {
        3000
    }

    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Violation> {
        let steps = self.0.steps(choices);
        self.0.judge(&steps, behaviour, &mut Tape::default())
    }

    fn defects(&self) -> &[String] {
        self.0.defects()
    }

    fn seeds(&self) -> Vec<Vec<u8>> {
        vec![vec![0; 8], (0..64).collect()]
    }

    fn in_words(&self, choices: &[u8]) -> String {
        Self::text(&self.0.steps(choices))
    }

    fn keep(&self, choices: &[u8], fault: &Violation, effort: &mut Effort<'_>) -> Kept {
        let small = self.smallest(&self.0.steps(choices), &fault.cause, effort);
        let mut tape = Tape::recording();
        let judged = self.judged(&small, &mut tape);
        let capture = tape.into_capture(B::PORTS);
        Kept {
            fault: judged.err().unwrap_or_else(|| fault.clone()),
            files: vec![
                (SESSION, Self::text(&small).into_bytes()),
                (CAPTURE, capture),
            ],
        }
    }

    fn case_file(&self) -> &'static str {
        SESSION
    }

    fn repeat(&self, dir: &Path) -> String {
        let mut command = format!("hilrig fuzz {}", B::NAME);
        for defect in self.0.defects() {
            command += &format!(" --defect {defect}");
        }
        command + &format!(" --repeat {}", word(&dir.join(SESSION)))
    }

    /// Choices cannot be reconstructed from a session.
    fn choices_of(&self, text: &str) -> Result<Option<Vec<u8>>, String> {
        step::parse(text, &Self::names()).map(|_| None)
    }

    fn repeated(&self, text: &str) -> Result<Result<(), Violation>, String> {
        let steps = step::parse(text, &Self::names())?;
        Ok(self.judged(&steps, &mut Tape::default()))
    }
}

#[cfg(test)]
mod tests;
