//! Calls in which the threads of a program wait, as the system lists them.

use std::fs;
use std::path::PathBuf;

/// The event for which a thread waits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Wait {
    /// Bytes of this file.
    Read(PathBuf),
    /// Room for bytes in this file.
    Write(PathBuf),
    /// A change of the modem lines of this terminal.
    ModemLine(PathBuf),
    /// The end of the output of this terminal.
    Drain(PathBuf),
    /// Any of several files.
    Any {
        /// Whether the wait has no timeout.
        for_ever: bool,
    },
    /// A time.
    Sleep,
    /// Another thread, or a signal.
    Lock,
}

/// A system call, by its number on one kind of processor.
#[derive(Clone, Copy)]
enum Call {
    Read,
    Write,
    Ioctl,
    /// Index of the timeout among the arguments, and the value that means no timeout.
    Any(usize, u64),
    Sleep,
    Lock,
    /// The end of another process; such a process does not use ports itself.
    Child,
}

/// The value for no timeout of `poll` and `epoll_wait`, an `int`.
const NEVER: u64 = 0xFFFF_FFFF;

#[cfg(target_arch = "x86_64")]
const CALLS: [(u64, Call); 24] = [
    (0, Call::Read),
    (19, Call::Read),
    (43, Call::Read),
    (45, Call::Read),
    (47, Call::Read),
    (288, Call::Read),
    (1, Call::Write),
    (20, Call::Write),
    (16, Call::Ioctl),
    (7, Call::Any(2, NEVER)),
    (23, Call::Any(4, 0)),
    (232, Call::Any(3, NEVER)),
    (281, Call::Any(3, NEVER)),
    (270, Call::Any(4, 0)),
    (271, Call::Any(2, 0)),
    (441, Call::Any(3, 0)),
    (35, Call::Sleep),
    (230, Call::Sleep),
    (202, Call::Lock),
    (34, Call::Lock),
    (128, Call::Lock),
    (130, Call::Lock),
    (61, Call::Child),
    (247, Call::Child),
];

#[cfg(not(target_arch = "x86_64"))]
const CALLS: [(u64, Call); 19] = [
    (63, Call::Read),
    (65, Call::Read),
    (202, Call::Read),
    (207, Call::Read),
    (212, Call::Read),
    (242, Call::Read),
    (64, Call::Write),
    (66, Call::Write),
    (29, Call::Ioctl),
    (22, Call::Any(3, NEVER)),
    (72, Call::Any(4, 0)),
    (73, Call::Any(2, 0)),
    (441, Call::Any(3, 0)),
    (101, Call::Sleep),
    (115, Call::Sleep),
    (98, Call::Lock),
    (133, Call::Lock),
    (260, Call::Child),
    (95, Call::Child),
];

/// `TIOCMIWAIT`, and `TCSBRK`, which `tcdrain` uses.
const MODEM_WAIT: u64 = 0x545C;
const DRAIN: u64 = 0x5409;

/// Waits of all threads of `pids`. Processes that only wait for their child are omitted, and so are
/// running threads and threads without information.
pub(crate) fn waits(pids: impl IntoIterator<Item = u32>) -> Vec<Wait> {
    let threads = |pid: u32| {
        let tasks = fs::read_dir(format!("/proc/{pid}/task"));
        tasks.into_iter().flatten().flatten()
    };
    let mut waits = Vec::new();
    for pid in pids {
        for task in threads(pid) {
            let call = fs::read_to_string(task.path().join("syscall")).unwrap_or_default();
            let file = |number: u64| fs::read_link(format!("/proc/{pid}/fd/{number}")).ok();
            waits.extend(wait_of(&call, file));
        }
    }
    waits
}

/// Meaning of a line of `/proc/PID/syscall`: the number of the call and its arguments.
fn wait_of(line: &str, file: impl Fn(u64) -> Option<PathBuf>) -> Option<Wait> {
    let mut words = line.split_ascii_whitespace();
    let number: u64 = words.next()?.parse().ok()?;
    let hex = |word: &str| u64::from_str_radix(word.trim_start_matches("0x"), 16).ok();
    let arguments: Vec<u64> = words.map_while(hex).collect();
    let (_, call) = CALLS.iter().find(|(known, _)| *known == number)?;
    let first = || file(*arguments.first()?);
    match *call {
        Call::Read => first().map(Wait::Read),
        Call::Write => first().map(Wait::Write),
        Call::Ioctl => match arguments.get(1)? & NEVER {
            MODEM_WAIT => first().map(Wait::ModemLine),
            DRAIN => first().map(Wait::Drain),
            _ => None,
        },
        Call::Any(place, never) => {
            let mask = if never == NEVER { NEVER } else { u64::MAX };
            let for_ever = arguments.get(place)? & mask == never;
            Some(Wait::Any { for_ever })
        }
        Call::Sleep => Some(Wait::Sleep),
        Call::Lock => Some(Wait::Lock),
        Call::Child => None,
    }
}

#[cfg(test)]
#[cfg(target_arch = "x86_64")]
mod tests {
    use super::*;

    /// Lines as Linux writes them; numbers and arguments are those of the manual pages of the
    /// calls.
    #[test]
    fn calls_are_told_by_their_numbers_and_their_timeouts_by_their_place() {
        let file = |number: u64| Some(PathBuf::from(format!("/dev/pts/{number}")));
        let of = |line: &str| wait_of(line, file);
        let port = || PathBuf::from("/dev/pts/3");
        let any = |for_ever| Some(Wait::Any { for_ever });
        assert_eq!(
            of("0 0x3 0x7ffd 0x40 0x0 0x0 0x0 0x7f 0x7e"),
            Some(Wait::Read(port()))
        );
        assert_eq!(
            of("16 0x3 0x545c 0x60 0x0 0x0 0x0 0x7f 0x7e"),
            Some(Wait::ModemLine(port()))
        );
        assert_eq!(
            of("7 0x7ffd 0x1 0xffffffff 0x0 0x0 0x0 0x7f 0x7e"),
            any(true)
        );
        assert_eq!(of("7 0x7ffd 0x1 0x3e8 0x0 0x0 0x0 0x7f 0x7e"), any(false));
        assert_eq!(of("270 0x6 0x7ffd 0x0 0x0 0x0 0x0 0x7f 0x7e"), any(true));
        assert_eq!(
            of("270 0x6 0x7ffd 0x0 0x0 0x7ffe 0x0 0x7f 0x7e"),
            any(false)
        );
        assert_eq!(
            of("230 0x1 0x0 0x7ffd 0x0 0x0 0x0 0x7f 0x7e"),
            Some(Wait::Sleep)
        );
        // For a child, in a call of another kind, and on the processor.
        for nothing in [
            "61 0xffffffff 0x0 0x0 0x0 0x0 0x0 0x7f 0x7e",
            "39 0x0",
            "running",
            "",
        ] {
            assert_eq!(of(nothing), None, "{nothing}");
        }
    }
}
