//! Timers that send a signal or make a file readable when their virtual time has come.

use core::time::Duration;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use protocols::Instant;
use rustix::process::{Signal, kill_process};
use rustix::time::{Itimerspec, TimerfdTimerFlags, Timespec, timerfd_settime};

use super::clocks::{low_i32, nanos, timespec};
use super::files::File;
use super::streams::{buffers, scatter};
use super::{Memory, On, Outcome, PollFlags, Supervisor, Wait};
use crate::guest::call::Call;
use crate::guest::task::{Timer, TimerFile};

const SECOND_NS: u64 = 1_000_000_000;

impl Supervisor {
    /// alarm, setitimer, getitimer.
    pub(super) fn interval_timer(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let now = self.stage.now();
        let memory = Memory(Pid::from_raw(tid));
        let pid = self.threads.get(&tid).ok_or(Errno::ESRCH)?.process;
        let process = self.processes.get_mut(&pid).ok_or(Errno::ESRCH)?;
        let [first, second, third, ..] = call.args;
        let old = process.alarm;
        let left = old.at.map_or(Duration::ZERO, |at| at - now);
        if call.number == libc::SYS_alarm {
            let seconds = u64::from(low_i32(first).cast_unsigned());
            process.alarm = Timer {
                at: (seconds > 0).then(|| now + Duration::from_secs(seconds)),
                interval: 0,
            };
            let seconds = left.as_nanos().div_ceil(u128::from(SECOND_NS));
            return Ok(Outcome::Answer(i64::try_from(seconds).unwrap_or(0)));
        }
        if low_i32(first) != libc::ITIMER_REAL {
            self.note("a timer of processor time is real".to_owned());
            return Ok(Outcome::Kernel);
        }
        let is_set = call.number == libc::SYS_setitimer;
        let place = if is_set { third } else { second };
        if is_set && second != 0 {
            let micros =
                |[seconds, micros]: [i64; 2]| nanos([seconds, micros.saturating_mul(1_000)]);
            let interval = micros(memory.pair(second)?)?.cast_unsigned();
            let first = micros(memory.pair(second.wrapping_add(16))?)?.cast_unsigned();
            process.alarm = Timer {
                at: (first > 0).then(|| now + Duration::from_nanos(first)),
                interval,
            };
        }
        if place != 0 {
            let parts = |nanos: u64| {
                let [seconds, nanos] = timespec(nanos.cast_signed());
                [seconds, nanos / 1_000]
            };
            memory.write_pair(place, parts(old.interval))?;
            let left = u64::try_from(left.as_nanos()).unwrap_or(0);
            memory.write_pair(place.wrapping_add(16), parts(left))?;
        }
        Ok(Outcome::Answer(0))
    }

    /// timerfd_create, timerfd_settime, timerfd_gettime.
    pub(super) fn timer_file(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [fd, flags, new, old, ..] = call.args;
        let fd = low_i32(fd);
        let now = self.stage.now();
        let memory = Memory(Pid::from_raw(tid));
        let pid = self.threads.get(&tid).ok_or(Errno::ESRCH)?.process;
        if call.number == libc::SYS_timerfd_create {
            self.keep_open_timers(pid);
            return Ok(Outcome::Kernel);
        }
        self.know_timer(tid, pid, fd)?;
        let process = self.processes.get_mut(&pid).ok_or(Errno::ESRCH)?;
        let timer = process.timers.get_mut(&fd).ok_or(Errno::EBADF)?;
        let was = timer.timer;
        let place = match call.number {
            libc::SYS_timerfd_gettime => flags,
            _ => {
                let is_absolute = low_i32(flags) & 1 != 0;
                let clock = is_absolute.then_some(timer.clock);
                timer.timer = Timer::asked_for(memory, new, clock, now)?;
                timer.expired = 0;
                set_real(timer, 0);
                old
            }
        };
        if place != 0 {
            was.tell(memory, place, now)?;
        }
        Ok(Outcome::Answer(0))
    }

    /// Forgets timers whose files are closed. Not every closing is seen: an exec closes files, and
    /// files with large numbers are closed without a stop.
    pub(super) fn keep_open_timers(&mut self, pid: i32) {
        if let Some(process) = self.processes.get_mut(&pid) {
            process.timers.retain(|&fd, _| clock_of(pid, fd).is_some());
        }
    }

    /// The process of `tid` is about to close `fd`. A timer goes on at a copy of its file.
    pub(super) fn forget_timer(&mut self, tid: i32, fd: i32) {
        let Some(pid) = self.threads.get(&tid).map(|thread| thread.process) else {
            return;
        };
        let Some(process) = self.processes.get_mut(&pid) else {
            return;
        };
        let Some(timer) = process.timers.remove(&fd) else {
            return;
        };
        let files = std::fs::read_dir(format!("/proc/{pid}/fd"));
        let numbers = files.into_iter().flatten().flatten();
        let numbers = numbers.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        let copy = numbers
            .filter(|other| *other != fd && !process.timers.contains_key(other))
            .find(|&other| clock_of(pid, other) == Some(timer.clock));
        if let Some(copy) = copy {
            process.timers.insert(copy, timer);
        }
    }

