//! A program of a few instructions, without a C library, that runs in virtual time: each run of it
//! executes the same instructions at the same addresses.

use std::path::Path;

use nix::libc;
use nix::sys::ptrace::{self, Options};

use super::Stopped;
use crate::guest::memory::Memory;
use crate::guest::supervisor::tests::{Bench, adopts};

/// Address of its data, which have 256 bytes, and of memory with zeros.
pub(in crate::guest) const DATA: u32 = 0x40_00B0;
pub(in crate::guest) const ZEROS: u32 = 0x40_2000;
/// Address of its first instruction. As the code of a C library, it is at most 2 GiB from the page
/// with its clocks.
pub(in crate::guest) const ENTRY: u64 = CODE + HEAD;
const CODE: u64 = 0x7FFF_E000_0000;
/// Length of the head of its file: 64 bytes, two headers of 56 bytes, and the data.
const HEAD: u64 = 64 + 2 * 56 + 256;

/// `mov` of a number to rax, rdi, rsi, rdx, r10 and r8, then `syscall` (Intel's manual, volume 2).
pub(in crate::guest) fn call(number: i64, args: &[u32]) -> Vec<u8> {
    const MOVES: [&[u8]; 5] = [
        &[0xBF],
        &[0xBE],
        &[0xBA],
        &[0x49, 0xC7, 0xC2],
        &[0x49, 0xC7, 0xC0],
    ];
    let number = u32::try_from(number).expect("a number");
    let mut code = vec![0xB8];
    code.extend(number.to_le_bytes());
    for (to, value) in MOVES.iter().zip(args) {
        code.extend(*to);
        code.extend(value.to_le_bytes());
    }
    code.extend([0x0F, 0x05]);
    code
}

/// `exit_group`.
pub(in crate::guest) fn exit(code: u32) -> Vec<u8> {
    call(libc::SYS_exit_group, &[code])
}

/// An executable file (elf(5)) with these data and this code.
fn executable(data: &[u8], code: &[u8]) -> Vec<u8> {
    assert!(data.len() <= 256 && code.len() <= 4_096);
    let len = HEAD + code.len() as u64;
    // The class, 64 bits; an executable for x86-64; its entry, and two headers of 56 bytes.
    let mut file = b"\x7FELF\x02\x01\x01".to_vec();
    file.resize(16, 0);
    let half = |file: &mut Vec<u8>, value: u16| file.extend(value.to_le_bytes());
    half(&mut file, 2);
    half(&mut file, 0x3E);
    file.extend(1_u32.to_le_bytes());
    for word in [ENTRY, 64, 0] {
        file.extend(word.to_le_bytes());
    }
    file.extend([0; 4]);
    for value in [64, 56, 2, 0, 0, 0] {
        half(&mut file, value);
    }
    // Two segments to load: for data, which can be read and written (6), with 16 KiB of memory,
    // and for code, which can be read and executed (5).
    for (flags, at, memory) in [(6_u32, 0x40_0000, 0x4000), (5, CODE, len)] {
        file.extend([1, flags].map(u32::to_le_bytes).as_flattened());
        for word in [0, at, at, len, memory, 0x1000] {
            file.extend(word.to_le_bytes());
        }
    }
    file.extend(data);
    file.resize(usize::try_from(HEAD).expect("short"), 0);
    file.extend(code);
    file
}

/// Lets a process of the bench become a program with these data and this code, as a launcher does:
/// it stands before that, and is the bench's only process. Its file has the name "program".
pub(in crate::guest) fn starts(bench: &mut Bench, data: &[u8], code: &[u8]) -> Stopped {
    let [filter, _] = crate::guest::launch::filters();
    let process = becomes(bench.folder.path(), &filter, data, code);
    let options = crate::guest::supervisor::options();
    ptrace::setoptions(process.pid, options).expect("it stands");
    adopts(bench, process.pid);
    process
}

