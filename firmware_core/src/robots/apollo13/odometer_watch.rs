//! Detects an odometer with wrong or missing data, and decides when to restart it.
//!
//! Its microcontroller measures the gyroscope's offset when it starts, from samples at rest. It
//! starts whenever its port is opened, and by itself after a loss of supply. If the odometer fell
//! silent, or restarted while the car was rolling, the car stops and opens its port to restart it.
//! If it stays silent, the car continues with the odometry of its board.

use core::time::Duration;

use protocols::Instant;

/// Silence after which the odometer counts as silent. Lines come each 10 ms, and no scheduler
/// delays them this long.
const SILENT: Duration = Duration::from_millis(250);
/// The car counts as resting if it had no motor command and no wheel pulse for this long: its motor
/// has a lag of 0.3 s.
const AT_REST: Duration = Duration::from_millis(1_200);
/// Time between the measurement of the offset and the first line.
const CALIBRATED_BEFORE: Duration = Duration::from_millis(200);
/// Longest wait for the car to come to rest. After it a silent odometer is started in the rolling
/// car, which an operator may drive by hand, and started again once the car rests.
const PATIENCE: Duration = Duration::from_secs(3);
/// Longest wait for the first line after the port was opened: it takes 1.10 s, with the later
/// sketch 2.24 s.
const ANSWERS: Duration = Duration::from_millis(2_800);
/// Attempts before the car continues without the odometer.
const ATTEMPTS: u8 = 3;
/// Time without the odometer before another attempt.
const ONCE_MORE: Duration = Duration::from_secs(30);

/// State of the odometer's restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    /// The odometer is valid; nothing to do.
    #[default]
    Fine,
    /// The car has been coming to rest since this time.
    Resting(Instant),
    /// The port was opened at this time.
    Opened(Instant),
    /// The odometer has been lost since this time.
    Gone(Instant),
}

/// The watch.
#[derive(Clone, Debug, Default)]
pub struct OdometerWatch {
    state: State,
    heard: Option<Instant>,
    /// Time of the last motor command or wheel pulse.
    rolled: Option<Instant>,
    /// Whether the offset was measured while the car was rolling.
    is_misled: bool,
    attempts: u8,
    is_to_be_opened: bool,
    openings: u64,
}

impl OdometerWatch {
    /// Takes the arrival of a line; `is_first` marks the first one after a start of the
    /// microcontroller.
    pub fn hear(&mut self, now: Instant, is_first: bool) {
        let is_first = self.heard.replace(now).is_none() || is_first;
        let was_rolling = |rolled| now - rolled < AT_REST + CALIBRATED_BEFORE;
        match self.state {
            // Lines from before its restart still arrive.
            State::Opened(_) if self.is_misled && !is_first => {}
            _ if is_first && self.rolled.is_some_and(was_rolling) => {
                (self.is_misled, self.attempts) = (true, 0);
                self.state = State::Resting(now);
            }
            State::Resting(_) if self.is_misled && !is_first => {}
            _ => {
                self.is_misled = false;
                self.state = State::Fine;
            }
        }
    }

    /// Notes a motor command or a wheel pulse.
    pub const fn roll(&mut self, now: Instant) {
        self.rolled = Some(now);
    }

    /// Advances the state in time.
    pub fn poll(&mut self, now: Instant) {
        let is_silent = self.is_silent(now);
        match self.state {
            State::Fine if is_silent => {
                self.attempts = 0;
                self.state = State::Resting(now);
            }
            State::Resting(began) => {
                let since = self.rolled.map_or(began, |rolled| rolled.max(began));
                if now - since >= AT_REST || is_silent && now - began >= PATIENCE {
                    self.attempts += 1;
                    self.openings += 1;
                    self.is_to_be_opened = true;
                    self.state = State::Opened(now);
                }
            }
            State::Opened(at) if now - at >= ANSWERS => {
                self.state = match self.attempts >= ATTEMPTS {
                    true => State::Gone(now),
                    false => State::Resting(now),
                };
            }
            State::Gone(since) if is_silent && now - since >= ONCE_MORE => {
                self.attempts = ATTEMPTS - 1;
                self.state = State::Resting(now);
            }
            _ => {}
        }
    }

    /// Whether no line has come for longer than usual.
    pub fn is_silent(&self, now: Instant) -> bool {
        now - self.heard.unwrap_or(Instant::ZERO) > SILENT
    }

    /// Whether the gyroscope's offset was measured while the car was rolling. Until the odometer is
    /// started again at rest, its heading drifts.
    pub const fn is_misled(&self) -> bool {
        self.is_misled
    }

    /// Whether the car must not drive to positions: its pose is unknown. This includes the time
    /// before the first line, while the offset is measured.
    pub const fn wants_rest(&self) -> bool {
        match self.state {
            State::Fine => self.heard.is_none(),
            State::Resting(_) | State::Opened(_) => true,
            State::Gone(_) => false,
        }
    }

    /// Whether the port must be opened now; true once per restart.
    pub const fn take_opening(&mut self) -> bool {
        core::mem::replace(&mut self.is_to_be_opened, false)
    }

    /// Number of times that the port was opened.
    pub const fn openings(&self) -> u64 {
        self.openings
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(ms)
    }

    /// Polls each 10 ms; returns the times at which the port was opened.
    fn openings(watch: &mut OdometerWatch, from_ms: u64, until_ms: u64) -> Vec<u64> {
        let times = (from_ms..until_ms).step_by(10);
        let opened = |ms: &u64| {
            watch.poll(at(*ms));
            watch.take_opening()
        };
        times.filter(opened).collect()
    }

