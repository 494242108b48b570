//! The turn of a thread: what it may do with the rig, and how it waits.

use core::sync::atomic::AtomicBool;
use core::task::{Context, Poll, Waker};
use core::time::Duration;
use std::io;
use std::sync::{Arc, MutexGuard};

use engine::run::Run;
use protocols::Instant;

use super::{Core, NEVER, State, Task, Until, Wait};
use crate::state::{PortState, hung_up};

/// Questions in one instant before further ones take time.
const SPINS: u32 = 100;
/// Time that such a question takes.
const SPIN: Duration = Duration::from_micros(10);

/// The turn of one thread.
pub(crate) struct Turn<'a> {
    pub(super) core: &'a Arc<Core>,
    pub(super) state: MutexGuard<'a, State>,
    pub(super) me: usize,
}

impl<'a> Turn<'a> {
    /// The run and a port.
    pub(crate) fn port(&mut self, index: usize) -> io::Result<(&mut Run, &mut PortState)> {
        let state = &mut *self.state;
        let run = state.run.as_mut().ok_or_else(hung_up)?;
        Ok((run, &mut state.ports[index]))
    }

    /// Virtual time.
    pub(crate) fn now(&self) -> Instant {
        self.state.now()
    }

    /// When the run is over.
    pub(crate) fn end(&self) -> Instant {
        self.state.end()
    }

    /// The number of the port `name`.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.state
            .ports
            .iter()
            .position(|port| port.end.name == name)
    }

    /// The names of the ports.
    pub(crate) fn names(&self) -> Vec<String> {
        self.state.names()
    }

    /// Lets others go on until `wait` is over.
    pub(crate) fn wait(self, until: Until, deadline: Instant) -> io::Result<Self> {
        let Self {
            core,
            mut state,
            me,
        } = self;
        let deadline = match until {
            // At the end virtual time stands.
            Until::Time | Until::Task if deadline != NEVER => deadline.min(state.end()),
            _ => deadline,
        };
        state.waits += 1;
        let number = state.waits;
        state.members[me].wait = Some((number, Wait { until, deadline }));
        state.hand_over();
        if state.current != me {
            core.turn.notify_all();
        }
        let mut state = core.await_turn(state, me)?;
        state.members[me].wait = None;
        if !matches!(until, Until::Act(_)) {
            state.acts += 1;
        }
        Ok(Self { core, state, me })
    }

    /// What other threads did so far.
    pub(crate) fn acts(&self) -> u64 {
        self.state.acts
    }

    /// This thread does something for which another may wait.
    pub(crate) fn act(&mut self) {
        self.state.acts += 1;
    }

    /// The number of a new timer.
    pub(crate) fn new_timer(&mut self) -> u64 {
        self.state.waits += 1;
        self.state.waits
    }

    /// An error if the run is over.
    pub(crate) fn check_open(&self) -> io::Result<()> {
        match self.now() < self.end() {
            true => Ok(()),
            false => Err(hung_up()),
        }
    }

    /// A call that asked for a state: one of very many in the same instant takes time, so that a
    /// loop that asks again and again ends.
    ///
    /// # Errors
    /// If the run is over.
    pub(crate) fn asked(mut self) -> io::Result<()> {
        self.check_open()?;
        let now = self.now();
        let (at, count) = self.state.spins;
        let count = if at == now { count + 1 } else { 1 };
        self.state.spins = (now, count);
        if count > SPINS {
            self.wait(Until::Time, now + SPIN)?;
        }
        Ok(())
    }

    /// The same as [`wait`](Self::wait) for a future: whether it can go on; else `cx` is woken.
    ///
    /// # Errors
    /// If no executor of the bench polls it: nothing would ever wake it.
    pub(crate) fn poll(
        &mut self,
        cx: &Context<'_>,
        until: Until,
        deadline: Instant,
    ) -> Poll<io::Result<()>> {
        let wait = Wait { until, deadline };
        let (me, state) = (self.me, &mut *self.state);
        if state.holds(me, wait) {
            return Poll::Ready(Ok(()));
        }
        if state.members[me].executor.is_none() {
            let message = "a port of the bench is polled by a foreign executor, which does not \
                           know virtual time: run the future with `Bench::block_on` or `Bench::tokio`";
            return Poll::Ready(Err(io::Error::other(message)));
        }
        let is_known = |task: &Task| {
            task.member == me && task.wait == wait && task.waker.will_wake(cx.waker())
        };
        state.tasks.retain(|task| !is_known(task));
        let waker = cx.waker().clone();
        state.tasks.push(Task {
            member: me,
            wait,
            waker,
        });
        Poll::Pending
    }

    /// Waits until a task of this thread can go on, at most until `deadline`, and wakes all that
    /// can.
    pub(crate) fn wait_for_tasks(self, deadline: Instant) -> io::Result<()> {
        let mut turn = self.wait(Until::Task, deadline)?;
        let me = turn.me;
        let mut wakers = Vec::new();
        let mut index = 0;
        while index < turn.state.tasks.len() {
            if turn.state.is_ready(me, index) {
                wakers.push(turn.state.tasks.remove(index).waker);
            } else {
                index += 1;
            }
        }
        drop(turn);
        wakers.into_iter().for_each(Waker::wake);
        Ok(())
    }

    /// Sets or removes the executor of this thread; the one before.
    pub(crate) fn set_executor(
        &mut self,
        executor: Option<Arc<AtomicBool>>,
    ) -> Option<Arc<AtomicBool>> {
        let member = &mut self.state.members[self.me];
        core::mem::replace(&mut member.executor, executor)
    }
}
