//! System calls that a stopped thread makes for its supervisor, with a call instruction of the
//! kernel's own page. The caller restores the thread's registers.

use nix::libc;
use nix::sys::ptrace;
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use rustix::process::WaitOptions;

use super::memory::Memory;
use super::news::{is_death, wait};

/// The instruction that makes a system call.
const SYSCALL: [u8; 2] = [0x0F, 0x05];
/// Stop at the beginning or the end of a call, with `PTRACE_O_TRACESYSGOOD`.
const CALL_STOP: i32 = libc::SIGTRAP | 0x80;

/// The reason why a thread did not make a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NotMade {
    /// The thread has ended, with this status.
    Ended(i32),
    /// The thread cannot be made to do it.
    Refused,
}

impl From<nix::Error> for NotMade {
    fn from(_: nix::Error) -> Self {
        Self::Refused
    }
}

/// A stopped thread that makes calls. It may have stopped at a signal, or at the end of a call.
pub(super) struct Hands {
    tid: Pid,
    registers: libc::user_regs_struct,
    /// Address of a call instruction.
    place: u64,
    /// Signals that arrived meanwhile and must be sent again.
    deferred: Vec<i32>,
}

impl Hands {
    /// Prepares `tid`, whose registers are `registers`.
    pub(super) fn of(tid: Pid, registers: libc::user_regs_struct) -> Result<Self, NotMade> {
        let place = call_instruction(tid, &registers).ok_or(NotMade::Refused)?;
        Ok(Self {
            tid,
            registers,
            place,
            deferred: Vec::new(),
        })
    }

    /// Makes a call; returns the kernel's result.
    pub(super) fn call(&mut self, number: i64, args: &[u64]) -> Result<i64, NotMade> {
        let arg = |index: usize| args.get(index).copied().unwrap_or(0);
        let mut registers = self.registers;
        registers.rip = self.place;
        registers.rax = number.cast_unsigned();
        registers.orig_rax = u64::MAX;
        registers.rdi = arg(0);
        registers.rsi = arg(1);
        registers.rdx = arg(2);
        registers.r10 = arg(3);
        registers.r8 = arg(4);
        registers.r9 = arg(5);
        ptrace::setregs(self.tid, registers)?;
        let mut is_inside = false;
        loop {
            ptrace::syscall(self.tid, None)?;
            let status = self.next_stop()?;
            let signal = (status >> 8) & 0xFF;
            match (status >> 16, signal) {
                (0, CALL_STOP) if is_inside => break,
                (0, CALL_STOP) => is_inside = true,
                (0, signal) => self.defer(signal),
                // The filter also stops this call.
                _ => {}
            }
        }
        Ok(ptrace::getregs(self.tid)?.rax.cast_signed())
    }

    /// The status of its next stop.
    pub(super) fn next_stop(&self) -> Result<i32, NotMade> {
        match wait(Some(self.tid), WaitOptions::empty()) {
            Some((_, status)) if is_death(status) => Err(NotMade::Ended(status)),
            Some((_, status)) => Ok(status),
            None => Err(NotMade::Refused),
        }
    }

    /// Stores a signal that arrived meanwhile.
    fn defer(&mut self, signal: i32) {
        // The supervisor's limit of wall time stops threads with SIGSTOP; it will check again
        // later.
        if signal != libc::SIGSTOP {
            self.deferred.push(signal);
        }
    }

    /// Lets the thread continue until it stops at `signal`.
    pub(super) fn stop_at(&mut self, signal: Signal) -> Result<(), NotMade> {
        loop {
            ptrace::cont(self.tid, None)?;
            let status = self.next_stop()?;
            match (status >> 16, (status >> 8) & 0xFF) {
                (0, found) if found == signal as i32 => return Ok(()),
                (0, found) => self.defer(found),
                _ => {}
            }
        }
    }

    /// Sends the stored signals again.
    pub(super) fn send_again(&mut self, process: i32) -> Result<(), NotMade> {
        let ids = [process, self.tid.as_raw()].map(|id| u64::from(id.cast_unsigned()));
        for signal in core::mem::take(&mut self.deferred) {
            let signal = u64::from(signal.cast_unsigned());
            self.call(libc::SYS_tgkill, &[ids[0], ids[1], signal])?;
        }
        Ok(())
    }

    /// Replaces the registers of the thread.
    pub(super) const fn become_like(&mut self, registers: libc::user_regs_struct) {
        self.registers = registers;
    }
}

