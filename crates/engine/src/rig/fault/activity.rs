//! Activity of a fault: a window, periodic times within it, or the time after an event.

use core::time::Duration;

use emulators::rng::Rng;
use protocols::Instant;

/// A span of time, its end excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First instant inside.
    pub from: Instant,
    /// First instant after.
    pub until: Instant,
}

impl Window {
    /// The whole run.
    pub const ALWAYS: Self = Self {
        from: Instant::ZERO,
        until: Instant::from_nanos(u64::MAX),
    };

    /// Whether the window contains no time.
    pub fn is_empty(self) -> bool {
        self.until <= self.from
    }

    /// Whether `now` lies inside.
    pub fn contains(self, now: Instant) -> bool {
        self.from <= now && now < self.until
    }
}

/// Repeated active periods within a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Spells {
    /// Time from the start of one period to the start of the next.
    pub every: Duration,
    /// Length of each period.
    pub lasting: Duration,
    /// Maximum number of repetitions.
    pub count: Option<u32>,
    /// Seed and name of the random stream, if each period begins and ends at random times. Then
    /// `lasting` is the mean length.
    pub dice: Option<(u64, String)>,
}

/// Event on the line that a fault waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// The byte with this number, counted from zero as sent.
    Byte(u64),
    /// The frame with this number, counted from zero. Frames are separated by a pause of two
    /// characters.
    Frame(u64),
}

/// The activity of a fault.
#[derive(Clone, Debug, PartialEq)]
pub struct Activity {
    /// Window of the fault. While the fault waits for its trigger, the length of the window counts
    /// from the trigger.
    pub window: Window,
    /// Active periods within the window; `None` if the fault is active all the time.
    pub spells: Option<Spells>,
    /// The awaited event; `None` after it has occurred.
    pub trigger: Option<Trigger>,
}

impl From<Window> for Activity {
    fn from(window: Window) -> Self {
        Self {
            window,
            spells: None,
            trigger: None,
        }
    }
}

impl Activity {
    /// The time around `now` in which the fault is active, if it is active now.
    pub fn spell_at(&self, now: Instant) -> Option<Window> {
        if self.trigger.is_some() || !self.window.contains(now) {
            return None;
        }
        let Some(spells) = &self.spells else {
            return Some(self.window);
        };
        let period = nanos(spells.every).max(1);
        let spell = self.spell((now - self.window.from).as_nanos() / u128::from(period))?;
        spell.contains(now).then_some(spell)
    }

    /// The next time after `now` at which the fault begins to be active; `None` if there is none,
    /// or if it depends on an event.
    pub(super) fn next_begin(&self, now: Instant) -> Option<Instant> {
        if self.trigger.is_some() || self.is_over(now) {
            return None;
        }
        let spells = self.spells.as_ref();
        let every = spells.map_or(u64::MAX, |spells| nanos(spells.every).max(1));
        let since = now.as_nanos().saturating_sub(self.window.from.as_nanos());
        let number = u128::from(since / every);
        let begins = [number, number + 1].map(|number| Some(self.spell(number)?.from));
        begins.into_iter().flatten().find(|&from| from > now)
    }

    /// Whether the fault is never active from `now` on.
    pub(super) fn is_over(&self, now: Instant) -> bool {
        self.trigger.is_none() && self.window.until <= now
    }

    /// Whether the fault is active at `now`.
    pub fn is_active(&self, now: Instant) -> bool {
        self.spell_at(now).is_some()
    }

    /// The period with this number, cut to the window; `None` after the last one.
    pub fn spell(&self, number: u128) -> Option<Window> {
        let Some(spells) = &self.spells else {
            return (number == 0 && !self.window.is_empty()).then_some(self.window);
        };
        if spells
            .count
            .is_some_and(|count| number >= u128::from(count))
        {
            return None;
        }
        let number = u64::try_from(number).ok()?;
        let (mut offset, mut length) = (0, nanos(spells.lasting));
        if let Some((seed, name)) = &spells.dice {
            let mut rng = Rng::stream(*seed, &format!("{name}.{number}"));
            length = rng.below(2 * length + 1).min(nanos(spells.every));
            offset = rng.below(nanos(spells.every) - length + 1);
        }
        let begin = nanos(spells.every)
            .checked_mul(number)?
            .checked_add(offset)?;
        let from = self.window.from.as_nanos().checked_add(begin)?;
        let until = from
            .saturating_add(length)
            .min(self.window.until.as_nanos());
        let from = Instant::from_nanos(from);
        (from < self.window.until).then_some(Window {
            from,
            until: Instant::from_nanos(until),
        })
    }

