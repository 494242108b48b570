//! The robot's list of waypoints: 100 static slots, in the order in which they are visited.
//!
//! A waypoint keeps the number that it was given for as long as it lives, and no number is given
//! twice, whatever is inserted, removed or replaced (seed report, chapter on waypoints). The
//! fielded program renumbered the list with every message and followed the sender's links into
//! memory that no longer existed; here the order of the message is the order of the list.

use protocols::pcui::message::{NO_WAYPOINT, Waypoint as Sent};

use crate::memory::StrayWrites;

/// Slots of the list (seed report: 100).
pub const CAPACITY: usize = 100;

/// A point to visit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Waypoint {
    /// Its number, never given to another one.
    pub id: i16,
    /// Position in the map.
    pub position_mm: [i16; 2],
    /// Layer of the map.
    pub layer: i8,
}

/// Why a waypoint was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WaypointError {
    /// All slots are taken.
    Full,
    /// All 32768 numbers have been given.
    NumbersUsedUp,
    /// No waypoint has this number.
    Unknown(i16),
}

impl core::fmt::Display for WaypointError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Full => write!(f, "all {CAPACITY} waypoint slots are taken"),
            Self::NumbersUsedUp => f.write_str("all waypoint numbers have been used"),
            Self::Unknown(id) => write!(f, "there is no waypoint {id}"),
        }
    }
}

impl core::error::Error for WaypointError {}

/// What the fielded program did wrong with its list; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The sender's links are followed; one to an unknown number is a null pointer (PU-07, PU-08).
    pub follows_unknown_links: bool,
    /// A link that two waypoints share leads to an object that is gone (PU-09).
    pub follows_shared_links: bool,
    /// The target is kept as a place in memory when a new list comes (PU-10).
    pub keeps_the_target: bool,
    /// Removing the first or the last waypoint loses that end of the list (NV-03).
    pub loses_its_ends: bool,
    /// What finds no slot is taken for stored (NV-05).
    pub drops_silently: bool,
}

impl Defects {
    /// None.
    pub const NONE: Self = Self {
        follows_unknown_links: false,
        follows_shared_links: false,
        keeps_the_target: false,
        loses_its_ends: false,
        drops_silently: false,
    };
}

/// The list, and how far the robot has got in it.
#[derive(Clone, Debug)]
pub struct Waypoints {
    slots: [Waypoint; CAPACITY],
    len: usize,
    /// The first so many were reached.
    reached: usize,
    /// `None` when the last number is gone.
    next_id: Option<i16>,
    defects: Defects,
    broken: Broken,
}

/// What defects have done to the list.
#[derive(Clone, Copy, Debug, Default)]
struct Broken {
    /// A null pointer was followed.
    is_dead: bool,
    stray: StrayWrites,
    has_no_start: bool,
    has_no_end: bool,
}

/// What a slot holds that nobody uses.
const FREE: Waypoint = Waypoint {
    id: NO_WAYPOINT,
    position_mm: [-1; 2],
    layer: 0,
};

impl Waypoints {
    /// An empty list.
    pub const fn new() -> Self {
        Self::with_defects(Defects::NONE)
    }

    /// An empty list with some of the fielded program's faults.
    pub const fn with_defects(defects: Defects) -> Self {
        Self {
            defects,
            broken: Broken {
                is_dead: false,
                stray: StrayWrites::NONE,
                has_no_start: false,
                has_no_end: false,
            },
            slots: [FREE; CAPACITY],
            len: 0,
            reached: 0,
            next_id: Some(0),
        }
    }

    /// The waypoints in the order of their visit.
    pub fn all(&self) -> &[Waypoint] {
        if self.broken.has_no_start {
            return &[];
        }
        &self.slots[..self.len]
    }

    /// How many the list counts; a broken one counts some that it does not reach.
    pub const fn count(&self) -> usize {
        self.len
    }

    /// Whether a defect has ended the program.
    pub const fn is_dead(&self) -> bool {
        self.broken.is_dead
    }

    /// Writes that the fielded program would have made to objects that are gone.
    pub const fn stray_writes(&self) -> StrayWrites {
        self.broken.stray
    }

    /// Whether the list is empty.
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The waypoint to drive to; `None` if all were reached.
    pub fn target(&self) -> Option<&Waypoint> {
        if self.defects.keeps_the_target {
            return self.slots.get(self.reached).filter(|_| self.len > 0);
        }
        self.all().get(self.reached)
    }

