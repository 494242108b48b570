//! Traffic that is guided by the coverage and the comparisons of a program.
//!
//! For each location the shortest input that reaches it is kept and mutated further, rare locations
//! first. An input with new coverage is sent again, with one side of each comparison replaced by
//! the other side.

use std::collections::{BTreeMap, BTreeSet};

use emulators::rng::Rng;
use serde::{Deserialize, Serialize};

use super::case::{Hex, index};
use super::compare::Comparison;
use super::coverage::{Reached, SIZES};
use super::message::{Input, Stock};
use super::speech::Speech;
use engine::codec::wire::Stream;

/// Number of initial messages.
const SEEDS: usize = 16;
/// Number of preceding messages that are kept with an input: they may have set the state of the
/// program.
const BEFORE: usize = 3;
/// Maximum number of queued inputs.
const DUE_MAX: usize = 2048;
/// Maximum number of inputs that one input adds.
const ADDED_MAX: usize = 512;
/// Number of times that comparisons at one location are used, in addition to those of inputs with
/// new coverage.
const ANSWERED_MAX: u8 = 8;
/// Afterwards, only the last comparison of an input creates variants: at most `STUCK_MAX`, while
/// fewer than `STUCK_DUE_MAX` inputs are queued and the input has fewer than `DEPTH_MAX`
/// replacements. This is required if a checksum must be corrected after each change.
const STUCK_MAX: usize = 1;
const STUCK_DUE_MAX: usize = 256;
const DEPTH_MAX: u8 = 4;
/// Number of times that comparisons of numbers at one location are used for one input: a loop
/// compares each byte with the same number.
const ALIKE_MAX: u8 = 2;
/// Number of bytes by which an input from a new location may be longer.
const NEW_BYTES: u64 = 64;
/// Number of bytes by which an input may be longer for each case that it has waited: short inputs
/// come first, but every input gets its turn.
const WAIT_BYTES: u64 = 4;
/// Maximum number of inputs per case: coverage is evaluated between cases.
const PARTS_MAX: usize = 200;
/// Maximum number of stored words, and of locations with counted comparisons.
const WORDS_MAX: usize = 256;
const PLACES_MAX: usize = 1 << 16;
/// Number of marks from which the rarest is selected.
const LOOKS: usize = 3;

/// The knowledge about one link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guide {
    /// Inputs that are the shortest for some mark, by age.
    pool: BTreeMap<u64, Input>,
    /// The age of the next input.
    next: u64,
    /// All marks that were reached: the input, and the number of times.
    marks: BTreeMap<u32, (u64, u64)>,
    /// Number of cases so far.
    cases: u64,
    /// Queued inputs in order.
    due: Vec<Due>,
    /// Texts with which the program compared its input.
    words: Vec<Hex>,
    /// Number of used comparisons per location.
    answered: BTreeMap<u32, u8>,
}

/// A queued input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Due {
    input: Input,
    /// Number of replacements since the last random mutation.
    depth: u8,
    /// Inputs with the lowest rank come first.
    rank: u64,
}

/// The traffic of a case, and its inputs.
#[derive(Clone, Debug, Default)]
pub(super) struct Guided {
    /// The stream of the case.
    pub(super) stream: String,
    /// The inputs, each followed by a pause, and whether each was queued.
    parts: Vec<(Due, bool)>,
}

impl Guide {
    /// Creates traffic of about `bytes` bytes.
    pub(super) fn traffic(&self, speech: &Speech, bytes: f64, rng: &mut Rng) -> Guided {
        let mut bodies: Vec<Vec<u8>> = Vec::new();
        for message in self.pool.values().flat_map(|input| &input.0) {
            bodies.push(speech.body(&message.0).to_vec());
        }
        if bodies.is_empty() {
            bodies.extend((0..SEEDS).map(|_| speech.body(&speech.message(rng)).to_vec()));
        }
        let (bodies, words) = (&bodies, &self.words);
        let stock = Stock { bodies, words };
        let (mut guided, mut len, mut due) = (Guided::default(), 0, self.due.iter());
        while (len as f64) < bytes && guided.parts.len() < PARTS_MAX {
            // A random input may bring the program into the state that the others need.
            let next = (rng.below(4) > 0).then(|| due.next()).flatten();
            let part = match next {
                Some(due) => (due.clone(), true),
                None => {
                    let input = self.made(speech, &stock, rng);
                    (self.due(input, 0), false)
                }
            };
            len += part.0.input.size().max(1);
            for message in &part.0.input.0 {
                guided.stream += &Stream::raw(&message.0).to_text();
            }
            guided.stream += "idle\n";
            guided.parts.push(part);
        }
        guided
    }

    /// An input mutated from a stored one, or created from nothing.
    fn made(&self, speech: &Speech, stock: &Stock<'_>, rng: &mut Rng) -> Input {
        let mut input = match rng.below(16) {
            0 => Input::default(),
            _ => self.picked(rng),
        };
        for _ in 0..1_u64 << rng.below(4) {
            input.mutate(speech, stock, rng);
        }
        input
    }

    /// The input of the rarest of a few random marks.
    fn picked(&self, rng: &mut Rng) -> Input {
        let Some(last) = (self.marks.len() as u64).checked_sub(1) else {
            return Input::default();
        };
        let mark = |_| self.marks.values().nth(index(rng, last + 1));
        let rarest = (0..LOOKS).filter_map(mark).min_by_key(|(_, count)| *count);
        let input = rarest.and_then(|(by, _)| self.pool.get(by));
        input.cloned().unwrap_or_default()
    }

