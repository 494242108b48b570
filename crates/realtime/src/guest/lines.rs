//! Modem lines in real time: a program runs at its own speed. It is stopped where it asks a port
//! for a line that a pseudo-terminal does not have. The rig answers over its control socket.
//!
//! ```text
//!  thread: ioctl(TIOCMBIC) --stop--> this one --{"do":"modem",..}--> rig: lidar-dtr goes low
//!                        <-answer--           <------ {"ok":true,..}
//! ```

mod terminals;
mod waiters;

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ffi::OsString;
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use nix::libc;
use nix::sys::ptrace::{self, Options};
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use rustix::process::WaitOptions;
use serde_json::{Value, json};

use super::call::Call;
use super::high_signals::{Delivered, deliver};
use super::links::Link;
use super::memory::Memory;
use super::news::{group_of, is_death, is_stop, wait};
use super::{GuestError, launch};
use crate::control;
use crate::exec::{PORTS_VARIABLE, port_variable, terminal_of};
use crate::process::LINES_VARIABLE;
use crate::transport::Settings;
use terminals::Done;
use waiters::Waiter;

/// Maximum time for an answer of the rig; a rig that is just ending never answers.
const PATIENCE: Duration = Duration::from_secs(1);
/// Maximum time for the rig's first answer: the rig may have just started, on a busy machine.
const PATIENCE_FIRST: Duration = Duration::from_secs(10);
/// Bits of modem lines as in TIOCMGET, by their names in the rig's answer.
const BITS: [(&str, u32); 6] = [
    ("dtr", 0x002),
    ("rts", 0x004),
    ("cts", 0x020),
    ("dcd", 0x040),
    ("ri", RI),
    ("dsr", 0x100),
];
const RI: u32 = 0x080;

/// Runs a program and its arguments with modem lines on the ports of the rig in `dir`. Returns its
/// exit code as a shell reports it. The program's output goes to `speaks`.
///
/// # Errors
/// If no rig answers there, or the program cannot be started or traced.
pub fn run_with_lines(dir: &Path, command: &[OsString], speaks: Stdio) -> Result<u8, GuestError> {
    let no_rig = |source| GuestError::NoRig {
        dir: dir.to_owned(),
        source,
    };
    if std::env::var_os(LINES_VARIABLE).is_some_and(|has| Path::new(&has) == dir) {
        return run_plain(command, speaks);
    }
    let mut tracer = Tracer {
        rig: Some(Rig::find(dir).map_err(no_rig)?),
        ports: ports_in(dir).map_err(no_rig)?,
        dir: dir.to_owned(),
        lines: BTreeMap::new(),
        waiting: 0,
        settings: BTreeMap::new(),
        serial_flags: BTreeMap::new(),
        known: BTreeSet::new(),
        waiters: BTreeMap::new(),
        halted: BTreeSet::new(),
        fatal: BTreeMap::new(),
        ended: VecDeque::new(),
    };
    let mut env = vec![
        (PORTS_VARIABLE.to_owned(), dir.into()),
        (LINES_VARIABLE.to_owned(), dir.into()),
    ];
    for name in tracer.ports.values() {
        env.push((port_variable(name), dir.join(name).into()));
        env.extend(terminal_of(name, &dir.join(name)));
    }
    // The program is in the same process group, so its own reaction to such a signal counts.
    let _ = launch::requests_to_end().thread_block();
    let not_started = |error: io::Error| GuestError::NotLaunched(error.to_string());
    let root = launch::start_with_lines(command, &env, speaks).map_err(not_started)?;
    let root = i32::try_from(root.id()).unwrap_or_default();
    let status = tracer.follow(root)?;
    Ok(code_of(status))
}

/// The exit code that a shell reports for the system's status.
fn code_of(status: i32) -> u8 {
    match status & 0x7F {
        0 => u8::try_from(status >> 8 & 0xFF).unwrap_or(1),
        signal => u8::try_from(128 + signal).unwrap_or(1),
    }
}

