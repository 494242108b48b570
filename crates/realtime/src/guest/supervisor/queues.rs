//! Queues and semaphores of POSIX and System V. Those of POSIX are files. For those of System V,
//! the supervisor makes the kernel's call without waiting, and again when one of them may have
//! changed.

use nix::errno::Errno;
use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;
use rustix::event::PollFlags;

use super::clocks::{low_i32, nanos};
use super::{Memory, On, Outcome, Supervisor, Wait, is_death};
use crate::guest::call::Call;

/// Length of an operation on a semaphore, offset of its flags, and maximum number of operations in
/// a call.
const OPERATION: usize = 6;
const FLAGS: usize = 4;
const OPERATIONS_MAX: u64 = 500;
const NO_WAIT: u16 = 0o4000;

/// The change that makes a call return without waiting: of an argument, or of operations in memory.
enum Asked {
    Argument(usize, u64),
    Operations(u64, Vec<u8>),
}

impl Supervisor {
    /// Handles mq_timedsend and mq_timedreceive.
    pub(super) fn message(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [fd, _, _, _, timeout, _] = call.args;
        let Some(file) = self.file(tid, low_i32(fd)) else {
            return Ok(Outcome::Kernel);
        };
        let wanted = match call.number {
            libc::SYS_mq_timedsend => PollFlags::OUT,
            _ => PollFlags::IN,
        };
        if file.never_waits() || !file.readiness(wanted).is_empty() {
            // A process may have requested a signal (mq_notify).
            self.is_signalled |= call.number == libc::SYS_mq_timedsend;
            return Ok(Outcome::Kernel);
        }
        let deadline = match timeout {
            0 => None,
            timeout => {
                let at = nanos(Memory(Pid::from_raw(tid)).pair(timeout)?)?;
                Some(Self::instant_of(libc::CLOCK_REALTIME.into(), at))
            }
        };
        if deadline.is_some_and(|at| self.stage.now() >= at) {
            return Err(Errno::ETIMEDOUT);
        }
        Ok(Outcome::Block(Wait {
            on: On::Files,
            deadline,
        }))
    }

    /// Handles msgsnd, msgrcv, semop and semtimedop.
    pub(super) fn queue(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let deadline = match call.number {
            libc::SYS_semtimedop => self.timespec_from(tid, call.args[3], 1)?,
            _ => None,
        };
        let has_waited = self
            .threads
            .get(&tid)
            .is_some_and(|thread| thread.is_at_end);
        let Some(asked) = self.ask_not_to_wait(tid, call)? else {
            return Ok(Outcome::Kernel);
        };
        let pid = Pid::from_raw(tid);
        let end = ptrace::syscall(pid, None)
            .ok()
            .and_then(|()| self.wait_for(tid));
        let Some((_, status)) = end else {
            return Ok(Outcome::Kernel);
        };
        if is_death(status) {
            self.died(tid, status);
            return Ok(Outcome::Kernel);
        }
        let end = Call::of(pid)?;
        let would_wait = match call.number {
            libc::SYS_msgrcv => Errno::ENOMSG,
            _ => Errno::EAGAIN,
        };
        let waits = end.result() == -i64::from(would_wait as i32);
        let is_time_up = deadline.is_some_and(|at| self.stage.now() >= at);
        let (index, value) = match &asked {
            Asked::Argument(index, value) => (*index, *value),
            Asked::Operations(place, operations) => {
                Memory(pid).write(*place, operations)?;
                (1, *place)
            }
        };
        if !waits || is_time_up {
            self.set_at_end(tid, false);
            self.has_queues_changed = true;
            // The queue was removed while the thread waited for it.
            let result = match end.result() == -i64::from(Errno::EINVAL as i32) && has_waited {
                true => -i64::from(Errno::EIDRM as i32),
                false => end.result(),
            };
            // The program's thread continues from here; its changed arguments are restored.
            end.with_result(pid, index, value, result)?;
            return Ok(Outcome::Kernel);
        }
        end.with_result_again(pid, index, value, call.number)?;
        self.set_at_end(tid, true);
        Ok(Outcome::Block(Wait {
            on: On::Queue,
            deadline,
        }))
    }

    /// Changes the call of a thread so that it does not wait; returns the original. `None` if the
    /// call does not wait anyway.
    fn ask_not_to_wait(&mut self, tid: i32, call: &Call) -> Result<Option<Asked>, Errno> {
        let pid = Pid::from_raw(tid);
        if self
            .threads
            .get(&tid)
            .is_some_and(|thread| thread.is_at_end)
        {
            self.set_at_end(tid, false);
            // The thread makes the call again, up to its stop by the filter. No signal that comes
            // before this has a handler.
            loop {
                ptrace::cont(pid, None)?;
                match self.wait_for(tid) {
                    Some((_, status)) if is_death(status) => {
                        self.died(tid, status);
                        return Ok(None);
                    }
                    Some((_, status)) if status >> 16 == libc::PTRACE_EVENT_SECCOMP => break,
                    Some((_, status)) if status >> 16 == 0 => {}
                    _ => return Ok(None),
                }
            }
        }
        let now = Call::of(pid)?;
        let [_, operations, count, fourth, fifth, _] = call.args;
        let no_wait = u64::from(NO_WAIT);
        let (index, flags) = match call.number {
            libc::SYS_msgsnd => (3, fourth),
            libc::SYS_msgrcv => (4, fifth),
            _ => {
                if count > OPERATIONS_MAX {
                    return Ok(None);
                }
                let mut before = vec![0; OPERATION * usize::try_from(count).unwrap_or(0)];
                Memory(pid).read(operations, &mut before)?;
                let mut after = before.clone();
                let mut waits = false;
                for operation in after.chunks_exact_mut(OPERATION) {
                    let flags = u16::from_ne_bytes([operation[FLAGS], operation[FLAGS + 1]]);
                    waits |= flags & NO_WAIT == 0;
                    operation[FLAGS..].copy_from_slice(&(flags | NO_WAIT).to_ne_bytes());
                }
                if !waits {
                    return Ok(None);
                }
                Memory(pid).write(operations, &after)?;
                return Ok(Some(Asked::Operations(operations, before)));
            }
        };
        if flags & no_wait != 0 {
            return Ok(None);
        }
        now.with(pid, index, flags | no_wait)?;
        Ok(Some(Asked::Argument(index, flags)))
    }
}
