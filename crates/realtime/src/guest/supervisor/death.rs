//! Threads and processes: their creation, their change to another program, and their end.

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use emulators::rng::Rng;
use nix::errno::Errno;
use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;
use rustix::process::WaitOptions;

use super::processors::FIRST;
use super::{Call, Flow, GuestError, Memory, Next, On, State, Supervisor, is_death, wait};
use crate::guest::clock_page::ClockPage;
use crate::guest::inject::{Hands, NotMade};
use crate::guest::news::group_of;
use crate::guest::task::{Process, Thread, Timer};

/// Entries of the auxiliary vector of a new program.
const AT_IGNORE: u64 = 1;
const AT_RANDOM: u64 = 25;
const AT_SYSINFO_EHDR: u64 = 33;
/// The flag of `clone` for a child in the memory of its parent (CLONE_VM).
const SHARES: u64 = 0x100;
/// Maximum number of arguments and variables that are skipped before the auxiliary vector.
const WORDS_MAX: u64 = 1 << 20;

impl Supervisor {
    pub(super) fn add_thread(&mut self, tid: Pid, process: Pid, vfork_parent: Option<i32>) {
        let [threads, processes] = &mut self.born;
        let pid = process.as_raw();
        if !self.processes.contains_key(&pid) {
            let stream = format!("guest.{processes}.random");
            *processes += 1;
            let process = Process {
                handle: None,
                files: BTreeMap::new(),
                sites: BTreeSet::new(),
                clocks: None,
                detours: BTreeMap::new(),
                shares_memory: false,
                random: Rng::stream(self.settings.seed, &stream),
                restarts: 0,
                alarm: Timer::default(),
                timers: BTreeMap::new(),
                posix_timers: BTreeMap::new(),
                is_dying: false,
                fatal: None,
            };
            self.processes.insert(pid, process);
        }
        let thread = Thread {
            tid,
            index: *threads,
            process: pid,
            state: State::Ready(Next::Go(None)),
            call: None,
            outside: None,
            entered: self.stage.now(),
            computed: Duration::ZERO,
            in_loop_at: None,
            loop_state: None,
            loop_length: None,
            blocked_at: 0,
            is_woken: false,
            is_at_end: false,
            progress: 0,
            lines_before: None,
            opens: None,
            slice: 0,
            watched: Vec::new(),
            timeout: [0; 16],
            waits_for_ports: false,
            asks_port: false,
            quiet: Vec::new(),
            idle: None,
            processors: FIRST,
            vfork_parent,
        };
        *threads += 1;
        self.threads.insert(tid.as_raw(), thread);
        match vfork_parent {
            Some(_) => self.queue.push_front(tid.as_raw()),
            None => self.queue.push_back(tid.as_raw()),
        }
    }

    /// Handles a thread that has created another thread or a process.
    pub(super) fn cloned(&mut self, tid: i32, event: i32) -> Flow {
        let new = ptrace::getevent(Pid::from_raw(tid)).ok();
        let Some(new) = new.and_then(|new| i32::try_from(new).ok()) else {
            return Flow::Goes(None);
        };
        let pid = Pid::from_raw(new);
        if !self.early.remove(&new) && wait(Some(pid), WaitOptions::empty()).is_none() {
            return Flow::Goes(None);
        }
        let group = Pid::from_raw(group_of(new).unwrap_or(new));
        if self.has_own_memory(tid, event, group.as_raw()) {
            self.forked_for_debugger(tid, pid);
        }
        let is_vfork = event == libc::PTRACE_EVENT_VFORK;
        self.add_thread(pid, group, is_vfork.then_some(tid));
        self.inherit_processors(tid, new);
        let parent = self.threads.get(&tid).map(|thread| thread.process);
        let parent = parent.and_then(|pid| self.processes.get(&pid));
        let inherited = parent.map(|parent| (parent.clocks, parent.detours.clone()));
        if let Some(process) = self.processes.get_mut(&group.as_raw())
            && let Some((clocks, detours)) = inherited
            && process.clocks.is_none()
        {
            // The child's memory is a copy, or the same memory.
            (process.clocks, process.detours) = (clocks, detours);
        }
        if !is_vfork {
            self.note_shared_memory(tid, group.as_raw());
            return Flow::Goes(None);
        }
        // The parent waits in the kernel until its child has executed another program or has ended.
        let _ = ptrace::cont(Pid::from_raw(tid), None);
        self.set_state(tid, State::Outside);
        Flow::Stays
    }