/// Address of an instruction that makes a system call, in the memory of the thread.
fn call_instruction(tid: Pid, registers: &libc::user_regs_struct) -> Option<u64> {
    let last = registers.rip.wrapping_sub(SYSCALL.len() as u64);
    let mut code = [0; 2];
    if Memory(tid).read(last, &mut code).is_ok() && code == SYSCALL {
        return Some(last);
    }
    let (from, page) = kernel_page(tid)?;
    let at = page.windows(2).position(|code| code == SYSCALL)?;
    Some(from + at as u64)
}

/// The kernel's own page in the memory of `tid`: its address and its content.
pub(super) fn kernel_page(tid: Pid) -> Option<(u64, Vec<u8>)> {
    let maps = std::fs::read_to_string(format!("/proc/{tid}/maps")).ok()?;
    let line = maps.lines().find(|line| line.ends_with("[vdso]"))?;
    let (from, to) = line.split_once(' ')?.0.split_once('-')?;
    let from = u64::from_str_radix(from, 16).ok()?;
    let to = u64::from_str_radix(to, 16).ok()?;
    let mut page = vec![0; usize::try_from(to.checked_sub(from)?).ok()?];
    Memory(tid).read(from, &mut page).ok()?;
    Some((from, page))
}

#[cfg(test)]
mod tests {
    use super::*;

    use nix::sys::ptrace::Options;

    use crate::guest::tests::Stopped;

    fn stopped() -> Stopped {
        let stopped = Stopped::new();
        let options = Options::PTRACE_O_TRACESYSGOOD;
        ptrace::setoptions(stopped.pid, options).expect("it stands");
        stopped
    }

    /// A stopped process makes calls: what it is and in what group, and a pipe in its memory.
    #[test]
    fn a_stopped_process_makes_calls() {
        let stopped = stopped();
        let (pid, before) = (stopped.pid, stopped.registers());
        let mut hands = Hands::of(pid, before).expect("it has a place for calls");
        let number = i64::from(pid.as_raw());
        assert_eq!(hands.call(libc::SYS_getpid, &[]), Ok(number));
        assert_eq!(
            hands.call(libc::SYS_gettid, &[1, 2, 3, 4, 5, 6]),
            Ok(number)
        );
        let place = before.rsp - 256;
        assert_eq!(hands.call(libc::SYS_pipe2, &[place, 0]), Ok(0));
        let ends = Memory(pid).u64(place).expect("its stack").to_ne_bytes();
        assert!(ends[0] >= 3 && ends[4] == ends[0] + 1, "{ends:?}");
        let write = [u64::from(ends[4]), place, 8];
        assert_eq!(hands.call(libc::SYS_write, &write), Ok(8));
        assert_eq!(hands.call(libc::SYS_close, &[999]), Ok(-9));
        // Six arguments: private memory of its own, at an address of the kernel's choice.
        let map = [0, 4_096, 3, 0x22, u64::MAX, 0];
        let at = hands.call(libc::SYS_mmap, &map).expect("it stands");
        assert_eq!(Memory(pid).u64(at.cast_unsigned()), Ok(0));
        // Signals that come in between are sent again; the one of a watch over time is not.
        hands.defer(libc::SIGSTOP);
        hands.defer(libc::SIGWINCH);
        assert_eq!(hands.deferred, [libc::SIGWINCH]);
        hands.send_again(pid.as_raw()).expect("it stands");
        let pending = crate::guest::pending::Pending::of(pid.as_raw(), pid.as_raw());
        assert!(hands.deferred.is_empty() && pending.own & 1 << 27 != 0);
        hands.stop_at(Signal::SIGWINCH).expect("it waits");
        nix::sys::signal::kill(pid, Signal::SIGKILL).expect("ours");
        assert_eq!(hands.next_stop(), Err(NotMade::Ended(9)));
    }

    /// The last two bytes before the next instruction, or one in the kernel's own page.
    #[test]
    fn a_call_instruction_is_found() {
        let stopped = stopped();
        let at = stopped.runs(&[0x0F, 0x05, 0x90]);
        let mut registers = stopped.registers();
        registers.rip = at + 2;
        assert_eq!(call_instruction(stopped.pid, &registers), Some(at));
        registers.rip = at + 3;
        let Some((page, code)) = kernel_page(stopped.pid) else {
            return;
        };
        let found = call_instruction(stopped.pid, &registers).expect("in the kernel's page");
        let inside = usize::try_from(found - page).expect("inside");
        assert_eq!(code[inside..inside + 2], SYSCALL);
        assert_eq!(code.len() % 4_096, 0);
        assert!(kernel_page(Pid::from_raw(-1)).is_none());
    }
}
