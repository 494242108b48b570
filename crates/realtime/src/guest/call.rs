//! A system call at which a thread has stopped: its number, its arguments, and how the thread
//! continues.

use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;

/// The futex calls of Linux 6.7, which `libc` does not know.
pub(super) const FUTEX_WAKE: i64 = 454;
pub(super) const FUTEX_WAIT: i64 = 455;
pub(super) const FUTEX_REQUEUE: i64 = 456;

/// Length of the instruction that makes a system call.
pub(super) const INSTRUCTION: u64 = 2;

/// The instructions that read the processor's counter.
pub(super) const RDTSC: [u8; 2] = [0x0F, 0x31];
pub(super) const RDTSCP: [u8; 3] = [0x0F, 0x01, 0xF9];

/// A system call at which a thread has stopped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Call {
    /// Its number.
    pub(super) number: i64,
    /// Its arguments.
    pub(super) args: [u64; 6],
    registers: libc::user_regs_struct,
}

impl Call {
    /// The call at which the thread `tid` has stopped.
    pub(super) fn of(tid: Pid) -> nix::Result<Self> {
        let registers = ptrace::getregs(tid)?;
        Ok(Self {
            number: registers.orig_rax.cast_signed(),
            args: [
                registers.rdi,
                registers.rsi,
                registers.rdx,
                registers.r10,
                registers.r8,
                registers.r9,
            ],
            registers,
        })
    }

    /// Hides that the thread runs in single steps: the call instruction has stored the flags, with
    /// the trap flag, in `r11` (Intel's manual, volume 2, SYSCALL).
    pub(super) fn hide_step(&mut self, tid: Pid) {
        if hide_trap_flag(&mut self.registers) {
            let _ = ptrace::setregs(tid, self.registers);
        }
    }

    /// The kernel's result; valid only at the end of the call.
    pub(super) const fn result(&self) -> i64 {
        self.registers.rax.cast_signed()
    }

    /// Skips the call in the kernel, and gives `result` to the program.
    pub(super) fn answer(&self, tid: Pid, result: i64) -> nix::Result<()> {
        let mut registers = self.registers;
        registers.orig_rax = u64::MAX;
        registers.rax = result.cast_unsigned();
        ptrace::setregs(tid, registers)
    }

    /// Lets the kernel execute the call with `value` as its argument `index`, 0 to 4.
    pub(super) fn with(&self, tid: Pid, index: usize, value: u64) -> nix::Result<()> {
        let mut registers = self.registers;
        match index {
            0 => registers.rdi = value,
            1 => registers.rsi = value,
            2 => registers.rdx = value,
            3 => registers.r10 = value,
            _ => registers.r8 = value,
        }
        ptrace::setregs(tid, registers)
    }

    /// Skips the call in the kernel for now. The thread makes the same call again when it
    /// continues.
    pub(super) fn again(&self, tid: Pid) -> nix::Result<()> {
        let mut registers = self.registers;
        registers.rip -= INSTRUCTION;
        registers.rax = registers.orig_rax;
        registers.orig_rax = u64::MAX;
        ptrace::setregs(tid, registers)
    }

    /// At the end of a call: restores the argument `index` to `value`, and gives `result` to the
    /// program.
    pub(super) fn with_result(
        &self,
        tid: Pid,
        index: usize,
        value: u64,
        result: i64,
    ) -> nix::Result<()> {
        let mut end = *self;
        end.registers.rax = result.cast_unsigned();
        end.with(tid, index, value)
    }

    /// At the end of a call: restores the argument `index`, and lets the thread make the call again
    /// when it continues.
    pub(super) fn with_result_again(
        &self,
        tid: Pid,
        index: usize,
        value: u64,
        number: i64,
    ) -> nix::Result<()> {
        let mut end = *self;
        end.registers.rip -= INSTRUCTION;
        end.with_result(tid, index, value, number)
    }

