//! A user's program: started in its own process group, watched, and ended with all its child
//! processes. Only this module starts programs of users.
//!
//! A process that leaves the group (a daemon with its own session) continues.

mod group;
pub(crate) mod waits;
pub(crate) mod words;

use core::fmt;
use core::time::Duration;
use std::ffi::OsString;
use std::io;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use protocols::Instant;
use rustix::process::{Pid, Signal};

use super::clock::{self, Clock, WallClock};

use group::Group;
pub(crate) use group::{Left, command_of};
use words::{Words, listen};

/// The hidden command that starts a program with modem lines on the ports in `HILRIG_DIR`.
pub const LINES_VERB: &str = "__with";
/// The variable with the ports that already have modem lines in this program.
pub(crate) const LINES_VARIABLE: &str = "HILRIG_LINES";

/// Maximum times for the end of a program after SIGTERM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// The program itself.
    pub program: Duration,
    /// Its remaining child processes.
    pub children: Duration,
}

impl Patience {
    /// For campaigns that end thousands of programs.
    pub const LITTLE: Self = Self {
        program: Duration::from_millis(500),
        children: Duration::ZERO,
    };
    /// For a run that judges the end of its program.
    pub const FAIR: Self = Self {
        program: Duration::from_secs(2),
        children: Duration::from_secs(1),
    };
}

/// Maximum delay between the end of a program and of its child processes, which got the signal
/// together.
const TOGETHER: Duration = Duration::from_millis(100);
/// Maximum delay of the program's last output.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// End of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Exit with this code.
    Code(i32),
    /// End by this signal.
    Signal(i32),
}

impl Ended {
    /// The end for an exit status. A shell reports "killed by signal N" as exit code 128 + N.
    pub(crate) fn of(status: ExitStatus) -> Self {
        match (status.signal(), status.code()) {
            (Some(signal), _) => Self::Signal(signal),
            (None, Some(code @ 129..=192)) => Self::Signal(code - 128),
            (None, code) => Self::Code(code.unwrap_or_default()),
        }
    }

    /// The end of a program that got SIGTERM, from the system's statuses of its first process and
    /// of all its processes. A shell that started the program ends by the signal, so a crash of
    /// another process counts then.
    pub(crate) fn when_asked(first: i32, all: &[i32]) -> Self {
        let of = |status: &i32| Self::of(ExitStatus::from_raw(*status));
        let crash = all.iter().map(of).find(|ended| ended.is_crash());
        let first = of(&first);
        crash.filter(|_| first == Self::Signal(15)).unwrap_or(first)
    }

    /// Whether the system ended the program because of an error in it, or the program aborted.
    pub(crate) fn is_crash(self) -> bool {
        matches!(self, Self::Signal(signal) if CRASHES.contains(&signal))
    }
}

/// Numbers of SIGILL, SIGTRAP, SIGABRT, SIGBUS, SIGFPE, SIGSEGV and SIGSYS on most processors of
/// Linux.
const CRASHES: [i32; 7] = [4, 5, 6, 7, 8, 11, 31];

/// Signals that end programs, by their numbers on most processors of Linux.
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

/// Result of the termination of a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Farewell {
    /// The last part of its output.
    pub said: String,
    /// Processes of its group that still ran after its end.
    pub left: Vec<Left>,
    /// Whether the program itself ignored SIGTERM.
    pub was_killed: bool,
    /// The end of each program after SIGTERM, in the order in which they were started; `None` if it
    /// ended before.
    pub ends: Vec<Option<Ended>>,
}

/// A running program. It is ended when dropped.
#[derive(Debug)]
pub struct Process {
    child: Child,
    group: Group,
    words: Arc<Mutex<Words>>,
    listener: Option<JoinHandle<()>>,
    ended: Option<Ended>,
    is_stopped: bool,
}

impl Process {
    /// Starts `command` in the shell with `env` added to its environment. With `log`, its standard
    /// output and standard error go to this file, up to `LOG_MAX` bytes. Without `log`, only its
    /// standard error is read.
    ///
    /// # Errors
    /// If the shell is missing, or the file cannot be created.
    pub fn start(
        command: &str,
        env: &[(String, OsString)],
        log: Option<&Path>,
    ) -> io::Result<Self> {
        let mut shell = Command::new("sh");
        shell.args(["-c", command]);
        Self::start_by(shell, env, log)
    }

