//! The program as GDB sees it.
//!
//! Threads have the numbers of their order of birth, from 1, so that they are the same in each run.

use core::num::NonZeroUsize;

use gdbstub::common::{Pid as GdbPid, Signal as GdbSignal, Tid};
use gdbstub::target::ext::auxv::{Auxv, AuxvOps};
use gdbstub::target::ext::base::BaseOps;
use gdbstub::target::ext::base::multithread::{
    MultiThreadBase, MultiThreadRangeStepping, MultiThreadRangeSteppingOps, MultiThreadResume,
    MultiThreadResumeOps, MultiThreadSchedulerLocking, MultiThreadSchedulerLockingOps,
    MultiThreadSingleStep, MultiThreadSingleStepOps,
};
use gdbstub::target::ext::base::reverse_exec::{ReverseContOps, ReverseStepOps};
use gdbstub::target::ext::breakpoints::{
    Breakpoints, BreakpointsOps, HwBreakpoint, HwBreakpointOps, HwWatchpoint, HwWatchpointOps,
    SwBreakpoint, SwBreakpointOps, WatchKind,
};
use gdbstub::target::ext::exec_file::{ExecFile, ExecFileOps};
use gdbstub::target::ext::monitor_cmd::{ConsoleOutput, MonitorCmd, MonitorCmdOps};
use gdbstub::target::ext::thread_extra_info::{ThreadExtraInfo, ThreadExtraInfoOps};
use gdbstub::target::{Target, TargetError, TargetResult};
use gdbstub_arch::x86::X86_64_SSE;
use gdbstub_arch::x86::reg::X86_64CoreRegs;
use nix::libc;
use nix::sys::signal::Signal;

use super::Session;
use super::registers::{from_gdb, shown, take, take_float};
use crate::guest::GuestError;
use crate::guest::supervisor::{Step, Watchpoint};

/// GDB's order to one thread.
#[derive(Clone, Debug)]
pub(super) enum Action {
    Go(Option<GdbSignal>),
    Step(Option<GdbSignal>),
    Range(u64, u64),
}

/// An error with its number for GDB.
fn errno<E>(number: i32) -> TargetError<E> {
    TargetError::Errno(u8::try_from(number).unwrap_or(u8::MAX))
}

/// Copies the requested part of `data`.
fn part(data: &[u8], offset: u64, length: usize, buf: &mut [u8]) -> usize {
    let rest = usize::try_from(offset).ok().and_then(|at| data.get(at..));
    let rest = rest.unwrap_or_default();
    let len = rest.len().min(length).min(buf.len());
    buf[..len].copy_from_slice(&rest[..len]);
    len
}

impl Session<'_> {
    /// The threads and their numbers, the current one first.
    fn threads(&self) -> Vec<(Tid, i32)> {
        let all = self.supervisor_ref().debugged_threads();
        let number = |index: u32| NonZeroUsize::MIN.saturating_add(index as usize);
        let mut all: Vec<(Tid, i32)> = all.map(|(index, tid)| (number(index), tid)).collect();
        all.sort_by_key(|&(number, tid)| (Some(tid) != self.current, number));
        all
    }

    fn tid_of(&self, number: Tid) -> Option<i32> {
        let threads = self.threads();
        let found = threads.into_iter().find(|(other, _)| *other == number);
        found.map(|(_, tid)| tid)
    }

    /// The number of a thread; if the thread has ended, the number of the first thread.
    pub(super) fn number_of(&self, tid: i32) -> Tid {
        let threads = self.threads();
        let found = threads.iter().find(|(_, other)| *other == tid);
        let found = found.or(threads.first());
        found.map_or(Tid::MIN, |(number, _)| *number)
    }
}

