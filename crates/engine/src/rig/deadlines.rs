//! Deadlines of nodes and lines, and the set of lines to poll.

use protocols::Instant;

use super::line::{End, NEVER};

/// Deadlines of a rig's nodes and lines.
#[derive(Clone, Debug, Default)]
pub(super) struct Plan {
    /// Next poll of each node.
    pub(super) polls: Deadlines,
    /// Next delivery of each line, or next poll of a sender that had more bytes; two lines per
    /// link.
    pub(super) lines_due: Deadlines,
    /// Lines whose sender is polled in this round.
    pub(super) asked: LineSet,
    /// Outgoing lines of each node.
    pub(super) lines_from: Vec<LineSet>,
    /// Sender of each line.
    pub(super) senders: Vec<End>,
}

/// The earliest of many times, of nodes or lines, as a tournament tree: each pair plays for the
/// earlier time, up to the earliest of all. A change costs at most one match per level of the tree,
/// and a node or line without work costs nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct Deadlines {
    /// The earliest of all times at 1, the earliest of `2 n` and `2 n + 1` at `n`, the times
    /// themselves from `half` on.
    times: Vec<Instant>,
    half: usize,
}

impl Deadlines {
    /// Replaces all times by `len` others.
    pub(super) fn fill(&mut self, len: usize, times: impl Iterator<Item = Instant>) {
        self.half = len.next_power_of_two();
        self.times.clear();
        self.times.resize(self.half, NEVER);
        self.times.extend(times);
        self.times.resize(2 * self.half, NEVER);
        for place in (1..self.half).rev() {
            self.times[place] = self.times[2 * place].min(self.times[2 * place + 1]);
        }
    }

    /// The earliest time, or [`NEVER`].
    #[inline]
    pub(super) fn next(&self) -> Instant {
        self.times.get(1).copied().unwrap_or(NEVER)
    }

    /// Changes the time of `index`.
    #[inline]
    pub(super) fn set(&mut self, index: usize, at: Instant) {
        let mut place = self.half + index;
        if self.times[place] == at {
            return;
        }
        self.times[place] = at;
        while place > 1 {
            let winner = self.times[place].min(self.times[place ^ 1]);
            place /= 2;
            if self.times[place] == winner {
                break;
            }
            self.times[place] = winner;
        }
    }

    /// The first index from `from` on with a time up to `now`.
    #[inline]
    pub(super) fn due_from(&self, from: usize, now: Instant) -> Option<usize> {
        if from >= self.half || self.next() > now {
            return None;
        }
        let mut place = self.half + from;
        // Climb up and to the right until a winner is due, then descend to the first due time.
        while self.times[place] > now {
            while place % 2 == 1 {
                place /= 2;
            }
            if place == 0 {
                return None;
            }
            place += 1;
        }
        while place < self.half {
            place *= 2;
            place += usize::from(self.times[place] > now);
        }
        Some(place - self.half)
    }
}

/// A set of lines, by their numbers. Most rigs have fewer than 64.
#[derive(Clone, Debug, Default)]
pub(super) struct LineSet {
    /// The first 64 lines.
    first: u64,
    /// All others.
    more: Vec<u64>,
}

impl LineSet {
    /// An empty set with room for numbers below `len`.
    pub(super) fn with_room(len: usize) -> Self {
        Self {
            first: 0,
            more: vec![0; len.saturating_sub(64).div_ceil(64)],
        }
    }

    /// Removes all lines.
    #[inline]
    pub(super) fn clear(&mut self) {
        self.first = 0;
        if !self.more.is_empty() {
            self.more.fill(0);
        }
    }

    #[inline]
    pub(super) fn insert(&mut self, number: usize) {
        match number.checked_sub(64) {
            None => self.first |= 1 << number,
            Some(number) => self.more[number / 64] |= 1 << (number % 64),
        }
    }

