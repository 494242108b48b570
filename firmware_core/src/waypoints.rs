//! The robot's list of waypoints: 100 static slots, in the order of the visits.
//!
//! A waypoint keeps its number for its lifetime, and no number is used twice, even after
//! insertions, removals and replacements (seed report, chapter on waypoints). The fielded program
//! renumbered the list with every message and followed the sender's links into freed memory; here
//! the order of the message is the order of the list.

use protocols::pcui::message::{NO_WAYPOINT, Waypoint as Sent};

use crate::memory::StrayWrites;

/// Slots of the list (seed report: 100).
pub const CAPACITY: usize = 100;

/// A point to visit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Waypoint {
    /// Number of the waypoint, never used for another one.
    pub id: i16,
    /// Position in the map.
    pub position_mm: [i16; 2],
    /// Layer of the map.
    pub layer: i8,
}

/// Reason why a waypoint was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WaypointError {
    /// All slots are taken.
    Full,
    /// All 32768 numbers have been used.
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

/// Defects of the fielded program's list; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The sender's links are followed; one to an unknown number is a null pointer (PU-07, PU-08).
    pub follows_unknown_links: bool,
    /// A link that two waypoints share leads to a freed object (PU-09).
    pub follows_shared_links: bool,
    /// The target stays a memory address when a new list arrives (PU-10).
    pub keeps_the_target: bool,
    /// Removing the first or the last waypoint loses that end of the list (NV-03).
    pub loses_its_ends: bool,
    /// Waypoints without a slot are reported as stored (NV-05).
    pub drops_silently: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        follows_unknown_links: false,
        follows_shared_links: false,
        keeps_the_target: false,
        loses_its_ends: false,
        drops_silently: false,
    };
}

/// The list, and the robot's progress in it.
#[derive(Clone, Debug)]
pub struct Waypoints {
    slots: [Waypoint; CAPACITY],
    len: usize,
    /// Number of reached waypoints at the front of the list.
    reached: usize,
    /// `None` when all numbers are used.
    next_id: Option<i16>,
    defects: Defects,
    broken: Broken,
}

/// Damage that defects have done to the list.
#[derive(Clone, Copy, Debug, Default)]
struct Broken {
    /// A null pointer was followed.
    is_dead: bool,
    stray: StrayWrites,
    has_no_start: bool,
    has_no_end: bool,
}

/// Content of an unused slot.
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

    /// An empty list with the given defects of the fielded program.
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

    /// Number of waypoints by the list's own count; a broken list also counts some that it cannot
    /// reach.
    pub const fn count(&self) -> usize {
        self.len
    }

    /// Whether a defect has ended the program.
    pub const fn is_dead(&self) -> bool {
        self.broken.is_dead
    }

    /// Writes that the fielded program would have made to freed objects.
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

    /// Number of reached waypoints.
    pub const fn reached(&self) -> usize {
        self.reached
    }

    /// Whether the target is the last one.
    pub const fn is_last(&self) -> bool {
        self.reached + 1 == self.len
    }

    /// Marks the target as reached.
    pub fn advance(&mut self) {
        self.reached = (self.reached + 1).min(self.len);
    }

    /// Appends a waypoint; returns its number.
    pub fn push(&mut self, position_mm: [i16; 2], layer: i8) -> Result<i16, WaypointError> {
        self.insert_at(self.len, position_mm, layer)
    }

    /// Inserts a waypoint behind the one with number `before`; returns its number. If `before` and
    /// the next waypoint were reached, the new one counts as reached, too.
    pub fn insert_after(
        &mut self,
        before: i16,
        position_mm: [i16; 2],
        layer: i8,
    ) -> Result<i16, WaypointError> {
        let index = self.index_of(before)? + 1;
        self.insert_at(index, position_mm, layer)
    }

    /// Removes a waypoint.
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

    /// Removes all waypoints. Their numbers stay used.
    pub const fn clear(&mut self) {
        self.slots = [FREE; CAPACITY];
        self.len = 0;
        self.reached = 0;
    }

    /// Replaces the list by a received one; returns how many waypoints got no slot or number.
    ///
    /// A received waypoint with unchanged number and position keeps its number, others get new
    /// ones. Waypoints at the start of both lists stay reached if they are equal. A list sent
    /// twice, or with a waypoint appended, therefore does not send the robot back. After a finished
    /// list, the same list or its beginning starts again. If only the rest of a list is taken away,
    /// the robot drives to the last waypoint left: there it is expected.
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
        let reached = old.reached.min(alike);
        self.reached = if self.defects.keeps_the_target {
            old.reached
        } else if was_finished && reached == self.len {
            0
        } else {
            reached.min(self.len.saturating_sub(1))
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

    /// Follows the sender's link as the fielded program did: to the number assigned here, not to
    /// the sent one. Returns false if that ended the list, or the program.
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
mod tests;