    /// Handles the awaited event, which occurred at `now`.
    pub fn fire(&mut self, now: Instant) {
        let length = self.window.until.as_nanos() - self.window.from.as_nanos();
        self.trigger = None;
        self.window = Window {
            from: now,
            until: Instant::from_nanos(now.as_nanos().saturating_add(length)),
        };
    }

    /// Ends the activity at `at`, if it would continue for longer. A fault that still waits for its
    /// event was never active.
    pub fn end(&mut self, at: Instant) {
        if self.trigger.take().is_some() {
            self.window.from = at;
        }
        self.window.until = self.window.until.min(at);
    }
}

fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX / 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spells(count: Option<u32>, dice: Option<(u64, String)>) -> Activity {
        Activity {
            window: Window {
                from: Instant::from_secs(10),
                until: Instant::from_secs(20),
            },
            spells: Some(Spells {
                every: Duration::from_secs(3),
                lasting: Duration::from_secs(1),
                count,
                dice,
            }),
            trigger: None,
        }
    }

    /// By hand: 10-11, 13-14, 16-17, 19-20 s.
    #[test]
    fn spells_come_at_regular_times_within_the_window() {
        let at = |activity: &Activity| -> Vec<u64> {
            let active = |&second: &u64| activity.is_active(Instant::from_secs(second));
            (0..30).filter(active).collect()
        };
        assert_eq!(at(&spells(None, None)), [10, 13, 16, 19]);
        assert_eq!(at(&spells(Some(2), None)), [10, 13]);
        assert_eq!(at(&spells(Some(0), None)), [0; 0]);
        // A period longer than the 584 years that a counter of nanoseconds covers occurs once.
        let mut once = spells(None, None);
        once.spells.as_mut().expect("it has some").every = Duration::MAX;
        assert_eq!(at(&once), [10]);
    }

    #[test]
    fn spells_by_chance_stay_within_their_periods_and_come_again_alike() {
        let activity = spells(None, Some((1, "clog".to_owned())));
        for number in 0..3 {
            let spell = activity
                .spell(u128::from(number))
                .expect("within the window");
            assert!(spell.from >= Instant::from_secs(10 + 3 * number));
            assert!(spell.until <= Instant::from_secs(13 + 3 * number));
            assert_eq!(activity.spell(u128::from(number)), Some(spell));
        }
        assert_ne!(
            activity.spell(0),
            spells(None, Some((2, "clog".to_owned()))).spell(0)
        );
    }

    #[test]
    fn what_waits_for_an_event_lasts_as_long_from_there_on() {
        let mut activity = Activity::from(Window {
            from: Instant::ZERO,
            until: Instant::from_secs(2),
        });
        activity.trigger = Some(Trigger::Byte(7));
        assert!(!activity.is_active(Instant::from_secs(1)));
        activity.fire(Instant::from_secs(5));
        assert!(activity.is_active(Instant::from_millis(6_999)));
        assert!(!activity.is_active(Instant::from_secs(7)));
    }

    #[test]
    fn what_ends_while_it_waits_was_never_at_work() {
        let mut activity = Activity::from(Window::ALWAYS);
        activity.trigger = Some(Trigger::Frame(3));
        activity.end(Instant::from_secs(1));
        assert!(activity.window.is_empty());
        assert_eq!(activity.spell(0), None);
    }

    /// On average two active seconds of each ten, so from none to four, anywhere within the ten.
    /// With nine on average, never more than ten.
    #[test]
    fn spells_by_chance_have_their_mean_length() {
        let spells = |lasting: u64| {
            let activity = Activity {
                window: Window::ALWAYS,
                spells: Some(Spells {
                    every: Duration::from_secs(10),
                    lasting: Duration::from_secs(lasting),
                    count: None,
                    dice: Some((3, "clog".to_owned())),
                }),
                trigger: None,
            };
            let spell = |number: u64| {
                let Window { from, until } = activity.spell(number.into()).expect("no end");
                let [begin, end] = [from, until].map(|at| at.as_millis() - 10_000 * number);
                [begin, end - begin]
            };
            (0..1_000).map(spell).collect::<Vec<_>>()
        };
        let short = spells(2);
        let lengths = short.iter().map(|[_, length]| *length);
        let (longest, sum) = (lengths.clone().max(), lengths.sum::<u64>());
        assert!(
            (3_900..=4_000).contains(&longest.expect("many")),
            "{longest:?}"
        );
        assert!((1_900_000..2_100_000).contains(&sum), "{sum}");
        let ends = short.iter().map(|[begin, length]| begin + length);
        assert!((9_900..=10_000).contains(&ends.max().expect("many")));
        assert!(short.iter().map(|[begin, _]| *begin).min().expect("many") < 100);
        let long = spells(9);
        assert!(long.iter().all(|[begin, length]| begin + length <= 10_000));
        assert!(
            long.iter()
                .any(|[begin, length]| (*begin, *length) == (0, 10_000))
        );
    }
    /// A mean of 1 ns: each period lasts 0, 1 or 2 ns.
    #[test]
    fn the_shortest_spells_are_twice_as_long_as_their_mean_at_most() {
        let mut activity = spells(None, Some((3, "clog".to_owned())));
        activity.window = Window::ALWAYS;
        activity.spells.as_mut().expect("it has some").lasting = Duration::from_nanos(1);
        let length = |number: u64| {
            let spell = activity.spell(number.into()).expect("no end");
            (spell.until - spell.from).as_nanos()
        };
        let lengths: std::collections::BTreeSet<u128> = (0..100).map(length).collect();
        assert_eq!(lengths.into_iter().collect::<Vec<_>>(), [0, 1, 2]);
    }

    /// By hand: 10, 13, 16 and 19 s, and no begin is after the end of the window.
    #[test]
    fn the_next_begin_is_the_first_one_that_comes() {
        let next = |activity: &Activity, at_ms: u64| {
            let begin = activity.next_begin(Instant::from_millis(at_ms))?;
            Some(begin.as_millis() / 1_000)
        };
        let all = spells(None, None);
        let times = [0, 9_999, 10_000, 12_999, 13_000, 18_999, 19_000, 20_000];
        let expected = [
            Some(10),
            Some(10),
            Some(13),
            Some(13),
            Some(16),
            Some(19),
            None,
            None,
        ];
        assert_eq!(times.map(|at| next(&all, at)), expected);
        let two = spells(Some(2), None);
        let expected = [Some(10), Some(13), None];
        assert_eq!([0, 10_000, 13_000].map(|at| next(&two, at)), expected);
        let whole = Activity::from(all.window);
        let expected = [Some(10), None, None];
        assert_eq!([9_999, 10_000, 30_000].map(|at| next(&whole, at)), expected);
        let mut waiting = spells(None, None);
        waiting.trigger = Some(Trigger::Byte(0));
        assert_eq!(next(&waiting, 0), None);
    }

    /// From 1 to 3 s, two seconds: at 5 s it lasts until 7 s.
    #[test]
    fn a_window_keeps_its_length_when_its_event_comes() {
        let mut activity = Activity::from(Window {
            from: Instant::from_secs(1),
            until: Instant::from_secs(3),
        });
        activity.trigger = Some(Trigger::Frame(1));
        assert!(!activity.is_over(Instant::from_secs(9)));
        activity.fire(Instant::from_secs(5));
        let window = Window {
            from: Instant::from_secs(5),
            until: Instant::from_secs(7),
        };
        assert_eq!((activity.window, activity.trigger), (window, None));
        let is_over = [6_999, 7_000, 7_001].map(|ms| activity.is_over(Instant::from_millis(ms)));
        assert_eq!(is_over, [false, true, true]);
    }

    /// A window of 9 s has room for three spells of 3 s: the fourth would begin at its end. The
    /// last one is cut if the window is shorter.
    #[test]
    fn no_spell_begins_at_the_end_of_the_window() {
        let ends = |until_ms: u64| {
            let mut activity = spells(None, None);
            activity.window.until = Instant::from_millis(until_ms);
            let spells = (0..5).map_while(|number| activity.spell(number));
            spells
                .map(|spell| spell.until.as_millis())
                .collect::<Vec<_>>()
        };
        assert_eq!(ends(19_000), [11_000, 14_000, 17_000]);
        assert_eq!(ends(19_001), [11_000, 14_000, 17_000, 19_001]);
        assert_eq!(ends(16_500), [11_000, 14_000, 16_500]);
    }

    /// Without spells there is one, the window, unless it is empty.
    #[test]
    fn a_window_without_spells_is_one_spell() {
        let window = |from, until| Window {
            from: Instant::from_secs(from),
            until: Instant::from_secs(until),
        };
        let activity = Activity::from(window(1, 3));
        assert_eq!(activity.spell(0), Some(window(1, 3)));
        assert_eq!(activity.spell(1), None);
        assert_eq!(Activity::from(window(3, 3)).spell(0), None);
        let empty = [(3, 4), (3, 3), (4, 3)].map(|(from, until)| window(from, until).is_empty());
        assert_eq!(empty, [false, true, true]);
    }

    /// A fault that ends later than it would have ends as before.
    #[test]
    fn an_end_never_makes_a_fault_longer() {
        let until = |at: u64| {
            let mut activity = spells(None, None);
            activity.end(Instant::from_secs(at));
            (
                activity.window.from.as_millis(),
                activity.window.until.as_millis(),
            )
        };
        assert_eq!(until(15), (10_000, 15_000));
        assert_eq!(until(25), (10_000, 20_000));
    }
}