impl Target for Session<'_> {
    type Arch = X86_64_SSE;
    type Error = GuestError;

    fn base_ops(&mut self) -> BaseOps<'_, Self::Arch, Self::Error> {
        BaseOps::MultiThread(self)
    }

    fn use_fork_stop_reason(&self) -> bool {
        false
    }

    fn use_vfork_stop_reason(&self) -> bool {
        false
    }

    fn use_vforkdone_stop_reason(&self) -> bool {
        false
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }

    fn support_monitor_cmd(&mut self) -> Option<MonitorCmdOps<'_, Self>> {
        Some(self)
    }

    fn support_exec_file(&mut self) -> Option<ExecFileOps<'_, Self>> {
        Some(self)
    }

    fn support_auxv(&mut self) -> Option<AuxvOps<'_, Self>> {
        Some(self)
    }
}

impl MultiThreadBase for Session<'_> {
    fn read_registers(&mut self, regs: &mut X86_64CoreRegs, tid: Tid) -> TargetResult<(), Self> {
        let tid = self.tid_of(tid).ok_or_else(|| errno(libc::ESRCH))?;
        let (own, float) = self
            .supervisor()
            .registers_of(tid)
            .ok_or(errno(libc::ESRCH))?;
        *regs = shown(&own, float.as_ref());
        Ok(())
    }

    fn write_registers(&mut self, regs: &X86_64CoreRegs, tid: Tid) -> TargetResult<(), Self> {
        let tid = self.tid_of(tid).ok_or_else(|| errno(libc::ESRCH))?;
        let supervisor = self.supervisor();
        let (mut own, mut float) = supervisor.registers_of(tid).ok_or(errno(libc::ESRCH))?;
        take(regs, &mut own);
        if let Some(float) = &mut float {
            take_float(regs, float);
        }
        match supervisor.set_registers_of(tid, own, float) {
            true => Ok(()),
            false => Err(errno(libc::EBUSY)),
        }
    }

    fn read_addrs(&mut self, start: u64, data: &mut [u8], _: Tid) -> TargetResult<usize, Self> {
        match self.supervisor().read_debugged(start, data) {
            0 if !data.is_empty() => Err(errno(libc::EFAULT)),
            len => Ok(len),
        }
    }

    fn write_addrs(&mut self, start: u64, data: &[u8], _: Tid) -> TargetResult<(), Self> {
        match self.supervisor().write_debugged(start, data) {
            true => Ok(()),
            false => Err(errno(libc::EFAULT)),
        }
    }

    fn list_active_threads(&mut self, is_active: &mut dyn FnMut(Tid)) -> Result<(), GuestError> {
        for (number, _) in self.threads() {
            is_active(number);
        }
        Ok(())
    }

    fn support_resume(&mut self) -> Option<MultiThreadResumeOps<'_, Self>> {
        Some(self)
    }

    fn support_thread_extra_info(&mut self) -> Option<ThreadExtraInfoOps<'_, Self>> {
        Some(self)
    }
}

impl ThreadExtraInfo for Session<'_> {
    fn thread_extra_info(&self, tid: Tid, buf: &mut [u8]) -> Result<usize, GuestError> {
        let tid = self.tid_of(tid);
        let told = tid.map(|tid| self.supervisor_ref().doing_of(tid));
        let told = told.unwrap_or_default();
        Ok(part(told.as_bytes(), 0, told.len(), buf))
    }
}