    /// Records that a process created by `clone` may use the memory of its parent.
    fn note_shared_memory(&mut self, tid: i32, child: i32) {
        let Some(parent) = self.threads.get(&tid).map(|thread| thread.process) else {
            return;
        };
        let Some(flags) = clone_flags(tid) else {
            return;
        };
        if parent == child || flags.is_ok_and(|flags| flags & SHARES == 0) {
            return;
        }
        for pid in [parent, child] {
            if let Some(process) = self.processes.get_mut(&pid) {
                process.shares_memory = true;
            }
        }
    }

    /// Whether the new child of `tid` is a process with memory of its own.
    fn has_own_memory(&self, tid: i32, event: i32, child: i32) -> bool {
        if event != libc::PTRACE_EVENT_CLONE {
            return event == libc::PTRACE_EVENT_FORK;
        }
        let parent = self.threads.get(&tid).map(|thread| thread.process);
        let flags = clone_flags(tid).and_then(Result::ok);
        parent != Some(child) && flags.is_some_and(|flags| flags & SHARES == 0)
    }

    /// Lets `parent` continue, whose memory the child no longer uses.
    fn release(&mut self, parent: Option<i32>) {
        let Some(parent) = parent else { return };
        let state = self.threads.get(&parent).map(|thread| thread.state);
        if !matches!(state, Some(State::Outside)) {
            // The event was reported already.
            return;
        }
        match self.wait_for(parent) {
            Some((_, status)) if is_death(status) => self.died(parent, status),
            Some((_, status)) if status >> 16 == libc::PTRACE_EVENT_VFORK_DONE => {
                self.ready(parent, Next::Go(None));
            }
            Some((_, status)) => self.ready(parent, Next::Stopped(status)),
            None => self.forget(parent),
        }
    }

    /// Handles a process that has executed another program: replaces its clock page by ours, or
    /// hides the page, so that each look at a clock is a call.
    pub(super) fn execed(&mut self, tid: i32) -> Flow {
        self.launchers.remove(&tid);
        let others = self.threads.values().filter(|thread| thread.process == tid);
        let others: Vec<i32> = others.map(|thread| thread.tid.as_raw()).collect();
        let mut parent = None;
        for other in others {
            if other == tid {
                parent = self
                    .threads
                    .get_mut(&tid)
                    .and_then(|it| it.vfork_parent.take());
            } else {
                self.threads.remove(&other);
            }
        }
        let is_known = self.threads.contains_key(&tid);
        if !is_known {
            self.add_thread(Pid::from_raw(tid), Pid::from_raw(tid), None);
            self.queue.retain(|&waiting| waiting != tid);
        }
        self.set_state(tid, State::Running);
        if let Some(process) = self.processes.get_mut(&tid) {
            process.restarts = 0;
            process.files.clear();
            process.sites.clear();
            process.clocks = None;
            process.detours.clear();
            process.shares_memory = false;
            process.posix_timers.clear();
        }
        self.keep_open_timers(tid);
        if let Err(error) = refuse(tid) {
            self.trouble = Some(error);
        }
        if takes_chance_from_processor(tid) {
            self.note(
                "std::random_device takes chance from the processor (RDRAND): it differs each time"
                    .to_owned(),
            );
        }
        self.note_program(tid);
        let flow = self.put_clock_page(tid);
        self.release(parent);
        self.execed_for_debugger(tid, flow)
    }

