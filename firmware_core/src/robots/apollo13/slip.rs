//! Detects slipping wheels: the encoder reports a speed without the acceleration that leads to it.
//!
//! Facts: seed 003 names this check as its next step; its later sketch prints accelerations beside
//! the encoder's distance. An accelerometer alone fails after a while because its offset adds up.
//! Its speed is therefore drawn to the encoder's, except while the two contradict each other.
//! During a contradiction the accelerometer gives the car's motion, for two seconds at most: after
//! that an offset of a hundredth of gravity has added up to 0.2 m/s.

/// Time over which distances are compared, seconds: the encoder prints centimetres.
const OVER_S: f64 = 0.3;
/// Maximum number of lines within that time.
const LINES_MAX: usize = 32;
/// Difference of distances from which they contradict each other, metres (0.13 m/s), and below
/// which they agree again.
const APART_M: [f64; 2] = [0.04, 0.015];
/// Time constant with which the speed is drawn to the encoder's, seconds.
const DRAWN_S: f64 = 0.5;
/// Time that the encoder stands before the offset is measured, and the time constant of the
/// measurement, seconds: a starting car moves a centimetre before the encoder reports it.
const STANDS_S: f64 = 0.5;
const LEARNED_S: f64 = 5.0;
/// Time constant with which the speed of a standing car decays, seconds.
const FORGOTTEN_S: f64 = 0.2;
/// Longest time for which the accelerometer is trusted, seconds.
const BELIEVED_S: f64 = 2.0;

/// A line's part in the comparison: time, distance by the encoder, distance by the accelerometer.
type Line = [f64; 3];

/// Comparison of encoder and accelerometer.
#[derive(Clone, Debug, Default)]
pub struct SlipWatch {
    lines: [Line; LINES_MAX],
    next: usize,
    /// Speed by the accelerometer, m/s.
    speed_m_s: f64,
    /// Acceleration measured at rest, m/s².
    offset_m_s2: Option<f64>,
    /// Duration of that measurement.
    learned_s: f64,
    /// Time since the last count of the encoder.
    stands_s: f64,
    /// Time since a slip was found; `None`: no slip.
    slips_s: Option<f64>,
    found: u64,
}

impl SlipWatch {
    /// Takes the encoder's distance `way_m` in `passed_s`, and the car's acceleration `ahead_m_s2`;
    /// returns the car's true distance.
    pub fn update(&mut self, passed_s: f64, way_m: f64, ahead_m_s2: f64) -> f64 {
        if !(passed_s > 0.0 && passed_s <= OVER_S && way_m.is_finite() && ahead_m_s2.is_finite()) {
            return way_m;
        }
        self.rest(passed_s, way_m, ahead_m_s2);
        let felt_m_s2 = ahead_m_s2 - self.offset_m_s2.unwrap_or(ahead_m_s2);
        self.speed_m_s += felt_m_s2 * passed_s;
        let felt_m = self.speed_m_s * passed_s;
        self.lines[self.next] = [passed_s, way_m, felt_m];
        self.next = (self.next + 1) % LINES_MAX;
        let [over_s, told_m, by_feel_m] = self.over();
        let apart_m = (told_m - by_feel_m).abs();
        match &mut self.slips_s {
            Some(since_s) => {
                *since_s += passed_s;
                if apart_m <= APART_M[1] || *since_s >= BELIEVED_S {
                    // The wheels grip again, or no other source is better than the wheels.
                    self.slips_s = None;
                    self.begin_anew(told_m / over_s);
                    return way_m;
                }
                felt_m
            }
            None if over_s >= 0.9 * OVER_S && apart_m > APART_M[0] => {
                self.slips_s = Some(0.0);
                self.found += 1;
                // Remove the wheels' distance that was counted since the slip began.
                way_m - (told_m - by_feel_m)
            }
            None => {
                self.speed_m_s += (told_m - by_feel_m) / over_s * passed_s / DRAWN_S;
                way_m
            }
        }
    }

    /// Whether the wheels slip.
    pub const fn is_slipping(&self) -> bool {
        self.slips_s.is_some()
    }

    /// Number of slips found.
    pub const fn found(&self) -> u64 {
        self.found
    }