/// A process that stands before the call by which it becomes the program with these data and this
/// code, in `folder`. Before this call is `int3`.
pub(in crate::guest) fn becomes(
    folder: &Path,
    filter: &[[u8; 8]],
    data: &[u8],
    code: &[u8],
) -> Stopped {
    let process = Stopped::in_group_of_its_own();
    let pid = process.pid;
    let options = Options::PTRACE_O_TRACESYSGOOD;
    ptrace::setoptions(pid, options).expect("it stands");
    let place = process.registers().rsp - 16_384;
    let memory = Memory(pid);
    let path = folder.join("program");
    let path = path.to_str().expect("a plain name");
    let file = executable(data, code);
    let name = [path.as_bytes(), &[0]].concat();
    // The path, its address as the only argument, and no variable.
    memory.write(place, &name).expect("its stack");
    let words = [place, 0].map(u64::to_ne_bytes);
    memory
        .write(place + 4_096, words.as_flattened())
        .expect("its stack");
    // It has no file but /dev/null.
    memory
        .write(place + 8_192, b"/dev/null\0")
        .expect("its stack");
    process.makes(libc::SYS_close_range, &[0, u32::MAX.into(), 0]);
    for number in 0..3 {
        let opened = process.makes(libc::SYS_open, &[place + 8_192, 2]);
        assert_eq!(opened, number);
    }
    // The process itself writes the file: a file that this process has open for writing, or a child
    // of another test, could not be executed.
    let opened = process.makes(libc::SYS_open, &[place, 0o1101, 0o755]);
    let opened = u64::try_from(opened).expect("a new file");
    for (index, piece) in file.chunks(2_048).enumerate() {
        memory.write(place + 8_192, piece).expect("its stack");
        let args = [opened, place + 8_192, piece.len() as u64];
        let written = process.makes(libc::SYS_write, &args);
        assert_eq!(usize::try_from(written), Ok(piece.len()), "{index}");
    }
    assert_eq!(process.makes(libc::SYS_close, &[opened]), 0);
    // ADDR_NO_RANDOMIZE; PR_SET_TSC with PR_TSC_SIGSEGV.
    process.makes(libc::SYS_personality, &[0x4_0000]);
    process.makes(libc::SYS_prctl, &[26, 2]);
    process.gets_filter(filter);
    memory.write(place, &name).expect("its stack");
    memory
        .write(place + 4_096, words.as_flattened())
        .expect("its stack");
    process.runs(&[0xCC, 0x0F, 0x05, 0xCC]);
    process.change(|registers| {
        registers.rip += 1;
        registers.rax = libc::SYS_execve.cast_unsigned();
        registers.rdi = place;
        registers.rsi = place + 4_096;
        registers.rdx = place + 4_104;
    });
    process
}

/// `mov [place], rax`: keeps the result of a call.
pub(in crate::guest) fn keeps(place: u32) -> Vec<u8> {
    [&[0x48, 0x89, 0x04, 0x25], &place.to_le_bytes()[..]].concat()
}

/// A call that stops the program until a signal comes, which none sends.
pub(in crate::guest) fn rests() -> Vec<u8> {
    call(libc::SYS_pause, &[])
}

/// `test eax, eax; jnz ..`: runs `code` if the last result is 0, as in a new process.
pub(in crate::guest) fn if_zero(code: &[u8]) -> Vec<u8> {
    let len = u32::try_from(code.len()).expect("short");
    [&[0x85, 0xC0, 0x0F, 0x85], &len.to_le_bytes()[..], code].concat()
}

/// A program and its supervisor.
pub(in crate::guest) struct Guest {
    pub(in crate::guest) bench: Bench,
    pub(in crate::guest) process: Stopped,
}

impl Guest {
    /// Lets a program with these data and this code run until it rests or has ended.
    pub(in crate::guest) fn runs(data: &[u8], code: &[&[u8]]) -> Self {
        Self::runs_in(Bench::new(), data, code)
    }

    pub(in crate::guest) fn runs_in(mut bench: Bench, data: &[u8], code: &[&[u8]]) -> Self {
        let process = starts(&mut bench, data, &code.concat());
        let mut it = Self { bench, process };
        for _ in 0..1_000 {
            if it.status().is_some() || it.rests() {
                return it;
            }
            it.bench.supervisor.turn().expect("it is supervised");
        }
        panic!("it goes on and on");
    }

    pub(in crate::guest) fn status(&self) -> Option<i32> {
        self.bench.supervisor.status(self.process.pid.as_raw())
    }

    fn rests(&self) -> bool {
        crate::guest::supervisor::tests::pauses(&self.bench.supervisor, self.process.pid)
    }

    /// A word of its memory.
    pub(in crate::guest) fn word(&self, place: u32) -> u64 {
        let memory = Memory(self.process.pid);
        memory.u64(place.into()).expect("its memory")
    }

    pub(in crate::guest) fn bytes(&self, place: u32, len: usize) -> Vec<u8> {
        let mut bytes = vec![0; len];
        let memory = Memory(self.process.pid);
        memory.read(place.into(), &mut bytes).expect("its memory");
        bytes
    }
}

/// The status of a process with a code has it in its second byte (wait(2)).
#[test]
fn a_program_in_virtual_time_ends_with_its_code() {
    let guest = Guest::runs(&[], &[&exit(3)]);
    assert_eq!(guest.status(), Some(3 << 8));
    let supervisor = &guest.bench.supervisor;
    assert!(supervisor.notes().is_empty(), "{:?}", supervisor.notes());
    assert!(!supervisor.is_anybody_there());
}
