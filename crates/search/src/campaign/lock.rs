//! A lock that allows one process at a time in a folder.
//!
//! The kernel holds the lock (`flock`) and releases it when the process ends for any reason. The
//! content of the file only names the process; the content of a dead process is ignored.

use core::time::Duration;
use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};

use crate::error::{StoreError, failed};
use realtime::clock::{Clock as _, WallClock};
use safefs::Dir;

const NAME: &str = "campaign.lock";
/// Maximum length of the content: a process id and a line end.
const CONTENT_MAX: usize = 12;
/// Maximum wait for the process that has just taken the lock to write its id.
const PATIENCE: Duration = Duration::from_secs(1);
const PAUSE: Duration = Duration::from_millis(5);

/// A lock on a folder, held until it is dropped.
#[derive(Debug)]
pub(super) struct Lock {
    file: File,
}

impl Lock {
    /// Takes the lock on `dir` for this process.
    ///
    /// # Errors
    /// If another process holds the lock, or the lock file has other content.
    pub(super) fn take(dir: &Path) -> Result<Self, StoreError> {
        let path = dir.join(NAME);
        let opened = Dir::open(dir).and_then(|dir| dir.open_or_create(NAME));
        let mut file = opened.map_err(|source| StoreError::Unusable {
            path: path.clone(),
            source,
            expected: "the lock of a campaign",
        })?;
        wait_for(&file, dir)?;
        if !is_lock(&content(&file).map_err(failed(&path))?) {
            return Err(StoreError::Content {
                path,
                message: "is not the lock of a campaign, expected a process id".to_owned(),
            });
        }
        let written = file
            .set_len(0)
            .and_then(|()| writeln!(file, "{}", std::process::id()));
        written.map_err(failed(&path))?;
        Ok(Self { file })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // The file is kept: another process may have it open and wait for the lock.
        let _ = self.file.set_len(0);
    }
}

/// Locks `file`, or reports the process that holds the lock on `dir`.
fn wait_for(file: &File, dir: &Path) -> Result<(), StoreError> {
    let clock = WallClock::start();
    let deadline = clock.now() + PATIENCE;
    loop {
        match flock(file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => return Ok(()),
            Err(Errno::WOULDBLOCK) => {}
            Err(error) => return Err(failed(&dir.join(NAME))(error.into())),
        }
        let owner = content(file).ok().and_then(|content| owner(&content));
        if owner.is_some_and(is_alive) || clock.now() >= deadline {
            return Err(StoreError::Locked {
                dir: dir.to_owned(),
                pid: owner.map(|pid| pid.as_raw_nonzero().get()),
            });
        }
        clock.sleep_until(clock.now() + PAUSE);
    }
}

/// The first bytes of the file, one more than a lock file may have.
fn content(file: &File) -> io::Result<Vec<u8>> {
    let mut content = [0; CONTENT_MAX + 1];
    let count = file.read_at(&mut content, 0)?;
    Ok(content[..count].to_vec())
}

fn is_lock(content: &[u8]) -> bool {
    let fits = |byte: &u8| byte.is_ascii_digit() || *byte == b'\n';
    content.len() <= CONTENT_MAX && content.iter().all(fits)
}

/// The process that the file names; `None` while the id is being written.
fn owner(content: &[u8]) -> Option<Pid> {
    let text = core::str::from_utf8(content).ok()?.strip_suffix('\n')?;
    Pid::from_raw(text.parse().ok()?)
}

/// Whether the process exists, even if another user owns it.
fn is_alive(pid: Pid) -> bool {
    !matches!(test_kill_process(pid), Err(Errno::SRCH))
}
