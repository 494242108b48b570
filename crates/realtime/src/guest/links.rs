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

#[cfg(test)]
mod tests {
    use super::*;

    use crate::guest::tests::{Room, own};

    fn path(text: &str) -> Room {
        Room::of(&[text.as_bytes(), &[0]].concat())
    }

    /// readlink(2), lstat(2), readlinkat(2), fstatat(2): the calls with `at` have a folder first.
    #[test]
    fn a_link_is_read_from_the_arguments() {
        let path = path("/a/b");
        for number in [libc::SYS_readlink, libc::SYS_lstat] {
            let link = Link::of(own(), &Call::made(number, &[path.at(0), 2, 3]));
            assert_eq!(
                (&*link.path, link.place, link.len),
                ("/a/b", 2, 3),
                "{number}"
            );
        }
        for number in [libc::SYS_readlinkat, libc::SYS_newfstatat] {
            let link = Link::of(own(), &Call::made(number, &[9, path.at(0), 2, 3]));
            assert_eq!(
                (&*link.path, link.place, link.len),
                ("/a/b", 2, 3),
                "{number}"
            );
        }
    }

    /// The system lists its terminals in a folder of /sys, and /dev/null is none of them.
    #[test]
    fn a_terminal_that_is_not_listed_has_an_entry() {
        let of = |text: &str| {
            let path = path(text);
            Link::of(own(), &Call::made(libc::SYS_readlink, &[path.at(0), 0, 0]))
                .unlisted_terminal()
        };
        let device = std::fs::metadata("/dev/null").expect("it is there").rdev();
        let expected = Some((device, "../../devices/virtual/tty/null".to_owned()));
        assert_eq!(of("/sys/class/tty/null"), expected);
        assert_eq!(of("/sys/class/tty/nowhere"), None);
        assert_eq!(of("/dev/null"), None);
        if std::fs::symlink_metadata("/sys/class/tty/tty").is_ok() {
            assert_eq!(of("/sys/class/tty/tty"), None, "the system has it");
        }
    }

    /// In `struct stat` of x86-64 the number of names is at 16, the mode at 24; a link is 0o120777.
    #[test]
    fn a_link_is_answered() {
        let room = Room::of(&[0xA5; 152]);
        let (at, path) = (room.at(0), path("/a"));
        let call = Call::made(libc::SYS_lstat, &[path.at(0), at, 0]);
        let link = Link::of(own(), &call);
        link.answer_status(own(), &call);
        let mut expected = vec![0; 152];
        expected[144..].fill(0xA5);
        expected[16] = 1;
        expected[24..28].copy_from_slice(&0o120_777_u32.to_ne_bytes());
        assert_eq!(room.bytes(), expected);
        for (len, expected) in [
            (9, &b"text\xA5"[..]),
            (4, b"text\xA5"),
            (3, b"tex\xA5\xA5"),
            (0, b"\xA5\xA5\xA5\xA5\xA5"),
        ] {
            room.put(0, &[0xA5; 152]);
            let call = Call::made(libc::SYS_readlink, &[path.at(0), at, len]);
            Link::of(own(), &call).answer(own(), &call, "text");
            assert_eq!(&room.bytes()[..5], expected, "{len}");
        }
        // The thread is told how many bytes there are.
        let stopped = crate::guest::tests::Stopped::new();
        let memory = stopped.registers().rsp - 64;
        let call = Call::made(libc::SYS_readlink, &[path.at(0), memory, 3]);
        let link = Link {
            path: String::new(),
            place: memory,
            len: 3,
        };
        link.answer(stopped.pid, &call, "text");
        assert_eq!(stopped.registers().rax, 3);
        link.answer_status(stopped.pid, &call);
        assert_eq!(stopped.registers().rax, 0);
    }
}
