//! Backward motion: the program runs again from its start to an earlier place.

use gdbstub::common::Tid;
use gdbstub::stub::MultiThreadStopReason;
use gdbstub::target::ext::base::reverse_exec::{ReplayLogPosition, ReverseCont, ReverseStep};

use super::Session;
use super::again::{Marks, Seen, Walk};
use crate::guest::GuestError;
use crate::guest::place::{Moment, Place};
use protocols::Instant;

/// Maximum number of single steps to find the previous instruction.
const STEPS_MAX: u64 = 1_000_000;

/// Kind of a backward motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Back {
    /// To the last breakpoint or watchpoint.
    Continue,
    /// One instruction of this thread.
    Step(Tid),
}

impl ReverseCont<Tid> for Session<'_> {
    fn reverse_cont(&mut self) -> Result<(), GuestError> {
        self.back = Some(Back::Continue);
        Ok(())
    }
}

impl ReverseStep<Tid> for Session<'_> {
    fn reverse_step(&mut self, tid: Tid) -> Result<(), GuestError> {
        self.back = Some(Back::Step(tid));
        Ok(())
    }
}

impl Session<'_> {
    /// Moves backward; returns the reason for the stop, or `None` if the debugger has interrupted
    /// the motion.
    pub(super) fn go_back(
        &mut self,
        back: Back,
    ) -> Result<Option<MultiThreadStopReason<u64>>, GuestError> {
        let here = self.place();
        let debugging = self.supervisor().debugging();
        let marks = debugging.map_or_else(Marks::default, |it| Marks {
            breaks: it.break_addresses(),
            watches: it.watches().to_vec(),
        });
        self.is_over = false;
        self.is_signal_told = false;
        let reason = match (back, self.back_to.take()) {
            (Back::Continue, Some(at)) => self.back_to_time(at)?,
            (Back::Continue, None) => self.back_to_mark(&here, &marks)?,
            (Back::Step(tid), _) => {
                let thread = u32::try_from(tid.get() - 1).unwrap_or(0);
                match self.predecessor(&here, thread)? {
                    Some(place) if self.arrive(&place)? => {
                        self.reason(gdbstub::common::Signal::SIGTRAP)
                    }
                    _ => self.back_to_start()?,
                }
            }
        };
        self.ear = None;
        let is_broken_off = core::mem::take(&mut self.is_broken_off);
        if is_broken_off {
            self.back_to_start()?;
        }
        // Restore the debugger's breakpoints, because the debugger removes them itself.
        self.set_marks(&marks);
        Ok((!is_broken_off).then_some(reason))
    }

    /// Runs again to `place`; returns whether this run reached it as the run before.
    pub(super) fn arrive(&mut self, place: &Place) -> Result<bool, GuestError> {
        let found = self.go_to(place)?;
        Ok(self.is_as_before(found, place))
    }

    /// Whether this run reached `place` as the run before. If not, the debugger will be told.
    pub(super) fn is_as_before(&mut self, found: bool, place: &Place) -> bool {
        let is_it = found && self.place().moment == place.moment;
        if !is_it && (self.goes_on)() && !self.is_broken_off {
            self.has_missed = true;
        }
        is_it
    }

    fn back_to_start(&mut self) -> Result<MultiThreadStopReason<u64>, GuestError> {
        self.load_again()?;
        let tid = self.current.map(|tid| self.number_of(tid));
        Ok(MultiThreadStopReason::ReplayLog {
            tid,
            pos: ReplayLogPosition::Begin,
        })
    }

    fn back_to_time(&mut self, at: Instant) -> Result<MultiThreadStopReason<u64>, GuestError> {
        match self.go_to_time(at)? {
            true => Ok(self.reason(gdbstub::common::Signal::SIGTRAP)),
            false => self.back_to_start(),
        }
    }

    fn back_to_mark(
        &mut self,
        here: &Place,
        marks: &Marks,
    ) -> Result<MultiThreadStopReason<u64>, GuestError> {
        let mut last = None;
        if (!marks.breaks.is_empty() || !marks.watches.is_empty()) && self.load_again()? {
            let walk = Walk {
                to: here,
                marks,
                steps: None,
            };
            let is_there = self.walk(&walk, &mut |place, seen| {
                last = Some((place.clone(), seen));
            })?;
            if !self.is_as_before(is_there, here) {
                last = None;
            }
        }
        let Some((place, seen)) = last else {
            return self.back_to_start();
        };
        if !self.arrive(&place)? {
            return self.back_to_start();
        }
        let tid = self.current.unwrap_or(0);
        let address = match seen {
            Seen::Break => return Ok(MultiThreadStopReason::SwBreak(self.number_of(tid))),
            Seen::Watch(address) => address,
        };
        // Backwards, the memory changes where its instruction is undone.
        let (addr, kind) = self.watched_at(address);
        let index = self.supervisor_ref().index_of(tid).unwrap_or(0);
        match self.predecessor(&place, index)? {
            Some(before) if !self.arrive(&before)? => return self.back_to_start(),
            None if self.has_missed => return self.back_to_start(),
            _ => {}
        }
        let tid = self.number_of(self.current.unwrap_or(0));
        Ok(MultiThreadStopReason::Watch { tid, kind, addr })
    }

    /// The place one instruction of `thread` before `here`.
    pub(super) fn predecessor(
        &mut self,
        here: &Place,
        thread: u32,
    ) -> Result<Option<Place>, GuestError> {
        if let Some(place) = here.one_step_less(thread) {
            return Ok(Some(place));
        }
        let mut calls = 1;
        loop {
            let base = Moment {
                calls: here.moment.calls.saturating_sub(calls),
                leaps: here.moment.leaps,
            };
            let is_start = base.calls == 0;
            let is_there = match is_start {
                true => self.load_again()?,
                false => self.go_to_moment(base)?,
            };
            if !is_there {
                self.has_missed = (self.goes_on)() && !self.is_broken_off;
                return Ok(None);
            }
            let base = self.place();
            let walk = Walk {
                to: here,
                marks: &Marks::default(),
                steps: Some(thread),
            };
            if let Some(debugging) = self.supervisor().debugging() {
                debugging.limit_steps(STEPS_MAX);
            }
            if !self.walk(&walk, &mut |_, _| {})? {
                if self.is_broken_off {
                    return Ok(None);
                }
                (self.say)("too many instructions back: the program goes back to an earlier call");
                return Ok(Some(base));
            }
            let debugging = self.supervisor().debugging();
            let last = debugging.and_then(|it| it.last_step_of(thread).cloned());
            let before = match here.is_at_watch() {
                // The thread stands behind the instruction that touched the memory, so the last
                // whole step is the instruction before it.
                true => last.filter(|last| last.moment == here.moment),
                // The thread stands where the last instruction ended.
                false => last.and_then(|last| last.one_step_less(thread)),
            };
            if let Some(before) = before {
                return Ok(Some(before));
            }
            if is_start {
                return Ok(None);
            }
            calls *= 2;
        }
    }
}
