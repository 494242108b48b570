//! Contacts of the robot, for several readers that query at their own times.

use std::collections::VecDeque;

use emulators::world::Contact;
use protocols::Instant;

use super::check::HARMLESS_M_S;

/// Number of stored contacts; older ones are only counted.
const CONTACTS_MAX: usize = 1000;

/// The contacts of a run, the latest thousand of them kept.
#[derive(Clone, Debug, Default)]
pub struct Contacts {
    kept: VecDeque<Contact>,
    count: u64,
    taken: u64,
    first_in_earnest: Option<Instant>,
}

impl Contacts {
    /// Number of contacts.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The stored contacts after the first `seen`, oldest first.
    pub fn since(&self, seen: u64) -> impl Iterator<Item = &Contact> {
        let gone = self.count - self.kept.len() as u64;
        let skip = usize::try_from(seen.saturating_sub(gone)).unwrap_or(usize::MAX);
        self.kept.iter().skip(skip)
    }

    /// Time of the first contact that may have caused harm.
    pub const fn first_in_earnest(&self) -> Option<Instant> {
        self.first_in_earnest
    }

    pub(super) fn extend(&mut self, contacts: Vec<Contact>) {
        self.count += contacts.len() as u64;
        let mut in_earnest = contacts.iter().filter(|one| one.own_m_s > HARMLESS_M_S);
        let first = in_earnest.next().map(|one| one.at);
        self.first_in_earnest = self.first_in_earnest.or(first);
        self.kept.extend(contacts);
        let surplus = self.kept.len().saturating_sub(CONTACTS_MAX);
        self.kept.drain(..surplus);
    }

    pub(super) fn take(&mut self) -> Vec<Contact> {
        let new = self.since(self.taken).copied().collect();
        self.taken = self.count;
        new
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::Point;

    use super::*;

    fn touches(count: u64) -> Vec<Contact> {
        let touch = |millis| Contact {
            at: Instant::from_millis(millis),
            speed_m_s: 0.1,
            own_m_s: 0.1,
            place: Point::new(0.0, 0.0),
        };
        (0..count).map(touch).collect()
    }

    #[test]
    fn each_who_asks_gets_what_is_new_and_the_oldest_are_only_counted() {
        let mut contacts = Contacts::default();
        contacts.extend(touches(3));
        assert_eq!(contacts.take().len(), 3);
        assert_eq!(contacts.since(1).count(), 2);
        contacts.extend(touches(1500));
        assert_eq!((contacts.count(), contacts.since(3).count()), (1503, 1000));
        assert_eq!(contacts.since(1502).count(), 1);
        assert_eq!((contacts.take().len(), contacts.take().len()), (1000, 0));
    }

    /// A robot that is no faster than 0.05 m/s does no harm, whatever touches it.
    #[test]
    fn the_first_touch_that_may_do_harm_stays_the_first() {
        let mut contacts = Contacts::default();
        let touch = |millis, own_m_s| Contact {
            at: Instant::from_millis(millis),
            speed_m_s: 1.0,
            own_m_s,
            place: Point::new(0.0, 0.0),
        };
        contacts.extend(vec![touch(1, 0.0), touch(2, 0.05)]);
        assert_eq!(contacts.first_in_earnest(), None);
        contacts.extend(vec![touch(3, 0.04), touch(4, 0.06), touch(5, 1.0)]);
        contacts.extend(vec![touch(6, 2.0)]);
        assert_eq!(contacts.first_in_earnest(), Some(Instant::from_millis(4)));
        assert_eq!(contacts.count(), 6);
    }
}
