//! Answers of a program in a learned format: which requests it answers, and whether it answers
//! damaged ones.

use core::time::Duration;
use std::path::Path;

use super::case::{Case, Hex, Pair, Raw, Told, quiet};
use super::harness::{Harness, HarnessError};
use super::learn::Asked;
use super::player::Halt;
use super::session::Session;
use crate::learn::likeness::{are_like, resemble};
use crate::learn::{Directions, Role};
use engine::scenario::Scenario;

/// Maximum time for an answer.
const WINDOW: Duration = Duration::from_millis(200);
/// Number of times that a frame, its damaged form and noise are sent.
const ROUNDS: usize = 3;
/// Maximum number of frames of each direction that are tried.
const TRIED: usize = 16;

impl Harness<'_> {
    /// Sends frames of both directions of `sources` to a program that sends no requests. In each
    /// source, the program answers the direction with more answers like the recorded ones, or
    /// with more answers at all. Without any answer, it gets the bytes to the master.
    pub(super) fn ask_both(
        &self,
        scenario: &Scenario,
        link: &str,
        sources: &[Directions],
        recording: &Path,
    ) -> Result<Asked, HarnessError> {
        let mut asked = Asked::default();
        let of = |is_swapped: bool| {
            let ask = |source: &Directions| match is_swapped {
                true => source.to_master.clone(),
                false => source.to_device.clone(),
            };
            sources.iter().map(ask).collect::<Vec<_>>()
        };
        let both = [of(false), of(true)];
        let mut answers = Vec::new();
        for chunks in &both {
            answers.push(self.answers_to(scenario, link, chunks, recording)?);
        }
        for at in 0..sources.len() {
            // The other direction has the recorded answers.
            let score = |side: usize| {
                let given = answers[side][at].iter().filter(|one| !one.is_empty());
                let recorded = &both[1 - side][at];
                let is_recorded = |one: &&Vec<u8>| recorded.iter().any(|of| resemble(of, one));
                (given.clone().filter(is_recorded).count(), given.count())
            };
            let (to_device, to_master) = (score(0), score(1));
            // Swapped: the program answers the bytes to the device, so its own bytes are those to
            // the master.
            let is_swapped =
                to_device > to_master || to_device == to_master && both[1][at].is_empty();
            let side = usize::from(!is_swapped);
            let pairs = both[side][at].iter().zip(&answers[side][at]);
            let given = pairs.filter(|(_, answer)| !answer.is_empty());
            let given: Vec<Vec<u8>> = given.map(|(chunk, _)| chunk.clone()).collect();
            asked.roles.push(Role {
                is_swapped,
                answers: !given.is_empty(),
            });
            asked.tried += both[side][at].len().min(TRIED);
            asked.answered.extend(given);
        }
        Ok(asked)
    }

    /// The answers of the program to some of `chunks`, which come from different sources; empty if
    /// it does not answer, or if its second answer differs from the first.
    fn answers_to(
        &self,
        scenario: &Scenario,
        link: &str,
        chunks: &[Vec<Vec<u8>>],
        recording: &Path,
    ) -> Result<Vec<Vec<Vec<u8>>>, HarnessError> {
        let mut answers = vec![Vec::new(); chunks.len()];
        if chunks.iter().all(Vec::is_empty) {
            return Ok(answers);
        }
        let raw = Raw {
            link: link.to_owned(),
            ..Raw::default()
        };
        let case = Case {
            scenario: quiet(scenario, Duration::ZERO),
            told: Told {
                raw: Some(raw),
                ..Told::default()
            },
        };
        let (mut live, opened) = Session::begin(self, &case, recording)?;
        let mut ask_all = || {
            for (chunks, answers) in chunks.iter().zip(&mut answers) {
                for chunk in chunks.iter().take(TRIED) {
                    let first = live.ask(chunk, WINDOW)?;
                    let is_again = !first.is_empty() && {
                        let second = live.ask(chunk, WINDOW)?;
                        are_like(
                            core::slice::from_ref(&first),
                            core::slice::from_ref(&second),
                        ) || resemble(&first, &second)
                    };
                    answers.push(if is_again { first } else { Vec::new() });
                }
            }
            Ok(())
        };
        let ended = opened.and_then(|()| ask_all());
        live.end(self);
        match ended {
            Err(Halt::Interrupted) => Err(HarnessError::Interrupted),
            Err(Halt::Guest(error)) => Err(error.into()),
            // A program that ended answers no more.
            _ => Ok(answers),
        }
    }
}

/// The pair whose damaged frame the program answers like the intact one, each time. Two facts show
/// that the answer is no refusal: noise in a frame gets another answer or none, and another request
/// gets another answer. The second one is left out if `raw` has one request only.
pub(super) fn taken(live: &mut Session<'_>, raw: &Raw) -> Result<Option<Pair>, Halt> {
    let is_one = |pair: &Pair| pair.good == raw.learned[0].good;
    let is_only_one = raw.learned.iter().all(is_one);
    let mut taken: Vec<(&Pair, Vec<Vec<u8>>)> = Vec::new();
    for pair in &raw.learned {
        let mut ask = |bytes: &Hex| live.ask(&bytes.0, WINDOW);
        if ask(&pair.damaged)?.is_empty() {
            continue;
        }
        let [mut noise, mut damaged, mut good] = [const { Vec::new() }; 3];
        for _ in 0..ROUNDS {
            noise.push(ask(&pair.noise)?);
            damaged.push(ask(&pair.damaged)?);
            good.push(ask(&pair.good)?);
        }
        let is_noise = |one: &Vec<u8>| are_like(&good, core::slice::from_ref(one));
        if are_like(&good, &damaged) && !noise.iter().any(is_noise) {
            let other = taken.iter().find(|(_, other)| !are_like(other, &good));
            if is_only_one || other.is_some() {
                return Ok(Some(pair.clone()));
            }
            taken.push((pair, good));
        }
    }
    Ok(None)
}