impl MultiThreadResume for Session<'_> {
    fn resume(&mut self) -> Result<(), GuestError> {
        let actions = core::mem::take(&mut self.actions);
        // An order to run forward replaces an earlier order to go back.
        self.back = None;
        let is_told = core::mem::take(&mut self.is_signal_told);
        let mut step = None;
        let mut signals = Vec::new();
        for (number, action) in actions {
            let Some(tid) = self.tid_of(number) else {
                continue;
            };
            let within = match action {
                Action::Range(from, to) => Some(from..to),
                Action::Step(_) => Some(0..0),
                Action::Go(_) => None,
            };
            step = step.or(within.map(|within| Step { tid, within }));
            if let Action::Go(Some(signal)) | Action::Step(Some(signal)) = action {
                signals.push((tid, Signal::try_from(from_gdb(signal)).ok()));
            }
        }
        let supervisor = self.supervisor();
        let held = supervisor.debugging().and_then(|it| it.held_thread());
        if let Some(held) = held {
            let given = signals.iter().find(|(tid, _)| *tid == held);
            let signal = given.and_then(|(_, signal)| *signal);
            // A debugger that was not told of a signal cannot intend to drop it.
            let is_meant = is_told || given.is_some();
            if is_meant && !supervisor.set_held_signal(held, signal) {
                supervisor.send_signal(held, signal);
            }
        }
        for (tid, signal) in signals.into_iter().filter(|(tid, _)| Some(*tid) != held) {
            supervisor.send_signal(tid, signal);
        }
        if let Some(debugging) = supervisor.debugging() {
            debugging.set_step(step);
        }
        Ok(())
    }

    fn clear_resume_actions(&mut self) -> Result<(), GuestError> {
        self.actions.clear();
        Ok(())
    }

    fn set_resume_action_continue(
        &mut self,
        tid: Tid,
        signal: Option<GdbSignal>,
    ) -> Result<(), GuestError> {
        self.actions.push((tid, Action::Go(signal)));
        Ok(())
    }

    fn support_reverse_cont(&mut self) -> Option<ReverseContOps<'_, Tid, Self>> {
        Some(self)
    }

    fn support_reverse_step(&mut self) -> Option<ReverseStepOps<'_, Tid, Self>> {
        Some(self)
    }

    fn support_single_step(&mut self) -> Option<MultiThreadSingleStepOps<'_, Self>> {
        Some(self)
    }

    fn support_range_step(&mut self) -> Option<MultiThreadRangeSteppingOps<'_, Self>> {
        Some(self)
    }

    fn support_scheduler_locking(&mut self) -> Option<MultiThreadSchedulerLockingOps<'_, Self>> {
        Some(self)
    }
}

impl MultiThreadSingleStep for Session<'_> {
    fn set_resume_action_step(
        &mut self,
        tid: Tid,
        signal: Option<GdbSignal>,
    ) -> Result<(), GuestError> {
        self.actions.push((tid, Action::Step(signal)));
        Ok(())
    }
}

impl MultiThreadRangeStepping for Session<'_> {
    fn set_resume_action_range_step(
        &mut self,
        tid: Tid,
        start: u64,
        end: u64,
    ) -> Result<(), GuestError> {
        self.actions.push((tid, Action::Range(start, end)));
        Ok(())
    }
}

impl MultiThreadSchedulerLocking for Session<'_> {
    /// Locking the scheduler has no effect: the order of threads is part of the run, so another
    /// order would be another run.
    fn set_resume_action_scheduler_lock(&mut self) -> Result<(), GuestError> {
        Ok(())
    }
}

impl Breakpoints for Session<'_> {
    fn support_sw_breakpoint(&mut self) -> Option<SwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_breakpoint(&mut self) -> Option<HwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_watchpoint(&mut self) -> Option<HwWatchpointOps<'_, Self>> {
        Some(self)
    }
}

impl SwBreakpoint for Session<'_> {
    fn add_sw_breakpoint(&mut self, addr: u64, _: usize) -> TargetResult<bool, Self> {
        Ok(self.supervisor().add_break(addr))
    }

    fn remove_sw_breakpoint(&mut self, addr: u64, _: usize) -> TargetResult<bool, Self> {
        Ok(self.supervisor().remove_break(addr))
    }
}

/// `hbreak` sets the same breakpoints, because all memory of the program can be written.
impl HwBreakpoint for Session<'_> {
    fn add_hw_breakpoint(&mut self, addr: u64, kind: usize) -> TargetResult<bool, Self> {
        self.add_sw_breakpoint(addr, kind)
    }

    fn remove_hw_breakpoint(&mut self, addr: u64, kind: usize) -> TargetResult<bool, Self> {
        self.remove_sw_breakpoint(addr, kind)
    }
}

