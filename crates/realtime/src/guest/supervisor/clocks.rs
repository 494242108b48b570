//! Clocks, sleeps and random bytes: all of them depend only on virtual time and the run's seed.

use core::time::Duration;

use nix::errno::Errno;
use nix::libc;
use protocols::Instant;

use super::{Memory, On, Outcome, Supervisor, Wait};
use crate::guest::call::{Call, RDTSC, RDTSCP};

const SECOND: i64 = 1_000_000_000;
/// Calendar time at the start of a run: 2026-01-01, 00:00 UTC.
const EPOCH_S: i64 = 1_767_225_600;
/// Time since the start of the machine at the start of a run. It is not 0, because some programs
/// take 0 for "not set".
const UPTIME_S: i64 = 1_000;
/// Maximum number of random bytes in one call.
const RANDOM_MAX: u64 = 1 << 20;

/// The reading of the clock with this number at the start of the run, nanoseconds.
pub(super) const fn begins(clock: i64) -> i64 {
    const REALTIME: i64 = libc::CLOCK_REALTIME as i64;
    const COARSE: i64 = libc::CLOCK_REALTIME_COARSE as i64;
    const ALARM: i64 = libc::CLOCK_REALTIME_ALARM as i64;
    const TAI: i64 = libc::CLOCK_TAI as i64;
    const PROCESS: i64 = libc::CLOCK_PROCESS_CPUTIME_ID as i64;
    const THREAD: i64 = libc::CLOCK_THREAD_CPUTIME_ID as i64;
    match clock {
        REALTIME | COARSE | ALARM | TAI => EPOCH_S * SECOND,
        PROCESS | THREAD => 0,
        clock if clock < 0 => 0,
        _ => UPTIME_S * SECOND,
    }
}

/// A `timespec` as nanoseconds.
pub(super) fn nanos([seconds, nanos]: [i64; 2]) -> Result<i64, Errno> {
    if seconds < 0 || !(0..SECOND).contains(&nanos) {
        return Err(Errno::EINVAL);
    }
    Ok(seconds.saturating_mul(SECOND).saturating_add(nanos))
}

/// Nanoseconds as a `timespec`.
pub(super) const fn timespec(nanos: i64) -> [i64; 2] {
    [nanos / SECOND, nanos % SECOND]
}

impl Supervisor {
    /// The current reading of `clock`, nanoseconds.
    pub(super) fn shown(&self, clock: i64) -> i64 {
        begins(clock).saturating_add_unsigned(self.stage.now().as_nanos())
    }

    /// The time at which `clock` reads `nanos`; past times count as now.
    pub(super) fn instant_of(clock: i64, nanos: i64) -> Instant {
        let since = nanos.saturating_sub(begins(clock)).max(0);
        Instant::from_nanos(since.cast_unsigned())
    }

    pub(super) fn look_at_clock(&self, memory: Memory, call: &Call) -> Result<Outcome, Errno> {
        let [first, second, ..] = call.args;
        let clock = i64::from(low_i32(first));
        match call.number {
            libc::SYS_clock_gettime => {
                memory.write_pair(second, timespec(self.shown(clock)))?;
            }
            libc::SYS_clock_getres if second != 0 => memory.write_pair(second, [0, 1])?,
            libc::SYS_clock_settime => return Err(Errno::EPERM),
            libc::SYS_gettimeofday if first != 0 => {
                let [seconds, nanos] = timespec(self.shown(0));
                memory.write_pair(first, [seconds, nanos / 1_000])?;
                if second != 0 {
                    memory.write(second, &[0; 8])?;
                }
            }
            libc::SYS_time => {
                let seconds = self.shown(0) / SECOND;
                if first != 0 {
                    memory.write(first, &seconds.to_ne_bytes())?;
                }
                return Ok(Outcome::Answer(seconds));
            }
            libc::SYS_times => {
                let ticks = self.shown(1) / (SECOND / 100);
                if first != 0 {
                    memory.write(first, &[0; 32])?;
                }
                return Ok(Outcome::Answer(ticks));
            }
            _ => {}
        }
        Ok(Outcome::Answer(0))
    }