/// Runs the command unchanged: the supervisor that started this process provides the modem lines.
fn run_plain(command: &[OsString], speaks: Stdio) -> Result<u8, GuestError> {
    let [program, words @ ..] = command else {
        return Ok(0);
    };
    let ended = Command::new(program).args(words).stdout(speaks).status();
    let not_started =
        |error: io::Error| GuestError::NotLaunched(format!("{}: {error}", program.display()));
    Ok(code_of(ended.map_err(not_started)?.into_raw()))
}

/// Runs a shell command with modem lines on the ports of the rig that started this process; where a
/// program cannot be traced, it has no modem lines.
pub fn become_shell_with_lines(command: OsString) -> ExitCode {
    let shell: [OsString; 3] = ["/bin/sh".into(), "-c".into(), command];
    let dir = std::env::var_os(PORTS_VARIABLE).unwrap_or_default();
    match run_with_lines(Path::new(&dir), &shell, Stdio::inherit()) {
        Ok(code) => ExitCode::from(code),
        Err(_) => {
            let _ = launch::requests_to_end().thread_unblock();
            let [shell, words @ ..] = &shell;
            let error = Command::new(shell).args(words).exec();
            eprintln!("/bin/sh: {error}");
            ExitCode::from(launch::NOT_LAUNCHED_CODE)
        }
    }
}

/// The ports in a directory: device numbers and names.
fn ports_in(dir: &Path) -> io::Result<BTreeMap<u64, String>> {
    let mut ports = BTreeMap::new();
    for entry in std::fs::read_dir(dir)?.flatten() {
        let data = std::fs::metadata(entry.path());
        if let Ok(data) = data.as_ref()
            && data.file_type().is_char_device()
        {
            ports.insert(
                data.rdev(),
                entry.file_name().to_string_lossy().into_owned(),
            );
        }
    }
    Ok(ports)
}

/// Whether a device number is that of the client's end of a pseudo-terminal.
fn is_pseudo_terminal(device: u64) -> bool {
    matches!(rustix::fs::major(device), 136..=143)
}

/// The rig, by its control socket.
struct Rig(BufReader<UnixStream>);

impl Rig {
    fn find(dir: &Path) -> io::Result<Self> {
        let stream = UnixStream::connect(dir.join(control::NAME))?;
        stream.set_read_timeout(Some(PATIENCE_FIRST))?;
        let mut rig = Self(BufReader::new(stream));
        // From now on each opening of a port raises its lines.
        rig.ask(&json!({"do": "modem"}))?;
        rig.0.get_ref().set_read_timeout(Some(PATIENCE))?;
        Ok(rig)
    }

    fn ask(&mut self, request: &Value) -> io::Result<Value> {
        writeln!(self.0.get_mut(), "{request}")?;
        let mut line = String::new();
        self.0.read_line(&mut line)?;
        Ok(serde_json::from_str(&line)?)
    }
}

/// Follows all threads of a program.
struct Tracer {
    /// The rig; `None` after it has stopped answering.
    rig: Option<Rig>,
    ports: BTreeMap<u64, String>,
    dir: PathBuf,
    /// Settings made by clients, by the port's device number.
    settings: BTreeMap<u64, Settings>,
    serial_flags: BTreeMap<u64, u32>,
    /// Number of bytes that wait for the line, at the port of the last request.
    waiting: u64,
    /// The last known levels of the lines of each port.
    lines: BTreeMap<String, u32>,
    /// Known threads.
    known: BTreeSet<i32>,
    /// Threads that wait for a line to change.
    waiters: BTreeMap<i32, Waiter>,
    /// Threads that a signal has stopped.
    halted: BTreeSet<i32>,
    /// Processes that are killed in place of a signal above 31, with that signal.
    fatal: BTreeMap<i32, i32>,
    /// Ends of threads that were reported while the tracer worked on these threads.
    ended: VecDeque<(i32, i32)>,
}

