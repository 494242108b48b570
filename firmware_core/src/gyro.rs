//! Heading from a gyroscope with samples summed elsewhere: the turn since the last reading, less
//! the offset, which is measured while the wheels stand still.

use core::time::Duration;

use protocols::Instant;

/// Rest time after which the offset is known well enough, and the longest averaging time.
const KNOWN_AFTER_S: f32 = 0.4;
const AVERAGED_S: f32 = 10.0;
/// Maximum plausible offset, degrees a second. A robot that turns faster at rest is being turned by
/// a person.
const OFFSET_MAX_DEG_S: f32 = 3.0;
/// Longest time between two readings; the turn between readings farther apart is unknown.
const APART_MAX: Duration = Duration::from_millis(500);

/// A gyroscope and its offset.
#[derive(Clone, Copy, Debug)]
pub struct Gyro {
    /// Time of the last reading, and its sum, hundredths of a degree.
    last: Option<(Instant, i32)>,
    offset_deg_s: f32,
    /// Rest time over which the offset is averaged.
    rest_s: f32,
}

/// Whether the wheels have turned since the reading before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wheels {
    /// Neither wheel has turned.
    AtRest,
    /// One wheel or both have turned.
    Turned,
}

impl Gyro {
    /// A gyroscope without readings.
    pub const fn new() -> Self {
        Self {
            last: None,
            offset_deg_s: 0.0,
            rest_s: 0.0,
        }
    }

    /// Discards the last reading after a failed one.
    pub const fn forget(&mut self) {
        self.last = None;
    }

    /// Takes the sum at `now`, hundredths of a degree, counter-clockwise; returns the turn since
    /// the previous reading, radians. `None` for the first reading, or while the offset is not
    /// known.
    pub fn turned(&mut self, now: Instant, sum: i32, wheels: Wheels) -> Option<f32> {
        let (at, before) = self.last.replace((now, sum))?;
        let apart = now - at;
        if apart > APART_MAX || apart.is_zero() {
            return None;
        }
        let time_s = apart.as_secs_f32();
        let turned_deg = sum.wrapping_sub(before) as f32 / 100.0;
        let rate = turned_deg / time_s;
        if wheels == Wheels::AtRest && rate.abs() <= OFFSET_MAX_DEG_S {
            self.rest_s = (self.rest_s + time_s).min(AVERAGED_S);
            self.offset_deg_s += (rate - self.offset_deg_s) * time_s / self.rest_s;
            // A resting robot does not turn, even if the last digit changes.
            return self.is_known().then_some(0.0);
        }
        let turn_deg = turned_deg - self.offset_deg_s * time_s;
        self.is_known().then(|| turn_deg.to_radians())
    }

    const fn is_known(&self) -> bool {
        self.rest_s >= KNOWN_AFTER_S
    }
}

impl Default for Gyro {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Duration = Duration::from_millis(40);

    /// Reads `count` times, with `more` hundredths added each time; returns the sum of the turns,
    /// degrees.
    fn run(gyro: &mut Gyro, from: (Instant, i32), count: u16, more: i32, wheels: Wheels) -> f32 {
        let mut turned = 0.0;
        for n in 1..=count {
            let at = from.0 + STEP * n.into();
            let sum = from.1 + more * i32::from(n);
            turned += gyro.turned(at, sum, wheels).unwrap_or(0.0);
        }
        turned.to_degrees()
    }

    /// At rest the sum grows by 4 hundredths of a degree in 40 ms: an offset of one degree a
    /// second. Each of 25 later steps is 104 hundredths: less the offset 1 degree, which is 25
    /// degrees a second.
    #[test]
    fn what_drifts_at_rest_is_no_turn() {
        let mut gyro = Gyro::new();
        let at_rest = run(&mut gyro, (Instant::ZERO, 0), 50, 4, Wheels::AtRest);
        assert!(at_rest.abs() < 1e-6, "{at_rest}");
        let from = (Instant::ZERO + STEP * 50, 200);
        let turned = run(&mut gyro, from, 25, 104, Wheels::Turned);
        assert!((turned - 25.0).abs() < 0.1, "{turned}");
    }

