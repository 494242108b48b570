//! Threads that wait in a loop without a call, such as `while (!flag);`.
//!
//! If the registers and the memory of a thread return to an earlier state, the thread repeats this
//! until another thread changes memory. Its position in the loop does not matter then: it is always
//! moved to the same instruction, so that the processor's speed has no effect.

use core::time::Duration;

use nix::libc;
use nix::sys::ptrace;
use nix::sys::ptrace::regset::NT_PRFPREG;
use nix::unistd::Pid;
use rustix::process::WaitOptions;

use super::{Flow, Memory, Next, State, Supervisor, wait};

/// Maximum length of a loop, instructions.
const LOOP_MAX: u32 = 20_000;
/// Maximum size of the compared memory, bytes.
const MEMORY_MAX: u64 = 256 << 20;
/// Number of bytes in one read.
const PIECE: usize = 1 << 20;
/// Signal code of a single step (`TRAP_TRACE`).
const BY_STEP: i32 = 2;
/// Maximum number of time steps before the loop is checked again.
const LEAPS_MAX: u32 = 100;

/// Factor of fingerprints: 2^64 divided by the golden ratio, as an odd number.
const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15;

/// Maximum number of instructions for the check of a known loop: this multiple of its length, and
/// some more.
const KNOWN_TIMES: u32 = 4;
const KNOWN_MORE: u32 = 64;

/// Activity of a thread without calls.
enum Spin {
    /// It waits for another thread, and has stopped at the first instruction of its loop; with a
    /// fingerprint of its state there, and the loop's length.
    Waits(u64, u32),
    Computes,
    /// It has stopped for another reason: the system's status.
    Stopped(i32),
}

/// The registers that a program can see.
type Registers = [u64; 18];

/// The registers of a thread, the instruction pointer first.
fn registers(pid: Pid) -> Option<Registers> {
    let it = ptrace::getregs(pid).ok()?;
    Some([
        it.rip, it.rsp, it.rbp, it.rax, it.rbx, it.rcx, it.rdx, it.rsi, it.rdi, it.r8, it.r9,
        it.r10, it.r11, it.r12, it.r13, it.r14, it.r15, it.eflags,
    ])
}

/// A fingerprint of all memory that the program can write, and of its floating-point registers;
/// `None` if the memory is too large.
fn fingerprint(pid: Pid) -> Option<u64> {
    let float = ptrace::getregset::<NT_PRFPREG>(pid).ok()?;
    let text = std::fs::read_to_string(format!("/proc/{pid}/maps")).ok()?;
    let mut print = FACTOR;
    let mut mix = |word: u64| print = (print ^ word).wrapping_mul(FACTOR).rotate_left(29);
    for half in float.xmm_space.into_iter().chain(float.st_space) {
        mix(half.into());
    }
    let (mut buf, mut left) = (vec![0; PIECE], MEMORY_MAX);
    for line in text.lines() {
        let (range, rest) = line.split_once(' ')?;
        if rest.as_bytes().get(1) != Some(&b'w') {
            continue;
        }
        let (from, to) = range.split_once('-')?;
        let [mut at, end] = [from, to].map(|it| u64::from_str_radix(it, 16).unwrap_or(0));
        left = left.checked_sub(end.saturating_sub(at))?;
        while at < end {
            let len = usize::try_from(end - at).unwrap_or(PIECE).min(PIECE);
            if Memory(pid).read(at, &mut buf[..len]).is_ok() {
                for word in buf[..len].chunks_exact(8) {
                    mix(u64::from_ne_bytes(word.try_into().unwrap_or_default()));
                }
            }
            at += len as u64;
        }
    }
    Some(print)
}

impl Supervisor {
    /// Handles a thread that has computed for a while without a call: if it waits for other
    /// threads, these run first.
    pub(super) fn spins(&mut self, tid: i32) -> Flow {
        if self.keeps_loan || self.is_stepped(tid) {
            return self.go_on_later(tid);
        }
        match self.look_for_loop(tid, LOOP_MAX) {
            Spin::Stopped(status) => self.handle(tid, status),
            Spin::Computes => self.go_on_later(tid),
            Spin::Waits(state, length) => self.waits_in_loop(tid, state, length),
        }
    }

