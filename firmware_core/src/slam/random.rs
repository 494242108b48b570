/// The search's random numbers: PCG XSH-RR 64/32, small, and the same everywhere.
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
    pub(super) const fn next_u32(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
        let shifted = (((old >> 18) ^ old) >> 27) as u32;
        shifted.rotate_right((old >> 59) as u32)
    }

    /// A number below `limit`, or any number if `limit` is 0: what a remainder by zero gives on
    /// the microcontroller, whose division answers 0.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference output of PCG's demo program, seed 42, sequence 54, is another stream; here the
    /// point is only that the numbers never change and fill their range.
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
}
