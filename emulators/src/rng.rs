//! Named random streams from one seed.
//!
//! Whoever needs chance asks for a stream of its own: `Rng::stream(seed, "lidar.noise")`. Streams
//! share nothing, so a new stream, or one more draw in an old one, never shifts another. Every
//! method draws a fixed number of words, whatever its arguments: a fault of probability 0 leaves
//! the stream where a fault of probability 1 leaves it.

use core::f64::consts::TAU;

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng as _, SeedableRng};

/// One stream of random numbers: xoshiro256++, the same on every host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rng(Xoshiro256PlusPlus);

impl Rng {
    /// The stream called `name` of the run with this `seed`.
    pub fn stream(seed: u64, name: &str) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(
            scramble(seed) ^ fnv1a(name),
        ))
    }

    /// The next 64 bits. One draw.
    pub fn next_u64(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A whole number below `n`. One draw; the bias is below n / 2^64.
    ///
    /// # Panics
    /// If `n` is 0, as no number is below it.
    pub fn below(&mut self, n: u64) -> u64 {
        assert!(n > 0, "no number is below 0");
        let scaled = (u128::from(self.next_u64()) * u128::from(n)) >> 64;
        u64::try_from(scaled).expect("a 128-bit product shifted by 64 fits 64 bits")
    }

    /// Uniform in [0, 1), a multiple of 2^-53. One draw.
    pub fn uniform(&mut self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "53 bits are exact in an f64")]
        let mantissa = (self.next_u64() >> 11) as f64;
        mantissa * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform between `lo` and `hi`. One draw.
    pub fn range(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.uniform()
    }

    /// Normal with mean 0 and standard deviation 1 (Box-Muller). Two draws.
    pub fn gauss(&mut self) -> f64 {
        let away_from_zero = 1.0 - self.uniform();
        let turn = self.uniform();
        (-2.0 * libm::log(away_from_zero)).sqrt() * libm::cos(TAU * turn)
    }

    /// True with probability `p`; never for 0 or less, always for 1 or more. One draw.
    pub fn chance(&mut self, p: f64) -> bool {
        self.uniform() < p
    }
}

/// One step of splitmix64: neighbouring seeds end up far apart, so that `seed ^ name` is no
/// other run's stream in practice.
fn scramble(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// FNV-1a, 64 bits: names are short and trusted, so a simple well-known hash is enough.
fn fnv1a(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}
