//! What is behind a file descriptor: the supervisor looks through a copy of its own.
//!
//! The supervisor keeps a copy until the program closes the file or puts another file at its
//! number. Those calls are stopped at no virtual time: a copy that outlives the file would hide the
//! end of a pipe and the closing of a port.

use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use nix::unistd::Pid;
use rustix::fs::{FileType, fstat};
use rustix::process::{PidfdFlags, PidfdGetfdFlags, pidfd_getfd, pidfd_open};

use super::clocks::low_i32;
use super::{Memory, Outcome, Supervisor};
use crate::guest::call::Call;
use crate::guest::launch::KEPT_BELOW;
pub(super) use crate::guest::open_file::{File, Kind};

impl Supervisor {
    /// The file `fd` of the process of `tid`.
    pub(super) fn file(&mut self, tid: i32, fd: i32) -> Option<Arc<File>> {
        let pid = self.threads.get(&tid)?.process;
        // A negative number is none, and is taken amiss below.
        let fd = Some(fd).filter(|&fd| fd >= 0)?;
        if let Some(file) = self.processes.get(&pid)?.files.get(&fd) {
            // A port may have hung up meanwhile.
            let kind = file.device.map_or(file.kind, |it| self.device_kind(it));
            if kind == file.kind {
                return Some(Arc::clone(file));
            }
        }
        let number = fd;
        let process = self.processes.get_mut(&pid)?;
        if process.handle.is_none() {
            let pid = rustix::process::Pid::from_raw(pid)?;
            process.handle = pidfd_open(pid, PidfdFlags::empty()).ok();
        }
        let handle = process.handle.as_ref()?.as_fd();
        let fd = pidfd_getfd(handle, fd, PidfdGetfdFlags::empty()).ok()?;
        let (kind, device) = self.kind(&fd);
        let file = Arc::new(File { fd, kind, device });
        if number < KEPT_BELOW.cast_signed()
            && let Some(process) = self.processes.get_mut(&pid)
        {
            process.files.insert(number, Arc::clone(&file));
        }
        Some(file)
    }

    /// Drops the copies of files that the program is about to close or replace.
    pub(super) fn lets_go(&mut self, call: &Call) {
        self.stage.stir();
        let [first, second, ..] = call.args.map(low_i32);
        let gone = match call.number {
            nix::libc::SYS_close => first..=first,
            nix::libc::SYS_dup2 | nix::libc::SYS_dup3 => second..=second,
            _ => 0..=i32::MAX,
        };
        // In all processes: some share their table of files.
        for process in self.processes.values_mut() {
            process.files.retain(|fd, _| !gone.contains(fd));
        }
    }

    /// Hands the bytes of ports to the kernel before a call that reads them there.
    pub(super) fn lets_kernel_read(&mut self, tid: i32, call: &Call) {
        self.stage.stir();
        for fd in [call.args[0], call.args[1], call.args[2]].map(low_i32) {
            if let Some(Kind::Port(port)) = self.file(tid, fd).map(|file| file.kind) {
                self.stage.release(port);
            }
        }
    }

    fn device_kind(&self, device: u64) -> Kind {
        let (major, minor) = (rustix::fs::major(device), rustix::fs::minor(device));
        match self.stage.port_of(device) {
            Some(port) => Kind::Port(port),
            None if self.stage.is_gone(device) => Kind::Gone,
            None if major == 1 && matches!(minor, 8 | 9) => Kind::Chance,
            None if matches!(major, 4 | 5 | 136..=143) => Kind::Stream,
            None => Kind::Prompt,
        }
    }

    fn kind(&self, fd: &OwnedFd) -> (Kind, Option<u64>) {
        let Ok(stat) = fstat(fd) else {
            return (Kind::Prompt, None);
        };
        let kind = match FileType::from_raw_mode(stat.st_mode) {
            FileType::CharacterDevice => {
                return (self.device_kind(stat.st_rdev), Some(stat.st_rdev));
            }
            FileType::RegularFile => self.told_file(fd).map_or(Kind::Prompt, Kind::Told),
            FileType::Directory | FileType::BlockDevice => Kind::Prompt,
            _ if (stat.st_dev, stat.st_ino) == self.stage.mouth => Kind::Mouth,
            FileType::Socket | FileType::Fifo => Kind::Stream,
            _ if self.has_signal_files => Self::signals_of(fd).map_or(Kind::Stream, Kind::Signals),
            _ => Kind::Stream,
        };
        (kind, None)
    }

    /// Files that tell of the world outside are named.
    pub(super) fn open(&mut self, tid: i32, call: &Call) -> Outcome {
        let address = match call.number {
            nix::libc::SYS_open => call.args[0],
            _ => call.args[1],
        };
        let path = Memory(Pid::from_raw(tid)).text(address);
        self.looks_into(&path);
        self.stage.touch();
        if self.is_refused(tid, call, &path) {
            return nix::errno::Errno::EBUSY.into();
        }
        self.open_fifo(tid, call, &path)
    }
}
