//! Start of a foreign program under supervision: hilrig starts itself once more. The new process
//! asks to be traced, installs the filter, and becomes the program.
//!
//! ```text
//!  hilrig run ..            hilrig __guest CMD
//!     | start  -----------------> traceme, stop
//!     | options, cont ----------> filter, exec /bin/sh -c CMD
//! ```
//!
//! The filter stops the system calls about time, waiting, other threads or ports; all others run at
//! full speed.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::File;
use std::io;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitCode, Stdio};

use nix::libc;
use nix::sys::personality::{self, Persona};
use nix::sys::ptrace;
use nix::sys::signal::{SigSet, Signal, raise};
use nix::unistd::Pid;
use rustix::process::{TimeStampCounterReadability, set_time_stamp_counter_readability};
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter,
    SeccompRule, TargetArch,
};

use super::call::{Call, FUTEX_REQUEUE, FUTEX_WAIT, FUTEX_WAKE};
use super::memory::Memory;
use super::settings::SETTINGS;

/// The hidden command for a program in virtual time.
pub const VERB: &str = "__guest";
/// The hidden command for a program in real time that has modem lines.
pub const LINES_VERB: &str = "__guest-lines";
/// Requests about modem lines, and others that a pseudo-terminal answers differently from a serial
/// port.
const LINES: [u64; 14] = [
    libc::TIOCMGET,
    libc::TIOCMBIS,
    libc::TIOCMBIC,
    libc::TIOCMSET,
    libc::TIOCSBRK,
    libc::TIOCCBRK,
    libc::TCSBRK,
    libc::TCSBRKP,
    TIOCMIWAIT,
    TIOCGICOUNT,
    libc::TIOCOUTQ,
    libc::TCFLSH,
    TIOCGSERIAL,
    TIOCSSERIAL,
];
/// Requests that `libc` does not know for this system.
pub(super) const TIOCMIWAIT: u64 = 0x545C;
pub(super) const TIOCGICOUNT: u64 = 0x545D;
/// Requests of `fcntl` about signals; `libc` does not know two of them for this system.
pub(super) const F_SETSIG: i32 = 10;
pub(super) const F_SETOWN_EX: i32 = 15;
pub(super) const NOTICES: [i32; 4] = [libc::F_SETFL, libc::F_SETOWN, F_SETSIG, F_SETOWN_EX];
/// The filter's instruction that returns a verdict.
const RETURN: u16 = 0x06;
pub(super) const TIOCGSERIAL: u64 = 0x541E;
pub(super) const TIOCSSERIAL: u64 = 0x541F;
/// Exit code of a launcher that could not be traced.
pub(super) const NOT_TRACED: i32 = 125;
/// Exit code of a launcher that could not install the filter, or did not find the shell.
pub(super) const NOT_LAUNCHED: i32 = 126;
/// A flag of clone that hides the child from the tracer of its parent.
pub(super) const CLONE_UNTRACED: u64 = 0x0080_0000;
/// Files with numbers below this one have a copy in the supervisor until the program closes them.
pub(super) const KEPT_BELOW: u32 = 256;
/// The filter's mark of a call by a 32-bit program.
pub(super) const OTHER_ARCHITECTURE: u8 = 1;
pub(super) const NOT_LAUNCHED_CODE: u8 = 126;