    /// Evaluates `guided`. `reached` holds the activity up to each pause, as far as the case came.
    /// `is_end` says that the case ended early: then the last part is the cause and is not sent
    /// again, because it would hide the parts behind it.
    pub(super) fn learn(
        &mut self,
        speech: &Speech,
        guided: Guided,
        reached: &[Reached],
        is_end: bool,
    ) {
        let played = reached.len().min(guided.parts.len());
        let parts = &guided.parts[..played];
        let due = parts.iter().filter(|(_, was_due)| *was_due).count();
        self.due.drain(..due.min(self.due.len()));
        let mut before: Vec<Hex> = Vec::new();
        self.cases += 1;
        for (at, ((part, _), reached)) in parts.iter().zip(reached).enumerate() {
            if is_end && at + 1 == played {
                break;
            }
            let is_new = self.keep(&part.input, &before, &reached.marks);
            let depth = if is_new { 0 } else { part.depth };
            let part = self.due(part.input.clone(), depth);
            if is_new && !before.is_empty() {
                self.due.push(part.clone());
            }
            for other in self.answers(speech, &part, is_new, &reached.compared) {
                // Also queued behind the preceding messages: the program may need the state that
                // they set.
                if !before.is_empty() {
                    let input = other.input.after(&before);
                    let rank = other.rank + (input.size() - other.input.size()) as u64;
                    self.due.push(Due {
                        input,
                        rank,
                        ..other
                    });
                }
                self.due.push(other);
            }
            before.extend(part.input.0);
            before.drain(..before.len().saturating_sub(BEFORE));
        }
        self.due.sort_by_key(|due| due.rank);
        self.due.truncate(DUE_MAX);
    }

    /// Queues `input` at its rank.
    fn due(&self, input: Input, depth: u8) -> Due {
        let rank = self.cases * WAIT_BYTES + input.size() as u64;
        Due { input, depth, rank }
    }

    /// Keeps `input` if it reaches a new location, a new count, or a known one with fewer bytes.
    /// Returns whether a location is new; then the preceding messages are kept too.
    fn keep(&mut self, input: &Input, before: &[Hex], marks: &[u32]) -> bool {
        let is_known = |mark: &u32| {
            let place = mark / SIZES * SIZES;
            self.marks.range(place..place + SIZES).next().is_some()
        };
        let is_new = !marks.iter().all(is_known);
        let whole = if is_new {
            input.after(before)
        } else {
            input.clone()
        };
        let (id, mut is_used) = (self.next, false);
        for mark in marks {
            let known = self.marks.get(mark).map(|(by, _)| *by);
            let size = known.and_then(|by| self.pool.get(&by)).map(Input::size);
            let is_won = size.is_none_or(|size| whole.size() < size);
            let (by, count) = self.marks.entry(*mark).or_insert((id, 0));
            *count += 1;
            if is_won {
                (*by, is_used) = (id, true);
            }
        }
        if is_used {
            self.pool.insert(id, whole);
            self.next += 1;
            let needed: BTreeSet<u64> = self.marks.values().map(|(by, _)| *by).collect();
            self.pool.retain(|id, _| needed.contains(id));
        }
        is_new
    }

    /// Variants of `part` that change the results of comparisons.
    fn answers(
        &mut self,
        speech: &Speech,
        part: &Due,
        is_new: bool,
        compared: &[Comparison],
    ) -> Vec<Due> {
        let (mut made, mut alike) = (Vec::new(), BTreeMap::new());
        let is_free = self.due.len() < STUCK_DUE_MAX && part.depth < DEPTH_MAX;
        for (at, comparison) in compared.iter().enumerate() {
            let is_last = at + 1 == compared.len() && is_free;
            let alike: &mut u8 = alike.entry(comparison.place).or_default();
            *alike = alike.saturating_add(1);
            if *alike > ALIKE_MAX && !comparison.is_of_texts() && !is_last {
                continue;
            }
            let most = match self.counts(comparison.place) {
                is_few if is_new || is_few == Some(true) => usize::MAX,
                _ if is_last => STUCK_MAX,
                _ => continue,
            };
            let messages = part.input.0.iter().enumerate();
            let others = messages.flat_map(|(at, message)| {
                let others = comparison.instead(&message.0).into_iter();
                others.map(move |other| (at, other))
            });
            for (at, other) in others.take(most) {
                made.extend(
                    speech
                        .mended(&other)
                        .map(|other| part.input.with(at, other)),
                );
                made.push(part.input.with(at, other));
            }
            self.learn_words(comparison, &part.input);
        }
        let mut known = BTreeSet::new();
        made.retain(|input| known.insert(input.clone()));
        made.truncate(ADDED_MAX);
        let depth = part.depth.saturating_add(1);
        let mut made: Vec<Due> = made
            .into_iter()
            .map(|input| self.due(input, depth))
            .collect();
        for due in made.iter_mut().filter(|_| is_new) {
            due.rank = due.rank.saturating_sub(NEW_BYTES);
        }
        made
    }

    /// Counts a comparison at this location. Returns whether there were few so far; `None` if there
    /// is no room.
    fn counts(&mut self, place: u32) -> Option<bool> {
        let is_known = self.answered.contains_key(&place);
        if !is_known && self.answered.len() >= PLACES_MAX {
            return None;
        }
        let answered = self.answered.entry(place).or_insert(0);
        let is_one_of_few = *answered < ANSWERED_MAX;
        *answered = answered.saturating_add(1);
        Some(is_one_of_few)
    }

    fn learn_words(&mut self, comparison: &Comparison, input: &Input) {
        let messages: Vec<&[u8]> = input.0.iter().map(|message| &*message.0).collect();
        for word in comparison.words(&messages) {
            let word = Hex(word.to_vec());
            if self.words.len() < WORDS_MAX && !self.words.contains(&word) {
                self.words.push(word);
            }
        }
    }
}

#[cfg(test)]
mod tests;
