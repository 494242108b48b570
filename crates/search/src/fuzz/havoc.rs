//! Mutations of choices.

use emulators::rng::Rng;

/// Maximum length of a string of choices.
const LEN_MAX: usize = 4096;
/// Maximum length of a string created from nothing; most are shorter.
const FRESH_MAX: u64 = 400;
/// Bytes at which programs often change their behaviour: limits of counters, and start bytes of the
/// wire formats.
const TELLING: [u8; 12] = [
    0x00, 0x01, 0x02, 0x10, 0x20, 0x7F, 0x80, 0xFE, 0xFF, 0xAB, 0xFA, b'P',
];

/// Choices mutated from a string in `pool`, or created from nothing.
pub(super) fn mutated(pool: &[Vec<u8>], rng: &mut Rng) -> Vec<u8> {
    if pool.is_empty() || rng.below(8) == 0 {
        return fresh(rng);
    }
    // Prefers the younger of two: recent findings lead to more new behaviour.
    let at = index(rng, pool.len()).max(index(rng, pool.len()));
    let mut choices = pool[at].clone();
    for _ in 0..1_u64 << rng.below(5) {
        mutate(&mut choices, pool, rng);
    }
    choices.truncate(LEN_MAX);
    choices
}

fn fresh(rng: &mut Rng) -> Vec<u8> {
    let most = rng.below(FRESH_MAX);
    let len = rng.below(most + 1);
    (0..len).map(|_| byte(rng)).collect()
}

fn byte(rng: &mut Rng) -> u8 {
    rng.next_u64().to_be_bytes()[0]
}

fn index(rng: &mut Rng, len: usize) -> usize {
    usize::try_from(rng.below(len as u64)).expect("below a length")
}

/// A random range within `len` bytes.
fn part(rng: &mut Rng, len: usize) -> core::ops::Range<usize> {
    let start = index(rng, len + 1);
    let most = (len - start).min(32);
    start..start + index(rng, most + 1)
}

/// Applies one mutation to `choices`; parts of other strings come from `pool`, which is not empty.
pub(super) fn mutate(choices: &mut Vec<u8>, pool: &[Vec<u8>], rng: &mut Rng) {
    if choices.is_empty() {
        choices.push(byte(rng));
    }
    let at = index(rng, choices.len());
    match rng.below(10) {
        0 => choices[at] ^= 1 << rng.below(8),
        1 => choices[at] = byte(rng),
        2 => choices[at] = TELLING[index(rng, TELLING.len())],
        3 => choices[at] = choices[at].wrapping_add(byte(rng) % 9).wrapping_sub(4),
        4 => choices.insert(at, byte(rng)),
        5 => {
            let new: Vec<u8> = (0..1 + rng.below(16)).map(|_| byte(rng)).collect();
            choices.splice(at..at, new);
        }
        6 => drop(choices.drain(part(rng, choices.len()))),
        7 => {
            let copy = choices[part(rng, choices.len())].to_vec();
            choices.splice(at..at, copy);
        }
        8 => {
            let other = &pool[index(rng, pool.len())];
            choices.splice(at..at, other[part(rng, other.len())].iter().copied());
        }
        _ => {
            // The beginning of one string, the end of another.
            let other = &pool[index(rng, pool.len())];
            choices.truncate(at);
            choices.extend(&other[at.min(other.len())..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_stream_of_chance_makes_the_same_choices() {
        let pool = vec![vec![1, 2, 3], vec![4; 100]];
        let make = |seed| mutated(&pool, &mut Rng::stream(seed, "test"));
        assert_eq!(make(3), make(3));
        assert_ne!(make(3), make(4));
    }

    /// A splice may double a string, but the length stays limited.
    #[test]
    fn choices_stay_short() {
        let pool = vec![vec![7; LEN_MAX]];
        let mut rng = Rng::stream(1, "test");
        for _ in 0..1000 {
            assert!(mutated(&pool, &mut rng).len() <= LEN_MAX);
        }
    }
}
