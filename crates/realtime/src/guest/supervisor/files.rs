//! What is behind a file descriptor: the supervisor looks through a copy of its own.

use std::os::fd::{AsFd, OwnedFd};

use nix::unistd::Pid;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FileType, OFlags, fcntl_getfl, fstat};
use rustix::process::{PidfdFlags, PidfdGetfdFlags, pidfd_getfd, pidfd_open};

use super::{Memory, Outcome, Supervisor};
use crate::guest::call::Call;

/// The kind of a file, as far as waiting is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Reading and writing never wait.
    Prompt,
    /// A port of the rig.
    Port(usize),
    /// One that the supervisor answers.
    Told(usize),
    /// What was a port of the rig, and hung up: nothing waits there.
    Gone,
    /// The system's source of chance.
    Chance,
    /// What the program says: heard in wall time.
    Mouth,
    /// Signals, as bits.
    Signals(u64),
    /// Pipes, sockets, events: may wait.
    Stream,
}

/// A file of the program.
#[derive(Debug)]
pub(super) struct File {
    pub(super) fd: OwnedFd,
    pub(super) kind: Kind,
}

impl File {
    /// Whether its owner does not want to wait.
    pub(super) fn never_waits(&self) -> bool {
        fcntl_getfl(&self.fd).is_ok_and(|flags| flags.contains(OFlags::NONBLOCK))
    }

    /// What can be done now, of `wanted`.
    pub(super) fn readiness(&self, wanted: PollFlags) -> PollFlags {
        let mut fds = [PollFd::new(&self.fd, wanted)];
        match poll(&mut fds, Some(&Timespec::default())) {
            Ok(_) => fds[0].revents(),
            Err(_) => PollFlags::empty(),
        }
    }
}

impl Supervisor {
    /// The file `fd` of the process of `tid`.
    pub(super) fn file(&mut self, tid: i32, fd: i32) -> Option<File> {
        let pid = self.threads.get(&tid)?.process;
        // A negative number is none, and is taken amiss below.
        let fd = Some(fd).filter(|&fd| fd >= 0)?;
        let process = self.processes.get_mut(&pid)?;
        if process.handle.is_none() {
            let pid = rustix::process::Pid::from_raw(pid)?;
            process.handle = pidfd_open(pid, PidfdFlags::empty()).ok();
        }
        let handle = process.handle.as_ref()?.as_fd();
        let fd = pidfd_getfd(handle, fd, PidfdGetfdFlags::empty()).ok()?;
        let kind = self.kind(&fd);
        Some(File { fd, kind })
    }

    fn kind(&self, fd: &OwnedFd) -> Kind {
        let Ok(stat) = fstat(fd) else {
            return Kind::Prompt;
        };
        let (major, minor) = (
            rustix::fs::major(stat.st_rdev),
            rustix::fs::minor(stat.st_rdev),
        );
        match FileType::from_raw_mode(stat.st_mode) {
            FileType::RegularFile => self.told_file(fd).map_or(Kind::Prompt, Kind::Told),
            FileType::Directory | FileType::BlockDevice => Kind::Prompt,
            FileType::CharacterDevice => match self.stage.port_of(stat.st_rdev) {
                Some(port) => Kind::Port(port),
                None if self.stage.is_gone(stat.st_rdev) => Kind::Gone,
                None if major == 1 && matches!(minor, 8 | 9) => Kind::Chance,
                None if matches!(major, 4 | 5 | 136..=143) => Kind::Stream,
                None => Kind::Prompt,
            },
            _ if (stat.st_dev, stat.st_ino) == self.stage.mouth => Kind::Mouth,
            FileType::Socket | FileType::Fifo => Kind::Stream,
            _ if self.has_signal_files => Self::signals_of(fd).map_or(Kind::Stream, Kind::Signals),
            _ => Kind::Stream,
        }
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
