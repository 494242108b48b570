//! A watchdog in wall time for the running thread. It stops a thread that waits in the kernel for
//! an event outside of virtual time, or that computes without end, so that the thread can be named.
//! Computing is measured in processor time, because a thread may wait for its turn on a busy
//! machine. For the same reason, a thread that computes without a call does not mean that virtual
//! time stands.
//!
//! The watchdog has no influence on a verdict, and never stops a thread that makes calls.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, AtomicU64, Ordering};
use core::time::Duration;
use std::fs;
use std::sync::Arc;
use std::thread;

use protocols::Instant;
use rustix::process::{Pid, Signal, kill_process};

use crate::clock::{Clock, WallClock};
use crate::exec::Supervision;

/// Interval between two checks.
const EVERY: Duration = Duration::from_millis(50);
/// Number of checks without a call after which a sleeping thread counts as waiting for the outside
/// world.
const SLEEPS: u32 = 2;
/// `SLEEPS` for a thread that waits for a disk.
const FETCHES: u32 = 200;
/// Processor time without a call after which a thread is stopped so that others can run; the second
/// value is for `--schedule`, where loops that wait for others are common.
const COMPUTES: Duration = Duration::from_secs(1);
const COMPUTES_BY_SCHEDULE: Duration = Duration::from_millis(100);
/// Virtual time may stand for this many times the limit of computing.
const STANDS: u32 = 3;
const STANDS_MIN: Duration = Duration::from_secs(30);

/// The reason why a thread was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kick {
    /// It waits in the kernel.
    Sleeps,
    /// It has computed without a call for this long since it continued.
    Computes(Duration),
}

#[derive(Debug, Default)]
struct Shared {
    /// The running thread and its process; 0: none.
    tid: AtomicI32,
    process: AtomicI32,
    /// Number of its actions.
    steps: AtomicU64,
    /// Milliseconds from its last action to its stop, plus one; 0: it was not stopped.
    kicked: AtomicU32,
    sleeps: AtomicBool,
    /// Number of single steps for a debugger: virtual time stands meanwhile, which is no fault.
    stepped: AtomicU64,
    /// Virtual time in nanoseconds, the number of its updates, and whether the supervisor is
    /// active.
    now: AtomicU64,
    turns: AtomicU64,
    is_at_work: AtomicBool,
    /// Seconds for which virtual time has stood; 0: it advances.
    stood: AtomicU32,
    is_over: AtomicBool,
    /// Number of checks: the only clock that the supervisor reads in its turns.
    beats: AtomicU32,
}

/// The watchdog, on a separate thread, which ends when this value is dropped.
#[derive(Debug)]
pub(super) struct Watchdog {
    shared: Arc<Shared>,
    clock: WallClock,
}

impl Watchdog {
    /// Starts a watchdog for a program whose first process is `root`.
    pub(super) fn start(root: i32, supervision: Supervision) -> Self {
        let shared = Arc::<Shared>::default();
        let watching = Arc::clone(&shared);
        // Without this thread, only the name of a hanging thread is lost.
        let _ = thread::Builder::new()
            .name("watchdog".to_owned())
            .spawn(move || watch(&watching, root, supervision));
        let clock = WallClock::start();
        Self { shared, clock }
    }

    /// Records that this thread runs from now on.
    pub(super) fn watch(&self, tid: i32, process: i32) {
        self.shared.process.store(process, Ordering::Relaxed);
        self.shared.tid.store(tid, Ordering::Relaxed);
        self.count();
    }

    /// Records an action of the running thread.
    pub(super) fn count(&self) {
        self.shared.steps.fetch_add(1, Ordering::Relaxed);
    }

    /// Records a single step for a debugger.
    pub(super) fn count_step(&self) {
        self.shared.stepped.fetch_add(1, Ordering::Relaxed);
    }

    /// Records that the supervisor becomes active at the virtual time `now`.
    pub(super) fn begin_turn(&self, now: Instant) {
        self.shared.turns.fetch_add(1, Ordering::Relaxed);
        self.shared.is_at_work.store(true, Ordering::Relaxed);
        let nanos = (now - Instant::ZERO).as_nanos();
        let nanos = u64::try_from(nanos).unwrap_or(u64::MAX);
        self.shared.now.store(nanos, Ordering::Relaxed);
    }

