//! A process with pipes: started in its own process group, written to and read from with a
//! wall-time limit, ended with all its children.
//!
//! A child that leaves the group (a daemon that starts its own session) cannot be ended and keeps
//! running.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::{self, JoinHandle};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::process::{Pid, Signal, kill_process_group};
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, timerfd_create, timerfd_settime,
};

use crate::error::{Ending, NodeError};
use crate::group;

/// Number of bytes of standard error that are kept, from its end.
const WORDS_MAX: usize = 64 << 10;
/// Maximum wait for the last output.
const LAST_WORDS: Duration = Duration::from_millis(500);
/// Maximum number of checks, 2 ms apart, whether all processes of a killed group have ended.
const GROUP_ENDS: usize = 250;
/// Interval between two checks whether a silent program has exited, or the rig must stop.
const SLICE: Duration = Duration::from_millis(100);

/// Whether the rig no longer waits for silent programs.
static STOPPED: AtomicBool = AtomicBool::new(false);

/// Ends current and later waits for silent programs within 100 ms. A program that answers at once
/// is not affected.
pub fn stop_waiting() {
    STOPPED.store(true, Ordering::Relaxed);
}

/// The result of waiting for a program.
enum Waited {
    /// The stream is ready.
    Ready,
    Exited,
    Silent,
    Stopped,
}

/// A stream of the program that the rig waits for.
#[derive(Clone, Copy)]
enum Stream {
    Input,
    Output,
}

/// A process that answers requests.
#[derive(Debug)]
pub struct Process {
    child: Option<Child>,
    group: Option<Pid>,
    stdin: Option<ChildStdin>,
    stdout: ChildStdout,
    /// Received bytes, and the offset of those that have not been consumed.
    came: (Vec<u8>, usize),
    words: Arc<Mutex<Vec<u8>>>,
    listener: Option<JoinHandle<()>>,
    limit: Duration,
    /// Becomes readable when the time for one request and its answer is over, independent of the
    /// number of chunks.
    alarm: OwnedFd,
    /// Number of waits for the current request and answer.
    waits: u32,
}