/// The calls at which a program is stopped.
const STOPPED: &[i64] = &[
    libc::SYS_clock_gettime,
    libc::SYS_clock_getres,
    libc::SYS_clock_settime,
    libc::SYS_gettimeofday,
    libc::SYS_time,
    libc::SYS_times,
    libc::SYS_nanosleep,
    libc::SYS_clock_nanosleep,
    libc::SYS_sched_yield,
    libc::SYS_futex,
    libc::SYS_futex_waitv,
    FUTEX_WAKE,
    FUTEX_WAIT,
    FUTEX_REQUEUE,
    libc::SYS_select,
    libc::SYS_pselect6,
    libc::SYS_poll,
    libc::SYS_ppoll,
    libc::SYS_epoll_wait,
    libc::SYS_epoll_pwait,
    libc::SYS_epoll_pwait2,
    libc::SYS_read,
    libc::SYS_readv,
    libc::SYS_write,
    libc::SYS_writev,
    libc::SYS_recvfrom,
    libc::SYS_recvmsg,
    libc::SYS_recvmmsg,
    libc::SYS_sendto,
    libc::SYS_sendmsg,
    libc::SYS_accept,
    libc::SYS_accept4,
    libc::SYS_connect,
    libc::SYS_open,
    libc::SYS_openat,
    libc::SYS_openat2,
    libc::SYS_readlink,
    libc::SYS_readlinkat,
    libc::SYS_bind,
    libc::SYS_getsockname,
    libc::SYS_adjtimex,
    libc::SYS_clock_adjtime,
    libc::SYS_settimeofday,
    libc::SYS_getrusage,
    libc::SYS_sysinfo,
    libc::SYS_ioctl,
    libc::SYS_wait4,
    libc::SYS_waitid,
    libc::SYS_exit,
    libc::SYS_exit_group,
    libc::SYS_kill,
    libc::SYS_tkill,
    libc::SYS_tgkill,
    libc::SYS_rt_sigqueueinfo,
    libc::SYS_rt_tgsigqueueinfo,
    libc::SYS_pidfd_send_signal,
    libc::SYS_rt_sigaction,
    libc::SYS_rt_sigsuspend,
    libc::SYS_rt_sigtimedwait,
    libc::SYS_pause,
    libc::SYS_alarm,
    libc::SYS_setitimer,
    libc::SYS_getitimer,
    libc::SYS_timer_create,
    libc::SYS_timer_settime,
    libc::SYS_timer_gettime,
    libc::SYS_timer_getoverrun,
    libc::SYS_flock,
    libc::SYS_timer_delete,
    libc::SYS_signalfd,
    libc::SYS_signalfd4,
    libc::SYS_timerfd_create,
    libc::SYS_timerfd_settime,
    libc::SYS_timerfd_gettime,
    libc::SYS_getrandom,
    libc::SYS_semop,
    libc::SYS_semtimedop,
    libc::SYS_semctl,
    libc::SYS_msgsnd,
    libc::SYS_msgrcv,
    libc::SYS_msgctl,
    libc::SYS_clone3,
    libc::SYS_mq_timedreceive,
    libc::SYS_mq_timedsend,
    libc::SYS_execve,
    libc::SYS_execveat,
    libc::SYS_dup2,
    libc::SYS_dup3,
    libc::SYS_close_range,
    libc::SYS_epoll_ctl,
    libc::SYS_preadv2,
    libc::SYS_pwritev2,
    libc::SYS_splice,
    libc::SYS_tee,
    libc::SYS_vmsplice,
    libc::SYS_sendfile,
    libc::SYS_io_submit,
    libc::SYS_io_uring_setup,
    libc::SYS_io_uring_enter,
    libc::SYS_io_getevents,
    libc::SYS_getcpu,
    libc::SYS_rseq,
    libc::SYS_sched_getaffinity,
    libc::SYS_sched_setaffinity,
];

/// Options of sockets that add the system's time to messages, old and new ones (socket(7)).
const TIMESTAMPS: [u64; 6] = [29, 35, 37, 63, 64, 65];

/// Variables that stop libraries from using the processor's random numbers (RDRAND, RDSEED), which
/// no supervisor can control: those of OpenSSL (OPENSSL_ia32cap(3)) and of Qt.
const WITHOUT_CHANCE: [(&str, &str); 2] = [
    ("OPENSSL_ia32cap", "~0x4000000000000000:~0x40000"),
    ("QT_NO_CPU_FEATURE", "rdrnd rdseed"),
];

/// Variables of sanitizers. Their search for memory leaks needs ptrace, which the supervisor
/// already uses.
const WITH_LEAKS: [&str; 3] = ["ASAN_OPTIONS", "HWASAN_OPTIONS", "LSAN_OPTIONS"];

/// The user's options `set`, without a search for leaks unless the user sets that option.
fn without_leaks(set: Option<OsString>) -> OsString {
    let mut options = set.unwrap_or_default();
    if options.to_string_lossy().contains("detect_leaks") {
        return options;
    }
    if !options.is_empty() {
        options.push(":");
    }
    options.push("detect_leaks=0");
    options
}

/// The environment of a program under supervision, in addition to that of this process.
fn supervised(launcher: &mut Command) {
    for name in WITH_LEAKS {
        launcher.env(name, without_leaks(std::env::var_os(name)));
    }
}

