//! Messages of a device, learned from a conversation: replies to requests, and unsolicited
//! messages.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::frame_format::FrameFormat;
use super::{DescribedFormat, framing, likeness};

/// Maximum numbers of stored replies per request, of requests, and of unsolicited messages.
const REPLIES_MAX: usize = 32;
const REQUESTS_MAX: usize = 64;
const CHUNKS_MAX: usize = 256;
/// Silence between two chunks, nanoseconds: bytes with shorter gaps belong to one chunk.
const GAP_NANOS: u64 = 3_000_000;
/// Maximum time from a request to its reply, nanoseconds.
const REPLY_NANOS: u64 = 1_000_000_000;

/// Bytes of a conversation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Spoken {
    /// Whether the program sent the bytes, not the device.
    pub(crate) is_program: bool,
    /// Time, nanoseconds.
    pub(crate) at: u64,
    /// The bytes.
    pub(crate) bytes: Vec<u8>,
}

/// Inputs for a program, learned from messages of devices.
#[derive(Clone, Debug)]
pub(crate) struct Seeds {
    /// Requests of the program with the replies of the device.
    pub(crate) exchanges: Vec<(Vec<u8>, Vec<Vec<u8>>)>,
    /// Unsolicited messages.
    pub(crate) unasked: Vec<Vec<u8>>,
    /// Whether the program sent any bytes.
    pub(crate) asks: bool,
    /// The format of the device's messages; of the requests if the device sent none.
    pub(crate) format: Arc<dyn FrameFormat>,
    /// Contents of the device's frames.
    pub(crate) contents: Vec<Vec<u8>>,
}

/// The chunks of a conversation: bytes of one end without a pause between them.
pub(crate) fn chunks(spoken: &[Spoken]) -> Vec<Spoken> {
    let mut chunks: Vec<Spoken> = Vec::new();
    let mut last_at = 0;
    for one in spoken.iter().filter(|one| !one.bytes.is_empty()) {
        let is_close = one.at.saturating_sub(last_at) < GAP_NANOS;
        last_at = one.at;
        match chunks.last_mut() {
            Some(chunk) if chunk.is_program == one.is_program && is_close => {
                chunk.bytes.extend(&one.bytes);
            }
            _ => chunks.push(one.clone()),
        }
    }
    chunks
}

/// Seeds while they are collected.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gathered {
    requests: Vec<Vec<u8>>,
    replies: BTreeMap<Vec<u8>, Vec<Vec<u8>>>,
    unasked: Vec<Vec<u8>>,
}

impl Gathered {
    /// Adds a conversation in order of time.
    pub(crate) fn conversation(&mut self, spoken: &[Spoken]) {
        let mut asked: Option<(Vec<u8>, u64)> = None;
        for chunk in chunks(spoken) {
            if chunk.is_program {
                self.request(chunk.bytes.clone());
                asked = Some((chunk.bytes, chunk.at));
                continue;
            }
            match asked.take() {
                Some((request, at)) if chunk.at.saturating_sub(at) < REPLY_NANOS => {
                    self.reply(request, chunk.bytes);
                }
                _ => self.unasked(chunk.bytes),
            }
        }
    }

    /// Adds a message of the device without its request.
    pub(crate) fn unasked(&mut self, chunk: Vec<u8>) {
        let is_new = !chunk.is_empty() && !self.unasked.contains(&chunk);
        if is_new && self.unasked.len() < CHUNKS_MAX {
            self.unasked.push(chunk);
        }
    }

    fn request(&mut self, request: Vec<u8>) {
        if !self.requests.contains(&request) && self.requests.len() < REQUESTS_MAX {
            self.requests.push(request);
        }
    }

    fn reply(&mut self, request: Vec<u8>, reply: Vec<u8>) {
        let is_known = self.replies.contains_key(&request);
        if is_known || self.replies.len() < REQUESTS_MAX {
            let known = self.replies.entry(request).or_default();
            if !known.contains(&reply) && known.len() < REPLIES_MAX {
                known.push(reply);
            }
        }
    }

    /// Adds a conversation in which the program answers: the other end's chunks are its input.
    pub(crate) fn questions(&mut self, spoken: &[Spoken]) {
        for chunk in chunks(spoken) {
            if !chunk.is_program {
                self.unasked(chunk.bytes);
            }
        }
    }

    /// The messages of the other end without a request.
    pub(crate) fn questions_so_far(&self) -> &[Vec<u8>] {
        &self.unasked
    }

    /// Whether the program sent any request.
    pub(crate) const fn has_requests(&self) -> bool {
        !self.requests.is_empty()
    }

    /// Whether the program sent `chunk` as a request.
    pub(crate) fn knows_request(&self, chunk: &[u8]) -> bool {
        self.requests.iter().any(|request| request == chunk)
    }

    /// Whether the program sent a request like `chunk`, with other values.
    pub(crate) fn knows_like(&self, chunk: &[u8]) -> bool {
        let mut requests = self.requests.iter();
        requests.any(|request| likeness::resemble(request, chunk))
    }

    /// The learned seeds; the format is `described` if given.
    pub(crate) fn learned(self, described: Option<DescribedFormat>) -> Seeds {
        let replies = self.replies.values().flatten().chain(&self.unasked);
        let mut chunks: Vec<Vec<u8>> = replies.cloned().collect();
        if chunks.is_empty() {
            chunks.clone_from(&self.requests);
        }
        let (format, frames): (Arc<dyn FrameFormat>, Vec<Vec<u8>>) = match described {
            None => {
                let (format, frames) = framing::infer(&chunks);
                (Arc::new(format), frames)
            }
            Some(format) => {
                let frames = chunks.iter().flat_map(|chunk| format.split(chunk));
                let mut frames: Vec<Vec<u8>> = frames.map(<[u8]>::to_vec).collect();
                frames.extend(format.examples());
                (Arc::new(format), frames)
            }
        };
        let contents = frames.iter().filter_map(|frame| format.content(frame));
        let contents: BTreeSet<Vec<u8>> = contents.collect();
        let mut contents: Vec<Vec<u8>> = contents.into_iter().take(CHUNKS_MAX).collect();
        if contents.is_empty() {
            contents.push(Vec::new());
        }
        // A stream received at once contains many frames.
        let unasked = self
            .unasked
            .iter()
            .flat_map(|chunk| match format.split(chunk) {
                frames if frames.len() > 8 => frames.into_iter().map(<[u8]>::to_vec).collect(),
                _ => vec![chunk.clone()],
            });
        let unasked = unasked.take(CHUNKS_MAX).collect();
        Seeds {
            exchanges: self.replies.into_iter().collect(),
            unasked,
            asks: !self.requests.is_empty(),
            format,
            contents,
        }
    }
}
