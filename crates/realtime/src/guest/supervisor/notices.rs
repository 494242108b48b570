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

#[cfg(test)]
mod tests {
    use std::os::fd::AsRawFd as _;

    use super::*;
    use crate::guest::pending::Pending;
    use crate::guest::supervisor::tests::Bench;
    use crate::guest::tests::{Room, Stopped};

    impl Notice {
        /// To a process, by SIGIO.
        pub(in crate::guest::supervisor) const fn default_of(owner: i32) -> Self {
            Self { owner, signal: 0 }
        }
    }

    /// fcntl(2): F_SETFL with O_ASYNC begins it; F_SETOWN and F_SETOWN_EX say where signals go,
    /// F_SETSIG which.
    #[test]
    fn a_file_tells_of_itself_by_a_signal() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let sets = |bench: &mut Bench, request: i32, argument: u64| {
            let args = [5, u64::from(request.unsigned_abs()), argument];
            bench
                .supervisor
                .sets_notice(tid, &Call::made(libc::SYS_fcntl, &args));
            let notice = bench.supervisor.notices.get(&(tid, 5));
            notice.map(|it| (it.owner, it.signal))
        };
        let is_async = u64::from(libc::O_ASYNC.unsigned_abs());
        assert_eq!(sets(&mut bench, libc::F_SETFL, !is_async), None);
        assert!(!bench.supervisor.hears_by_signal);
        assert_eq!(sets(&mut bench, libc::F_SETFL, is_async), Some((tid, 0)));
        assert!(bench.supervisor.hears_by_signal);
        assert_eq!(sets(&mut bench, libc::F_SETOWN, 77), Some((77, 0)));
        assert_eq!(sets(&mut bench, libc::F_SETOWN, u64::MAX), Some((-1, 0)));
        assert_eq!(sets(&mut bench, F_SETSIG, 40), Some((-1, 40)));
        assert_eq!(sets(&mut bench, libc::F_SETFL, is_async), Some((-1, 40)));
        bench.add(1_000_001, tid, super::super::State::Running);
        // A thread, a process, a group: 0, 1, 2, and the number.
        for (kind, id, expected) in [
            (0, 1_000_001, tid),
            (0, 88, 88),
            (1, 88, 88),
            (2, 88, -88),
            (2, i32::MIN, 0),
        ] {
            let owner = Room::of(&[i32::to_ne_bytes(kind), id.to_ne_bytes()].concat());
            let set = sets(&mut bench, F_SETOWN_EX, owner.at(0));
            assert_eq!(set, Some((expected, 40)), "{kind} {id}");
        }
        assert_eq!(sets(&mut bench, libc::F_GETFL, 0), Some((0, 40)));
    }

    #[test]
    fn fioasync_is_the_same_by_ioctl() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let (on, off) = (Room::of_words(&[1]), Room::of_words(&[0]));
        let mut sets = |request, argument| {
            let call = Call::made(libc::SYS_ioctl, &[5, request, argument]);
            bench.supervisor.sets_notice_by_ioctl(tid, &call);
            bench.supervisor.hears_by_signal
        };
        assert!(!sets(0x5452, off.at(0)) && !sets(0x5451, on.at(0)) && !sets(0x5452, 8));
        assert!(sets(0x5452, on.at(0)));
    }

    /// A process with a port is told when bytes come, by SIGURG in this test, which does nothing
    /// without a handler (signal(7)).
    #[test]
    fn bytes_of_a_port_are_told_to_its_owner() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let (tid, fd) = (bench.tid, port.as_raw_fd());
        let stopped = Stopped::new();
        let other = stopped.pid.as_raw();
        bench.add(other, other, super::super::State::Running);
        let notice = Notice {
            owner: other,
            signal: libc::SIGURG,
        };
        bench.supervisor.notices.insert((tid, fd), notice);
        let pending = || Pending::of(other, other).common & 1 << 22 != 0;
        bench.brings(1);
        bench.supervisor.tell_arrivals();
        assert!(!bench.supervisor.is_signalled, "no file tells of itself");
        bench.supervisor.hears_by_signal = true;
        bench.supervisor.tell_arrivals();
        assert!(
            bench.supervisor.is_signalled && !pending(),
            "without O_ASYNC"
        );
        // The kernel keeps the flag where there is an owner.
        let flags = fcntl_getfl(&port).expect("open");
        let flags = flags | rustix::fs::OFlags::from_bits_retain(libc::O_ASYNC.unsigned_abs());
        rustix::fs::fcntl_setfl(&port, flags).expect("open");
        bench.supervisor.tell_arrivals();
        assert!(!pending(), "nothing new has come");
        bench.brings(9);
        bench.supervisor.tell_arrivals();
        assert!(pending());
    }

    #[test]
    fn a_signal_goes_to_its_owner_or_its_group() {
        let mut bench = Bench::new();
        let all = [
            Stopped::in_group_of_its_own(),
            Stopped::in_group_of_its_own(),
        ];
        let pids = all.each_ref().map(|it| it.pid.as_raw());
        for pid in pids {
            bench.add(pid, pid, super::super::State::Running);
        }
        let mut sends = |owner: i32, signal: i32| {
            bench.supervisor.send_notice(Notice { owner, signal }, 5);
            let bit = 1_u64 << (signal - 1);
            (
                pids.map(|pid| Pending::of(pid, pid).common & bit != 0),
                bench.supervisor.sent_notices.clone(),
            )
        };
        assert_eq!(sends(pids[0], libc::SIGURG), ([true, false], vec![]));
        assert_eq!(sends(-pids[1], libc::SIGWINCH), ([false, true], vec![]));
        assert_eq!(sends(-pids[1], 34), ([false, true], vec![(pids[1], 34, 5)]));
        assert_eq!(
            sends(1, libc::SIGCHLD).0,
            [false, false],
            "to none of others"
        );
        assert_eq!(sends(0, libc::SIGCHLD).0, [false, false]);
        assert!(bench.supervisor.notes().is_empty());
        bench.supervisor.send_notice(
            Notice {
                owner: 1,
                signal: 99,
            },
            5,
        );
        assert_eq!(
            bench.supervisor.notes(),
            ["signal 99 of a port is not sent"]
        );
        // sigaction(2): POLL_IN is 1, at si_code; si_band 0x41 at 16, si_fd at 24.
        assert_eq!(bench.supervisor.told_by_notice(pids[0], 34), None);
        assert_eq!(bench.supervisor.told_by_notice(pids[1], 35), None);
        let told = bench
            .supervisor
            .told_by_notice(pids[1], 34)
            .expect("it was sent");
        let mut expected = [0; 128];
        (expected[0], expected[8], expected[16], expected[24]) = (34, 1, 0x41, 5);
        assert_eq!(told, expected);
        assert_eq!(bench.supervisor.told_by_notice(pids[1], 34), None);
    }

    #[test]
    fn a_copy_of_a_file_goes_on_telling() {
        let mut bench = Bench::new();
        let (tid, own) = (bench.tid, std::process::id().cast_signed());
        let file = std::fs::File::options()
            .append(true)
            .open("/dev/null")
            .expect("it is there");
        let fd = file.as_raw_fd();
        let notice = Notice {
            owner: tid,
            signal: 0,
        };
        bench.supervisor.notices.insert((tid, fd), notice);
        bench.supervisor.forget_notice(tid, fd);
        assert!(bench.supervisor.notices.is_empty());
        bench.supervisor.notices.insert((tid, fd), notice);
        let copy = file.try_clone().expect("it is open");
        bench.supervisor.forget_notice(tid, fd);
        let left: Vec<(i32, i32)> = bench.supervisor.notices.keys().copied().collect();
        assert_eq!(left, [(tid, copy.as_raw_fd())]);
        bench.supervisor.forget_notice(-7, fd);
        let (path, flags) = look_of(own, fd).expect("it is open");
        assert_eq!(path.to_str(), Some("/dev/null"));
        let flags = flags.cast_signed();
        assert_eq!(flags & libc::O_ACCMODE, libc::O_WRONLY);
        assert!(flags & libc::O_APPEND != 0 && flags & libc::O_CLOEXEC == 0);
        assert_eq!(look_of(own, 9_999), None);
    }
}
