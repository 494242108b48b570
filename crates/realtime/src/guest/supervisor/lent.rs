//! The loan to the running thread: with it, the thread reads clocks and ports without a stop.

use core::time::Duration;
use std::sync::Arc;

use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;
use protocols::Instant;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::files::{File, Kind, numbers};
use super::{On, SLICE, State, Supervisor, Thread};
use crate::guest::clock_page::ClockPage;
use crate::guest::detour;
use crate::guest::error::GuestError;
use crate::guest::launch::KEPT_BELOW;
use crate::guest::lent::{LentPort, Loan, Taken};
use crate::guest::trace::Record;
use crate::transport::Code;

/// Number of looks and calls in a new turn.
const TURN: u64 = SLICE as u64 - 1;
/// Minimum and maximum time ahead for which bytes are lent.
const AHEAD: [Duration; 2] = [Duration::from_millis(2), Duration::from_millis(10)];
/// Number of consecutive loans of bytes that a program may leave unused; after that, bytes are lent
/// only once in `RETRY_EVERY` calls.
const UNUSED_MAX: u32 = 8;
const RETRY_EVERY: u64 = 64;
/// Files with numbers below this one are bits of a word.
const BITS: i32 = 63;
/// Maximum number of ports that are lent at once.
const PORTS_MAX: usize = 4;

/// A loan of bytes in addition to time.
#[derive(Debug)]
pub(super) struct Lease {
    ports: Vec<LentPort>,
    /// Its start and its limit.
    from: Instant,
    limit: Instant,
    /// Number of lent looks and calls.
    calls: u64,
    /// Time ahead for the next loan of bytes, and number of consecutive loans without a use.
    ahead: Duration,
    unused: u32,
    has_waited: bool,
    /// Whether the program's page holds this loan.
    is_lent: bool,
}

impl Default for Lease {
    fn default() -> Self {
        Self {
            ports: Vec::new(),
            from: Instant::ZERO,
            limit: Instant::ZERO,
            calls: 0,
            ahead: AHEAD[0],
            unused: 0,
            has_waited: false,
            is_lent: false,
        }
    }
}

impl Lease {
    /// Whether the thread has waited without a stop since the last call.
    pub(super) const fn take_has_waited(&mut self) -> bool {
        core::mem::replace(&mut self.has_waited, false)
    }

    /// Adapts the length of the next loan to the use of this one.
    fn learn(&mut self, ports: &[LentPort], taken: &Taken) {
        let is_used = !taken.reads.is_empty() || taken.selects + taken.counts > 0;
        self.unused = if is_used { 0 } else { self.unused + 1 };
        let is_empty = |(index, port): (usize, &LentPort)| {
            let reads = taken.reads.iter().filter(|read| read.index == index);
            let len: usize = reads.map(|read| read.len).sum();
            len > 0 && len == port.bytes.len()
        };
        let used = Instant::from_nanos(taken.now) - self.from;
        if ports.iter().enumerate().any(is_empty) {
            self.ahead = (2 * self.ahead).min(AHEAD[1]);
        } else if used < self.ahead / 4 {
            self.ahead = (self.ahead / 2).max(AHEAD[0]);
        }
    }
}

impl Supervisor {
    fn clocks_of(&self, tid: i32) -> Option<ClockPage> {
        let process = self.threads.get(&tid)?.process;
        self.processes.get(&process)?.clocks
    }

