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

#[cfg(test)]
mod tests {
    use super::super::{On, State, Wait};
    use super::*;
    use crate::guest::supervisor::tests::Bench;
    use crate::guest::tests::Room;

    fn note(bench: &mut Bench, number: i64, args: &[u64], outcome: Outcome) {
        let call = Call::made(number, args);
        let tid = bench.tid;
        bench.supervisor.note_idle(tid, &call, &outcome);
    }

    /// How many fruitless calls in a row there were.
    fn count(bench: &mut Bench) -> Option<u32> {
        bench.thread().idle.as_ref().map(|idle| idle.count)
    }

    /// After a call of no use: whether this one counts as one more, as none, or ends the wait.
    fn sign(number: i64, args: &[u64], outcome: Outcome) -> Option<u32> {
        let mut bench = Bench::new();
        note(&mut bench, libc::SYS_sched_yield, &[], Outcome::Yield(0));
        note(&mut bench, number, args, outcome);
        count(&mut bench)
    }

    #[test]
    fn calls_of_no_use_are_told_from_others() {
        const FRUITLESS: Option<u32> = Some(2);
        const NEUTRAL: Option<u32> = Some(1);
        for number in [
            libc::SYS_clock_gettime,
            libc::SYS_gettimeofday,
            libc::SYS_time,
            libc::SYS_times,
            libc::SYS_clock_getres,
        ] {
            assert_eq!(sign(number, &[], Outcome::Answer(0)), NEUTRAL, "{number}");
        }
        for number in [
            libc::SYS_poll,
            libc::SYS_ppoll,
            libc::SYS_select,
            libc::SYS_pselect6,
            libc::SYS_epoll_wait,
            libc::SYS_epoll_pwait,
            libc::SYS_epoll_pwait2,
            libc::SYS_nanosleep,
            libc::SYS_clock_nanosleep,
        ] {
            assert_eq!(sign(number, &[], Outcome::Answer(0)), FRUITLESS, "{number}");
            if ![libc::SYS_poll, libc::SYS_ppoll].contains(&number) {
                assert_eq!(sign(number, &[], Outcome::Answer(1)), None, "{number}");
            }
            assert_eq!(sign(number, &[], Outcome::Kernel), None, "{number}");
        }
        for number in [
            libc::SYS_read,
            libc::SYS_readv,
            libc::SYS_recvfrom,
            libc::SYS_recvmsg,
            libc::SYS_accept,
            libc::SYS_accept4,
        ] {
            assert_eq!(sign(number, &[], Outcome::Answer(0)), FRUITLESS, "{number}");
            assert_eq!(
                sign(number, &[], Outcome::Answer(-11)),
                FRUITLESS,
                "{number}"
            );
            assert_eq!(sign(number, &[], Outcome::Answer(1)), None, "{number}");
        }
        for number in [
            libc::SYS_write,
            libc::SYS_writev,
            libc::SYS_sendto,
            libc::SYS_sendmsg,
        ] {
            assert_eq!(
                sign(number, &[], Outcome::Answer(-11)),
                FRUITLESS,
                "{number}"
            );
            assert_eq!(sign(number, &[], Outcome::Answer(0)), None, "{number}");
            assert!(is_write(number));
        }
        assert_eq!(
            sign(libc::SYS_sched_yield, &[1], Outcome::Yield(0)),
            FRUITLESS
        );
        assert_eq!(sign(libc::SYS_getpid, &[], Outcome::Answer(-1)), None);
        let room = Room::new(8);
        for request in [libc::FIONREAD, libc::TIOCOUTQ, libc::TIOCMGET] {
            let args = [3, request, room.at(0)];
            assert_eq!(sign(libc::SYS_ioctl, &args, Outcome::Answer(0)), FRUITLESS);
            assert_eq!(
                sign(libc::SYS_ioctl, &[3, request, 8], Outcome::Answer(0)),
                None
            );
            assert_eq!(sign(libc::SYS_ioctl, &args, Outcome::Answer(-5)), None);
        }
        let args = [3, libc::TIOCMSET, room.at(0)];
        assert_eq!(sign(libc::SYS_ioctl, &args, Outcome::Answer(0)), None);
    }