    /// Records that the supervisor is no longer active.
    pub(super) fn end_turn(&self) {
        self.shared.is_at_work.store(false, Ordering::Relaxed);
    }

    /// Time for which virtual time has stood, if that was too long.
    pub(super) fn stood(&self) -> Option<Duration> {
        let seconds = self.shared.stood.load(Ordering::Relaxed);
        (seconds > 0).then(|| Duration::from_secs(seconds.into()))
    }

    /// Number of checks so far.
    pub(super) fn beats(&self) -> u32 {
        self.shared.beats.load(Ordering::Relaxed)
    }

    /// Records that no thread runs.
    pub(super) fn rest(&self) {
        self.shared.tid.store(0, Ordering::Relaxed);
    }

    /// The reason why the thread was stopped, if it was.
    pub(super) fn take_kick(&self) -> Option<Kick> {
        let millis = self.shared.kicked.swap(0, Ordering::Relaxed);
        let sleeps = self.shared.sleeps.load(Ordering::Relaxed);
        let millis = millis.checked_sub(1)?;
        Some(match sleeps {
            true => Kick::Sleeps,
            false => Kick::Computes(Duration::from_millis(millis.into())),
        })
    }

    /// The watchdog has stopped the thread for this reason.
    #[cfg(test)]
    pub(super) fn has_stopped(&self, kick: Kick) {
        let (sleeps, millis) = match kick {
            Kick::Sleeps => (true, 0),
            Kick::Computes(time) => (false, time.as_millis()),
        };
        let millis = u32::try_from(millis).expect("short") + 1;
        self.shared.sleeps.store(sleeps, Ordering::Relaxed);
        self.shared.kicked.store(millis, Ordering::Relaxed);
    }

    /// Waits in wall time.
    pub(super) fn pause(&self, length: Duration) {
        self.clock.sleep_until(self.clock.now() + length);
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
    }
}

fn watch(shared: &Shared, root: i32, supervision: Supervision) {
    let clock = WallClock::start();
    let mut watching = Watching::new(supervision, clock.now());
    while !shared.is_over.load(Ordering::Relaxed) {
        clock.sleep_until(clock.now() + EVERY);
        shared.beats.fetch_add(1, Ordering::Relaxed);
        let look = Look::at(shared, clock.now());
        match watching.look(&look) {
            Found::Nothing => {}
            Found::Stands(seconds) => {
                shared.stood.store(seconds, Ordering::Relaxed);
                // Killing the processes ends any wait.
                for pid in [look.process, root].into_iter().filter_map(Pid::from_raw) {
                    let _ = kill_process(pid, Signal::KILL);
                }
                return;
            }
            Found::Kicks { sleeps, millis } => {
                shared.sleeps.store(sleeps, Ordering::Relaxed);
                shared
                    .kicked
                    .store(millis.saturating_add(1), Ordering::Relaxed);
                if let Some(pid) = Pid::from_raw(look.process) {
                    let _ = kill_process(pid, Signal::STOP);
                }
            }
        }
    }
}

/// Observations of one check.
#[derive(Clone, Copy, Debug)]
struct Look {
    wall: Instant,
    /// Virtual time, and the number of its updates.
    now: u64,
    turns: u64,
    is_at_work: bool,
    /// Number of single steps for a debugger.
    stepped: u64,
    /// The running thread and its process; 0: none.
    tid: i32,
    process: i32,
    /// Processor time and state of this thread, if the system reports them.
    counted: Option<Duration>,
    state: Option<char>,
    /// Number of its actions.
    steps: u64,
}

impl Look {
    fn at(shared: &Shared, wall: Instant) -> Self {
        let now = shared.now.load(Ordering::Relaxed);
        let turns = shared.turns.load(Ordering::Relaxed);
        let is_at_work = shared.is_at_work.load(Ordering::Relaxed);
        let stepped = shared.stepped.load(Ordering::Relaxed);
        let tid = shared.tid.load(Ordering::Relaxed);
        let process = shared.process.load(Ordering::Relaxed);
        Self {
            wall,
            now,
            turns,
            is_at_work,
            stepped,
            tid,
            process,
            counted: used(process, tid).filter(|_| tid != 0),
            state: state(process, tid).filter(|_| tid != 0),
            steps: shared.steps.load(Ordering::Relaxed),
        }
    }
}