/// Starts the launcher of `command`, with `env` added to its environment. The program's output goes
/// to `mouth`. The launcher stops before it does anything.
pub(super) fn start(command: &str, env: &[(String, OsString)], mouth: File) -> io::Result<Child> {
    let mut launcher = Command::new(std::env::current_exe()?);
    for (name, value) in WITHOUT_CHANCE {
        if std::env::var_os(name).is_none() {
            launcher.env(name, value);
        }
    }
    supervised(&mut launcher);
    launcher
        .args([VERB, command])
        .envs(env.iter().map(|(name, value)| (name, value)))
        .process_group(0)
        .stdin(Stdio::null())
        .stdout(Stdio::from(mouth.try_clone()?))
        .stderr(Stdio::from(mouth));
    launcher.spawn()
}

/// Starts the launcher of a program and its arguments; the program stops only at calls about modem
/// lines.
pub(super) fn start_with_lines(
    command: &[OsString],
    env: &[(String, OsString)],
    speaks: Stdio,
) -> io::Result<Child> {
    let mut launcher = Command::new(std::env::current_exe()?);
    supervised(&mut launcher);
    launcher
        .stdout(speaks)
        .arg(LINES_VERB)
        .args(command)
        .envs(env.iter().map(|(name, value)| (name, value)));
    launcher.spawn()
}

/// The signals that ask a program to end.
pub(super) fn requests_to_end() -> SigSet {
    let mut set = SigSet::empty();
    for signal in [
        Signal::SIGINT,
        Signal::SIGTERM,
        Signal::SIGHUP,
        Signal::SIGQUIT,
    ] {
        set.add(signal);
    }
    set
}

/// Becomes a program with its arguments, supervised by the parent process.
pub fn become_guest_with_lines(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    // The parent process blocks these signals.
    let _ = requests_to_end().thread_unblock();
    let mut words = words.into_iter();
    let mut program = Command::new(words.next().unwrap_or_default());
    program.args(words);
    become_supervised(&mut program, about_lines)
}

/// Becomes `command`, supervised by the parent process.
pub fn become_guest(command: &str) -> ExitCode {
    // Memory addresses are then the same in each run; some systems forbid this setting.
    let _ = personality::get()
        .and_then(|persona| personality::set(persona | Persona::ADDR_NO_RANDOMIZE));
    // If the processor's counter cannot be hidden, it stays visible.
    let _ = set_time_stamp_counter_readability(TimeStampCounterReadability::RaiseSIGSEGV);
    let mut shell = Command::new("/bin/sh");
    become_supervised(shell.args(["-c", command]), all_stopped)
}

fn become_supervised(
    program: &mut Command,
    stopped: fn() -> Result<Rules, seccompiler::BackendError>,
) -> ExitCode {
    let code = |code: i32| ExitCode::from(u8::try_from(code).unwrap_or(1));
    if let Err(error) = ptrace::traceme().and_then(|()| raise(Signal::SIGSTOP)) {
        eprintln!("ptrace: {error}");
        return code(NOT_TRACED);
    }
    if let Err(error) = put_on_filter(stopped) {
        eprintln!("seccomp: {error}");
        return code(NOT_LAUNCHED);
    }
    let error = program.exec();
    eprintln!("{}: {error}", program.get_program().display());
    code(NOT_LAUNCHED)
}

/// Calls at which a program is stopped, with conditions on their arguments.
type Rules = BTreeMap<i64, Vec<SeccompRule>>;

fn all_stopped() -> Result<Rules, seccompiler::BackendError> {
    let mut rules: Rules = STOPPED.iter().map(|&number| (number, Vec::new())).collect();
    // Of this call's requests, only waits for a lock and signals about files are stopped.
    let requests = NOTICES.into_iter().chain([libc::F_SETLKW]);
    let requests = requests.map(|request| {
        let (eq, len) = (SeccompCmpOp::Eq, SeccompCmpArgLen::Dword);
        let is = SeccompCondition::new(1, len, eq, u64::from(request.unsigned_abs()))?;
        SeccompRule::new(vec![is])
    });
    let requests: Result<Vec<SeccompRule>, _> = requests.collect();
    rules.insert(libc::SYS_fcntl, requests?);
    let kept = SeccompCondition::new(
        0,
        SeccompCmpArgLen::Dword,
        SeccompCmpOp::Lt,
        KEPT_BELOW.into(),
    )?;
    rules.insert(libc::SYS_close, vec![SeccompRule::new(vec![kept])?]);
    rules.extend(about_children()?);
    rules.extend(about_entries()?);
    rules.extend(about_stamps()?);
    Ok(rules)
}

