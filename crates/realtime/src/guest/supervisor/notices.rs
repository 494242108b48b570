//! Signals about files (O_ASYNC): the supervisor sends those of ports whose bytes it holds, the
//! kernel those of other files.

use std::collections::BTreeSet;
use std::path::PathBuf;

use nix::libc;
use nix::unistd::Pid;
use rustix::fs::fcntl_getfl;
use rustix::process::{Signal, getpgid, kill_process};
use rustix_libc_wrappers::process::SignalExt as _;

use super::clocks::low_i32;
use super::files::{Kind, numbers, told_of};
use super::posix_timers::SIGINFO;
use super::{Memory, Supervisor};
use crate::guest::call::Call;
use crate::guest::launch::{F_SETOWN_EX, F_SETSIG};

/// A request of `ioctl` that `libc` does not know for this system.
const FIOASYNC: u64 = 0x5452;
/// Kind of owner of `F_SETOWN_EX`: a process group (fcntl(2)).
const OWNER_GROUP: u32 = 2;
/// The lowest signal above 31 that a program may use; the C library uses the two below.
const HIGH_MIN: i32 = 34;
/// The event that such a signal reports: there are bytes (POLLIN | POLLRDNORM).
const POLL_IN: i32 = 1;
const BAND_IN: i64 = 0x41;
/// Maximum number of stored signals with their data.
const SENT_MAX: usize = 1024;

/// The signal about a file, and its receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Notice {
    /// A process, or a process group as a negative number.
    owner: i32,
    /// Number of the signal; 0 stands for SIGIO.
    signal: i32,
}

impl Supervisor {
    /// Follows fcntl with one of the requests above; the kernel executes it, too.
    pub(super) fn sets_notice(&mut self, tid: i32, call: &Call) {
        let [fd, request, argument, ..] = call.args;
        let (fd, argument) = (low_i32(fd), low_i32(argument));
        match low_i32(request) {
            libc::F_SETFL if argument & libc::O_ASYNC != 0 => self.begins_notice(tid, fd),
            libc::F_SETOWN => self.change_notice(tid, fd, |notice| notice.owner = argument),
            F_SETSIG => self.change_notice(tid, fd, |notice| notice.signal = argument),
            F_SETOWN_EX => {
                let owner = Memory(Pid::from_raw(tid)).u64(call.args[2]).unwrap_or(0);
                let [kind, id] = [owner & 0xFFFF_FFFF, owner >> 32];
                let id = low_i32(id);
                let owner = match u32::try_from(kind) {
                    Ok(OWNER_GROUP) => id.checked_neg().unwrap_or(0),
                    // A thread represents its process.
                    _ => self.threads.get(&id).map_or(id, |thread| thread.process),
                };
                self.change_notice(tid, fd, |notice| notice.owner = owner);
            }
            _ => {}
        }
    }

    /// Follows such a request by ioctl.
    pub(super) fn sets_notice_by_ioctl(&mut self, tid: i32, call: &Call) {
        let [fd, request, argument, ..] = call.args;
        let is_on = || Memory(Pid::from_raw(tid)).u32(argument);
        if request == FIOASYNC && is_on().is_ok_and(|value| value != 0) {
            self.begins_notice(tid, low_i32(fd));
        }
    }

    fn begins_notice(&mut self, tid: i32, fd: i32) {
        self.hears_by_signal = true;
        self.stage.take_arrived();
        self.change_notice(tid, fd, |_| {});
    }

    /// Changes the notice of a file in the process of `tid`. Initially this process is the owner.
    fn change_notice(&mut self, tid: i32, fd: i32, change: impl FnOnce(&mut Notice)) {
        let Some(process) = self.threads.get(&tid).map(|thread| thread.process) else {
            return;
        };
        let new = Notice {
            owner: process,
            signal: 0,
        };
        change(self.notices.entry((process, fd)).or_insert(new));
    }

