//! Somebody's program: started in a process group of its own, watched, and ended with all that it
//! has started.

use core::fmt;
use core::time::Duration;
use std::collections::VecDeque;
use std::io::{self, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use rustix::process::{Pid, Signal, kill_process_group};

use crate::realtime::clock::{Clock, WallClock};

/// The variable by which the program is told where its ports are.
pub const PORTS_VARIABLE: &str = "HILRIG_DIR";
/// How long a program may take to end by itself once it was asked to.
const FAREWELL: Duration = Duration::from_millis(500);
/// As much of what it says on its standard error as is kept, from the end.
const SAID_MAX: usize = 64 << 10;

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// With this exit code.
    Code(i32),
    /// By this signal.
    Signal(i32),
}

impl Ended {
    /// A shell says "killed by signal N" as exit code 128 + N.
    fn of(status: ExitStatus) -> Self {
        match (status.signal(), status.code()) {
            (Some(signal), _) => Self::Signal(signal),
            (None, Some(code @ 129..=192)) => Self::Signal(code - 128),
            (None, code) => Self::Code(code.unwrap_or_default()),
        }
    }
}

/// Signals that end programs, by their numbers on most of Linux's processors.
const SIGNALS: [(i32, &str); 12] = [
    (1, "SIGHUP"),
    (2, "SIGINT"),
    (3, "SIGQUIT"),
    (4, "SIGILL"),
    (6, "SIGABRT"),
    (7, "SIGBUS"),
    (8, "SIGFPE"),
    (9, "SIGKILL"),
    (11, "SIGSEGV"),
    (13, "SIGPIPE"),
    (14, "SIGALRM"),
    (15, "SIGTERM"),
];

impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Code(code) => write!(f, "exit code {code}"),
            Self::Signal(signal) => match SIGNALS.iter().find(|(number, _)| number == signal) {
                Some((_, name)) => f.write_str(name),
                None => write!(f, "signal {signal}"),
            },
        }
    }
}

/// A program that runs. Ended when dropped.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    group: Pid,
    said: Arc<Mutex<VecDeque<u8>>>,
    listener: Option<JoinHandle<()>>,
    ended: Option<Ended>,
}

impl Process {
    /// Starts `command` by the shell, its ports being in `ports`.
    pub(super) fn start(command: &str, ports: &Path) -> io::Result<Self> {
        let mut child = Command::new("sh")
            .args(["-c", command])
            .env(PORTS_VARIABLE, ports)
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        let said = Arc::<Mutex<VecDeque<u8>>>::default();
        let listener = child.stderr.take().map(|stderr| {
            let said = Arc::clone(&said);
            thread::spawn(move || listen(stderr, &said))
        });
        Ok(Self {
            child,
            group: group.expect("a process has a number"),
            said,
            listener,
            ended: None,
        })
    }

    /// How it ended, if it did.
    pub(super) fn ended(&mut self) -> Option<Ended> {
        if self.ended.is_none() {
            let status = self.child.try_wait().ok().flatten();
            self.ended = status.map(Ended::of);
        }
        self.ended
    }

    /// Ends it and whatever it started: asks first, then kills. What it said on its standard error.
    pub(super) fn end(mut self) -> String {
        self.stop();
        self.is_silent_within(FAREWELL);
        self.said()
    }

    /// What it said on its standard error so far, the end of it.
    pub(super) fn said(&self) -> String {
        if self.ended.is_some() {
            // Its last words may still be on their way.
            self.is_silent_within(FAREWELL);
        }
        let said = self.said.lock();
        let said = said.map(|said| said.iter().copied().collect::<Vec<u8>>());
        String::from_utf8_lossy(&said.unwrap_or_default()).into_owned()
    }

    /// Waits until nobody can say anything more; whether that came true. What left the group, a
    /// daemon, goes on.
    fn is_silent_within(&self, most: Duration) -> bool {
        let clock = WallClock::start();
        let is_over = || self.listener.as_ref().is_none_or(JoinHandle::is_finished);
        while !is_over() && clock.now() - protocols::Instant::ZERO < most {
            clock.sleep_until(clock.now() + Duration::from_millis(1));
        }
        is_over()
    }

    fn stop(&mut self) {
        if self.ended().is_none() {
            // One that is just ending is none to ask.
            let _ = kill_process_group(self.group, Signal::TERM);
            let clock = WallClock::start();
            let until = clock.now() + FAREWELL;
            while self.ended().is_none() && clock.now() < until {
                clock.sleep_until(clock.now() + Duration::from_millis(1));
            }
        }
        // Also what outlived its parent.
        let _ = kill_process_group(self.group, Signal::KILL);
        if self.ended.is_none() {
            let _ = self.child.wait();
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Keeps the end of what is said, until nobody can say anything more.
fn listen(mut stderr: ChildStderr, said: &Mutex<VecDeque<u8>>) {
    let mut buf = [0; 4096];
    while let Ok(len @ 1..) = stderr.read(&mut buf) {
        let Ok(mut said) = said.lock() else { return };
        said.extend(&buf[..len]);
        let excess = said.len().saturating_sub(SAID_MAX);
        said.drain(..excess);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs `command` to its end.
    fn run(command: &str) -> (Ended, String) {
        let mut process = Process::start(command, Path::new("/tmp/ports")).expect("a shell");
        let clock = WallClock::start();
        loop {
            if let Some(ended) = process.ended() {
                return (ended, process.end());
            }
            clock.sleep_until(clock.now() + Duration::from_millis(1));
        }
    }

    #[test]
    fn a_signal_is_told_from_an_exit_code_also_behind_a_shell() {
        assert_eq!(run("exit 3").0.to_string(), "exit code 3");
        assert_eq!(run("kill -SEGV $$").0.to_string(), "SIGSEGV");
        assert_eq!(
            run("sh -c 'kill -ABRT $$'; exit $?").0.to_string(),
            "SIGABRT"
        );
    }

    #[test]
    fn the_program_is_told_where_its_ports_are_and_what_it_says_is_kept() {
        let (ended, said) = run("echo \"in $HILRIG_DIR\" >&2");
        assert_eq!((ended, said.as_str()), (Ended::Code(0), "in /tmp/ports\n"));
    }

    /// The shell waits for its child, and both ignore the request to end. The child has the
    /// standard error too: that nobody can say anything any more means that both are dead.
    #[test]
    fn whoever_does_not_end_when_asked_is_killed_with_all_that_it_started() {
        let stubborn = "trap '' TERM; echo ready >&2; sh -c \"trap '' TERM; sleep 60\"; true";
        let mut process = Process::start(stubborn, Path::new("/tmp")).expect("a shell");
        let clock = WallClock::start();
        while process.said.lock().expect("sound").is_empty() {
            clock.sleep_until(clock.now() + Duration::from_millis(1));
        }
        process.stop();
        assert_eq!(process.ended, None, "it did not end by itself");
        assert!(process.is_silent_within(Duration::from_secs(10)));
    }
}
