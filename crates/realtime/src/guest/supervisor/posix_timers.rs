//! Timers of `timer_create`: they belong to a process, and send a signal at a virtual time.
//!
//! The supervisor delivers the signal to threads that wait for it (sigwaitinfo). The C library
//! implements timers with a callback in this way, in a thread of its own. For other threads, the
//! kernel delivers the signal.

use nix::errno::Errno;
use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;
use rustix::process::{Signal, kill_process};
use rustix_libc_wrappers::process::SignalExt as _;

use super::clocks::low_i32;
use super::timers::expirations;
use super::{Memory, Next, Outcome, Supervisor, is_death};
use crate::guest::call::Call;
use crate::guest::pending::Pending;
use crate::guest::task::{PosixTimer, Timer};

/// Maximum number of timers of a process.
const TIMERS_MAX: usize = 1024;
/// The highest signal.
const SIGNAL_MAX: i32 = 64;
/// Kinds of notification: a signal, none, a signal for a callback, a signal to one thread.
const SIGEV_SIGNAL: i32 = 0;
const SIGEV_NONE: i32 = 1;
const SIGEV_THREAD: i32 = 2;
const SIGEV_THREAD_ID: i32 = 4;
/// Code of the origin in a timer's signal.
const SI_TIMER: i32 = -2;
/// Length of the data of a signal.
pub(super) const SIGINFO: usize = 128;

impl Supervisor {
    pub(super) fn posix_timer(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [first, second, third, fourth, ..] = call.args;
        if call.number == libc::SYS_timer_create {
            return self.create_timer(tid, low_i32(first), [second, third]);
        }
        let now = self.stage.now();
        let memory = Memory(Pid::from_raw(tid));
        let pid = self.threads.get(&tid).ok_or(Errno::ESRCH)?.process;
        let process = self.processes.get_mut(&pid).ok_or(Errno::ESRCH)?;
        let id = low_i32(first);
        let timer = process.posix_timers.get_mut(&id).ok_or(Errno::EINVAL)?;
        let was = timer.timer;
        let place = match call.number {
            libc::SYS_timer_delete => {
                process.posix_timers.remove(&id);
                return Ok(Outcome::Answer(0));
            }
            libc::SYS_timer_getoverrun => return Ok(Outcome::Answer(timer.overrun)),
            libc::SYS_timer_gettime => second,
            _ => {
                let is_absolute = low_i32(second) & 1 != 0;
                let clock = is_absolute.then_some(timer.clock);
                timer.timer = Timer::asked_for(memory, third, clock, now)?;
                timer.is_due = false;
                fourth
            }
        };
        if place != 0 {
            was.tell(memory, place, now)?;
        }
        Ok(Outcome::Answer(0))
    }

    fn create_timer(
        &mut self,
        tid: i32,
        clock: i32,
        [event, place]: [u64; 2],
    ) -> Result<Outcome, Errno> {
        let memory = Memory(Pid::from_raw(tid));
        let pid = self.threads.get(&tid).ok_or(Errno::ESRCH)?.process;
        let process = self.processes.get_mut(&pid).ok_or(Errno::ESRCH)?;
        let free = (0..).find(|id| !process.posix_timers.contains_key(id));
        let id = free.filter(|_| process.posix_timers.len() < TIMERS_MAX);
        let id = id.ok_or(Errno::EAGAIN)?;
        let mut timer = PosixTimer {
            clock: clock.into(),
            signal: libc::SIGALRM,
            value: u64::from(id.cast_unsigned()),
            thread: None,
            timer: Timer::default(),
            is_due: false,
            is_sent: false,
            overrun: 0,
        };
        if event != 0 {
            let word = |at: u64| memory.u32(event.wrapping_add(at)).map(u32::cast_signed);
            let notice = word(12)?;
            let is_signal = (1..=SIGNAL_MAX).contains(&word(8)?);
            let threads = &self.threads;
            let is_own = |id: i32| threads.get(&id).is_some_and(|it| it.process == pid);
            let is_valid = match notice {
                SIGEV_NONE => true,
                SIGEV_THREAD_ID => is_signal && is_own(word(16)?),
                SIGEV_SIGNAL | SIGEV_THREAD => is_signal,
                _ => false,
            };
            if !is_valid {
                return Err(Errno::EINVAL);
            }
            timer.value = memory.u64(event)?;
            timer.signal = match notice {
                SIGEV_NONE => 0,
                _ => word(8)?,
            };
            timer.thread = match notice {
                SIGEV_THREAD_ID => Some(word(16)?),
                _ => None,
            };
        }
        memory.write(place, &id.to_ne_bytes())?;
        process.posix_timers.insert(id, timer);
        Ok(Outcome::Answer(0))
    }

