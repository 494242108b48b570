//! Shortening of long silences of a capture for the replay.
//!
//! A program must run through every silence, and a changed clock or a suspended recorder can make a
//! silence of days. No part of a robot waits for longer than [`SILENCE_MAX`], so the behaviour
//! after that time is the same as after a day.

use core::time::Duration;

use protocols::Instant;

use super::{Arrival, Passage, Recorded};
use crate::divergence::Track;

/// Maximum silence of all links that is played at full length.
pub const SILENCE_MAX: Duration = Duration::from_secs(60);

/// A silence of all links that is played as if it had lasted [`SILENCE_MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Silence {
    /// Time of the last event before it, in the capture.
    pub from: Instant,
    /// Its length.
    pub lasted: Duration,
    /// Time removed from this silence and from all earlier ones.
    cut: Duration,
}

/// The long silences of a capture, oldest first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Silences(Vec<Silence>);

impl Silences {
    /// The long silences between `times`, and before the first of them.
    fn between(mut times: Vec<Instant>) -> Self {
        times.push(Instant::ZERO);
        times.sort_unstable();
        let mut cut = Duration::ZERO;
        let long = |pair: &[Instant]| {
            let lasted = pair[1] - pair[0];
            let too_much = lasted
                .checked_sub(SILENCE_MAX)
                .filter(|rest| !rest.is_zero())?;
            cut += too_much;
            let from = pair[0];
            Some(Silence { from, lasted, cut })
        };
        Self(times.windows(2).filter_map(long).collect())
    }

    /// The silences.
    pub fn all(&self) -> &[Silence] {
        &self.0
    }

    /// Replay time for the capture's time `at`.
    pub fn played_at(&self, at: Instant) -> Instant {
        let begun = self.0.partition_point(|silence| silence.from < at);
        let Some(last) = begun.checked_sub(1).map(|index| self.0[index]) else {
            return at;
        };
        let end = last.from + last.lasted;
        // Within a silence nothing happens; its end is the lower limit.
        Instant::ZERO + (at.max(end) - Instant::ZERO).saturating_sub(last.cut)
    }

    /// The capture's time for the replay time `played`.
    pub fn captured_at(&self, played: Instant) -> Instant {
        let is_over = |silence: &Silence| self.played_at(silence.from) + SILENCE_MAX <= played;
        let over = self.0.partition_point(is_over);
        let cut = over.checked_sub(1).map(|index| self.0[index].cut);
        played + cut.unwrap_or_default()
    }
}

impl Recorded {
    /// The recording with each silence of all links shortened to at most [`SILENCE_MAX`], and the
    /// shortened silences.
    #[must_use]
    pub fn shortened(self) -> (Self, Silences) {
        let times = self.links.iter().flat_map(Passage::times);
        let silences = Silences::between(times.chain([self.end]).collect());
        if silences.0.is_empty() {
            return (self, silences);
        }
        let links = self.links.into_iter().map(|one| one.at(&silences));
        let shortened = Self {
            links: links.collect(),
            end: silences.played_at(self.end),
            zero: self.zero,
        };
        (shortened, silences)
    }
}

impl Passage {
    pub(super) fn times(&self) -> impl Iterator<Item = Instant> {
        let arrivals = self.arrivals.iter().chain(&self.heard);
        let sent = self.sent.pieces().map(|(at, _)| at);
        let opened = self.opened.iter().copied();
        arrivals.map(|arrival| arrival.at).chain(sent).chain(opened)
    }