    /// Lends time before the thread continues: up to the next event, it counts its clocks itself.
    pub(super) fn lend_time(&mut self, tid: i32) {
        if self.computing.is_some() {
            // Computing time is charged before calls, so each look at a clock must be a call.
            return self.keep_time(tid);
        }
        self.lease.ports.clear();
        self.lease.is_lent = false;
        let Some(clocks) = self.clocks_of(tid) else {
            return;
        };
        let slice = self.threads.get(&tid).map_or(0, |thread| thread.slice);
        let nanos = |at: Instant| at.as_nanos();
        let now = self.stage.now();
        let looks = TURN.saturating_sub(slice.into());
        let known = if looks > 0 {
            self.lend_ports(tid)
        } else {
            None
        };
        let limit = match known {
            Some(_) => nanos(self.lease.limit),
            None => self
                .stage
                .quiet_until()
                .map_or(i64::MAX.unsigned_abs(), |at| nanos(at).saturating_sub(1)),
        };
        (self.lease.from, self.lease.calls) = (now, looks);
        let cost = self.settings.supervision.call_cost.as_nanos();
        let loan = Loan {
            now: nanos(now),
            limit,
            cost: u64::try_from(cost).unwrap_or(0),
            looks,
            turn: TURN,
            known: known.unwrap_or(0),
            // The supervisor handles a wait that has already begun.
            counts: self.threads.get(&tid).is_some_and(|it| it.idle.is_none()),
        };
        // Without ports, only looks take time.
        let by_looks = loan.now.saturating_add(loan.cost.saturating_mul(looks));
        let is_bare = self.lease.ports.is_empty();
        self.lease.limit = Instant::from_nanos(if is_bare { limit.min(by_looks) } else { limit });
        self.lease.is_lent = clocks
            .lend(Pid::from_raw(tid), loan, &self.lease.ports)
            .is_ok();
        if !self.lease.is_lent {
            self.lease.ports.clear();
        }
    }

    /// Lends the bytes of its ports to the thread, if no other thread uses these ports. Returns the
    /// files whose readiness is known, as bits.
    fn lend_ports(&mut self, tid: i32) -> Option<u64> {
        let thread = self.threads.get(&tid)?;
        let process = self.processes.get(&thread.process)?;
        let has_detour = process.detours.values().any(|&is_made| is_made);
        let is_asked = !has_detour
            || self.debugging.is_some()
            || self.schedule.is_some()
            || self.hears_by_signal
            || self.is_signalled
            || self.calls.is_written()
            || !self.queue.is_empty();
        let is_of_use =
            self.lease.unused < UNUSED_MAX || self.calls.count.is_multiple_of(RETRY_EVERY);
        if is_asked || !is_of_use || self.threads.values().any(|it| meddles(it, tid)) {
            return None;
        }
        let files = process.files.iter();
        let files = files.filter(|(fd, file)| {
            (0..BITS).contains(*fd) && matches!(file.kind, Kind::Port(_)) && file.is_readable()
        });
        let files: Vec<i32> = files.map(|(&fd, _)| fd).collect();
        let mut ports: Vec<(usize, i32, bool)> = Vec::new();
        for fd in files {
            let file = self.file(tid, fd)?;
            let Kind::Port(port) = file.kind else {
                continue;
            };
            if ports.iter().any(|&(other, ..)| other == port) {
                continue;
            }
            let settings = *self.stage.terminal(port)?.settings();
            let waits = settings.code(Code::Least) > 0 && !file.never_waits();
            ports.push((port, fd, waits));
        }
        if ports.is_empty() || ports.len() > PORTS_MAX {
            return None;
        }
        let mut until = self.stage.now() + self.lease.ahead;
        if let Some(deadline) = self.next_deadline() {
            until = until.min(deadline);
        }
        let ahead = self.stage.look_ahead(&ports, until)?;
        let bits = ports.iter().map(|&(_, fd, _)| 1_u64 << fd);
        let known = bits.fold(self.quiet_files(tid), |all, bit| all | bit);
        (self.lease.limit, self.lease.ports) = (ahead.limit, ahead.ports);
        Some(known)
    }