    /// Starts `command` with modem lines on the ports of the rig that `env` names.
    ///
    /// # Errors
    /// If the program cannot be started, or the file cannot be created.
    pub(crate) fn start_with_lines(
        command: &str,
        env: &[(String, OsString)],
        log: Option<&Path>,
    ) -> io::Result<Self> {
        let mut supervisor = Command::new(std::env::current_exe()?);
        supervisor.args([LINES_VERB, command]);
        Self::start_by(supervisor, env, log)
    }

    fn start_by(
        mut shell: Command,
        env: &[(String, OsString)],
        log: Option<&Path>,
    ) -> io::Result<Self> {
        let words = Words::new(log.map(safefs::create).transpose()?);
        let (ears, mouth) = io::pipe()?;
        shell
            .envs(env.iter().map(|(name, value)| (name, value)))
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(match log {
                Some(_) => Stdio::from(mouth.try_clone()?),
                None => Stdio::null(),
            })
            .stderr(Stdio::from(mouth));
        clock::be_usual();
        let child = shell.spawn()?;
        // The shell object holds a copy of the pipe's write end; the pipe stays open until the
        // object is dropped.
        drop(shell);
        let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        let hearing = Arc::clone(&words);
        let listener = thread::spawn(move || listen(ears, &hearing));
        Ok(Self {
            child,
            group: Group(group.expect("a process has a number")),
            words,
            listener: Some(listener),
            ended: None,
            is_stopped: false,
        })
    }

    /// The program's end, if it has ended.
    pub fn ended(&mut self) -> Option<Ended> {
        if self.ended.is_none() {
            let status = self.child.try_wait().ok().flatten();
            self.ended = status.map(Ended::of);
        }
        self.ended
    }

    /// The processes of the program and of its children.
    pub fn ids(&self) -> Vec<u32> {
        self.group.pids()
    }

    /// Whether the system delays the program or one of its child processes.
    pub(crate) fn is_held_up(&self) -> bool {
        self.group.is_held_up()
    }

    /// Calls in which the threads of the program and of its child processes wait.
    pub(crate) fn waits(&self) -> Vec<waits::Wait> {
        waits::waits(self.group.pids())
    }

    /// Ends the program and its child processes: first by SIGTERM, then by SIGKILL. No process of
    /// its group is left afterwards.
    pub fn end(mut self, patience: Patience) -> Farewell {
        let was_running = self.ended().is_none();
        let (left, was_killed) = self.stop(patience);
        let end = self.ended.filter(|_| was_running && !was_killed);
        self.is_silent_within(LAST_WORDS);
        if let Ok(mut words) = self.words.lock() {
            words.close();
        }
        Farewell {
            said: self.said(),
            left,
            was_killed,
            ends: vec![end],
        }
    }

    /// The last part of its output so far.
    pub fn said(&self) -> String {
        if self.ended.is_some() {
            // The last output may still be in the pipe.
            self.is_silent_within(LAST_WORDS);
        }
        let words = self.words.lock();
        words.map(|words| words.text()).unwrap_or_default()
    }

    /// Waits until no process can write output any more; returns whether that happened in time. A
    /// process that left the group, a daemon, continues.
    fn is_silent_within(&self, most: Duration) -> bool {
        wait_until(most, || {
            self.listener.as_ref().is_none_or(JoinHandle::is_finished)
        })
    }

    /// Stops the group. Returns the processes that were left behind, and whether the program itself
    /// was killed.
    fn stop(&mut self, patience: Patience) -> (Vec<Left>, bool) {
        self.is_stopped = true;
        let group = self.group;
        let is_running = self.ended().is_none();
        // A child process that outlives a program that ended by itself was left behind, even if it
        // ends soon.
        let mut left = match is_running {
            true => Vec::new(),
            false => group.members(),
        };
        group.signal(Signal::TERM);
        let was_killed = is_running && !wait_until(patience.program, || self.ended().is_some());
        // A process that started while its tracer ended stays stopped and receives no signal until
        // SIGCONT.
        group.signal(Signal::CONT);
        if is_running && !was_killed {
            wait_until(TOGETHER.min(patience.children), || {
                group.members().is_empty()
            });
            left = group.members();
        }
        if !was_killed {
            wait_until(patience.children, || group.members().is_empty());
        }
        let stubborn = group.members();
        if was_killed || !stubborn.is_empty() {
            group.signal(Signal::KILL);
        }
        for one in &mut left {
            one.was_killed = stubborn.iter().any(|other| other.pid == one.pid);
        }
        if self.ended.is_none() {
            let _ = self.child.wait();
        }
        wait_until(LAST_WORDS, || group.members().is_empty());
        (left, was_killed)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if !self.is_stopped {
            self.stop(Patience::LITTLE);
        }
    }
}

