//! Messages, and inputs of several messages: the units that coverage guidance mutates. A message is
//! a line, a frame or a few bytes. A mutation usually keeps the end of a line and the checksum of a
//! frame.

use emulators::rng::Rng;
use serde::{Deserialize, Serialize};

use super::case::{Hex, index};
use super::speech::Speech;
use crate::fuzz::havoc;

/// Maximum length of a message.
const LEN_MAX: usize = 512;
/// Maximum number of messages of an input.
const MESSAGES_MAX: usize = 8;
/// Separators between the words of lines.
const SEPARATORS: &[u8] = b"  =,;:/";
/// Maximum number of bytes of a message of unknown format.
const BYTES_MAX: u64 = 32;

/// The messages between two pauses, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Input(pub(super) Vec<Hex>);

/// The material of inputs, in addition to random bytes.
pub(super) struct Stock<'a> {
    /// Useful messages, without their ends; not empty.
    pub(super) bodies: &'a [Vec<u8>],
    /// Words with which the program compares its input.
    pub(super) words: &'a [Hex],
}

impl Input {
    /// Number of bytes of all messages.
    pub(super) fn size(&self) -> usize {
        self.0.iter().map(|message| message.0.len()).sum()
    }

    /// The last messages of `before`, followed by this input.
    pub(super) fn after(&self, before: &[Hex]) -> Self {
        let most = MESSAGES_MAX.saturating_sub(self.0.len());
        let before = &before[before.len().saturating_sub(most)..];
        Self([before, &self.0].concat())
    }

    /// This input with `message` at index `at`.
    pub(super) fn with(&self, at: usize, message: Vec<u8>) -> Self {
        let mut new = self.clone();
        new.0[at] = Hex(message);
        new
    }

    /// Mutates the input slightly.
    pub(super) fn mutate(&mut self, speech: &Speech, stock: &Stock<'_>, rng: &mut Rng) {
        let len = self.0.len();
        let at = match rng.below(2) {
            0 => len.saturating_sub(1),
            _ => index(rng, len.max(1) as u64),
        };
        match rng.below(16) {
            _ if len == 0 => self.0.push(Hex(speech.message(rng))),
            0 if len < MESSAGES_MAX => self.0.push(Hex(speech.message(rng))),
            1 if len < MESSAGES_MAX => {
                let body = &stock.bodies[index(rng, stock.bodies.len() as u64)];
                self.0.push(Hex(speech.finished(body.clone(), rng)));
            }
            2 if len < MESSAGES_MAX => self.0.insert(at, self.0[at].clone()),
            3 if len > 1 => drop(self.0.remove(at)),
            4 if len > 1 => self.0.swap(at, (at + 1) % len),
            5..8 if !stock.words.is_empty() => {
                let word = &stock.words[index(rng, stock.words.len() as u64)].0;
                let mut body = speech.body(&self.0[at].0).to_vec();
                let from = index(rng, body.len() as u64 + 1);
                let to = match rng.below(2) {
                    0 => from,
                    _ => (from + word.len()).min(body.len()),
                };
                body.splice(from..to, word.iter().copied());
                self.0[at] = Hex(speech.finished(body, rng));
            }
            8..10 if matches!(speech, Speech::Text(_)) => {
                let mut body = speech.body(&self.0[at].0).to_vec();
                body.push(SEPARATORS[index(rng, SEPARATORS.len() as u64)]);
                match stock.words {
                    [] => body.extend(rng.below(100).to_string().bytes()),
                    words => body.extend(&words[index(rng, words.len() as u64)].0),
                }
                self.0[at] = Hex(speech.finished(body, rng));
            }
            _ => {
                let mut body = speech.body(&self.0[at].0).to_vec();
                havoc::mutate(&mut body, stock.bodies, rng);
                self.0[at] = Hex(speech.finished(body, rng));
            }
        }
    }
}

impl Speech {
    /// A message as the device or its master sends it.
    pub(super) fn message(&self, rng: &mut Rng) -> Vec<u8> {
        let text = match self {
            Self::Frames(_) => self.frame(rng).unwrap_or_default(),
            Self::Text(text) => [text.line(rng).as_bytes(), text.terminator()].concat(),
            Self::Bytes => {
                let len = 1 + rng.below(BYTES_MAX);
                let byte = |_| rng.next_u64().to_be_bytes()[0];
                (0..len).map(byte).collect()
            }
        };
        shortened(text)
    }

    /// A message without its end or checksum.
    pub(super) fn body<'a>(&self, message: &'a [u8]) -> &'a [u8] {
        match self {
            Self::Text(text) => message.strip_suffix(text.terminator()).unwrap_or(message),
            Self::Frames(_) | Self::Bytes => message,
        }
    }

    /// A message with its end and a correct checksum.
    fn whole(&self, body: Vec<u8>) -> Vec<u8> {
        let mut message = shortened(body);
        match self {
            Self::Frames(codec) => codec.repair(&mut message),
            Self::Text(text) => message.extend(text.terminator()),
            Self::Bytes => {}
        }
        message
    }

    /// A frame with a corrected checksum, if it was wrong.
    pub(super) fn mended(&self, message: &[u8]) -> Option<Vec<u8>> {
        let is_frame = matches!(self, Self::Frames(_));
        let mended = is_frame.then(|| self.whole(message.to_vec()));
        mended.filter(|mended| mended != message)
    }

    /// Like `whole`, but sometimes a frame is damaged or a line truncated.
    fn finished(&self, body: Vec<u8>, rng: &mut Rng) -> Vec<u8> {
        match rng.below(12) {
            0 => shortened(body),
            _ => self.whole(body),
        }
    }
}

fn shortened(mut message: Vec<u8>) -> Vec<u8> {
    message.truncate(LEN_MAX);
    message
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::codec;

    fn bus() -> Speech {
        Speech::of_codec(Some(&codec::BUS))
    }

    /// The sum of AB 05 02 is B2.
    #[test]
    fn a_frame_that_is_changed_keeps_its_checksum() {
        let changed = vec![0xAB, 0x05, 0x02, 0xB1, 0x00];
        assert_eq!(bus().whole(changed), [0xAB, 0x05, 0x02, 0xB2, 0x00]);
    }

    #[test]
    fn inputs_stay_short_and_are_the_same_for_the_same_seed() {
        let bodies = [vec![7; LEN_MAX]];
        let words = [Hex(b"selftest".to_vec())];
        let stock = Stock {
            bodies: &bodies,
            words: &words,
        };
        for speech in [bus(), Speech::Bytes] {
            let make = |seed| {
                let (mut input, rng) = (Input::default(), &mut Rng::stream(seed, "test"));
                for _ in 0..300 {
                    input.mutate(&speech, &stock, rng);
                    assert!((1..=MESSAGES_MAX).contains(&input.0.len()));
                    assert!(input.size() <= MESSAGES_MAX * LEN_MAX);
                }
                input
            };
            assert_eq!(make(1), make(1));
            assert_ne!(make(1), make(2));
        }
    }

    /// Of ten preceding messages the last ones are kept, as far as there is room.
    #[test]
    fn an_input_takes_the_last_messages_before_it() {
        let before: Vec<Hex> = (0..10).map(|name| Hex(vec![name])).collect();
        let input = Input(vec![Hex(vec![99])]).after(&before);
        assert_eq!(input.0.len(), MESSAGES_MAX);
        assert_eq!(input.0[0], Hex(vec![3]));
        assert_eq!(input.0[7], Hex(vec![99]));
    }
}
