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

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::Write as _;
    use std::os::fd::OwnedFd;

    use rustix::io::ioctl_fionbio;

    use super::*;
    use crate::guest::supervisor::State;
    use crate::guest::supervisor::tests::{Bench, MS, Told, error, fd};
    use crate::guest::tests::{Room, Stopped};

    /// A process that stops at its calls about queues and semaphores of System V.
    struct Caller {
        bench: Bench,
        process: Stopped,
        /// Memory below its stack.
        place: u64,
        /// Address of the instruction of its call.
        at: u64,
    }

    impl Caller {
        fn new() -> Self {
            let process = Stopped::that_calls();
            // Where the system allows it, queues that a failed test leaves disappear with the
            // process: CLONE_NEWUSER and CLONE_NEWIPC.
            process.makes(libc::SYS_unshare, &[0x1000_0000 | 0x0800_0000]);
            process.filters(&[
                libc::SYS_msgsnd,
                libc::SYS_msgrcv,
                libc::SYS_semop,
                libc::SYS_semtimedop,
            ]);
            let mut bench = Bench::new();
            let tid = process.pid.as_raw();
            bench.add(tid, tid, State::Running);
            let place = process.registers().rsp - 8_192;
            Self {
                bench,
                process,
                place,
                at: 0,
            }
        }

        fn begins(&mut self, number: i64, args: &[u64]) -> Told {
            self.at = self.process.begins(number, args);
            self.bench.supervisor.has_queues_changed = false;
            let now = self.bench.supervisor.stage.now();
            let thread = self.bench.supervisor.threads.get_mut(&self.tid());
            let thread = thread.expect("added");
            (thread.is_at_end, thread.entered) = (false, now);
            thread.call = Some(Call::of(self.process.pid).expect("it stands"));
            self.again()
        }

        fn again(&mut self) -> Told {
            let (tid, thread) = (self.tid(), &self.bench.supervisor.threads[&self.tid()]);
            let call = thread.call.expect("begun");
            let outcome = self.bench.supervisor.queue(tid, &call);
            outcome.map_or_else(error, Told::from)
        }

        fn tid(&self) -> i32 {
            self.process.pid.as_raw()
        }

        /// It has left its call with this result.
        fn is_done(&self, result: i64) {
            let registers = self.process.registers();
            let found = (registers.rax.cast_signed(), registers.rip);
            assert_eq!(found, (result, self.at + 2));
            assert!(!self.bench.supervisor.threads[&self.tid()].is_at_end);
            assert!(self.bench.supervisor.has_queues_changed);
        }

        /// It will make its call again.
        fn repeats(&self, number: i64) {
            let registers = self.process.registers();
            let found = (registers.rax.cast_signed(), registers.rip);
            assert_eq!(found, (number, self.at));
            assert!(self.bench.supervisor.threads[&self.tid()].is_at_end);
            assert!(!self.bench.supervisor.has_queues_changed);
        }

        /// The kernel still has to execute its call.
        fn is_left_to_the_kernel(&self, result: i64) {
            assert!(!self.bench.supervisor.has_queues_changed);
            assert_eq!(self.process.ends_call(), result);
        }
    }

    const FOR_EVER: Told = Told::Waits(On::Queue, None);

    /// A message of type 1 with eight bytes. ENOMSG 42, EIDRM 43, EINVAL 22 (linux/errno.h);
    /// IPC_NOWAIT 0o4000 and MSG_NOERROR 0o10000 (linux/ipc.h, linux/msg.h).
    #[test]
    fn a_thread_waits_for_a_message_and_for_room() {
        let mut it = Caller::new();
        let (place, queue) = (it.place, it.process.makes(libc::SYS_msgget, &[0, 0o600]));
        let queue = queue.cast_unsigned();
        let memory = Memory(it.process.pid);
        let takes = [queue, place, 8, 0, 0o10_000];
        let message = [1_u64.to_ne_bytes(), *b"distance"];
        for _ in 0..2 {
            assert_eq!(it.begins(libc::SYS_msgrcv, &takes), FOR_EVER);
            it.repeats(libc::SYS_msgrcv);
            assert_eq!(it.process.registers().r8, 0o10_000);
            // A signal that does nothing, SIGWINCH, comes before it.
            let winch = nix::sys::signal::Signal::SIGWINCH;
            nix::sys::signal::kill(it.process.pid, winch).expect("ours");
            assert_eq!(it.again(), FOR_EVER);
            it.repeats(libc::SYS_msgrcv);
            memory.write(place, message.as_flattened()).expect("stack");
            let sends = [queue, place, 8, 0];
            assert_eq!(it.process.makes(libc::SYS_msgsnd, &sends), 0);
            memory.write(place, &[0; 16]).expect("stack");
            assert_eq!(it.again(), Told::Kernel);
            it.is_done(8);
            assert_eq!(it.process.registers().r8, 0o10_000);
            assert_eq!(memory.u64(place + 8), Ok(u64::from_ne_bytes(*b"distance")));
        }
        assert_eq!(
            it.begins(libc::SYS_msgsnd, &[queue, place, 8, 0o10_000]),
            Told::Kernel
        );
        it.is_done(0);
        assert_eq!(it.process.registers().r10, 0o10_000);
        // One that does not wait is a matter of the kernel.
        let takes_now = [queue, place, 8, 0, 0o4_000];
        assert_eq!(it.begins(libc::SYS_msgrcv, &takes_now), Told::Kernel);
        it.is_left_to_the_kernel(8);
        assert_eq!(it.begins(libc::SYS_msgrcv, &takes_now), Told::Kernel);
        it.is_left_to_the_kernel(-42);
        // msgctl with IPC_RMID.
        assert_eq!(it.begins(libc::SYS_msgrcv, &takes), FOR_EVER);
        assert_eq!(it.process.makes(libc::SYS_msgctl, &[queue, 0]), 0);
        assert_eq!(it.again(), Told::Kernel);
        it.is_done(-43);
        assert_eq!(it.begins(libc::SYS_msgrcv, &takes), Told::Kernel);
        it.is_done(-22);
    }

    /// An operation: number of the semaphore, change, flags, 16 bits each.
    fn operation(change: i16, flags: u16) -> [u8; 6] {
        let ([a, b], [c, d]) = (change.to_ne_bytes(), flags.to_ne_bytes());
        [0, 0, a, b, c, d]
    }

    /// EAGAIN 11, E2BIG 7, EFAULT 14; semctl with SETVAL 16 and IPC_RMID 0.
    #[test]
    fn a_thread_waits_for_a_semaphore() {
        let mut it = Caller::new();
        let set = it.process.makes(libc::SYS_semget, &[0, 1, 0o600]);
        let set = set.cast_unsigned();
        let (place, memory) = (it.place, Memory(it.process.pid));
        let holds = |bytes: &[u8]| {
            let mut found = vec![0; bytes.len()];
            memory.read(place, &mut found).expect("its stack");
            assert_eq!(found, bytes);
        };
        // SEM_UNDO stays, too.
        let take = operation(-1, 0o10_000);
        memory.write(place, &take).expect("its stack");
        assert_eq!(it.begins(libc::SYS_semop, &[set, place, 1]), FOR_EVER);
        it.repeats(libc::SYS_semop);
        assert_eq!(it.process.registers().rsi, place);
        holds(&take);
        assert_eq!(it.again(), FOR_EVER);
        assert_eq!(it.process.makes(libc::SYS_semctl, &[set, 0, 16, 1]), 0);
        assert_eq!(it.again(), Told::Kernel);
        it.is_done(0);
        holds(&take);
        // 5 ms, and nothing comes.
        let five = [0, 5 * MS].map(u64::to_ne_bytes);
        memory
            .write(place + 64, five.as_flattened())
            .expect("stack");
        let timed = [set, place, 1, place + 64];
        let until = Told::Waits(On::Queue, Some(5 * MS));
        assert_eq!(it.begins(libc::SYS_semtimedop, &timed), until);
        it.bench.passes(4);
        assert_eq!(it.again(), until);
        it.repeats(libc::SYS_semtimedop);
        it.bench.passes(1);
        assert_eq!(it.again(), Told::Kernel);
        it.is_done(-11);
        // The timeout is not looked at without a wait in time.
        assert_eq!(it.begins(libc::SYS_semop, &timed), FOR_EVER);
        // One of two waits.
        let two = [operation(-1, NO_WAIT), operation(-1, 0)];
        memory.write(place, two.as_flattened()).expect("its stack");
        assert_eq!(it.begins(libc::SYS_semop, &[set, place, 2]), FOR_EVER);
        holds(two.as_flattened());
        let two = [operation(-1, NO_WAIT), operation(-1, NO_WAIT | 0o10_000)];
        memory.write(place, two.as_flattened()).expect("its stack");
        assert_eq!(it.begins(libc::SYS_semop, &[set, place, 2]), Told::Kernel);
        it.is_left_to_the_kernel(-11);
        holds(two.as_flattened());
        // 500 operations are the kernel's limit (semctl(2), SEMOPM): each waits for 0, which it is.
        memory
            .write(place, &operation(0, 0).repeat(500))
            .expect("its stack");
        assert_eq!(it.begins(libc::SYS_semop, &[set, place, 500]), Told::Kernel);
        it.is_done(0);
        assert_eq!(it.begins(libc::SYS_semop, &[set, place, 501]), Told::Kernel);
        it.is_left_to_the_kernel(-7);
        assert_eq!(
            it.begins(libc::SYS_semop, &[set, 8, 1]),
            error(Errno::EFAULT)
        );
        it.is_left_to_the_kernel(-14);
        assert_eq!(it.process.makes(libc::SYS_semctl, &[set, 0, 0]), 0);
    }

    /// A queue of POSIX is a file; here, a pipe. CLOCK_REALTIME begins with 2026.
    #[test]
    fn a_message_of_posix_is_a_matter_of_its_file() {
        let mut bench = Bench::new();
        let (reader, mut writer) = std::io::pipe().expect("the system has pipes");
        let at_five = Room::of_words(&[1_767_225_600, 5 * MS]);
        let takes = [fd(&reader), 0, 0, 0, 0];
        let takes_until = [fd(&reader), 0, 0, 0, at_five.at(0)];
        let calls = |bench: &mut Bench, number, args: &[u64; 5]| {
            bench.supervisor.is_signalled = false;
            let told = bench.calls(number, args);
            (told, bench.supervisor.is_signalled)
        };
        let (receive, send) = (libc::SYS_mq_timedreceive, libc::SYS_mq_timedsend);
        let waits = |deadline| (Told::Waits(On::Files, deadline), false);
        assert_eq!(calls(&mut bench, receive, &takes), waits(None));
        let until = waits(Some(5 * MS));
        assert_eq!(calls(&mut bench, receive, &takes_until), until);
        bench.passes(4);
        assert_eq!(calls(&mut bench, receive, &takes_until), until);
        bench.passes(1);
        let late = (error(Errno::ETIMEDOUT), false);
        assert_eq!(calls(&mut bench, receive, &takes_until), late);
        let bad = [fd(&reader), 0, 0, 0, 8];
        let fault = (error(Errno::EFAULT), false);
        assert_eq!(calls(&mut bench, receive, &bad), fault);
        // The sender may have requested a signal for others.
        let sends = [fd(&writer), 0, 0, 0, 0];
        assert_eq!(calls(&mut bench, send, &sends), (Told::Kernel, true));
        writer.write_all(b"x").expect("it has room");
        assert_eq!(calls(&mut bench, receive, &takes), (Told::Kernel, false));
        assert_eq!(calls(&mut bench, receive, &[999; 5]), (Told::Kernel, false));
        let (other, _writer) = std::io::pipe().expect("the system has pipes");
        ioctl_fionbio(&other, true).expect("it is open");
        let hasty = [fd(&other), 0, 0, 0, 0];
        assert_eq!(calls(&mut bench, receive, &hasty), (Told::Kernel, false));
        drop(File::from(OwnedFd::from(reader)));
    }
}