    /// At the end of a call that was to be made again: lets it fail with EINTR instead.
    pub(super) fn interrupted_at_end(&self, tid: Pid) -> nix::Result<()> {
        let mut registers = self.registers;
        registers.rip += INSTRUCTION;
        registers.rax = (-i64::from(libc::EINTR)).cast_unsigned();
        ptrace::setregs(tid, registers)
    }

    /// After our stop has cut short a wait in the kernel: lets the thread make the call again, if
    /// the kernel would not do this by itself.
    pub(super) fn again_if_cut_short(&self, tid: Pid) {
        if self.number >= 0 && self.result() == -i64::from(libc::EINTR) {
            let _ = self.again(tid);
        }
    }

    /// Whether it is the same call as `other`: number and arguments.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        self.number == other.number && self.args == other.args
    }

    /// All registers of the thread at the call.
    pub(super) const fn registers(&self) -> libc::user_regs_struct {
        self.registers
    }

    /// Address of the thread's next instruction.
    pub(super) const fn instruction(&self) -> u64 {
        self.registers.rip
    }

    /// Moves the thread past an instruction of `len` bytes that reads the processor's counter, with
    /// `count` as the value that it read.
    pub(super) fn has_read_counter(&self, tid: Pid, len: u64, count: u64) -> nix::Result<()> {
        let mut registers = self.registers;
        registers.rip += len;
        registers.rax = count & 0xFFFF_FFFF;
        registers.rdx = count >> 32;
        if len == RDTSCP.len() as u64 {
            // The processor's number.
            registers.rcx = 0;
        }
        ptrace::setregs(tid, registers)
    }

    /// Value of the stack pointer at the call.
    pub(super) const fn stack(&self) -> u64 {
        self.registers.rsp
    }
}

