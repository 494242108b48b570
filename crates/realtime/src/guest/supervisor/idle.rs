//! Detection of busy waiting: a thread waits if it repeats the same calls without success, with
//! only looks at clocks between them. Each further call takes longer, by a fraction of the wait so
//! far, but never longer than until the next event. So the wait ends at the same time, with
//! hundreds of stops instead of millions.
//!
//! The turn of the thread ends with each of these waits, like the turn of a thread that blocks:
//! the callers observe the ports between two turns, so one turn must not last for seconds.

use core::time::Duration;

use nix::libc;
use nix::unistd::Pid;
use protocols::Instant;

use super::polls::{POLLFD, entries, watched};
use super::{Flow, Memory, Next, Outcome, SLICE, Supervisor, Thread};
use crate::guest::call::Call;
use crate::guest::lent::LentCount;
use crate::guest::task::{Fruitless, Idle};

/// Number of consecutive calls without success that take the usual time.
const FREE: u32 = 8;
/// `FREE` for writes to a full buffer.
const FREE_FULL: u32 = 2;
/// Each further call takes this part of the time since the first call, at most `LONGEST`.
const PART: u32 = 4;
const LONGEST: Duration = Duration::from_millis(1);
/// The maximum for `sched_yield`: schedulers call it thousands of times before they wait.
const LONGEST_YIELD: Duration = Duration::from_micros(20);
/// Maximum number of different calls in one wait.
const KINDS_MAX: usize = 8;

/// Meaning of a call for the detection.
enum Sign {
    /// The call had no success; with its answer.
    Fruitless(i64),
    /// The call shows neither waiting nor progress.
    Neutral,
    /// The call shows progress.
    Fruitful,
}

const fn key(call: &Call) -> (i64, [u64; 3]) {
    let [first, second, third, ..] = call.args;
    (call.number, [first, second, third])
}

const fn is_write(number: i64) -> bool {
    matches!(
        number,
        libc::SYS_write | libc::SYS_writev | libc::SYS_sendto | libc::SYS_sendmsg
    )
}

/// Whether `poll` reports nothing but closed files.
fn finds_no_file(tid: i32, call: &Call) -> bool {
    let entries = entries(tid, call);
    let found = entries.as_deref().unwrap_or_default().chunks_exact(POLLFD);
    let found = found.map(|entry| i16::from_ne_bytes([entry[6], entry[7]]));
    let mut rest = found.map(|flags| flags & !libc::POLLNVAL);
    entries.is_ok() && rest.all(|rest| rest == 0)
}

impl Supervisor {
    /// Before a call of `tid` that waits in this way: lets other threads run first, or lets time
    /// pass. `None` if the thread can make its call now.
    pub(super) fn idle_away(&mut self, tid: i32, call: &Call) -> Option<Flow> {
        let idle = self.threads.get(&tid)?.idle.as_ref()?;
        // A full buffer has room only after the next byte has left.
        let is_full = is_write(call.number);
        let free = if is_full { FREE_FULL } else { FREE };
        if idle.count < free || idle.seen.iter().all(|seen| seen.call != key(call)) {
            return None;
        }
        let watched = watched(tid, call);
        let is_known = |seen: &Fruitless| seen.call == key(call) && seen.watched == watched;
        if !idle.seen.iter().any(is_known) {
            return None;
        }
        if !self.queue.is_empty() {
            self.ready(tid, Next::Attempt);
            return Some(Flow::Stays);
        }
        let now = self.stage.now();
        let longest = match call.number {
            libc::SYS_sched_yield => LONGEST_YIELD,
            _ => LONGEST,
        };
        let until = match is_full {
            true => now + longest,
            false => now + ((now - idle.since) / PART).min(longest),
        };
        let deadline = self.next_deadline().map_or(until, |at| at.min(until));
        if let Err(error) = self.stage.leap(Some(deadline), false) {
            self.trouble = Some(error.into());
        }
        self.idled += self.stage.now() - now;
        self.expire();
        if self.stage.take_delivered() {
            self.retry_files(None);
        }
        let slice = self.threads.get(&tid).map_or(0, |thread| thread.slice);
        // A debugger counts its own turns. A thread with a full turn lets others run next.
        if self.debugging.is_some() || slice >= SLICE {
            return None;
        }
        self.held_over = Some((tid, Next::Attempt));
        Some(Flow::Stays)
    }

