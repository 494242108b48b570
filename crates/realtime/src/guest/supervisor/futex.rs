//! Words in memory on which threads wait for each other: the order of wake-ups is the supervisor's.

use core::time::Duration;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;

use super::clocks::{low_i32, nanos};
use super::{Memory, Next, On, Outcome, State, Supervisor, Wait};
use crate::guest::call::Call;
use crate::guest::task::FutexKey;

pub(super) const ALL: u32 = u32::MAX;

/// Whether a futex's operation is of such a lock.
pub(super) fn is_pi(call: &Call) -> bool {
    let command = command(low_i32(call.args[1]));
    call.number == libc::SYS_futex && matches!(command, libc::FUTEX_LOCK_PI | libc::FUTEX_LOCK_PI2)
}

/// What is to be done, without the flags.
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
            libc::FUTEX_WAKE => Ok(self.futex_wake(key, count, ALL)),
            libc::FUTEX_WAKE_BITSET => {
                let [.., bits] = call.args;
                let [a, b, c, d, ..] = bits.to_le_bytes();
                Ok(self.futex_wake(key, count, u32::from_le_bytes([a, b, c, d])))
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

    fn futex_wake(&mut self, key: FutexKey, most: usize, bits: u32) -> Outcome {
        let waiters = self.futex_waiters(key, bits);
        let woken = waiters.into_iter().take(most);
        let mut count = 0;
        for tid in woken {
            self.wake(tid);
            count += 1;
        }
        Outcome::Answer(count)
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

    /// A thread has ended: the kernel has cleared its word and woken the threads that waited for
    /// it.
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

/// The place of `address` in memory that is shared with others; `None` if it is the process's own.
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