/// Names of the calls that users see in messages.
const NAMES: &[(i64, &str)] = &[
    (libc::SYS_read, "read"),
    (libc::SYS_write, "write"),
    (libc::SYS_readv, "readv"),
    (libc::SYS_writev, "writev"),
    (libc::SYS_open, "open"),
    (libc::SYS_openat, "openat"),
    (libc::SYS_poll, "poll"),
    (libc::SYS_ppoll, "ppoll"),
    (libc::SYS_select, "select"),
    (libc::SYS_pselect6, "pselect6"),
    (libc::SYS_epoll_wait, "epoll_wait"),
    (libc::SYS_epoll_pwait, "epoll_pwait"),
    (libc::SYS_epoll_pwait2, "epoll_pwait2"),
    (libc::SYS_ioctl, "ioctl"),
    (libc::SYS_futex, "futex"),
    (libc::SYS_futex_waitv, "futex_waitv"),
    (FUTEX_WAKE, "futex_wake"),
    (FUTEX_WAIT, "futex_wait"),
    (FUTEX_REQUEUE, "futex_requeue"),
    (libc::SYS_pidfd_send_signal, "pidfd_send_signal"),
    (libc::SYS_nanosleep, "nanosleep"),
    (libc::SYS_clock_nanosleep, "clock_nanosleep"),
    (libc::SYS_clock_gettime, "clock_gettime"),
    (libc::SYS_clock_getres, "clock_getres"),
    (libc::SYS_clock_settime, "clock_settime"),
    (libc::SYS_gettimeofday, "gettimeofday"),
    (libc::SYS_time, "time"),
    (libc::SYS_times, "times"),
    (libc::SYS_sched_yield, "sched_yield"),
    (libc::SYS_wait4, "wait4"),
    (libc::SYS_waitid, "waitid"),
    (libc::SYS_exit, "exit"),
    (libc::SYS_exit_group, "exit_group"),
    (libc::SYS_execve, "execve"),
    (libc::SYS_kill, "kill"),
    (libc::SYS_tkill, "tkill"),
    (libc::SYS_tgkill, "tgkill"),
    (libc::SYS_rt_sigaction, "rt_sigaction"),
    (libc::SYS_rt_sigsuspend, "rt_sigsuspend"),
    (libc::SYS_rt_sigtimedwait, "rt_sigtimedwait"),
    (libc::SYS_pause, "pause"),
    (libc::SYS_alarm, "alarm"),
    (libc::SYS_setitimer, "setitimer"),
    (libc::SYS_timer_create, "timer_create"),
    (libc::SYS_timer_settime, "timer_settime"),
    (libc::SYS_timer_gettime, "timer_gettime"),
    (libc::SYS_timer_getoverrun, "timer_getoverrun"),
    (libc::SYS_timer_delete, "timer_delete"),
    (libc::SYS_io_uring_setup, "io_uring_setup"),
    (libc::SYS_timerfd_create, "timerfd_create"),
    (libc::SYS_timerfd_settime, "timerfd_settime"),
    (libc::SYS_timerfd_gettime, "timerfd_gettime"),
    (libc::SYS_getrandom, "getrandom"),
    (libc::SYS_recvfrom, "recvfrom"),
    (libc::SYS_recvmsg, "recvmsg"),
    (libc::SYS_sendto, "sendto"),
    (libc::SYS_sendmsg, "sendmsg"),
    (libc::SYS_accept, "accept"),
    (libc::SYS_accept4, "accept4"),
    (libc::SYS_connect, "connect"),
    (libc::SYS_flock, "flock"),
    (libc::SYS_fcntl, "fcntl"),
    (libc::SYS_semop, "semop"),
    (libc::SYS_semtimedop, "semtimedop"),
    (libc::SYS_msgrcv, "msgrcv"),
    (libc::SYS_mq_timedreceive, "mq_timedreceive"),
    (libc::SYS_io_uring_enter, "io_uring_enter"),
    (libc::SYS_io_getevents, "io_getevents"),
    (libc::SYS_clone3, "clone3"),
    (libc::SYS_signalfd, "signalfd"),
    (libc::SYS_signalfd4, "signalfd4"),
    (libc::SYS_semctl, "semctl"),
    (libc::SYS_msgctl, "msgctl"),
    (libc::SYS_msgsnd, "msgsnd"),
    (libc::SYS_mq_timedsend, "mq_timedsend"),
    (libc::SYS_mq_open, "mq_open"),
    (libc::SYS_clone, "clone"),
    (libc::SYS_pread64, "pread64"),
    (libc::SYS_pwrite64, "pwrite64"),
    (libc::SYS_preadv, "preadv"),
    (libc::SYS_pwritev, "pwritev"),
    (libc::SYS_preadv2, "preadv2"),
    (libc::SYS_pwritev2, "pwritev2"),
    (libc::SYS_recvmmsg, "recvmmsg"),
    (libc::SYS_sendmmsg, "sendmmsg"),
    (libc::SYS_splice, "splice"),
    (libc::SYS_tee, "tee"),
    (libc::SYS_vmsplice, "vmsplice"),
    (libc::SYS_sendfile, "sendfile"),
    (libc::SYS_copy_file_range, "copy_file_range"),
    (libc::SYS_fsync, "fsync"),
    (libc::SYS_fdatasync, "fdatasync"),
    (libc::SYS_ptrace, "ptrace"),
    (libc::SYS_rt_sigqueueinfo, "rt_sigqueueinfo"),
    (libc::SYS_rt_tgsigqueueinfo, "rt_tgsigqueueinfo"),
    (libc::SYS_userfaultfd, "userfaultfd"),
    (libc::SYS_getrusage, "getrusage"),
    (libc::SYS_sysinfo, "sysinfo"),
    (libc::SYS_adjtimex, "adjtimex"),
    (libc::SYS_clock_adjtime, "clock_adjtime"),
    (libc::SYS_settimeofday, "settimeofday"),
    (libc::SYS_arch_prctl, "arch_prctl"),
    (libc::SYS_prctl, "prctl"),
    (libc::SYS_mmap, "mmap"),
    (libc::SYS_close, "close"),
    (libc::SYS_vfork, "vfork"),
    (libc::SYS_fork, "fork"),
    (libc::SYS_sigaltstack, "sigaltstack"),
    (libc::SYS_restart_syscall, "restart_syscall"),
    (libc::SYS_uname, "uname"),
    (libc::SYS_stat, "stat"),
    (libc::SYS_fstat, "fstat"),
    (libc::SYS_lstat, "lstat"),
    (libc::SYS_newfstatat, "newfstatat"),
    (libc::SYS_statx, "statx"),
    (libc::SYS_prlimit64, "prlimit64"),
    (libc::SYS_sched_setaffinity, "sched_setaffinity"),
];