    /// How many were reached.
    pub const fn reached(&self) -> usize {
        self.reached
    }

    /// Whether the target is the last one.
    pub const fn is_last(&self) -> bool {
        self.reached + 1 == self.len
    }

    /// The target was reached.
    pub fn advance(&mut self) {
        self.reached = (self.reached + 1).min(self.len);
    }

    /// Appends a waypoint; its number.
    pub fn push(&mut self, position_mm: [i16; 2], layer: i8) -> Result<i16, WaypointError> {
        self.insert_at(self.len, position_mm, layer)
    }

    /// Puts a waypoint behind the one with number `before`; its number. If `before` was reached,
    /// and another one behind it as well, the new one counts as reached.
    pub fn insert_after(
        &mut self,
        before: i16,
        position_mm: [i16; 2],
        layer: i8,
    ) -> Result<i16, WaypointError> {
        let index = self.index_of(before)? + 1;
        self.insert_at(index, position_mm, layer)
    }

    /// Takes a waypoint out.
    pub fn remove(&mut self, id: i16) -> Result<Waypoint, WaypointError> {
        let index = self.index_of(id)?;
        let removed = self.slots[index];
        if self.defects.loses_its_ends && self.len > 1 {
            self.broken.has_no_start |= index == 0;
            self.broken.has_no_end |= index + 1 == self.len;
        }
        self.slots.copy_within(index + 1..self.len, index);
        self.len -= 1;
        self.slots[self.len] = FREE;
        if index < self.reached {
            self.reached -= 1;
        }
        Ok(removed)
    }

    /// Takes all waypoints out. Their numbers stay used.
    pub const fn clear(&mut self) {
        self.slots = [FREE; CAPACITY];
        self.len = 0;
        self.reached = 0;
    }

    /// Replaces the list by one that was received; how many of it found no slot or number.
    ///
    /// A waypoint that comes back with number and position unchanged keeps its number, others get
    /// new ones. As far as the new list begins like the old one, what was reached stays reached,
    /// so a list that is sent twice, or sent again with a waypoint added behind, does not send the
    /// robot back. A list that was finished starts again.
    pub fn replace(&mut self, received: impl Iterator<Item = Sent>) -> usize {
        let old = self.clone();
        let was_finished = self.reached == self.len;
        self.clear();
        let mut refused = 0;
        for sent in received {
            if !self.links_hold(&sent) {
                break;
            }
            let known = old.all().iter().any(|known| {
                known.id == sent.id
                    && known.position_mm == sent.position_mm
                    && known.layer == sent.layer
            }) && self.index_of(sent.id).is_err();
            let taken = if known {
                self.insert_slot(
                    self.len,
                    Waypoint {
                        id: sent.id,
                        position_mm: sent.position_mm,
                        layer: sent.layer,
                    },
                )
            } else {
                self.push(sent.position_mm, sent.layer).map(|_| ())
            };
            refused += usize::from(taken.is_err());
        }
        let alike = old
            .all()
            .iter()
            .zip(self.all())
            .take_while(|(old, new)| old.position_mm == new.position_mm && old.layer == new.layer)
            .count();
        let same = alike == old.len && alike == self.len;
        self.reached = if self.defects.keeps_the_target {
            old.reached
        } else if same && was_finished {
            0
        } else {
            old.reached.min(alike)
        };
        refused
    }