/// Stops `setsockopt` if it asks for the system's time of each message.
fn about_stamps() -> Result<Rules, seccompiler::BackendError> {
    let (eq, len) = (SeccompCmpOp::Eq, SeccompCmpArgLen::Dword);
    let rules = TIMESTAMPS.map(|option| {
        let level = u64::from(libc::SOL_SOCKET.unsigned_abs());
        let level = SeccompCondition::new(1, len.clone(), eq.clone(), level)?;
        let option = SeccompCondition::new(2, len.clone(), eq.clone(), option)?;
        SeccompRule::new(vec![level, option])
    });
    let rules: Result<Vec<SeccompRule>, _> = rules.into_iter().collect();
    Ok([(libc::SYS_setsockopt, rules?)].into())
}

/// Removes the flag that hides a child, because a hidden child would leave the supervision.
pub(super) fn show_child(tid: Pid, call: &Call) {
    let flags = match call.number {
        libc::SYS_clone => Ok(call.args[0]),
        _ => Memory(tid).u64(call.args[0]),
    };
    let Some(flags) = flags.ok().filter(|flags| flags & CLONE_UNTRACED != 0) else {
        return;
    };
    let flags = flags & !CLONE_UNTRACED;
    let _ = match call.number {
        libc::SYS_clone => call.with(tid, 0, flags),
        _ => Memory(tid).write(call.args[0], &flags.to_ne_bytes()),
    };
}

/// Rules for calls that hide children from the tracer of their parent.
fn about_children() -> Result<Rules, seccompiler::BackendError> {
    let is_hidden = SeccompCmpOp::MaskedEq(CLONE_UNTRACED);
    let hides = SeccompCondition::new(0, SeccompCmpArgLen::Qword, is_hidden, CLONE_UNTRACED)?;
    // The flags of the newer call are in memory, which no filter can read.
    Ok([
        (libc::SYS_clone, vec![SeccompRule::new(vec![hides])?]),
        (libc::SYS_clone3, Vec::new()),
    ]
    .into())
}

fn about_lines() -> Result<Rules, seccompiler::BackendError> {
    let rules = LINES.iter().chain(&SETTINGS).map(|&request| {
        let is = SeccompCondition::new(1, SeccompCmpArgLen::Dword, SeccompCmpOp::Eq, request)?;
        SeccompRule::new(vec![is])
    });
    let rules: Result<Vec<SeccompRule>, _> = rules.collect();
    let mut all = about_children()?;
    all.insert(libc::SYS_ioctl, rules?);
    all.extend([libc::SYS_readlink, libc::SYS_readlinkat].map(|number| (number, Vec::new())));
    all.extend(about_entries()?);
    Ok(all)
}

/// Stops `lstat`, because libserialport looks for the entry of a port in `/sys/class/tty`.
fn about_entries() -> Result<Rules, seccompiler::BackendError> {
    let flag = u64::from(libc::AT_SYMLINK_NOFOLLOW.unsigned_abs());
    let is_link = SeccompCmpOp::MaskedEq(flag);
    let is_link = SeccompCondition::new(3, SeccompCmpArgLen::Dword, is_link, flag)?;
    Ok([
        (libc::SYS_lstat, Vec::new()),
        (libc::SYS_newfstatat, vec![SeccompRule::new(vec![is_link])?]),
    ]
    .into())
}

fn put_on_filter(
    stopped: fn() -> Result<Rules, seccompiler::BackendError>,
) -> Result<(), seccompiler::Error> {
    seccompiler::apply_filter(&filter_of(stopped)?)
}

fn filter_of(
    stopped: fn() -> Result<Rules, seccompiler::BackendError>,
) -> Result<BpfProgram, seccompiler::Error> {
    let filter = SeccompFilter::new(
        stopped()?,
        SeccompAction::Allow,
        SeccompAction::Trace(0),
        TargetArch::x86_64,
    )?;
    let mut program: BpfProgram = filter.try_into()?;
    // The default would kill the process without a message.
    let kill = u32::from(SeccompAction::KillProcess);
    let told = u32::from(SeccompAction::Trace(OTHER_ARCHITECTURE.into()));
    for step in &mut program {
        if step.code == RETURN && step.k == kill {
            step.k = told;
        }
    }
    Ok(program)
}