impl Process {
    /// Starts `command` with the shell in `folder`, with `env` added to its environment. `limit` is
    /// the timeout in wall time.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn start(
        command: &str,
        folder: Option<&Path>,
        env: &[(String, String)],
        limit: Duration,
    ) -> Result<Self, NodeError> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.is_dir();
        if let Some(folder) = folder.filter(is_missing) {
            let folder = folder.display();
            let message = format!("its folder {folder} is missing; correct the key \"folder\"");
            return Err(NodeError::NotStarted(message));
        }
        Self::try_start(command, folder, env, limit).map_err(|error| {
            let place = folder.map(|folder| format!(" in {}", folder.display()));
            NodeError::NotStarted(format!("{error}{}", place.unwrap_or_default()))
        })
    }

    fn try_start(
        command: &str,
        folder: Option<&Path>,
        env: &[(String, String)],
        limit: Duration,
    ) -> io::Result<Self> {
        let mut shell = Command::new("sh");
        shell
            .args(["-c", command])
            .envs(env.iter().map(|(name, value)| (name, value)))
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        if let Some(folder) = folder.filter(|folder| !folder.as_os_str().is_empty()) {
            shell.current_dir(folder);
        }
        let alarm = timerfd_create(TimerfdClockId::Monotonic, TimerfdFlags::CLOEXEC)?;
        let mut child = shell.spawn()?;
        let stream = || io::Error::other("a standard stream is missing");
        let stdin = child.stdin.take().ok_or_else(stream)?;
        let stdout = child.stdout.take().ok_or_else(stream)?;
        let stderr = child.stderr.take().ok_or_else(stream)?;
        let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        let words = Arc::default();
        let heard = Arc::clone(&words);
        let listener = thread::spawn(move || listen(stderr, &heard));
        let process = Self {
            child: Some(child),
            group,
            stdin: Some(stdin),
            stdout,
            came: (Vec::new(), 0),
            words,
            listener: Some(listener),
            limit,
            alarm,
            waits: 0,
        };
        if let Some(stdin) = &process.stdin {
            fcntl_setfl(stdin, fcntl_getfl(stdin)? | OFlags::NONBLOCK)?;
        }
        Ok(process)
    }

    /// Writes `bytes`, a part of the request `to`.
    ///
    /// # Errors
    /// If the program does not accept the bytes.
    pub fn write(&mut self, bytes: &[u8], to: &'static str) -> Result<(), NodeError> {
        let mut rest = bytes;
        while !rest.is_empty() {
            let Some(stdin) = &mut self.stdin else {
                return Err(self.gone("input", to));
            };
            match stdin.write(rest) {
                Ok(len) => rest = &rest[len..],
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    match self.wait_for(Stream::Input) {
                        Waited::Ready => {}
                        other => return Err(self.vain(other, "input", to)),
                    }
                }
                Err(_) => return Err(self.gone("input", to)),
            }
        }
        Ok(())
    }

    /// Reads until `message` finds a message at the beginning of the received bytes; returns its
    /// result and the length.
    ///
    /// # Errors
    /// If the program is silent or has ended, or if the bytes are not a message.
    pub fn read<T>(
        &mut self,
        to: &'static str,
        message: impl Fn(&[u8]) -> Result<Option<(T, usize)>, String>,
    ) -> Result<T, NodeError> {
        loop {
            let (came, from) = &mut self.came;
            let found = message(&came[*from..]);
            let found = found.map_err(|what| NodeError::Unreadable { to, what })?;
            if let Some((found, len)) = found {
                *from += len;
                if *from == came.len() {
                    came.clear();
                    *from = 0;
                }
                self.waits = 0;
                return Ok(found);
            }
            match self.wait_for(Stream::Output) {
                Waited::Ready if self.fill() => {}
                Waited::Ready => return Err(self.gone("output", to)),
                other => return Err(self.vain(other, "output", to)),
            }
        }
    }

    /// Waits until a stream is ready. Also detects that the program has exited while one of its
    /// children holds its standard output open.
    fn wait_for(&mut self, stream: Stream) -> Waited {
        let mut is_last_look = false;
        loop {
            let slice = match is_last_look {
                true => Duration::ZERO,
                false => SLICE,
            };
            match (self.ready(stream, slice), is_last_look) {
                (Some(true), _) => return Waited::Ready,
                (Some(false), _) => return Waited::Silent,
                (None, true) => return Waited::Exited,
                (None, false) => {}
            }
            if STOPPED.load(Ordering::Relaxed) {
                return Waited::Stopped;
            }
            // The last answer may have arrived between the check and the exit.
            let child = self.child.as_mut();
            is_last_look =
                child.is_none_or(|child| child.try_wait().is_ok_and(|ended| ended.is_some()));
        }
    }

    /// Whether a stream is ready within `slice`; `Some(false)` after the timeout of the answer.
    fn ready(&mut self, stream: Stream, slice: Duration) -> Option<bool> {
        // Most answers require one wait and no alarm.
        if self.waits == 1 {
            let time = Itimerspec {
                it_interval: Timespec::default(),
                it_value: Timespec::try_from(self.limit).unwrap_or_default(),
            };
            // Cannot fail: the descriptor is a timer and the time is valid.
            let _ = timerfd_settime(&self.alarm, TimerfdTimerFlags::empty(), &time);
        }
        self.waits = self.waits.saturating_add(1);
        let stream = match (stream, &self.stdin) {
            (Stream::Input, Some(stdin)) => PollFd::new(stdin, PollFlags::OUT),
            _ => PollFd::new(&self.stdout, PollFlags::IN),
        };
        let mut both = [stream, PollFd::new(&self.alarm, PollFlags::IN)];
        let watched = match self.waits {
            1 => 1,
            _ => 2,
        };
        wait(&mut both[..watched], slice);
        let [stream, alarm] = both.map(|ready| !ready.revents().is_empty());
        (stream || alarm).then_some(stream)
    }

    /// The error for an unsuccessful wait.
    fn vain(&mut self, waited: Waited, stream: &'static str, to: &'static str) -> NodeError {
        let limit = self.limit;
        match waited {
            Waited::Silent => NodeError::Hung { to, limit },
            Waited::Stopped => NodeError::Stopped { to },
            Waited::Exited | Waited::Ready => self.gone(stream, to),
        }
    }

    /// Reads the available bytes; returns whether standard output is still open.
    fn fill(&mut self) -> bool {
        let mut buf = [0; 4096];
        loop {
            match self.stdout.read(&mut buf) {
                Ok(0) => return false,
                Ok(len) => {
                    let (came, from) = &mut self.came;
                    came.drain(..*from);
                    *from = 0;
                    came.extend_from_slice(&buf[..len]);
                    return true;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
    }

    /// The process id; `None` if the process has ended.
    pub(crate) fn pid(&self) -> Option<Pid> {
        self.group.filter(|_| self.child.is_some())
    }

    /// Number of received bytes that belong to no answer.
    pub fn excess(&self) -> usize {
        self.came.0.len() - self.came.1
    }

    /// The error for a closed stream.
    fn gone(&mut self, stream: &'static str, to: &'static str) -> NodeError {
        match self.wait_for_end(LAST_WORDS) {
            Some(status) => NodeError::Exited {
                how: Ending::of(status),
                to,
            },
            None => NodeError::Closed { stream, to },
        }
    }

    /// Closes standard input and waits for the process; kills it after `patience`. Returns its end,
    /// if it ended by itself.
    pub fn end(&mut self, patience: Duration) -> Option<Ending> {
        self.stdin = None;
        self.wait_for_end(patience).map(Ending::of)
    }

    /// Waits for the end of the program; afterwards no process of its group is left.
    fn wait_for_end(&mut self, patience: Duration) -> Option<ExitStatus> {
        let mut child = self.child.take()?;
        let (tell, told) = mpsc::channel();
        let waiter = thread::spawn(move || {
            let _ = tell.send(child.wait());
        });
        let status = told.recv_timeout(patience).ok().and_then(Result::ok);
        if let Some(group) = self.group {
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = waiter.join();
        // Its children end a little later.
        let (_still, never) = mpsc::channel::<()>();
        for _ in 0..GROUP_ENDS {
            if !self.group.is_some_and(group::is_running) {
                break;
            }
            let _ = never.recv_timeout(Duration::from_millis(2));
        }
        status
    }

    /// The end of its standard error output.
    pub fn said(&self) -> String {
        let words = self.words.lock().unwrap_or_else(PoisonError::into_inner);
        String::from_utf8_lossy(&words).into_owned()
    }

    /// As `said`, after the end of the process: waits for the last output.
    pub fn said_at_last(&mut self) -> String {
        if let Some(listener) = self.listener.take() {
            let (tell, told) = mpsc::channel();
            thread::spawn(move || {
                let _ = tell.send(listener.join());
            });
            let _ = told.recv_timeout(LAST_WORDS);
        }
        self.said()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end(Duration::ZERO);
    }
}

/// Waits until one of the descriptors is ready.
fn wait(all: &mut [PollFd<'_>], limit: Duration) {
    let limit = Timespec::try_from(limit).ok();
    while poll(all, limit.as_ref()) == Err(Errno::INTR) {}
}

/// The last non-empty line of a program's output.
pub fn last_words(said: &str) -> Option<&str> {
    said.lines().map(str::trim).rfind(|line| !line.is_empty())
}

/// Collects the output until the last writer closes the pipe.
fn listen(mut from: impl io::Read, words: &Mutex<Vec<u8>>) {
    let mut buf = [0; 4096];
    loop {
        match from.read(&mut buf) {
            Ok(len @ 1..) => {
                let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
                words.extend_from_slice(&buf[..len]);
                let excess = words.len().saturating_sub(WORDS_MAX);
                words.drain(..excess);
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            _ => return,
        }
    }
}
