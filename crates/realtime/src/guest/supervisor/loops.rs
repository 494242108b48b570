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

    use crate::guest::supervisor::tests::Bench;

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
}
