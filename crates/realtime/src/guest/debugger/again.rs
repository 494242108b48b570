//! Runs the program again from its start to a place that an earlier run has reached: each run of a
//! case is the same.

use protocols::Instant;

use super::{Event, Session};
use crate::guest::GuestError;
use crate::guest::place::{Leg, Moment, Place};
use crate::guest::supervisor::{Goal, Step, Stop, Watchpoint};

/// Breakpoints and watchpoints.
#[derive(Clone, Debug, Default)]
pub(super) struct Marks {
    pub(super) breaks: Vec<u64>,
    pub(super) watches: Vec<Watchpoint>,
}

/// An observation on the path to a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// A breakpoint.
    Break,
    /// A change of watched memory, with its address.
    Watch(u64),
}

/// A path to a place, with the breakpoints and watchpoints to report on it.
pub(super) struct Walk<'a> {
    pub(super) to: &'a Place,
    pub(super) marks: &'a Marks,
    /// The thread that runs in single steps, by its number in the order of birth.
    pub(super) steps: Option<u32>,
}

impl Session<'_> {
    /// Starts the program again and waits until it is loaded; returns whether it was loaded.
    pub(super) fn load_again(&mut self) -> Result<bool, GuestError> {
        if self.is_broken_off {
            return Ok(false);
        }
        if let Some(trial) = self.trial.take() {
            self.computing = trial.abandon();
        }
        // A session without a run cannot serve a debugger: it ends.
        self.trial = Some((self.start)().ok_or(GuestError::Restart)?);
        if let Some(computing) = self.computing.clone() {
            self.supervisor().charge_again(computing);
        }
        self.load()
    }

    /// Runs again to `place`; returns whether the place was reached.
    pub(super) fn go_to(&mut self, place: &Place) -> Result<bool, GuestError> {
        let walk = Walk {
            to: place,
            marks: &Marks::default(),
            steps: None,
        };
        let found = self.load_again()? && self.walk(&walk, &mut |_, _| {})?;
        self.set_marks(&Marks::default());
        Ok(found)
    }

    /// Runs again to the first moment at or after `moment`.
    pub(super) fn go_to_moment(&mut self, moment: Moment) -> Result<bool, GuestError> {
        let place = Place {
            moment,
            legs: Vec::new(),
        };
        self.go_to(&place)
    }

    /// Runs again to the rig's time `at`.
    pub(super) fn go_to_time(&mut self, at: Instant) -> Result<bool, GuestError> {
        if !self.load_again()? {
            return Ok(false);
        }
        self.reach_goal(Goal::Time(at))
    }

    /// Runs to a goal; returns whether it was reached.
    pub(super) fn reach_goal(&mut self, goal: Goal) -> Result<bool, GuestError> {
        if let Some(debugging) = self.supervisor().debugging() {
            debugging.set_goal(Some(goal));
        }
        loop {
            match self.run_until_event()? {
                Some(Event::Stop(Stop::Reached(tid))) => {
                    self.current = tid.or(self.current);
                    return Ok(true);
                }
                Some(Event::Stop(Stop::Ended(_)) | Event::Over) | None => return Ok(false),
                Some(Event::Stop(_)) => {}
            }
        }
    }

    /// The current place of the program.
    pub(super) fn place(&mut self) -> Place {
        let debugging = self.supervisor().debugging();
        debugging.map(|it| it.place().clone()).unwrap_or_default()
    }

    /// Replaces all breakpoints and watchpoints by these.
    pub(super) fn set_marks(&mut self, marks: &Marks) {
        self.supervisor().clear_breaks();
        for &address in &marks.breaks {
            self.supervisor().add_break_when_possible(address);
        }
        if let Some(debugging) = self.supervisor().debugging() {
            debugging.set_watches(marks.watches.clone());
        }
    }

    /// Runs from here to a place, and reports observations before it. Returns whether the place was
    /// reached.
    pub(super) fn walk(
        &mut self,
        walk: &Walk<'_>,
        seen: &mut dyn FnMut(&Place, Seen),
    ) -> Result<bool, GuestError> {
        self.set_marks(walk.marks);
        if self.place().moment < walk.to.moment {
            let goal = Goal::Moment(walk.to.moment);
            if let Some(debugging) = self.supervisor().debugging() {
                debugging.set_goal(Some(goal));
            }
            self.leave_break(walk.steps)?;
            let is_there = self.pass(walk, seen, &mut |_, stop| {
                matches!(stop, Stop::Reached(_)).then_some(true)
            })?;
            if !is_there {
                return Ok(false);
            }
        }
        let mut before = None;
        for (index, leg) in walk.to.legs.iter().enumerate() {
            let is_last = index + 1 == walk.to.legs.len();
            if !self.walk_leg(walk, (before, leg), is_last, seen)? {
                return Ok(false);
            }
            before = Some(leg);
        }
        Ok(true)
    }

    /// Runs a part of the path, behind the part `before`.
    fn walk_leg(
        &mut self,
        walk: &Walk<'_>,
        (before, leg): (Option<&Leg>, &Leg),
        is_last: bool,
        seen: &mut dyn FnMut(&Place, Seen),
    ) -> Result<bool, GuestError> {
        match leg {
            Leg::Hits {
                breaks,
                watches,
                count,
            } => {
                let mut marks = walk.marks.clone();
                marks.breaks.extend(breaks);
                // Watchpoints of this leg come first, because the processor has only four.
                let others = marks.watches.into_iter();
                let others = others.filter(|it| !watches.contains(it));
                marks.watches = watches.iter().copied().chain(others).take(4).collect();
                self.set_marks(&marks);
                // A single step may lead to a breakpoint of this leg: then it is hit at once.
                let held = self.held_thread().map(|held| self.instruction_of(held));
                let is_at_hit = held.is_some_and(|at| breaks.contains(&at));
                if !(is_at_hit && matches!(before, Some(Leg::Steps { .. }))) {
                    self.leave_break(walk.steps)?;
                }
                let mut left = *count;
                let found = self.pass(walk, seen, &mut |session, stop| {
                    let is_hit = match stop {
                        Stop::Break(tid) => breaks.contains(&session.instruction_of(tid)),
                        Stop::Watch(_, address) => {
                            watches.iter().any(|watch| watch.address == address)
                        }
                        _ => false,
                    };
                    left -= u64::from(is_hit);
                    (is_hit && left == 0).then_some(is_last)
                });
                self.set_marks(walk.marks);
                found
            }
            Leg::Steps { thread, count } => {
                for _ in 0..*count {
                    if !self.single_step(*thread, seen)? {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            Leg::Signals(count) => {
                self.leave_break(walk.steps)?;
                let mut left = *count;
                self.pass(walk, seen, &mut |_, stop| {
                    left -= u64::from(matches!(stop, Stop::Signal(..)));
                    (left == 0).then_some(is_last)
                })
            }
        }
    }

    /// Runs until `is_there` returns a value: `true` if that stop must not be reported, `false` if
    /// it must. Returns whether this happened.
    fn pass(
        &mut self,
        walk: &Walk<'_>,
        seen: &mut dyn FnMut(&Place, Seen),
        is_there: &mut dyn FnMut(&Self, Stop) -> Option<bool>,
    ) -> Result<bool, GuestError> {
        loop {
            if let Some(thread) = walk.steps {
                self.set_step_of(thread);
            }
            let Some(Event::Stop(stop)) = self.run_until_event()? else {
                return Ok(false);
            };
            if let Stop::Ended(_) = stop {
                return Ok(false);
            }
            self.note_current(stop);
            let end = is_there(self, stop);
            if end == Some(true) {
                return Ok(true);
            }
            let place = self.place();
            match stop {
                Stop::Break(tid) if walk.marks.breaks.contains(&self.instruction_of(tid)) => {
                    seen(&place, Seen::Break);
                }
                Stop::Watch(_, address)
                    if walk.marks.watches.iter().any(|it| it.address == address) =>
                {
                    seen(&place, Seen::Watch(address));
                }
                // The thread has made too many single steps.
                Stop::Step(_) => return Ok(false),
                _ => {}
            }
            if end.is_some() {
                return Ok(true);
            }
            if let Stop::Break(_) = stop {
                self.leave_break(walk.steps)?;
            }
        }
    }

    /// Lets a thread at a breakpoint execute the instruction under it.
    pub(super) fn leave_break(&mut self, keeps_stepping: Option<u32>) -> Result<(), GuestError> {
        let Some(held) = self.held_thread() else {
            return Ok(());
        };
        let at = self.instruction_of(held);
        if !self.supervisor().has_break(at) {
            return Ok(());
        }
        self.supervisor().remove_break(at);
        self.step_held(held)?;
        self.supervisor().add_break_when_possible(at);
        if let Some(thread) = keeps_stepping {
            self.set_step_of(thread);
        }
        Ok(())
    }

    fn held_thread(&mut self) -> Option<i32> {
        self.supervisor().debugging()?.held_thread()
    }

    /// Executes one instruction of the held thread, or less if the thread stops before its end.
    pub(super) fn step_held(&mut self, tid: i32) -> Result<(), GuestError> {
        if let Some(debugging) = self.supervisor().debugging() {
            debugging.set_step(Some(Step { tid, within: 0..0 }));
        }
        let event = self.run_until_event()?;
        if let Some(Event::Stop(stop)) = event {
            self.note_current(stop);
        }
        if let Some(debugging) = self.supervisor().debugging() {
            debugging.set_step(None);
        }
        Ok(())
    }

    /// Executes one instruction of a thread, whatever the others do meanwhile; returns whether it
    /// was executed.
    pub(super) fn single_step(
        &mut self,
        thread: u32,
        seen: &mut dyn FnMut(&Place, Seen),
    ) -> Result<bool, GuestError> {
        let Some(tid) = self.tid_by_index(thread) else {
            return Ok(false);
        };
        let at = self.instruction_of(tid);
        let was_set = self.supervisor().has_break(at);
        if was_set {
            self.supervisor().remove_break(at);
        }
        loop {
            if let Some(debugging) = self.supervisor().debugging() {
                debugging.set_step(Some(Step { tid, within: 0..0 }));
            }
            let Some(Event::Stop(stop)) = self.run_until_event()? else {
                return Ok(false);
            };
            self.note_current(stop);
            match stop {
                Stop::Step(other) if other == tid => break,
                Stop::Ended(_) => return Ok(false),
                Stop::Break(_) => {
                    let place = self.place();
                    seen(&place, Seen::Break);
                    self.leave_break(None)?;
                }
                Stop::Watch(other, address) => {
                    let place = self.place();
                    seen(&place, Seen::Watch(address));
                    if other == tid {
                        break;
                    }
                }
                _ => {}
            }
        }
        if let Some(debugging) = self.supervisor().debugging() {
            debugging.set_step(None);
        }
        if was_set {
            self.supervisor().add_break_when_possible(at);
        }
        Ok(true)
    }

    pub(super) fn set_step_of(&mut self, thread: u32) {
        let tid = self.tid_by_index(thread);
        if let Some(debugging) = self.supervisor().debugging() {
            let step = |tid| Step {
                tid,
                within: 0..u64::MAX,
            };
            debugging.set_step(tid.map(step));
        }
    }

    pub(super) fn tid_by_index(&mut self, thread: u32) -> Option<i32> {
        let mut threads = self.supervisor().debugged_threads();
        let found = threads.find(|&(index, _)| index == thread);
        found.map(|(_, tid)| tid)
    }

    /// Address of a thread's next instruction.
    pub(super) fn instruction_of(&self, tid: i32) -> u64 {
        let registers = self.supervisor_ref().registers_of(tid);
        registers.map_or(0, |(own, _)| own.rip)
    }

    pub(super) fn note_current(&mut self, stop: Stop) {
        match stop {
            Stop::Loaded(tid)
            | Stop::Break(tid)
            | Stop::Watch(tid, _)
            | Stop::Step(tid)
            | Stop::Signal(tid, _) => self.current = Some(tid),
            Stop::Reached(tid) => self.current = tid.or(self.current),
            Stop::Ended(_) => {}
        }
    }
}
