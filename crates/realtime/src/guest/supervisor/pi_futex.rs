//! Locks with priority inheritance (PTHREAD_PRIO_INHERIT). The word in memory names the owner. The
//! supervisor passes the lock to the oldest waiter, because all threads have the same priority
//! here.

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;

use super::clocks::{low_i32, nanos};
use super::futex::{ALL, command, is_pi};
use super::{Memory, On, Outcome, State, Supervisor, Wait};
use crate::guest::call::Call;
use crate::guest::task::FutexKey;

/// Bits of the word: a thread waits; the owner has ended; the number of the owner.
const WAITERS: u32 = 0x8000_0000;
const OWNER_DIED: u32 = 0x4000_0000;
const OWNER: u32 = 0x3FFF_FFFF;

impl Supervisor {
    /// Handles FUTEX_LOCK_PI, FUTEX_LOCK_PI2 and FUTEX_TRYLOCK_PI.
    pub(super) fn pi_lock(
        &mut self,
        tid: i32,
        call: &Call,
        key: FutexKey,
        waits: bool,
    ) -> Result<Outcome, Errno> {
        let [address, operation, _, timeout, ..] = call.args;
        let thread = self.threads.get(&tid).ok_or(Errno::ESRCH)?;
        if thread.is_woken {
            return Ok(Outcome::Answer(0));
        }
        let memory = Memory(Pid::from_raw(tid));
        let word = memory.u32(address)?;
        let owner = (word & OWNER).cast_signed();
        if owner == 0 {
            self.pi_give(key, tid, address, word & OWNER_DIED)?;
            return Ok(Outcome::Answer(0));
        }
        if owner == tid {
            return Err(Errno::EDEADLK);
        }
        if !self.threads.contains_key(&owner) {
            return Err(Errno::ESRCH);
        }
        if !waits {
            return Err(Errno::EAGAIN);
        }
        let operation = low_i32(operation);
        let is_first = command(operation) == libc::FUTEX_LOCK_PI;
        let is_calendar = is_first || operation & libc::FUTEX_CLOCK_REALTIME != 0;
        let deadline = match timeout {
            0 => None,
            timeout => {
                let at = nanos(memory.pair(timeout)?)?;
                Some(Self::instant_of(i64::from(!is_calendar), at))
            }
        };
        if deadline.is_some_and(|at| self.stage.now() >= at) {
            return Err(Errno::ETIMEDOUT);
        }
        memory.write(address, &(word | WAITERS).to_ne_bytes())?;
        Ok(Outcome::Block(Wait {
            on: On::Futex(key, ALL),
            deadline,
        }))
    }

    /// Handles FUTEX_UNLOCK_PI.
    pub(super) fn pi_unlock(
        &mut self,
        tid: i32,
        call: &Call,
        key: FutexKey,
    ) -> Result<Outcome, Errno> {
        let address = call.args[0];
        let memory = Memory(Pid::from_raw(tid));
        if (memory.u32(address)? & OWNER).cast_signed() != tid {
            return Err(Errno::EPERM);
        }
        match self.futex_waiters(key, ALL).first() {
            Some(&next) => self.pi_hand_on(key, next, 0)?,
            None => memory.write(address, &0_u32.to_ne_bytes())?,
        }
        Ok(Outcome::Answer(0))
    }

    /// Gives the lock to `tid`.
    fn pi_give(&self, key: FutexKey, tid: i32, address: u64, more: u32) -> Result<(), Errno> {
        let waiters = self.futex_waiters(key, ALL);
        let others = waiters.iter().any(|&waiter| waiter != tid);
        let word = tid.cast_unsigned() | more | if others { WAITERS } else { 0 };
        Memory(Pid::from_raw(tid)).write(address, &word.to_ne_bytes())
    }

    /// Gives the lock to `next`, which has waited for it.
    fn pi_hand_on(&mut self, key: FutexKey, next: i32, more: u32) -> Result<(), Errno> {
        let call = self.threads.get(&next).and_then(|thread| thread.call);
        let address = call.ok_or(Errno::ESRCH)?.args[0];
        self.pi_give(key, next, address, more)?;
        self.wake(next);
        Ok(())
    }

    /// Gives the locks of an ended thread to the oldest threads that wait for them.
    pub(super) fn pi_after_death(&mut self) {
        let mut waiters: Vec<(u64, i32, FutexKey)> = Vec::new();
        for thread in self.threads.values() {
            if let State::Blocked(Wait {
                on: On::Futex(key, _),
                ..
            }) = thread.state
                && thread.call.is_some_and(|call| is_pi(&call))
            {
                waiters.push((thread.blocked_at, thread.tid.as_raw(), key));
            }
        }
        waiters.sort_unstable_by_key(|&(at, ..)| at);
        let mut given: Vec<FutexKey> = Vec::new();
        for (_, tid, key) in waiters {
            let call = self.threads.get(&tid).and_then(|thread| thread.call);
            let word = call.map(|call| Memory(Pid::from_raw(tid)).u32(call.args[0]));
            let Some(Ok(word)) = word else { continue };
            let owner = (word & OWNER).cast_signed();
            let is_gone = owner == 0 || !self.threads.contains_key(&owner);
            if is_gone && !given.contains(&key) && self.pi_hand_on(key, tid, OWNER_DIED).is_ok() {
                given.push(key);
            }
        }
    }
}
