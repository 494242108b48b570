//! Inputs learned from captures, from files of frames, and from the conversation itself.
//!
//! ```text
//!  capture, folder --+
//!                    +--> Gathered --> Seeds: requests and replies, frames, their format
//!  conversation -----+                   |
//!                                        v
//!                            Turn: the next data, changed or not
//! ```

mod mutate;

use std::collections::BTreeSet;
use std::path::Path;

use emulators::rng::Rng;

use super::case::{Exchange, Hex, Turn, index};
use super::constants::Constants;
use crate::learn::{Corpus, DescribedFormat, FrameFormat, Gathered, Seeds, conversation};
use capture::Capture;
use mutate::Material;

/// One turn in this many is the reply of another request.
const OTHERS_ONE_IN: u64 = 16;

/// The knowledge about the device on a link.
#[derive(Clone, Debug)]
pub(super) struct Lesson {
    seeds: Seeds,
}

impl Lesson {
    /// Learns from the capture at `path` and from `corpus` about `link`; `described` gives the
    /// frame format if it is known. The program is the master of the link.
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

    /// The requests of the program with the replies of the device.
    pub(super) fn exchanges(&self) -> Vec<Exchange> {
        let exchanges = self.seeds.exchanges.iter();
        let exchanges = exchanges.map(|(request, replies)| Exchange {
            request: Hex(request.clone()),
            reply: Hex(replies.first().cloned().unwrap_or_default()),
        });
        exchanges.collect()
    }

    /// Whether the program sends requests.
    pub(super) const fn asks(&self) -> bool {
        self.seeds.asks
    }

    /// Whether the device sends lines of text.
    pub(super) fn is_text(&self) -> bool {
        self.seeds.format.is_text()
    }

    /// Creates `count` turns; kinds in `avoided` are used less often.
    pub(super) fn turns(
        &self,
        count: usize,
        avoided: &BTreeSet<String>,
        constants: &Constants,
        rng: &mut Rng,
    ) -> Vec<Turn> {
        // In half of the cases all requests but one get intact replies. Otherwise a changed
        // greeting would prevent the program from continuing.
        let requests = self.seeds.exchanges.len() as u64;
        let is_one = requests > 1 && rng.below(2) == 0;
        let one = is_one.then(|| index(rng, requests));
        let turns = (0..count).map(|_| self.turn(one, avoided, constants, rng));
        turns.collect()
    }

    /// Creates a turn for the request `one`, or for any request.
    fn turn(
        &self,
        one: Option<usize>,
        avoided: &BTreeSet<String>,
        constants: &Constants,
        rng: &mut Rng,
    ) -> Turn {
        let seeds = &self.seeds;
        let requests = seeds.exchanges.len();
        let all = requests + seeds.unasked.len().min(requests.max(1));
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
            constants,
        };
        if to.is_some() && requests > 1 && rng.below(OTHERS_ONE_IN) == 0 {
            return self.reply_of_another(to, rng);
        }
        let mut mutant = mutate::mutant(&material, chunk, rng);
        // Usually replaces a mutant whose kind has led to a known finding.
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

impl Lesson {
    /// An intact reply that answers another request than `to`.
    fn reply_of_another(&self, to: Option<Hex>, rng: &mut Rng) -> Turn {
        let exchanges = &self.seeds.exchanges;
        let others = exchanges
            .iter()
            .filter(|one| Some(&one.0) != to.as_ref().map(|to| &to.0));
        let others: Vec<&Vec<Vec<u8>>> = others.map(|(_, replies)| replies).collect();
        let replies = others[index(rng, others.len() as u64)];
        let reply = replies[index(rng, replies.len() as u64)].clone();
        Turn {
            kind: "reply-of-another-request".to_owned(),
            is_altered: true,
            to,
            say: vec![Hex(reply)],
        }
    }
}

/// A change of `chunk`, which holds frames of `format`: its kind and the pieces to send.
pub(super) fn mutant(
    format: &dyn FrameFormat,
    contents: &[Vec<u8>],
    chunk: &[u8],
    rng: &mut Rng,
) -> (&'static str, Vec<Vec<u8>>) {
    let constants = &Constants::default();
    let material = Material {
        format,
        contents,
        constants,
    };
    let mutant = mutate::mutant(&material, chunk, rng);
    (mutant.kind, mutant.pieces)
}

#[cfg(test)]
mod tests;