    /// Replaces the kernel's clock page by ours; if this fails, hides the kernel's page.
    fn put_clock_page(&mut self, tid: i32) -> Flow {
        let pid = Pid::from_raw(tid);
        // Let the call run to its end.
        let at_end = ptrace::syscall(pid, None).ok();
        let status = at_end.and_then(|()| wait(Some(pid), WaitOptions::empty()));
        match status {
            Some((_, status)) if is_death(status) => {
                self.died(tid, status);
                return Flow::Stays;
            }
            Some(_) => {}
            None => return Flow::Goes(None),
        }
        let Ok(registers) = ptrace::getregs(pid) else {
            return Flow::Goes(None);
        };
        let put = Hands::of(pid, registers).and_then(|mut hands| {
            let page = ClockPage::put(pid, &mut hands);
            hands.send_again(tid)?;
            page
        });
        if let Err(NotMade::Ended(status)) = put {
            self.died(tid, status);
            return Flow::Stays;
        }
        let _ = ptrace::setregs(pid, registers);
        let page = put.ok();
        if let Some(process) = self.processes.get_mut(&tid) {
            process.clocks = page;
        }
        self.hide_clock_page(tid, page);
        Flow::Goes(None)
    }

    fn hide_clock_page(&mut self, tid: i32, page: Option<ClockPage>) {
        let pid = Pid::from_raw(tid);
        let memory = Memory(pid);
        let Ok(call) = Call::of(pid) else { return };
        let chance = self.chance(tid, 16);
        // Content of the stack: a count, the arguments and a zero, the variables and a zero, the
        // auxiliary vector.
        let mut at = call.stack();
        let Ok(count) = memory.u64(at) else { return };
        at += 8 * (count + 2);
        for _ in 0..WORDS_MAX {
            let Ok(word) = memory.u64(at) else { return };
            at += 8;
            if word == 0 {
                break;
            }
        }
        for _ in 0..64 {
            let (Ok(key), Ok(value)) = (memory.u64(at), memory.u64(at + 8)) else {
                return;
            };
            match key {
                0 => return,
                AT_SYSINFO_EHDR => {
                    let _ = match page {
                        Some(page) => memory.write(at + 8, &page.place.to_ne_bytes()),
                        None => memory.write(at, &AT_IGNORE.to_ne_bytes()),
                    };
                }
                AT_RANDOM => drop(memory.write(value, &chance)),
                _ => {}
            }
            at += 16;
        }
    }

    /// Records that all threads of the process are about to end.
    pub(super) fn dies(&mut self, tid: i32) {
        let process = self.threads.get(&tid).map(|thread| thread.process);
        if let Some(process) = process.and_then(|pid| self.processes.get_mut(&pid)) {
            process.is_dying = true;
            process.files.clear();
        }
    }

    /// Handles the end of a thread.
    pub(super) fn died(&mut self, tid: i32, status: i32) {
        let Some(process) = self.threads.get(&tid).map(|thread| thread.process) else {
            return;
        };
        self.buried(tid, status);
        let is_signal = status & 0x7F != 0;
        let is_dying = self.processes.get(&process).is_some_and(|it| it.is_dying);
        while (is_signal || is_dying) && self.has_threads(process) {
            let Some((pid, status)) = wait(None, WaitOptions::empty()) else {
                break;
            };
            match is_death(status) {
                true => self.buried(pid, status),
                false
                    if self
                        .threads
                        .get(&pid)
                        .is_some_and(|it| it.process == process) =>
                {
                    let _ = ptrace::cont(Pid::from_raw(pid), None);
                }
                false => self.note_other(pid, status),
            }
        }
        self.wake_after_death();
    }

    fn has_threads(&self, process: i32) -> bool {
        self.threads
            .values()
            .any(|thread| thread.process == process)
    }

