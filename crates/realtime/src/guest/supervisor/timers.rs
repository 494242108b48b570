//! Timers that send a signal or make a file readable when their virtual time has come.

use core::time::Duration;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use protocols::Instant;
use rustix::process::{Signal, kill_process};
use rustix::time::{Itimerspec, TimerfdTimerFlags, Timespec, timerfd_settime};

use super::clocks::{low_i32, nanos, timespec};
use super::files::{File, numbers, told_of};
use super::streams::{buffers, scatter};
use super::{Memory, On, Outcome, PollFlags, Supervisor, Wait};
use crate::guest::call::Call;
use crate::guest::task::{Timer, TimerFile};

const SECOND_NS: u64 = 1_000_000_000;
/// Time to which the kernel's timer is set while copies of its file are searched for: about a year.
const MARK_S: i64 = 30_000_000;

impl Supervisor {
    /// Handles alarm, setitimer and getitimer.
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

    /// Handles timerfd_create, timerfd_settime and timerfd_gettime.
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

    /// Drops timers whose files are closed. Not every closing causes a stop: an exec closes files,
    /// and files with high numbers are closed without a stop.
    pub(super) fn keep_open_timers(&mut self, pid: i32) {
        let Some(process) = self.processes.get_mut(&pid) else {
            return;
        };
        let closed = process
            .timers
            .extract_if(.., |&fd, _| clock_of(pid, fd).is_none());
        let closed: Vec<(i32, TimerFile)> = closed.collect();
        for (fd, timer) in closed {
            self.hand_on(timer, (pid, fd));
        }
    }

    /// Handles `fd`, which the process of `tid` is about to close: its timer continues with a copy
    /// of the file.
    pub(super) fn forget_timer(&mut self, tid: i32, fd: i32) {
        let Some(pid) = self.threads.get(&tid).map(|thread| thread.process) else {
            return;
        };
        let timer = self.processes.get_mut(&pid);
        if let Some(timer) = timer.and_then(|process| process.timers.remove(&fd)) {
            self.hand_on(timer, (pid, fd));
        }
    }

    /// Moves a timer to a copy of its file in any process, if its file was closed at one place.
    pub(super) fn hand_on(&mut self, timer: TimerFile, closed: (i32, i32)) {
        if timer.timer.at.is_none() && timer.expired == 0 {
            return;
        }
        // This time identifies the copies.
        set_kernels(&timer, MARK_S, 0);
        let (own, _) = closed;
        let others = self.processes.keys().copied().filter(|&pid| pid != own);
        let copies = core::iter::once(own)
            .chain(others)
            .flat_map(|pid| numbers(pid).map(move |fd| (pid, fd)));
        let mut free = copies.filter(|&(pid, fd)| {
            let process = self.processes.get(&pid);
            process.is_some_and(|it| !it.timers.contains_key(&fd)) && (pid, fd) != closed
        });
        let copy = free.find(|&(pid, fd)| is_marked(pid, fd));
        set_real(&timer, i64::from(timer.expired > 0));
        let Some((pid, fd)) = copy else { return };
        if let Some(process) = self.processes.get_mut(&pid) {
            process.timers.insert(fd, timer);
        }
    }

    /// Replaces the kernel's timer behind `fd` by one in virtual time.
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

    /// Reads `file`, if it is a timer's file.
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
            // A read of a copy of this file has taken the expirations.
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
    /// The timer that the program requests with the two times at `place`. With `clock`, the first
    /// time is a reading of this clock; otherwise it counts from `now`.
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

    /// Writes the interval and the remaining time to `place`, in the program's format.
    pub(super) fn tell(self, memory: Memory, place: u64, now: Instant) -> Result<(), Errno> {
        let left = self.at.map_or(Duration::ZERO, |at| at - now);
        let left = i64::try_from(left.as_nanos()).unwrap_or(0);
        memory.write_pair(place, timespec(self.interval.cast_signed()))?;
        memory.write_pair(place.wrapping_add(16), timespec(left))
    }
}

/// Number of expirations of a timer until `now`.
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

/// Sets the kernel's timer to this many nanoseconds, or stops it if 0. Waits until the file shows
/// the change.
fn set_real(timer: &TimerFile, nanos: i64) {
    set_kernels(timer, 0, nanos);
    if nanos > 0 {
        let mut fds = [rustix::event::PollFd::new(&timer.file, PollFlags::IN)];
        let most = Timespec {
            tv_sec: 1,
            tv_nsec: 0,
        };
        let _ = rustix::event::poll(&mut fds, Some(&most));
    }
}