    /// Lets timers expire whose time has come by `now`.
    pub(super) fn fire_posix_timers(&mut self) {
        let now = self.stage.now();
        let (mut sent, mut waited) = (false, false);
        for (&pid, process) in &mut self.processes {
            let rustix_pid = rustix::process::Pid::from_raw(pid);
            for timer in process.posix_timers.values_mut() {
                let count = expirations(&mut timer.timer, now);
                if count == 0 || timer.signal == 0 {
                    continue;
                }
                let bit = bit_of(timer.signal);
                let is_held = || Pending::of(pid, pid).common & bit != 0;
                if timer.is_due || timer.is_sent && is_held() {
                    // Its signal is already pending, so no second one is sent.
                    let count = i64::try_from(count).unwrap_or(i64::MAX);
                    timer.overrun = timer.overrun.saturating_add(count);
                    continue;
                }
                timer.overrun = i64::try_from(count - 1).unwrap_or(i64::MAX);
                let is_low =
                    Signal::from_named_raw(timer.signal).is_some() && timer.thread.is_none();
                // The C library waits for its own signal, so that one is not sent.
                let signal = Signal::from_raw(timer.signal);
                let signal = signal.filter(|_| is_low || Pending::of(pid, pid).are_handled(bit));
                match (signal, rustix_pid) {
                    (Some(signal), Some(pid)) => {
                        let _ = kill_process(pid, signal);
                        timer.is_sent = true;
                        sent = true;
                    }
                    _ => {
                        timer.is_due = true;
                        waited = true;
                    }
                }
            }
        }
        self.is_signalled |= sent;
        if waited {
            self.wake_waiters_for_signals();
        }
    }

    fn wake_waiters_for_signals(&mut self) {
        let waits = self.threads.values().filter(|thread| {
            let call = thread.call.map(|call| call.number);
            call == Some(libc::SYS_rt_sigtimedwait) && thread.is_blocked()
        });
        let mut waits: Vec<(u64, i32)> = waits
            .map(|thread| (thread.blocked_at, thread.tid.as_raw()))
            .collect();
        waits.sort_unstable();
        for (_, tid) in waits {
            self.ready(tid, Next::Attempt);
        }
    }

    /// The signal of a timer for which `tid` waits in `call`, with data in the kernel's format.
    pub(super) fn take_timer_signal(
        &mut self,
        tid: i32,
        call: &Call,
        wanted: u64,
    ) -> Result<Option<Outcome>, Errno> {
        let pid = self.threads.get(&tid).ok_or(Errno::ESRCH)?.process;
        let process = self.processes.get_mut(&pid).ok_or(Errno::ESRCH)?;
        let is_wanted = |timer: &PosixTimer| {
            let bit = u32::try_from(timer.signal - 1).ok();
            let is_in = bit.is_some_and(|bit| wanted.checked_shr(bit).unwrap_or(0) & 1 != 0);
            let is_for = timer.thread.is_none_or(|thread| thread == tid);
            timer.is_due && is_in && is_for
        };
        let mut timers = process.posix_timers.iter_mut();
        let Some((id, timer)) = timers.find(|(_, timer)| is_wanted(timer)) else {
            return Ok(None);
        };
        timer.is_due = false;
        let (signal, info) = (timer.signal, told_by(*id, timer));
        if call.args[1] != 0 {
            Memory(Pid::from_raw(tid)).write(call.args[1], &info)?;
        }
        Ok(Some(Outcome::Answer(signal.into())))
    }