    /// Adds all lines of `other`.
    #[inline]
    pub(super) fn insert_all(&mut self, other: &Self) {
        self.first |= other.first;
        for (word, other) in self.more.iter_mut().zip(&other.more) {
            *word |= other;
        }
    }

    /// Removes and returns the first line from `from` on.
    #[inline]
    pub(super) fn take_from(&mut self, from: usize) -> Option<usize> {
        if from < 64
            && let rest = self.first & u64::MAX << from
            && rest != 0
        {
            self.first &= !(rest & rest.wrapping_neg());
            return Some(rest.trailing_zeros() as usize);
        }
        if self.more.is_empty() {
            return None;
        }
        self.take_more(from.saturating_sub(64))
    }

    fn take_more(&mut self, from: usize) -> Option<usize> {
        let mut mask = u64::MAX << (from % 64);
        for (index, word) in self.more.iter_mut().enumerate().skip(from / 64) {
            let rest = *word & mask;
            if rest != 0 {
                *word &= !(rest & rest.wrapping_neg());
                return Some(64 + 64 * index + rest.trailing_zeros() as usize);
            }
            mask = u64::MAX;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// After any changes of times, the tournament gives the same next time and the same due
        /// indices as a search through all times.
        #[test]
        fn the_tournament_knows_what_a_search_finds(
            mut times in prop::collection::vec(0u64..40, 0..70),
            changes in prop::collection::vec((any::<prop::sample::Index>(), 0u64..40), 0..40),
        ) {
            let at = Instant::from_nanos;
            let mut deadlines = Deadlines::default();
            // Times of an earlier fill are removed.
            deadlines.fill(100, (0..100).map(at));
            deadlines.fill(times.len(), times.iter().copied().map(at));
            for (index, time) in changes {
                if !times.is_empty() {
                    let index = index.index(times.len());
                    times[index] = time;
                    deadlines.set(index, at(time));
                }
                let next = times.iter().min().copied();
                prop_assert_eq!(deadlines.next(), next.map_or(NEVER, at));
                for from in 0..=times.len() + 1 {
                    let due = (from..times.len()).find(|&index| times[index] <= time);
                    prop_assert_eq!(deadlines.due_from(from, at(time)), due);
                }
            }
        }
    }

    #[test]
    fn lines_are_asked_once_in_their_order() {
        let mut set = LineSet::with_room(130);
        for number in [129, 3, 64, 63, 3] {
            set.insert(number);
        }
        let taken = [0, 4, 0, 65, 0, 0].map(|from| set.take_from(from));
        assert_eq!(taken, [Some(3), Some(63), Some(64), Some(129), None, None]);
        set.insert(5);
        set.insert(129);
        set.clear();
        let mut others = LineSet::with_room(130);
        others.insert(128);
        set.insert_all(&others);
        assert_eq!(set.take_from(65), Some(128));
        assert_eq!([set.take_from(0), set.take_from(130)], [None, None]);
    }
    /// Lines 69 and 134 lie in different words; from 70 on only the second one is left.
    #[test]
    fn lines_before_the_first_one_asked_for_stay_in_the_set() {
        let mut set = LineSet::with_room(200);
        set.insert(69);
        set.insert(134);
        let taken = [70, 70, 0].map(|from| set.take_from(from));
        assert_eq!(taken, [Some(134), None, Some(69)]);
    }

    /// The lines of another set come in, in each word; those that were in stay.
    #[test]
    fn the_lines_of_another_set_are_added() {
        let mut set = LineSet::with_room(200);
        let mut other = LineSet::with_room(200);
        for number in [1, 70, 135] {
            set.insert(number);
            other.insert(number + 1);
        }
        other.insert(70);
        set.insert_all(&other);
        let mut from = 0;
        let all = core::iter::from_fn(|| {
            let number = set.take_from(from)?;
            from = number + 1;
            Some(number)
        });
        assert_eq!(all.collect::<Vec<_>>(), [1, 2, 70, 71, 135, 136]);
    }
}
