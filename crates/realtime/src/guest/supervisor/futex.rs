//! Futexes: words in memory on which threads wait for each other. The supervisor determines the
//! order of wake-ups.

use core::time::Duration;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;

use super::clocks::{low_i32, nanos};
use super::{Memory, Next, On, Outcome, State, Supervisor, Wait};
use crate::guest::call::Call;
use crate::guest::task::FutexKey;

pub(super) const ALL: u32 = u32::MAX;

/// Whether a futex call operates on a lock with priority inheritance.
pub(super) fn is_pi(call: &Call) -> bool {
    let command = command(low_i32(call.args[1]));
    call.number == libc::SYS_futex && matches!(command, libc::FUTEX_LOCK_PI | libc::FUTEX_LOCK_PI2)
}

/// The operation without its flags.
pub(super) const fn command(operation: i32) -> i32 {
    operation & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME)
}

impl Supervisor {
    pub(super) fn futex(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [address, operation, value, ..] = call.args;
        let operation = low_i32(operation);
        let is_own = operation & libc::FUTEX_PRIVATE_FLAG != 0;
        let key = self.futex_key(tid, address, is_own)?;
        let count = usize::try_from(low_i32(value).max(0)).unwrap_or_default();
        let command = operation & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME);
        match command {
            libc::FUTEX_WAIT | libc::FUTEX_WAIT_BITSET => self.futex_wait(tid, call, key),
            libc::FUTEX_WAKE => Ok(Outcome::Answer(self.futex_wake(key, count, ALL))),
            libc::FUTEX_WAKE_OP => self.futex_wake_op(tid, call, key),
            libc::FUTEX_WAKE_BITSET => {
                let [.., bits] = call.args;
                let [a, b, c, d, ..] = bits.to_le_bytes();
                let bits = u32::from_le_bytes([a, b, c, d]);
                Ok(Outcome::Answer(self.futex_wake(key, count, bits)))
            }
            libc::FUTEX_REQUEUE | libc::FUTEX_CMP_REQUEUE => {
                self.futex_requeue(tid, call, key, command == libc::FUTEX_CMP_REQUEUE)
            }
            libc::FUTEX_LOCK_PI | libc::FUTEX_LOCK_PI2 => self.pi_lock(tid, call, key, true),
            libc::FUTEX_TRYLOCK_PI => self.pi_lock(tid, call, key, false),
            libc::FUTEX_UNLOCK_PI => self.pi_unlock(tid, call, key),
            _ => {
                self.note(format!("futex operation {command} is done by the kernel"));
                Ok(Outcome::Kernel)
            }
        }
    }

    fn futex_wait(&self, tid: i32, call: &Call, key: FutexKey) -> Result<Outcome, Errno> {
        let [address, operation, value, timeout, _, bits] = call.args;
        let operation = low_i32(operation);
        let thread = self.threads.get(&tid).ok_or(Errno::ESRCH)?;
        if thread.is_woken {
            return Ok(Outcome::Answer(0));
        }
        let memory = Memory(Pid::from_raw(tid));
        let has_bits = operation & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME)
            == libc::FUTEX_WAIT_BITSET;
        let deadline = match timeout {
            0 => None,
            timeout => {
                let nanos = nanos(memory.pair(timeout)?)?;
                let clock = i64::from(operation & libc::FUTEX_CLOCK_REALTIME == 0);
                Some(match has_bits {
                    true => Self::instant_of(clock, nanos),
                    false => thread.entered + Duration::from_nanos(nanos.cast_unsigned()),
                })
            }
        };
        let is_first = matches!(thread.state, State::Running);
        let [a, b, c, d, ..] = value.to_le_bytes();
        if is_first && memory.u32(address)? != u32::from_le_bytes([a, b, c, d]) {
            return Err(Errno::EAGAIN);
        }
        if deadline.is_some_and(|at| self.stage.now() >= at) {
            return Err(Errno::ETIMEDOUT);
        }
        let [a, b, c, d, ..] = bits.to_le_bytes();
        let bits = match has_bits {
            true => u32::from_le_bytes([a, b, c, d]),
            false => ALL,
        };
        Ok(Outcome::Block(Wait {
            on: On::Futex(key, bits),
            deadline,
        }))
    }

    /// Threads that wait for `key`, oldest first.
    pub(super) fn futex_waiters(&self, key: FutexKey, bits: u32) -> Vec<i32> {
        let mut waiters: Vec<(u64, i32)> = Vec::new();
        for thread in self.threads.values() {
            if let State::Blocked(Wait {
                on: On::Futex(its, wanted),
                ..
            }) = thread.state
                && its == key
                && wanted & bits != 0
            {
                waiters.push((thread.blocked_at, thread.tid.as_raw()));
            }
        }
        waiters.sort_unstable();
        waiters.into_iter().map(|(_, tid)| tid).collect()
    }

    /// Wakes threads; returns their number.
    fn futex_wake(&mut self, key: FutexKey, most: usize, bits: u32) -> i64 {
        let waiters = self.futex_waiters(key, bits);
        let woken = waiters.into_iter().take(most);
        let mut count = 0;
        for tid in woken {
            self.wake(tid);
            count += 1;
        }
        count
    }

    /// Changes another word and wakes the threads that wait for the first word. If the old value of
    /// the other word meets a condition, also wakes threads that wait for that word.
    fn futex_wake_op(&mut self, tid: i32, call: &Call, key: FutexKey) -> Result<Outcome, Errno> {
        let [_, operation, wakes, others, target, change] = call.args;
        let [a, b, c, d, ..] = change.to_le_bytes();
        let change = Change::of(u32::from_le_bytes([a, b, c, d]));
        let is_own = low_i32(operation) & libc::FUTEX_PRIVATE_FLAG != 0;
        let other = self.futex_key(tid, target, is_own)?;
        let memory = Memory(Pid::from_raw(tid));
        let old = memory.u32(target)?;
        let (new, wakes_others) = change.apply(old).ok_or(Errno::ENOSYS)?;
        memory.write(target, &new.to_ne_bytes())?;
        let number = |value: u64| usize::try_from(low_i32(value).max(0)).unwrap_or_default();
        let mut count = self.futex_wake(key, number(wakes), ALL);
        if wakes_others {
            count += self.futex_wake(other, number(others), ALL);
        }
        Ok(Outcome::Answer(count))
    }

    pub(super) fn wake(&mut self, tid: i32) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.is_woken = true;
        }
        self.ready(tid, Next::Attempt);
    }

    fn futex_requeue(
        &mut self,
        tid: i32,
        call: &Call,
        key: FutexKey,
        compares: bool,
    ) -> Result<Outcome, Errno> {
        let [address, operation, wakes, moves, target, value] = call.args;
        let [a, b, c, d, ..] = value.to_le_bytes();
        let found = Memory(Pid::from_raw(tid)).u32(address)?;
        if compares && found != u32::from_le_bytes([a, b, c, d]) {
            return Err(Errno::EAGAIN);
        }
        let is_own = low_i32(operation) & libc::FUTEX_PRIVATE_FLAG != 0;
        let target = self.futex_key(tid, target, is_own)?;
        let number = |value: u64| usize::try_from(low_i32(value).max(0)).unwrap_or_default();
        let waiters = self.futex_waiters(key, ALL);
        let mut count = 0;
        for (index, waiter) in waiters.into_iter().enumerate() {
            if index < number(wakes) {
                self.wake(waiter);
            } else if index < number(wakes).saturating_add(number(moves)) {
                if let Some(State::Blocked(wait)) = self
                    .threads
                    .get_mut(&waiter)
                    .map(|thread| &mut thread.state)
                {
                    wait.on = On::Futex(target, ALL);
                }
            } else {
                break;
            }
            count += 1;
        }
        Ok(Outcome::Answer(count))
    }

    /// Handles an ended thread: the kernel has cleared its word, and threads that waited for it
    /// must wake.
    pub(super) fn wake_after_death(&mut self) {
        let mut waiters: Vec<(u64, i32)> = Vec::new();
        for thread in self.threads.values() {
            let State::Blocked(Wait {
                on: On::Futex(..), ..
            }) = thread.state
            else {
                continue;
            };
            let Some(call) = thread.call.filter(|call| !is_pi(call)) else {
                continue;
            };
            let [address, _, value, ..] = call.args;
            let [a, b, c, d, ..] = value.to_le_bytes();
            let found = Memory(thread.tid).u32(address);
            if found.is_ok_and(|found| found != u32::from_le_bytes([a, b, c, d])) {
                waiters.push((thread.blocked_at, thread.tid.as_raw()));
            }
        }
        waiters.sort_unstable();
        for (_, tid) in waiters {
            self.wake(tid);
        }
        self.pi_after_death();
    }

    fn futex_key(&self, tid: i32, address: u64, is_own: bool) -> Result<FutexKey, Errno> {
        let thread = self.threads.get(&tid).ok_or(Errno::ESRCH)?;
        let own = FutexKey::Own(thread.process, address);
        if is_own {
            return Ok(own);
        }
        Ok(shared_key(thread.process, address).unwrap_or(own))
    }
}

