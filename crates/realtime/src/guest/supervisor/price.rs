//! The price of computing: a thread's computing time passes before its next call, for this thread
//! only. Other threads run meanwhile, as on other processors.

use core::time::Duration;

use super::{Flow, Next, Supervisor};
use crate::clock::processor_time;
use crate::guest::computing::Computing;
use crate::guest::programs::files_of;

impl Supervisor {
    /// Processor time of the process of `tid`, if computing is measured. One thread runs at a time,
    /// so an increase belongs to that thread.
    pub(super) fn processor_time_of(&self, tid: i32) -> Option<Duration> {
        self.computing.as_ref().filter(|it| it.measures())?;
        processor_time(self.threads.get(&tid)?.process)
    }

    /// Records the computing of a thread that has stopped. `before` is the processor time of its
    /// process when the thread continued.
    pub(super) fn has_computed(&mut self, tid: i32, before: Option<Duration>) {
        let Some((before, now)) = before.zip(self.processor_time_of(tid)) else {
            return;
        };
        let index = self.threads.get(&tid).map(|thread| thread.index);
        if let (Some(index), Some(computing)) = (index, &mut self.computing) {
            computing.used(index, now.saturating_sub(before));
        }
    }

    /// Makes the last computing free, because the thread only waited for another one in a loop
    /// without a call.
    pub(super) fn forgive_computing(&mut self, tid: i32) {
        let index = self.threads.get(&tid).map(|thread| thread.index);
        if let (Some(index), Some(computing)) = (index, &mut self.computing) {
            computing.forgive(index);
        }
    }

    /// Records the program of a process that has executed another program.
    pub(super) fn note_program(&mut self, process: i32) {
        if let Some(computing) = &mut self.computing {
            computing.runs(files_of(process));
        }
    }

    /// Lets a thread that begins a call wait until its computing before the call has passed.
    pub(super) fn charge_computing(&mut self, tid: i32) -> Option<Flow> {
        if self.stage.is_frozen {
            return None;
        }
        let thread = self.threads.get(&tid)?;
        let number = thread.call?.number;
        let charge = self.computing.as_mut()?.charge(thread.index, number);
        if charge.is_zero() {
            return None;
        }
        self.delay(tid, charge, Next::Charged);
        Some(Flow::Stays)
    }

    /// All charges of the run so far.
    pub(in crate::guest) const fn computing(&self) -> Option<&Computing> {
        self.computing.as_ref()
    }

    /// Uses the charges of an earlier run of the same program, up to its end.
    pub(in crate::guest) fn charge_again(&mut self, earlier: Computing) {
        self.computing = Some(earlier.again());
    }
}