    /// The empty pipes and counters of the thread's last selects, as bits.
    fn quiet_files(&mut self, tid: i32) -> u64 {
        let quiet = self.threads.get(&tid).map(|thread| thread.quiet.clone());
        let quiet = quiet.unwrap_or_default();
        let quiet = quiet.into_iter().filter(|fd| (0..BITS).contains(fd));
        let files: Vec<(i32, Arc<File>)> = quiet
            .filter_map(|fd| Some((fd, self.file(tid, fd)?)))
            .filter(|(_, file)| file.is_inner())
            .collect();
        let mut polled: Vec<PollFd<'_>> = files
            .iter()
            .map(|(_, file)| PollFd::new(&file.fd, PollFlags::IN))
            .collect();
        // The closing of a file with a high number causes no stop, but the closing by the last
        // writer is an event.
        let has_high = |pid| numbers(pid).any(|fd| fd >= KEPT_BELOW.cast_signed());
        let process = self.threads.get(&tid).map(|thread| thread.process);
        if polled.is_empty()
            || process.is_none_or(has_high)
            || poll(&mut polled, Some(&Timespec::default())).is_err()
        {
            return 0;
        }
        let quiet = files.iter().zip(&polled);
        let quiet = quiet.filter(|(_, polled)| polled.revents().is_empty());
        quiet.fold(0, |bits, ((fd, _), _)| bits | 1 << fd)
    }

    /// Makes the program ask its page before the current call of the thread, if the call is about a
    /// port.
    pub(super) fn make_detour(&mut self, tid: i32) {
        let Some(thread) = self.threads.get(&tid).filter(|thread| thread.asks_port) else {
            return;
        };
        let Some(call) = thread.call.filter(|call| detour::is_served(call.number)) else {
            return;
        };
        let is_free =
            self.debugging.is_none() && self.schedule.is_none() && self.computing.is_none();
        if self.shares_memory(thread.process) {
            return;
        }
        let Some(process) = self.processes.get_mut(&thread.process) else {
            return;
        };
        let place = call.instruction();
        if !is_free || self.calls.is_written() || process.detours.contains_key(&place) {
            return;
        }
        let Some(page) = &mut process.clocks else {
            return;
        };
        let is_made = detour::make(Pid::from_raw(tid), page, call.number, place);
        process.detours.insert(place, is_made);
    }

    /// Whether another process runs in the memory of this one. Each counts its own detours, so one
    /// would write over those of the other.
    fn shares_memory(&self, process: i32) -> bool {
        let of = |tid: i32| self.threads.get(&tid).map(|thread| thread.process);
        let is_borrowed = |thread: &Thread| {
            let parent = thread.vfork_parent;
            parent.is_some_and(|it| thread.process == process || of(it) == Some(process))
        };
        let mut processes = self.processes.get(&process).into_iter();
        processes.any(|it| it.shares_memory) || self.threads.values().any(is_borrowed)
    }

    /// Whether the fault of `tid` occurred while its page answered a call: then the program makes
    /// the call.
    pub(super) fn gives_up(&self, tid: i32) -> bool {
        let pid = Pid::from_raw(tid);
        let Some(clocks) = self.clocks_of(tid) else {
            return false;
        };
        let Ok(mut registers) = ptrace::getregs(pid) else {
            return false;
        };
        if clocks.gives_up(pid, &mut registers).is_none() {
            return false;
        }
        ptrace::setregs(pid, registers).is_ok()
    }

    /// Whether a thread has stopped in the middle of a look at its clocks, with incomplete counts.
    pub(super) fn stands_in_clocks(&self, tid: i32, status: i32) -> bool {
        let signal = status >> 8;
        let is_trap = signal == libc::SIGTRAP;
        let is_kick = signal == libc::SIGSTOP;
        let is_stepped = self.debugging.is_some() || self.schedule.is_some();
        if !(is_trap && is_stepped || is_kick) {
            return false;
        }
        let registers = ptrace::getregs(Pid::from_raw(tid));
        let clocks = self.clocks_of(tid);
        clocks.is_some_and(|it| registers.is_ok_and(|at| it.has_code_at(at.rip)))
    }

    /// Lends nothing, because the thread continues where virtual time does not count: each look is
    /// a call.
    pub(super) fn keep_time(&mut self, tid: i32) {
        self.lease.ports.clear();
        self.lease.is_lent = false;
        if let Some(clocks) = self.clocks_of(tid) {
            let nothing = Loan {
                now: 0,
                limit: 0,
                cost: 1,
                looks: 0,
                turn: 0,
                known: 0,
                counts: false,
            };
            // If the program has made its page read-only, its own next look fails.
            let _ = clocks.lend(Pid::from_raw(tid), nothing, &[]);
        }
    }

