//! Turns of a bench's threads: one thread runs at a time, and the order depends on virtual time
//! alone.
//!
//! ```text
//! thread   call -> its turn? -> runs -> cannot continue: waits for a byte, a time, a thread
//!                     ^                                |
//!                     +--- the one that waited longest of those that can continue; if none can,
//!                          the rig runs to its next event
//! ```

mod turn;

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Waker;
use core::time::Duration;
use std::io::{self, ErrorKind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::{self, ThreadId};

use engine::run::Run;
use protocols::Instant;

use crate::state::{PortState, end_of, hung_up, step};

pub(crate) use turn::Turn;

/// Maximum wall time of a turn without a call of the bench.
pub const PATIENCE: Duration = Duration::from_secs(10);
/// A deadline in the infinite future.
pub(crate) const NEVER: Instant = Instant::from_nanos(u64::MAX);

/// The event that a thread or task waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Until {
    /// The turn of the thread.
    Turn,
    /// The deadline only.
    Time,
    /// The deadline only, of the timer with this number.
    Timer(u64),
    /// Bytes or a message at this port.
    Readable(usize),
    /// Room in this port's buffer.
    Room(usize),
    /// The last bit has been sent from this port.
    Sent(usize),
    /// The end of this thread.
    Over(usize),
    /// An action of another thread after this number of actions.
    Act(u64),
    /// A task of the thread that can continue.
    Task,
}

/// An event with a deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wait {
    pub(crate) until: Until,
    pub(crate) deadline: Instant,
}

/// A thread of the bench.
struct Member {
    name: String,
    /// `None`: announced, but not seen yet.
    thread: Option<ThreadId>,
    /// The wait, with its number in the order of waiting.
    wait: Option<(u64, Wait)>,
    is_over: bool,
    /// Only [`Core::join_as`] assigns a thread to this member.
    is_reserved: bool,
    /// Set if the thread runs tasks; the flag says that one of them was woken.
    executor: Option<Arc<AtomicBool>>,
}

/// A waiting future.
struct Task {
    member: usize,
    wait: Wait,
    waker: Waker,
}

/// The state that all threads of a bench share.
pub(crate) struct Core {
    state: Mutex<State>,
    turn: Condvar,
    /// The thread that has borrowed the run, see [`Core::look`].
    viewer: Mutex<Option<ThreadId>>,
}

/// The state behind the lock.
pub(crate) struct State {
    /// `None` after the verdict.
    pub(crate) run: Option<Run>,
    /// Time of the verdict.
    pub(crate) ended: Instant,
    pub(crate) ports: Vec<PortState>,
    members: Vec<Member>,
    tasks: Vec<Task>,
    current: usize,
    waits: u64,
    calls: u64,
    acts: u64,
    spins: (Instant, u32),
    patience: Duration,
    /// The reason why no thread can continue.
    stuck: Option<String>,
}

/// Removes a thread from a bench when the thread ends.
pub(crate) struct Membership {
    core: Weak<Core>,
    index: usize,
}

thread_local! {
    static MEMBERSHIPS: RefCell<Vec<Membership>> = const { RefCell::new(Vec::new()) };
}

impl Drop for Membership {
    fn drop(&mut self) {
        if let Some(core) = self.core.upgrade() {
            core.leave(self.index);
        }
    }
}

impl Core {
    pub(crate) fn new(run: Run, ports: Vec<PortState>) -> Arc<Self> {
        let state = State {
            run: Some(run),
            ended: Instant::ZERO,
            ports,
            members: Vec::new(),
            tasks: Vec::new(),
            current: 0,
            waits: 0,
            calls: 0,
            acts: 0,
            spins: (Instant::ZERO, 0),
            patience: PATIENCE,
            stuck: None,
        };
        let core = Arc::new(Self {
            state: Mutex::new(state),
            turn: Condvar::new(),
            viewer: Mutex::new(None),
        });
        let name = thread::current().name().unwrap_or("main").to_owned();
        let mut state = core.lock();
        let first = state.add_member(name, true);
        state.members[first].thread = Some(thread::current().id());
        state.members[first].wait = None;
        drop(state);
        core
    }

