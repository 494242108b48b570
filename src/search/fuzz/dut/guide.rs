//! Traffic that is led by what a program reaches: choices that brought it somewhere new are kept
//! and changed further, as for programs of our own.

use std::collections::BTreeSet;

use emulators::rng::Rng;
use serde::{Deserialize, Serialize};

use super::case::Hex;
use super::speech::Speech;
use crate::codec::wire::Stream;
use crate::search::fuzz::engine::POOL_MAX;
use crate::search::fuzz::havoc;

/// Valid traffic to begin with.
const SEEDS: usize = 8;

/// What was learnt on one link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guide {
    /// Choices that did something new, in order.
    pool: Vec<Hex>,
    /// All that was ever reached.
    seen: BTreeSet<u32>,
}

/// Traffic of a case, and which choices made which part of it.
#[derive(Clone, Debug, Default)]
pub(super) struct Guided {
    /// The stream of the case.
    pub(super) stream: String,
    /// Choices, each with the number of pauses in its traffic, the last one behind it.
    parts: Vec<(Vec<u8>, usize)>,
}

impl Guide {
    /// Traffic of some `bytes`.
    pub(super) fn traffic(&self, speech: &Speech, bytes: f64, rng: &mut Rng) -> Guided {
        let mut pool: Vec<Vec<u8>> = self.pool.iter().map(|hex| hex.0.clone()).collect();
        if pool.is_empty() {
            pool = (0..SEEDS).filter_map(|_| speech.choices(rng)).collect();
        }
        let (mut guided, mut len) = (Guided::default(), 0);
        while (len as f64) < bytes {
            let choices = havoc::mutated(&pool, rng);
            let stream = speech.stream(&choices);
            len += stream.bytes().len().max(1);
            let text = stream.to_text() + "idle\n";
            let pauses = text.lines().filter(|line| *line == "idle").count();
            guided.stream += &text;
            guided.parts.push((choices, pauses));
        }
        guided
    }

    /// Keeps of `guided` what brought the program somewhere new; `reached` is what was reached
    /// until each of its pauses, as far as the case came.
    pub(super) fn learn(&mut self, guided: Guided, reached: &[Vec<u32>]) {
        let mut reached = reached.iter();
        for (choices, pauses) in guided.parts {
            let before = self.seen.len();
            let marks = reached.by_ref().take(pauses).flatten();
            self.seen.extend(marks);
            if self.seen.len() > before && self.pool.len() < POOL_MAX {
                self.pool.push(Hex(choices));
            }
        }
    }
}

impl Speech {
    /// Traffic that `choices` make: frames of the format if there is one, else these very bytes.
    fn stream(&self, choices: &[u8]) -> Stream {
        match self {
            Self::Frames(codec) => self.split(&(codec.target().stream)(choices)),
            Self::Text(_) | Self::Bytes => Stream::raw(choices),
        }
    }

    /// Choices that make valid traffic, if there are some that are worth a begin.
    fn choices(&self, rng: &mut Rng) -> Option<Vec<u8>> {
        let is_text = matches!(self, Self::Text(_));
        is_text.then(|| self.session(rng).bytes().to_vec())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The second part has two pauses and reaches mark 2 at the second one; the third part reaches
    /// nothing new, the fourth was not played.
    #[test]
    fn what_reached_something_new_is_kept() {
        let part = |name: u8, pauses| (vec![name], pauses);
        let guided = Guided {
            stream: String::new(),
            parts: vec![part(1, 1), part(2, 2), part(3, 1), part(4, 1)],
        };
        let mut guide = Guide::default();
        guide.learn(guided, &[vec![1], vec![1], vec![1, 2], vec![2]]);
        assert_eq!(guide.pool, [Hex(vec![1]), Hex(vec![2])]);
        assert_eq!(guide.seen, BTreeSet::from([1, 2]));
    }

    #[test]
    fn traffic_is_the_same_for_the_same_seed_and_made_of_what_is_kept() {
        let guide = Guide {
            pool: vec![Hex(vec![0xA5; 40])],
            seen: BTreeSet::new(),
        };
        let make = |seed| {
            let rng = &mut Rng::stream(seed, "test");
            guide.traffic(&Speech::Bytes, 1000.0, rng).stream
        };
        assert_eq!(make(1), make(1));
        assert_ne!(make(1), make(2));
        assert!(make(1).contains("A5 A5 A5 A5 A5 A5"));
    }
}
