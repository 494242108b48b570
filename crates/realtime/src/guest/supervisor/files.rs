//! The files behind file descriptors: the supervisor examines its own copies.
//!
//! The supervisor keeps a copy until the program closes the file or puts another file at its
//! number. These calls are stopped but take no virtual time. A copy that outlives the file would
//! hide the end of a pipe and the closing of a port.

use std::os::fd::{AsFd, AsRawFd as _, OwnedFd};
use std::sync::Arc;

use nix::libc;
use nix::unistd::Pid;
use rustix::fs::{FileType, fstat};
use rustix::process::{PidfdFlags, PidfdGetfdFlags, pidfd_getfd, pidfd_open};

use super::clocks::low_i32;
use super::{Memory, Outcome, Supervisor};
use crate::guest::call::Call;
use crate::guest::launch::KEPT_BELOW;
pub(super) use crate::guest::open_file::{EVENT, File, Form, Kind};

impl Supervisor {
    /// The file `fd` of the process of `tid`.
    pub(super) fn file(&mut self, tid: i32, fd: i32) -> Option<Arc<File>> {
        let pid = self.threads.get(&tid)?.process;
        // A negative number is no file, and would be rejected below.
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
        let known = self.kind(&fd);
        if let (Kind::Port(_), ..) = known {
            self.uses_port_for_debugger(pid);
        }
        let file = Arc::new(File::new(fd, known));
        if number < KEPT_BELOW.cast_signed()
            && let Some(process) = self.processes.get_mut(&pid)
        {
            process.files.insert(number, Arc::clone(&file));
        }
        Some(file)
    }

    /// Drops the copies of files that the program is about to close or replace.
    pub(super) fn lets_go(&mut self, tid: i32, call: &Call) {
        self.stage.stir();
        // A terminal that hangs up sends a signal.
        self.is_signalled |= self.has_terminals;
        let [first, second, ..] = call.args.map(low_i32);
        let gone = match call.number {
            libc::SYS_close => first..=first,
            // If both numbers are equal, or the first is not open, no file is closed.
            libc::SYS_dup2 | libc::SYS_dup3 if first == second || !self.is_open(tid, first) => {
                return;
            }
            libc::SYS_dup2 | libc::SYS_dup3 => second..=second,
            _ => 0..=i32::MAX,
        };
        // In all processes: some share their table of files.
        for process in self.processes.values_mut() {
            process.files.retain(|fd, _| !gone.contains(fd));
        }
        if call.number != libc::SYS_close_range {
            self.forget_timer(tid, *gone.start());
            self.forget_notice(tid, *gone.start());
        }
    }

    fn is_open(&self, tid: i32, fd: i32) -> bool {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        process.is_some_and(|pid| std::fs::read_link(format!("/proc/{pid}/fd/{fd}")).is_ok())
    }

    /// Drops all copies, and passes the bytes of all ports to the kernel, before a call that the
    /// supervisor does not understand.
    pub(super) fn lets_all_go(&mut self) {
        for process in self.processes.values_mut() {
            process.files.clear();
        }
        self.has_signal_files = true;
        self.stage.release_all();
    }