    /// Sends the signals of ports at which bytes have arrived.
    pub(super) fn tell_arrivals(&mut self) {
        if !self.hears_by_signal {
            return;
        }
        // The kernel sends the signals of other files.
        self.is_signalled = true;
        let arrived = self.stage.take_arrived();
        if arrived.is_empty() {
            return;
        }
        let notices: Vec<_> = self.notices.iter().map(|(&at, &it)| (at, it)).collect();
        let mut told = BTreeSet::new();
        for ((process, fd), notice) in notices {
            let mut threads = self.threads.values();
            let thread = threads.find(|thread| thread.process == process);
            let thread = thread.map(|thread| thread.tid.as_raw());
            let Some(file) = thread.and_then(|tid| self.file(tid, fd)) else {
                continue;
            };
            let Kind::Port(port) = file.kind else {
                continue;
            };
            let is_held = self.stage.terminal(port).is_some_and(|it| it.holds());
            let is_on = fcntl_getfl(&file.fd)
                .is_ok_and(|flags| flags.bits() & libc::O_ASYNC.unsigned_abs() != 0);
            if arrived.contains(&port) && is_held && is_on && told.insert((port, notice)) {
                self.send_notice(notice, fd);
            }
        }
    }

    /// Handles `fd`, which the process of `tid` is about to close: its signals continue with a copy
    /// of the file.
    pub(super) fn forget_notice(&mut self, tid: i32, fd: i32) {
        let Some(pid) = self.threads.get(&tid).map(|thread| thread.process) else {
            return;
        };
        let Some(notice) = self.notices.remove(&(pid, fd)) else {
            return;
        };
        let like = look_of(pid, fd);
        let mut copies = numbers(pid).filter(|&other| other != fd);
        let copy = copies.find(|&other| {
            !self.notices.contains_key(&(pid, other)) && look_of(pid, other) == like
        });
        if let Some(copy) = copy.filter(|_| like.is_some()) {
            self.notices.insert((pid, copy), notice);
        }
    }

    /// The data for the handler of this signal, if the signal is about a file (sigaction(2)).
    pub(super) fn told_by_notice(&mut self, process: i32, signal: i32) -> Option<[u8; SIGINFO]> {
        let mut sent = self.sent_notices.iter();
        let index = sent.position(|&(to, number, _)| (to, number) == (process, signal))?;
        let (_, _, fd) = self.sent_notices.remove(index);
        let mut info = [0; SIGINFO];
        info[..4].copy_from_slice(&signal.to_ne_bytes());
        info[8..12].copy_from_slice(&POLL_IN.to_ne_bytes());
        info[16..24].copy_from_slice(&BAND_IN.to_ne_bytes());
        info[24..28].copy_from_slice(&fd.to_ne_bytes());
        Some(info)
    }

    /// Sends a signal about file `fd`, only to processes of the program.
    fn send_notice(&mut self, notice: Notice, fd: i32) {
        let is_high = notice.signal >= HIGH_MIN;
        let signal = match notice.signal {
            0 => Some(Signal::IO),
            signal if is_high => Signal::from_raw(signal),
            signal => Signal::from_named_raw(signal),
        };
        let Some(signal) = signal else {
            return self.note(format!("signal {} of a port is not sent", notice.signal));
        };
        let group = notice.owner.checked_neg().filter(|&group| group > 0);
        let group = group.and_then(rustix::process::Pid::from_raw);
        for pid in self.processes.keys().copied() {
            let Some(process) = rustix::process::Pid::from_raw(pid) else {
                continue;
            };
            let is_meant = match notice.owner {
                owner if owner > 0 => owner == pid,
                _ => group.is_some() && getpgid(Some(process)).ok() == group,
            };
            if is_meant {
                if is_high && self.sent_notices.len() < SENT_MAX {
                    self.sent_notices.push((pid, notice.signal, fd));
                }
                let _ = kill_process(process, signal);
            }
        }
    }
}

/// The common properties of a file and its copies: the name and the flags of the opening.
fn look_of(pid: i32, fd: i32) -> Option<(PathBuf, u32)> {
    let name = std::fs::read_link(format!("/proc/{pid}/fd/{fd}")).ok()?;
    let flags = u32::from_str_radix(&told_of(pid, fd, "flags")?, 8).ok()?;
    Some((name, flags & !libc::O_CLOEXEC.unsigned_abs()))
}
