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
use std::sync::Arc;

use description::{Description, From, TextChange};
use emulators::rng::Rng;

use super::case::{Exchange, Hex, Pair, Turn, index};
use super::constants::Constants;
use super::speech;
use crate::learn::{DescribedFormat, FrameFormat, Gathered, Role, Seeds};
use mutate::Material;

/// The frames that a program answers, and its role in each capture of a corpus.
#[derive(Clone, Debug, Default)]
pub(super) struct Asked {
    pub(super) answered: Vec<Vec<u8>>,
    pub(super) roles: Vec<Role>,
    /// Number of frames that were tried.
    pub(super) tried: usize,
}

/// One turn in this many is the reply of another request.
const OTHERS_ONE_IN: u64 = 16;

/// Number of different changes of a reply.
const CHANGES: u64 = 1 << 32;

/// Seeds from this one on are numbers of texts at their limits.
const TEXTS_FROM: u32 = u32::MAX - 0xFF;
/// Number of turns with such a text for each request of a conversation.
const TEXTS: u64 = 3;
/// Maximum number of unsolicited frames with such texts in a conversation.
const TEXT_FRAMES_MAX: usize = 2;
/// Maximum number of attempts to change a frame so that its checksum is wrong.
const NOISE_TRIES: usize = 8;

/// The knowledge about the device on a link.
#[derive(Clone, Debug)]
pub(super) struct Lesson {
    seeds: Seeds,
    /// The descriptions of the devices on the wire.
    described: Vec<Arc<Description>>,
    constants: Constants,
    /// The contents of known requests with those of their first replies.
    contents: Vec<(Vec<u8>, Vec<u8>)>,
    asked: Asked,
}

impl Lesson {
    /// Learns from `gathered`; `described` are the devices on the wire, if they are known. The
    /// program has these constants, and answers the requests of `asked`.
    pub(super) fn of(
        gathered: Gathered,
        asked: Asked,
        described: Vec<Arc<Description>>,
        constants: Constants,
    ) -> Self {
        let from = match asked.answered.is_empty() {
            true => From::Device,
            false => From::Host,
        };
        let seeds = gathered.learned(DescribedFormat::of_wire(&described, from));
        Self {
            asked,
            ..Self::with(seeds, described, constants)
        }
    }

    pub(super) fn with(
        seeds: Seeds,
        described: Vec<Arc<Description>>,
        constants: Constants,
    ) -> Self {
        let exchanges = seeds.exchanges.iter();
        let contents = exchanges.filter_map(|(request, replies)| {
            let reply = seeds.format.content(replies.first()?)?;
            Some((content_of(&*seeds.format, request), reply))
        });
        Self {
            contents: contents.collect(),
            seeds,
            described,
            constants,
            asked: Asked::default(),
        }
    }

    /// Number of frames that the program answers, and of those that were tried.
    pub(super) const fn answered(&self) -> (usize, usize) {
        (self.asked.answered.len(), self.asked.tried)
    }

    /// Pairs of intact and damaged requests that the program answers, at most `count`.
    pub(super) fn pairs(&self, count: usize, rng: &mut Rng) -> Vec<Pair> {
        let answered = &self.asked.answered;
        let first = index(rng, answered.len().max(1) as u64);
        let frames = answered.iter().cycle().skip(first).take(answered.len());
        let pairs = frames.filter_map(|frame| {
            let seed = u32::try_from(rng.below(CHANGES)).unwrap_or_default();
            Some(Pair {
                damaged: Hex(self.damaged(seed, frame)?),
                noise: Hex(self.noise(frame, rng)?),
                good: Hex(frame.clone()),
            })
        });
        pairs.take(count).collect()
    }

    /// `frame` with a wrong checksum and another content. Bytes that are the same in all answered
    /// frames of its length stay, such as a length; without such frames the first byte stays.
    fn noise(&self, frame: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
        let format = &*self.seeds.format;
        let content = format.content(frame)?;
        let others = self.asked.answered.iter();
        let others = others.filter_map(|other| format.content(other));
        let others: Vec<_> = { others }
            .filter(|one| one.len() == content.len())
            .collect();
        let is_same = |at: usize| others.iter().all(|other| other[at] == content[at]);
        let mut varies: Vec<usize> = (0..content.len()).filter(|at| !is_same(*at)).collect();
        if varies.is_empty() {
            varies = (1..content.len()).collect();
        }
        (0..NOISE_TRIES).find_map(|_| {
            let mut content = content.clone();
            for at in &varies {
                content[*at] = match format.is_text() {
                    true => b'a' + u8::try_from(rng.below(26)).unwrap_or_default(),
                    false => u8::try_from(rng.below(256)).unwrap_or_default(),
                };
            }
            format.repair_lengths(&mut content);
            let noise = format.frame(&content, 1);
            format.is_damaged(&noise).then_some(noise)
        })
    }

