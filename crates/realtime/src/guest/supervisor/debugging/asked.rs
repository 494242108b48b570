//! Requests of the debugger, and the answers.

use super::watch::WATCHES;
use super::{Debugging, Goal, PortWrite, Step, Watchpoint};
use crate::guest::place::{Moment, Place};
use engine::run::Run;

impl Debugging {
    pub(super) fn has_come(&mut self, run: &Run) -> bool {
        let has_come = match &self.goal {
            Some(Goal::Time(at)) => run.rig.now() >= *at,
            Some(Goal::Condition(watch)) => run.has_come(watch),
            Some(Goal::Moment(moment)) => self.place.moment >= *moment,
            None => false,
        };
        if has_come {
            self.goal = None;
        }
        has_come
    }

    /// The thread of the last stop, if there is one.
    pub(in crate::guest) const fn held_thread(&self) -> Option<i32> {
        match self.held {
            Some((tid, _)) => Some(tid),
            None => None,
        }
    }

    pub(in crate::guest) const fn place(&self) -> &Place {
        &self.place
    }

    pub(in crate::guest) fn set_step(&mut self, step: Option<Step>) {
        self.step = step;
    }

    /// Limits the number of single steps after which a thread stops at any place.
    pub(in crate::guest) const fn limit_steps(&mut self, count: u64) {
        self.steps_left = count;
    }

    /// The end of the last single step of a thread.
    pub(in crate::guest) fn last_step_of(&self, thread: u32) -> Option<&Place> {
        let (of, place) = self.last_step.as_ref()?;
        (*of == thread).then_some(place)
    }

    pub(in crate::guest) fn set_goal(&mut self, goal: Option<Goal>) {
        self.goal = goal;
    }

    /// The first program that used a port.
    pub(in crate::guest) const fn port_user(&self) -> Option<u32> {
        self.port_user
    }

    /// File names of the programs that were started.
    pub(in crate::guest) fn started(&self) -> &[String] {
        &self.started
    }

    /// The watched memory.
    pub(in crate::guest) fn watches(&self) -> &[Watchpoint] {
        &self.watches
    }

    /// The addresses of the breakpoints.
    pub(in crate::guest) fn break_addresses(&self) -> Vec<u64> {
        self.breaks.keys().chain(&self.pending).copied().collect()
    }

    /// Replaces all watchpoints.
    pub(in crate::guest) fn set_watches(&mut self, watches: Vec<Watchpoint>) {
        if self.watches != watches {
            self.watches = watches;
            self.watch_changes += 1;
        }
    }

    /// The writes to ports, and the moment at which the last call of the debugged process began.
    pub(in crate::guest) fn take_log(&mut self) -> (Vec<PortWrite>, Moment) {
        (core::mem::take(&mut self.writes), self.last_call)
    }

    /// Adds a watchpoint; returns `false` if the processor has no register left for it.
    pub(in crate::guest) fn add_watch(&mut self, watch: Watchpoint) -> bool {
        let is_whole =
            matches!(watch.len, 1 | 2 | 4 | 8) && watch.address.is_multiple_of(watch.len);
        if !is_whole || self.watches.len() >= WATCHES {
            return false;
        }
        self.watches.push(watch);
        self.watch_changes += 1;
        true
    }

    pub(in crate::guest) fn remove_watch(&mut self, watch: Watchpoint) -> bool {
        let Some(index) = self.watches.iter().position(|it| *it == watch) else {
            return false;
        };
        self.watches.remove(index);
        self.watch_changes += 1;
        true
    }
}
