//! Signals that wait for a stopped thread, as the system lists them.

use std::fs::File;
use std::io::Read as _;

/// Signals that do nothing without a handler: SIGCHLD, SIGCONT, SIGURG, SIGWINCH.
const MILD: u64 = 1 << 16 | 1 << 17 | 1 << 22 | 1 << 27;

/// Signals that continue a stopped process: SIGKILL, SIGCONT.
const CONTINUES: u64 = 1 << 8 | 1 << 17;

/// More than the length of the system's status of a thread.
const STATUS_MAX: usize = 8192;

/// The pending signals of a thread, as bits.
pub(super) struct Pending {
    pub(super) own: u64,
    /// Signals for any thread of its process.
    pub(super) common: u64,
    pub(super) blocked: u64,
    /// Whether the thread has left its stop, because it was killed.
    pub(super) is_killed: bool,
    ignored: u64,
    caught: u64,
}

impl Pending {
    pub(super) fn of(process: i32, tid: i32) -> Self {
        let status = status(process, tid).unwrap_or_default();
        let mask = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            line.and_then(|text| u64::from_str_radix(text.trim(), 16).ok())
                .unwrap_or(0)
        };
        let state = status.lines().find_map(|line| line.strip_prefix("State:"));
        Self {
            is_killed: state.is_some_and(|state| !state.trim_start().starts_with(['t', 'T'])),
            own: mask("SigPnd:"),
            common: mask("ShdPnd:"),
            blocked: mask("SigBlk:"),
            ignored: mask("SigIgn:"),
            caught: mask("SigCgt:"),
        }
    }

    /// Whether one of them continues a stopped process.
    pub(super) const fn continues(&self) -> bool {
        (self.own | self.common) & CONTINUES != 0
    }

    /// Whether one of `signals` has a handler.
    pub(super) const fn are_handled(&self, signals: u64) -> bool {
        self.caught & !self.blocked & signals == signals
    }

    /// The signals without an effect while `held` are blocked.
    pub(super) const fn quiet(&self, held: u64) -> u64 {
        held | self.ignored | (MILD & !self.caught)
    }

    /// Whether one of them ends a wait.
    pub(super) const fn interrupts(&self) -> bool {
        (self.own | self.common) & !self.quiet(self.blocked) != 0
    }
}