/// Waits until `is_so`, at most this long; returns whether the condition came true.
fn wait_until(most: Duration, mut is_so: impl FnMut() -> bool) -> bool {
    let clock = WallClock::start();
    let until = Instant::ZERO + most;
    loop {
        if is_so() {
            return true;
        }
        let now = clock.now();
        if now >= until {
            return false;
        }
        clock.sleep_until(now + Duration::from_millis(2));
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn ports() -> Vec<(String, OsString)> {
        vec![("HILRIG_DIR".to_owned(), "/tmp/ports".into())]
    }

    /// Runs `command` to its end.
    fn run(command: &str) -> (Ended, String) {
        let mut process = Process::start(command, &ports(), None).expect("a shell");
        let clock = WallClock::start();
        loop {
            if let Some(ended) = process.ended() {
                return (ended, process.end(Patience::LITTLE).said);
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

    /// The shell waits for its child, and both ignore SIGTERM. The child also holds the standard
    /// error: the end of the output proves that both are dead.
    #[test]
    fn whoever_does_not_end_when_asked_is_killed_with_all_that_it_started() {
        let stubborn = "trap '' TERM; echo ready >&2; sh -c \"trap '' TERM; sleep 60\"; true";
        let mut process = Process::start(stubborn, &ports(), None).expect("a shell");
        let clock = WallClock::start();
        while process.said().is_empty() {
            clock.sleep_until(clock.now() + Duration::from_millis(1));
        }
        process.stop(Patience::LITTLE);
        assert_eq!(process.ended, None, "it did not end by itself");
        assert!(process.group.members().is_empty());
        assert!(process.is_silent_within(Duration::from_secs(10)));
    }

    /// The program ends, but its child ignores SIGTERM: the child is named and killed.
    #[test]
    fn a_child_that_is_left_behind_is_named_and_killed_if_it_does_not_listen() {
        let command = "sh -c \"trap '' TERM; echo up >&2; while :; do sleep 0.05; done\" & exit 0";
        let mut process = Process::start(command, &ports(), None).expect("a shell");
        wait_until(Duration::from_secs(10), || {
            process.ended().is_some() && process.said().contains("up")
        });
        let patience = Patience {
            children: Duration::from_millis(50),
            ..Patience::LITTLE
        };
        let farewell = process.end(patience);
        assert!(!farewell.was_killed, "it had ended");
        let killed: Vec<_> = farewell.left.iter().filter(|one| one.was_killed).collect();
        assert!(killed[0].command.contains("while"), "{killed:?}");
    }

    #[test]
    fn a_child_that_ends_when_asked_is_named_all_the_same() {
        let mut process = Process::start("sleep 60 & exit 0", &ports(), None).expect("a shell");
        // Until it runs the command, the child is a copy of the shell.
        wait_until(Duration::from_secs(10), || {
            let is_up = |one: &Left| one.command == "sleep 60";
            process.ended().is_some() && process.group.members().iter().any(is_up)
        });
        let farewell = process.end(Patience::FAIR);
        let [left] = &farewell.left[..] else {
            panic!("{:?}", farewell.left)
        };
        assert_eq!(
            (left.command.as_str(), left.was_killed),
            ("sleep 60", false)
        );
    }

    /// A stopped process receives SIGTERM as soon as it continues, so it need not be killed.
    #[test]
    fn a_child_that_stands_still_is_woken_to_hear_that_it_shall_end() {
        // The child stops only after its parent has ended: then the system sends it SIGHUP.
        let command = "export parent=$$; sh -c 'while kill -0 $parent 2>/dev/null; do \
                       sleep 0.01; done; kill -STOP $$; sleep 60; true' & exit 0";
        let mut process = Process::start(command, &ports(), None).expect("a shell");
        let stands = |process: &Process| {
            let state = |one: &Left| fs::read_to_string(format!("/proc/{}/stat", one.pid));
            let mut members = process.group.members().into_iter();
            members.any(|one| state(&one).is_ok_and(|stat| stat.contains(") T ")))
        };
        wait_until(Duration::from_secs(10), || {
            process.ended().is_some() && stands(&process)
        });
        let farewell = process.end(Patience::FAIR);
        let killed: Vec<bool> = farewell.left.iter().map(|one| one.was_killed).collect();
        assert_eq!(killed, [false], "{:?}", farewell.left);
    }
}
