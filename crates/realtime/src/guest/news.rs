//! Events of the traced threads.

use nix::libc;
use nix::unistd::Pid;
use rustix::process::WaitOptions;

/// The next event of a traced thread: its number and the system's status.
pub(super) fn wait(pid: Option<Pid>, more: WaitOptions) -> Option<(i32, i32)> {
    let all = libc::__WALL | libc::__WNOTHREAD;
    let options = more | WaitOptions::from_bits_retain(all.cast_unsigned());
    let pid = pid.and_then(|pid| rustix::process::Pid::from_raw(pid.as_raw()));
    loop {
        let news = match pid {
            Some(pid) => rustix::process::waitpid(Some(pid), options),
            None => rustix::process::wait(options),
        };
        match news {
            Ok(Some((pid, status))) => {
                return Some((pid.as_raw_nonzero().get(), status.as_raw()));
            }
            Err(rustix::io::Errno::INTR) => {}
            _ => return None,
        }
    }
}

pub(super) const fn is_death(status: i32) -> bool {
    status & 0xFF != 0x7F
}

/// Whether this signal stops processes.
pub(super) const fn is_stop(signal: i32) -> bool {
    matches!(
        signal,
        libc::SIGSTOP | libc::SIGTSTP | libc::SIGTTIN | libc::SIGTTOU
    )
}

/// The process of a thread.
pub(super) fn group_of(tid: i32) -> Option<i32> {
    let status = std::fs::read_to_string(format!("/proc/{tid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("Tgid:"))?;
    line.trim().parse().ok()
}