    /// The data of a signal that the kernel has for a thread and the thread takes now, if a timer
    /// has sent the signal.
    pub(super) fn take_sent_signal(&mut self, tid: i32, call: &Call, pending: u64) -> Option<()> {
        let pid = self.threads.get(&tid)?.process;
        let mut timers = self.processes.get(&pid)?.posix_timers.values();
        if !timers.any(|it| it.is_sent && bit_of(it.signal) & pending != 0) {
            return None;
        }
        ptrace::syscall(Pid::from_raw(tid), None).ok()?;
        let (_, status) = self.wait_for(tid)?;
        if is_death(status) {
            self.died(tid, status);
            return None;
        }
        let taken = Call::of(Pid::from_raw(tid)).ok()?.result();
        let info = self.told_by_timer(pid, i32::try_from(taken).ok()?)?;
        if call.args[1] != 0 {
            let _ = Memory(Pid::from_raw(tid)).write(call.args[1], &info);
        }
        Some(())
    }

    /// The data for the handler of this signal, if a timer has sent the signal.
    pub(super) fn told_by_timer(&mut self, pid: i32, signal: i32) -> Option<[u8; SIGINFO]> {
        let process = self.processes.get_mut(&pid)?;
        let mut timers = process.posix_timers.iter_mut();
        let (id, timer) = timers.find(|(_, it)| it.is_sent && it.signal == signal)?;
        timer.is_sent = false;
        Some(told_by(*id, timer))
    }
}

/// A signal as a bit.
fn bit_of(signal: i32) -> u64 {
    let bit = u32::try_from(signal - 1).ok();
    bit.and_then(|bit| 1_u64.checked_shl(bit)).unwrap_or(0)
}

/// The data of a timer's signal, in the kernel's format.
fn told_by(id: i32, timer: &PosixTimer) -> [u8; SIGINFO] {
    let mut info = [0; SIGINFO];
    let overrun = i32::try_from(timer.overrun).unwrap_or(i32::MAX);
    info[..4].copy_from_slice(&timer.signal.to_ne_bytes());
    info[8..12].copy_from_slice(&SI_TIMER.to_ne_bytes());
    info[16..20].copy_from_slice(&id.to_ne_bytes());
    info[20..24].copy_from_slice(&overrun.to_ne_bytes());
    info[24..32].copy_from_slice(&timer.value.to_ne_bytes());
    info
}