/// The change of a word by `FUTEX_WAKE_OP`, and the condition for waking more threads (futex(2)).
#[derive(Clone, Copy, Debug)]
struct Change {
    operation: u32,
    by: u32,
    comparison: u32,
    with: i32,
}

impl Change {
    /// Bits 28 to 31: the operation, and whether its operand is a bit's number; 24 to 27: the
    /// comparison; 12 to 23 and 0 to 11: the operands, signed.
    fn of(word: u32) -> Self {
        let signed = |bits: u32| (bits << 20).cast_signed() >> 20;
        let by = signed(word >> 12).cast_unsigned();
        Self {
            operation: word >> 28 & 7,
            by: if word >> 31 == 0 { by } else { 1 << (by & 31) },
            comparison: word >> 24 & 15,
            with: signed(word),
        }
    }

    /// The new word, and whether the old one meets the condition; `None` for an unknown operation.
    fn apply(self, old: u32) -> Option<(u32, bool)> {
        let new = match self.operation {
            0 => self.by,
            1 => old.wrapping_add(self.by),
            2 => old | self.by,
            3 => old & !self.by,
            4 => old ^ self.by,
            _ => return None,
        };
        let order = old.cast_signed().cmp(&self.with);
        let holds = match self.comparison {
            0 => order.is_eq(),
            1 => order.is_ne(),
            2 => order.is_lt(),
            3 => order.is_le(),
            4 => order.is_gt(),
            5 => order.is_ge(),
            _ => return None,
        };
        Some((new, holds))
    }
}