    /// poll(2): POLLNVAL, 0x20, is a file that is not open. A program that polls such a one only
    /// waits as well.
    #[test]
    fn a_poll_of_closed_files_is_of_no_use() {
        let poll = |found: &[u16]| {
            let entries: Vec<[u8; 8]> = found
                .iter()
                .map(|found| {
                    let mut entry = [0xFF; 8];
                    entry[6..].copy_from_slice(&found.to_ne_bytes());
                    entry
                })
                .collect();
            let room = Room::of(entries.as_flattened());
            let ready = i64::try_from(found.iter().filter(|&&it| it != 0).count()).expect("few");
            let args = [room.at(0), found.len() as u64, 0];
            sign(libc::SYS_poll, &args, Outcome::Answer(ready))
        };
        assert_eq!(poll(&[0x20]), Some(2));
        assert_eq!(poll(&[0x20, 0]), Some(2));
        assert_eq!(poll(&[0x20, 1]), None);
        assert_eq!(poll(&[1]), None);
        assert_eq!(sign(libc::SYS_ppoll, &[8, 1], Outcome::Answer(1)), None);
        // A program that does not wait yet has found something.
        let mut bench = Bench::new();
        let entry = Room::of(&[0, 0, 0, 0, 0, 0, 0x20, 0]);
        note(
            &mut bench,
            libc::SYS_poll,
            &[entry.at(0), 1],
            Outcome::Answer(1),
        );
        assert_eq!(count(&mut bench), None);
    }

    #[test]
    fn a_wait_is_made_up_of_the_same_calls_and_answers() {
        let mut bench = Bench::new();
        let read = |bench: &mut Bench, file: u64, answer: i64| {
            note(
                bench,
                libc::SYS_read,
                &[file, 8, 1],
                Outcome::Answer(answer),
            );
            count(bench)
        };
        assert_eq!(read(&mut bench, 3, -11), Some(1));
        bench.passes(5);
        assert_eq!(read(&mut bench, 3, -11), Some(2));
        assert_eq!(read(&mut bench, 4, -11), Some(3));
        let since = |bench: &mut Bench| bench.thread().idle.as_ref().map(|it| it.since.as_nanos());
        assert_eq!(since(&mut bench), Some(0));
        assert_eq!(read(&mut bench, 3, 0), Some(1), "another answer is news");
        assert_eq!(since(&mut bench), Some(5_000_000));
        for file in 4..11 {
            read(&mut bench, file, 0);
        }
        assert_eq!(count(&mut bench), Some(8));
        assert_eq!(read(&mut bench, 11, 0), Some(1), "more than eight kinds");
        bench.thread().watched = vec![1];
        assert_eq!(read(&mut bench, 11, 0), Some(2), "of other files");
        assert_eq!(
            bench.thread().idle.as_ref().map(|it| it.seen.len()),
            Some(2)
        );
        let count_of = LentCount {
            at: Instant::from_millis(9),
            index: 0,
            len: 5,
            address: 8,
        };
        let tid = bench.tid;
        bench.supervisor.note_count(tid, 3, &count_of);
        assert_eq!(count(&mut bench), Some(3));
        let last = bench
            .thread()
            .idle
            .as_ref()
            .and_then(|it| it.seen.last().cloned());
        let last = last.expect("noted");
        assert_eq!(
            (last.call, last.answer),
            ((libc::SYS_ioctl, [3, libc::FIONREAD, 8]), 5)
        );
    }