    /// Updates the detection after a call of `tid`.
    pub(super) fn note_idle(&mut self, tid: i32, call: &Call, outcome: &Outcome) {
        let now = self.stage.now();
        let sign = self.sign_of(tid, call, outcome);
        let Some(thread) = self.threads.get_mut(&tid) else {
            return;
        };
        match sign {
            Sign::Neutral => {}
            Sign::Fruitful => thread.idle = None,
            Sign::Fruitless(answer) => {
                let fruitless = Fruitless {
                    call: key(call),
                    watched: thread.watched.clone(),
                    answer,
                };
                thread.note_fruitless(fruitless, now);
            }
        }
    }

    /// Updates the detection after the page has told the thread the number of available bytes, like
    /// a call.
    pub(super) fn note_count(&mut self, tid: i32, fd: i32, count: &LentCount) {
        let Some(thread) = self.threads.get_mut(&tid) else {
            return;
        };
        let file = u64::from(fd.cast_unsigned());
        let fruitless = Fruitless {
            call: (libc::SYS_ioctl, [file, libc::FIONREAD, count.address]),
            watched: Vec::new(),
            answer: i64::try_from(count.len).unwrap_or(0),
        };
        thread.note_fruitless(fruitless, count.at);
    }

    fn sign_of(&self, tid: i32, call: &Call, outcome: &Outcome) -> Sign {
        match (call.number, outcome) {
            (
                libc::SYS_clock_gettime
                | libc::SYS_gettimeofday
                | libc::SYS_time
                | libc::SYS_times
                | libc::SYS_clock_getres,
                _,
            ) => Sign::Neutral,
            (
                libc::SYS_poll
                | libc::SYS_ppoll
                | libc::SYS_select
                | libc::SYS_pselect6
                | libc::SYS_epoll_wait
                | libc::SYS_epoll_pwait
                | libc::SYS_epoll_pwait2
                | libc::SYS_nanosleep
                | libc::SYS_clock_nanosleep,
                Outcome::Answer(0),
            ) => Sign::Fruitless(0),
            (libc::SYS_sched_yield, _) => Sign::Fruitless(0),
            (
                libc::SYS_read
                | libc::SYS_readv
                | libc::SYS_recvfrom
                | libc::SYS_recvmsg
                | libc::SYS_accept
                | libc::SYS_accept4,
                &Outcome::Answer(answer),
            ) if answer <= 0 => Sign::Fruitless(answer),
            (number, &Outcome::Answer(answer)) if is_write(number) && answer < 0 => {
                Sign::Fruitless(answer)
            }
            // Check this only for a program that already waits: reading its memory costs time.
            (libc::SYS_poll | libc::SYS_ppoll, &Outcome::Answer(answer)) if answer > 0 => {
                let waits = self.threads.get(&tid).is_some_and(|it| it.idle.is_some());
                match waits && finds_no_file(tid, call) {
                    true => Sign::Fruitless(answer),
                    false => Sign::Fruitful,
                }
            }
            (libc::SYS_ioctl, Outcome::Answer(0)) => match call.args[1] {
                libc::FIONREAD | libc::TIOCOUTQ | libc::TIOCMGET => {
                    let answer = Memory(Pid::from_raw(tid)).u32(call.args[2]);
                    answer.map_or(Sign::Fruitful, |answer| Sign::Fruitless(answer.into()))
                }
                _ => Sign::Fruitful,
            },
            _ => Sign::Fruitful,
        }
    }
}

impl Thread {
    fn note_fruitless(&mut self, fruitless: Fruitless, now: Instant) {
        let idle = self.idle.get_or_insert_with(|| Idle {
            seen: Vec::new(),
            count: 0,
            since: now,
        });
        let is_it =
            |seen: &&Fruitless| seen.call == fruitless.call && seen.watched == fruitless.watched;
        let known = idle.seen.iter().find(is_it);
        let is_same = known.map(|known| known.answer == fruitless.answer);
        if is_same != Some(true) {
            // A different answer is news, so the wait starts again.
            if is_same.is_some() || idle.seen.len() >= KINDS_MAX {
                idle.seen.clear();
                (idle.count, idle.since) = (0, now);
            }
            idle.seen.push(fruitless);
        }
        idle.count = idle.count.saturating_add(1);
    }
}