/// The system's status of a thread, read in one call, because this is needed often.
fn status(process: i32, tid: i32) -> Option<String> {
    let path = format!("/proc/{process}/task/{tid}/status");
    let mut file = File::open(path).ok()?;
    let mut bytes = vec![0; STATUS_MAX];
    let len = file.read(&mut bytes).ok()?;
    Some(String::from_utf8_lossy(&bytes[..len]).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    const INT: u64 = 1 << 1;
    const USR1: u64 = 1 << 9;
    const CHLD: u64 = 1 << 16;
    const CONT: u64 = 1 << 17;

    const fn none() -> Pending {
        Pending {
            own: 0,
            common: 0,
            blocked: 0,
            is_killed: false,
            ignored: 0,
            caught: 0,
        }
    }

    /// A signal of the thread or of its process ends a wait, unless it is blocked, ignored, or does
    /// nothing without a handler.
    #[test]
    fn a_signal_that_does_something_ends_a_wait() {
        assert!(Pending { own: INT, ..none() }.interrupts());
        assert!(
            Pending {
                common: INT,
                ..none()
            }
            .interrupts()
                && !none().interrupts()
        );
        for quiet in [
            Pending {
                own: INT,
                blocked: INT,
                ..none()
            },
            Pending {
                own: INT,
                ignored: INT,
                ..none()
            },
            Pending {
                own: CHLD,
                ..none()
            },
        ] {
            assert!(!quiet.interrupts());
        }
        assert!(
            Pending {
                own: CHLD,
                caught: CHLD,
                ..none()
            }
            .interrupts()
        );
        assert!(
            Pending {
                own: INT | USR1,
                blocked: INT,
                ..none()
            }
            .interrupts()
        );
        assert_eq!(none().quiet(INT), INT | MILD);
        assert_eq!(
            Pending {
                caught: CHLD,
                ignored: USR1,
                ..none()
            }
            .quiet(0),
            USR1 | (MILD & !CHLD)
        );
    }

    #[test]
    fn a_stopped_process_continues_with_its_signal() {
        assert!(
            Pending {
                own: CONT,
                ..none()
            }
            .continues()
        );
        assert!(
            Pending {
                common: 1 << 8,
                ..none()
            }
            .continues()
        );
        assert!(!Pending { own: INT, ..none() }.continues() && !none().continues());
    }

    #[test]
    fn signals_are_handled_if_all_are_caught_and_none_is_blocked() {
        let caught = Pending {
            caught: INT | USR1,
            ..none()
        };
        assert!(caught.are_handled(INT) && caught.are_handled(INT | USR1));
        assert!(!caught.are_handled(INT | CHLD));
        let blocked = Pending {
            caught: INT,
            blocked: INT,
            ..none()
        };
        assert!(!blocked.are_handled(INT));
    }

    /// The thread of this test runs: it has not stopped, and has no pending signal.
    #[test]
    fn the_system_lists_the_signals_of_a_thread() {
        let tid = nix::unistd::gettid().as_raw();
        let process = nix::unistd::getpid().as_raw();
        let own = Pending::of(process, tid);
        assert!(own.is_killed && own.own == 0);
        assert!(!Pending::of(process, -1).is_killed);
    }

    /// proc(5): signals that wait for a stopped process, and those that it holds back.
    #[test]
    fn signals_of_a_stopped_process_are_listed() {
        let stopped = crate::guest::tests::Stopped::new();
        let pid = stopped.pid.as_raw();
        let before = Pending::of(pid, pid);
        assert!(!before.is_killed && before.own == 0 && before.common == 0);
        nix::sys::signal::kill(stopped.pid, nix::sys::signal::Signal::SIGUSR1).expect("ours");
        let after = Pending::of(pid, pid);
        assert_eq!((after.own, after.common), (0, USR1));
        assert!(after.interrupts() && !after.continues());
        nix::sys::signal::kill(stopped.pid, nix::sys::signal::Signal::SIGCONT).expect("ours");
        assert!(Pending::of(pid, pid).continues());
    }

    /// SIGCHLD is 17, SIGCONT 18, SIGURG 23, SIGWINCH 28; SIGKILL is 9 (signal(7)).
    #[test]
    fn mild_signals_are_those_of_the_manual() {
        let bits = |signals: &[u32]| signals.iter().fold(0, |all, it| all | 1_u64 << (it - 1));
        assert_eq!(MILD, bits(&[17, 18, 23, 28]));
        assert_eq!(CONTINUES, bits(&[9, 18]));
        for signal in 1..=64 {
            let own = bits(&[signal]);
            let mild = [17, 18, 23, 28].contains(&signal);
            assert_eq!(Pending { own, ..none() }.interrupts(), !mild, "{signal}");
            let continues = [9, 18].contains(&signal);
            assert_eq!(
                Pending {
                    common: own,
                    ..none()
                }
                .continues(),
                continues,
                "{signal}"
            );
        }
    }

    /// A signal may be quiet for more than one reason.
    #[test]
    fn a_signal_that_is_quiet_twice_does_nothing() {
        for quiet in [
            Pending {
                own: CHLD,
                ignored: CHLD,
                ..none()
            },
            Pending {
                own: CHLD,
                blocked: CHLD,
                ..none()
            },
            Pending {
                own: INT,
                blocked: INT,
                ignored: INT,
                ..none()
            },
        ] {
            assert!(!quiet.interrupts());
        }
    }

    /// The same signal may pend for a thread and for its process.
    #[test]
    fn a_signal_that_pends_twice_counts() {
        let twice = |signal| Pending {
            own: signal,
            common: signal,
            ..none()
        };
        assert!(twice(INT).interrupts());
        assert!(twice(CONT).continues() && !twice(INT).continues());
    }
}
