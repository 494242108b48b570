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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::Bench;

    fn fixed(maps: &str) -> Fixed {
        Fixed {
            maps: maps.to_owned(),
            files: Vec::new(),
            own: Vec::new(),
        }
    }

    /// proc(5): a range, its rights with `p` for private memory, and more.
    #[test]
    fn writable_memory_is_read_from_the_list() {
        let all = "1000-3000 rw-p 0 00:00 0\n4000-5000 r--p 0 00:00 0\n\
                   6000-6010 rw-p 0 00:00 0 [heap]\n\
                   7000-8000 rwxp 0 00:00 0\n9000-a000 r-xs 0 00:00 0\n";
        assert_eq!(
            fixed(all).writable(),
            Some(vec![(0x1000, 0x2000), (0x6000, 0x10)])
        );
        let shared = format!("{all}b000-c000 rw-s 0 00:00 0\n");
        assert_eq!(fixed(&shared).writable(), None);
        assert_eq!(
            fixed("1000-801000 rw-p 0\n").writable(),
            Some(vec![(0x1000, 8 << 20)])
        );
        assert_eq!(
            fixed("1000-801010 rw-p 0\n").writable(),
            None,
            "more than 8 MiB"
        );
        assert_eq!(fixed("1000 rw-p 0\n").writable(), None);
        assert_eq!(fixed("3000-1000 rw-p 0\n").writable(), None);
        assert_eq!(fixed("").writable(), Some(vec![]));
    }

    #[test]
    fn the_state_of_a_process_is_its_mappings_files_and_masks() {
        let stopped = crate::guest::tests::Stopped::new();
        let pid = stopped.pid.as_raw();
        let it = Fixed::of(pid).expect("it stands");
        assert!(it.maps.contains("[stack]") && it.files.iter().any(|(fd, _)| *fd == 0));
        assert!(it.files.is_sorted());
        let names: Vec<&str> = it
            .own
            .iter()
            .filter_map(|line| line.split(':').next())
            .collect();
        for name in OWN_LINES {
            assert!(names.contains(&name), "{name} of {names:?}");
        }
        assert_eq!(Fixed::of(pid), Some(it));
        assert_eq!(Fixed::of(-1), None);
    }

    /// A thread that waits for its ports at the beginning of a call, and each thing that is in the
    /// way of putting it back.
    #[test]
    fn a_program_that_does_nothing_else_can_be_put_back() {
        let can = |change: &dyn Fn(&mut Bench)| {
            let mut bench = Bench::new();
            let wait = Wait {
                on: On::Files,
                deadline: None,
            };
            bench.thread().state = State::Blocked(wait);
            change(&mut bench);
            let found = bench.supervisor.waiting_thread();
            assert!(found.is_none_or(|tid| tid == bench.tid));
            found.is_some()
        };
        assert!(can(&|_| {}));
        let changes: [&dyn Fn(&mut Bench); 26] = [
            &|it| it.thread().state = State::Running,
            &|it| it.thread().state = State::Blocked(Wait::for_ever()),
            &|it| it.thread().is_at_end = true,
            &|it| it.thread().outside = it.thread().call.or(Some(super::super::Call::made(0, &[]))),
            &|it| it.thread().progress = 1,
            &|it| it.supervisor.queue.push_back(1),
            &|it| it.supervisor.late.push((protocols::Instant::ZERO, 1)),
            &|it| it.supervisor.early.extend([1]),
            &|it| {
                it.supervisor
                    .notices
                    .insert((1, 1), super::super::Notice::default_of(1));
            },
            &|it| it.supervisor.held_over = Some((1, super::super::Next::Attempt)),
            &|it| it.supervisor.trouble = Some(crate::guest::GuestError::Restart),
            &|it| it.supervisor.is_signalled = true,
            &|it| it.supervisor.begin_debugging(super::super::Wanted::Nothing),
            &|it| it.supervisor.schedule = Some(super::super::Schedule::new(1)),
            &|it| it.supervisor.has_signal_files = true,
            &|it| it.supervisor.has_told_files = true,
            &|it| it.supervisor.has_bound = true,
            &|it| it.process().alarm.at = Some(protocols::Instant::ZERO),
            &|it| it.process().shares_memory = true,
            &|it| it.process().is_dying = true,
            &|it| {
                let own = it.tid;
                it.add(1_000_001, own, State::Running);
            },
            &|it| it.supervisor.threads.clear(),
            &|it| it.supervisor.processes.clear(),
            &|it| {
                it.add(1_000_001, 1_000_001, State::Running);
                it.supervisor.threads.remove(&1_000_001);
            },
            &|it| {
                use crate::guest::task::{PosixTimer, Timer};
                let timer = PosixTimer {
                    clock: 1,
                    signal: 0,
                    value: 0,
                    thread: None,
                    timer: Timer::default(),
                    is_due: false,
                    is_sent: false,
                    overrun: 0,
                };
                it.process().posix_timers.insert(0, timer);
            },
            &|it| {
                use crate::guest::task::{Timer, TimerFile};
                let null = fs::File::open("/dev/null").expect("it is there");
                let timer = TimerFile {
                    file: null.into(),
                    clock: 1,
                    timer: Timer::default(),
                    expired: 0,
                };
                it.process().timers.insert(3, timer);
            },
        ];
        for (index, change) in changes.into_iter().enumerate() {
            assert!(!can(change), "change {index}");
        }
    }

    /// Registers and memory of a process that waits are written back.
    #[test]
    fn a_waiting_program_is_put_back() {
        let mut bench = Bench::new();
        let _port = bench.opens("sonar");
        let stopped = crate::guest::tests::Stopped::without_files();
        let (own, pid) = (bench.tid, stopped.pid.as_raw());
        let wait = Wait {
            on: On::Files,
            deadline: None,
        };
        bench.add(pid, pid, State::Blocked(wait));
        bench.supervisor.threads.remove(&own);
        bench.supervisor.processes.remove(&own);
        bench.supervisor.is_signalled = false;
        let place = stopped.registers().rsp - 64;
        Memory(stopped.pid)
            .write(place, &[1; 8])
            .expect("its stack");
        let process = bench.supervisor.processes.get_mut(&pid).expect("added");
        process.restarts = 5;
        let Some(moment) = bench.supervisor.moment() else {
            // More than 8 MiB of memory, or another kind of memory.
            panic!("nothing else is under way");
        };
        let next = bench.supervisor.chance(pid, 8);
        Memory(stopped.pid)
            .write(place, &[2; 8])
            .expect("its stack");
        stopped.change(|registers| registers.rbx ^= 1);
        let thread = bench.supervisor.threads.get_mut(&pid).expect("added");
        thread.slice = 77;
        let process = bench.supervisor.processes.get_mut(&pid).expect("added");
        process.restarts = 6;
        let changed = stopped.registers().rbx;
        assert!(bench.supervisor.put_back(&moment));
        assert_eq!(stopped.registers().rbx, changed ^ 1);
        assert_eq!(Memory(stopped.pid).u64(place), Ok(0x0101_0101_0101_0101));
        assert_eq!(bench.supervisor.threads[&pid].slice, 0);
        assert_eq!(bench.supervisor.processes[&pid].restarts, 5);
        assert_eq!(
            bench.supervisor.chance(pid, 8),
            next,
            "the same chance again"
        );
        bench.supervisor.has_bound = true;
        assert!(!bench.supervisor.put_back(&moment));
    }
}
