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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, MS, Told, error};
    use crate::guest::tests::Room;

    const PRIVATE: u64 = 128;
    const LOCK: u64 = 6 | PRIVATE;
    const UNLOCK: u64 = 7 | PRIVATE;
    const TRYLOCK: u64 = 8 | PRIVATE;
    const LOCK2: u64 = 13 | PRIVATE;

    fn futex(bench: &mut Bench, args: [u64; 4]) -> Told {
        bench.calls(libc::SYS_futex, &args)
    }

    fn word(room: &Room) -> u32 {
        room.numbers()[0].cast_unsigned()
    }

    /// futex(2), priority inheritance: the word is 0 or its owner's number; the highest bit tells
    /// of waiters, the next one of an owner that has ended.
    #[test]
    fn a_free_lock_is_taken_and_given_back() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let room = Room::new(4);
        for operation in [LOCK, LOCK2, TRYLOCK] {
            room.put(0, &[0; 4]);
            assert_eq!(
                futex(&mut bench, [room.at(0), operation, 0, 0]),
                Told::Answer(0)
            );
            assert_eq!(word(&room), tid.cast_unsigned());
            let told = futex(&mut bench, [room.at(0), operation, 0, 0]);
            assert_eq!(told, error(Errno::EDEADLK));
            assert_eq!(
                futex(&mut bench, [room.at(0), UNLOCK, 0, 0]),
                Told::Answer(0)
            );
            assert_eq!(word(&room), 0);
            let told = futex(&mut bench, [room.at(0), UNLOCK, 0, 0]);
            assert_eq!(told, error(Errno::EPERM));
        }
        room.put(0, &OWNER_DIED.to_ne_bytes());
        assert_eq!(futex(&mut bench, [room.at(0), LOCK, 0, 0]), Told::Answer(0));
        assert_eq!(word(&room), tid.cast_unsigned() | OWNER_DIED);
    }

    #[test]
    fn a_lock_of_another_thread_is_waited_for() {
        let mut bench = Bench::new();
        bench.passes(10);
        let tid = bench.tid;
        let room = Room::of(&1_000_001_u32.to_ne_bytes());
        let at = room.at(0);
        assert_eq!(futex(&mut bench, [at, LOCK, 0, 0]), error(Errno::ESRCH));
        bench.add(1_000_001, tid, State::Running);
        assert_eq!(futex(&mut bench, [at, TRYLOCK, 0, 0]), error(Errno::EAGAIN));
        let key = FutexKey::Own(tid, at);
        let waits =
            |until_ms: Option<u64>| Told::Waits(On::Futex(key, ALL), until_ms.map(|ms| ms * MS));
        assert_eq!(futex(&mut bench, [at, LOCK, 0, 0]), waits(None));
        assert_eq!(word(&room), 1_000_001 | WAITERS);
        let time = Room::of_words(&[1_767_225_600, 40_000_000]);
        assert_eq!(
            futex(&mut bench, [at, LOCK, 0, time.at(0)]),
            waits(Some(40))
        );
        assert_eq!(
            futex(&mut bench, [at, LOCK2 | 256, 0, time.at(0)]),
            waits(Some(40))
        );
        time.put(0, &1_000_u64.to_ne_bytes());
        assert_eq!(
            futex(&mut bench, [at, LOCK2, 0, time.at(0)]),
            waits(Some(40))
        );
        time.put(8, &10_000_000_u64.to_ne_bytes());
        let told = futex(&mut bench, [at, LOCK2, 0, time.at(0)]);
        assert_eq!(told, error(Errno::ETIMEDOUT));
        bench.thread().is_woken = true;
        assert_eq!(bench.again(), Told::Answer(0));
    }

    /// The kernel hands a lock on to the thread that waits longest.
    #[test]
    fn a_lock_is_handed_on() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let room = Room::of(&tid.to_ne_bytes());
        let at = room.at(0);
        // This process itself is the one that waits: its memory is written.
        let key = FutexKey::Own(tid, at);
        let wait = |on| State::Blocked(Wait { on, deadline: None });
        bench.begins(libc::SYS_futex, &[at, LOCK, 0, 0]);
        bench.thread().state = wait(On::Futex(key, ALL));
        let call = Call::made(libc::SYS_futex, &[at, UNLOCK]);
        let told = bench.supervisor.pi_unlock(tid, &call, key).map(Told::from);
        assert_eq!(told, Ok(Told::Answer(0)));
        assert_eq!(word(&room), tid.cast_unsigned());
        assert!(bench.thread().is_woken);
        // With another one behind it.
        bench.thread().state = wait(On::Futex(key, ALL));
        bench.thread().blocked_at = 1;
        bench
            .add(1_000_001, tid, wait(On::Futex(key, ALL)))
            .blocked_at = 2;
        let told = bench.supervisor.pi_unlock(tid, &call, key).map(Told::from);
        assert_eq!(told, Ok(Told::Answer(0)));
        assert_eq!(word(&room), tid.cast_unsigned() | WAITERS);
    }

    #[test]
    fn the_lock_of_a_dead_thread_goes_to_the_oldest_wait() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let room = Room::of(&(1_000_009_u32 | WAITERS).to_ne_bytes());
        let key = FutexKey::Own(tid, room.at(0));
        bench.begins(libc::SYS_futex, &[room.at(0), LOCK, 0, 0]);
        let wait = State::Blocked(Wait {
            on: On::Futex(key, ALL),
            deadline: None,
        });
        bench.thread().state = wait;
        bench.add(1_000_009, tid, State::Running);
        bench.supervisor.pi_after_death();
        assert_eq!(word(&room), 1_000_009 | WAITERS, "its owner lives");
        bench.supervisor.threads.remove(&1_000_009);
        bench.supervisor.pi_after_death();
        assert_eq!(word(&room), tid.cast_unsigned() | OWNER_DIED);
        assert!(bench.thread().is_woken);
        // A lock without an owner is given as well.
        bench.thread().is_woken = false;
        bench.thread().state = wait;
        room.put(0, &[0; 4]);
        bench.supervisor.pi_after_death();
        assert_eq!(word(&room), tid.cast_unsigned() | OWNER_DIED);
        // A plain wait is none for a lock.
        bench.begins(libc::SYS_futex, &[room.at(0), PRIVATE, 0, 0]);
        bench.thread().state = wait;
        room.put(0, &[0; 4]);
        bench.supervisor.pi_after_death();
        assert_eq!(word(&room), 0);
    }
}