    /// Measures the accelerometer's offset on a standing car.
    fn rest(&mut self, passed_s: f64, way_m: f64, ahead_m_s2: f64) {
        self.stands_s = if way_m == 0.0 {
            self.stands_s + passed_s
        } else {
            0.0
        };
        let offset = self.offset_m_s2.get_or_insert(ahead_m_s2);
        if self.stands_s >= STANDS_S && self.slips_s.is_none() {
            self.learned_s += passed_s;
            let part = passed_s / self.learned_s.min(LEARNED_S);
            *offset += (ahead_m_s2 - *offset) * part.min(1.0);
            self.speed_m_s -= self.speed_m_s * (passed_s / FORGOTTEN_S).min(1.0);
        }
    }

    /// Time and distances of the last [`OVER_S`].
    fn over(&self) -> Line {
        let mut sum = [0.0; 3];
        for back in 1..=LINES_MAX {
            let line = self.lines[(self.next + LINES_MAX - back) % LINES_MAX];
            if line[0] == 0.0 || sum[0] + line[0] > OVER_S {
                break;
            }
            for (sum, part) in sum.iter_mut().zip(line) {
                *sum += part;
            }
        }
        sum
    }

    fn begin_anew(&mut self, speed_m_s: f64) {
        self.lines = [[0.0; 3]; LINES_MAX];
        self.speed_m_s = speed_m_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Pcg32;

    const STEP_S: f64 = 0.01;

    /// A car that stands for 2 s and then moves by the given laws: speed of the wheels and of the
    /// car over the time since then. The encoder is read in centimetres, the accelerometer has an
    /// offset of 0.3 m/s² and a noise of 0.04. Returns the watch, its distance and the true
    /// distance.
    fn driven(
        until_s: f64,
        wheels: impl Fn(f64) -> f64,
        car: impl Fn(f64) -> f64,
    ) -> (SlipWatch, f64, f64) {
        let mut random = Pcg32::new(7);
        let mut watch = SlipWatch::default();
        let (mut rolled, mut printed, mut believed, mut gone) = (0.0, 0.0, 0.0, 0.0);
        let mut now_s = -2.0;
        while now_s < until_s {
            let of = |law: &dyn Fn(f64) -> f64, at_s: f64| if at_s < 0.0 { 0.0 } else { law(at_s) };
            let [before, after] = [of(&car, now_s), of(&car, now_s + STEP_S)];
            rolled += of(&wheels, now_s) * STEP_S;
            gone += after * STEP_S;
            let line = libm::round(rolled * 100.0) / 100.0;
            let felt = (after - before) / STEP_S + 0.3 + random.normal(0.04);
            believed += watch.update(STEP_S, line - printed, felt.clamp(-19.6, 19.6));
            printed = line;
            now_s += STEP_S;
        }
        (watch, believed, gone)
    }

    /// Speed of level 2, with a lag of 0.3 s.
    fn starts(at_s: f64) -> f64 {
        0.22 * (1.0 - libm::exp(-at_s / 0.3))
    }

    #[test]
    fn wheels_that_hold_are_believed() {
        let (watch, believed, gone) = driven(30.0, starts, starts);
        assert_eq!(watch.found(), 0);
        assert!((believed - gone).abs() < 0.02, "{believed} {gone}");
    }

    /// On ice: the wheels turn at 0.22 m/s for 1.5 s, the car stays in position. Of the wheels'
    /// 0.26 m less than a tenth of a metre counts.
    #[test]
    fn d1_wheels_that_spin_are_found_by_the_accelerometer() {
        let (watch, believed, _) = driven(1.5, starts, |_| 0.0);
        assert!(watch.is_slipping() && watch.found() == 1);
        assert!(believed.abs() < 0.1, "{believed}");
    }

    /// A box on the path stops the car at 3 s in 50 ms; the wheels turn on.
    #[test]
    fn d1_a_car_that_is_stopped_by_a_box_is_found_to_slip() {
        let car = |at_s: f64| starts(at_s) * (1.0 - (at_s - 3.0) / 0.05).clamp(0.0, 1.0);
        let (watch, believed, gone) = driven(4.5, starts, car);
        assert!(watch.is_slipping() && watch.found() == 1);
        assert!((believed - gone).abs() < 0.1, "{believed} {gone}");
    }

    /// After two seconds an offset may explain the whole difference: the wheels are trusted again.
    #[test]
    fn the_accelerometer_is_believed_for_two_seconds() {
        let (watch, believed, _) = driven(5.0, starts, |_| 0.0);
        assert!(!watch.is_slipping() && believed > 0.3, "{believed}");
    }

    #[test]
    fn what_is_no_number_changes_nothing() {
        let mut watch = SlipWatch::default();
        for bad in [
            [0.0, 0.1, 0.0],
            [0.01, f64::NAN, 0.0],
            [0.01, 0.1, f64::INFINITY],
        ] {
            let [passed_s, way_m, felt] = bad;
            let way = watch.update(passed_s, way_m, felt);
            assert!(way == way_m || way.is_nan());
        }
        assert!(watch.found() == 0 && !watch.is_slipping());
    }

    /// The encoder stands for half a second: then the first reading is the offset, later the mean
    /// of two and of three readings, and the speed halves with each tenth of a second. After one
    /// count the encoder no longer stands.
    #[test]
    fn the_offset_is_the_mean_of_what_is_felt_at_rest() {
        let mut watch = SlipWatch::default();
        for _ in 0..4 {
            watch.rest(0.1, 0.0, 1.0);
        }
        watch.speed_m_s = 0.8;
        let mut rest = |way_m: f64, felt: f64| {
            watch.rest(0.1, way_m, felt);
            (watch.offset_m_s2, watch.speed_m_s)
        };
        let is = |(offset, speed): (Option<f64>, f64), expected: [f64; 2]| {
            offset.is_some_and(|offset| (offset - expected[0]).abs() < 1e-9)
                && (speed - expected[1]).abs() < 1e-9
        };
        // 0.4 s and 0.1 s are half a second, or less by the last digit of the sum.
        let found = [rest(0.0, 2.0), rest(0.0, 6.0), rest(0.0, 1.0)];
        assert!(
            is(found[0], [2.0, 0.4]) && is(found[1], [4.0, 0.2]),
            "{found:?}"
        );
        assert!(is(found[2], [3.0, 0.1]), "{found:?}");
        assert!(is(rest(0.01, 9.0), [3.0, 0.1]) && is(rest(0.0, 9.0), [3.0, 0.1]));
    }

    /// Only the last 0.3 s count, which are four lines of a 16th of a second each.
    #[test]
    fn ways_are_compared_over_three_tenths_of_a_second() {
        let mut watch = SlipWatch::default();
        assert_eq!(watch.over(), [0.0; 3]);
        for way in [8.0, 1.0, 2.0, 4.0] {
            watch.lines[watch.next] = [0.062_5, way, 10.0 * way];
            watch.next += 1;
        }
        assert_eq!(watch.over(), [0.25, 15.0, 150.0]);
        watch.lines[watch.next] = [0.062_5, 16.0, 160.0];
        watch.next += 1;
        assert_eq!(watch.over(), [0.25, 23.0, 230.0]);
        // The first slot follows the last one.
        let mut watch = SlipWatch::default();
        watch.lines[LINES_MAX - 1] = [0.1, 1.0, 2.0];
        watch.lines[0] = [0.1, 4.0, 8.0];
        watch.next = 1;
        assert_eq!(watch.over(), [0.2, 5.0, 10.0]);
    }

    /// Lines with a time of 0 or of more than three tenths of a second, and those with
    /// not-a-number, have no effect.
    #[test]
    fn what_is_no_line_leaves_no_trace() {
        extern crate std;
        let fresh = std::format!("{:?}", SlipWatch::default());
        for [passed_s, way_m, felt] in [
            [0.0, 0.1, 0.0],
            [-0.01, 0.1, 0.0],
            [0.301, 0.1, 0.0],
            [f64::NAN, 0.1, 0.0],
            [0.01, f64::INFINITY, 0.0],
            [0.01, 0.1, f64::NAN],
        ] {
            let mut watch = SlipWatch::default();
            watch.update(passed_s, way_m, felt);
            assert_eq!(
                std::format!("{watch:?}"),
                fresh,
                "{passed_s} {way_m} {felt}"
            );
        }
        let mut watch = SlipWatch::default();
        watch.update(OVER_S, 0.1, 0.0);
        assert_ne!(std::format!("{watch:?}"), fresh);
    }
}
