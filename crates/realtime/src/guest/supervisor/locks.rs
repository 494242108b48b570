//! Locks on files between the program's own processes.

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use rustix::fs::{FlockOperation, flock};
use rustix::process::{Flock, FlockOffsetType, FlockType, fcntl_getlk};

use super::clocks::low_i32;
use super::{Memory, On, Outcome, Supervisor, Wait};
use crate::guest::call::Call;

impl Supervisor {
    /// Handles fcntl(F_SETLKW) and flock: the kernel executes the call when it would not wait.
    pub(super) fn lock_file(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let fd = low_i32(call.args[0]);
        let is_taken = match call.number {
            libc::SYS_flock => self.is_flocked(tid, fd, low_i32(call.args[1])),
            _ => self.is_range_locked(tid, fd, call)?,
        };
        Ok(match is_taken {
            false => Outcome::Kernel,
            true => Outcome::Block(Wait {
                on: On::Files,
                deadline: None,
            }),
        })
    }

    fn is_flocked(&self, tid: i32, fd: i32, operation: i32) -> bool {
        let waiting = match operation {
            libc::LOCK_EX => FlockOperation::NonBlockingLockExclusive,
            libc::LOCK_SH => FlockOperation::NonBlockingLockShared,
            _ => return false,
        };
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        // A newly opened file is a separate owner of locks, and its lock is released when the file
        // is closed.
        let Ok(again) = std::fs::File::open(format!("/proc/{process}/fd/{fd}")) else {
            return false;
        };
        flock(&again, waiting) == Err(rustix::io::Errno::WOULDBLOCK)
            && !self.is_its_own(process, fd, &again)
    }

    /// Whether the blocking lock belongs to `fd` itself, which may change it.
    fn is_its_own(&self, process: i32, fd: i32, file: &std::fs::File) -> bool {
        use std::os::unix::fs::MetadataExt as _;

        let Ok(data) = file.metadata() else {
            return false;
        };
        let info = std::fs::read_to_string(format!("/proc/{process}/fdinfo/{fd}"));
        let has_lock = info.is_ok_and(|info| info.lines().any(|line| line.starts_with("lock:")));
        let inode = format!(":{} ", data.ino());
        let all = std::fs::read_to_string("/proc/locks").unwrap_or_default();
        let held = all
            .lines()
            .filter(|line| line.contains("FLOCK") && line.contains(&inode) && !line.contains("->"));
        has_lock && held.count() == 1
    }

    fn is_range_locked(&mut self, tid: i32, fd: i32, call: &Call) -> Result<bool, Errno> {
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        // short type, short whence, long start, long length, int pid.
        let mut bytes = [0; 32];
        Memory(Pid::from_raw(tid)).read(call.args[2], &mut bytes)?;
        let short = |at: usize| i32::from(i16::from_ne_bytes([bytes[at], bytes[at + 1]]));
        let long = |at: usize| {
            let mut word = [0; 8];
            word.copy_from_slice(&bytes[at..at + 8]);
            u64::from_ne_bytes(word)
        };
        let wanted = Flock {
            start: long(8),
            length: long(16),
            pid: None,
            typ: match short(0) {
                libc::F_RDLCK => FlockType::ReadLock,
                libc::F_WRLCK => FlockType::WriteLock,
                _ => return Ok(false),
            },
            offset_type: match short(2) {
                libc::SEEK_SET => FlockOffsetType::Set,
                libc::SEEK_CUR => FlockOffsetType::Current,
                _ => FlockOffsetType::End,
            },
        };
        let Some(file) = self.file(tid, fd) else {
            return Ok(false);
        };
        let found = fcntl_getlk(&file.fd, &wanted).ok().flatten();
        let holder = found.and_then(|found| found.pid);
        Ok(holder.is_some_and(|pid| pid.as_raw_nonzero().get() != process))
    }
}
