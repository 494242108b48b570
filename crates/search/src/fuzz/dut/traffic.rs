//! Raw traffic to a program on one link: answered frames, damaged variants of them, noise.

use core::time::Duration;

use emulators::rng::Rng;

use super::case::{Hex, Pair, Raw, index};
use super::guide::{Guide, Guided};
use super::probe::Probed;
use super::speech::Speech;

/// Maximum number of pairs of an intact and a damaged frame in a case.
const PAIRS_MAX: u64 = 4;
/// One case in this many begins a frame and stops.
const CUT_ONE_IN: u64 = 4;
/// Share of the line's capacity that raw traffic uses.
const LOAD: f64 = 0.6;
/// Minimum and maximum number of bytes of a stream.
const BYTES: core::ops::Range<f64> = 200.0..200_000.0;

/// Traffic for the link of `met`. `dice` holds separate random sources for pairs and stream: the
/// answered frames must not influence the stream. With `guide`, coverage guides the stream.
pub(super) fn raw(
    met: &Probed,
    speech: &Speech,
    baud: u32,
    lasting: Duration,
    [dice, rng]: &mut [Rng; 2],
    guide: Option<&Guide>,
) -> (Raw, Guided) {
    let mut pairs = Vec::new();
    for _ in 0..PAIRS_MAX {
        let Some(last) = (met.answered.len() as u64).checked_sub(1) else {
            break;
        };
        let good = met.answered[index(dice, last + 1)].frame.clone();
        if let Some(damaged) = speech.damaged(&good.0, dice)
            && let Some(noise) = speech.noise(&good.0, dice)
        {
            let (damaged, noise) = (Hex(damaged), Hex(noise));
            pairs.push(Pair {
                good,
                damaged,
                noise,
            });
        }
    }
    let is_cut = dice.below(CUT_ONE_IN) == 0;
    let answered = met.answered.first().filter(|_| is_cut);
    let cut = answered.map(|one| Hex(one.frame.0[..one.frame.0.len() / 2].to_vec()));
    let bytes = f64::from(baud) / 10.0 * lasting.as_secs_f64() * LOAD;
    let bytes = bytes.clamp(BYTES.start, BYTES.end);
    let mut guided = guide.map_or_else(Guided::default, |guide| guide.traffic(speech, bytes, rng));
    let (mut stream, mut len) = (core::mem::take(&mut guided.stream), 0);
    while guide.is_none() && (len as f64) < bytes {
        let session = speech.session(rng);
        len += session.bytes().len().max(1);
        stream += &session.to_text();
        stream += "idle\n";
    }
    let raw = Raw {
        link: met.link.clone(),
        answered: met.answered.clone(),
        chatter: met.chatter.iter().cloned().map(Hex).collect(),
        pair: pairs,
        cut,
        stream,
        ..Raw::default()
    };
    (raw, guided)
}