fn set_kernels(timer: &TimerFile, seconds: i64, nanos: i64) {
    let it_interval = Timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    let it_value = Timespec {
        tv_sec: seconds,
        tv_nsec: nanos,
    };
    let new = Itimerspec {
        it_interval,
        it_value,
    };
    let _ = timerfd_settime(&timer.file, TimerfdTimerFlags::empty(), &new);
}

/// Whether the kernel's timer behind a file is set to a long time.
fn is_marked(pid: i32, fd: i32) -> bool {
    let left = told_of(pid, fd, "it_value");
    let seconds = left.and_then(|it| it.strip_prefix('(')?.split(',').next()?.parse().ok());
    seconds.is_some_and(|seconds: i64| seconds > MARK_S / 2)
}

/// The clock of a timer's file; `None` for another file.
fn clock_of(pid: i32, fd: i32) -> Option<i64> {
    told_of(pid, fd, "clockid")?.parse().ok()
}

#[cfg(test)]
mod tests {
    use std::os::fd::{AsRawFd as _, OwnedFd};

    use rustix::time::{TimerfdClockId, TimerfdFlags, timerfd_create};

    use super::*;
    use crate::guest::supervisor::tests::{Bench, MS, Told, error, fd};
    use crate::guest::tests::Room;

    /// A timer for 10 ms, once and each 3 ms: until 16 ms it expires three times, and is due at 19.
    #[test]
    fn a_timer_expires_as_often_as_its_interval_fits() {
        let at = Instant::from_millis;
        let after = |interval_ms: u64, now_ms: u64| {
            let mut timer = Timer {
                at: Some(at(10)),
                interval: interval_ms * 1_000_000,
            };
            let count = expirations(&mut timer, at(now_ms));
            (count, timer.at.map(Instant::as_millis))
        };
        assert_eq!(
            (after(0, 9), after(0, 10), after(0, 99)),
            ((0, Some(10)), (1, None), (1, None))
        );
        assert_eq!(
            (after(3, 9), after(3, 10), after(3, 12)),
            ((0, Some(10)), (1, Some(13)), (1, Some(13)))
        );
        assert_eq!((after(3, 13), after(3, 16)), ((2, Some(16)), (3, Some(19))));
        assert_eq!(expirations(&mut Timer::default(), at(99)), 0);
    }

    fn times(first: [u64; 2], interval: [u64; 2]) -> Room {
        Room::of_words(&[interval[0], interval[1], first[0], first[1]])
    }

    /// alarm(2): whole seconds, and what was left of the one before, rounded up.
    #[test]
    fn an_alarm_is_due_after_whole_seconds() {
        let mut bench = Bench::new();
        bench.passes(500);
        let alarm = libc::SYS_alarm;
        assert_eq!(bench.calls(alarm, &[2]), Told::Answer(0));
        let at = |ms| Some(Instant::from_millis(ms));
        assert_eq!(
            (bench.process().alarm.at, bench.process().alarm.interval),
            (at(2_500), 0)
        );
        bench.passes(1);
        assert_eq!(bench.calls(alarm, &[0]), Told::Answer(2));
        assert_eq!(bench.process().alarm.at, None);
        assert_eq!(bench.calls(alarm, &[1]), Told::Answer(0));
        bench.passes(999);
        assert_eq!(bench.calls(alarm, &[1]), Told::Answer(1));
    }

