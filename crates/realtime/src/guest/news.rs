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

#[cfg(test)]
mod tests {
    use super::*;

    use crate::guest::tests::Stopped;

    /// wait(2): the low byte of a stop is 0x7F, and the signal is above it.
    #[test]
    fn a_stop_is_told_from_a_death() {
        for (status, expected) in [
            (0x137F, false),
            (0x6_057F, false),
            (0, true),
            (9, true),
            (0x300, true),
            (0x8B, true),
        ] {
            assert_eq!(is_death(status), expected, "{status:x}");
        }
        for signal in 1..32 {
            assert_eq!(is_stop(signal), (19..=22).contains(&signal), "{signal}");
        }
    }

    #[test]
    fn news_are_those_of_traced_processes() {
        let stopped = Stopped::new();
        let pid = stopped.pid.as_raw();
        assert_eq!(group_of(pid), Some(pid));
        assert_eq!(group_of(-1), None);
        let own = nix::unistd::gettid().as_raw();
        assert_eq!(group_of(own), Some(std::process::id().cast_signed()));
        let nothing = WaitOptions::NOHANG;
        assert_eq!(wait(Some(stopped.pid), nothing), None);
        assert_eq!(wait(None, nothing), None);
        assert_eq!(wait(Some(Pid::from_raw(1)), nothing), None, "no child");
        nix::sys::signal::kill(stopped.pid, nix::sys::signal::Signal::SIGKILL).expect("ours");
        assert_eq!(wait(None, WaitOptions::empty()), Some((pid, 9)));
    }
}
