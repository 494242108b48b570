//! The evidence of stuffing in frames without a checksum.

use std::collections::BTreeSet;

use super::super::format::{Coding, Format};

/// Minimum evidence of stuffing for a guess, and for a claim, bits.
pub(super) const STUFFED_BITS: f64 = 14.0;
pub(super) const STUFFED_SURE: f64 = 24.0;

/// The evidence of stuffing in frames without a checksum.
pub(super) struct Stuffed {
    pub(super) escapes: usize,
    /// Evidence of the stuffing, and of the flags at both ends of frames.
    pub(super) bits: f64,
    pub(super) flags: f64,
}

impl Stuffed {
    pub(super) fn of(format: &Format, frames: &[Vec<u8>]) -> Self {
        let distinct: BTreeSet<&Vec<u8>> = frames.iter().collect();
        let pairs = |first: u8, seconds: &[u8]| {
            let pairs = distinct.iter().flat_map(|frame| frame.windows(2));
            let own = pairs.filter(|pair| pair[0] == first && seconds.contains(&pair[1]));
            own.count()
        };
        // Of 256 bytes, one or two may follow an escape.
        let (escapes, bits) = match format.coding {
            Coding::Raw => (0, 0.0),
            Coding::Slip => (pairs(0xDB, &[0xDC, 0xDD]), 7.0),
            Coding::Hdlc => (pairs(0x7D, &[0x5D, 0x5E]), 7.0),
            Coding::Dle => (pairs(0x10, &[0x10]), 8.0),
            // Of 255 first codes, one leads to the end of the frame.
            Coding::Cobs => (distinct.len(), 7.0),
        };
        let has_flag = |frame: &&&Vec<u8>| frame.starts_with(&format.flag);
        let flagged = distinct.iter().filter(has_flag).count();
        let flags = if format.flag.is_empty() { 0.0 } else { 2.0 };
        Self {
            escapes,
            bits: bits * escapes as f64,
            flags: flags * flagged as f64,
        }
    }
}
