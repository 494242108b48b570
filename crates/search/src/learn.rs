//! Knowledge from the bytes of an unknown device: frame boundaries, checksum and lengths, requests
//! and replies.
//!
//! ```text
//!  capture, folder --+
//!                    +--> Gathered --> Seeds: requests and replies, frames, their format
//!  conversation -----+
//! ```
//!
//! Fuzzing creates mutants from it; `hilrig learn` proposes a description.

mod checksum;
mod corpus;
mod described;
mod format;
mod frame_format;
mod framing;
pub(crate) mod likeness;
mod marked;
mod propose;
mod seeds;
mod stream;
mod sums;

use std::collections::VecDeque;

use protocols::Instant;

use capture::{Capture, Kind};
use engine::rig::line::Direction;

pub use corpus::{Corpus, CorpusError};
pub(crate) use corpus::{Directions, Role};
pub(crate) use described::DescribedFormat;
pub(crate) use frame_format::{FieldLimits, FrameFormat};
pub use propose::{Claim, Confidence, Proposal};
pub(crate) use seeds::{Gathered, Seeds, Spoken};

/// The bytes of `link` in `capture`, or of its only link.
pub(crate) fn conversation(capture: &Capture, link: Option<&str>) -> Vec<Spoken> {
    let named = capture
        .links
        .iter()
        .position(|one| Some(&*one.name) == link);
    let link = named.unwrap_or(0);
    let records = capture.records.iter();
    let bytes = records.filter(|record| record.link == link && record.kind == Kind::Data);
    let spoken = bytes.map(|record| Spoken {
        is_program: record.direction == Direction::ToDevice,
        at: nanos(record.at),
        bytes: record.bytes.to_vec(),
    });
    spoken.collect()
}

/// A conversation on a single wire without the program's own bytes, which come back to it before
/// the device replies.
pub(crate) fn without_echo(mut spoken: Vec<Spoken>) -> Vec<Spoken> {
    // A byte and its echo arrive at the same time.
    spoken.sort_by_key(|one| (one.at, !one.is_program));
    let mut echo: VecDeque<u8> = VecDeque::new();
    for one in &mut spoken {
        if one.is_program {
            echo.extend(&one.bytes);
            continue;
        }
        let pairs = one.bytes.iter().zip(&echo);
        let len = pairs.take_while(|(heard, said)| heard == said).count();
        echo.drain(..len);
        one.bytes.drain(..len);
        // Bytes of the device that are not the echo end it, because a part of the echo was lost.
        if !one.bytes.is_empty() {
            echo.clear();
        }
    }
    spoken.retain(|one| !one.bytes.is_empty());
    spoken
}

fn nanos(at: Instant) -> u64 {
    u64::try_from((at - Instant::ZERO).as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
pub(crate) mod tests;