/// Result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Found {
    Nothing,
    /// Virtual time has stood for this many seconds.
    Stands(u32),
    /// The thread must be stopped: it sleeps, or has computed for this many milliseconds.
    Kicks {
        sleeps: bool,
        millis: u32,
    },
}

/// Results of the checks so far.
struct Watching {
    spin_max: Duration,
    computes: Duration,
    patience: Duration,
    steps: u64,
    stepped: u64,
    looks: u32,
    /// State of the thread in all checks since its last action.
    seen: Option<char>,
    since: Duration,
    time: u64,
    turns: u64,
    moved_at: Instant,
    /// Thread and value of the last measured processor time.
    last: (i32, Duration),
}

impl Watching {
    fn new(supervision: Supervision, moved_at: Instant) -> Self {
        let spin_max = supervision.spin_max;
        Self {
            spin_max,
            computes: match supervision.schedule {
                Some(_) => COMPUTES_BY_SCHEDULE,
                None => COMPUTES,
            },
            patience: (spin_max * STANDS).max(STANDS_MIN),
            steps: 0,
            stepped: 0,
            looks: 0,
            seen: None,
            since: Duration::ZERO,
            time: 0,
            turns: 0,
            moved_at,
            last: (0, Duration::ZERO),
        }
    }

    fn look(&mut self, look: &Look) -> Found {
        let wall = look.wall;
        if core::mem::replace(&mut self.time, look.now) != look.now {
            self.moved_at = wall;
        }
        // No thread continues between two turns.
        let has_turned = core::mem::replace(&mut self.turns, look.turns) != look.turns;
        if !has_turned && !look.is_at_work {
            self.moved_at = wall;
        }
        if core::mem::replace(&mut self.stepped, look.stepped) != look.stepped {
            self.moved_at = wall;
        }
        let has_computed = has_computed(&mut self.last, look.tid, look.counted);
        // Another limit applies to computing without a call. Calls that take no virtual time are
        // counted.
        if has_computed && look.state == Some('R') && look.steps == self.steps {
            self.moved_at = wall;
        }
        if wall - self.moved_at >= self.patience {
            let seconds = (wall - self.moved_at).as_secs();
            return Found::Stands(u32::try_from(seconds).unwrap_or(u32::MAX));
        }
        let used = look.counted.unwrap_or(wall - Instant::ZERO);
        if look.tid == 0 || look.steps != self.steps {
            (self.steps, self.looks, self.since) = (look.steps, 0, used);
            return Found::Nothing;
        }
        if core::mem::replace(&mut self.seen, look.state) != look.state {
            (self.looks, self.since) = (0, used);
        }
        self.looks += 1;
        let computed = used.saturating_sub(self.since);
        let (sleeps, is_enough) = match look.state {
            Some('S') => (true, self.looks >= SLEEPS),
            // The thread waits for a disk, which may take long on a busy machine.
            Some('D') => (true, self.looks >= FETCHES),
            Some('R') => (false, computed >= self.spin_max.min(self.computes)),
            _ => return Found::Nothing,
        };
        if !is_enough {
            return Found::Nothing;
        }
        (self.looks, self.since) = (0, used);
        let millis = u32::try_from(computed.as_millis()).unwrap_or(u32::MAX);
        Found::Kicks { sleeps, millis }
    }
}

/// Whether a thread has used processor time since the last check.
const fn has_computed(last: &mut (i32, Duration), tid: i32, used: Option<Duration>) -> bool {
    let Some(used) = used else {
        return false;
    };
    let (before, was) = core::mem::replace(last, (tid, used));
    before == tid && used.as_nanos() > was.as_nanos()
}

/// Processor time that a thread has used; `None` if the system does not report it.
fn used(process: i32, tid: i32) -> Option<Duration> {
    let text = fs::read_to_string(format!("/proc/{process}/task/{tid}/schedstat")).ok()?;
    let nanos = text.split_ascii_whitespace().next()?.parse().ok()?;
    match nanos {
        // Some kernels do not count it, and print zeros.
        0 => ticks(&fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?),
        nanos => Some(Duration::from_nanos(nanos)),
    }
}

