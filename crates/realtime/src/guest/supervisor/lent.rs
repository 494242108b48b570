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
    use super::*;

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
}