/// Divides watched memory into words. The processor watches whole words, so longer memory needs
/// several of its four registers.
fn words(address: u64, len: u64, kind: WatchKind) -> Vec<Watchpoint> {
    let end = address.saturating_add(len.min(32));
    let (mut at, mut words) = (address, Vec::new());
    while at < end {
        let fits = |len: &u64| at.is_multiple_of(*len) && at + len <= end;
        let len = [8, 4, 2, 1].into_iter().find(fits).unwrap_or(1);
        words.push(Watchpoint {
            address: at,
            len,
            reads: kind != WatchKind::Write,
        });
        at += len;
    }
    words
}

impl HwWatchpoint for Session<'_> {
    fn add_hw_watchpoint(
        &mut self,
        addr: u64,
        len: u64,
        kind: WatchKind,
    ) -> TargetResult<bool, Self> {
        let words = words(addr, len, kind);
        let Some(debugging) = self.supervisor().debugging() else {
            return Ok(false);
        };
        let mut added = Vec::new();
        for word in &words {
            if !debugging.add_watch(*word) {
                for word in added {
                    debugging.remove_watch(word);
                }
                return Ok(false);
            }
            added.push(*word);
        }
        self.kinds.insert(addr, (len, kind));
        Ok(true)
    }

    fn remove_hw_watchpoint(
        &mut self,
        addr: u64,
        len: u64,
        kind: WatchKind,
    ) -> TargetResult<bool, Self> {
        let Some(debugging) = self.supervisor().debugging() else {
            return Ok(false);
        };
        let mut removed = true;
        for word in words(addr, len, kind) {
            removed &= debugging.remove_watch(word);
        }
        self.kinds.remove(&addr);
        Ok(removed)
    }
}

impl ExecFile for Session<'_> {
    fn get_exec_file(
        &self,
        _: Option<GdbPid>,
        offset: u64,
        length: usize,
        buf: &mut [u8],
    ) -> TargetResult<usize, Self> {
        let path = self.supervisor_ref().debugged_file();
        let path = path.ok_or_else(|| errno(libc::ENOENT))?;
        Ok(part(
            path.as_os_str().as_encoded_bytes(),
            offset,
            length,
            buf,
        ))
    }
}

impl Auxv for Session<'_> {
    fn get_auxv(&self, offset: u64, length: usize, buf: &mut [u8]) -> TargetResult<usize, Self> {
        let table = self.supervisor_ref().auxiliary_vector();
        let table = table.ok_or_else(|| errno(libc::ESRCH))?;
        Ok(part(&table, offset, length, buf))
    }
}

impl MonitorCmd for Session<'_> {
    fn handle_monitor_cmd(
        &mut self,
        cmd: &[u8],
        mut out: ConsoleOutput<'_>,
    ) -> Result<(), GuestError> {
        let answer = self.monitor(&String::from_utf8_lossy(cmd));
        out.write_raw(answer.as_bytes());
        out.write_raw(b"\n");
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each word lies at a multiple of its length, and all words together are the watched memory.
    #[test]
    fn watched_memory_is_cut_into_words_of_the_processor() {
        let cut = |address, len| -> Vec<(u64, u64)> {
            let words = words(address, len, WatchKind::Write).into_iter();
            words.map(|word| (word.address, word.len)).collect()
        };
        assert_eq!(cut(16, 8), [(16, 8)]);
        assert_eq!(cut(20, 8), [(20, 4), (24, 4)]);
        assert_eq!(cut(7, 4), [(7, 1), (8, 2), (10, 1)]);
    }

    #[test]
    fn a_part_of_a_table_ends_where_it_ends() {
        let mut buf = [0; 4];
        assert_eq!(part(b"abcdef", 4, 4, &mut buf), 2);
        assert_eq!(&buf[..2], b"ef");
        assert_eq!(part(b"abcdef", 7, 4, &mut buf), 0);
        assert_eq!(part(b"abcdef", u64::MAX, 4, &mut buf), 0);
    }
}
