//! Computing time on the robot's microcontroller.

use core::time::Duration;

use firmware_core::Work;

/// Converts [`Work`] to processor time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuModel {
    /// Time per scan, except for the search.
    pub per_scan: Duration,
    /// Time per candidate pose.
    pub per_try: Duration,
    /// Time per point of each candidate pose.
    pub per_point: Duration,
}

impl CpuModel {
    /// The rescue robot's STM32F4 at 168 MHz. The seed report's figure of search times gives 14 ms
    /// per scan, 0.15 ms per try with 36 points and 1.27 ms with 360. Two equations give the time
    /// of a try (25.6 us) and of a point (3.457 us).
    pub const STM32F4: Self = Self {
        per_scan: Duration::from_millis(14),
        per_try: Duration::from_nanos(25_556),
        per_point: Duration::from_nanos(3_457),
    };

    /// A processor that is never busy.
    pub const IDEAL: Self = Self {
        per_scan: Duration::ZERO,
        per_try: Duration::ZERO,
        per_point: Duration::ZERO,
    };

    /// Time that `work` takes.
    pub fn cost(self, work: Work) -> Duration {
        if work == Work::NONE {
            return Duration::ZERO;
        }
        self.per_scan * work.scans + self.per_try * work.tries + self.per_point * work.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seed figure S4: 360 points cost 8.47 times as much as 36.
    #[test]
    fn the_slope_over_points_is_the_seeds() {
        let tries = |points| {
            CpuModel::STM32F4.cost(Work {
                scans: 0,
                tries: 1000,
                points,
            })
        };
        let (few, many) = (tries(36_000).as_secs_f64(), tries(360_000).as_secs_f64());
        assert!((few - 0.150).abs() < 1e-4, "{few}");
        assert!((many / few - 8.47).abs() < 0.01, "{}", many / few);
    }

    /// Two scans, three tries and five points, each with its own time.
    #[test]
    fn work_costs_the_sum_of_its_parts() {
        let nanos = Duration::from_nanos;
        let model = CpuModel {
            per_scan: nanos(1_000_000),
            per_try: nanos(1_000),
            per_point: nanos(1),
        };
        let (scans, tries, points) = (2, 3, 5);
        let work = Work {
            scans,
            tries,
            points,
        };
        assert_eq!(model.cost(work), nanos(2_003_005));
        assert_eq!(CpuModel::IDEAL.cost(work), Duration::ZERO);
    }
}