    /// The passage at its replay times.
    fn at(self, silences: &Silences) -> Self {
        let arrivals = |list: Vec<Arrival>| {
            let list = list.into_iter().map(|arrival| Arrival {
                at: silences.played_at(arrival.at),
                ..arrival
            });
            list.collect()
        };
        let mut sent = Track::default();
        for (at, bytes) in self.sent.pieces() {
            sent.push(silences.played_at(at), bytes);
        }
        let opened = self.opened.iter().map(|&at| silences.played_at(at));
        Self {
            opened: opened.collect(),
            arrivals: arrivals(self.arrivals),
            heard: arrivals(self.heard),
            sent,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: Duration = Duration::from_secs(86_400);

    fn at(seconds: u64) -> Instant {
        Instant::from_secs(seconds)
    }

    /// A link on which a byte arrives at each of `times`.
    fn recorded(times: &[Instant]) -> Recorded {
        let arrival = |&at: &Instant| Arrival {
            at,
            bytes: vec![0xFA],
        };
        let passage = Passage {
            link: "lidar".to_owned(),
            arrivals: times.iter().map(arrival).collect(),
            ..Passage::default()
        };
        Recorded {
            links: vec![passage],
            end: times.iter().copied().max().unwrap_or_default(),
            zero: Instant::ZERO,
        }
    }

    fn arrivals(recorded: &Recorded) -> Vec<Instant> {
        recorded.links[0]
            .arrivals
            .iter()
            .map(|one| one.at)
            .collect()
    }

    #[test]
    fn a_day_of_silence_is_played_as_a_minute_and_told() {
        let (played, silences) = recorded(&[at(5), at(5) + DAY, at(6) + DAY]).shortened();
        assert_eq!(arrivals(&played), [at(5), at(65), at(66)]);
        assert_eq!(played.end, at(66));
        let [silence] = silences.all() else {
            panic!("{silences:?}");
        };
        assert_eq!((silence.from, silence.lasted), (at(5), DAY));
    }

    #[test]
    fn a_silence_before_the_first_byte_is_one_too() {
        let (played, _) = recorded(&[at(0) + DAY]).shortened();
        assert_eq!(arrivals(&played), [at(60)]);
    }

    #[test]
    fn a_silence_of_a_minute_is_left_alone() {
        let whole = recorded(&[at(1), at(61)]);
        let (played, silences) = whole.clone().shortened();
        assert_eq!((played, silences), (whole, Silences::default()));
    }

    /// Times of a replay are converted back to times of the capture.
    #[test]
    fn each_time_that_is_played_leads_back_to_its_own() {
        let times = [at(5), at(5) + DAY, at(6) + DAY, at(6) + 3 * DAY];
        let (played, silences) = recorded(&times).shortened();
        let back = arrivals(&played)
            .into_iter()
            .map(|at| silences.captured_at(at));
        assert_eq!(back.collect::<Vec<_>>(), times);
        assert_eq!(silences.captured_at(at(30)), at(30), "within a silence");
    }

    /// The bytes of both directions, those of the program, and the openings move together. Times of
    /// a replay lead back from the end of a silence on.
    #[test]
    fn everything_on_a_link_moves_with_the_silence() {
        let arrival = |at: Instant| Arrival { at, bytes: vec![1] };
        let mut sent = Track::default();
        sent.push(at(7) + DAY, b"s");
        let mut whole = recorded(&[at(5), at(6) + DAY]);
        whole.links[0].heard = vec![arrival(at(6) + DAY)];
        whole.links[0].sent = sent;
        whole.links[0].opened = vec![at(5), at(8) + DAY];
        whole.links[0].baud = 9_600;
        whole.end = at(9) + DAY;
        let (played, silences) = whole.shortened();
        let own = &played.links[0];
        // The silence from 5 s on has lasted for a day and a second, and is played as 60 s.
        assert_eq!(own.heard, [arrival(at(65))]);
        assert_eq!(own.sent.pieces().next(), Some((at(66), &b"s"[..])));
        assert_eq!(own.opened, [at(5), at(67)]);
        assert_eq!((own.baud, &*own.link), (9_600, "lidar"));
        assert_eq!(played.end, at(68));
        assert_eq!(silences.captured_at(at(64)), at(64));
        assert_eq!(silences.captured_at(at(65)), at(6) + DAY);
        assert_eq!(silences.played_at(at(5)), at(5));
        assert_eq!(silences.played_at(at(70)), at(65), "within the silence");
    }
}
