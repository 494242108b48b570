//! What a program may be told, learned from captures, from files of frames, and from the
//! conversation itself.
//!
//! ```text
//!  capture, folder --+
//!                    +--> Gathered --> Seeds: requests and replies, frames, their format
//!  conversation -----+                   |
//!                                        v
//!                            Turn: what is said next, changed or not
//! ```

mod mutate;

use std::collections::BTreeSet;
use std::path::Path;

use emulators::rng::Rng;

use super::case::{Exchange, Hex, Turn, index};
use crate::learn::{Corpus, DescribedFormat, Gathered, Seeds, conversation};
use capture::Capture;
use mutate::Material;

/// What was learned of the device on a link.
#[derive(Clone, Debug)]
pub(super) struct Lesson {
    seeds: Seeds,
}

impl Lesson {
    /// What the capture at `path` and `corpus` teach of `link`, whose frames are `described` if
    /// that is given. The program is that link's master.
    pub(super) fn of(
        path: &Path,
        link: &str,
        corpus: Option<&Corpus>,
        described: Option<DescribedFormat>,
    ) -> Self {
        let mut gathered = Gathered::default();
        if let Ok(capture) = Capture::read(path) {
            gathered.conversation(&conversation(&capture, Some(link)));
        }
        if let Some(corpus) = corpus {
            corpus.teach(link, &mut gathered);
        }
        let seeds = gathered.learned(described);
        Self { seeds }
    }

    /// Whether anything was learned.
    pub(super) fn is_empty(&self) -> bool {
        let seeds = &self.seeds;
        let is_nothing = |content: &Vec<u8>| content.is_empty();
        seeds.exchanges.is_empty()
            && seeds.unasked.is_empty()
            && seeds.contents.iter().all(is_nothing)
    }

    /// The frame format, in words.
    pub(super) fn in_words(&self) -> String {
        let (requests, unasked) = (self.seeds.exchanges.len(), self.seeds.unasked.len());
        let format = self.seeds.format.in_words();
        format!("format: {format}; {requests} requests with replies, {unasked} frames unasked")
    }

    /// The requests of the program and what the device said to them.
    pub(super) fn exchanges(&self) -> Vec<Exchange> {
        let exchanges = self.seeds.exchanges.iter();
        let exchanges = exchanges.map(|(request, replies)| Exchange {
            request: Hex(request.clone()),
            reply: Hex(replies.first().cloned().unwrap_or_default()),
        });
        exchanges.collect()
    }

    /// Whether the program asks for what it is told.
    pub(super) const fn asks(&self) -> bool {
        self.seeds.asks
    }

    /// Whether the device speaks in lines of text.
    pub(super) fn is_text(&self) -> bool {
        self.seeds.format.is_text()
    }

    /// `count` turns; kinds of `avoided` are rarer.
    pub(super) fn turns(
        &self,
        count: usize,
        avoided: &BTreeSet<String>,
        rng: &mut Rng,
    ) -> Vec<Turn> {
        // In half of the cases all but one of the requests get their sound replies: what comes
        // after a greeting is not reached if that is changed.
        let requests = self.seeds.exchanges.len() as u64;
        let is_one = requests > 1 && rng.below(2) == 0;
        let one = is_one.then(|| index(rng, requests));
        let turns = (0..count).map(|_| self.turn(one, avoided, rng));
        turns.collect()
    }

    /// A turn for request `one`, or for any.
    fn turn(&self, one: Option<usize>, avoided: &BTreeSet<String>, rng: &mut Rng) -> Turn {
        let seeds = &self.seeds;
        let all = seeds.exchanges.len() + seeds.unasked.len().min(seeds.exchanges.len().max(1));
        let picked = one.unwrap_or_else(|| index(rng, all.max(1) as u64));
        let (to, chunk) = match seeds.exchanges.get(picked) {
            Some((request, replies)) => {
                let reply = &replies[index(rng, replies.len() as u64)];
                (Some(Hex(request.clone())), reply.as_slice())
            }
            None => {
                let one = index(rng, seeds.unasked.len().max(1) as u64);
                let chunk = seeds.unasked.get(one);
                (None, chunk.map_or(&[][..], Vec::as_slice))
            }
        };
        let material = Material {
            format: &*seeds.format,
            contents: &seeds.contents,
        };
        let mut mutant = mutate::mutant(&material, chunk, rng);
        // Another one in place of most that are of a kind that led to a known finding.
        if avoided.contains(mutant.kind) && rng.below(4) > 0 {
            mutant = mutate::mutant(&material, chunk, rng);
        }
        Turn {
            kind: mutant.kind.to_owned(),
            is_altered: mutant.is_altered,
            to,
            say: mutant.pieces.into_iter().map(Hex).collect(),
        }
    }
}

#[cfg(test)]
mod tests;