    /// setitimer(2): interval and first time in seconds and microseconds.
    #[test]
    fn an_interval_timer_is_set_and_told() {
        let mut bench = Bench::new();
        bench.passes(500);
        let room = Room::new(32);
        let asked = times([1, 250_000], [0, 40_000]);
        let real = libc::ITIMER_REAL.unsigned_abs().into();
        let (set, get) = (libc::SYS_setitimer, libc::SYS_getitimer);
        assert_eq!(
            bench.calls(set, &[real, asked.at(0), room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.words(), [0; 4]);
        let alarm = bench.process().alarm;
        assert_eq!(
            (alarm.at, alarm.interval),
            (Some(Instant::from_millis(1_750)), 40 * MS)
        );
        bench.passes(300);
        assert_eq!(bench.calls(get, &[real, room.at(0)]), Told::Answer(0));
        assert_eq!(room.words(), [0, 40_000, 0, 950_000]);
        assert_eq!(bench.calls(set, &[real, 0, room.at(0)]), Told::Answer(0));
        assert!(bench.process().alarm.at.is_some(), "nothing was asked for");
        let none = times([0, 0], [0, 40_000]);
        assert_eq!(bench.calls(set, &[real, none.at(0), 0]), Told::Answer(0));
        assert_eq!(bench.process().alarm.at, None);
        let wrong = times([0, 1_000_000], [0, 0]);
        assert_eq!(
            bench.calls(set, &[real, wrong.at(0), 0]),
            error(Errno::EINVAL)
        );
        assert!(bench.supervisor.notes().is_empty());
        let virt = libc::ITIMER_VIRTUAL.unsigned_abs().into();
        assert_eq!(bench.calls(set, &[virt, asked.at(0), 0]), Told::Kernel);
        assert_eq!(
            bench.supervisor.notes(),
            ["a timer of processor time is real"]
        );
    }

    fn timer_file(clock: TimerfdClockId) -> OwnedFd {
        timerfd_create(clock, TimerfdFlags::NONBLOCK).expect("the system has them")
    }

    /// timerfd_create(2): a read gives the number of expirations, 8 bytes.
    #[test]
    fn a_timers_file_is_read_when_its_time_has_come() {
        let mut bench = Bench::new();
        bench.passes(100);
        let file = timer_file(TimerfdClockId::Monotonic);
        let room = Room::new(32);
        let asked = times([0, 20_000_000], [0, 5_000_000]);
        let (set, get) = (libc::SYS_timerfd_settime, libc::SYS_timerfd_gettime);
        assert_eq!(bench.calls(get, &[fd(&file), room.at(0)]), Told::Answer(0));
        assert_eq!(room.words(), [0; 4]);
        let args = [fd(&file), 0, asked.at(0), room.at(0)];
        assert_eq!(bench.calls(set, &args), Told::Answer(0));
        let read = libc::SYS_read;
        let reads = [fd(&file), room.at(0), 8];
        assert_eq!(bench.calls(read, &reads), error(Errno::EAGAIN));
        bench.passes(19);
        let now = bench.supervisor.stage.now();
        bench.supervisor.fire_timers(now);
        assert_eq!(bench.calls(read, &reads), error(Errno::EAGAIN));
        bench.passes(7);
        let now = bench.supervisor.stage.now();
        assert!(!core::mem::take(&mut bench.supervisor.is_changed));
        bench.supervisor.fire_timers(now);
        assert!(bench.supervisor.is_changed);
        assert_eq!(bench.calls(get, &[fd(&file), room.at(0)]), Told::Answer(0));
        assert_eq!(room.words(), [0, 5_000_000, 0, 4_000_000]);
        assert_eq!(bench.calls(read, &reads), Told::Answer(8));
        assert_eq!(room.words()[0], 2);
        assert_eq!(bench.calls(read, &reads), error(Errno::EAGAIN));
        // By its clock: 1,000.2 s are 200 ms.
        let at = times([1_000, 200_000_000], [0, 0]);
        assert_eq!(
            bench.calls(set, &[fd(&file), 1, at.at(0), 0]),
            Told::Answer(0)
        );
        let own = file.as_raw_fd();
        let timer = |bench: &mut Bench| bench.process().timers[&own].timer;
        assert_eq!(timer(&mut bench).at, Some(Instant::from_millis(200)));
        assert_eq!(
            bench.calls(set, &[fd(&file), 2, at.at(0), 0]),
            Told::Answer(0)
        );
        assert_eq!(timer(&mut bench).at, Some(Instant::from_millis(1_000_326)));
        assert_eq!(
            bench.calls(set, &[9_999, 0, at.at(0), 0]),
            error(Errno::EBADF)
        );
        let null = std::fs::File::open("/dev/null").expect("it is there");
        assert_eq!(
            bench.calls(set, &[fd(&null), 0, at.at(0), 0]),
            error(Errno::EINVAL)
        );
        assert_eq!(bench.calls(libc::SYS_timerfd_create, &[1, 0]), Told::Kernel);
    }

    /// It waits, unless it was opened with TFD_NONBLOCK; a setting forgets what expired.
    #[test]
    fn a_read_of_a_timers_file_waits() {
        let mut bench = Bench::new();
        let file = timerfd_create(TimerfdClockId::Realtime, TimerfdFlags::empty());
        let file = file.expect("the system has them");
        let (room, asked) = (Room::new(8), times([0, 20_000_000], [0, 0]));
        let set = [fd(&file), 0, asked.at(0), 0];
        assert_eq!(
            bench.calls(libc::SYS_timerfd_settime, &set),
            Told::Answer(0)
        );
        let reads = [fd(&file), room.at(0), 8];
        assert_eq!(
            bench.calls(libc::SYS_read, &reads),
            Told::Waits(On::Files, None)
        );
        bench.passes(20);
        let now = bench.supervisor.stage.now();
        bench.supervisor.fire_timers(now);
        let own = file.as_raw_fd();
        assert_eq!(bench.process().timers[&own].expired, 1);
        assert_eq!(
            bench.calls(libc::SYS_timerfd_settime, &set),
            Told::Answer(0)
        );
        assert_eq!(bench.process().timers[&own].expired, 0);
        assert_eq!(
            bench.calls(libc::SYS_read, &reads),
            Told::Waits(On::Files, None)
        );
        // One of the calendar: 2026 began with the run.
        let at = times([1_767_225_600, 60_000_000], [0, 0]);
        let set = [fd(&file), 1, at.at(0), 0];
        assert_eq!(
            bench.calls(libc::SYS_timerfd_settime, &set),
            Told::Answer(0)
        );
        assert_eq!(
            bench.process().timers[&own].timer.at,
            Some(Instant::from_millis(60))
        );
        assert_eq!(clock_of(bench.tid, own), Some(0));
    }

    /// A copy of the file (dup(2)) goes on with the timer; without one it is forgotten.
    #[test]
    fn a_timer_goes_on_at_a_copy_of_its_file() {
        let mut bench = Bench::new();
        let (tid, own) = (bench.tid, std::process::id().cast_signed());
        let asked = times([0, 20_000_000], [0, 0]);
        let file = timer_file(TimerfdClockId::Monotonic);
        let set = |bench: &mut Bench, file: &OwnedFd| {
            let told = bench.calls(libc::SYS_timerfd_settime, &[fd(file), 0, asked.at(0), 0]);
            assert_eq!(told, Told::Answer(0));
        };
        set(&mut bench, &file);
        assert!(!is_marked(own, file.as_raw_fd()));
        // The supervisor's own copies are files of this process as well.
        let _copy = file.try_clone().expect("it is open");
        bench.supervisor.forget_timer(tid, file.as_raw_fd());
        let known = |bench: &mut Bench| bench.process().timers.keys().copied().collect::<Vec<_>>();
        let [copy] = known(&mut bench)[..] else {
            panic!("one copy goes on");
        };
        assert!(copy != file.as_raw_fd() && clock_of(own, copy) == Some(1));
        assert!(!is_marked(own, copy), "the mark is taken away");
        bench.process().timers.clear();
        // One that is not set has nothing to go on with.
        let file = timer_file(TimerfdClockId::Monotonic);
        let _copy = file.try_clone().expect("it is open");
        let none = times([0, 0], [0, 0]);
        bench.calls(libc::SYS_timerfd_settime, &[fd(&file), 0, none.at(0), 0]);
        bench.supervisor.keep_open_timers(tid);
        assert_eq!(known(&mut bench), [file.as_raw_fd()]);
        bench.supervisor.forget_timer(tid, file.as_raw_fd());
        assert!(known(&mut bench).is_empty());
        bench.supervisor.forget_timer(-7, 3);
    }

    #[test]
    fn a_timer_is_asked_for_and_told() {
        let memory = Memory(crate::guest::tests::own());
        let now = Instant::from_millis(100);
        let asked = |first, clock| {
            let room = times(first, [0, 3]);
            let timer = Timer::asked_for(memory, room.at(0), clock, now);
            timer.map(|timer| (timer.at.map(Instant::as_nanos), timer.interval))
        };
        assert_eq!(asked([1, 2], None), Ok((Some(1_100 * MS + 2), 3)));
        assert_eq!(asked([0, 0], None), Ok((None, 3)));
        assert_eq!(asked([1_000, 7], Some(1)), Ok((Some(7), 3)));
        assert_eq!(asked([0, 1_000_000_000], None), Err(Errno::EINVAL));
        let room = Room::new(32);
        let timer = Timer {
            at: Some(Instant::from_millis(1_250)),
            interval: 2_000_000_003,
        };
        assert_eq!(timer.tell(memory, room.at(0), now), Ok(()));
        assert_eq!(room.words(), [2, 3, 1, 150_000_000]);
        assert_eq!(Timer::default().tell(memory, room.at(0), now), Ok(()));
        assert_eq!(room.words(), [0; 4]);
    }
}