/// The position of `address` in memory that processes share; `None` if the memory belongs to the
/// process alone.
fn shared_key(pid: i32, address: u64) -> Option<FutexKey> {
    let maps = std::fs::read_to_string(format!("/proc/{pid}/maps")).ok()?;
    for line in maps.lines() {
        let mut fields = line.split_ascii_whitespace();
        let (from, to) = fields.next()?.split_once('-')?;
        let number = |text: &str| u64::from_str_radix(text, 16).ok();
        let (from, to) = (number(from)?, number(to)?);
        if !(from..to).contains(&address) {
            continue;
        }
        let is_shared = fields.next()?.ends_with('s');
        let offset = number(fields.next()?)?;
        let (major, minor) = fields.next()?.split_once(':')?;
        let device = (number(major)? << 32) | number(minor)?;
        let file = fields.next()?.parse().ok()?;
        let place = offset + (address - from);
        return is_shared.then_some(FutexKey::Shared(device, file, place));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, MS, Told, error};
    use crate::guest::tests::Room;

    /// futex(2): FUTEX_OP(op, oparg, cmp, cmparg) is op << 28 | cmp << 24 | oparg << 12 | cmparg.
    #[test]
    fn a_change_of_a_word_is_that_of_the_manual() {
        let change = |[operation, by, comparison, with]: [u32; 4], old| {
            let word = operation << 28 | comparison << 24 | (by & 0xFFF) << 12 | (with & 0xFFF);
            Change::of(word).apply(old)
        };
        // Set to 5, as in the lock of old C libraries; was it greater than 1?
        assert_eq!(change([0, 5, 4, 1], 2), Some((5, true)));
        assert_eq!(change([0, 5, 4, 1], 1), Some((5, false)));
        let minus = |number: u32| number.wrapping_neg();
        assert_eq!(
            change([1, minus(1), 2, minus(3)], minus(4)),
            Some((minus(5), true))
        );
        assert_eq!(change([2 | 8, 4, 0, 0], 0), Some((16, true)));
        assert_eq!(change([3, 6, 5, 7], 7), Some((1, true)));
        assert_eq!(change([4, 6, 3, 7], 8), Some((14, false)));
        assert_eq!(change([5, 0, 0, 0], 0), None);
        assert_eq!(change([0, 0, 6, 0], 0), None);
    }

    const PRIVATE: u64 = 128;
    const CALENDAR: u64 = 256;

    fn futex(bench: &mut Bench, args: [u64; 6]) -> Told {
        bench.calls(libc::SYS_futex, &args)
    }

    /// A thread that waits for this word, as the `at`th one.
    fn waits(bench: &mut Bench, tid: i32, word: u64, bits: u32, at: u64) {
        let on = On::Futex(FutexKey::Own(bench.tid, word), bits);
        let wait = Wait { on, deadline: None };
        let own = bench.tid;
        bench.add(tid, own, State::Blocked(wait)).blocked_at = at;
    }

    fn ready(bench: &mut Bench) -> Vec<i32> {
        let queue = core::mem::take(&mut bench.supervisor.queue);
        for tid in &queue {
            let thread = &bench.supervisor.threads[tid];
            assert!(thread.is_woken && matches!(thread.state, State::Ready(Next::Attempt)));
        }
        queue.into()
    }

    /// futex(2): a wait for a word that has changed fails with EAGAIN; a time is relative for
    /// FUTEX_WAIT, and one of a clock for FUTEX_WAIT_BITSET.
    #[test]
    fn a_thread_waits_while_the_word_is_the_same() {
        let mut bench = Bench::new();
        bench.passes(10);
        let tid = bench.tid;
        let word = Room::of_words(&[0x7_0000_0005]);
        let at = word.at(0);
        let key = FutexKey::Own(tid, at);
        let for_ever = Told::Waits(On::Futex(key, ALL), None);
        assert_eq!(futex(&mut bench, [at, PRIVATE, 5, 0, 0, 0]), for_ever);
        assert_eq!(
            futex(&mut bench, [at, PRIVATE, 0x9_0000_0005, 0, 0, 0]),
            for_ever
        );
        assert_eq!(
            futex(&mut bench, [at, 0, 5, 0, 0, 0]),
            for_ever,
            "its own memory"
        );
        assert_eq!(
            futex(&mut bench, [at, PRIVATE, 6, 0, 0, 0]),
            error(Errno::EAGAIN)
        );
        assert_eq!(
            futex(&mut bench, [8, PRIVATE, 6, 0, 0, 0]),
            error(Errno::EFAULT)
        );
        let until = |bits, ms: u64| Told::Waits(On::Futex(key, bits), Some(ms * MS));
        let time = Room::of_words(&[0, 30_000_000]);
        let args = [at, PRIVATE, 5, time.at(0), 0, 3];
        assert_eq!(futex(&mut bench, args), until(ALL, 40));
        bench.passes(29);
        assert_eq!(bench.again(), until(ALL, 40));
        bench.passes(1);
        assert_eq!(bench.again(), error(Errno::ETIMEDOUT));
        time.put(0, &[1_000_u64, 70_000_000].map(u64::to_ne_bytes).concat());
        let args = [at, 9 | PRIVATE, 5, time.at(0), 0, 0x1_0000_0003];
        assert_eq!(futex(&mut bench, args), until(3, 70));
        time.put(0, &1_767_225_600_u64.to_ne_bytes());
        let args = [at, 9 | PRIVATE | CALENDAR, 5, time.at(0), 0, 3];
        assert_eq!(futex(&mut bench, args), until(3, 70));
        time.put(8, &40_000_000_u64.to_ne_bytes());
        assert_eq!(futex(&mut bench, args), error(Errno::ETIMEDOUT));
        time.put(8, &u64::MAX.to_ne_bytes());
        assert_eq!(futex(&mut bench, args), error(Errno::EINVAL));
        // One that was woken goes on, whatever the word is now.
        assert_eq!(futex(&mut bench, [at, PRIVATE, 5, 0, 0, 0]), for_ever);
        bench.thread().is_woken = true;
        word.put(0, &[9]);
        assert_eq!(bench.again(), Told::Answer(0));
        // One that tries again does not look at the word.
        word.put(0, &[5]);
        assert_eq!(futex(&mut bench, [at, PRIVATE, 5, 0, 0, 0]), for_ever);
        bench.thread().state = State::Ready(Next::Attempt);
        word.put(0, &[9]);
        assert_eq!(bench.again(), for_ever);
    }

    /// The oldest waits end first, at most so many; of those for bits only the ones that have some
    /// in common.
    #[test]
    fn waits_end_in_their_order() {
        let mut bench = Bench::new();
        let words = Room::new(16);
        let at = words.at(0);
        let place = |bench: &mut Bench| {
            waits(bench, 1_000_001, at, ALL, 3);
            waits(bench, 1_000_002, at, 0b01, 1);
            waits(bench, 1_000_003, at, 0b10, 2);
            waits(bench, 1_000_004, at + 8, ALL, 0);
        };
        place(&mut bench);
        assert_eq!(
            futex(&mut bench, [at, 1 | PRIVATE, 2, 0, 0, 0]),
            Told::Answer(2)
        );
        assert_eq!(ready(&mut bench), [1_000_002, 1_000_003]);
        assert_eq!(
            futex(&mut bench, [at, 1 | PRIVATE, 2, 0, 0, 0]),
            Told::Answer(1)
        );
        assert_eq!(ready(&mut bench), [1_000_001]);
        place(&mut bench);
        assert_eq!(
            futex(&mut bench, [at, 10 | PRIVATE, 9, 0, 0, 0b10]),
            Told::Answer(2)
        );
        assert_eq!(ready(&mut bench), [1_000_003, 1_000_001]);
        place(&mut bench);
        assert_eq!(
            futex(&mut bench, [at, 1 | PRIVATE, 0, 0, 0, 0]),
            Told::Answer(0)
        );
        let none = u64::from(u32::MAX);
        assert_eq!(
            futex(&mut bench, [at, 1 | PRIVATE, none, 0, 0, 0]),
            Told::Answer(0)
        );
        // The word behind it becomes 1; it was 0, so its threads are woken as well.
        let change = 1 << 12;
        let args = [at, 5 | PRIVATE, 1, 9, at + 8, change];
        assert_eq!(futex(&mut bench, args), Told::Answer(2));
        assert_eq!(ready(&mut bench), [1_000_002, 1_000_004]);
        assert_eq!(words.words(), [0, 1]);
        place(&mut bench);
        assert_eq!(futex(&mut bench, args), Told::Answer(1));
        assert_eq!(ready(&mut bench), [1_000_002]);
        let unknown = [at, 5 | PRIVATE, 1, 9, at + 8, 5 << 28];
        assert_eq!(futex(&mut bench, unknown), error(Errno::ENOSYS));
        assert_eq!(futex(&mut bench, [at, 77, 0, 0, 0, 0]), Told::Kernel);
        assert_eq!(
            bench.supervisor.notes(),
            ["futex operation 77 is done by the kernel"]
        );
    }

    /// FUTEX_REQUEUE: some are woken, some wait for another word from now on, the rest stays.
    #[test]
    fn waits_are_moved_to_another_word() {
        let mut bench = Bench::new();
        let words = Room::of_words(&[5, 0]);
        let [at, other] = [words.at(0), words.at(8)];
        for (order, tid) in (1_000_001..1_000_006).enumerate() {
            waits(&mut bench, tid, at, ALL, order as u64);
        }
        let args = [at, 4 | PRIVATE, 1, 2, other, 4];
        assert_eq!(futex(&mut bench, args), error(Errno::EAGAIN));
        let args = [at, 4 | PRIVATE, 1, 2, other, 5];
        assert_eq!(futex(&mut bench, args), Told::Answer(3));
        assert_eq!(ready(&mut bench), [1_000_001]);
        let key = |at| FutexKey::Own(bench.tid, at);
        let [old, new] = [key(at), key(other)];
        assert_eq!(
            bench.supervisor.futex_waiters(new, ALL),
            [1_000_002, 1_000_003]
        );
        assert_eq!(
            bench.supervisor.futex_waiters(old, ALL),
            [1_000_004, 1_000_005]
        );
        // FUTEX_REQUEUE does not compare.
        let args = [at, 3 | PRIVATE, 0, 1, other, 4];
        assert_eq!(futex(&mut bench, args), Told::Answer(1));
        assert!(ready(&mut bench).is_empty());
        assert_eq!(bench.supervisor.futex_waiters(old, ALL), [1_000_005]);
    }

    /// The kernel clears the word of a thread that ends (CLONE_CHILD_CLEARTID): waits for a word
    /// that is another one now end, oldest first.
    #[test]
    fn after_a_death_waits_for_changed_words_end() {
        let mut bench = Bench::new();
        let own = bench.tid;
        let word = Room::of_words(&[5]);
        let key = FutexKey::Own(own, word.at(0));
        let wait = Wait {
            on: On::Futex(key, ALL),
            deadline: None,
        };
        bench.thread().call = Some(Call::made(libc::SYS_futex, &[word.at(0), PRIVATE, 5]));
        bench.thread().state = State::Blocked(wait);
        bench.supervisor.wake_after_death();
        assert!(ready(&mut bench).is_empty());
        word.put(0, &[4]);
        bench.supervisor.wake_after_death();
        assert_eq!(ready(&mut bench), [own]);
        // Those that hand a lock on are another matter.
        bench.thread().call = Some(Call::made(libc::SYS_futex, &[word.at(0), 6 | PRIVATE, 5]));
        bench.thread().state = State::Blocked(wait);
        word.put(0, &own.to_ne_bytes());
        bench.supervisor.wake_after_death();
        assert!(ready(&mut bench).is_empty());
    }

    #[test]
    fn operations_are_told_without_their_flags() {
        let is_pi = |number, operation| is_pi(&Call::made(number, &[0, operation]));
        for flags in [0, PRIVATE, CALENDAR, PRIVATE | CALENDAR] {
            assert!(is_pi(libc::SYS_futex, 6 | flags) && is_pi(libc::SYS_futex, 13 | flags));
            assert!(!is_pi(libc::SYS_futex, flags) && !is_pi(libc::SYS_futex, 7 | flags));
            assert!(!is_pi(libc::SYS_read, 6 | flags));
        }
        assert_eq!([0, 128, 256, 384, 137].map(command), [0, 0, 0, 0, 9]);
    }

    /// proc(5): a mapping that is shared has an `s`; its file is known by device, number, offset.
    #[test]
    fn shared_memory_is_known_by_its_file() {
        let own = std::process::id().cast_signed();
        let room = Room::new(8);
        assert_eq!(shared_key(own, room.at(0)), None);
        assert_eq!(shared_key(own, 8), None);
        assert_eq!(shared_key(-1, room.at(0)), None);
    }

    /// By hand, with 6 as the old word: 0 sets 3, 1 adds, 2 is `or`, 3 clears, 4 is `xor`. The
    /// conditions from 0 on: equal, not equal, less, at most, greater, at least.
    #[test]
    fn each_operation_and_each_condition_differs() {
        let apply = |operation, comparison, with| {
            let change = Change {
                operation,
                by: 3,
                comparison,
                with,
            };
            change.apply(6)
        };
        for (operation, expected) in [(0, 3), (1, 9), (2, 7), (3, 4), (4, 5)] {
            assert_eq!(apply(operation, 0, 6), Some((expected, true)));
        }
        for (comparison, expected) in [
            (0, [false, true, false]),
            (1, [true, false, true]),
            (2, [true, false, false]),
            (3, [true, true, false]),
            (4, [false, false, true]),
            (5, [false, true, true]),
        ] {
            // 6 is less than 7, equal to 6, and greater than 5.
            let found = [7, 6, 5].map(|with| apply(0, comparison, with));
            assert_eq!(
                found,
                expected.map(|holds| Some((3, holds))),
                "{comparison}"
            );
        }
    }
}
