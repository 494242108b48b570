//! A place in a run, which every run of the same case finds again: the number of calls, the number
//! of time steps, and the later hits, steps and signals that the debugger saw.

use core::fmt;

use super::supervisor::Watchpoint;

/// A moment of a run. Between two consecutive moments the program only computes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Moment {
    /// Number of calls that threads have begun.
    pub(super) calls: u64,
    /// Number of times that time has advanced while all threads waited.
    pub(super) leaps: u64,
}

/// A part of the path from a moment to a place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Leg {
    /// The last of `count` hits of any of these breakpoints and watchpoints.
    Hits {
        breaks: Vec<u64>,
        watches: Vec<Watchpoint>,
        count: u64,
    },
    /// `count` single steps of the thread with this number in the order of birth.
    Steps { thread: u32, count: u64 },
    /// This number of signals.
    Signals(u64),
}

/// The place at which a program stands.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) moment: Moment,
    pub(super) legs: Vec<Leg>,
}

impl Place {
    /// Records that a thread has begun a call.
    pub(super) fn called(&mut self) {
        self.moment.calls += 1;
        self.legs.clear();
    }

    /// Records that time has advanced.
    pub(super) fn leapt(&mut self) {
        self.moment.leaps += 1;
        self.legs.clear();
    }

    /// Records a stop at a breakpoint.
    pub(super) fn hit(&mut self, address: u64) {
        // A debugger steps over a breakpoint before the program continues to the same one.
        if let [
            ..,
            Leg::Hits {
                breaks, watches, ..
            },
            Leg::Steps { count: 1, .. },
        ] = &self.legs[..]
            && **breaks == [address]
            && watches.is_empty()
        {
            self.legs.pop();
        }
        self.add_hit(vec![address], Vec::new());
    }

    /// Records an access to watched memory.
    pub(super) fn touched(&mut self, watches: &[Watchpoint]) {
        self.add_hit(Vec::new(), watches.to_vec());
    }

    fn add_hit(&mut self, of: Vec<u64>, at: Vec<Watchpoint>) {
        match self.legs.last_mut() {
            Some(Leg::Hits {
                breaks,
                watches,
                count,
            }) if *breaks == of && *watches == at => *count += 1,
            _ => self.legs.push(Leg::Hits {
                breaks: of,
                watches: at,
                count: 1,
            }),
        }
    }

    /// Records an executed instruction of a thread.
    pub(super) fn stepped(&mut self, by: u32) {
        match self.legs.last_mut() {
            Some(Leg::Steps { thread, count }) if *thread == by => *count += 1,
            _ => self.legs.push(Leg::Steps {
                thread: by,
                count: 1,
            }),
        }
    }

    /// The place one instruction earlier, if the last part of the path consists of single steps of
    /// that thread.
    pub(super) fn one_step_less(&self, of: u32) -> Option<Self> {
        let mut before = self.clone();
        match before.legs.last_mut() {
            Some(Leg::Steps { thread, count }) if *thread == of => {
                *count -= 1;
                if *count == 0 {
                    before.legs.pop();
                }
                Some(before)
            }
            _ => None,
        }
    }

    /// Whether the program stands behind an instruction that accessed watched memory.
    pub(super) fn is_at_watch(&self) -> bool {
        matches!(self.legs.last(), Some(Leg::Hits { watches, .. }) if !watches.is_empty())
    }

    /// Records a stop at a signal.
    pub(super) fn signalled(&mut self) {
        match self.legs.last_mut() {
            Some(Leg::Signals(count)) => *count += 1,
            _ => self.legs.push(Leg::Signals(1)),
        }
    }
}

