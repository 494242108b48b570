//! Puts a program back to an earlier moment: each case of a search then begins where the program
//! first waits for its port, without a new start of the program.
//!
//! The process stays. Its writable memory and registers are written back, its clocks are set back,
//! and the rig continues. This is the whole state of a program with one thread that waits in a
//! call, and with no files except its ports and its output. No other program can be put back.
//! Mappings, open files and handlers of signals are compared: if one has changed, the program
//! cannot be put back and is started again.

use std::fs;

use nix::libc;
use nix::sys::ptrace::{self, regset::NT_PRFPREG};
use nix::unistd::Pid;

use super::{On, State, Supervisor, Wait};
use crate::guest::memory::Memory;
use crate::guest::stage::StageMoment;
use crate::guest::task::Thread;
use emulators::rng::Rng;

/// Maximum number of bytes of writable memory: writing more takes as long as a new start.
const MEMORY_MAX: usize = 8 << 20;
/// Lines of `/proc/PID/status` that only the program itself changes.
const OWN_LINES: [&str; 6] = ["Umask", "Threads", "SigBlk", "SigIgn", "SigCgt", "Seccomp"];

/// A program at one moment.
pub(in crate::guest) struct Moment {
    thread: Thread,
    random: Rng,
    restarts: u64,
    registers: libc::user_regs_struct,
    floats: libc::user_fpregs_struct,
    memory: Vec<(u64, Vec<u8>)>,
    fixed: Fixed,
    stage: StageMoment,
}

/// The state of a process that is not written back.
#[derive(Debug, PartialEq, Eq)]
struct Fixed {
    maps: String,
    files: Vec<(i32, String)>,
    own: Vec<String>,
}

impl Fixed {
    fn of(pid: i32) -> Option<Self> {
        let path = |name: &str| format!("/proc/{pid}/{name}");
        let maps = fs::read_to_string(path("maps")).ok()?;
        let mut files = Vec::new();
        for entry in fs::read_dir(path("fd")).ok()? {
            let entry = entry.ok()?;
            let number = entry.file_name().to_str()?.parse().ok()?;
            let link = fs::read_link(entry.path()).ok()?;
            files.push((number, link.to_string_lossy().into_owned()));
        }
        files.sort_unstable();
        let status = fs::read_to_string(path("status")).ok()?;
        let is_own = |line: &&str| OWN_LINES.iter().any(|name| line.starts_with(name));
        let own = status.lines().filter(is_own).map(str::to_owned).collect();
        Some(Self { maps, files, own })
    }

    /// The writable memory; `None` if other processes share some.
    fn writable(&self) -> Option<Vec<(u64, usize)>> {
        let mut all = Vec::new();
        for line in self.maps.lines() {
            let mut words = line.split(' ');
            let (range, rights) = (words.next()?, words.next()?);
            // The clock page is also executable: its detours stay, and its data are lent again.
            if !rights.starts_with("rw-") {
                continue;
            }
            if !rights.ends_with('p') {
                return None;
            }
            let (from, to) = range.split_once('-')?;
            let [from, to] = [from, to].map(|at| u64::from_str_radix(at, 16).ok());
            all.push((from?, usize::try_from(to?.checked_sub(from?)?).ok()?));
        }
        let bytes: usize = all.iter().map(|(_, len)| len).sum();
        (bytes <= MEMORY_MAX).then_some(all)
    }
}

impl Supervisor {
    /// The current moment, if the program can be put back to it.
    pub(in crate::guest) fn moment(&mut self) -> Option<Moment> {
        let tid = self.waiting_thread()?;
        let stage = self.stage.moment()?;
        let fixed = Fixed::of(tid)?;
        let ports = self.stage.clients();
        let is_known = |(_, link): &(i32, String)| {
            let is_quiet = link == "/dev/null" || link.starts_with("pipe:");
            is_quiet || ports.contains(link)
        };
        if !fixed.files.iter().all(is_known) {
            return None;
        }
        let pid = Pid::from_raw(tid);
        let mut memory = Vec::new();
        for (from, len) in fixed.writable()? {
            let mut bytes = vec![0; len];
            Memory(pid).read(from, &mut bytes).ok()?;
            memory.push((from, bytes));
        }
        let process = self.processes.get(&tid)?;
        Some(Moment {
            thread: self.threads.get(&tid)?.clone(),
            random: process.random.clone(),
            restarts: process.restarts,
            registers: ptrace::getregs(pid).ok()?,
            floats: ptrace::getregset::<NT_PRFPREG>(pid).ok()?,
            memory,
            fixed,
            stage,
        })
    }

    /// Puts the program back to `moment`; returns whether this was possible. If not, the program is
    /// in an unusable state.
    pub(in crate::guest) fn put_back(&mut self, moment: &Moment) -> bool {
        let Some(tid) = self.waiting_thread() else {
            return false;
        };
        let pid = Pid::from_raw(tid);
        let is_same =
            tid == moment.thread.tid.as_raw() && Fixed::of(tid).as_ref() == Some(&moment.fixed);
        if !is_same || !self.stage.put_back(&moment.stage) {
            return false;
        }
        let pieces = moment.memory.iter();
        let pieces = pieces.map(|(from, bytes)| (*from, bytes.as_slice()));
        let is_written = Memory(pid).write_all(pieces).is_ok()
            && ptrace::setregs(pid, moment.registers).is_ok()
            && ptrace::setregset::<NT_PRFPREG>(pid, moment.floats).is_ok();
        if let Some(thread) = self.threads.get_mut(&tid) {
            *thread = moment.thread.clone();
        }
        if let Some(process) = self.processes.get_mut(&tid) {
            process.random = moment.random.clone();
            process.restarts = moment.restarts;
        }
        is_written
    }

    /// The only thread of the program, if it waits at the start of a call and no other event is
    /// pending.
    fn waiting_thread(&self) -> Option<i32> {
        let mut threads = self.threads.values();
        let (Some(thread), None) = (threads.next(), threads.next()) else {
            return None;
        };
        let process = self.processes.get(&thread.process)?;
        let waits = matches!(thread.state, State::Blocked(Wait { on: On::Files, .. }));
        let is_idle = self.queue.is_empty()
            && self.late.is_empty()
            && self.early.is_empty()
            && self.meetings.is_empty()
            && self.notices.is_empty()
            && self.held_over.is_none()
            && self.trouble.is_none()
            && !self.is_signalled;
        let is_plain = self.debugging.is_none()
            && self.left.is_none()
            && self.schedule.is_none()
            && self.computing.is_none()
            && !self.has_signal_files
            && !self.has_told_files
            && !self.has_bound;
        let is_alone = self.processes.len() == 1
            && process.timers.is_empty()
            && process.posix_timers.is_empty()
            && process.alarm.at.is_none()
            && !process.shares_memory
            && !process.is_dying;
        let is_at_begin = !thread.is_at_end && thread.outside.is_none() && thread.progress == 0;
        let is_there = waits && is_at_begin && thread.tid.as_raw() == thread.process;
        (is_there && is_idle && is_plain && is_alone).then_some(thread.process)
    }
}