    /// Locks the state, independent of the turn.
    ///
    /// # Panics
    /// If this thread has borrowed the run.
    pub(crate) fn lock(&self) -> MutexGuard<'_, State> {
        let viewer = *self.viewer.lock().unwrap_or_else(PoisonError::into_inner);
        let is_viewed = viewer == Some(thread::current().id());
        assert!(
            !is_viewed,
            "the bench is used while `Bench::run` is borrowed: drop its returned value first"
        );
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Locks the state and borrows the run until [`looked`](Self::looked).
    pub(crate) fn look(&self) -> MutexGuard<'_, State> {
        let state = self.lock();
        let mut viewer = self.viewer.lock().unwrap_or_else(PoisonError::into_inner);
        *viewer = Some(thread::current().id());
        state
    }

    /// Ends the borrow of the run.
    pub(crate) fn looked(&self) {
        let mut viewer = self.viewer.lock().unwrap_or_else(PoisonError::into_inner);
        *viewer = None;
    }

    /// Waits for the turn of this thread.
    pub(crate) fn enter(self: &Arc<Self>) -> io::Result<Turn<'_>> {
        let mut state = self.lock();
        if state.run.is_none() {
            return Err(hung_up());
        }
        let me = state.member_of_this_thread(self)?;
        state.calls += 1;
        let mut state = self.await_turn(state, me)?;
        // The first turn: other threads may wait for actions of this thread before its next wait.
        if state.members[me].wait.take().is_some() {
            state.acts += 1;
        }
        Ok(Turn {
            core: self,
            state,
            me,
        })
    }

    fn await_turn<'a>(
        &'a self,
        mut state: MutexGuard<'a, State>,
        me: usize,
    ) -> io::Result<MutexGuard<'a, State>> {
        loop {
            if let Some(stuck) = &state.stuck {
                return Err(io::Error::new(ErrorKind::Deadlock, stuck.clone()));
            }
            if state.run.is_none() {
                return Err(hung_up());
            }
            if state.current == me || state.members[state.current].is_over {
                state.current = me;
                return Ok(state);
            }
            let (calls, patience) = (state.calls, state.patience);
            let waited = self.turn.wait_timeout(state, patience);
            let (back, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
            state = back;
            if timeout.timed_out() && state.calls == calls && state.current != me {
                state.blame_the_turn();
                self.turn.notify_all();
            }
        }
    }

    /// Announces a thread; returns its index. A thread that is not reserved may be started by a
    /// driver.
    pub(crate) fn announce(&self, name: &str, is_reserved: bool) -> usize {
        self.lock().add_member(name.to_owned(), is_reserved)
    }

    /// Assigns this thread to the announced member `index`, until the returned value is dropped.
    pub(crate) fn join_as(self: &Arc<Self>, index: usize) -> Membership {
        self.lock().members[index].thread = Some(thread::current().id());
        Membership {
            core: Arc::downgrade(self),
            index,
        }
    }

    fn leave(&self, index: usize) {
        let mut state = self.lock();
        state.members[index].is_over = true;
        state.members[index].wait = None;
        state.tasks.retain(|task| task.member != index);
        state.acts += 1;
        state.calls += 1;
        if state.current == index {
            state.hand_over();
        }
        drop(state);
        self.turn.notify_all();
    }

    /// Removes a timer that was dropped.
    pub(crate) fn forget(&self, timer: u64) {
        let viewer = *self.viewer.lock().unwrap_or_else(PoisonError::into_inner);
        if viewer == Some(thread::current().id()) {
            // The timer wakes its future once more, without effect.
            return;
        }
        let mut state = self.lock();
        let is_its = |task: &Task| task.wait.until == Until::Timer(timer);
        let index = state.tasks.iter().position(is_its);
        let task = index.map(|index| state.tasks.remove(index));
        drop(state);
        // A waker may own a future that uses the bench.
        drop(task);
    }

    /// Ends the run and wakes all waiting threads.
    pub(crate) fn end(&self) -> Option<(Run, bool)> {
        let mut state = self.lock();
        let run = state.run.take()?;
        state.ended = run.rig.now();
        let was_read = state.ports.iter().any(|port| port.was_read);
        drop(state);
        self.turn.notify_all();
        Some((run, was_read))
    }

    /// Sets [`PATIENCE`] for this bench.
    pub(crate) fn set_patience(&self, patience: Duration) {
        self.lock().patience = patience;
    }
}

impl State {
    /// The names of the ports.
    pub(crate) fn names(&self) -> Vec<String> {
        self.ports
            .iter()
            .map(|port| port.end.name.clone())
            .collect()
    }

    /// Virtual time.
    pub(crate) fn now(&self) -> Instant {
        self.run.as_ref().map_or(self.ended, |run| run.rig.now())
    }

    /// Whether virtual time has reached the end.
    #[cfg(feature = "tokio")]
    pub(crate) fn is_at_end(&self) -> bool {
        self.now() >= self.end()
    }

    /// The end of the run.
    pub(crate) fn end(&self) -> Instant {
        self.run.as_ref().map_or(self.ended, end_of)
    }

    fn add_member(&mut self, name: String, is_reserved: bool) -> usize {
        self.waits += 1;
        let deadline = Instant::ZERO;
        let until = Until::Turn;
        self.members.push(Member {
            name,
            thread: None,
            wait: Some((self.waits, Wait { until, deadline })),
            is_over: false,
            is_reserved,
            executor: None,
        });
        self.members.len() - 1
    }