    /// The descriptions of the devices on the wire.
    pub(super) fn described(&self) -> &[Arc<Description>] {
        &self.described
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
        let (answered, tried) = self.answered();
        let roles = &self.asked.roles;
        let is_swapped = roles.iter().any(|role| role.is_swapped && !role.answers);
        let role = match () {
            () if answered > 0 => format!(
                "; the program answers {answered} of {tried} frames, so it is taken as the device"
            ),
            () if is_swapped => "; the directions of the corpus are swapped: the program sends \
                                 its bytes to the master"
                .to_owned(),
            () if tried > 0 => format!("; the program answers none of {tried} frames"),
            () => String::new(),
        };
        format!(
            "format: {format}; {requests} requests with replies, {unasked} frames unasked{role}"
        )
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
        rng: &mut Rng,
    ) -> Vec<Turn> {
        // In half of the cases all requests but one get intact replies. Otherwise a changed
        // greeting would prevent the program from continuing.
        let requests = self.seeds.exchanges.len() as u64;
        let is_one = requests > 1 && rng.below(2) == 0;
        let one = is_one.then(|| index(rng, requests));
        let turns = (0..count).map(|_| self.turn(one, avoided, rng));
        turns.collect()
    }

    /// Creates a turn for the request `one`, or for any request.
    fn turn(&self, one: Option<usize>, avoided: &BTreeSet<String>, rng: &mut Rng) -> Turn {
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
        if to.is_some() && requests > 1 && rng.below(OTHERS_ONE_IN) == 0 {
            return self.reply_of_another(to, rng);
        }
        let mut seed = || u32::try_from(rng.below(CHANGES)).unwrap_or_default();
        let mut turn = self.changed(seed(), chunk);
        // Usually replaces a mutant whose kind has led to a known finding.
        if avoided.contains(&turn.kind) && seed() % 4 > 0 {
            turn = self.changed(seed(), chunk);
        }
        Turn { to, ..turn }
    }

    /// Creates turns with texts at their limits, other ones in each conversation: a few for each
    /// request and frame with a text. Most drivers read a text once, at their start.
    pub(super) fn text_turns(&self, conversation: u64, avoided: &BTreeSet<String>) -> Vec<Turn> {
        // Where a text has led to a finding, others most likely lead to the same one.
        let is_known = TextChange::KINDS.iter().any(|kind| avoided.contains(*kind));
        if is_known && !conversation.is_multiple_of(4) {
            return Vec::new();
        }
        let seeds = &self.seeds;
        let replies = seeds.exchanges.iter();
        let replies = replies.filter_map(|(request, replies)| {
            let reply = replies.iter().find(|reply| self.has_text(reply))?;
            Some((Some(Hex(request.clone())), reply))
        });
        let unasked = seeds.unasked.iter().filter(|frame| self.has_text(frame));
        let unasked = unasked.take(TEXT_FRAMES_MAX).map(|frame| (None, frame));
        let mut turns = Vec::new();
        for (to, chunk) in replies.chain(unasked) {
            let numbers = (0..TEXTS).map(|at| conversation * TEXTS + at);
            for number in numbers {
                let number = u32::try_from(number % 0x100).unwrap_or_default();
                let turn = self.changed(TEXTS_FROM + number, chunk);
                turns.push(Turn {
                    to: to.clone(),
                    ..turn
                });
            }
        }
        turns
    }

    fn has_text(&self, chunk: &[u8]) -> bool {
        let format = &*self.seeds.format;
        let mut frames = format.split(chunk).into_iter();
        frames.any(|frame| {
            let content = format.content(frame);
            content.is_some_and(|content| !format.texts(&content).is_empty())
        })
    }

    /// The change with this seed of `chunk`.
    pub(super) fn changed(&self, seed: u32, chunk: &[u8]) -> Turn {
        let material = Material {
            format: &*self.seeds.format,
            contents: &self.seeds.contents,
            constants: &self.constants,
        };
        let number = seed.checked_sub(TEXTS_FROM);
        let text = number.and_then(|number| mutate::text_at_limit(&material, chunk, number));
        let mutant = text.unwrap_or_else(|| {
            mutate::mutant(&material, chunk, &mut Rng::stream(seed.into(), "turn"))
        });
        Turn {
            kind: mutant.kind.to_owned(),
            is_altered: mutant.is_altered,
            to: None,
            say: mutant.pieces.into_iter().map(Hex).collect(),
            seed: Some(seed),
        }
    }

    /// The reply to `request`, made from the reply to a known request, if both requests differ only
    /// in bytes that replies repeat, as in a counter.
    pub(super) fn fitted(&self, request: &[u8]) -> Option<Vec<u8>> {
        let content = content_of(&*self.seeds.format, request);
        let made = self.contents.iter().find_map(|known| {
            let places = self.places(&known.0, &content)?;
            let mut reply = known.1.clone();
            for (from, to) in places {
                *reply.get_mut(to)? = content[from];
            }
            Some(reply)
        });
        made.map(|reply| self.seeds.format.frame(&reply, 0))
    }

