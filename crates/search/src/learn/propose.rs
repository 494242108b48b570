//! A description proposed from the captured bytes of an unknown device.
//!
//! Each claim states its evidence and whether it is certain. Parts without evidence stay plain
//! bytes. The draft is parsed as a description, and the proposal states the share of captured bytes
//! that it covers.

mod form;
mod frame;
mod message;
mod stuffed;
mod written;

use core::fmt;
use core::time::Duration;
use std::sync::Arc;

use capture::Capture;
use description::Description;

use super::{Spoken, conversation};
use frame::Cover;
use written::Proposed;

/// The confidence in a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Confidence {
    /// The probability of a coincidence is below one in a million.
    Sure,
    /// The claim fits, but other interpretations may fit too.
    Guess,
}

/// A claim about the device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claim {
    /// Topic: `framing`, `checksum`, `length`, `messages`, `replies`.
    pub topic: &'static str,
    /// The claim in words.
    pub words: String,
    /// The evidence.
    pub evidence: String,
    /// The confidence.
    pub confidence: Confidence,
}

impl fmt::Display for Claim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sure = match self.confidence {
            Confidence::Sure => "sure",
            Confidence::Guess => "a guess",
        };
        write!(
            f,
            "{}: {} ({sure}; {})",
            self.topic, self.words, self.evidence
        )
    }
}

/// A proposed description.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// The claims.
    pub claims: Vec<Claim>,
    /// The draft; none without any claim.
    pub draft: Option<String>,
    /// Number of bytes in frames of the draft, and of all bytes.
    pub covered: [usize; 2],
}

/// Bytes received at once.
#[derive(Clone, Debug)]
struct Chunk {
    is_host: bool,
    /// Time at which the first byte begins, nanoseconds; at an unknown rate, that of its end.
    begins: u64,
    /// Time of the end of the last byte, nanoseconds.
    ends: u64,
    bytes: Vec<u8>,
}

/// Silence between two chunks, in characters, and its minimum.
const GAP_CHARACTERS: u32 = 3;
const GAP_MIN: Duration = Duration::from_millis(2);
/// Assumed baud rate if the capture contains none.
const BAUD: u32 = 115_200;
/// Maximum time from a request to its reply, nanoseconds.
const REPLY_NANOS: u64 = 1_000_000_000;

impl Proposal {
    /// Examines the bytes of `link`, or of the only link.
    ///
    /// # Errors
    /// If the link does not exist or has no bytes; with the expected name.
    pub fn of(capture: &Capture, link: Option<&str>) -> Result<Self, String> {
        let names: Vec<&str> = capture.links.iter().map(|link| &*link.name).collect();
        let known = names.join(", ");
        let at = match link {
            Some(name) => {
                let found = names.iter().position(|known| *known == name);
                found.ok_or_else(|| {
                    format!("--link {name}: no such link, expected one of {known}")
                })?
            }
            None if names.len() > 1 => {
                return Err(format!(
                    "there are {} links, expected --link with one of {known}",
                    names.len()
                ));
            }
            None => 0,
        };
        let link = names.get(at).ok_or("there is no link with bytes in it")?;
        // If the file contains no baud rate, the most common one is assumed.
        let baud = match capture.links[at].baud {
            0 => BAUD,
            baud => baud.max(300),
        };
        let spoken = conversation(capture, Some(link));
        if spoken.is_empty() {
            return Err(format!(
                "there are no bytes on {link}, expected some of the device"
            ));
        }
        let is_known = capture.links[at].baud > 0;
        Ok(Self::of_bytes(&spoken, baud, is_known))
    }