    /// Passes the bytes of a port to the kernel, before a call that reads them there.
    pub(super) fn lets_kernel_read(&mut self, tid: i32, call: &Call) {
        self.stage.stir();
        let Some(fd) = read_by_kernel(call) else {
            return;
        };
        if let Some(Kind::Port(port)) = self.file(tid, fd).map(|file| file.kind) {
            self.stage.release(port);
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

    fn kind(&self, fd: &OwnedFd) -> (Kind, Form, Option<u64>) {
        let Ok(stat) = fstat(fd) else {
            return (Kind::Prompt, Form::Other, None);
        };
        let (kind, form) = match FileType::from_raw_mode(stat.st_mode) {
            FileType::CharacterDevice => {
                let device = stat.st_rdev;
                return (self.device_kind(device), Form::Other, Some(device));
            }
            FileType::RegularFile => {
                let told = self.told_file(fd).map_or(Kind::Prompt, Kind::Told);
                (told, Form::Other)
            }
            FileType::Directory | FileType::BlockDevice | FileType::Symlink => {
                (Kind::Prompt, Form::Other)
            }
            _ if (stat.st_dev, stat.st_ino) == self.stage.mouth => (Kind::Mouth, Form::Pipe),
            FileType::Fifo => (Kind::Stream, Form::Pipe),
            FileType::Socket => (Kind::Stream, Form::Socket),
            _ => {
                let entry = std::fs::read_link(format!("/proc/self/fd/{}", fd.as_raw_fd()));
                let entry = entry.unwrap_or_default();
                match Form::of_nameless(&entry.to_string_lossy()) {
                    Form::Other => (Kind::Prompt, Form::Other),
                    form if entry.ends_with("anon_inode:[signalfd]") => (Kind::Signals, form),
                    form => (Kind::Stream, form),
                }
            }
        };
        (kind, form, None)
    }

    /// Opens a file. Files with data about the outside world are reported in a note.
    pub(super) fn open(&mut self, tid: i32, call: &Call) -> Outcome {
        let address = match call.number {
            libc::SYS_open => call.args[0],
            _ => call.args[1],
        };
        let path = Memory(Pid::from_raw(tid)).text(address);
        self.looks_into(&path);
        self.has_terminals |= path.ends_with("/ptmx");
        self.stage.touch();
        if self.is_refused(tid, call, &path) {
            return nix::errno::Errno::EBUSY.into();
        }
        self.open_fifo(tid, call, &path)
    }
}

/// The numbers of the open files of a process.
pub(super) fn numbers(pid: i32) -> impl Iterator<Item = i32> {
    let files = std::fs::read_dir(format!("/proc/{pid}/fd"));
    let numbers = files.into_iter().flatten().flatten();
    numbers.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}

/// The system's value `name` of an open file (proc(5)).
pub(super) fn told_of(pid: i32, fd: i32, name: &str) -> Option<String> {
    let info = std::fs::read_to_string(format!("/proc/{pid}/fdinfo/{fd}")).ok()?;
    let mut lines = info.lines();
    let line = lines.find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    Some(line.trim().to_owned())
}

/// The file whose bytes the kernel itself reads or watches in a call.
fn read_by_kernel(call: &Call) -> Option<i32> {
    let [first, second, third, ..] = call.args.map(low_i32);
    match call.number {
        libc::SYS_preadv2 | libc::SYS_splice => Some(first),
        libc::SYS_sendfile => Some(second),
        libc::SYS_epoll_ctl if second != libc::EPOLL_CTL_DEL => Some(third),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told, fd};
    use crate::guest::tests::Room;

    /// What the supervisor makes of a file, and whether it keeps a copy.
    fn kind_of(bench: &mut Bench, file: &impl AsFd) -> (Kind, Form) {
        let (tid, fd) = (bench.tid, file.as_fd().as_raw_fd());
        // Tests close files without a stop.
        bench.process().files.clear();
        let file = bench.supervisor.file(tid, fd).expect("it is open");
        assert_eq!(bench.process().files.contains_key(&fd), fd < 256);
        (file.kind, file.form)
    }

    #[test]
    fn files_are_of_the_kind_that_the_system_tells() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        assert_eq!(kind_of(&mut bench, &port), (Kind::Port(0), Form::Other));
        let open = |path: &str| std::fs::File::open(path).expect("each system has it");
        for (path, kind) in [
            ("/dev/null", Kind::Prompt),
            ("/dev/zero", Kind::Prompt),
            ("/dev/random", Kind::Chance),
            ("/dev/urandom", Kind::Chance),
            ("/dev/ptmx", Kind::Stream),
            ("/proc/self/maps", Kind::Prompt),
            ("/", Kind::Prompt),
        ] {
            assert_eq!(
                kind_of(&mut bench, &open(path)),
                (kind, Form::Other),
                "{path}"
            );
        }
        let (ears, mouth) = std::io::pipe().expect("the system has pipes");
        assert_eq!(kind_of(&mut bench, &ears), (Kind::Stream, Form::Pipe));
        assert_eq!(kind_of(&mut bench, &mouth), (Kind::Stream, Form::Pipe));
        let (one, _other) = std::os::unix::net::UnixStream::pair().expect("and sockets");
        assert_eq!(kind_of(&mut bench, &one), (Kind::Stream, Form::Socket));
        let counter = rustix::event::eventfd(0, rustix::event::EventfdFlags::empty());
        let counter = counter.expect("and counters");
        assert_eq!(kind_of(&mut bench, &counter), (Kind::Stream, Form::Counter));
        let set = rustix::event::epoll::create(rustix::event::epoll::CreateFlags::empty());
        assert_eq!(
            kind_of(&mut bench, &set.expect("and sets")),
            (Kind::Prompt, Form::Other)
        );
        let mask = nix::sys::signal::SigSet::empty();
        let signals = nix::sys::signalfd::SignalFd::new(&mask).expect("and files of signals");
        assert_eq!(kind_of(&mut bench, &signals), (Kind::Signals, Form::Events));
        let words = bench.mouth();
        assert_eq!(kind_of(&mut bench, &words), (Kind::Mouth, Form::Pipe));
    }

    #[test]
    fn a_number_without_a_file_is_none() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        for fd in [-1, -100, i32::MIN, i32::MAX] {
            assert!(bench.supervisor.file(tid, fd).is_none(), "{fd}");
        }
        let null = std::fs::File::open("/dev/null").expect("each system has it");
        assert!(bench.supervisor.file(-7, null.as_raw_fd()).is_none());
    }