/// Processor time by a line of `stat`: fields 14 and 15, in hundredths of a second (proc(5)).
fn ticks(stat: &str) -> Option<Duration> {
    let (_, fields) = stat.rsplit_once(") ")?;
    // The third field of the line is the first one here.
    let mut fields = fields.split_ascii_whitespace().skip(11);
    let mut next = || fields.next()?.parse::<u64>().ok();
    let ticks = next()?.saturating_add(next()?);
    Some(Duration::from_millis(ticks.saturating_mul(10)))
}

/// State of a thread, as the system's letter.
fn state(process: i32, tid: i32) -> Option<char> {
    let stat = fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?;
    let (_, fields) = stat.rsplit_once(") ")?;
    fields.chars().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thread that waits for its turn, or one that was not watched before, proves nothing.
    #[test]
    fn only_growing_processor_time_of_one_thread_is_computing() {
        let mut last = (0, Duration::ZERO);
        let mut look =
            |tid, millis| has_computed(&mut last, tid, Some(Duration::from_millis(millis)));
        let looks = [(7, 5), (7, 9), (7, 9), (8, 20), (8, 21)];
        let looks = looks.map(|(tid, millis)| look(tid, millis));
        assert_eq!(looks, [false, true, false, false, true]);
        assert!(!has_computed(&mut last, 8, None));
    }

    /// proc(5): utime and stime are fields 14 and 15; a name may hold brackets and spaces.
    #[test]
    fn processor_time_is_read_from_a_line_of_stat() {
        let stat = "7 (a ) b) R 1 7 7 0 -1 4194304 90 0 0 0 123 45 6 7 20 0 1 0 99 100 1";
        assert_eq!(ticks(stat), Some(Duration::from_millis(1_680)));
        assert_eq!(ticks("7 (a) R 1"), None);
    }

    /// A watch that no thread looks at.
    fn still() -> Watchdog {
        Watchdog {
            shared: Arc::default(),
            clock: WallClock::start(),
        }
    }

    #[test]
    fn the_watch_hears_what_the_supervisor_does() {
        let dog = still();
        let relaxed = Ordering::Relaxed;
        dog.watch(7, 5);
        let shared = &dog.shared;
        assert_eq!(
            (shared.tid.load(relaxed), shared.process.load(relaxed)),
            (7, 5)
        );
        assert_eq!(shared.steps.load(relaxed), 1);
        dog.count();
        assert_eq!(
            (shared.steps.load(relaxed), shared.stepped.load(relaxed)),
            (2, 0)
        );
        dog.count_step();
        assert_eq!(
            (shared.steps.load(relaxed), shared.stepped.load(relaxed)),
            (2, 1)
        );
        dog.rest();
        assert_eq!(
            (shared.tid.load(relaxed), shared.process.load(relaxed)),
            (0, 5)
        );
        dog.begin_turn(Instant::from_nanos(9));
        let turn = |dog: &Watchdog| {
            let shared = &dog.shared;
            (
                shared.turns.load(relaxed),
                shared.is_at_work.load(relaxed),
                shared.now.load(relaxed),
            )
        };
        assert_eq!(turn(&dog), (1, true, 9));
        dog.end_turn();
        assert_eq!(turn(&dog), (1, false, 9));
        shared.beats.store(3, relaxed);
        assert_eq!(dog.beats(), 3);
        assert_eq!(dog.stood(), None);
        shared.stood.store(31, relaxed);
        assert_eq!(dog.stood(), Some(Duration::from_secs(31)));
        let shared = Arc::clone(&dog.shared);
        drop(dog);
        assert!(shared.is_over.load(relaxed), "its thread ends");
    }

    /// The milliseconds are one more than they were, so that 0 is no kick; it is told once.
    #[test]
    fn a_kick_is_told_once() {
        let dog = still();
        assert_eq!(dog.take_kick(), None);
        let kick = |millis, sleeps| {
            dog.shared.kicked.store(millis, Ordering::Relaxed);
            dog.shared.sleeps.store(sleeps, Ordering::Relaxed);
            let kick = dog.take_kick();
            assert_eq!(dog.take_kick(), None);
            kick
        };
        assert_eq!(kick(1, true), Some(Kick::Sleeps));
        assert_eq!(kick(1, false), Some(Kick::Computes(Duration::ZERO)));
        assert_eq!(
            kick(1_001, false),
            Some(Kick::Computes(Duration::from_secs(1)))
        );
        assert_eq!(kick(0, true), None);
    }

    /// proc(5): the third field of `stat` is S for a sleep, R for a thread that runs, T for one
    /// that was stopped, t for one that a tracer stopped.
    #[test]
    fn the_state_of_a_thread_is_a_letter() {
        let stopped = crate::guest::tests::Stopped::new();
        let pid = stopped.pid.as_raw();
        assert_eq!(state(pid, pid), Some('t'));
        assert_eq!((state(-1, -1), used(-1, -1)), (None, None));
        let own = nix::unistd::gettid().as_raw();
        let process = std::process::id().cast_signed();
        assert_eq!(state(process, own), Some('R'));
        assert!(used(process, own).is_some());
        // Fields behind the name: the twelfth and the thirteenth of them.
        let stat = "7 (a) R 1 7 7 0 -1 4194304 90 0 0 0 1 0 6 7 20 0 1 0 99 100 1";
        assert_eq!(ticks(stat), Some(Duration::from_millis(10)));
        let most = format!("7 (a) R 1 7 7 0 -1 4194304 90 0 0 0 {} 1 6", u64::MAX);
        assert_eq!(ticks(&most), Some(Duration::from_millis(u64::MAX)));
    }

    /// A thread that runs: number 7 of process 5, in its first turn.
    const RUNS: Look = Look {
        wall: Instant::ZERO,
        now: 0,
        turns: 1,
        is_at_work: true,
        stepped: 0,
        tid: 7,
        process: 5,
        counted: None,
        state: Some('R'),
        steps: 1,
    };

    fn by(spin_max: u64, schedule: bool) -> Watching {
        let supervision = Supervision {
            spin_max: Duration::from_secs(spin_max),
            schedule: schedule.then_some(crate::exec::Schedule::Seed(1)),
            ..Supervision::default()
        };
        Watching::new(supervision, Instant::ZERO)
    }

    /// Looks each 50 ms; the numbers of the looks with a result, and the results.
    fn results(watching: &mut Watching, count: u64, of: impl Fn(u64) -> Look) -> Vec<(u64, Found)> {
        let looks = (1..=count).map(|index| {
            let wall = Instant::from_millis(50 * index);
            let look = Look { wall, ..of(index) };
            (index, watching.look(&look))
        });
        looks
            .filter(|(_, found)| *found != Found::Nothing)
            .collect()
    }

    const SLEEPS_NOW: Found = Found::Kicks {
        sleeps: true,
        millis: 0,
    };

    /// By hand: the first look sees the last action; each second one after it is a stop. For a
    /// thread that waits for a disk, each 200th one is.
    #[test]
    fn a_thread_that_sleeps_is_stopped() {
        let asleep = |state| {
            move |_| Look {
                state: Some(state),
                counted: Some(Duration::from_millis(3)),
                ..RUNS
            }
        };
        let found = results(&mut by(10, false), 5, asleep('S'));
        assert_eq!(found, [(3, SLEEPS_NOW), (5, SLEEPS_NOW)]);
        let found = results(&mut by(10, false), 402, asleep('D'));
        assert_eq!(found, [(201, SLEEPS_NOW), (401, SLEEPS_NOW)]);
        assert!(results(&mut by(10, false), 100, asleep('t')).is_empty());
        // One that acts, or that sleeps and runs in turn, is not; nor is no thread.
        let acts = |index| Look {
            steps: index,
            ..asleep('S')(index)
        };
        assert!(results(&mut by(10, false), 100, acts).is_empty());
        let changes = |index: u64| asleep(if index.is_multiple_of(2) { 'S' } else { 'R' })(index);
        assert!(results(&mut by(10, false), 100, changes).is_empty());
        let none = |index| Look {
            tid: 0,
            ..asleep('S')(index)
        };
        assert!(results(&mut by(10, false), 100, none).is_empty());
    }

    /// By hand: the second look is the first that sees the thread run, with 40 ms. After 1 s more
    /// it is stopped; with `--schedule` after 100 ms, and with a limit below 1 s after that.
    #[test]
    fn a_thread_that_computes_is_stopped() {
        let computes = |index| Look {
            counted: Some(Duration::from_millis(20 * index)),
            ..RUNS
        };
        let stops = |millis| Found::Kicks {
            sleeps: false,
            millis,
        };
        let found = results(&mut by(10, false), 101, computes);
        assert_eq!(found, [(52, stops(1_000))]);
        let found = results(&mut by(10, true), 12, computes);
        assert_eq!(found, [(7, stops(100)), (12, stops(100))]);
        let found = results(&mut by(0, false), 3, computes);
        assert_eq!(found, [(2, stops(0)), (3, stops(20))]);
        // Without a measure it is the time of the wall.
        let found = results(&mut by(10, false), 25, |_| RUNS);
        assert_eq!(found, [(22, stops(1_000))]);
    }

    /// By hand: three times the limit of computing, and at least 30 s: 600 looks after the last
    /// progress.
    #[test]
    fn virtual_time_that_stands_is_an_end() {
        let first = |limit, of: &dyn Fn(u64) -> Look| {
            let mut watching = by(limit, false);
            let mut found = results(&mut watching, 2_000, |index| Look {
                steps: index,
                ..of(index)
            });
            found.truncate(1);
            found
        };
        let stands = |_| RUNS;
        // The first look sees the first turn, but no progress of time.
        assert_eq!(first(10, &stands), [(600, Found::Stands(30))]);
        assert_eq!(first(5, &stands), [(600, Found::Stands(30))]);
        assert_eq!(first(20, &stands), [(1_200, Found::Stands(60))]);
        // Time that moves, up to the 100th look.
        let moves = |index: u64| Look {
            now: index.min(100),
            ..RUNS
        };
        assert_eq!(first(10, &moves), [(700, Found::Stands(30))]);
        let steps = |index: u64| Look {
            stepped: index.min(100),
            ..RUNS
        };
        assert_eq!(first(10, &steps), [(700, Found::Stands(30))]);
        // Between two turns nothing has to move; a turn that began and ended is one.
        let rests = |index: u64| Look {
            is_at_work: index > 100,
            ..RUNS
        };
        assert_eq!(first(10, &rests), [(700, Found::Stands(30))]);
        let turns = |index: u64| Look {
            is_at_work: false,
            turns: index,
            ..RUNS
        };
        assert_eq!(first(10, &turns), [(600, Found::Stands(30))]);
    }

    /// A thread that computes without an action has another limit.
    #[test]
    fn virtual_time_may_stand_while_a_thread_computes() {
        let ends = |of: &dyn Fn(u64) -> Look| {
            let found = results(&mut by(10, false), 1_000, of);
            found
                .into_iter()
                .any(|(_, found)| matches!(found, Found::Stands(_)))
        };
        let computes = |index| Look {
            counted: Some(Duration::from_millis(index)),
            ..RUNS
        };
        assert!(!ends(&computes));
        assert!(ends(&|index| Look {
            steps: index,
            ..computes(index)
        }));
        assert!(ends(&|index| Look {
            state: Some('S'),
            ..computes(index)
        }));
        assert!(ends(&|_| computes(3)));
    }

    /// What a check observes of this very thread.
    #[test]
    fn a_look_is_that_of_the_running_thread() {
        let dog = still();
        let own = nix::unistd::gettid().as_raw();
        dog.watch(own, std::process::id().cast_signed());
        dog.begin_turn(Instant::from_nanos(9));
        dog.count_step();
        let wall = Instant::from_millis(8);
        let look = Look::at(&dog.shared, wall);
        let times = (look.wall, look.now, look.turns, look.is_at_work);
        assert_eq!(times, (wall, 9, 1, true));
        assert_eq!((look.tid, look.steps, look.stepped), (own, 1, 1));
        assert_eq!(look.state, Some('R'));
        assert!(look.counted.is_some());
        dog.rest();
        let look = Look::at(&dog.shared, wall);
        assert_eq!((look.tid, look.counted, look.state), (0, None, None));
    }
}