    /// Removes an ended thread; with the first thread of a process also the process.
    pub(super) fn buried(&mut self, tid: i32, status: i32) {
        let Some(thread) = self.threads.remove(&tid) else {
            return;
        };
        self.queue.retain(|&waiting| waiting != tid);
        self.buried_for_debugger(tid, status);
        self.end_meeting(tid);
        self.is_changed = true;
        if tid != thread.process {
            return;
        }
        if self.stage.is_frozen {
            self.last_ends.push(status);
        }
        let gone = self.processes.remove(&tid);
        let fatal = gone.as_ref().and_then(|it| it.fatal);
        for (fd, timer) in gone.into_iter().flat_map(|it| it.timers) {
            self.hand_on(timer, (tid, fd));
        }
        self.notices.retain(|&(process, _), _| process != tid);
        self.threads.retain(|_, other| other.process != tid);
        self.fatal.extend(fatal.map(|signal| (tid, signal)));
        if let Some(ended) = self.roots.get_mut(&tid) {
            *ended = Some(fatal.unwrap_or(status));
        }
        // The kernel may have released its semaphores.
        self.has_queues_changed = true;
        self.stage.touch();
        self.is_signalled = true;
        self.wake_parents();
        self.release(thread.vfork_parent);
    }

    /// Lets threads that wait for their children check again.
    pub(super) fn wake_parents(&mut self) {
        let parents = self
            .threads
            .values()
            .filter(|thread| matches!(thread.state, State::Blocked(wait) if wait.on == On::Child));
        let mut parents: Vec<(u32, i32)> = parents
            .map(|thread| (thread.index, thread.tid.as_raw()))
            .collect();
        parents.sort_unstable();
        for (_, parent) in parents {
            self.set_at_end(parent, false);
            self.ready(parent, Next::Go(None));
        }
    }

    /// Removes a thread that reports no more events.
    pub(super) fn forget(&mut self, tid: i32) {
        self.buried(tid, 0);
    }
}

/// The flags of the `clone` with which `tid` has created a thread or process; `None` for another
/// call.
fn clone_flags(tid: i32) -> Option<Result<u64, Errno>> {
    let registers = ptrace::getregs(Pid::from_raw(tid)).ok()?;
    match i64::try_from(registers.orig_rax) {
        Ok(libc::SYS_clone) => Some(Ok(registers.rdi)),
        Ok(libc::SYS_clone3) => Some(Memory(Pid::from_raw(tid)).u64(registers.rdi)),
        _ => None,
    }
}

/// Rejects programs that cannot be supervised.
fn refuse(pid: i32) -> Result<(), GuestError> {
    use std::io::Read as _;
    use std::os::unix::fs::PermissionsExt as _;

    let path = format!("/proc/{pid}/exe");
    let name = std::fs::read_link(&path).unwrap_or_default();
    let mode = std::fs::metadata(&path).map_or(0, |data| data.permissions().mode());
    if mode & 0o6000 != 0 {
        return Err(GuestError::Setuid(name));
    }
    let mut head = [0; 5];
    let read = std::fs::File::open(&path).and_then(|mut file| file.read_exact(&mut head));
    // The fifth byte of an ELF file: 2 is 64 bit.
    match read {
        Ok(()) if head[4] != 2 => Err(GuestError::OtherArchitecture(name)),
        _ => Ok(()),
    }
}

/// Maximum number of bytes of a program that are searched for the names of its functions.
const NAMES_MAX: u64 = 1 << 20;
/// The C++ library's source of random numbers, which first uses the processor's instruction.
const RANDOM_DEVICE: &[u8] = b"_ZNSt13random_device";