/// The numbers of a place for the user: calls, time steps, hits.
impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "call {}.{}", self.moment.calls, self.moment.leaps)?;
        for leg in &self.legs {
            match leg {
                Leg::Hits { count, .. } => write!(f, ", hit {count}")?,
                Leg::Steps { count, .. } => write!(f, ", instruction {count}")?,
                Leg::Signals(count) => write!(f, ", signal {count}")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The step over a breakpoint belongs to its next hit; other steps are separate parts of the
    /// path.
    #[test]
    fn a_place_is_numbered_by_calls_and_hits() {
        let mut place = Place::default();
        place.called();
        place.called();
        place.leapt();
        place.hit(16);
        place.stepped(0);
        place.hit(16);
        place.stepped(0);
        place.stepped(0);
        place.hit(16);
        assert_eq!(place.to_string(), "call 2.1, hit 2, instruction 2, hit 1");
        assert_eq!(place.one_step_less(0), None);
        place.stepped(0);
        place.stepped(0);
        let before = place.one_step_less(0).expect("two steps");
        assert_eq!(
            before.to_string(),
            "call 2.1, hit 2, instruction 2, hit 1, instruction 1"
        );
        assert_eq!(place.one_step_less(1), None);
        place.called();
        assert_eq!(place.to_string(), "call 3.1");
    }

    const WATCH: Watchpoint = Watchpoint {
        address: 8,
        len: 4,
        reads: false,
    };

    fn hits(breaks: &[u64], watches: &[Watchpoint], count: u64) -> Leg {
        Leg::Hits {
            breaks: breaks.to_vec(),
            watches: watches.to_vec(),
            count,
        }
    }

    /// Hits of the same marks, and steps of the same thread, are counted together.
    #[test]
    fn legs_of_a_kind_are_counted_together() {
        let mut place = Place::default();
        place.touched(&[WATCH]);
        place.touched(&[WATCH]);
        assert!(place.is_at_watch());
        assert_eq!(place.legs, [hits(&[], &[WATCH], 2)]);
        place.hit(16);
        assert!(!place.is_at_watch());
        place.hit(17);
        place.hit(17);
        let three = [
            hits(&[], &[WATCH], 2),
            hits(&[16], &[], 1),
            hits(&[17], &[], 2),
        ];
        assert_eq!(place.legs, three);
        place.stepped(3);
        place.stepped(3);
        place.stepped(4);
        let steps = |thread, count| Leg::Steps { thread, count };
        assert_eq!(place.legs[3..], [steps(3, 2), steps(4, 1)]);
        place.signalled();
        place.signalled();
        place.stepped(4);
        place.signalled();
        assert_eq!(
            place.legs[5..],
            [Leg::Signals(2), steps(4, 1), Leg::Signals(1)]
        );
        assert_eq!(place.one_step_less(4), None);
        let moment = |place: &Place| (place.moment.calls, place.moment.leaps);
        assert_eq!(moment(&place), (0, 0));
        place.leapt();
        assert_eq!((moment(&place), place.legs.len()), ((0, 1), 0));
        place.signalled();
        place.called();
        assert_eq!((moment(&place), place.legs.len()), ((1, 1), 0));
        assert!(!place.is_at_watch());
    }

    /// Only one step, over the same breakpoint, belongs to its next hit.
    #[test]
    fn a_step_over_a_breakpoint_is_a_part_of_the_next_hit() {
        let steps = |count| Leg::Steps { thread: 0, count };
        let after = |first: Leg, count| {
            let mut place = Place {
                legs: vec![first, steps(count)],
                ..Place::default()
            };
            place.hit(16);
            place.legs
        };
        assert_eq!(after(hits(&[16], &[], 1), 1), [hits(&[16], &[], 2)]);
        let other = [hits(&[17], &[], 1), steps(1), hits(&[16], &[], 1)];
        assert_eq!(after(hits(&[17], &[], 1), 1), other);
        let two = [hits(&[16], &[], 1), steps(2), hits(&[16], &[], 1)];
        assert_eq!(after(hits(&[16], &[], 1), 2), two);
        let watched = [hits(&[16], &[WATCH], 1), steps(1), hits(&[16], &[], 1)];
        assert_eq!(after(hits(&[16], &[WATCH], 1), 1), watched);
    }

    #[test]
    fn one_step_less_is_the_place_before() {
        let place = |count| Place {
            moment: Moment::default(),
            legs: vec![Leg::Signals(1), Leg::Steps { thread: 2, count }],
        };
        assert_eq!(place(3).one_step_less(2), Some(place(2)));
        let first = Place {
            legs: vec![Leg::Signals(1)],
            ..Place::default()
        };
        assert_eq!(place(1).one_step_less(2), Some(first));
        assert_eq!(place(3).one_step_less(1), None);
        assert_eq!(place(3).to_string(), "call 0.0, signal 1, instruction 3");
    }
}