    /// The index of this thread. An announced thread is recognised by its name, else as the only
    /// one not seen yet.
    fn member_of_this_thread(&mut self, core: &Arc<Core>) -> io::Result<usize> {
        let this = thread::current();
        let known = |member: &Member| member.thread == Some(this.id()) && !member.is_over;
        if let Some(index) = self.members.iter().position(known) {
            return Ok(index);
        }
        let is_free =
            |member: &Member| member.thread.is_none() && !member.is_over && !member.is_reserved;
        let is_named = |member: &Member| is_free(member) && this.name() == Some(&*member.name);
        let named = self.members.iter().position(is_named);
        let free = self.members.iter().filter(|member| is_free(member));
        let free: Vec<&str> = free.map(|member| &*member.name).collect();
        let name = this.name().unwrap_or("without a name");
        if named.is_none() && free.len() > 1 {
            let free = free.join(", ");
            let message = format!(
                "the thread {name} may be any of the expected threads {free}: give each thread of \
                 the driver the name that `Bench::expect_thread` has"
            );
            return Err(io::Error::other(message));
        }
        let Some(index) = named.or_else(|| self.members.iter().position(is_free)) else {
            let message = format!(
                "the thread {name} is unknown to the bench: start it with `Bench::spawn`, or call \
                 `Bench::expect_thread` before the driver starts it"
            );
            return Err(io::Error::other(message));
        };
        self.members[index].thread = Some(this.id());
        let membership = Membership {
            core: Arc::downgrade(core),
            index,
        };
        MEMBERSHIPS.with_borrow_mut(|all| all.push(membership));
        Ok(index)
    }

    fn blame_the_turn(&mut self) {
        let member = &self.members[self.current];
        let (name, limit) = (&member.name, self.patience);
        let why = match member.thread {
            Some(_) => format!(
                "the thread {name} has the turn and did not call the bench for {limit:?}: it \
                 blocks outside of the bench; wait with `Bench::wait_until`, or judge the run before you \
                 join a driver's thread"
            ),
            None => format!("the expected thread {name} did not call the bench within {limit:?}"),
        };
        self.stuck = Some(why);
    }

    /// Gives the turn to the next thread.
    fn hand_over(&mut self) {
        match self.choose() {
            Some(next) => self.current = next,
            None if self.members.iter().all(|member| member.is_over) => {}
            // All other threads are running.
            None if self.members.iter().all(|one| one.wait.is_none()) => {}
            None => {
                let waiting = self.members.iter().filter(|member| member.wait.is_some());
                let names: Vec<&str> = waiting.map(|member| &*member.name).collect();
                let names = names.join(", ");
                self.stuck = Some(format!(
                    "deadlock: {names} waits for a thread or a future that never comes"
                ));
            }
        }
    }

    /// The next thread to run; the rig runs until there is one.
    fn choose(&mut self) -> Option<usize> {
        loop {
            let mut best: Option<(u64, usize)> = None;
            for index in 0..self.members.len() {
                let Some((number, wait)) = self.members[index].wait else {
                    continue;
                };
                if self.holds(index, wait) && best.is_none_or(|(first, _)| number < first) {
                    best = Some((number, index));
                }
            }
            if let Some((_, index)) = best {
                return Some(index);
            }
            let waits = self.members.iter().filter_map(|member| member.wait);
            let first = waits.map(|(_, wait)| wait.deadline).min()?;
            let tasks = self.tasks.iter().map(|task| task.wait.deadline);
            let deadline = tasks.fold(first, Instant::min);
            let run = self.run.as_mut()?;
            let end = end_of(run);
            if run.rig.now() >= end {
                return None;
            }
            step(run, deadline.min(end));
        }
    }

    fn holds(&mut self, member: usize, wait: Wait) -> bool {
        let Some(run) = &mut self.run else {
            return true;
        };
        let is_over = run.rig.now() >= end_of(run);
        if run.rig.now() >= wait.deadline {
            return true;
        }
        match wait.until {
            Until::Turn => true,
            Until::Time | Until::Timer(_) => false,
            Until::Readable(port) => is_over || self.ports[port].collect(run),
            Until::Room(port) => is_over || self.ports[port].room(run) > 0,
            Until::Sent(port) => is_over || self.ports[port].is_sent(run),
            Until::Over(other) => self.members[other].is_over,
            Until::Act(seen) => self.acts > seen,
            Until::Task => {
                let executor = self.members[member].executor.as_ref();
                executor.is_some_and(|woken| woken.load(Ordering::Relaxed))
                    || (0..self.tasks.len()).any(|index| self.is_ready(member, index))
            }
        }
    }

    fn is_ready(&mut self, member: usize, task: usize) -> bool {
        let Task {
            member: owner,
            wait,
            ..
        } = self.tasks[task];
        owner == member && self.holds(member, wait)
    }
}