    /// The proposal for these bytes. `is_known`: the rate comes from the capture, so the duration
    /// of a byte is certain.
    fn of_bytes(spoken: &[Spoken], baud: u32, is_known: bool) -> Self {
        let character = Duration::from_secs(10) / baud.max(300);
        let gap = (character * GAP_CHARACTERS).max(GAP_MIN);
        let chunks = chunks(spoken, [character, gap].map(whole_nanos), is_known);
        let all: usize = spoken.iter().map(|one| one.bytes.len()).sum();
        let nothing = Self {
            claims: Vec::new(),
            draft: None,
            covered: [0, all],
        };
        let mut formats = frame::find(&chunks, baud);
        let mut plain = draft(&formats, baud, all, None);
        let Ok(read) = parse(&plain) else {
            return nothing;
        };
        let covered = Cover::of(&read, chunks.iter()).bytes;
        let is_doubted = covered < all && formats.iter().any(|one| one.is_paused);
        if is_doubted {
            let paused = formats.iter_mut().filter(|one| one.is_paused);
            paused.for_each(|one| one.doubt(all - covered));
            plain = draft(&formats, baud, all, None);
        }
        let mut claims: Vec<Claim> = formats.iter().flat_map(|one| one.claims.clone()).collect();
        let ends = |chunk: &&Chunk| {
            formats
                .iter()
                .any(|one| one.ends[usize::from(chunk.is_host)])
        };
        let said: usize = chunks
            .iter()
            .filter(ends)
            .map(|chunk| chunk.bytes.len())
            .sum();
        if covered * 100 < said * COVERED_SURE && !formats.iter().any(|one| one.is_summed) {
            // A format that does not cover most bytes is rejected.
            return nothing;
        }
        let (told, more) = message::messages(&read, &chunks, &formats);
        let fuller = draft(&formats, baud, all, Some(&told));
        let draft = match parse(&fuller) {
            Ok(_) => {
                claims.extend(more);
                fuller
            }
            Err(_) => plain,
        };
        Self {
            claims,
            draft: Some(draft),
            covered: [covered, all],
        }
    }
}

/// Minimum share of bytes in frames without a checksum, per cent.
const COVERED_SURE: usize = 85;

/// The description with `formats`; `told` holds the learned messages, if any.
fn draft(formats: &[Proposed], baud: u32, all: usize, told: Option<&str>) -> String {
    let claims = formats.iter().flat_map(|format| &format.claims);
    let claims: String = claims.map(|claim| format!("# {claim}\n")).collect();
    let frames = formats
        .iter()
        .enumerate()
        .map(|(index, format)| match formats {
            [_] => format!("[frame]\n{}\n", format.toml),
            _ => format!("[[frame]]\nname = \"f{}\"\n{}\n", index + 1, format.toml),
        });
    let frames: String = frames.collect();
    let messages = told.map_or_else(|| message::plain(formats), str::to_owned);
    format!(
        "{claims}# A draft from captured bytes: it matches these bytes, and nothing else is known.\n\
         name = \"learned\"\nabout = \"Device from {all} captured bytes\"\n\
         line = {{ baud = {baud} }}\n\n{frames}{messages}"
    )
}

fn parse(text: &str) -> Result<Arc<Description>, String> {
    let nothing = |_: &str| Err(String::new());
    Description::parse("draft", text, &nothing).map_err(|error| error.to_string())
}

fn whole_nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// Joins bytes that were sent at once, in order of time. A record has the time of its end, so the
/// time of its own characters before it is not silence. At an unknown rate, this time also counts
/// as its start.
fn chunks(spoken: &[Spoken], [character, gap]: [u64; 2], is_known: bool) -> Vec<Chunk> {
    let mut chunks: Vec<Chunk> = Vec::new();
    let mut last_at = 0;
    for one in spoken.iter().filter(|one| !one.bytes.is_empty()) {
        let own = character.saturating_mul(one.bytes.len() as u64);
        let is_close = one.at.saturating_sub(last_at) < gap.saturating_add(own);
        last_at = one.at;
        match chunks.last_mut() {
            Some(chunk) if chunk.is_host == one.is_program && is_close => {
                chunk.bytes.extend(&one.bytes);
                chunk.ends = one.at;
            }
            _ => chunks.push(Chunk {
                is_host: one.is_program,
                begins: one.at.saturating_sub(if is_known { own } else { 0 }),
                ends: one.at,
                bytes: one.bytes.clone(),
            }),
        }
    }
    chunks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At 2,400 baud a character takes 4,166,666 ns. A request of 3 bytes ends at 100 ms, in two
    /// records; the reply of 32 bytes begins 20 ms later and ends after 133,333,312 ns more.
    #[test]
    fn the_latency_of_a_reply_does_not_contain_its_bytes() {
        const CHARACTER: u64 = 4_166_666;
        let spoken = |is_program, at, len| Spoken {
            is_program,
            at,
            bytes: vec![0x41; len],
        };
        let all = [
            spoken(true, 100_000_000 - CHARACTER, 2),
            spoken(true, 100_000_000, 1),
            spoken(false, 120_000_000 + 32 * CHARACTER, 32),
        ];
        let latency = |is_known| {
            let chunks = chunks(&all, [CHARACTER, 3 * CHARACTER], is_known);
            assert_eq!(chunks.len(), 2);
            chunks[1].begins - chunks[0].ends
        };
        assert_eq!(latency(true), 20_000_000);
        assert_eq!(latency(false), 20_000_000 + 32 * CHARACTER);
    }
}