impl Tracer {
    /// Follows the launcher `root` to its end; returns the system's status.
    fn follow(&mut self, root: i32) -> Result<i32, GuestError> {
        let first = wait(Some(Pid::from_raw(root)), WaitOptions::empty());
        if first.is_none_or(|(_, status)| is_death(status)) {
            return Err(GuestError::NotTraced);
        }
        let options = Options::PTRACE_O_TRACESECCOMP
            | Options::PTRACE_O_TRACECLONE
            | Options::PTRACE_O_TRACEFORK
            | Options::PTRACE_O_TRACEVFORK
            | Options::PTRACE_O_TRACEEXEC
            | Options::PTRACE_O_TRACESYSGOOD;
        let pid = Pid::from_raw(root);
        ptrace::setoptions(pid, options).map_err(|_| GuestError::NotTraced)?;
        self.known.insert(root);
        let _ = ptrace::cont(pid, None);
        while let Some((tid, status)) = self.next_news() {
            if is_death(status) {
                self.known.remove(&tid);
                self.waiters.remove(&tid);
                self.halted.remove(&tid);
                let fatal = self.fatal.remove(&tid);
                if tid == root {
                    return Ok(fatal.unwrap_or(status));
                }
                continue;
            }
            let is_new = self.known.insert(tid);
            let signal = (status >> 8) & 0xFF;
            let pid = Pid::from_raw(tid);
            let passed = match status >> 16 {
                libc::PTRACE_EVENT_SECCOMP => {
                    if self.called(pid) {
                        continue;
                    }
                    None
                }
                // A new thread begins with a stop signal of the kernel, not of another process.
                0 if is_new && signal == libc::SIGSTOP => None,
                0 if is_stop(signal) && ptrace::getsiginfo(pid).is_err() => {
                    // The thread stays stopped until a signal continues it.
                    self.halted.insert(tid);
                    continue;
                }
                0 => match Signal::try_from(signal) {
                    Ok(signal) => Some(signal),
                    Err(_) => self.high_signal(pid, signal),
                },
                _ => None,
            };
            let _ = ptrace::cont(pid, passed);
        }
        Ok(0)
    }

    /// Delivers a signal above 31; returns the signal with which the thread must continue.
    fn high_signal(&mut self, pid: Pid, signal: i32) -> Option<Signal> {
        let process = group_of(pid.as_raw()).unwrap_or(pid.as_raw());
        match deliver(process, pid, signal, None) {
            Delivered::Fatal => {
                self.fatal.insert(process, signal);
                Some(Signal::SIGKILL)
            }
            Delivered::Ended(status) => {
                self.ended.push_back((pid.as_raw(), status));
                None
            }
            Delivered::Goes | Delivered::Refused => None,
        }
    }

    /// Answers a call about a line if its file is a port; returns whether the thread must wait.
    fn called(&mut self, pid: Pid) -> bool {
        let Ok(call) = Call::of(pid) else {
            return false;
        };
        if ptrace::getevent(pid) == Ok(launch::OTHER_ARCHITECTURE.into()) {
            return false;
        }
        if matches!(call.number, libc::SYS_clone | libc::SYS_clone3) {
            launch::show_child(pid, &call);
            return false;
        }
        if matches!(call.number, libc::SYS_lstat | libc::SYS_newfstatat) {
            let link = Link::of(pid, &call);
            if let Some((device, _)) = link.unlisted_terminal()
                && self.ports.contains_key(&device)
            {
                link.answer_status(pid, &call);
            }
            return false;
        }
        if matches!(call.number, libc::SYS_readlink | libc::SYS_readlinkat) {
            let link = Link::of(pid, &call);
            if let Some((device, text)) = link.unlisted_terminal()
                && self.ports.contains_key(&device)
            {
                link.answer(pid, &call, &text);
            }
            return false;
        }
        let [fd, request, argument, ..] = call.args;
        let Some((device, port)) = self.port_at(pid, fd) else {
            return false;
        };
        let file = terminals::copy_of(pid, fd);
        if file.as_ref().is_none_or(terminals::is_hung_up) {
            // The kernel rejects all requests at this file.
            return false;
        }
        if let Some(file) = file
            && terminals::is_one(request, argument)
        {
            return match self.about_terminal(pid, &call, (device, &port), &file) {
                Done::ByKernel => false,
                Done::Later => {
                    self.insert_waiter(pid, Waiter::for_sent(call, device, port));
                    true
                }
                Done::With(result) => {
                    let _ = call.answer(pid, result);
                    false
                }
            };
        }
        if request == launch::TIOCMIWAIT {
            let lines = self.ask(&port, &json!({"do": "modem", "port": port}));
            self.insert_waiter(pid, Waiter::for_line(call, device, port, lines, argument));
            return true;
        }
        if let Some(done) = self.change(Memory(pid), &port, request, argument) {
            let result = done.map_or_else(|errno| -i64::from(errno as i32), |()| 0);
            let _ = call.answer(pid, result);
        }
        false
    }

