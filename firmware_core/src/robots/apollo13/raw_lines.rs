//! Converts the later sketch's lines, which contain only raw sensor values, to readings. The
//! heading is summed here, and a distance without a matching acceleration does not count.

use protocols::odometer::{Raw, Reading};

use super::slip::SlipWatch;

/// Period of the sketch's lines, which contain no time.
const LINE_S: f64 = 0.010_03;
/// Time that the encoder stands before the gyroscope's offset is measured, and the time constant of
/// the measurement, seconds.
const STANDS_S: f64 = 0.5;
const LEARNED_S: f64 = 0.5;
/// A distance that falls back to 0 from more than this means a reset of the board.
const RESET_M: f64 = 0.05;

/// State of the conversion.
#[derive(Clone, Debug, Default)]
pub struct RawLines {
    told_m: Option<f64>,
    offset_rad_s: Option<f64>,
    stands_s: f64,
    reading: Option<Reading>,
    slip: SlipWatch,
}

impl RawLines {
    /// Converts a line to a reading. After a reset of the board its time restarts.
    pub fn read(&mut self, raw: &Raw) -> Reading {
        let before_m = self.told_m.unwrap_or(raw.distance);
        if raw.distance == 0.0 && before_m.abs() > RESET_M {
            *self = Self {
                slip: core::mem::take(&mut self.slip),
                ..Self::default()
            };
            return self.read(raw);
        }
        self.told_m = Some(raw.distance);
        let way_m = raw.distance - before_m;
        let rate_rad_s = raw.rates[2];
        self.stands_s = if way_m == 0.0 {
            self.stands_s + LINE_S
        } else {
            0.0
        };
        let offset = self.offset_rad_s.get_or_insert(rate_rad_s);
        if self.stands_s >= STANDS_S {
            *offset += (rate_rad_s - *offset) * LINE_S / LEARNED_S;
        }
        let rate_rad_s = rate_rad_s - *offset;
        let went_m = self.slip.update(LINE_S, way_m, raw.accelerations[0]);
        let before = self.reading.unwrap_or(Reading {
            distance_m: 0.0,
            rate_rad_s: 0.0,
            yaw_rad: 0.0,
            time_s: 0.0,
        });
        let reading = Reading {
            distance_m: before.distance_m + went_m,
            rate_rad_s,
            yaw_rad: before.yaw_rad + rate_rad_s * LINE_S,
            time_s: before.time_s + LINE_S,
        };
        self.reading = Some(reading);
        reading
    }

    /// Number of slips of the wheels.
    pub const fn slips(&self) -> u64 {
        self.slip.found()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    fn raw(distance: f64, rate_dps: f64) -> Raw {
        Raw {
            distance,
            rates: [0.0, 0.0, rate_dps.to_radians()],
            accelerations: [0.3, 0.0, 9.8],
            field: [0.0; 3],
        }
    }

    /// An offset of 0.5 degrees a second at rest; then a quarter turn in 100 lines, 1.003 s, at 90.
    #[test]
    fn the_heading_is_added_up_without_the_offset() {
        let mut lines = RawLines::default();
        (0..200).for_each(|_| _ = lines.read(&raw(0.0, 0.5)));
        let mut yaw_rad = 0.0;
        (0..100).for_each(|_| yaw_rad = lines.read(&raw(0.0, 90.5)).yaw_rad);
        // A turn while the encoder stands is taken for an offset within half a second.
        assert!(yaw_rad < 1.0, "{yaw_rad}");
        let mut lines = RawLines::default();
        (0..200).for_each(|_| _ = lines.read(&raw(0.0, 0.5)));
        let mut distance = 0.0;
        for _ in 0..100 {
            distance += 0.001;
            yaw_rad = lines.read(&raw(distance, 90.5)).yaw_rad;
        }
        assert!((yaw_rad - 90.27_f64.to_radians()).abs() < 0.01, "{yaw_rad}");
    }

    #[test]
    fn after_a_reset_the_time_begins_anew() {
        let mut lines = RawLines::default();
        lines.read(&raw(1.0, 0.0));
        let before = lines.read(&raw(1.001, 0.0));
        let after = lines.read(&raw(0.0, 0.0));
        assert!(after.time_s < before.time_s && after.distance_m == 0.0);
    }

    /// Lines come each 10.03 ms. The fiftieth line, after half a second, is the first that changes
    /// the offset, with a weight of 10.03 of 500. Its rate is 1 degree a second above the first
    /// line's, and 0.97994 of that remain. A count of the encoder restarts the half second.
    #[test]
    fn an_offset_is_learned_after_half_a_second_at_rest() {
        let mut lines = RawLines::default();
        let mut rate_dps = |distance, rate| {
            let reading = lines.read(&raw(distance, rate));
            reading.rate_rad_s.to_degrees()
        };
        assert_eq!(rate_dps(0.0, 1.0), 0.0);
        let rates: std::vec::Vec<f64> = (2..=50).map(|_| rate_dps(0.0, 2.0)).collect();
        assert!(rates[..48].iter().all(|rate| (rate - 1.0).abs() < 1e-9));
        assert!((rates[48] - 0.979_94).abs() < 1e-9, "{}", rates[48]);
        let moved = rate_dps(0.01, 2.0);
        assert!((moved - 0.979_94).abs() < 1e-9, "{moved}");
        let rests: std::vec::Vec<f64> = (1..=50).map(|_| rate_dps(0.01, 2.0)).collect();
        assert!(
            rests[..49]
                .iter()
                .all(|rate| (rate - 0.979_94).abs() < 1e-9)
        );
        assert!((rests[49] - 0.979_94 * 0.979_94).abs() < 1e-9);
    }

    /// Three lines add up to 3 cm and 30.09 ms, with a turn of 2 degrees a second in two of them. A
    /// distance that falls back to 0 from 5 cm is a motion; from more it is a reset of the board.
    #[test]
    fn ways_times_and_turns_add_up_until_a_reset() {
        let mut lines = RawLines::default();
        lines.read(&raw(0.02, 0.0));
        lines.read(&raw(0.03, 2.0));
        let told = lines.read(&raw(0.05, 2.0));
        assert!((told.distance_m - 0.03).abs() < 1e-12 && (told.time_s - 0.030_09).abs() < 1e-12);
        assert!((told.yaw_rad.to_degrees() - 0.040_12).abs() < 1e-12);
        let back = lines.read(&raw(0.0, 0.0));
        assert!((back.time_s - 0.040_12).abs() < 1e-12);
        lines.read(&raw(-0.051, 0.0));
        let reset = lines.read(&raw(0.0, 0.0));
        assert!((reset.time_s - 0.010_03).abs() < 1e-12 && reset.distance_m == 0.0);
    }

    /// Wheels that spin at 0.5 m/s without an acceleration slip, and the slip is counted.
    #[test]
    fn slips_are_counted() {
        let mut lines = RawLines::default();
        (0..100).for_each(|_| _ = lines.read(&raw(1.0, 0.0)));
        assert_eq!(lines.slips(), 0);
        let mut distance = 1.0;
        for _ in 0..60 {
            distance += 0.005;
            lines.read(&raw(distance, 0.0));
        }
        assert_eq!(lines.slips(), 1);
        lines.read(&raw(0.0, 0.0));
        assert_eq!(lines.slips(), 1, "a reset of the board forgets none");
    }
}