    /// The list as it is sent, each waypoint with the number of the one before it.
    pub fn to_send(&self) -> impl Iterator<Item = Sent> + '_ {
        let before =
            core::iter::once(NO_WAYPOINT).chain(self.all().iter().map(|waypoint| waypoint.id));
        self.all()
            .iter()
            .zip(before)
            .map(|(waypoint, previous)| Sent {
                position_mm: waypoint.position_mm,
                layer: waypoint.layer,
                id: waypoint.id,
                previous,
            })
    }

    /// Follows the sender's link as the fielded program did: to the number that a waypoint got
    /// here, not to the one that was sent. False if that ended the list, or the program.
    fn links_hold(&mut self, sent: &Sent) -> bool {
        if sent.previous == NO_WAYPOINT {
            return true;
        }
        let before = usize::try_from(sent.previous).ok();
        let before = before.filter(|before| *before < self.len);
        if self.defects.follows_unknown_links && before.is_none() {
            self.broken.is_dead = true;
            return false;
        }
        let is_shared = before.is_some_and(|before| before + 1 < self.len);
        if self.defects.follows_shared_links && is_shared {
            self.broken.stray.note(0);
            return false;
        }
        true
    }

    fn index_of(&self, id: i16) -> Result<usize, WaypointError> {
        self.all()
            .iter()
            .position(|waypoint| waypoint.id == id)
            .ok_or(WaypointError::Unknown(id))
    }

    fn insert_at(
        &mut self,
        index: usize,
        position_mm: [i16; 2],
        layer: i8,
    ) -> Result<i16, WaypointError> {
        let id = self.next_id.ok_or(WaypointError::NumbersUsedUp)?;
        self.insert_slot(
            index,
            Waypoint {
                id,
                position_mm,
                layer,
            },
        )?;
        self.next_id = id.checked_add(1);
        Ok(id)
    }

    fn insert_slot(&mut self, index: usize, waypoint: Waypoint) -> Result<(), WaypointError> {
        if self.len == CAPACITY {
            let told = !self.defects.drops_silently;
            return if told {
                Err(WaypointError::Full)
            } else {
                Ok(())
            };
        }
        if self.broken.has_no_end {
            return Ok(());
        }
        self.slots.copy_within(index..self.len, index + 1);
        self.slots[index] = waypoint;
        self.len += 1;
        if index < self.reached {
            self.reached += 1;
        }
        Ok(())
    }
}

impl Default for Waypoints {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::BTreeSet;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    fn sent(id: i16, x: i16) -> Sent {
        Sent {
            position_mm: [x, 0],
            id,
            ..Sent::default()
        }
    }

    fn ids(list: &Waypoints) -> Vec<i16> {
        list.all().iter().map(|waypoint| waypoint.id).collect()
    }

    /// Field defect NV-05: the 101st waypoint vanished without a word. Seed figure S9: 100 slots.
    #[test]
    fn the_101st_waypoint_is_refused_aloud() {
        let mut list = Waypoints::new();
        for x in 0..100 {
            assert_eq!(list.push([x, 0], 0), Ok(x));
        }
        assert_eq!(list.push([100, 0], 0), Err(WaypointError::Full));
        assert_eq!(list.all().len(), 100);
    }

    /// Field defect NV-03: removing the first or the last waypoint lost an end of the list.
    #[test]
    fn the_ends_can_be_removed() {
        let mut list = Waypoints::new();
        list.replace([sent(0, 1), sent(1, 2), sent(2, 3)].into_iter());
        assert!(list.remove(0).is_ok() && list.remove(2).is_ok());
        assert_eq!(ids(&list), [1]);
        assert_eq!(list.remove(2), Err(WaypointError::Unknown(2)));
    }

    /// Field defects PU-07 and PU-09: links to waypoints that do not exist, or in a ring, led the
    /// fielded program into foreign memory.
    #[test]
    fn the_senders_links_are_not_followed() {
        let mut list = Waypoints::new();
        let linked = |id, previous, x| Sent {
            previous,
            ..sent(id, x)
        };
        list.replace([linked(1, -1, 10), linked(0, 1, 20), linked(7, 99, 30)].into_iter());
        let xs: Vec<i16> = list
            .all()
            .iter()
            .map(|waypoint| waypoint.position_mm[0])
            .collect();
        assert_eq!(xs, [10, 20, 30]);
        let previous: Vec<i16> = list.to_send().map(|sent| sent.previous).collect();
        assert_eq!(previous, [-1, 0, 1]);
    }

    /// Field defect PU-10: heading for the third waypoint, a list of one came, and the robot drove
    /// to a slot that had been freed.
    #[test]
    fn a_new_list_selects_its_own_target() {
        let mut list = Waypoints::new();
        list.replace([sent(0, 1), sent(1, 2), sent(2, 3)].into_iter());
        list.advance();
        list.advance();
        list.replace([sent(0, 500)].into_iter());
        assert_eq!(
            list.target().map(|waypoint| waypoint.position_mm),
            Some([500, 0])
        );
        list.replace([].into_iter());
        assert_eq!(list.target(), None);
    }

