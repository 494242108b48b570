//! A process with pipes: started in a process group of its own, written to and read from with a
//! limit of wall time, ended with all that it started.
//!
//! What leaves its group (a daemon that begins a session of its own) is out of reach and goes on.

use core::time::Duration;
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::{self, JoinHandle};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::process::{Pid, Signal, kill_process_group, test_kill_process_group};

use crate::error::NodeError;

/// As much of standard error as is kept, from its end.
const WORDS_MAX: usize = 64 << 10;
/// How long its last words may be on their way.
const LAST_WORDS: Duration = Duration::from_millis(500);
/// Most pieces of one answer, besides those that its length explains: a program that sends a byte
/// now and then hangs.
const PIECES_MAX: usize = 1_000;

/// Looks at whether all of a killed group have ended, 2 ms apart.
const GROUP_ENDS: usize = 250;
/// Time between two looks at whether a silent program has exited.
const SLICE: Duration = Duration::from_millis(100);

/// What became of waiting for an answer.
enum Waited {
    Answered,
    Exited,
    Silent,
}

/// A process that answers requests.
#[derive(Debug)]
pub struct Process {
    child: Option<Child>,
    group: Option<Pid>,
    stdin: Option<ChildStdin>,
    stdout: ChildStdout,
    /// What came and was not taken: bytes, and where the rest begins.
    came: (Vec<u8>, usize),
    words: Arc<Mutex<Vec<u8>>>,
    listener: Option<JoinHandle<()>>,
    limit: Duration,
}

impl Process {
    /// Starts `command` by the shell in `folder`, with `env` added to its environment. `limit` is
    /// the wall time for which it may be silent.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn start(
        command: &str,
        folder: Option<&Path>,
        env: &[(String, String)],
        limit: Duration,
    ) -> Result<Self, NodeError> {
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
        };
        if let Some(stdin) = &process.stdin {
            fcntl_setfl(stdin, fcntl_getfl(stdin)? | OFlags::NONBLOCK)?;
        }
        Ok(process)
    }

    /// Writes `bytes`, a part of the request called `to`.
    ///
    /// # Errors
    /// If it does not take them.
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
                    let ready = PollFd::new(stdin, PollFlags::OUT);
                    if !wait(ready, self.limit) {
                        let limit = self.limit;
                        return Err(NodeError::Hung { to, limit });
                    }
                }
                Err(_) => return Err(self.gone("input", to)),
            }
        }
        Ok(())
    }

    /// Reads until `message` finds one at the front of what came: what it makes of it, and how long
    /// it was.
    ///
    /// # Errors
    /// If it is silent or gone, or if what came cannot be a message.
    pub fn read<T>(
        &mut self,
        to: &'static str,
        message: impl Fn(&[u8]) -> Result<Option<(T, usize)>, String>,
    ) -> Result<T, NodeError> {
        let mut pieces = 0;
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
                return Ok(found);
            }
            let is_slow = pieces > PIECES_MAX + came.len() / 512;
            pieces += 1;
            match self.wait_for_answer() {
                Waited::Answered if is_slow => {}
                Waited::Answered if self.fill() => continue,
                Waited::Answered | Waited::Exited => return Err(self.gone("output", to)),
                Waited::Silent => {}
            }
            let limit = self.limit;
            return Err(NodeError::Hung { to, limit });
        }
    }

    /// Waits until something comes. A program that has exited is noticed although another one that
    /// it started holds its standard output open.
    fn wait_for_answer(&mut self) -> Waited {
        let mut left = self.limit;
        loop {
            let slice = left.min(SLICE);
            if wait(PollFd::new(&self.stdout, PollFlags::IN), slice) {
                return Waited::Answered;
            }
            let child = self.child.as_mut();
            if child.is_none_or(|child| child.try_wait().is_ok_and(|ended| ended.is_some())) {
                // Its last answer may have come meanwhile.
                let ready = PollFd::new(&self.stdout, PollFlags::IN);
                return match wait(ready, Duration::ZERO) {
                    true => Waited::Answered,
                    false => Waited::Exited,
                };
            }
            left -= slice;
            if left.is_zero() {
                return Waited::Silent;
            }
        }
    }

    /// Takes what came; whether its standard output is open.
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

    /// Bytes that came and belong to no answer.
    pub fn excess(&self) -> usize {
        self.came.0.len() - self.came.1
    }

    /// Why one of its streams is closed.
    fn gone(&mut self, stream: &'static str, to: &'static str) -> NodeError {
        match self.wait_for_end(LAST_WORDS) {
            Some(status) => NodeError::Exited {
                how: how(status),
                to,
            },
            None => NodeError::Closed { stream, to },
        }
    }

    /// Closes its standard input and waits until it has ended; kills it after `patience`. How it
    /// ended, if it ended by itself.
    pub fn end(&mut self, patience: Duration) -> Option<ExitStatus> {
        self.stdin = None;
        self.wait_for_end(patience)
    }

    /// Waits for the end of the program; no process of its group is left when this returns.
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
        // What it had started ends a little later.
        let (_still, never) = mpsc::channel::<()>();
        let is_there = |group| test_kill_process_group(group).is_ok();
        for _ in 0..GROUP_ENDS {
            if !self.group.is_some_and(is_there) {
                break;
            }
            let _ = never.recv_timeout(Duration::from_millis(2));
        }
        status
    }

    /// What it said on standard error, the end of it.
    pub fn said(&self) -> String {
        let words = self.words.lock().unwrap_or_else(PoisonError::into_inner);
        String::from_utf8_lossy(&words).into_owned()
    }

    /// The same once it has ended: waits for its last words.
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

/// Waits until something can be done; whether it came true.
fn wait(ready: PollFd<'_>, limit: Duration) -> bool {
    let limit = Timespec::try_from(limit).ok();
    let mut all = [ready];
    loop {
        match poll(&mut all, limit.as_ref()) {
            Ok(count) => return count > 0,
            Err(Errno::INTR) => {}
            Err(_) => return false,
        }
    }
}

/// Exit code or signal, in words.
fn how(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) => format!("signal {signal}"),
        (None, Some(127)) => "exit code 127: the shell did not find the command".to_owned(),
        (None, code) => format!("exit code {}", code.unwrap_or_default()),
    }
}

/// How a program ended, if that was not well.
pub(crate) fn trouble(status: ExitStatus) -> Option<String> {
    (!status.success()).then(|| how(status))
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