/// The filters of a program in virtual time and of one with modem lines, in the kernel's format.
#[cfg(test)]
pub(super) fn filters() -> [Vec<[u8; 8]>; 2] {
    [all_stopped, about_lines].map(in_bytes)
}

#[cfg(test)]
fn in_bytes(stopped: fn() -> Result<Rules, seccompiler::BackendError>) -> Vec<[u8; 8]> {
    let program = filter_of(stopped).expect("valid");
    let bytes = program.iter().map(|step| {
        let mut bytes = [0; 8];
        bytes[..2].copy_from_slice(&step.code.to_ne_bytes());
        (bytes[2], bytes[3]) = (step.jt, step.jf);
        bytes[4..].copy_from_slice(&step.k.to_ne_bytes());
        bytes
    });
    bytes.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The user's options stay. If an option is given twice, the last one counts.
    #[test]
    fn the_search_for_leaks_is_off_unless_the_user_decides() {
        let options = |set: Option<&str>| without_leaks(set.map(Into::into));
        for (set, expected) in [
            (None, "detect_leaks=0"),
            (Some(""), "detect_leaks=0"),
            (Some("abort_on_error=1"), "abort_on_error=1:detect_leaks=0"),
            (Some("detect_leaks=1"), "detect_leaks=1"),
        ] {
            assert_eq!(options(set), OsString::from(expected));
        }
    }

    /// Which calls stop a program is told by their numbers; the rest is a matter of arguments.
    #[test]
    fn some_calls_stop_a_program_by_their_arguments() {
        let rules = all_stopped().expect("valid");
        for number in STOPPED {
            assert!(
                rules[number].is_empty() || *number == libc::SYS_clone3,
                "{number}"
            );
        }
        let count = |number| rules.get(&number).map(Vec::len);
        // F_SETFL, F_SETOWN, F_SETSIG, F_SETOWN_EX and F_SETLKW.
        assert_eq!(count(libc::SYS_fcntl), Some(5));
        assert_eq!(count(libc::SYS_close), Some(1));
        assert_eq!(count(libc::SYS_setsockopt), Some(6));
        assert_eq!(count(libc::SYS_clone), Some(1));
        assert_eq!(count(libc::SYS_clone3), Some(0));
        assert_eq!(
            (count(libc::SYS_lstat), count(libc::SYS_newfstatat)),
            (Some(0), Some(1))
        );
        assert_eq!(
            (count(libc::SYS_getpid), count(libc::SYS_mmap)),
            (None, None)
        );
        let lines = about_lines().expect("valid");
        let count = |number| lines.get(&number).map(Vec::len);
        assert_eq!(count(libc::SYS_ioctl), Some(14 + 12));
        assert_eq!(
            (count(libc::SYS_readlink), count(libc::SYS_readlinkat)),
            (Some(0), Some(0))
        );
        assert_eq!(
            (count(libc::SYS_clone), count(libc::SYS_lstat)),
            (Some(1), Some(0))
        );
        assert_eq!(
            (count(libc::SYS_read), count(libc::SYS_fcntl)),
            (None, None)
        );
    }

    #[test]
    fn a_program_is_asked_to_end_by_four_signals() {
        let set = requests_to_end();
        let all = Signal::iterator().filter(|&signal| set.contains(signal));
        let expected = [
            Signal::SIGHUP,
            Signal::SIGINT,
            Signal::SIGQUIT,
            Signal::SIGTERM,
        ];
        assert_eq!(all.collect::<Vec<_>>(), expected);
    }

    /// CLONE_UNTRACED is 0x800000; the flags of clone3(2) are the first word in memory.
    #[test]
    fn a_child_that_hides_is_shown() {
        let stopped = crate::guest::tests::Stopped::new();
        stopped.change(|registers| registers.rdi = 5);
        let clone = |flags| show_child(stopped.pid, &Call::made(libc::SYS_clone, &[flags]));
        clone(0x11);
        assert_eq!(stopped.registers().rdi, 5);
        clone(0x80_0011);
        assert_eq!(stopped.registers().rdi, 0x11);
        let room = crate::guest::tests::Room::of_words(&[0x80_0100, 0x80_0000]);
        let own = crate::guest::tests::own();
        show_child(own, &Call::made(libc::SYS_clone3, &[room.at(0), 88]));
        assert_eq!(room.words(), [0x100, 0x80_0000]);
        show_child(own, &Call::made(libc::SYS_clone3, &[8, 88]));
    }
}
