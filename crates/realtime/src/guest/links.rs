//! Symbolic links of ports: libraries such as libserialport look up a port's driver before they
//! open the port (also in programs built on them, such as sigrok). The terminals of the rig have no
//! such link, so the supervisor answers.

use std::os::unix::fs::MetadataExt as _;

use nix::libc;
use nix::unistd::Pid;

use super::call::Call;
use super::memory::Memory;

/// Size of `struct stat`, and offsets of `st_nlink` and `st_mode`.
const STAT: usize = 144;
const STAT_NAMES: usize = 16;
const STAT_MODE: usize = 24;
/// Folder in which the system lists its terminals.
const CLASS: &str = "/sys/class/tty/";
/// Target of such an entry, without the terminal's name.
const DRIVER: &str = "../../devices/virtual/tty/";

/// A thread's request about a link.
pub(super) struct Link {
    pub(super) path: String,
    place: u64,
    len: u64,
}

impl Link {
    /// The link in `call`, which is readlink or readlinkat.
    pub(super) fn of(tid: Pid, call: &Call) -> Self {
        let [path, place, len] = match call.number {
            libc::SYS_readlink | libc::SYS_lstat => [call.args[0], call.args[1], call.args[2]],
            _ => [call.args[1], call.args[2], call.args[3]],
        };
        let path = Memory(tid).text(path);
        Self { path, place, len }
    }

    /// The terminal's device and the target of the entry, if the link is the entry of a terminal
    /// that the system does not list.
    pub(super) fn unlisted_terminal(&self) -> Option<(u64, String)> {
        let name = self.path.strip_prefix(CLASS)?;
        let device = std::fs::metadata(format!("/dev/{name}")).ok()?.rdev();
        let is_listed = std::fs::symlink_metadata(&self.path).is_ok();
        (!is_listed).then(|| (device, format!("{DRIVER}{}", name.replace('/', ""))))
    }

    /// Answers `lstat` with the status of a link.
    pub(super) fn answer_status(&self, tid: Pid, call: &Call) {
        let mut status = [0; STAT];
        status[STAT_NAMES] = 1;
        let mode = libc::S_IFLNK | 0o777;
        status[STAT_MODE..STAT_MODE + 4].copy_from_slice(&mode.to_ne_bytes());
        if Memory(tid).write(self.place, &status).is_ok() {
            let _ = call.answer(tid, 0);
        }
    }

    /// Writes `text` as the target of the link.
    pub(super) fn answer(&self, tid: Pid, call: &Call, text: &str) {
        let len = text.len().min(usize::try_from(self.len).unwrap_or(0));
        if Memory(tid)
            .write(self.place, &text.as_bytes()[..len])
            .is_ok()
        {
            let _ = call.answer(tid, i64::try_from(len).unwrap_or(0));
        }
    }
}
