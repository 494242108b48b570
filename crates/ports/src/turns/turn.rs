//! The turn of a thread: its access to the rig, and its waits.

use core::sync::atomic::AtomicBool;
use core::task::{Context, Poll, Waker};
use core::time::Duration;
use std::io;
use std::sync::{Arc, MutexGuard};

use engine::run::Run;
use protocols::Instant;

use super::{Core, NEVER, State, Task, Until, Wait};
use crate::state::{PortState, hung_up};

/// Number of queries at one instant after which further queries take time.
const SPINS: u32 = 100;
/// Virtual time of such a query.
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

    /// The end of the run.
    pub(crate) fn end(&self) -> Instant {
        self.state.end()
    }

    /// The index of the port `name`.
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

    /// Hands over the turn until `wait` is over.
    pub(crate) fn wait(self, until: Until, deadline: Instant) -> io::Result<Self> {
        let Self {
            core,
            mut state,
            me,
        } = self;
        let deadline = match until {
            // Virtual time stops at the end of the run.
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

    /// Number of actions of other threads so far.
    pub(crate) fn acts(&self) -> u64 {
        self.state.acts
    }

    /// Records an action that another thread may wait for.
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

    /// Ends a query. After very many queries at one instant, a query takes time, so that a polling
    /// loop ends.
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

    /// Like [`wait`](Self::wait), for a future: returns whether it can continue; otherwise `cx` is
    /// woken later.
    ///
    /// # Errors
    /// If the executor of the future does not belong to the bench: the future would never be woken.
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

    /// Waits until a task of this thread can continue, at most until `deadline`, and wakes all
    /// tasks that can.
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

    /// Sets or removes the executor of this thread; returns the previous one.
    pub(crate) fn set_executor(
        &mut self,
        executor: Option<Arc<AtomicBool>>,
    ) -> Option<Arc<AtomicBool>> {
        let member = &mut self.state.members[self.me];
        core::mem::replace(&mut member.executor, executor)
    }
}
