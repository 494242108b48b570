//! Process groups, as the system lists them.
//!
//! A child that outlives its parent belongs to the first process of the system, or of the
//! container. If that one does not reap it soon, it remains a zombie. Zombies receive signals
//! without an error, so only the system's list shows that a group has ended.

use std::fs;
use std::io;

use rustix::process::{Pid, test_kill_process_group};

/// Process ids of the members of `group` without zombies.
///
/// # Errors
/// If the system has no list of processes.
pub fn members(group: Pid) -> io::Result<Vec<u32>> {
    // The list of all processes is long, and most groups are empty.
    if test_kill_process_group(group).is_err() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir("/proc")?.flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    Ok(pids.filter(|&pid| has(group, pid)).collect())
}

/// Whether a process of `group` still runs.
pub(crate) fn is_running(group: Pid) -> bool {
    let unknown = |_| test_kill_process_group(group).is_ok();
    members(group).map_or_else(unknown, |members| !members.is_empty())
}

fn has(group: Pid, pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let wanted = group.as_raw_nonzero().get();
    state_and_group(&stat).is_some_and(|(_, its)| its == wanted)
}

/// State and group in a line of `/proc/PID/stat`, unless the process is dead. The name is in
/// brackets and may contain any characters, also brackets.
pub fn state_and_group(stat: &str) -> Option<(&str, i32)> {
    let (_, fields) = stat.rsplit_once(')')?;
    let mut fields = fields.split_ascii_whitespace();
    let state = fields.next()?;
    let group = fields.nth(1)?.parse().ok()?;
    (!["Z", "X"].contains(&state)).then_some((state, group))
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::CommandExt as _;
    use std::process::{Command, Stdio};

    use rustix::process::{Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

    use super::*;

    #[test]
    fn a_name_with_brackets_and_blanks_does_not_hide_the_group() {
        let found = state_and_group("12 (a) S (b) D 1 77 77 0 -1");
        assert_eq!(found, Some(("D", 77)));
        assert_eq!(state_and_group("12 (sleep) Z 1 77 77 0 -1"), None);
        assert_eq!(state_and_group("12 (sleep"), None);
    }

    /// Before its parent waits for it, signals still reach the group of a killed process.
    #[test]
    fn a_group_of_zombies_has_ended() {
        let mut command = Command::new("sleep");
        command.arg("600").process_group(0).stdout(Stdio::null());
        let mut child = command.spawn().expect("a program of the system");
        let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        let pid = pid.expect("a process has a number");
        assert!(is_running(pid));
        assert_eq!(members(pid).expect("a list"), [child.id()]);
        kill_process_group(pid, Signal::KILL).expect("its group");
        // Waits for the end, and leaves the zombie.
        let ended = waitid(
            WaitId::Pid(pid),
            WaitIdOptions::EXITED | WaitIdOptions::NOWAIT,
        );
        assert!(ended.expect("a child").is_some());
        assert!(test_kill_process_group(pid).is_ok());
        assert!(!is_running(pid));
        child.wait().expect("a child");
    }
}
