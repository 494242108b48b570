//! Inputs for a device: requests of its description, intact, changed or damaged.

use std::sync::Arc;

use description::Description;
use emulators::rng::Rng;

use super::super::case::index;
use super::super::learn;
use crate::learn::{DescribedFormat, FrameFormat as _};

/// The kind of an unchanged request.
const REQUEST: &str = "request";

/// Bytes for a device, which a pause ends.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Input {
    /// The kind of change.
    pub(super) kind: String,
    /// Pieces with short pauses between them.
    pub(super) pieces: Vec<Vec<u8>>,
}

impl Input {
    /// An unchanged request.
    pub(super) fn request(bytes: Vec<u8>) -> Self {
        Self {
            kind: REQUEST.to_owned(),
            pieces: vec![bytes],
        }
    }

    /// All bytes.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.pieces.concat()
    }
}

/// A generator of inputs.
pub(super) struct Inputs {
    format: DescribedFormat,
    /// Frames of requests.
    requests: Vec<Vec<u8>>,
    /// Their contents.
    contents: Vec<Vec<u8>>,
}

impl Inputs {
    /// Inputs made of the requests of `description`; without `changes` only of those that do not
    /// change the device's state.
    pub(super) fn of(description: &Arc<Description>, changes: bool) -> Self {
        let format = DescribedFormat::of_requests(description);
        let asks = description.asks().into_iter();
        let asks = asks.filter(|ask| changes || !ask.changes);
        let requests: Vec<Vec<u8>> = asks.map(|ask| ask.bytes).collect();
        let contents = requests.iter().filter_map(|frame| format.content(frame));
        let mut contents: Vec<Vec<u8>> = contents.collect();
        if contents.is_empty() {
            contents.push(Vec::new());
        }
        Self {
            contents,
            format,
            requests,
        }
    }

    /// Whether the bytes are an unchanged request.
    pub(super) fn has_request(&self, bytes: &[u8]) -> bool {
        self.requests.iter().any(|request| request == bytes)
    }

    /// Whether the description has no request.
    pub(super) const fn is_empty(&self) -> bool {
        self.requests.is_empty()
    }

    /// The next input.
    pub(super) fn next(&self, rng: &mut Rng) -> Input {
        let one = |rng: &mut Rng| {
            let at = index(rng, self.requests.len().max(1) as u64);
            self.requests.get(at).cloned().unwrap_or_default()
        };
        let mut chunk = one(rng);
        match rng.below(8) {
            0 => Input::request(chunk),
            shape => {
                if shape == 1 {
                    chunk.extend(one(rng));
                }
                // In one piece: whether a pause ends a frame depends on how bytes are delivered.
                let (kind, pieces) = learn::mutant(&self.format, &self.contents, &chunk, rng);
                Input {
                    kind: kind.to_owned(),
                    pieces: vec![pieces.concat()],
                }
            }
        }
    }
}