    /// Whether the fault of `tid` is a read of the processor's counter, which is hidden from the
    /// program. If so, the thread gets a counter of nanoseconds instead.
    pub(super) fn reads_counter(&mut self, tid: i32) -> bool {
        let pid = nix::unistd::Pid::from_raw(tid);
        let Ok(call) = Call::of(pid) else {
            return false;
        };
        let mut code = [0; 3];
        let place = call.instruction();
        // The last two bytes of a page may be the end of the program.
        let read = Memory(pid).read(place, &mut code);
        let read = read.or_else(|_| Memory(pid).read(place, &mut code[..2]));
        let len = match code {
            _ if read.is_err() => return false,
            [a, b, _] if [a, b] == RDTSC => RDTSC.len(),
            RDTSCP => RDTSCP.len(),
            _ => return false,
        };
        if let Err(error) = self.stage.pass(self.settings.supervision.call_cost) {
            self.trouble = Some(error.into());
        }
        let count = self.shown(1).cast_unsigned();
        call.has_read_counter(pid, len as u64, count).is_ok()
    }

    pub(super) fn sleep(&self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let memory = Memory(nix::unistd::Pid::from_raw(tid));
        let [first, flags, third, ..] = call.args;
        let is_plain = call.number == libc::SYS_nanosleep;
        let (clock, request) = match is_plain {
            true => (1, first),
            false => (i64::from(low_i32(first)), third),
        };
        let nanos = nanos(memory.pair(request)?)?;
        let is_absolute = !is_plain && flags & 1 != 0;
        let deadline = match is_absolute {
            true => Self::instant_of(clock, nanos),
            false => self.entered(tid) + Duration::from_nanos(nanos.cast_unsigned()),
        };
        if self.stage.now() >= deadline {
            return Ok(Outcome::Answer(0));
        }
        Ok(Outcome::Block(Wait {
            on: On::Others,
            deadline: Some(deadline),
        }))
    }

    /// Time of the current call of the thread.
    pub(super) fn entered(&self, tid: i32) -> Instant {
        let thread = self.threads.get(&tid);
        thread.map_or(self.stage.now(), |thread| thread.entered)
    }

    pub(super) fn random(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [address, len, ..] = call.args;
        let len = len.min(RANDOM_MAX);
        let bytes = self.chance(tid, usize::try_from(len).unwrap_or_default());
        Memory(nix::unistd::Pid::from_raw(tid)).write(address, &bytes)?;
        Ok(Outcome::Answer(len.cast_signed()))
    }

    /// Random bytes for the process of `tid`.
    pub(super) fn chance(&mut self, tid: i32, len: usize) -> Vec<u8> {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        let process = process.and_then(|pid| self.processes.get_mut(&pid));
        let mut bytes = Vec::with_capacity(len + 8);
        if let Some(process) = process {
            while bytes.len() < len {
                bytes.extend(process.random.next_u64().to_le_bytes());
            }
        }
        bytes.resize(len, 0);
        bytes
    }
}