    /// The copy of a file goes when the program closes it or puts another one in its place:
    /// close(2), dup(2), close_range(2).
    #[test]
    fn the_copy_of_a_file_goes_with_it() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let files = [(); 3].map(|()| std::fs::File::open("/dev/null").expect("it is there"));
        let own = files.each_ref().map(|file| file.as_raw_fd());
        let [a, b, c] = files.each_ref().map(fd);
        let cases: [(i64, &[u64], [bool; 3]); 8] = [
            (libc::SYS_close, &[a], [false, true, true]),
            (libc::SYS_close, &[c], [true, true, false]),
            (libc::SYS_dup2, &[a, b], [true, false, true]),
            (libc::SYS_dup3, &[b, a], [false, true, true]),
            (libc::SYS_dup2, &[a, a], [true; 3]),
            (libc::SYS_dup2, &[9_999, b], [true; 3]),
            (libc::SYS_dup3, &[9_999, b], [true; 3]),
            (libc::SYS_close_range, &[a, b, 0], [false; 3]),
        ];
        for (number, args, left) in cases {
            for fd in own {
                assert!(bench.supervisor.file(tid, fd).is_some());
            }
            bench.supervisor.lets_go(tid, &Call::made(number, args));
            let kept = own.map(|fd| bench.process().files.contains_key(&fd));
            assert_eq!(kept, left, "{number} {args:?}");
        }
        assert!(!bench.supervisor.is_signalled);
        bench.supervisor.has_terminals = true;
        bench
            .supervisor
            .lets_go(tid, &Call::made(libc::SYS_close, &[a]));
        assert!(
            bench.supervisor.is_signalled,
            "a terminal that hangs up sends a signal"
        );
        assert!(bench.supervisor.is_open(tid, own[0]) && !bench.supervisor.is_open(tid, 9_999));
    }

    /// preadv2(2), splice(2), sendfile(2), epoll_ctl(2): the argument that is read from.
    #[test]
    fn the_file_that_the_kernel_reads_is_known() {
        let of = |number, args: &[u64]| read_by_kernel(&Call::made(number, args));
        assert_eq!(of(libc::SYS_preadv2, &[3, 4, 5]), Some(3));
        assert_eq!(of(libc::SYS_splice, &[3, 0, 4]), Some(3));
        assert_eq!(of(libc::SYS_sendfile, &[3, 4, 5]), Some(4));
        assert_eq!(of(libc::SYS_epoll_ctl, &[3, 1, 5]), Some(5));
        assert_eq!(of(libc::SYS_epoll_ctl, &[3, 3, 5]), Some(5));
        assert_eq!(of(libc::SYS_epoll_ctl, &[3, 2, 5]), None, "it is taken out");
        assert_eq!(of(libc::SYS_tee, &[3, 4, 5]), None);
        assert_eq!(of(libc::SYS_pwritev2, &[3, 4, 5]), None);
    }

    /// From then on the kernel holds the bytes of that port.
    #[test]
    fn a_port_that_the_kernel_reads_is_handed_over() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let port = bench.opens("sonar");
        let holds = |bench: &mut Bench| {
            bench
                .supervisor
                .stage
                .terminal(0)
                .is_some_and(|it| it.holds())
        };
        let null = std::fs::File::open("/dev/null").expect("it is there");
        bench
            .supervisor
            .lets_kernel_read(tid, &Call::made(libc::SYS_splice, &[fd(&null)]));
        bench
            .supervisor
            .lets_kernel_read(tid, &Call::made(libc::SYS_tee, &[fd(&port)]));
        assert!(holds(&mut bench));
        bench
            .supervisor
            .lets_kernel_read(tid, &Call::made(libc::SYS_splice, &[fd(&port)]));
        assert!(!holds(&mut bench));
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        assert!(bench.supervisor.file(bench.tid, port.as_raw_fd()).is_some());
        bench.supervisor.lets_all_go();
        assert!(!holds(&mut bench) && bench.process().files.is_empty());
        assert!(bench.supervisor.has_signal_files);
    }

    #[test]
    fn an_opened_path_is_looked_at() {
        let mut bench = Bench::new();
        let open = |bench: &mut Bench, path: &str| {
            let path = Room::of(&[path.as_bytes(), &[0]].concat());
            assert_eq!(bench.calls(libc::SYS_open, &[path.at(0), 0]), Told::Kernel);
            assert_eq!(
                bench.calls(libc::SYS_openat, &[9, path.at(0), 0]),
                Told::Kernel
            );
        };
        open(&mut bench, "/nowhere");
        assert!(bench.supervisor.notes().is_empty() && !bench.supervisor.has_terminals);
        open(&mut bench, "/proc/stat");
        assert_eq!(bench.supervisor.notes(), ["reads /proc/stat"]);
        open(&mut bench, "/nowhere/ptmx");
        assert!(bench.supervisor.has_terminals);
    }

    /// proc(5): /proc/PID/fdinfo has "pos:", "flags:" in octal, and what is special to a file.
    #[test]
    fn the_system_tells_of_open_files() {
        let null = std::fs::File::open("/dev/null").expect("it is there");
        let own = std::process::id().cast_signed();
        let flags = told_of(own, null.as_raw_fd(), "flags").expect("each has some");
        let flags = i32::from_str_radix(&flags, 8).expect("octal");
        assert_eq!(flags & libc::O_ACCMODE, libc::O_RDONLY);
        assert_ne!(flags & libc::O_CLOEXEC, 0);
        assert_eq!(told_of(own, null.as_raw_fd(), "pos"), Some("0".to_owned()));
        assert_eq!(told_of(own, null.as_raw_fd(), "po"), None);
        assert_eq!(told_of(own, 9_999, "pos"), None);
        assert!(numbers(own).any(|fd| fd == null.as_raw_fd()));
        assert!(numbers(own).all(|fd| fd != 9_999) && numbers(-1).next().is_none());
    }
}
