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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told, error, fd};
    use crate::guest::tests::Room;

    /// A new file, opened twice.
    fn twice(name: &str) -> [std::fs::File; 2] {
        let path = std::env::temp_dir().join(format!("hilrig-lock-{name}-{}", std::process::id()));
        let new = std::fs::File::create(&path).expect("a free name");
        let again = std::fs::File::options().read(true).write(true).open(&path);
        std::fs::remove_file(&path).expect("ours");
        [new, again.expect("it is there")]
    }

    /// flock(2): LOCK_SH is 1, LOCK_EX 2, LOCK_UN 8, LOCK_NB 4.
    #[test]
    fn a_lock_of_another_file_is_waited_for() {
        let mut bench = Bench::new();
        let [held, other] = twice("flock");
        let lock = |bench: &mut Bench, file: &std::fs::File, how: u64| {
            bench.calls(libc::SYS_flock, &[fd(file), how])
        };
        let waits = Told::Waits(On::Files, None);
        assert_eq!(lock(&mut bench, &other, 2), Told::Kernel);
        flock(&held, FlockOperation::LockShared).expect("it is free");
        assert_eq!(lock(&mut bench, &other, 1), Told::Kernel);
        assert_eq!(lock(&mut bench, &other, 2), waits);
        for how in [6, 8] {
            assert_eq!(lock(&mut bench, &other, how), Told::Kernel, "{how}");
        }
        assert_eq!(
            lock(&mut bench, &held, 2),
            Told::Kernel,
            "its own may change"
        );
        flock(&held, FlockOperation::LockExclusive).expect("it is ours");
        assert_eq!(lock(&mut bench, &other, 1), waits);
        assert_eq!(lock(&mut bench, &held, 1), Told::Kernel);
        assert_eq!(bench.calls(libc::SYS_flock, &[9_999, 2]), Told::Kernel);
        drop(held);
        assert_eq!(lock(&mut bench, &other, 2), Told::Kernel);
    }

    /// fcntl(2): locks are those of processes. F_RDLCK is 0, F_WRLCK 1, F_UNLCK 2.
    #[test]
    fn a_range_of_ones_own_is_not_waited_for() {
        let mut bench = Bench::new();
        let [file, _other] = twice("range");
        let flock = |kind: u16, from: u64, len: u64| {
            let room = Room::of_words(&[0, from, len, 0]);
            room.put(0, &kind.to_ne_bytes());
            room
        };
        let lock = |bench: &mut Bench, wanted: &Room| {
            bench.calls(libc::SYS_fcntl, &[fd(&file), 7, wanted.at(0)])
        };
        let [read, write, none] = [0, 1, 2].map(|kind| flock(kind, 0, 10));
        for wanted in [&read, &write, &none] {
            assert_eq!(lock(&mut bench, wanted), Told::Kernel);
        }
        assert_eq!(
            bench.calls(libc::SYS_fcntl, &[fd(&file), 7, 8]),
            error(Errno::EFAULT)
        );
        assert_eq!(
            bench.calls(libc::SYS_fcntl, &[9_999, 7, read.at(0)]),
            Told::Kernel
        );
    }
}