    /// The odometer is silent from 1 s on: this is noticed after 250 ms. The port is reopened 1.2 s
    /// later, in all three times every 4 s, and again after half a minute.
    #[test]
    fn a_silent_odometer_is_opened_three_times_and_then_done_without() {
        let mut watch = OdometerWatch::default();
        watch.hear(at(1_000), true);
        assert!(openings(&mut watch, 1_000, 1_250).is_empty() && !watch.wants_rest());
        let opened = openings(&mut watch, 1_250, 13_300);
        assert_eq!(opened, [2_460, 6_460, 10_460]);
        assert!(!watch.wants_rest());
        assert_eq!(openings(&mut watch, 13_300, 45_000), [44_460]);
    }

    /// The odometer answers: the car may drive again.
    #[test]
    fn an_odometer_that_answers_is_believed() {
        let mut watch = OdometerWatch::default();
        watch.hear(at(0), true);
        assert_eq!(openings(&mut watch, 0, 2_000), [1_460]);
        assert!(watch.wants_rest());
        watch.hear(at(2_000), true);
        assert!(!watch.wants_rest() && openings(&mut watch, 2_000, 2_200).is_empty());
    }

    /// Silent from 0 on in a car that an operator drives: opened after 3 s anyway.
    #[test]
    fn an_odometer_is_started_in_a_car_that_rolls_on() {
        let mut watch = OdometerWatch::default();
        let mut opened = Vec::new();
        for ms in (0..4_000).step_by(10) {
            watch.roll(at(ms));
            watch.poll(at(ms));
            opened.extend(watch.take_opening().then_some(ms));
        }
        assert_eq!(opened, [3_260]);
    }

    /// A start at 2 s while the car rolls measured a wrong offset, so the car rests and restarts
    /// the odometer. Only the first line after a start proves a good offset.
    #[test]
    fn an_odometer_that_started_while_the_car_rolled_is_started_at_rest() {
        let mut watch = OdometerWatch::default();
        watch.hear(at(0), true);
        let mut opened = Vec::new();
        for ms in (0..6_000).step_by(10) {
            if (500..2_000).contains(&ms) {
                watch.roll(at(ms));
            }
            watch.hear(at(ms), [2_000, 3_500].contains(&ms));
            assert_eq!(watch.wants_rest(), (2_000..3_500).contains(&ms), "{ms}");
            assert_eq!(watch.is_misled(), watch.wants_rest(), "{ms}");
            watch.poll(at(ms));
            opened.extend(watch.take_opening().then_some(ms));
        }
        assert_eq!(opened, [3_200]);
    }

    /// The car gets a drive order 0.2 s after all was switched on and waits for the first line at
    /// 0.27 s. A car that an operator drove meanwhile restarts its odometer at rest.
    #[test]
    fn a_car_waits_for_its_first_line() {
        let mut watch = OdometerWatch::default();
        watch.poll(at(200));
        assert!(watch.wants_rest());
        let mut by_hand = watch.clone();
        watch.hear(at(270), false);
        assert!(!watch.wants_rest() && !watch.is_misled());
        by_hand.roll(at(200));
        by_hand.hear(at(270), false);
        assert!(by_hand.wants_rest() && by_hand.is_misled());
        assert_eq!(openings(&mut by_hand, 270, 1_480), [1_470]);
    }

    /// 1.2 s for the motor's lag, and 0.2 s for the offset: 1.4 s after it rolled the car was at
    /// rest.
    #[test]
    fn a_start_is_at_rest_1400_ms_after_the_car_rolled() {
        let is_misled = |ms: u64| {
            let mut watch = OdometerWatch::default();
            watch.roll(at(1_000));
            watch.hear(at(1_000 + ms), true);
            watch.is_misled()
        };
        assert_eq!([1_399, 1_400].map(is_misled), [true, false]);
    }

    /// A line each 250 ms is frequent enough: the odometer does not count as silent.
    #[test]
    fn silence_is_longer_than_a_quarter_of_a_second() {
        let mut watch = OdometerWatch::default();
        watch.hear(at(1_000), false);
        assert_eq!(
            [1_250, 1_251].map(|ms| watch.is_silent(at(ms))),
            [false, true]
        );
    }

    /// The odometer is silent from 1 s on, and sends again before its port is opened: the watch
    /// does not restart it.
    #[test]
    fn an_odometer_that_is_heard_again_is_not_opened() {
        let mut watch = OdometerWatch::default();
        watch.hear(at(1_000), true);
        assert!(openings(&mut watch, 1_000, 1_500).is_empty() && watch.wants_rest());
        watch.hear(at(1_500), false);
        assert!(!watch.wants_rest());
        let mut opened = Vec::new();
        for ms in (1_500..6_000).step_by(10) {
            watch.hear(at(ms), false);
            watch.poll(at(ms));
            opened.extend(watch.take_opening().then_some(ms));
        }
        assert!(opened.is_empty() && watch.openings() == 0);
    }

    /// After the opening, the lines continue without a first line after a start: the port has no
    /// reset line.
    #[test]
    fn an_odometer_that_goes_on_behind_its_opening_is_believed() {
        let mut watch = OdometerWatch::default();
        watch.hear(at(0), true);
        assert_eq!(openings(&mut watch, 0, 2_000), [1_460]);
        watch.hear(at(2_000), false);
        assert!(!watch.wants_rest() && !watch.is_misled());
        assert_eq!(watch.openings(), 1);
    }
}
