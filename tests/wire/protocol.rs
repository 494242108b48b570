//! A protocol for the laws, and its streams as a bad line delivers them.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use protocols::Decode;

use crate::damage::{Damage, damage};

/// A frame with access to its wire bytes.
pub(crate) trait Wire {
    /// The bytes of the frame.
    fn wire(&self) -> Vec<u8>;
}

/// One decoder with independent knowledge of its protocol.
pub(crate) trait Protocol {
    /// The decoder on trial.
    type Decoder: Decode<Frame: Wire>;

    /// Bytes that the format reacts to: start bytes, magic words, flags.
    const TELLING: &'static [u8];
    /// Whether a checksum distinguishes frames from damaged ones.
    const CHECKED: bool = true;
    /// Cases per law; fewer for long frames.
    const CASES: u32 = 4000;

    /// A fresh decoder.
    fn decoder() -> Self::Decoder;

    /// Length of the frame at the start of `bytes`, from a slow and simple reference implementation
    /// that does not use the tested code.
    fn frame_at(bytes: &[u8]) -> Option<usize>;

    /// Valid frames, built by our encoder.
    fn frame() -> BoxedStrategy<Vec<u8>>;
}

/// All frames in `bytes` by the simplest method: look everywhere, skip each found frame.
pub(crate) fn scan(bytes: &[u8], frame_at: fn(&[u8]) -> Option<usize>) -> Vec<Vec<u8>> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let len = frame_at(&bytes[at..]);
        found.extend(len.map(|len| bytes[at..at + len].to_vec()));
        at += len.unwrap_or(1);
    }
    found
}

/// Up to `most` valid frames in a row.
pub(crate) fn frames<P: Protocol>(most: usize) -> impl Strategy<Value = Vec<Vec<u8>>> {
    vec(P::frame(), 1..=most)
}

/// The beginning of a valid frame.
pub(crate) fn cut_frame<P: Protocol>() -> impl Strategy<Value = Vec<u8>> {
    (P::frame(), any::<Index>()).prop_map(|(mut frame, at)| {
        frame.truncate(at.index(frame.len()));
        frame
    })
}

/// A stream of valid frames, cut frames and noise, with some damaged bytes. (Random bytes alone
/// hardly ever resemble a frame, so they find next to nothing.)
pub(crate) fn stream<P: Protocol>() -> impl Strategy<Value = Vec<u8>> {
    let noise = prop_oneof![any::<u8>(), proptest::sample::select(P::TELLING)];
    let piece = prop_oneof![
        6 => P::frame(),
        3 => cut_frame::<P>(),
        1 => vec(noise, 0..6),
    ];
    (vec(piece, 0..7), vec(damage(P::TELLING), 0..5)).prop_map(|(pieces, damages)| {
        let mut bytes = pieces.concat();
        damages
            .into_iter()
            .for_each(|damage| damage.apply(&mut bytes));
        bytes
    })
}

/// One damaged byte.
pub(crate) fn one_damage<P: Protocol>() -> impl Strategy<Value = Damage> {
    damage(P::TELLING)
}

/// Positions at which a stream is cut into pieces: many, few or none.
pub(crate) fn cuts() -> impl Strategy<Value = Vec<Index>> {
    prop_oneof![vec(any::<Index>(), 0..4), vec(any::<Index>(), 0..60)]
}

/// `bytes` cut at `cuts`, empty pieces included.
pub(crate) fn pieces<'a>(bytes: &'a [u8], cuts: &[Index]) -> Vec<&'a [u8]> {
    let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
    ends.push(bytes.len());
    ends.sort_unstable();
    ends.iter()
        .scan(0, |start, &end| {
            Some(&bytes[core::mem::replace(start, end)..end])
        })
        .collect()
}
