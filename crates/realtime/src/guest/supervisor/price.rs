//! The price of computing: what a thread has computed passes before its next call, for that thread.
//! Others run meanwhile, as on processors of their own.

use core::time::Duration;

use super::{Flow, Next, Supervisor};
use crate::clock::processor_time;
use crate::guest::computing::Computing;
use crate::guest::programs::files_of;

impl Supervisor {
    /// Processor time of the process of `tid`, if computing is measured. One thread runs at a time,
    /// so what is added is that thread's.
    pub(super) fn processor_time_of(&self, tid: i32) -> Option<Duration> {
        self.computing.as_ref().filter(|it| it.measures())?;
        processor_time(self.threads.get(&tid)?.process)
    }

    /// The thread has stopped, which ran since its process had used `before`.
    pub(super) fn has_computed(&mut self, tid: i32, before: Option<Duration>) {
        let Some((before, now)) = before.zip(self.processor_time_of(tid)) else {
            return;
        };
        let index = self.threads.get(&tid).map(|thread| thread.index);
        if let (Some(index), Some(computing)) = (index, &mut self.computing) {
            computing.used(index, now.saturating_sub(before));
        }
    }

    /// A thread has waited for another one in a loop without a call, which is no computing.
    pub(super) fn forgive_computing(&mut self, tid: i32) {
        let index = self.threads.get(&tid).map(|thread| thread.index);
        if let (Some(index), Some(computing)) = (index, &mut self.computing) {
            computing.forgive(index);
        }
    }

    /// The process has become another program.
    pub(super) fn note_program(&mut self, process: i32) {
        if let Some(computing) = &mut self.computing {
            computing.runs(files_of(process));
        }
    }

    /// A thread begins a call: it waits while its computing before that passes.
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

    /// The charges of the run so far.
    pub(in crate::guest) const fn computing(&self) -> Option<&Computing> {
        self.computing.as_ref()
    }

    /// The charges of an earlier run of the same program, up to where that came.
    pub(in crate::guest) fn charge_again(&mut self, earlier: Computing) {
        self.computing = Some(earlier.again());
    }
}
