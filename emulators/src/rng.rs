//! Named random streams from one seed.
//!
//! Each consumer of random numbers has a stream of its own: `Rng::stream(seed, "lidar.noise")`.
//! Streams share nothing, so a new stream, or one more draw in an old one, never shifts another.
//! Every method draws a fixed number of words, whatever its arguments: a fault of probability 0
//! leaves the stream in the same state as a fault of probability 1.

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

    /// About normal with mean 0 and standard deviation 1, never beyond 3.47: the sum of four
    /// uniform numbers of 16 bits. One draw, and no logarithm, for callers that need very many.
    pub fn bell(&mut self) -> f64 {
        let word = self.next_u64();
        let sum = (0..4)
            .map(|part| (word >> (16 * part)) & 0xffff)
            .sum::<u64>();
        #[expect(clippy::cast_precision_loss, reason = "18 bits")]
        let sum = sum as f64;
        // Each part has a mean of 32767.5 and a variance of (2^32 - 1) / 12.
        (sum - 131_070.0) / 37_837.227
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

#[cfg(test)]
mod tests {
    use super::*;

    fn first_three(seed: u64, name: &str) -> [u64; 3] {
        let mut rng = Rng::stream(seed, name);
        [rng.next_u64(), rng.next_u64(), rng.next_u64()]
    }

    /// Saved cases keep their meaning only if these figures never change. A second implementation
    /// of FNV-1a, splitmix64 and xoshiro256++ computed them; that one was checked against the
    /// published vector of xoshiro256++ (state 1, 2, 3, 4: 41943041, 58720359, ..).
    #[test]
    fn streams_are_the_same_for_ever() {
        assert_eq!(
            first_three(0, ""),
            [
                0x96bb_3c9c_ab98_ed3f,
                0x65b6_4fbc_9a77_0e81,
                0xed86_fb2d_91de_1ae1
            ]
        );
        assert_eq!(
            first_three(1, "lidar.noise"),
            [
                0xa4d0_e3e2_8669_6280,
                0x174e_cd65_4d70_db42,
                0x32ba_a2b8_a33f_180a
            ]
        );
        assert_eq!(
            first_three(1, "lidar.drop"),
            [
                0xade1_fbf7_5ad2_5384,
                0xa838_463c_8071_8100,
                0x5e3c_760c_aadf_3ed6
            ]
        );
        assert_eq!(
            first_three(2, "lidar.noise"),
            [
                0x37a9_cc63_25c6_683e,
                0xff25_6dee_28c6_7eb9,
                0xb8f6_9d19_7977_184a
            ]
        );
    }

    /// Published values: FNV-1a of "foobar"; first output of splitmix64 with seed 0.
    #[test]
    fn hash_and_scrambler_give_their_published_values() {
        assert_eq!(fnv1a("foobar"), 0x8594_4171_f739_67e8);
        assert_eq!(scramble(0), 0xe220_a839_7b1d_cdaf);
    }

    /// A fault switched off must not shift later draws of the stream.
    #[test]
    fn a_chance_of_zero_draws_as_often_as_a_chance_of_one() {
        let mut never = Rng::stream(7, "fault");
        let mut always = never.clone();
        assert!(!never.chance(0.0));
        assert!(always.chance(1.0));
        assert_eq!(never, always);
    }

    #[test]
    fn a_normal_draw_takes_two_words_whatever_it_gives() {
        let mut drawn = Rng::stream(7, "noise");
        let mut counted = drawn.clone();
        drawn.gauss();
        counted.next_u64();
        counted.next_u64();
        assert_eq!(drawn, counted);
    }

    /// Of n draws the mean of a standard normal has deviation 1/sqrt(n), the variance sqrt(2/n):
    /// 0.005 and 0.007 here; five of each are allowed.
    #[test]
    fn normal_draws_have_mean_zero_and_variance_one() {
        let mut rng = Rng::stream(3, "noise");
        let draws: Vec<f64> = (0..40_000).map(|_| rng.gauss()).collect();
        let mean = draws.iter().sum::<f64>() / 40_000.0;
        let variance = draws.iter().map(|d| d * d).sum::<f64>() / 40_000.0;
        assert!(mean.abs() < 0.025, "{mean}");
        assert!((variance - 1.0).abs() < 0.035, "{variance}");
    }

    /// Checks mean and variance of the sum of four uniform numbers, all within 3.47. The sum uses
    /// one word.
    #[test]
    fn the_quick_bell_has_mean_zero_and_variance_one() {
        let mut rng = Rng::stream(3, "bell");
        let draws: Vec<f64> = (0..40_000).map(|_| rng.bell()).collect();
        let mean = draws.iter().sum::<f64>() / 40_000.0;
        let variance = draws.iter().map(|d| d * d).sum::<f64>() / 40_000.0;
        assert!(mean.abs() < 0.025, "{mean}");
        assert!((variance - 1.0).abs() < 0.035, "{variance}");
        assert!(draws.iter().all(|draw| draw.abs() < 3.47));
        let mut counted = Rng::stream(3, "bell");
        (0..40_000).for_each(|_| {
            counted.next_u64();
        });
        assert_eq!(rng, counted);
    }

    /// 60,000 rolls: each face 10,000 with a deviation of 91; five of them are allowed.
    #[test]
    fn every_face_of_a_die_comes_up_equally_often() {
        let mut rng = Rng::stream(3, "die");
        let mut faces = [0_u32; 6];
        for _ in 0..60_000 {
            faces[usize::try_from(rng.below(6)).unwrap()] += 1;
        }
        assert!(
            faces.iter().all(|count| count.abs_diff(10_000) < 456),
            "{faces:?}"
        );
    }

    #[test]
    fn uniform_draws_stay_within_their_range() {
        let mut rng = Rng::stream(3, "range");
        let draws: Vec<f64> = (0..10_000).map(|_| rng.range(-2.0, 3.0)).collect();
        assert!(draws.iter().all(|draw| (-2.0..3.0).contains(draw)));
        assert!(draws.iter().any(|draw| *draw < -1.99) && draws.iter().any(|draw| *draw > 2.99));
    }
}