#[cfg(test)]
mod tests {
    use super::super::{On, State};
    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told, error};
    use crate::guest::tests::Room;

    /// A `sigevent`: value, signal, kind of notice, thread.
    fn event(value: u64, signal: i32, notice: i32, thread: i32) -> Room {
        let room = Room::new(64);
        room.put(0, &value.to_ne_bytes());
        room.put(8, &[signal, notice, thread].map(i32::to_ne_bytes).concat());
        room
    }

    fn times(first: [u64; 2], interval: [u64; 2]) -> Room {
        Room::of_words(&[interval[0], interval[1], first[0], first[1]])
    }

    /// timer_create(2): the least free number; without an event SIGALRM with that number.
    #[test]
    fn a_timer_is_made_as_its_event_says() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let place = Room::of(&[0xFF; 4]);
        let make = |bench: &mut Bench, event: u64| {
            let told = bench.calls(libc::SYS_timer_create, &[1, event, place.at(0)]);
            (told, place.numbers()[0])
        };
        assert_eq!(make(&mut bench, 0), (Told::Answer(0), 0));
        let told = event(0x1_2345_6789, 34, SIGEV_SIGNAL, -1);
        assert_eq!(make(&mut bench, told.at(0)), (Told::Answer(0), 1));
        let told = event(7, 64, SIGEV_THREAD, -1);
        assert_eq!(make(&mut bench, told.at(0)), (Told::Answer(0), 2));
        let told = event(7, 65, SIGEV_NONE, -1);
        assert_eq!(make(&mut bench, told.at(0)), (Told::Answer(0), 3));
        let told = event(7, 1, SIGEV_THREAD_ID, tid);
        assert_eq!(make(&mut bench, told.at(0)), (Told::Answer(0), 4));
        let timers: Vec<(i32, u64, Option<i32>, i64)> = bench
            .process()
            .posix_timers
            .values()
            .map(|it| (it.signal, it.value, it.thread, it.clock))
            .collect();
        let expected = [
            (14, 0, None, 1),
            (34, 0x1_2345_6789, None, 1),
            (64, 7, None, 1),
            (0, 7, None, 1),
            (1, 7, Some(tid), 1),
        ];
        assert_eq!(timers, expected);
        for (signal, notice, thread) in [
            (0, SIGEV_SIGNAL, -1),
            (65, SIGEV_SIGNAL, -1),
            (65, SIGEV_THREAD, -1),
            (10, 3, -1),
            (10, SIGEV_THREAD_ID, 1),
            (0, SIGEV_THREAD_ID, tid),
        ] {
            let wrong = event(7, signal, notice, thread);
            let told = bench.calls(libc::SYS_timer_create, &[1, wrong.at(0), place.at(0)]);
            assert_eq!(told, error(Errno::EINVAL), "{signal} {notice} {thread}");
        }
        let delete = libc::SYS_timer_delete;
        assert_eq!(bench.calls(delete, &[1]), Told::Answer(0));
        assert_eq!(bench.calls(delete, &[1]), error(Errno::EINVAL));
        assert_eq!(make(&mut bench, 0), (Told::Answer(0), 1));
        let fault = bench.calls(libc::SYS_timer_create, &[1, 0, 8]);
        assert_eq!(fault, error(Errno::EFAULT));
        for _ in 5..TIMERS_MAX {
            assert_eq!(make(&mut bench, 0).0, Told::Answer(0));
        }
        let many = bench.calls(libc::SYS_timer_create, &[1, 0, place.at(0)]);
        assert_eq!(many, error(Errno::EAGAIN));
    }

    /// A timer without a signal: nothing is sent to this process.
    #[test]
    fn a_timer_is_set_and_told() {
        let mut bench = Bench::new();
        bench.passes(100);
        let (place, none) = (Room::new(4), event(0, 0, SIGEV_NONE, -1));
        bench.calls(libc::SYS_timer_create, &[1, none.at(0), place.at(0)]);
        let (set, get) = (libc::SYS_timer_settime, libc::SYS_timer_gettime);
        let room = Room::of(&[0xFF; 32]);
        let asked = times([0, 20_000_000], [0, 3_000_000]);
        assert_eq!(
            bench.calls(set, &[0, 0, asked.at(0), room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.words(), [0; 4]);
        bench.passes(5);
        assert_eq!(bench.calls(get, &[0, room.at(0)]), Told::Answer(0));
        assert_eq!(room.words(), [0, 3_000_000, 0, 15_000_000]);
        assert_eq!(bench.calls(set, &[0, 0, asked.at(0), 0]), Told::Answer(0));
        let at = times([1_000, 300_000_000], [0, 0]);
        assert_eq!(
            bench.calls(set, &[0, 1, at.at(0), room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.words(), [0, 3_000_000, 0, 20_000_000]);
        assert_eq!(bench.calls(get, &[0, room.at(0)]), Told::Answer(0));
        assert_eq!(room.words(), [0, 0, 0, 195_000_000]);
        assert_eq!(bench.calls(set, &[0, 2, at.at(0), 0]), Told::Answer(0));
        assert_eq!(bench.calls(get, &[0, room.at(0)]), Told::Answer(0));
        assert_eq!(room.words(), [0, 0, 1_000, 300_000_000]);
        assert_eq!(bench.calls(get, &[7, room.at(0)]), error(Errno::EINVAL));
        assert_eq!(
            bench.calls(libc::SYS_timer_getoverrun, &[0]),
            Told::Answer(0)
        );
        bench.passes(2_000_000);
        bench.supervisor.fire_posix_timers();
        let timer = bench.process().posix_timers[&0];
        assert_eq!(
            (timer.is_due, timer.is_sent, timer.overrun),
            (false, false, 0)
        );
        assert!(!bench.supervisor.is_signalled);
    }

    /// SIGRTMIN and higher go to the thread that waits for them: rt_sigtimedwait(2), sigaction(2).
    #[test]
    fn a_thread_takes_the_signal_of_a_timer() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let (place, told) = (Room::new(4), event(0xABCD, 40, SIGEV_SIGNAL, -1));
        bench.calls(libc::SYS_timer_create, &[1, told.at(0), place.at(0)]);
        let asked = times([0, 20_000_000], [0, 3_000_000]);
        bench.calls(libc::SYS_timer_settime, &[0, 0, asked.at(0), 0]);
        let set = Room::of_words(&[1 << 39]);
        let info = Room::of(&[0xFF; 128]);
        let time = Room::of_words(&[0, 50_000_000]);
        let args = [set.at(0), info.at(0), time.at(0), 8];
        let wait = libc::SYS_rt_sigtimedwait;
        assert_eq!(
            bench.calls(wait, &args),
            Told::Waits(On::Others, Some(50_000_000))
        );
        bench.passes(30);
        bench.thread().state = State::Blocked(super::super::Wait::for_ever());
        bench.supervisor.fire_posix_timers();
        // At 20, 23, 26 and 29 ms: three more than the one that is told.
        let timer = bench.process().posix_timers[&0];
        assert_eq!(
            (timer.is_due, timer.is_sent, timer.overrun),
            (true, false, 3)
        );
        assert!(matches!(bench.thread().state, State::Ready(Next::Attempt)));
        bench.passes(3);
        bench.supervisor.fire_posix_timers();
        assert_eq!(
            bench.process().posix_timers[&0].overrun,
            4,
            "one more while it is pending"
        );
        let other = Room::of_words(&[!(1 << 39)]);
        let elsewhere = [other.at(0), info.at(0), time.at(0), 8];
        assert!(matches!(bench.calls(wait, &elsewhere), Told::Waits(..)));
        assert_eq!(bench.calls(wait, &args), Told::Answer(40));
        let mut expected = [0; 128];
        expected[..4].copy_from_slice(&40_i32.to_ne_bytes());
        expected[8..12].copy_from_slice(&(-2_i32).to_ne_bytes());
        expected[20..24].copy_from_slice(&4_i32.to_ne_bytes());
        expected[24..32].copy_from_slice(&0xABCD_u64.to_ne_bytes());
        assert_eq!(info.bytes(), expected);
        assert!(matches!(bench.calls(wait, &args), Told::Waits(..)));
        assert_eq!(
            bench.calls(libc::SYS_timer_getoverrun, &[0]),
            Told::Answer(4)
        );
        bench.passes(50);
        assert!(matches!(bench.calls(wait, &args), Told::Waits(..)));
        bench.passes(50);
        assert_eq!(bench.again(), error(Errno::EAGAIN));
        // One for another thread is not taken.
        bench.supervisor.fire_posix_timers();
        let timers = &mut bench.process().posix_timers;
        timers.get_mut(&0).expect("made").thread = Some(tid + 1);
        assert!(matches!(bench.calls(wait, &args), Told::Waits(..)));
        let timers = &mut bench.process().posix_timers;
        timers.get_mut(&0).expect("made").thread = Some(tid);
        let untold = [set.at(0), 0, time.at(0), 8];
        assert_eq!(bench.calls(wait, &untold), Told::Answer(40));
    }

    /// A handler is told of a timer whose signal was sent, once.
    #[test]
    fn a_handler_is_told_of_the_timer_that_sent_its_signal() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let place = Room::new(4);
        bench.calls(libc::SYS_timer_create, &[1, 0, place.at(0)]);
        assert_eq!(bench.supervisor.told_by_timer(tid, 14), None);
        let timer = bench.process().posix_timers.get_mut(&0).expect("made");
        (timer.is_sent, timer.overrun) = (true, i64::MAX);
        assert_eq!(bench.supervisor.told_by_timer(tid, 15), None);
        assert_eq!(bench.supervisor.told_by_timer(-7, 14), None);
        let info = bench
            .supervisor
            .told_by_timer(tid, 14)
            .expect("it was sent");
        assert_eq!(info[20..24], i32::MAX.to_ne_bytes());
        assert_eq!(bench.supervisor.told_by_timer(tid, 14), None);
    }

    #[test]
    fn a_signal_is_a_bit() {
        let bits = [1, 2, 32, 64].map(bit_of);
        assert_eq!(bits, [1, 2, 1 << 31, 1 << 63]);
        assert_eq!([0, -1, 65].map(bit_of), [0; 3]);
    }
}