    /// The port behind a file, and its device number.
    fn port_at(&mut self, pid: Pid, fd: u64) -> Option<(u64, String)> {
        let data = std::fs::metadata(format!("/proc/{pid}/fd/{fd}")).ok()?;
        let device = data.rdev();
        if !self.ports.contains_key(&device) && is_pseudo_terminal(device) {
            // A port whose plug was out has come back with another device number.
            self.ports = ports_in(&self.dir).unwrap_or_default();
        }
        Some((device, self.ports.get(&device)?.clone()))
    }

    fn insert_waiter(&mut self, pid: Pid, waiter: Waiter) {
        self.waiters.insert(pid.as_raw(), waiter);
    }

    /// Changes modem lines; `None` if the kernel must execute the request.
    fn change(
        &mut self,
        memory: Memory,
        port: &str,
        request: u64,
        argument: u64,
    ) -> Option<nix::Result<()>> {
        let word = || memory.u32(argument);
        let wish = |lines: nix::Result<u32>, is: Option<bool>| {
            let wish = |bit| match is {
                Some(is) => lines.map(|lines| (lines & bit != 0).then_some(is)),
                None => lines.map(|lines| Some(lines & bit != 0)),
            };
            Ok(json!({"do": "modem", "port": port, "dtr": wish(0x002)?, "rts": wish(0x004)?}))
        };
        let wish = match request {
            libc::TIOCMGET => Ok(json!({"do": "modem", "port": port})),
            libc::TIOCMBIS => wish(word(), Some(true)),
            libc::TIOCMBIC => wish(word(), Some(false)),
            libc::TIOCMSET => wish(word(), None),
            libc::TIOCCBRK => return Some(Ok(())),
            // The counts of a driver are not known here.
            launch::TIOCGICOUNT => return Some(memory.write(argument, &[0; 80])),
            _ => Ok(json!({"do": "modem", "port": port, "break": true})),
        };
        let wish = match wish {
            Ok(wish) => wish,
            Err(errno) => return Some(Err(errno)),
        };
        let lines = self.ask(port, &wish);
        Some(match request {
            libc::TIOCMGET => memory.write(argument, &lines.to_ne_bytes()),
            _ => Ok(()),
        })
    }

    /// The levels of the lines of `port` after `wish`.
    fn ask(&mut self, port: &str, wish: &Value) -> u32 {
        let answer = self.rig.as_mut().map(|rig| rig.ask(wish));
        match answer {
            Some(Ok(answer)) => {
                let is_on = |&&(name, _): &&(&str, u32)| answer[name] == true;
                let lines = BITS.iter().filter(is_on).map(|(_, bit)| bit).sum();
                self.lines.insert(port.to_owned(), lines);
                self.waiting = answer["waiting"].as_u64().unwrap_or(0);
            }
            // The program does not wait for a rig that has ended.
            _ => (self.rig, self.waiting) = (None, 0),
        }
        self.lines.get(port).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests;