    /// Begins to stand in for the kernel's timer behind `fd`.
    fn know_timer(&mut self, tid: i32, pid: i32, fd: i32) -> Result<(), Errno> {
        if !self
            .processes
            .get(&pid)
            .is_some_and(|it| it.timers.contains_key(&fd))
        {
            let file = self.file(tid, fd).ok_or(Errno::EBADF)?;
            let clock = clock_of(pid, fd).ok_or(Errno::EINVAL)?;
            let process = self.processes.get_mut(&pid).ok_or(Errno::ESRCH)?;
            let new = TimerFile {
                file: file.fd.try_clone().map_err(|_| Errno::EMFILE)?,
                clock,
                timer: Timer::default(),
                expired: 0,
            };
            process.timers.insert(fd, new);
        }
        Ok(())
    }

    /// A read of `file`, if it is a timer's.
    pub(super) fn read_timer(
        &mut self,
        tid: i32,
        call: &Call,
        file: &File,
    ) -> Option<Result<Outcome, Errno>> {
        let pid = self.threads.get(&tid)?.process;
        let fd = low_i32(call.args[0]);
        let timer = self.processes.get_mut(&pid)?.timers.get_mut(&fd)?;
        if timer.expired > 0 && file.readiness(PollFlags::IN).is_empty() {
            // A read at a copy of this file has taken them.
            timer.expired = 0;
        }
        if timer.expired == 0 {
            return Some(match file.never_waits() {
                true => Err(Errno::EAGAIN),
                false => Ok(Outcome::Block(Wait {
                    on: On::Files,
                    deadline: None,
                })),
            });
        }
        let count = core::mem::take(&mut timer.expired);
        set_real(timer, 0);
        let done = buffers(tid, call).and_then(|to| scatter(tid, &to, &count.to_ne_bytes()));
        Some(done.map(|()| Outcome::Answer(8)))
    }

    /// Lets the timers expire whose time has come by `now`.
    pub(super) fn fire_timers(&mut self, now: Instant) {
        for (&pid, process) in &mut self.processes {
            if expirations(&mut process.alarm, now) > 0
                && let Some(pid) = rustix::process::Pid::from_raw(pid)
            {
                let _ = kill_process(pid, Signal::ALARM);
                self.is_signalled = true;
            }
            for timer in process.timers.values_mut() {
                let count = expirations(&mut timer.timer, now);
                if count > 0 {
                    timer.expired += count;
                    set_real(timer, 1);
                    self.is_changed = true;
                }
            }
        }
        self.fire_posix_timers();
    }
}

impl Timer {
    /// What the program asks for by the two times at `place`; the first is one of `clock` if that
    /// is given, or else counts from `now`.
    pub(super) fn asked_for(
        memory: Memory,
        place: u64,
        clock: Option<i64>,
        now: Instant,
    ) -> Result<Self, Errno> {
        let interval = nanos(memory.pair(place)?)?.cast_unsigned();
        let first = nanos(memory.pair(place.wrapping_add(16))?)?;
        let at = match clock {
            Some(clock) => Supervisor::instant_of(clock, first),
            None => now + Duration::from_nanos(first.cast_unsigned()),
        };
        Ok(Self {
            at: (first != 0).then_some(at),
            interval,
        })
    }

    /// Writes interval and time left to `place`, as the program asks for them.
    pub(super) fn tell(self, memory: Memory, place: u64, now: Instant) -> Result<(), Errno> {
        let left = self.at.map_or(Duration::ZERO, |at| at - now);
        let left = i64::try_from(left.as_nanos()).unwrap_or(0);
        memory.write_pair(place, timespec(self.interval.cast_signed()))?;
        memory.write_pair(place.wrapping_add(16), timespec(left))
    }
}

/// How often a timer expires until `now`.
pub(super) fn expirations(timer: &mut Timer, now: Instant) -> u64 {
    let Some(at) = timer.at.filter(|&at| at <= now) else {
        return 0;
    };
    if timer.interval == 0 {
        timer.at = None;
        return 1;
    }
    let late = u64::try_from((now - at).as_nanos()).unwrap_or(0);
    let count = late / timer.interval + 1;
    timer.at = Some(at + Duration::from_nanos(timer.interval.saturating_mul(count)));
    count
}

/// Sets the kernel's timer to so many nanoseconds, 0: to nothing, and waits until it shows.
fn set_real(timer: &TimerFile, nanos: i64) {
    let zero = Timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    let new = Itimerspec {
        it_interval: zero,
        it_value: Timespec {
            tv_nsec: nanos,
            ..zero
        },
    };
    let _ = timerfd_settime(&timer.file, TimerfdTimerFlags::empty(), &new);
    if nanos > 0 {
        let mut fds = [rustix::event::PollFd::new(&timer.file, PollFlags::IN)];
        let most = Timespec {
            tv_sec: 1,
            tv_nsec: 0,
        };
        let _ = rustix::event::poll(&mut fds, Some(&most));
    }
}

/// The clock of a timer's file; `None` if it is none.
fn clock_of(pid: i32, fd: i32) -> Option<i64> {
    let info = std::fs::read_to_string(format!("/proc/{pid}/fdinfo/{fd}")).ok()?;
    let line = info
        .lines()
        .find_map(|line| line.strip_prefix("clockid:"))?;
    line.trim().parse().ok()
}