    #[test]
    fn a_repeated_list_does_not_send_the_robot_back() {
        let mut list = Waypoints::new();
        let tour = [sent(0, 1), sent(1, 2), sent(2, 3)];
        list.replace(tour.into_iter());
        list.advance();
        list.replace(tour.into_iter());
        assert_eq!((list.reached(), ids(&list)), (1, Vec::from([0, 1, 2])));

        list.replace(tour.into_iter().chain([sent(3, 4)]));
        assert_eq!(list.target().map(|waypoint| waypoint.id), Some(1));

        list.replace([sent(0, 1), sent(1, 9)].into_iter());
        assert_eq!(
            list.target()
                .map(|waypoint| (waypoint.id, waypoint.position_mm[0])),
            Some((4, 9))
        );
    }

    #[test]
    fn a_finished_list_that_comes_again_is_driven_again() {
        let mut list = Waypoints::new();
        list.replace([sent(0, 1), sent(1, 2)].into_iter());
        list.advance();
        list.advance();
        assert_eq!(list.target(), None);
        list.replace([sent(0, 1), sent(1, 2)].into_iter());
        assert_eq!(list.target().map(|waypoint| waypoint.id), Some(0));
    }

    /// Field defect UI-05: the PC numbers its own waypoints from 0 and sends a number twice.
    #[test]
    fn a_number_that_comes_twice_is_given_once() {
        let mut list = Waypoints::new();
        list.replace([sent(0, 1)].into_iter());
        list.replace([sent(0, 1), sent(0, 1), sent(0, 2)].into_iter());
        assert_eq!(ids(&list), [0, 1, 2]);
    }

    #[test]
    fn used_up_numbers_are_reported() {
        let mut list = Waypoints::new();
        list.next_id = Some(i16::MAX);
        assert_eq!(list.push([0; 2], 0), Ok(i16::MAX));
        assert_eq!(list.push([0; 2], 0), Err(WaypointError::NumbersUsedUp));
    }

    #[derive(Clone, Debug)]
    enum Step {
        Push(i16),
        InsertAfter(usize, i16),
        Remove(usize),
        Advance,
        Clear,
        Replace(Vec<i16>),
    }

    /// The only reason to refuse a waypoint, and how long the list is then.
    const FULL: (WaypointError, usize) = (WaypointError::Full, CAPACITY);

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            6 => any::<i16>().prop_map(Step::Push),
            4 => (0_usize..120, any::<i16>()).prop_map(|(at, x)| Step::InsertAfter(at, x)),
            3 => (0_usize..120).prop_map(Step::Remove),
            2 => Just(Step::Advance),
            1 => Just(Step::Clear),
            1 => prop::collection::vec(any::<i16>(), 0..56).prop_map(Step::Replace),
        ]
    }

    proptest! {
        /// Seed figure S9: the list does what a plain vector does, and no number comes twice.
        #[test]
        fn the_list_is_a_vector_whose_numbers_are_never_reused(
            steps in prop::collection::vec(step(), 0..150),
        ) {
            let mut list = Waypoints::new();
            let mut model: Vec<(i16, i16)> = Vec::new();
            let mut given = BTreeSet::new();
            for step in steps {
                match step {
                    Step::Push(x) => match list.push([x, 0], 0) {
                        Ok(id) => { prop_assert!(given.insert(id)); model.push((id, x)); }
                        Err(error) => prop_assert_eq!((error, model.len()), FULL),
                    },
                    Step::InsertAfter(at, x) => if let Some(&(before, _)) = model.get(at) {
                        match list.insert_after(before, [x, 0], 0) {
                            Ok(id) => {
                                prop_assert!(given.insert(id));
                                model.insert(at + 1, (id, x));
                            }
                            Err(error) => prop_assert_eq!((error, model.len()), FULL),
                        }
                    },
                    Step::Remove(at) => if let Some(&(id, _)) = model.get(at) {
                        prop_assert!(list.remove(id).is_ok());
                        model.remove(at);
                    },
                    Step::Advance => list.advance(),
                    Step::Clear => { list.clear(); model.clear(); }
                    Step::Replace(xs) => {
                        // Strangers' numbers, so all of it is new.
                        prop_assert_eq!(list.replace(xs.iter().map(|&x| sent(-2, x))), 0);
                        model = list.all().iter().map(|waypoint| waypoint.id).zip(xs).collect();
                        for (id, _) in &model { prop_assert!(given.insert(*id)); }
                    }
                }
                let seen = |waypoint: &Waypoint| (waypoint.id, waypoint.position_mm[0]);
                let held: Vec<_> = list.all().iter().map(seen).collect();
                prop_assert_eq!(&held, &model);
                prop_assert!(list.reached() <= model.len());
            }
        }
    }
}