/// Whether a program uses that source.
fn takes_chance_from_processor(pid: i32) -> bool {
    use std::io::Read as _;

    let mut head = Vec::new();
    let program = std::fs::File::open(format!("/proc/{pid}/exe"));
    let read = program.and_then(|file| file.take(NAMES_MAX).read_to_end(&mut head));
    read.is_ok()
        && head
            .windows(RANDOM_DEVICE.len())
            .any(|word| word == RANDOM_DEVICE)
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::guest::supervisor::tests::Bench;
    use crate::guest::supervisor::{Wait, futex};
    use crate::guest::tests::Stopped;

    /// With the first thread of a process all of it is gone.
    #[test]
    fn a_process_ends_with_its_first_thread() {
        let mut bench = Bench::new();
        let own = bench.tid;
        for (tid, process) in [
            (1_000_001, 1_000_001),
            (1_000_002, 1_000_001),
            (1_000_003, own),
        ] {
            bench.add(tid, process, State::Running);
        }
        bench.supervisor.queue.extend([1_000_002, 1_000_003]);
        bench.supervisor.is_changed = false;
        bench.supervisor.buried(1_000_003, 0);
        assert!(core::mem::take(&mut bench.supervisor.is_changed));
        assert_eq!(bench.supervisor.queue, [1_000_002]);
        assert!(!bench.supervisor.is_signalled && bench.supervisor.processes.contains_key(&own));
        bench.supervisor.roots.insert(1_000_001, None);
        bench.supervisor.buried(1_000_001, 0x300);
        assert_eq!(
            bench.supervisor.threads.keys().copied().collect::<Vec<_>>(),
            [own]
        );
        assert!(!bench.supervisor.processes.contains_key(&1_000_001));
        assert!(bench.supervisor.is_signalled && bench.supervisor.has_queues_changed);
        assert_eq!(bench.supervisor.status(1_000_001), Some(0x300));
        assert!(bench.supervisor.last_ends.is_empty());
        // After the run ends are noted; a signal beyond 31 is told in place of SIGKILL.
        bench.supervisor.stage.is_frozen = true;
        bench.add(1_000_004, 1_000_004, State::Running);
        bench.supervisor.roots.insert(1_000_004, None);
        let process = bench.supervisor.processes.get_mut(&1_000_004);
        process.expect("added").fatal = Some(40);
        bench.supervisor.buried(1_000_004, 9);
        assert_eq!(bench.supervisor.last_ends, [9]);
        assert_eq!(bench.supervisor.status(1_000_004), Some(40));
        assert_eq!(bench.supervisor.fatal.get(&1_000_004), Some(&40));
        bench.supervisor.buried(-7, 9);
        assert_eq!(bench.supervisor.last_ends, [9]);
    }

    /// Threads that wait for their children look again, in the order of their birth.
    #[test]
    fn parents_look_for_their_children() {
        let mut bench = Bench::new();
        let own = bench.tid;
        let wait = |on| State::Blocked(Wait { on, deadline: None });
        bench.add(1_000_009, own, wait(On::Child)).is_at_end = true;
        bench.add(1_000_001, own, wait(On::Child));
        bench.add(1_000_002, own, wait(On::Files));
        bench.supervisor.wake_parents();
        assert_eq!(bench.supervisor.queue, [1_000_009, 1_000_001]);
        let first = &bench.supervisor.threads[&1_000_009];
        assert!(!first.is_at_end && matches!(first.state, State::Ready(Next::Go(None))));
    }

    /// Each process has its own random numbers. They depend on the seed of the run and on the order
    /// in which processes begin.
    #[test]
    fn threads_and_processes_are_counted_by_birth() {
        let drawn = || {
            let mut bench = Bench::new();
            let own = bench.tid;
            bench.add(1_000_001, 1_000_001, State::Running);
            bench.add(1_000_002, own, State::Running);
            let index = |tid| bench.supervisor.threads[&tid].index;
            assert_eq!([own, 1_000_001, 1_000_002].map(index), [0, 1, 2]);
            assert_eq!(
                (bench.supervisor.born, bench.supervisor.processes.len()),
                ([3, 2], 2)
            );
            [own, 1_000_001].map(|pid| bench.supervisor.chance(pid, 16))
        };
        let [one, other] = drawn();
        assert!(one != other && drawn() == [one, other]);
        let mut bench = Bench::new();
        bench.supervisor.queue.push_back(5);
        bench
            .supervisor
            .add_thread(Pid::from_raw(1_000_001), Pid::from_raw(1_000_001), None);
        let parent = Some(bench.tid);
        bench
            .supervisor
            .add_thread(Pid::from_raw(1_000_002), Pid::from_raw(1_000_002), parent);
        assert_eq!(
            bench.supervisor.queue,
            [1_000_002, 5, 1_000_001],
            "its parent waits for it"
        );
        assert!(bench.supervisor.has_threads(1_000_001) && !bench.supervisor.has_threads(7));
        let _ = futex::ALL;
    }

    /// clone(2): CLONE_VM is 0x100; a child that does not share memory has its own.
    #[test]
    fn a_child_has_memory_of_its_own_or_that_of_its_parent() {
        let mut bench = Bench::new();
        let stopped = Stopped::new();
        let parent = stopped.pid.as_raw();
        bench.add(parent, parent, State::Running);
        bench.add(1_000_001, 1_000_001, State::Running);
        let flags = |number: i64, flags: u64| {
            stopped.change(|registers| {
                registers.orig_rax = number.cast_unsigned();
                registers.rdi = flags;
            });
        };
        let clone = libc::PTRACE_EVENT_CLONE;
        let own =
            |bench: &Bench, event, child| bench.supervisor.has_own_memory(parent, event, child);
        assert!(own(&bench, libc::PTRACE_EVENT_FORK, 1_000_001));
        assert!(!own(&bench, libc::PTRACE_EVENT_VFORK, 1_000_001));
        flags(libc::SYS_clone, 0x11);
        assert!(own(&bench, clone, 1_000_001) && !own(&bench, clone, parent));
        flags(libc::SYS_clone, 0x111);
        assert!(!own(&bench, clone, 1_000_001));
        let at = stopped.registers().rsp - 256;
        let memory = Memory(stopped.pid);
        memory
            .write(at, &0x100_u64.to_ne_bytes())
            .expect("its stack");
        flags(libc::SYS_clone3, at);
        assert!(!own(&bench, clone, 1_000_001));
        assert_eq!(clone_flags(parent), Some(Ok(0x100)));
        memory
            .write(at, &0x11_u64.to_ne_bytes())
            .expect("its stack");
        assert!(own(&bench, clone, 1_000_001));
        flags(libc::SYS_fork, 0);
        assert!(!own(&bench, clone, 1_000_001) && clone_flags(parent).is_none());
        let shares = |bench: &mut Bench| {
            bench.supervisor.note_shared_memory(parent, 1_000_001);
            let of = |pid| bench.supervisor.processes[&pid].shares_memory;
            [of(parent), of(1_000_001)]
        };
        assert_eq!(shares(&mut bench), [false; 2]);
        flags(libc::SYS_clone, 0x11);
        assert_eq!(shares(&mut bench), [false; 2]);
        flags(libc::SYS_clone, 0x111);
        bench.supervisor.note_shared_memory(parent, parent);
        assert!(
            !bench.supervisor.processes[&parent].shares_memory,
            "a thread"
        );
        assert_eq!(shares(&mut bench), [true; 2]);
        assert!(clone_flags(-1).is_none());
    }

    /// The stack of a new program (elf): a count, arguments and a zero, variables and a zero, and a
    /// table of pairs: 25 is chance, 33 the kernel's page, 1 an entry to be left out.
    #[test]
    fn the_table_of_a_new_program_shows_our_page() {
        let mut bench = Bench::new();
        let stopped = Stopped::new();
        let tid = stopped.pid.as_raw();
        bench.add(tid, tid, State::Running);
        let at = stopped.registers().rsp - 2_048;
        let chance = at + 1_024;
        let table = [
            2, 7, 7, 0, 8, 8, 8, 0, 33, 0x5000, 25, chance, 6, 4_096, 0, 0, 33, 0x6000,
        ];
        let memory = Memory(stopped.pid);
        let put = || {
            let bytes: Vec<[u8; 8]> = table.map(u64::to_ne_bytes).to_vec();
            memory.write(at, bytes.as_flattened()).expect("its stack");
            memory.write(chance, &[0; 24]).expect("its stack");
            stopped.change(|registers| registers.rsp = at);
        };
        let words = |from: u64, count: u64| -> Vec<u64> {
            (0..count)
                .map(|index| memory.u64(from + 8 * index).expect("its stack"))
                .collect()
        };
        put();
        bench
            .supervisor
            .hide_clock_page(tid, Some(ClockPage::at(0x7_0000)));
        let mut expected = table.to_vec();
        expected[9] = ClockPage::at(0x7_0000).place;
        assert_eq!(words(at, 18), expected);
        let given = words(chance, 3);
        assert!(given[0] != 0 && given[1] != 0 && given[2] == 0);
        put();
        bench.supervisor.hide_clock_page(tid, None);
        let mut expected = table.to_vec();
        expected[8] = 1;
        assert_eq!(words(at, 18), expected);
        assert!(
            words(chance, 2) != given[..2],
            "the next bytes of its chance"
        );
    }

    /// Programs with other rights (setuid, setgid) or of 32 bits are refused.
    #[test]
    fn programs_that_cannot_be_supervised_are_refused() {
        let own = std::process::id().cast_signed();
        assert!(refuse(own).is_ok() && refuse(-1).is_ok());
        let stopped = Stopped::new();
        assert!(refuse(stopped.pid.as_raw()).is_ok());
        assert!(!takes_chance_from_processor(stopped.pid.as_raw()));
        assert!(!takes_chance_from_processor(-1));
    }

    #[test]
    fn a_dying_process_keeps_no_files() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let null = std::fs::File::open("/dev/null").expect("it is there");
        let fd = std::os::fd::AsRawFd::as_raw_fd(&null);
        assert!(bench.supervisor.file(tid, fd).is_some());
        bench.supervisor.dies(-7);
        assert!(!bench.process().is_dying);
        bench.supervisor.dies(tid);
        assert!(bench.process().is_dying && bench.process().files.is_empty());
    }

    /// A program with rights of its own (set-user-ID, chmod(2)) cannot be traced. One with the C++
    /// library's source of random numbers takes some from the processor.
    #[test]
    fn a_program_is_looked_at_when_it_starts() {
        use std::os::unix::fs::PermissionsExt as _;

        use crate::guest::tests::program::{Guest, exit, rests};

        let guest = Guest::runs(&[], &[&rests()]);
        let pid = guest.process.pid.as_raw();
        assert!(guest.bench.supervisor.notes().is_empty());
        assert!(refuse(pid).is_ok());
        let path = std::fs::read_link(format!("/proc/{pid}/exe")).expect("it runs");
        for (mode, is_refused) in [(0o4755, true), (0o2755, true), (0o755, false)] {
            let mode = std::fs::Permissions::from_mode(mode);
            std::fs::set_permissions(&path, mode).expect("ours");
            assert_eq!(refuse(pid).is_err(), is_refused);
        }
        let guest = Guest::runs(b"_ZNSt13random_device", &[&exit(0)]);
        let note = "std::random_device takes chance from the processor (RDRAND): it differs each \
                    time";
        assert_eq!(guest.bench.supervisor.notes(), [note]);
        let guest = Guest::runs(b"_ZNSt13random_devic", &[&exit(0)]);
        assert!(guest.bench.supervisor.notes().is_empty());
    }
}
