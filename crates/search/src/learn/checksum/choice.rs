//! Choice among the candidates that fit a set of frames. Several often fit: sums of 7 and 8 bits
//! over small values, or an exclusive or at several positions.

use std::collections::BTreeSet;

use super::super::sums::{self, ALL, Sum, UNNAMED};
use super::{CLAIMED_BITS, Checksum, FRAMES_MAX, GUESSED_BITS, HEAD_MAX, Place, candidates};

impl Checksum {
    /// Whether the position is unambiguous. If an exclusive-or sum or a negative sum covers the
    /// whole frame, each byte is the checksum of all others. The byte that changes most is then
    /// most likely the checksum.
    fn has_certain_place(&self, bodies: &[&[u8]]) -> bool {
        if !self.sum.is_symmetric() {
            return true;
        }
        let Place::End { tail, .. } = self.place else {
            return !matches!(self.place, Place::Head { .. });
        };
        let values = |at: &dyn Fn(&[u8]) -> Option<u8>| {
            let values: BTreeSet<Option<u8>> = bodies.iter().map(|body| at(body)).collect();
            values.len()
        };
        let own = values(&|body| body.get(body.len().checked_sub(tail + 1)?).copied());
        let most = (self.start..HEAD_MAX).map(|at| values(&|body| body.get(at).copied()));
        most.max().unwrap_or(0) * 2 <= own * 3
    }

    /// Whether descriptions have a name for the algorithm.
    fn is_named(&self) -> bool {
        !self.sum.is_free || sums::described(self.sum.name, self.free).is_some()
    }

    /// Whether this candidate fits each of `bodies` that `other` fits.
    fn covers(&self, other: &Self, bodies: &[&[u8]]) -> bool {
        bodies
            .iter()
            .all(|body| self.holds(body) || !other.holds(body))
    }

    /// Whether this candidate replaces `best`, which has more evidence: it has a name and `best`
    /// has none, or it is the same sum at the end of the frame instead of in the header.
    fn is_preferred(&self, best: &Self, bodies: &[&[u8]]) -> bool {
        let is_at_end = matches!(self.place, Place::End { .. });
        let is_same = self.sum.family().is_some() && self.sum.family() == best.sum.family();
        let is_moved = is_same
            && is_at_end
            && best.sum.is_symmetric()
            && matches!(best.place, Place::Head { is_whole: true, .. });
        let is_at_same = bodies.iter().all(|body| self.at(body) == best.at(body));
        let is_known = !best.is_named() && is_at_same;
        (is_moved || is_known) && self.covers(best, bodies)
    }

    /// Whether the fields of both have a byte in common.
    fn overlaps(&self, other: &Self, body: &[u8]) -> bool {
        match (self.at(body), other.at(body)) {
            (Some(at), Some(place)) => at < place + other.len() && place < at + self.len(),
            _ => false,
        }
    }

    /// Whether this candidate is the same kind of sum as `best` with another number of bits.
    fn is_twin(&self, best: &Self, bodies: &[&[u8]]) -> bool {
        let family = self.sum.family();
        family.is_some()
            && family == best.sum.family()
            && self.sum.bits() != best.sum.bits()
            && bodies.iter().all(|body| self.overlaps(best, body))
            && self.covers(best, bodies)
    }
}

/// Minimum number of different frames for a polynomial without a name.
const UNNAMED_MIN: usize = 12;

/// Different `bodies`, at most [`FRAMES_MAX`], in an order that spreads similar ones: damaged
/// frames are often alike, and the first ones must not all be damaged.
fn spread(bodies: &[Vec<u8>]) -> Vec<&[u8]> {
    let distinct: BTreeSet<&[u8]> = bodies.iter().map(Vec::as_slice).collect();
    let few: Vec<&[u8]> = distinct.into_iter().take(FRAMES_MAX).collect();
    // The step is a prime that does not divide the number of bodies, so each body comes once.
    let from = few.len() / 2;
    (0..few.len())
        .map(|at| few[(from + at * STEP) % few.len()])
        .collect()
}

/// Distance of two bodies that follow each other in this order: a prime above [`FRAMES_MAX`].
const STEP: usize = 67;

/// The checksum of `bodies`, which are frames without their ends, if one is found.
pub(crate) fn infer(bodies: &[Vec<u8>]) -> Option<Checksum> {
    let distinct = spread(bodies);
    let (mut tried, mut fitting) = all_fitting(&distinct, &ALL)?;
    let is_enough = |one: &Checksum| one.bits - tried >= CLAIMED_BITS;
    if !fitting.iter().any(is_enough) && distinct.len() >= UNNAMED_MIN {
        // Polynomials without a name need evidence of many frames.
        let (more, found) = all_fitting(&distinct, &UNNAMED)?;
        (tried, fitting) = (tried.max(more) + 1.0, [fitting, found].concat());
    }
    let first = |best: Option<Checksum>, one: &Checksum| match best {
        Some(best) if best.bits >= one.bits => Some(best),
        _ => Some(*one),
    };
    let mut best = fitting.iter().fold(None, first)?;
    let is_claimed = |one: &&Checksum| one.bits - tried >= CLAIMED_BITS;
    let named: Vec<&Checksum> = fitting
        .iter()
        .filter(|one| one.is_named())
        .filter(is_claimed)
        .collect();
    let preferred = named
        .iter()
        .copied()
        .filter(|one| one.is_preferred(&best, &distinct));
    best = preferred.fold(None, first).unwrap_or(best);
    let is_claimed = best.bits - tried >= CLAIMED_BITS && best.has_certain_place(&distinct);
    // The twin needs no evidence of its own: each frame that fits `best` fits it, too.
    let twins = fitting
        .iter()
        .filter(|one| one.is_named() && one.is_twin(&best, &distinct));
    let twin = twins.fold(None, first).filter(|_| is_claimed);
    best.twin = twin.map(|twin| (twin.sum, twin.start));
    best.bits -= tried;
    best.is_sure = is_claimed && twin.is_none();
    let is_whole = distinct.iter().all(|body| best.holds(body));
    (best.is_present() || (is_whole && best.bits >= GUESSED_BITS)).then_some(best)
}

/// The correction for the number of tried candidates, bits, and the candidates that fit `bodies`.
fn all_fitting(bodies: &[&[u8]], sums: &'static [Sum]) -> Option<(f64, Vec<Checksum>)> {
    let mut lens: Vec<usize> = bodies.iter().map(|body| body.len()).collect();
    lens.sort_unstable();
    let (shortest, usual) = (*lens.first()?, lens[lens.len() / 2]);
    let (mut tried, mut fitting) = (0.0_f64, Vec::new());
    for sum in sums {
        for mut candidate in candidates(sum, [shortest, usual], bodies.len()) {
            tried += 1.0;
            if let Some([between, behind]) = candidate.around(bodies[0]) {
                candidate.fixed[..between.len()].copy_from_slice(between);
                candidate.fixed[between.len()..][..behind.len()].copy_from_slice(behind);
            }
            if let Some(bits) = candidate.evidence(bodies) {
                fitting.push(Checksum { bits, ..candidate });
            }
        }
    }
    Some((tried.log2(), fitting))
}