    /// Whether a debugger lets this thread run in single steps.
    fn is_stepped(&self, tid: i32) -> bool {
        let debugging = self.debugging.as_ref();
        let step = debugging.and_then(|it| it.step.as_ref());
        step.is_some_and(|step| step.tid == tid)
    }

    /// Lets a thread continue that was found in a loop. A short check shows whether it is still in
    /// the loop, without the processor time that finding a loop takes.
    pub(super) fn go_on_in_loop(&mut self, tid: i32) -> Flow {
        let thread = self.threads.get_mut(&tid);
        let length = thread.and_then(|thread| thread.loop_length.take());
        let is_free = !self.keeps_loan && !self.is_stepped(tid);
        let Some(length) = length.filter(|_| is_free) else {
            return Flow::Goes(None);
        };
        let limit = length
            .saturating_mul(KNOWN_TIMES)
            .saturating_add(KNOWN_MORE);
        match self.look_for_loop(tid, limit.min(LOOP_MAX)) {
            Spin::Stopped(status) => self.handle(tid, status),
            Spin::Computes => Flow::Goes(None),
            Spin::Waits(state, length) => self.waits_in_loop(tid, state, length),
        }
    }

    /// Handles a thread that has stopped at the first instruction of its loop.
    fn waits_in_loop(&mut self, tid: i32, state: u64, length: u32) -> Flow {
        self.note_loop(tid, state, length);
        self.forgive_computing(tid);
        let is_in_loop = |tid: &i32| {
            let thread = self.threads.get(tid);
            thread.is_some_and(|it| it.in_loop_at == Some(self.progress))
        };
        let is_alone = self.queue.iter().all(is_in_loop);
        if is_alone && self.schedule.is_none() && self.late.is_empty() {
            // Only time can end the loop, but time stands while a thread can run: the thread counts
            // as computing.
            if let Some(thread) = self.threads.get_mut(&tid) {
                thread.loop_length = None;
            }
            return self.go_on_later(tid);
        }
        if is_alone {
            self.pass_for_loop(tid);
        }
        self.ready(tid, Next::Go(None));
        Flow::Stays
    }

