//! Parts of the tests of guests: memory of this very process in place of a guest's, and a process
//! that stands.

pub(super) mod program;

use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};

use nix::libc::user_regs_struct;
use nix::sys::ptrace::{self, Options};
use nix::unistd::Pid;
use rustix::process::WaitOptions;

use super::inject::Hands;
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

    /// With stops at the beginning and the end of its calls.
    pub(super) fn that_calls() -> Self {
        let stopped = Self::new();
        let options = Options::PTRACE_O_TRACESYSGOOD | Options::PTRACE_O_TRACESECCOMP;
        ptrace::setoptions(stopped.pid, options).expect("it stands");
        stopped
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

    /// It makes a call, and stands where it stood; the kernel's result.
    pub(super) fn makes(&self, number: i64, args: &[u64]) -> i64 {
        let registers = self.registers();
        let mut hands = Hands::of(self.pid, registers).expect("it has a place for calls");
        let result = hands.call(number, args).expect("it stands");
        ptrace::setregs(self.pid, registers).expect("it stands");
        result
    }

    /// Lets it run on one processor only. Otherwise, the system writes the number of another one
    /// into its memory (rseq(2)).
    pub(super) fn stays_on_one_processor(&self) {
        const LEN: usize = 128;
        let place = self.registers().rsp - 2_048;
        let mut set = [0; LEN];
        let memory = Memory(self.pid);
        memory.write(place, &set).expect("its stack");
        assert!(self.makes(nix::libc::SYS_sched_getaffinity, &[0, LEN as u64, place]) > 0);
        memory.read(place, &mut set).expect("its stack");
        let first = set.iter().position(|&byte| byte != 0).expect("one");
        let byte = 1 << set[first].trailing_zeros();
        set = [0; LEN];
        set[first] = byte;
        memory.write(place, &set).expect("its stack");
        assert_eq!(
            self.makes(nix::libc::SYS_sched_setaffinity, &[0, LEN as u64, place]),
            0
        );
    }

    /// Lets a filter stop it at these calls, as a program in virtual time.
    pub(super) fn filters(&self, calls: &[i64]) {
        // linux/filter.h, linux/seccomp.h: load the number; the verdict is to trace if it is equal
        // to one of these, and to allow the call otherwise.
        let instruction = |code: u16, if_equal: u8, value: u32| {
            let mut bytes = [0; 8];
            bytes[..2].copy_from_slice(&code.to_ne_bytes());
            bytes[2] = if_equal;
            bytes[4..].copy_from_slice(&value.to_ne_bytes());
            bytes
        };
        let mut filter = vec![instruction(0x20, 0, 0)];
        for (index, &call) in calls.iter().enumerate() {
            let behind = u8::try_from(calls.len() - index).expect("some");
            let call = u32::try_from(call).expect("a number");
            filter.push(instruction(0x15, behind, call));
        }
        filter.push(instruction(0x06, 0, 0x7FFF_0000));
        filter.push(instruction(0x06, 0, 0x7FF0_0000));
        self.gets_filter(&filter);
    }

    /// Gets a filter of its calls, in the kernel's format.
    pub(super) fn gets_filter(&self, filter: &[[u8; 8]]) {
        let place = self.registers().rsp - 16_384;
        let head = [filter.len() as u64, place + 16];
        for (at, bytes) in [
            (place, head.map(u64::to_ne_bytes).as_flattened()),
            (place + 16, filter.as_flattened()),
        ] {
            Memory(self.pid).write(at, bytes).expect("its stack");
        }
        // PR_SET_NO_NEW_PRIVS, and PR_SET_SECCOMP with SECCOMP_MODE_FILTER.
        assert_eq!(self.makes(157, &[38, 1]), 0);
        assert_eq!(self.makes(157, &[22, 2, place]), 0);
    }

    /// It begins a call, and stands at the filter. Its instruction is at the returned address.
    pub(super) fn begins(&self, number: i64, args: &[u64]) -> u64 {
        let at = self.runs(&[0x0F, 0x05, 0xCC]);
        let arg = |index: usize| args.get(index).copied().unwrap_or(0);
        self.change(|registers| {
            registers.rax = number.cast_unsigned();
            registers.rdi = arg(0);
            registers.rsi = arg(1);
            registers.rdx = arg(2);
            registers.r10 = arg(3);
            registers.r8 = arg(4);
            registers.r9 = arg(5);
        });
        assert_eq!(self.goes_on() >> 16, nix::libc::PTRACE_EVENT_SECCOMP);
        at
    }

    /// Lets the kernel execute the call that it has begun; the result.
    pub(super) fn ends_call(&self) -> i64 {
        ptrace::syscall(self.pid, None).expect("it stands");
        wait(Some(self.pid), WaitOptions::empty()).expect("it stops");
        self.registers().rax.cast_signed()
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