    /// Nine degrees a second at rest mean that a person turns the robot; the offset stays.
    #[test]
    fn somebody_who_turns_a_robot_at_rest_is_no_offset() {
        let mut gyro = Gyro::new();
        run(&mut gyro, (Instant::ZERO, 0), 50, 0, Wheels::AtRest);
        let from = (Instant::ZERO + STEP * 50, 0);
        let turned = run(&mut gyro, from, 25, 36, Wheels::AtRest);
        assert!((turned - 9.0).abs() < 0.1, "{turned}");
    }

    #[test]
    fn without_a_reading_before_or_an_offset_nothing_is_told() {
        let mut gyro = Gyro::new();
        assert_eq!(gyro.turned(Instant::ZERO, 0, Wheels::Turned), None);
        let at = Instant::ZERO + STEP;
        assert_eq!(gyro.turned(at, 100, Wheels::Turned), None);
        run(&mut gyro, (at, 100), 50, 0, Wheels::AtRest);
        gyro.forget();
        let later = Instant::from_secs(10);
        assert_eq!(gyro.turned(later, 900, Wheels::Turned), None);
        assert_eq!(gyro.turned(later + APART_MAX * 2, 0, Wheels::Turned), None);
    }

    /// The offset is the mean of the readings at rest: six of 1 degree a second and five of 2 give
    /// 16 / 11. A turn by 1.04 degrees in 40 ms, less this offset, is 0.98182 degrees.
    #[test]
    fn the_offset_is_the_mean_of_the_rest() {
        let mut gyro = Gyro::new();
        run(&mut gyro, (Instant::ZERO, 0), 6, 4, Wheels::AtRest);
        // The very first reading has no predecessor, so it gives no turn.
        let from = (Instant::ZERO + STEP * 6, 24);
        run(&mut gyro, from, 6, 8, Wheels::AtRest);
        let from = (Instant::ZERO + STEP * 12, 72);
        let turned = run(&mut gyro, from, 1, 104, Wheels::Turned);
        assert!(
            (turned - 1.04 + 0.04 * 17.0 / 11.0).abs() < 1e-5,
            "{turned}"
        );
    }

    /// The offset is a mean over at most ten seconds. A reading of 2.5 degrees a second for 40 ms
    /// therefore adds a hundredth of a degree a second to it.
    #[test]
    fn an_old_offset_changes_slowly() {
        let mut gyro = Gyro::new();
        run(&mut gyro, (Instant::ZERO, 0), 400, 0, Wheels::AtRest);
        run(
            &mut gyro,
            (Instant::ZERO + STEP * 400, 0),
            1,
            10,
            Wheels::AtRest,
        );
        assert!(
            (gyro.offset_deg_s - 0.01).abs() < 1e-5,
            "{}",
            gyro.offset_deg_s
        );
        // 13 hundredths are 3.25 degrees a second: a person turns the robot.
        run(
            &mut gyro,
            (Instant::ZERO + STEP * 401, 10),
            1,
            13,
            Wheels::AtRest,
        );
        assert!((gyro.offset_deg_s - 0.01).abs() < 1e-5);
    }

    /// Readings half a second apart still give a turn, readings farther apart do not.
    #[test]
    fn readings_too_far_apart_tell_no_turn() {
        let told = |apart| {
            let mut gyro = Gyro::new();
            run(&mut gyro, (Instant::ZERO, 0), 50, 0, Wheels::AtRest);
            let at = Instant::ZERO + STEP * 50 + apart;
            gyro.turned(at, 500, Wheels::Turned).map(f32::to_degrees)
        };
        assert!(told(APART_MAX).is_some_and(|turned| (turned - 5.0).abs() < 1e-4));
        assert_eq!(
            [
                told(APART_MAX + Duration::from_nanos(1)),
                told(Duration::ZERO)
            ],
            [None; 2]
        );
    }
}