    /// Takes the loan back from a stopped thread: its counted time passes, and its read bytes are
    /// removed.
    pub(super) fn take_time(&mut self, tid: i32) {
        self.lease.has_waited = false;
        let Some(clocks) = self.clocks_of(tid) else {
            return;
        };
        let ports = core::mem::take(&mut self.lease.ports);
        if !self.lease.is_lent {
            return;
        }
        let Some(mut taken) = clocks.take(Pid::from_raw(tid), !ports.is_empty()) else {
            return;
        };
        let times = [self.lease.from, self.lease.limit];
        if !taken.is_nothing() && !taken.bound(times, self.lease.calls.max(TURN), &ports) {
            self.trouble = Some(GuestError::Overwritten);
            return;
        }
        if !ports.is_empty() {
            self.lease.learn(&ports, &taken);
        }
        let fruitful = taken.reads.len() as u64 + taken.selects;
        let served = fruitful + taken.counts;
        let count = taken.looks + served;
        if count == 0 {
            return;
        }
        let Some(thread) = self.threads.get_mut(&tid) else {
            return;
        };
        self.lease.has_waited = self.lease.calls.saturating_sub(count) != taken.left;
        thread.slice = u32::try_from(TURN.saturating_sub(taken.left)).unwrap_or(SLICE);
        thread.computed = Duration::ZERO;
        if fruitful > 0 {
            thread.idle = None;
        }
        let index = thread.index;
        self.calls.count += count;
        self.looks += taken.looks;
        self.served += served;
        if ports.is_empty() {
            self.stage.has_counted(Instant::from_nanos(taken.now));
        } else {
            self.follow(&ports, &taken);
        }
        for count in &taken.last_counts {
            if let Some(lent) = ports.get(count.index) {
                self.note_count(tid, lent.fd, count);
            }
        }
        let passed = [
            (libc::SYS_clock_gettime, taken.looks),
            (libc::SYS_read, served),
        ];
        for (number, count) in passed.into_iter().filter(|(_, count)| *count > 0) {
            self.calls.add(Record {
                at: self.stage.now(),
                thread: index,
                number,
                looks: u32::try_from(count).unwrap_or(u32::MAX),
                result: Some(0),
            });
        }
    }

    /// Lets the rig and the ports follow the use of a loan. VTIME counts from the times of the last
    /// arrivals.
    fn follow(&mut self, ports: &[LentPort], taken: &Taken) {
        let now = Instant::from_nanos(taken.now);
        let mut arrivals = self.stage.last_arrivals(now);
        if let Some(last) = arrivals.last_mut() {
            *last = seen_at(*last, now, self.settings.supervision.call_cost);
        }
        let mut arrivals = arrivals.into_iter().peekable();
        for read in &taken.reads {
            while let Some(at) = arrivals.next_if(|at| *at < read.at) {
                self.follow_to(at);
            }
            self.follow_to(read.at);
            let Some(lent) = ports.get(read.index) else {
                continue;
            };
            if !self.stage.has_read(lent.port, read.len) {
                let path = self.stage.path_of(lent.port).unwrap_or_default();
                self.trouble = Some(GuestError::Unsent(path, read.at - Instant::ZERO));
            }
        }
        for at in arrivals.filter(|at| *at < now).chain([now]) {
            self.follow_to(at);
        }
        if self.lease.has_waited {
            self.stage.end_fruitless();
        }
    }

    fn follow_to(&mut self, at: Instant) {
        if let Err(error) = self.stage.follow(at) {
            self.trouble = Some(error.into());
        }
    }
}

/// The time at which a program saw the last event, which came at `at`. The program has reached
/// `now` by looks and calls of this cost. It saw the event with the first look or call after it, or
/// while it waited.
fn seen_at(at: Instant, now: Instant, cost: Duration) -> Instant {
    let cost = u64::try_from(cost.as_nanos()).unwrap_or(u64::MAX);
    let since = now.as_nanos().saturating_sub(at.as_nanos());
    let calls = since.checked_div(cost).unwrap_or(0);
    match cost {
        0 => at,
        _ => Instant::from_nanos(now.as_nanos() - calls * cost),
    }
}