/// Removes the trap flag from the flags that a call has stored; returns whether it was set.
pub(super) const fn hide_trap_flag(registers: &mut libc::user_regs_struct) -> bool {
    const TRAP_FLAG: u64 = 1 << 8;
    let has_it = registers.r11 & TRAP_FLAG != 0;
    registers.r11 &= !TRAP_FLAG;
    has_it
}

/// The name of a call, or its number.
pub(super) fn name(number: i64) -> String {
    let row = NAMES.iter().find(|(known, _)| *known == number);
    row.map_or_else(|| format!("call {number}"), |(_, name)| (*name).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::tests::{Stopped, no_registers};

    impl Call {
        /// A call with these arguments, and zeros after them.
        pub(in crate::guest) fn made(number: i64, given: &[u64]) -> Self {
            let mut args = [0; 6];
            args[..given.len()].copy_from_slice(given);
            Self {
                number,
                args,
                registers: no_registers(),
            }
        }
    }

    /// A thread at a call as the kernel shows it (ptrace(2), syscall(2)).
    fn at_call() -> Stopped {
        let stopped = Stopped::new();
        stopped.change(|registers| {
            registers.orig_rax = 7;
            registers.rax = (-38_i64).cast_unsigned();
            [registers.rdi, registers.rsi, registers.rdx] = [1, 2, 3];
            [registers.r10, registers.r8, registers.r9] = [4, 5, 6];
            registers.rip = 0x1000;
        });
        stopped
    }

    /// What the kernel would do: number, arguments, answer, and where the thread goes on.
    fn seen(stopped: &Stopped) -> (i64, [u64; 6], i64, u64) {
        let it = stopped.registers();
        let args = [it.rdi, it.rsi, it.rdx, it.r10, it.r8, it.r9];
        let [number, result] = [it.orig_rax, it.rax].map(u64::cast_signed);
        (number, args, result, it.rip)
    }

    #[test]
    fn a_call_is_read_from_the_registers_and_changed_in_them() {
        let own = [1, 2, 3, 4, 5, 6];
        let stopped = at_call();
        let pid = stopped.pid;
        let call = Call::of(pid).expect("it stands");
        assert_eq!((call.number, call.args), (7, own));
        assert_eq!((call.result(), call.instruction()), (-38, 0x1000));
        assert_eq!(call.stack(), stopped.registers().rsp);
        assert_eq!(call.registers().r9, 6);
        type Change<'a> = &'a dyn Fn(&Call) -> nix::Result<()>;
        type Seen = (i64, [u64; 6], i64, u64);
        let cases: [(Change<'_>, Seen); 9] = [
            (&|it| it.answer(pid, -5), (-1, own, -5, 0x1000)),
            (
                &|it| it.with(pid, 0, 9),
                (7, [9, 2, 3, 4, 5, 6], -38, 0x1000),
            ),
            (
                &|it| it.with(pid, 1, 9),
                (7, [1, 9, 3, 4, 5, 6], -38, 0x1000),
            ),
            (
                &|it| it.with(pid, 2, 9),
                (7, [1, 2, 9, 4, 5, 6], -38, 0x1000),
            ),
            (
                &|it| it.with(pid, 3, 9),
                (7, [1, 2, 3, 9, 5, 6], -38, 0x1000),
            ),
            (
                &|it| it.with(pid, 4, 9),
                (7, [1, 2, 3, 4, 9, 6], -38, 0x1000),
            ),
            // The instruction of a call has two bytes.
            (&|it| it.again(pid), (-1, own, 7, 0xFFE)),
            (
                &|it| it.with_result_again(pid, 1, 9, 11),
                (7, [1, 9, 3, 4, 5, 6], 11, 0xFFE),
            ),
            (&|it| it.interrupted_at_end(pid), (7, own, -4, 0x1002)),
        ];
        for (index, (change, expected)) in cases.into_iter().enumerate() {
            change(&call).expect("it stands");
            assert_eq!(seen(&stopped), expected, "case {index}");
        }
        call.with_result(pid, 0, 8, 3).expect("it stands");
        assert_eq!(seen(&stopped), (7, [8, 2, 3, 4, 5, 6], 3, 0x1000));
    }

    /// Only a call that a signal has cut short (EINTR, 4), and that is one, is made again.
    #[test]
    fn a_call_that_was_cut_short_is_made_again() {
        let stopped = at_call();
        let pid = stopped.pid;
        for (number, result, expected) in [(7, -4, 0xFFE), (7, -11, 0x1000), (-1, -4, 0x1000)] {
            stopped.change(|registers| {
                registers.orig_rax = i64::cast_unsigned(number);
                registers.rax = i64::cast_unsigned(result);
                registers.rip = 0x1000;
            });
            Call::of(pid).expect("it stands").again_if_cut_short(pid);
            assert_eq!(stopped.registers().rip, expected, "{number} {result}");
        }
    }

    #[test]
    fn calls_are_alike_with_the_same_number_and_arguments() {
        let call = Call::made(7, &[1, 2]);
        assert!(call.is_like(&Call::made(7, &[1, 2])));
        assert!(!call.is_like(&Call::made(7, &[1, 3])));
        assert!(!call.is_like(&Call::made(8, &[1, 2])));
    }

    /// Intel's manual, volume 2: RDTSC puts the lower half into EAX and the upper one into EDX;
    /// RDTSCP puts the processor's number into ECX as well.
    #[test]
    fn the_processors_counter_is_in_two_registers() {
        let stopped = at_call();
        for (len, rcx) in [(2, 77), (3, 0)] {
            stopped.change(|registers| {
                registers.rcx = 77;
                registers.rip = 0x1000;
            });
            let call = Call::of(stopped.pid).expect("it stands");
            let count = 0x1234_5678_9ABC_DEF0;
            call.has_read_counter(stopped.pid, len, count)
                .expect("it stands");
            let it = stopped.registers();
            assert_eq!([it.rax, it.rdx, it.rcx], [0x9ABC_DEF0, 0x1234_5678, rcx]);
            assert_eq!(it.rip, 0x1000 + len);
        }
    }

    /// Bit 8 of the flags is the trap flag (Intel's manual, volume 1, 3.4.3).
    #[test]
    fn the_trap_flag_of_a_step_is_hidden() {
        let mut registers = no_registers();
        for (flags, hidden, had_it) in [(0x346, 0x246, true), (0x246, 0x246, false)] {
            registers.r11 = flags;
            assert_eq!(hide_trap_flag(&mut registers), had_it);
            assert_eq!(registers.r11, hidden);
        }
        let stopped = at_call();
        stopped.change(|registers| registers.r11 = 0x346);
        Call::of(stopped.pid)
            .expect("it stands")
            .hide_step(stopped.pid);
        assert_eq!(stopped.registers().r11, 0x246);
    }

    #[test]
    fn a_call_has_a_name_or_a_number() {
        assert_eq!(
            (name(libc::SYS_read), name(FUTEX_WAIT)),
            ("read".into(), "futex_wait".into())
        );
        assert_eq!(name(9_999), "call 9999");
    }
}