    /// Records that a thread is in a loop. If its state there differs from before, it has changed
    /// memory meanwhile, and other threads may leave their loops.
    fn note_loop(&mut self, tid: i32, state: u64, length: u32) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.loop_length = Some(length);
            // Other threads have run since then. A loop counts as computing only if no other thread
            // runs.
            if thread.in_loop_at != Some(self.progress) {
                thread.computed = Duration::ZERO;
            }
            self.progress += u64::from(thread.loop_state != Some(state));
            thread.loop_state = Some(state);
            thread.in_loop_at = Some(self.progress);
        }
    }

    /// Lets time pass until a thread can run that does not wait in a loop.
    fn pass_for_loop(&mut self, tid: i32) {
        let can_run = self.queue.len();
        for _ in 0..LEAPS_MAX {
            // The changes may make files ready for threads that wait for them.
            self.is_changed = false;
            self.retry_files(None);
            if self.queue.len() > can_run || self.is_signalled {
                // This may end the loop.
                if let Some(thread) = self.threads.get_mut(&tid) {
                    thread.computed = Duration::ZERO;
                }
                return;
            }
            if self.stage.is_over() {
                return;
            }
            if let Err(error) = self.let_time_pass() {
                self.trouble = Some(error);
                return;
            }
        }
    }

    /// Ends the turn; the next turn continues with the same thread.
    fn go_on_later(&mut self, tid: i32) -> Flow {
        self.stop_for_schedule(tid);
        let next = Some((tid, Next::Go(None)));
        match &mut self.debugging {
            Some(debugging) => debugging.held = next,
            None => self.held_over = next,
        }
        self.set_state(tid, State::Running);
        Flow::Stays
    }

    fn look_for_loop(&mut self, tid: i32, most: u32) -> Spin {
        let pid = Pid::from_raw(tid);
        // A look at a clock must be a call, which ends the loop.
        self.keep_time(tid);
        let Some(mut kept) = registers(pid) else {
            return Spin::Computes;
        };
        // The state is stored at each power of two (Brent's cycle detection).
        let (mut length, mut limit) = (0, 1);
        for _ in 0..most {
            let now = match self.one_instruction(pid) {
                Ok(now) => now,
                Err(spin) => return spin,
            };
            length += 1;
            if now == kept {
                return self.prove_loop(pid, kept, length);
            }
            if length == limit {
                (kept, length, limit) = (now, 0, limit * 2);
            }
        }
        Spin::Computes
    }

    /// Checks whether `length` instructions from here lead to the same state. If so, runs to the
    /// first instruction of the loop.
    fn prove_loop(&self, pid: Pid, start: Registers, length: u32) -> Spin {
        let before = fingerprint(pid);
        let (mut first, mut now) = (start, start);
        for _ in 0..length {
            now = match self.one_instruction(pid) {
                Ok(now) => now,
                Err(spin) => return spin,
            };
            first = first.min(now);
        }
        let memory = match (before, fingerprint(pid)) {
            (Some(before), Some(after)) if now == start && before == after => after,
            _ => return Spin::Computes,
        };
        while now != first {
            now = match self.one_instruction(pid) {
                Ok(now) => now,
                Err(spin) => return spin,
            };
        }
        let mixed = now
            .into_iter()
            .fold(memory, |print, word| (print ^ word).wrapping_mul(FACTOR));
        Spin::Waits(mixed, length)
    }

    fn one_instruction(&self, pid: Pid) -> Result<Registers, Spin> {
        self.watchdog.count();
        ptrace::step(pid, None).map_err(|_| Spin::Computes)?;
        let (_, status) = wait(Some(pid), WaitOptions::empty()).ok_or(Spin::Computes)?;
        let is_step = status >> 8 == libc::SIGTRAP
            && ptrace::getsiginfo(pid).is_ok_and(|info| info.si_code == BY_STEP);
        match registers(pid).filter(|_| is_step) {
            Some(registers) => Ok(registers),
            None => Err(Spin::Stopped(status)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use nix::sys::signal::Signal;

    use crate::guest::supervisor::tests::Bench;
    use crate::guest::supervisor::{Step, Wanted};
    use crate::guest::tests::Stopped;

    #[test]
    fn another_state_of_a_loop_is_progress() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let note = |bench: &mut Bench, state| {
            bench.thread().computed = Duration::from_secs(1);
            bench.supervisor.note_loop(tid, state, 7);
            let thread = bench.thread();
            assert_eq!(thread.loop_length, Some(7));
            let was_kept = thread.computed > Duration::ZERO;
            let at = thread.in_loop_at;
            assert_eq!(at, Some(bench.supervisor.progress));
            (bench.supervisor.progress, was_kept)
        };
        assert_eq!(note(&mut bench, 1), (1, false));
        assert_eq!(note(&mut bench, 1), (1, true));
        assert_eq!(note(&mut bench, 2), (2, true));
        bench.supervisor.progress += 1;
        assert_eq!(note(&mut bench, 2), (3, false), "others have gone on");
    }

    /// A thread that stands at the first byte of this code.
    fn stands_at(code: &[u8]) -> (Bench, Stopped, u64) {
        let stopped = Stopped::that_calls();
        stopped.stays_on_one_processor();
        let at = stopped.runs(code);
        let tid = stopped.pid.as_raw();
        let mut bench = Bench::new();
        bench.add(tid, tid, State::Running);
        (bench, stopped, at)
    }

    /// Result of a look for a loop.
    #[derive(Debug, PartialEq)]
    enum Found {
        /// Length of the loop.
        Waits(u32),
        Computes,
        Stopped(i32),
    }

    fn looks(bench: &mut Bench, stopped: &Stopped, most: u32) -> (Found, u64) {
        let tid = stopped.pid.as_raw();
        match bench.supervisor.look_for_loop(tid, most) {
            Spin::Waits(state, length) => (Found::Waits(length), state),
            Spin::Computes => (Found::Computes, 0),
            Spin::Stopped(status) => (Found::Stopped(status), 0),
        }
    }

    /// `jmp -2` is EB FE. Ten times `nop`.
    const TO_ITSELF: &[u8] = &[0xEB, 0xFE];
    const ELEVEN: &[u8] = &[
        0x90, 0x90, 0x90, 0x90, 0x90, 0x90, 0x90, 0x90, 0x90, 0x90, 0xEB, 0xF4,
    ];

    /// Intel's manual, volume 2: `nop` 90, `inc eax` FF C0, `not dword [rsp]` F7 14 24, which
    /// changes no flag, `jmp` EB with the distance from its end, `int3` CC.
    #[test]
    fn a_thread_waits_whose_registers_and_memory_return() {
        let twice = [0xF7, 0x14, 0x24, 0xF7, 0x14, 0x24, 0xEB, 0xF8];
        for (code, expected) in [
            (TO_ITSELF, Found::Waits(1)),
            (&[0x90, 0xEB, 0xFD], Found::Waits(2)),
            (ELEVEN, Found::Waits(11)),
            (&twice, Found::Waits(3)),
            (&[0xF7, 0x14, 0x24, 0xEB, 0xFB], Found::Computes),
            (&[0xFF, 0xC0, 0xEB, 0xFC], Found::Computes),
            (&[0x90, 0xCC], Found::Stopped(0x57F)),
        ] {
            let (mut bench, stopped, at) = stands_at(code);
            let waits = matches!(expected, Found::Waits(_));
            assert_eq!(looks(&mut bench, &stopped, 100).0, expected, "{code:x?}");
            let now = stopped.registers().rip;
            assert!(!waits || now == at, "it is at the first instruction");
        }
        // Wherever it was in its loop.
        let (mut bench, stopped, at) = stands_at(ELEVEN);
        stopped.change(|registers| registers.rip = at + 4);
        assert_eq!(looks(&mut bench, &stopped, 100).0, Found::Waits(11));
        assert_eq!(stopped.registers().rip, at);
    }

    /// By hand (Brent): the state is kept after 1, 3, 7 and 15 instructions, for the next 2, 4, 8
    /// and 16. A loop of eleven is found 11 instructions behind the 15th.
    #[test]
    fn a_loop_is_found_after_some_instructions() {
        for (most, expected) in [(25, Found::Computes), (26, Found::Waits(11))] {
            let (mut bench, stopped, _) = stands_at(ELEVEN);
            assert_eq!(looks(&mut bench, &stopped, most).0, expected, "{most}");
        }
    }

    /// The state of a loop is that of its registers and of memory that can be written.
    #[test]
    fn a_loop_has_a_state() {
        let (mut bench, stopped, at) = stands_at(TO_ITSELF);
        let mut state = || {
            let (found, state) = looks(&mut bench, &stopped, 10);
            assert_eq!(found, Found::Waits(1));
            state
        };
        let first = state();
        assert_eq!(state(), first);
        // Its code cannot be written.
        let poke = crate::guest::supervisor::poke;
        poke(stopped.pid, at + 64, &[1, 2, 3, 4, 5, 6, 7, 8]).expect("it stands");
        assert_eq!(state(), first);
        let mut seen = vec![first];
        let mut is_new = |state| {
            assert!(!seen.contains(&state));
            seen.push(state);
        };
        stopped.change(|registers| registers.rbx ^= 1);
        is_new(state());
        let stack = stopped.registers().rsp;
        for below in [8, 4_096] {
            Memory(stopped.pid)
                .write(stack - below, &[0xEE; 8])
                .expect("its stack");
            is_new(state());
        }
        for change in [
            |it: &mut libc::user_fpregs_struct| it.xmm_space[0] ^= 1,
            |it: &mut libc::user_fpregs_struct| it.xmm_space[63] ^= 1,
            |it: &mut libc::user_fpregs_struct| it.st_space[0] ^= 1,
        ] {
            let float = ptrace::getregset::<NT_PRFPREG>(stopped.pid);
            let mut float = float.expect("it stands");
            change(&mut float);
            ptrace::setregset::<NT_PRFPREG>(stopped.pid, float).expect("it stands");
            is_new(state());
        }
    }

    /// At most 256 MiB are compared.
    #[test]
    fn a_program_with_much_memory_computes() {
        let process = Stopped::that_calls();
        // Private memory of its own that is never touched: MAP_NORESERVE.
        let len = MEMORY_MAX + 4_096;
        let map = [0, len, 3, 0x4022, u64::MAX, 0];
        assert!(process.makes(libc::SYS_mmap, &map) > 0);
        assert_eq!(fingerprint(process.pid), None);
        assert_eq!(fingerprint(Pid::from_raw(-7)), None);
        assert!(fingerprint(Stopped::new().pid).is_some());
    }

    /// While another thread can run, a thread in a loop is behind it. Alone, it computes: its turn
    /// goes on.
    #[test]
    fn a_thread_in_a_loop_lets_others_run() {
        let (mut bench, stopped, _) = stands_at(TO_ITSELF);
        let tid = stopped.pid.as_raw();
        bench.supervisor.queue.push_back(bench.tid);
        assert!(matches!(bench.supervisor.spins(tid), Flow::Stays));
        assert_eq!(bench.supervisor.queue, [bench.tid, tid]);
        let thread = &bench.supervisor.threads[&tid];
        assert!(matches!(thread.state, State::Ready(Next::Go(None))));
        assert_eq!((thread.loop_length, thread.in_loop_at), (Some(1), Some(1)));
        assert!(bench.supervisor.held_over.is_none());
        // The other one is in a loop as well, and nothing has happened since.
        bench.supervisor.queue = [bench.tid].into();
        bench.thread().in_loop_at = Some(1);
        assert!(matches!(bench.supervisor.spins(tid), Flow::Stays));
        assert_eq!(bench.supervisor.queue, [bench.tid]);
        let held = bench.supervisor.held_over.take();
        assert!(matches!(held, Some((it, Next::Go(None))) if it == tid));
        let thread = &bench.supervisor.threads[&tid];
        assert!(matches!(thread.state, State::Running));
        assert_eq!(thread.loop_length, None);
        // Its loop is of a time before the last progress.
        bench.thread().in_loop_at = Some(0);
        assert!(matches!(bench.supervisor.spins(tid), Flow::Stays));
        assert_eq!(bench.supervisor.queue, [bench.tid, tid]);
    }

    /// A late thread may end the loop: time passes up to its time.
    #[test]
    fn time_passes_for_a_loop_while_a_thread_is_late() {
        let (mut bench, stopped, _) = stands_at(TO_ITSELF);
        let (tid, other) = (stopped.pid.as_raw(), bench.tid);
        let by = Duration::from_millis(5);
        bench.supervisor.delay(other, by, Next::Go(None));
        assert!(matches!(bench.supervisor.spins(tid), Flow::Stays));
        assert_eq!(bench.now(), 5_000_000);
        assert_eq!(bench.supervisor.queue, [other, tid]);
        assert!(bench.supervisor.held_over.is_none());
        assert!(!bench.supervisor.is_changed);
    }

    /// No thread becomes able to run: time advances 100 times, by 10 ms each.
    #[test]
    fn time_passes_for_a_loop_for_a_while_only() {
        let (mut bench, stopped, _) = stands_at(TO_ITSELF);
        let tid = stopped.pid.as_raw();
        bench.waits();
        bench.supervisor.pass_for_loop(tid);
        assert_eq!(bench.now(), 1_000_000_000);
        // A signal may end the loop.
        bench.supervisor.is_signalled = true;
        let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
        thread.computed = Duration::from_secs(1);
        bench.supervisor.pass_for_loop(tid);
        let computed = bench.supervisor.threads[&tid].computed;
        assert_eq!((bench.now(), computed), (1_000_000_000, Duration::ZERO));
    }

    /// A thread that computes goes on, in a turn of its own. A debugger's steps are not looked at.
    #[test]
    fn a_thread_that_computes_goes_on() {
        let (mut bench, stopped, at) = stands_at(&[0xFF, 0xC0, 0xEB, 0xFC]);
        let tid = stopped.pid.as_raw();
        let held = |bench: &mut Bench| {
            assert!(matches!(bench.supervisor.spins(tid), Flow::Stays));
            let held = bench.supervisor.held_over.take();
            matches!(held, Some((it, Next::Go(None))) if it == tid)
        };
        let eax = || stopped.registers().rax;
        stopped.change(|registers| registers.rax = 0);
        assert!(held(&mut bench));
        // `inc` and `jmp`, 20,000 of them.
        assert_eq!(eax(), 10_000);
        bench.supervisor.keeps_loan = true;
        assert!(held(&mut bench));
        bench.supervisor.keeps_loan = false;
        bench.supervisor.begin_debugging(Wanted::Nothing);
        let step = |tid| {
            let within = 0..0;
            Some(Step { tid, within })
        };
        let debugging = bench.supervisor.debugging().expect("begun");
        debugging.set_step(step(tid));
        assert!(matches!(bench.supervisor.spins(tid), Flow::Stays));
        let debugging = bench.supervisor.debugging().expect("begun");
        assert_eq!(debugging.held_thread(), Some(tid));
        assert_eq!((eax(), stopped.registers().rip), (10_000, at));
        assert!(bench.supervisor.is_stepped(tid));
        let debugging = bench.supervisor.debugging().expect("begun");
        debugging.set_step(step(tid + 1));
        assert!(!bench.supervisor.is_stepped(tid));
        assert!(matches!(bench.supervisor.spins(tid), Flow::Stays));
        assert_eq!(eax(), 20_000);
    }

    /// By hand: 4 times the known length and 64 more. A loop of eleven is found after 26
    /// instructions, one of 64 after 127.
    #[test]
    fn a_known_loop_is_found_again_fast() {
        let mut long = vec![0x90; 63];
        long.extend([0xEB, 0xBF]);
        for (code, length, expected) in [
            (ELEVEN, Some(1), true),
            (&long, Some(15), false),
            (&long, Some(16), true),
            (ELEVEN, None, false),
        ] {
            let (mut bench, stopped, _) = stands_at(code);
            let tid = stopped.pid.as_raw();
            bench.supervisor.queue.push_back(bench.tid);
            let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
            thread.loop_length = length;
            let flow = bench.supervisor.go_on_in_loop(tid);
            assert_eq!(matches!(flow, Flow::Stays), expected, "{length:?}");
            assert!(expected || matches!(flow, Flow::Goes(None)));
            assert_eq!(bench.supervisor.queue.contains(&tid), expected);
        }
        let (mut bench, stopped, at) = stands_at(ELEVEN);
        let tid = stopped.pid.as_raw();
        let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
        thread.loop_length = Some(11);
        bench.supervisor.keeps_loan = true;
        let flow = bench.supervisor.go_on_in_loop(tid);
        assert!(matches!(flow, Flow::Goes(None)));
        assert_eq!(stopped.registers().rip, at);
        assert_eq!(bench.supervisor.threads[&tid].loop_length, None);
        assert!(matches!(
            bench.supervisor.go_on_in_loop(-7),
            Flow::Goes(None)
        ));
    }

    /// A stop in the middle of a loop is handled: `int3` gives SIGTRAP.
    #[test]
    fn a_stop_in_a_loop_is_handled() {
        for is_known in [true, false] {
            let (mut bench, stopped, _) = stands_at(&[0x90, 0xCC]);
            let tid = stopped.pid.as_raw();
            let thread = bench.supervisor.threads.get_mut(&tid).expect("added");
            thread.loop_length = is_known.then_some(5);
            let flow = match is_known {
                true => bench.supervisor.go_on_in_loop(tid),
                false => bench.supervisor.spins(tid),
            };
            assert!(matches!(flow, Flow::Goes(Some(Signal::SIGTRAP))));
        }
    }
}
