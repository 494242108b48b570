//! Breakpoints, and access to the memory of the debugged process as if it had no breakpoints.

use nix::unistd::Pid;
use rustix::fs::{Mode, OFlags, open};
use rustix::io::{Errno, pwrite};

use super::Debugging;
use crate::guest::memory::Memory;
use crate::guest::supervisor::{State, Supervisor};
use crate::guest::task::Thread;

/// The instruction of a breakpoint.
pub(super) const TRAP: u8 = 0xCC;
impl Supervisor {
    /// A thread through which the memory of the debugged process can be accessed; it need not have
    /// stopped.
    fn any_debugged(&self) -> Option<Pid> {
        let process = self.debugging.as_ref()?.process?;
        let mut threads = self.threads.values();
        let is_it = |it: &&Thread| it.process == process && !matches!(it.state, State::Ended);
        threads.find(is_it).map(|thread| thread.tid)
    }

    /// Sets a breakpoint.
    pub(in crate::guest) fn add_break(&mut self, address: u64) -> bool {
        let Some(pid) = self.any_debugged() else {
            return false;
        };
        let mut byte = [0];
        let has = |it: &Debugging| it.breaks.contains_key(&address);
        if self.debugging.as_deref().is_none_or(has) {
            return self.debugging.is_some();
        }
        if Memory(pid).read(address, &mut byte).is_err() || poke(pid, address, &[TRAP]).is_err() {
            return false;
        }
        if let Some(debugging) = &mut self.debugging {
            // A breakpoint that could not be removed is not a byte of the program.
            let known = debugging.under.get(&address).copied();
            let byte = known.filter(|_| byte[0] == TRAP).unwrap_or(byte[0]);
            debugging.breaks.insert(address, byte);
            debugging.under.insert(address, byte);
        }
        true
    }

    /// Sets a breakpoint, or stores it until its code is loaded.
    pub(in crate::guest) fn add_break_when_possible(&mut self, address: u64) {
        if !self.add_break(address)
            && let Some(debugging) = &mut self.debugging
        {
            debugging.pending.insert(address);
        }
    }

    /// Sets the stored breakpoints, if their libraries were loaded by a call.
    pub(super) fn add_pending_breaks(&mut self) {
        let pending = self.debugging.as_ref().map(|it| it.pending.clone());
        for address in pending.unwrap_or_default() {
            if self.add_break(address)
                && let Some(debugging) = &mut self.debugging
            {
                debugging.pending.remove(&address);
            }
        }
    }

    pub(in crate::guest) fn has_break(&self, address: u64) -> bool {
        let debugging = self.debugging.as_ref();
        debugging.is_some_and(|it| it.breaks.contains_key(&address))
    }

    /// Removes a breakpoint.
    pub(in crate::guest) fn remove_break(&mut self, address: u64) -> bool {
        let pid = self.any_debugged();
        let Some(debugging) = &mut self.debugging else {
            return false;
        };
        let was_pending = debugging.pending.remove(&address);
        let Some(byte) = debugging.breaks.remove(&address) else {
            return was_pending;
        };
        pid.is_some_and(|pid| poke(pid, address, &[byte]).is_ok())
    }

    /// Removes all breakpoints.
    pub(in crate::guest) fn clear_breaks(&mut self) {
        let all = self.debugging.as_ref().map(|it| it.break_addresses());
        for address in all.unwrap_or_default() {
            self.remove_break(address);
        }
    }

    /// Reads the memory of the debugged process as if it had no breakpoints; returns the number of
    /// bytes read.
    pub(in crate::guest) fn read_debugged(&self, address: u64, buf: &mut [u8]) -> usize {
        /// Readable memory ends at a multiple of this.
        const PAGE: u64 = 4096;
        let Some(pid) = self.any_debugged() else {
            return 0;
        };
        let mut done = 0;
        while done < buf.len() {
            let at = address.wrapping_add(done as u64);
            let rest = usize::try_from(PAGE - at % PAGE).unwrap_or(1);
            let end = buf.len().min(done + rest);
            if Memory(pid).read(at, &mut buf[done..end]).is_err() {
                break;
            }
            done = end;
        }
        let breaks = self.debugging.as_ref().map(|it| &it.breaks);
        for (&at, &byte) in breaks.into_iter().flatten() {
            let index = at
                .checked_sub(address)
                .and_then(|it| usize::try_from(it).ok());
            if let Some(shown) = index.and_then(|index| buf[..done].get_mut(index)) {
                *shown = byte;
            }
        }
        done
    }

    /// Writes the debugged process's memory; breakpoints stay.
    pub(in crate::guest) fn write_debugged(&mut self, address: u64, bytes: &[u8]) -> bool {
        let Some(pid) = self.any_debugged() else {
            return false;
        };
        let mut bytes = bytes.to_vec();
        let Some(debugging) = &mut self.debugging else {
            return false;
        };
        for (&at, under) in &mut debugging.breaks {
            let index = at
                .checked_sub(address)
                .and_then(|it| usize::try_from(it).ok());
            if let Some(byte) = index.and_then(|index| bytes.get_mut(index)) {
                *under = core::mem::replace(byte, TRAP);
                debugging.under.insert(at, *under);
            }
        }
        Memory(pid).write(address, &bytes).is_ok() || poke(pid, address, &bytes).is_ok()
    }
}

/// Writes memory of a process, also if the process itself must not write it; its threads need not
/// have stopped.
pub(in crate::guest) fn poke(pid: Pid, address: u64, bytes: &[u8]) -> Result<(), Errno> {
    let file = open(
        format!("/proc/{pid}/mem"),
        OFlags::WRONLY | OFlags::CLOEXEC,
        Mode::empty(),
    )?;
    match pwrite(&file, bytes, address)? == bytes.len() {
        true => Ok(()),
        false => Err(Errno::IO),
    }
}
