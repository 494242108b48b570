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
