//! Parts of the tests of guests: memory of this very process in place of a guest's, and a process
//! that stands.

use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};

use nix::libc::user_regs_struct;
use nix::sys::ptrace::{self, Options};
use nix::unistd::Pid;
use rustix::process::WaitOptions;

use super::memory::Memory;
use super::news::wait;

/// This process, as its own guest.
pub(super) fn own() -> Pid {
    Pid::this()
}

/// Memory that calls name by its address.
pub(super) struct Room(Vec<u8>);

impl Room {
    pub(super) fn new(len: usize) -> Self {
        Self(vec![0; len])
    }

    pub(super) fn of(bytes: &[u8]) -> Self {
        Self(bytes.to_vec())
    }

    pub(super) fn of_words(words: &[u64]) -> Self {
        Self::of(
            words
                .iter()
                .map(|word| word.to_ne_bytes())
                .collect::<Vec<_>>()
                .as_flattened(),
        )
    }

    /// The address of its byte `offset`.
    pub(super) fn at(&self, offset: usize) -> u64 {
        (self.0.as_ptr().expose_provenance() + offset) as u64
    }

    pub(super) fn put(&self, offset: usize, bytes: &[u8]) {
        let done = Memory(own()).write(self.at(offset), bytes);
        done.expect("memory of this process");
    }

    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0; self.0.len()];
        let done = Memory(own()).read(self.at(0), &mut bytes);
        done.expect("memory of this process");
        bytes
    }

    pub(super) fn words(&self) -> Vec<u64> {
        let bytes = self.bytes();
        let words = bytes.chunks_exact(8);
        words
            .map(|word| u64::from_ne_bytes(word.try_into().expect("eight")))
            .collect()
    }

    pub(super) fn numbers(&self) -> Vec<i32> {
        let bytes = self.bytes();
        let words = bytes.chunks_exact(4);
        words
            .map(|word| i32::from_ne_bytes(word.try_into().expect("four")))
            .collect()
    }
}

/// A process that stands, traced by this thread.
pub(super) struct Stopped {
    child: Child,
    pub(super) pid: Pid,
}

/// Numbers of `nanosleep` and `clock_nanosleep`.
const SLEEPS: [u64; 2] = [35, 230];

impl Stopped {
    pub(super) fn new() -> Self {
        Self::of(Command::new("sleep").arg("1000"))
    }

    pub(super) fn in_group_of_its_own() -> Self {
        Self::of(Command::new("sleep").arg("1000").process_group(0))
    }

    /// With nothing but `/dev/null`.
    pub(super) fn without_files() -> Self {
        let mut sleep = Command::new("sleep");
        sleep.arg("1000").stdin(Stdio::null());
        Self::of(sleep.stdout(Stdio::null()).stderr(Stdio::null()))
    }

    fn of(command: &mut Command) -> Self {
        let child = command.spawn();
        let child = child.expect("each system has it");
        let pid = Pid::from_raw(child.id().cast_signed());
        // In contrast to `attach`, no signal of this is left.
        ptrace::seize(pid, Options::empty()).expect("it is a child");
        let stopped = Self { child, pid };
        loop {
            ptrace::interrupt(pid).expect("it is traced");
            wait(Some(pid), WaitOptions::empty()).expect("it stops");
            // Before its sleep it still loads its libraries.
            if SLEEPS.contains(&stopped.registers().orig_rax) {
                return stopped;
            }
            ptrace::cont(pid, None).expect("it stands");
            std::thread::yield_now();
        }
    }

    pub(super) fn registers(&self) -> user_regs_struct {
        ptrace::getregs(self.pid).expect("it stands")
    }

    /// Changes its registers.
    pub(super) fn change(&self, change: impl FnOnce(&mut user_regs_struct)) {
        let mut registers = self.registers();
        change(&mut registers);
        ptrace::setregs(self.pid, registers).expect("it stands");
    }

    /// Puts `code` where its next instruction is, outside of a call; where that is.
    pub(super) fn runs(&self, code: &[u8]) -> u64 {
        let at = self.registers().rip & !0xFFF;
        super::supervisor::poke(self.pid, at, code).expect("it stands");
        self.change(|registers| {
            registers.rip = at;
            registers.orig_rax = u64::MAX;
        });
        at
    }

    /// Lets it go on up to its next stop; the system's status.
    pub(super) fn goes_on(&self) -> i32 {
        ptrace::cont(self.pid, None).expect("it stands");
        wait(Some(self.pid), WaitOptions::empty())
            .expect("it stops")
            .1
    }

    /// The signal at which it stands, of a status.
    pub(super) const fn signal_of(status: i32) -> i32 {
        status >> 8
    }
}

impl Drop for Stopped {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The registers of a thread that has done nothing yet.
pub(super) const fn no_registers() -> user_regs_struct {
    user_regs_struct {
        r15: 0,
        r14: 0,
        r13: 0,
        r12: 0,
        rbp: 0,
        rbx: 0,
        r11: 0,
        r10: 0,
        r9: 0,
        r8: 0,
        rax: 0,
        rcx: 0,
        rdx: 0,
        rsi: 0,
        rdi: 0,
        orig_rax: 0,
        rip: 0,
        cs: 0,
        eflags: 0,
        rsp: 0,
        ss: 0,
        fs_base: 0,
        gs_base: 0,
        ds: 0,
        es: 0,
        fs: 0,
        gs: 0,
    }
}
