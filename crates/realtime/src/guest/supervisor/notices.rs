//! Signals about files (O_ASYNC): a port whose bytes the supervisor holds sends them from here,
//! other files by the kernel.

use std::collections::BTreeSet;

use nix::libc;
use nix::unistd::Pid;
use rustix::fs::fcntl_getfl;
use rustix::process::{Signal, getpgid, kill_process};

use super::clocks::low_i32;
use super::files::Kind;
use super::{Memory, Supervisor};
use crate::guest::call::Call;
use crate::guest::launch::{F_SETOWN_EX, F_SETSIG};

/// A request of `ioctl` that `libc` does not know for this system.
const FIOASYNC: u64 = 0x5452;
/// Kind of owner of `F_SETOWN_EX`: a process group (fcntl(2)).
const OWNER_GROUP: u32 = 2;

/// The signal about a file, and where it goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Notice {
    /// A process, or a process group as a negative number.
    owner: i32,
    /// 0: SIGIO.
    signal: i32,
}

impl Supervisor {
    /// fcntl with one of the requests above; the kernel does it as well.
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
                    // A thread stands for its process.
                    _ => self.threads.get(&id).map_or(id, |thread| thread.process),
                };
                self.change_notice(tid, fd, |notice| notice.owner = owner);
            }
            _ => {}
        }
    }

    /// The same by ioctl.
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

    /// Changes the notice of a file of the process of `tid`. The owner is that process at first.
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

    /// Sends the signals of ports to which bytes came.
    pub(super) fn tell_arrivals(&mut self) {
        if !self.hears_by_signal {
            return;
        }
        // The kernel sends those of other files.
        self.is_signalled = true;
        let arrived = self.stage.take_arrived();
        if arrived.is_empty() {
            return;
        }
        let notices: Vec<_> = self.notices.iter().map(|(&at, &it)| (at, it)).collect();
        let mut told = BTreeSet::new();
        for ((process, fd), notice) in notices {
            let Some(file) = self.file(process, fd) else {
                continue;
            };
            let Kind::Port(port) = file.kind else {
                continue;
            };
            let is_held = self.stage.terminal(port).is_some_and(|it| it.holds());
            let is_on = fcntl_getfl(&file.fd)
                .is_ok_and(|flags| flags.bits() & libc::O_ASYNC.unsigned_abs() != 0);
            if arrived.contains(&port) && is_held && is_on && told.insert((port, notice)) {
                self.send_notice(notice);
            }
        }
    }

    /// Sends one to processes of the program, never to others.
    fn send_notice(&mut self, notice: Notice) {
        let signal = match notice.signal {
            0 => Some(Signal::IO),
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
                let _ = kill_process(process, signal);
            }
        }
    }
}