/// The lower half of a register, as the kernel takes an `int`.
pub(super) fn low_i32(value: u64) -> i32 {
    let [a, b, c, d, ..] = value.to_le_bytes();
    i32::from_le_bytes([a, b, c, d])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, MS, Told, error};
    use crate::guest::tests::{Room, Stopped};

    /// The calendar begins with 2026 (`date -u -d 2026-01-01 +%s`), the time since the start of the
    /// machine with 1,000 s, and a processor's time with 0.
    #[test]
    fn clocks_begin_where_they_do() {
        for clock in [
            libc::CLOCK_REALTIME,
            libc::CLOCK_REALTIME_COARSE,
            libc::CLOCK_REALTIME_ALARM,
            libc::CLOCK_TAI,
        ] {
            assert_eq!(begins(clock.into()), 1_767_225_600_000_000_000);
        }
        for clock in [
            libc::CLOCK_PROCESS_CPUTIME_ID,
            libc::CLOCK_THREAD_CPUTIME_ID,
            -6,
        ] {
            assert_eq!(begins(clock.into()), 0);
        }
        for clock in [
            libc::CLOCK_MONOTONIC,
            libc::CLOCK_BOOTTIME,
            libc::CLOCK_MONOTONIC_RAW,
        ] {
            assert_eq!(begins(clock.into()), 1_000_000_000_000);
        }
        let at = |nanos| Supervisor::instant_of(1, nanos).as_nanos();
        assert_eq!([at(1_000_000_000_005), at(7)], [5, 0]);
    }

    #[test]
    fn a_time_has_seconds_and_less_than_one_more() {
        assert_eq!(nanos([2, 5]), Ok(2_000_000_005));
        assert_eq!(
            (nanos([0, 0]), nanos([0, 999_999_999])),
            (Ok(0), Ok(999_999_999))
        );
        assert_eq!(nanos([i64::MAX, 5]), Ok(i64::MAX));
        for wrong in [[-1, 0], [0, -1], [0, 1_000_000_000]] {
            assert_eq!(nanos(wrong), Err(Errno::EINVAL));
        }
        assert_eq!((timespec(2_000_000_005), timespec(0)), ([2, 5], [0, 0]));
        assert_eq!((low_i32(0x1_FFFF_FFFF), low_i32(0xFF_0000_0007)), (-1, 7));
    }

    /// 1.5 s after the start: the calendar shows 1,767,225,601.5 s, the clock since the machine's
    /// start 1,001.5 s, which are 100,150 ticks of 10 ms.
    #[test]
    fn each_call_about_clocks_tells_virtual_time() {
        let mut bench = Bench::new();
        bench.passes(1_500);
        let room = Room::of(&[0xA5; 40]);
        let [here, behind] = [room.at(0), room.at(16)];
        let untouched = u64::from_ne_bytes([0xA5; 8]);
        let half = 500_000_000;
        let day = 1_767_225_601;
        let real = libc::CLOCK_REALTIME as u64;
        let cases: [(i64, &[u64], i64, [u64; 3]); 11] = [
            (
                libc::SYS_clock_gettime,
                &[1, here],
                0,
                [1_001, half, untouched],
            ),
            (
                libc::SYS_clock_gettime,
                &[real, here],
                0,
                [day, half, untouched],
            ),
            (libc::SYS_clock_gettime, &[2, here], 0, [1, half, untouched]),
            (libc::SYS_clock_getres, &[1, here], 0, [0, 1, untouched]),
            (libc::SYS_clock_getres, &[1, 0], 0, [untouched; 3]),
            (libc::SYS_clock_settime, &[0, here], -1, [untouched; 3]),
            (
                libc::SYS_gettimeofday,
                &[here, 0],
                0,
                [day, 500_000, untouched],
            ),
            (
                libc::SYS_gettimeofday,
                &[here, behind],
                0,
                [day, 500_000, 0],
            ),
            (libc::SYS_gettimeofday, &[0, behind], 0, [untouched; 3]),
            (
                libc::SYS_time,
                &[0],
                i64::from(1_767_225_601),
                [untouched; 3],
            ),
            (
                libc::SYS_time,
                &[here],
                1_767_225_601,
                [day, untouched, untouched],
            ),
        ];
        for (number, args, answer, words) in cases {
            room.put(0, &[0xA5; 40]);
            assert_eq!(
                bench.calls(number, args),
                Told::Answer(answer),
                "{number} {args:?}"
            );
            assert_eq!(room.words()[..3], words, "{number} {args:?}");
        }
        room.put(0, &[0xA5; 40]);
        assert_eq!(bench.calls(libc::SYS_times, &[0]), Told::Answer(100_150));
        assert_eq!(room.words(), [untouched; 5]);
        assert_eq!(bench.calls(libc::SYS_times, &[here]), Told::Answer(100_150));
        assert_eq!(room.words(), [0, 0, 0, 0, untouched]);
        assert_eq!(
            bench.calls(libc::SYS_clock_gettime, &[1, 8]),
            error(Errno::EFAULT)
        );
    }

    #[test]
    fn a_sleep_ends_at_its_time() {
        let mut bench = Bench::new();
        bench.passes(10);
        let time = |seconds: u64, nanos: u64| Room::of_words(&[seconds, nanos]);
        let asked = time(0, 30_000_000);
        let until = |ms: u64| Told::Waits(On::Others, Some(ms * MS));
        assert_eq!(
            bench.calls(libc::SYS_nanosleep, &[asked.at(0), 0]),
            until(40)
        );
        bench.passes(29);
        assert_eq!(bench.again(), until(40));
        bench.passes(1);
        assert_eq!(bench.again(), Told::Answer(0));
        let sleep = libc::SYS_clock_nanosleep;
        assert_eq!(bench.calls(sleep, &[1, 0, asked.at(0)]), until(70));
        assert_eq!(bench.calls(sleep, &[1, 2, asked.at(0)]), until(70));
        // The clock since the machine's start begins with 1,000 s.
        let at = time(1_000, 90_000_000);
        assert_eq!(bench.calls(sleep, &[1, 1, at.at(0)]), until(90));
        let past = time(1_000, 40_000_000);
        assert_eq!(bench.calls(sleep, &[1, 1, past.at(0)]), Told::Answer(0));
        // The second argument of nanosleep is an address, and no flag.
        assert_eq!(
            bench.calls(libc::SYS_nanosleep, &[asked.at(0), 1]),
            until(70)
        );
        for wrong in [time(0, 1_000_000_000), time(u64::MAX, 0)] {
            let told = bench.calls(libc::SYS_nanosleep, &[wrong.at(0), 0]);
            assert_eq!(told, error(Errno::EINVAL));
        }
    }

    #[test]
    fn chance_is_that_of_the_seed() {
        let drawn = |len: u64| {
            let mut bench = Bench::new();
            let room = Room::new(64);
            let told = bench.calls(libc::SYS_getrandom, &[room.at(8), len, 0]);
            assert_eq!(told, Told::Answer(len.cast_signed()));
            let first = room.bytes();
            assert_eq!(
                bench.calls(libc::SYS_getrandom, &[room.at(8), len, 0]),
                told
            );
            assert!(len == 0 || room.bytes() != first);
            first
        };
        for len in [0, 1, 7, 8, 13, 32] {
            let bytes = drawn(len);
            assert_eq!(bytes, drawn(len));
            let (len, rest) = (usize::try_from(len).expect("small"), &bytes[8..]);
            assert_eq!(
                (&bytes[..8], &rest[len..]),
                (&[0; 8][..], &vec![0; 56 - len][..])
            );
            assert!(len < 8 || rest[..len].iter().any(|&byte| byte != 0));
        }
        let mut bench = Bench::new();
        let room = Room::new(1 << 20);
        let much = bench.calls(libc::SYS_getrandom, &[room.at(0), (1 << 20) + 5, 0]);
        assert_eq!(much, Told::Answer(1 << 20));
        let (tid, len) = (bench.tid, 21);
        assert_eq!(bench.supervisor.chance(tid, len).len(), len);
        assert_eq!(bench.supervisor.chance(-1, 3), [0; 3], "of no process");
    }

    /// Intel's manual: `rdtsc` is 0F 31, `rdtscp` 0F 01 F9. The clock shows 1,000 s, and each look
    /// costs a microsecond; 1,000,000,001,000 is 0xE8 D4A5 13E8.
    #[test]
    fn a_look_at_the_processors_counter_is_one_at_the_clock() {
        let mut bench = Bench::new();
        let stopped = Stopped::new();
        let tid = stopped.pid.as_raw();
        for (code, len, low) in [
            (&[0x0F, 0x31, 0x90][..], 2, 0xD4A5_13E8),
            (&[0x0F, 0x01, 0xF9], 3, 0xD4A5_17D0),
        ] {
            let at = stopped.runs(code);
            assert!(bench.supervisor.reads_counter(tid));
            let it = stopped.registers();
            assert_eq!([it.rip, it.rax, it.rdx], [at + len, low, 0xE8]);
        }
        let at = stopped.runs(&[0x0F, 0x0B, 0x90]);
        assert!(!bench.supervisor.reads_counter(tid));
        assert_eq!((stopped.registers().rip, bench.now()), (at, 2_000));
    }
}
