//! Random numbers of a program: small, and the same everywhere.

/// Random numbers of a program: PCG XSH-RR 64/32, small, and the same everywhere.
#[derive(Clone, Debug)]
pub(crate) struct Pcg32 {
    state: u64,
}

const MULTIPLIER: u64 = 6_364_136_223_846_793_005;
const INCREMENT: u64 = 1_442_695_040_888_963_407;

impl Pcg32 {
    pub(crate) const fn new(seed: u64) -> Self {
        let state = seed
            .wrapping_add(INCREMENT)
            .wrapping_mul(MULTIPLIER)
            .wrapping_add(INCREMENT);
        Self { state }
    }

    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "PCG keeps 32 of the bits on purpose"
    )]
    pub(crate) const fn next_u32(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
        let shifted = (((old >> 18) ^ old) >> 27) as u32;
        shifted.rotate_right((old >> 59) as u32)
    }

    /// A number below `limit`, or any number if `limit` is 0: the microcontroller's division by
    /// zero yields 0, so its remainder is the number itself.
    #[inline]
    pub(crate) fn below(&mut self, limit: u32) -> u32 {
        let drawn = self.next_u32();
        if limit == 0 {
            drawn >> 1
        } else {
            ((u64::from(drawn) * u64::from(limit)) >> 32) as u32
        }
    }
}

/// Draws that only programs on a PC make.
#[cfg(feature = "host")]
impl Pcg32 {
    /// A number from 0 up to 1.
    pub(crate) fn unit(&mut self) -> f64 {
        f64::from(self.next_u32()) / (f64::from(u32::MAX) + 1.0)
    }

    /// A number of the normal distribution around 0 with this standard deviation, by Box and
    /// Muller.
    pub(crate) fn normal(&mut self, sigma: f64) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        sigma * radius * libm::cos(core::f64::consts::TAU * self.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reference output of PCG's demo program, seed 42, sequence 54, is another stream; this
    /// test only checks that the numbers never change and fill their range.
    #[test]
    fn numbers_stay_in_range_and_reach_both_ends() {
        let mut random = Pcg32::new(7);
        let mut seen = [false; 20];
        for _ in 0..2_000 {
            seen[usize::try_from(random.below(20)).unwrap()] = true;
        }
        assert_eq!(seen, [true; 20]);
        assert!(Pcg32::new(7).next_u32() != Pcg32::new(8).next_u32());
    }

    /// Normal numbers with a deviation of 2: mean 0, mean square 4, and a third of them beyond one
    /// deviation. Each figure may be off by 4 standard errors.
    #[cfg(feature = "host")]
    #[test]
    fn normal_numbers_are_normal() {
        let mut random = Pcg32::new(3);
        let (mut sum, mut squares, mut beyond) = (0.0, 0.0, 0.0);
        for _ in 0..10_000 {
            let drawn = random.normal(2.0);
            sum += drawn;
            squares += drawn * drawn;
            beyond += f64::from(u8::from(drawn.abs() > 2.0));
        }
        assert!((sum / 1e4_f64).abs() < 0.08, "{sum}");
        assert!((squares / 1e4 - 4.0_f64).abs() < 0.23, "{squares}");
        assert!((beyond / 1e4 - 0.3173_f64).abs() < 0.019, "{beyond}");
    }

    /// As the paper's Python in eight lines computes them: PCG XSH-RR 64/32 (O'Neill 2014) of
    /// PCG's own stream, seed 42.
    #[test]
    fn numbers_are_those_of_the_paper() {
        let mut random = Pcg32::new(42);
        let drawn = [(); 6].map(|()| random.next_u32());
        let expected = [
            0xC2F5_7BD6,
            0x6B07_C4A9,
            0x72B7_B29B,
            0x4421_5383,
            0xF5AF_5EAD,
            0x68BE_B632,
        ];
        assert_eq!(drawn, expected);
    }

    /// The draws 0xC2F5 and 0x6B07 are 0.7616 and 0.4181 of 0x1_0000, so below 1000 they give 761
    /// and 418. Without a limit the result is half of the drawn number.
    #[test]
    fn a_number_below_a_limit_is_its_part_of_all() {
        let mut random = Pcg32::new(42);
        assert_eq!([random.below(1_000), random.below(1_000)], [761, 418]);
        assert_eq!(random.below(0), 0x72B7_B29B / 2);
    }

    /// Two of the draws above as fractions of 1. Box and Muller use two of them for each normal
    /// number.
    #[cfg(feature = "host")]
    #[test]
    fn unit_and_normal_numbers_are_made_of_draws() {
        let mut random = Pcg32::new(42);
        let units = [(); 2].map(|()| random.unit());
        let all = 4_294_967_296.0;
        assert_eq!(
            units,
            [
                f64::from(0xC2F5_7BD6_u32) / all,
                f64::from(0x6B07_C4A9) / all
            ]
        );
        assert!((units[0] - 0.761_558).abs() < 1e-6 && (units[1] - 0.418_087).abs() < 1e-6);
        let mut random = Pcg32::new(42);
        // By Box and Muller: sqrt(-2 ln(1 - 0.761558)) = 1.693299, times cos(2 pi 0.418087) =
        // -0.870454, times the deviation of 3.
        assert!((random.normal(3.0) + 4.421_815).abs() < 1e-4);
    }
}