    /// `reply` with a wrong checksum in each of its frames; `None` if it has none, or if that is
    /// not certain.
    pub(super) fn damaged(&self, seed: u32, reply: &[u8]) -> Option<Vec<u8>> {
        let format = &*self.seeds.format;
        let frames = format.split(reply);
        let mut rng = Rng::stream(seed.into(), "damage");
        let is_bit = rng.below(2) == 0;
        let mut damaged = |frame: &[u8]| {
            let spoilt = format.frame(&format.content(frame)?, 1);
            // Only the bytes of the checksum differ.
            let pairs = frame.iter().zip(&spoilt).enumerate();
            let places = pairs.filter(|(_, (one, other))| one != other);
            let places: Vec<usize> = places.map(|(at, _)| at).collect();
            let at = places.get(index(&mut rng, places.len().max(1) as u64));
            let (bit, mut flipped) = (rng.below(8), frame.to_vec());
            if let Some(at) = at.filter(|_| is_bit && frame.len() == spoilt.len()) {
                flipped[*at] = speech::with_bit(frame, *at, bit);
            }
            let mut all = [flipped, spoilt].into_iter();
            all.find(|one| format.is_damaged(one))
        };
        let frames: Option<Vec<_>> = frames.into_iter().map(&mut damaged).collect();
        frames
            .map(|frames| frames.concat())
            .filter(|all| !all.is_empty())
    }

    /// The recorded requests whose replies have a checksum.
    pub(super) fn damageable(&self) -> Vec<Hex> {
        let exchanges = self.seeds.exchanges.iter();
        let replied = exchanges.filter_map(|(request, replies)| {
            self.damaged(0, replies.first()?)?;
            Some(Hex(request.clone()))
        });
        replied.collect()
    }

    /// Whether `request` is one like `known`, with another counter.
    pub(super) fn is_like(&self, known: &[u8], request: &[u8]) -> bool {
        let [known, request] = [known, request].map(|frame| content_of(&*self.seeds.format, frame));
        self.places(&known, &request).is_some()
    }

    /// The positions at which two contents of requests differ, each with the position in the reply
    /// that repeats it.
    fn places(&self, known: &[u8], content: &[u8]) -> Option<Vec<(usize, usize)>> {
        if known.len() != content.len() {
            return None;
        }
        let (_, reply) = self.contents.iter().find(|one| one.0 == known)?;
        let sizes = (known.len(), reply.len());
        let differs = |at: &usize| known[*at] != content[*at];
        let mut places = Vec::new();
        for at in (0..known.len()).filter(differs) {
            let all: Vec<usize> = (0..reply.len())
                .filter(|to| self.repeats(at, *to, sizes))
                .collect();
            if all.is_empty() {
                return None;
            }
            places.extend(all.into_iter().map(|to| (at, to)));
        }
        Some(places)
    }

    /// Whether byte `to` of the replies repeats byte `from` of the requests, or the rest of a
    /// number whose other bytes do.
    fn repeats(&self, from: usize, to: usize, sizes: (usize, usize)) -> bool {
        let values = |from: usize, to: usize| self.repeated(from, to, sizes);
        let near = || {
            let before = from.checked_sub(1).zip(to.checked_sub(1));
            let near = [before, Some((from + 1, to + 1))];
            { near.into_iter().flatten() }.any(|(from, to)| values(from, to) > 1)
        };
        match values(from, to) {
            0 => false,
            1 => near(),
            _ => true,
        }
    }

    /// The number of different values of byte `from` of the requests, if byte `to` of the replies
    /// always equals it, else 0. Only contents of these sizes count, if they have several values.
    fn repeated(&self, from: usize, to: usize, sizes: (usize, usize)) -> usize {
        let count = |is_of: &dyn Fn(&[u8], &[u8]) -> bool| {
            let mut values = BTreeSet::new();
            let contents = self.contents.iter();
            for (request, reply) in contents.filter(|(request, reply)| is_of(request, reply)) {
                match (request.get(from), reply.get(to)) {
                    (Some(one), Some(other)) if one == other => values.insert(*one),
                    _ => return 0,
                };
            }
            values.len()
        };
        match count(&|request, reply| (request.len(), reply.len()) == sizes) {
            1 => count(&|_, _| true).max(1),
            own => own,
        }
    }
}

/// The content of a request; the request itself if replies have another format.
fn content_of(format: &dyn FrameFormat, request: &[u8]) -> Vec<u8> {
    format.content(request).unwrap_or_else(|| request.to_vec())
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
            seed: None,
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
