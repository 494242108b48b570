//! The members of a process group, as the system lists them.

use core::fmt;
use std::fs;

use nodes::group::{members, state_and_group};
use rustix::process::{Pid, Signal, kill_process_group};

/// Maximum length of a reported command.
const COMMAND_MAX: usize = 120;

/// A process that a user's program started and did not end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Left {
    /// Its number.
    pub pid: u32,
    /// Its command.
    pub command: String,
    /// Whether the process ignored SIGTERM and was killed.
    pub was_killed: bool,
}

impl fmt::Display for Left {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.pid, self.command)
    }
}

/// A process group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group(pub(super) Pid);

impl Group {
    /// Sends `signal` to all processes of the group; a process that is just ending is ignored.
    pub(super) fn signal(self, signal: Signal) {
        let _ = kill_process_group(self.0, signal);
    }

    /// Its members without zombies.
    pub(super) fn members(self) -> Vec<Left> {
        let left = |pid| Left {
            pid,
            command: command_of(pid),
            was_killed: false,
        };
        self.pids().into_iter().map(left).collect()
    }

    /// Process ids of the members.
    pub(super) fn pids(self) -> Vec<u32> {
        members(self.0).unwrap_or_default()
    }

    /// Whether a thread of the group waits for the system and cannot even be killed, for example
    /// for a page of its own code from the disk. The program itself cannot end such a wait.
    pub(super) fn is_held_up(self) -> bool {
        // The command is not read here: it is in the memory of the process, for which this thread
        // might have to wait.
        let threads = |pid: u32| {
            let tasks = fs::read_dir(format!("/proc/{pid}/task"));
            tasks.into_iter().flatten().flatten()
        };
        self.pids().into_iter().flat_map(threads).any(|task| {
            let stat = fs::read_to_string(task.path().join("stat")).unwrap_or_default();
            state_and_group(&stat).is_some_and(|(state, _)| state == "D")
        })
    }
}

/// The command of a process; `?` if the process has ended.
pub(crate) fn command_of(pid: u32) -> String {
    let words = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let words = String::from_utf8_lossy(&words).replace('\0', " ");
    let mut command: String = words.trim_end().chars().take(COMMAND_MAX).collect();
    if command.is_empty() {
        "?".clone_into(&mut command);
    }
    command
}