/// Whether another thread than `tid` may run or read before the next stop.
fn meddles(thread: &Thread, tid: i32) -> bool {
    if thread.tid.as_raw() == tid {
        return false;
    }
    let State::Blocked(wait) = thread.state else {
        return true;
    };
    let waits_elsewhere = matches!(wait.on, On::Futex(..) | On::Child | On::Others | On::Queue);
    !waits_elsewhere || thread.lines_before.is_some()
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsRawFd as _;

    use super::*;
    use crate::guest::lent::LentRead;
    use crate::guest::supervisor::tests::{Bench, MS};
    use crate::guest::tests::Room;

    /// By hand: looks at 10.0, 10.3, .. 11.2 us see a byte of 10.5 us at 10.6 us.
    #[test]
    fn a_byte_is_seen_by_the_next_look() {
        let at = Instant::from_nanos;
        let cost = Duration::from_nanos(300);
        assert_eq!(seen_at(at(10_500), at(11_200), cost), at(10_600));
        assert_eq!(seen_at(at(10_600), at(11_200), cost), at(10_600));
        assert_eq!(seen_at(at(11_200), at(11_200), cost), at(11_200));
        assert_eq!(seen_at(at(10_500), at(11_200), Duration::ZERO), at(10_500));
    }

    fn port(len: usize) -> LentPort {
        LentPort {
            port: 0,
            fd: 3,
            waits: true,
            takes: true,
            known_until: Instant::ZERO,
            bytes: vec![(Instant::ZERO, 7); len],
        }
    }

    /// By hand: time ahead begins with 2 ms, doubles when all bytes of a port were read, up to
    /// 10 ms, and is halved when less than a quarter of it was used, down to 2 ms.
    #[test]
    fn a_lease_is_as_long_as_it_was_of_use() {
        let ms = Duration::from_millis;
        let mut lease = Lease::default();
        assert_eq!((lease.ahead, lease.unused), (ms(2), 0));
        let taken = |now_us: u64, reads: &[(usize, usize)]| Taken {
            now: now_us * 1_000,
            reads: reads
                .iter()
                .map(|&(index, len)| LentRead {
                    at: Instant::ZERO,
                    index,
                    len,
                })
                .collect(),
            ..Taken::default()
        };
        let ports = [port(3), port(2)];
        let mut learn = |taken: &Taken| {
            lease.learn(&ports, taken);
            (lease.ahead, lease.unused)
        };
        assert_eq!(
            learn(&taken(2_000, &[(0, 1), (0, 1)])),
            (ms(2), 0),
            "one is left"
        );
        assert_eq!(learn(&taken(2_000, &[(0, 1), (0, 2)])), (ms(4), 0));
        assert_eq!(learn(&taken(0, &[(1, 2)])), (ms(8), 0));
        assert_eq!(learn(&taken(0, &[(1, 2)])), (ms(10), 0));
        assert_eq!(learn(&taken(2_500, &[])), (ms(10), 1), "a quarter was used");
        assert_eq!(learn(&taken(2_499, &[])), (ms(5), 2));
        assert_eq!(learn(&taken(1_249, &[])), (Duration::from_micros(2_500), 3));
        assert_eq!(learn(&taken(0, &[])), (ms(2), 4));
        assert_eq!(learn(&taken(0, &[])), (ms(2), 5));
        let counts = Taken {
            counts: 1,
            ..taken(0, &[])
        };
        assert_eq!(learn(&counts).1, 0);
        assert_eq!(learn(&taken(0, &[])).1, 1);
        let selects = Taken {
            selects: 1,
            ..taken(0, &[])
        };
        assert_eq!(learn(&selects).1, 0);
        // A port without bytes is not emptied.
        let mut lease = Lease::default();
        lease.learn(&[port(0)], &taken(0, &[(0, 0)]));
        assert_eq!(lease.ahead, ms(2));
        // It counts from where it began.
        lease.ahead = ms(8);
        lease.from = Instant::from_millis(100);
        lease.learn(&[port(1)], &taken(102_000, &[]));
        assert_eq!(lease.ahead, ms(8));
        lease.learn(&[port(1)], &taken(101_999, &[]));
        assert_eq!(lease.ahead, ms(4));
    }

    #[test]
    fn threads_that_may_run_or_read_meddle() {
        let mut bench = Bench::new();
        let own = bench.tid;
        let wait = |on| State::Blocked(super::super::Wait { on, deadline: None });
        let key = crate::guest::task::FutexKey::Own(own, 8);
        for (state, expected) in [
            (State::Running, true),
            (State::Outside, true),
            (State::Halted, true),
            (wait(On::Files), true),
            (wait(On::Line), true),
            (wait(On::Futex(key, 1)), false),
            (wait(On::Child), false),
            (wait(On::Others), false),
            (wait(On::Queue), false),
        ] {
            let thread = bench.add(1_000_001, own, state).clone();
            assert_eq!(meddles(&thread, own), expected, "{state:?}");
            assert!(!meddles(&thread, 1_000_001), "itself");
            let waits_for_lines = Thread {
                lines_before: Some([0; 4]),
                ..thread
            };
            assert!(meddles(&waits_for_lines, own));
        }
    }

    /// A thread with a detour and a port that has read whole bytes: all that else would be in the
    /// way of lending is one thing after the other.
    #[test]
    fn bytes_are_lent_to_the_only_thread_that_may_read_them() {
        let lends = |change: &dyn Fn(&mut Bench)| {
            let mut bench = Bench::new();
            let port = bench.opens("sonar");
            let (tid, fd) = (bench.tid, port.as_raw_fd());
            bench.supervisor.stage.begin();
            bench.raw();
            bench
                .supervisor
                .stage
                .leap(None, false)
                .expect("the port stays");
            bench
                .supervisor
                .stage
                .leap(None, false)
                .expect("the port stays");
            bench.process().detours.insert(8, true);
            bench.supervisor.file(tid, fd).expect("open");
            change(&mut bench);
            bench.supervisor.stage.carry().expect("the port stays");
            let known = bench.supervisor.lend_ports(tid);
            let expected = known.map(|_| 1_u64 << fd);
            assert_eq!(known, expected);
            let lent: Vec<(usize, i32, bool)> = bench
                .supervisor
                .lease
                .ports
                .iter()
                .map(|it| (it.port, it.fd, it.waits))
                .collect();
            assert_eq!(
                lent,
                known.map(|_| (0, fd, true)).into_iter().collect::<Vec<_>>()
            );
            known.is_some()
        };
        assert!(lends(&|_| {}));
        assert!(!lends(&|it| it.process().detours.clear()));
        assert!(!lends(&|it| {
            it.process().detours.insert(8, false);
        }));
        assert!(!lends(&|it| it.supervisor.hears_by_signal = true));
        assert!(!lends(&|it| it.supervisor.is_signalled = true));
        assert!(!lends(&|it| it.supervisor.queue.push_back(1)));
        assert!(!lends(
            &|it| it.supervisor.schedule = Some(super::super::Schedule::new(1))
        ));
        assert!(!lends(&|it| it
            .supervisor
            .begin_debugging(super::super::Wanted::Nothing)));
        assert!(!lends(&|it| {
            let own = it.tid;
            it.add(1_000_001, own, State::Running);
        }));
        assert!(!lends(&|it| it.process().files.clear()));
        assert!(lends(&|it| it.supervisor.lease.unused = 7));
        assert!(!lends(&|it| {
            it.supervisor.lease.unused = 8;
            it.supervisor.calls.count = 63;
        }));
        assert!(lends(&|it| {
            it.supervisor.lease.unused = 8;
            it.supervisor.calls.count = 64;
        }));
    }

    /// Pipes of the last calls in which nothing is; the close of a file from 256 on is no stop.
    #[test]
    fn quiet_pipes_are_known() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let (ears, mut mouth) = std::io::pipe().expect("pipes");
        let null = std::fs::File::open("/dev/null").expect("it is there");
        let fd = ears.as_raw_fd();
        assert_eq!(bench.supervisor.quiet_files(tid), 0);
        bench.thread().quiet = vec![fd, null.as_raw_fd(), 9_999, -1];
        let expected = if (0..63).contains(&fd) { 1 << fd } else { 0 };
        assert_eq!(bench.supervisor.quiet_files(tid), expected);
        std::io::Write::write_all(&mut mouth, b"x").expect("room");
        assert_eq!(bench.supervisor.quiet_files(tid), 0);
        assert_eq!(bench.supervisor.quiet_files(-7), 0);
    }

    #[test]
    fn processes_in_one_memory_share_it() {
        let mut bench = Bench::new();
        let own = bench.tid;
        assert!(!bench.supervisor.shares_memory(own) && !bench.supervisor.shares_memory(-7));
        bench.process().shares_memory = true;
        assert!(bench.supervisor.shares_memory(own));
        bench.process().shares_memory = false;
        bench.add(1_000_001, 1_000_001, State::Running);
        assert!(!bench.supervisor.shares_memory(1_000_001));
        let child = bench.supervisor.threads.get_mut(&1_000_001).expect("added");
        child.vfork_parent = Some(own);
        assert!(bench.supervisor.shares_memory(own));
        assert!(bench.supervisor.shares_memory(1_000_001));
        bench.add(1_000_002, 1_000_002, State::Running);
        assert!(!bench.supervisor.shares_memory(1_000_002));
    }

    /// A page in memory of this process: what is lent is there, what it counts is taken.
    #[test]
    fn time_is_lent_and_taken() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let room = Room::new(4_096);
        bench.process().clocks = Some(ClockPage::at(room.at(0)));
        bench.passes(10);
        bench.thread().slice = 9;
        bench.supervisor.lend_time(tid);
        // Now, limit, cost, looks, left, turn, known files, ports; no events before the rig begins.
        let most = i64::MAX.unsigned_abs();
        let words = &room.words()[..11];
        assert_eq!(words, [10 * MS, most, 1_000, 0, 990, 999, 0, 0, 0, 0, 0]);
        // Three looks at 1 us each.
        room.put(0, &(10 * MS + 3_000).to_ne_bytes());
        room.put(24, &[3_u64, 987].map(u64::to_ne_bytes).concat());
        bench.thread().computed = Duration::from_secs(1);
        bench.supervisor.take_time(tid);
        assert_eq!(bench.now(), 10 * MS + 3_000);
        assert_eq!((bench.supervisor.looks, bench.supervisor.served), (3, 0));
        assert_eq!(bench.supervisor.calls.count(), 3);
        assert_eq!(
            (bench.thread().slice, bench.thread().computed),
            (12, Duration::ZERO)
        );
        assert!(!bench.supervisor.lease.take_has_waited() && bench.supervisor.trouble.is_none());
        // A wait has begun a turn.
        bench.supervisor.lend_time(tid);
        room.put(0, &(10 * MS + 4_000).to_ne_bytes());
        room.put(24, &[1_u64, 998].map(u64::to_ne_bytes).concat());
        bench.supervisor.take_time(tid);
        assert!(bench.supervisor.lease.take_has_waited());
        assert!(!bench.supervisor.lease.take_has_waited());
        // Nothing was counted, so nothing passes.
        bench.supervisor.lend_time(tid);
        bench.supervisor.take_time(tid);
        assert_eq!(bench.supervisor.calls.count(), 4);
        // A program that has written to its page is told so.
        bench.supervisor.lend_time(tid);
        room.put(24, &[1_000_000_u64, 998].map(u64::to_ne_bytes).concat());
        bench.supervisor.take_time(tid);
        assert!(matches!(
            bench.supervisor.trouble,
            Some(GuestError::Overwritten)
        ));
        // Where virtual time does not count nothing is lent: each look is a call.
        bench.supervisor.keep_time(tid);
        assert_eq!(room.words()[..11], [0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 7]);
        // A thread with a full turn has no looks left.
        bench.thread().slice = 1_000;
        bench.supervisor.lend_time(tid);
        assert_eq!(room.words()[4], 0);
    }
}