    /// By hand: from the ninth call on, a read waits for a quarter of the time since the first one,
    /// 1 ms at most; a yield 20 us at most; from the third on, a write 1 ms at once.
    #[test]
    fn a_thread_that_asks_over_and_over_waits() {
        let waits = |number: i64, calls: u32, since_us: u64| {
            let mut bench = Bench::new();
            let call = bench.begins(number, &[3, 8, 1]);
            for _ in 0..calls {
                note(&mut bench, number, &[3, 8, 1], Outcome::Answer(-11));
            }
            let pass = Duration::from_micros(since_us);
            bench.supervisor.stage.pass(pass).expect("the port stays");
            let (before, tid) = (bench.now(), bench.tid);
            let flow = bench.supervisor.idle_away(tid, &call);
            assert_eq!(
                bench.supervisor.idled.as_nanos(),
                u128::from(bench.now() - before)
            );
            let held =
                matches!(bench.supervisor.held_over, Some((held, Next::Attempt)) if held == tid);
            assert_eq!(held, matches!(flow, Some(Flow::Stays)));
            (held, (bench.now() - before) / 1_000)
        };
        assert_eq!(waits(libc::SYS_read, 7, 100), (false, 0));
        assert_eq!(waits(libc::SYS_read, 8, 100), (true, 25));
        assert_eq!(waits(libc::SYS_read, 8, 40_000), (true, 1_000));
        assert_eq!(waits(libc::SYS_write, 1, 100), (false, 0));
        assert_eq!(waits(libc::SYS_write, 2, 100), (true, 1_000));
        let mut bench = Bench::new();
        let call = bench.begins(libc::SYS_sched_yield, &[]);
        for _ in 0..8 {
            note(&mut bench, libc::SYS_sched_yield, &[], Outcome::Yield(0));
        }
        bench.passes(40);
        let tid = bench.tid;
        assert!(bench.supervisor.idle_away(tid, &call).is_some());
        assert_eq!(bench.now(), 40_020_000);
        // Another call is none of the wait.
        let other = Call::made(libc::SYS_sched_yield, &[7]);
        assert!(bench.supervisor.idle_away(tid, &other).is_none());
        // Others come first.
        bench.add(1_000_001, 1_000_001, State::Running);
        bench.supervisor.queue.push_back(1_000_001);
        assert!(matches!(
            bench.supervisor.idle_away(tid, &call),
            Some(Flow::Stays)
        ));
        assert_eq!(bench.supervisor.queue, [1_000_001, tid]);
        assert_eq!(bench.now(), 40_020_000);
        // The wait ends with the deadline of another thread.
        bench.supervisor.queue.clear();
        let at = Some(Instant::from_micros(40_025));
        let wait = Wait {
            on: On::Others,
            deadline: at,
        };
        bench.supervisor.set_state(1_000_001, State::Blocked(wait));
        assert!(bench.supervisor.idle_away(tid, &call).is_some());
        assert_eq!(
            (bench.now(), &bench.supervisor.queue[0]),
            (40_025_000, &1_000_001)
        );
        // A thread with a full turn makes its call at once, and others run next.
        bench.supervisor.queue.clear();
        bench.thread().slice = SLICE;
        assert!(bench.supervisor.idle_away(tid, &call).is_none());
    }

    #[test]
    fn a_poll_of_other_files_is_no_wait() {
        let mut bench = Bench::new();
        let entry = Room::of(&[3, 0, 0, 0, 1, 0, 0, 0]);
        let args = [entry.at(0), 1, 0];
        let call = bench.begins(libc::SYS_poll, &args);
        bench.thread().watched = watched(bench.tid, &call);
        for _ in 0..8 {
            note(&mut bench, libc::SYS_poll, &args, Outcome::Answer(0));
        }
        bench.passes(40);
        let tid = bench.tid;
        entry.put(0, &[4]);
        assert!(bench.supervisor.idle_away(tid, &call).is_none());
        entry.put(0, &[3]);
        assert!(bench.supervisor.idle_away(tid, &call).is_some());
    }
}
