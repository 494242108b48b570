//! Registers and signals in the order and with the numbers of GDB.

use gdbstub::common::Signal as GdbSignal;
use gdbstub_arch::x86::reg::{X86_64CoreRegs, X87FpuInternalRegs};
use nix::libc::{self, user_fpregs_struct, user_regs_struct};

/// The lower half of a register.
const fn low(value: u64) -> u32 {
    let [a, b, c, d, ..] = value.to_le_bytes();
    u32::from_le_bytes([a, b, c, d])
}

const fn lowest(value: u32) -> u16 {
    let [a, b, ..] = value.to_le_bytes();
    u16::from_le_bytes([a, b])
}

/// The registers of a thread as GDB sees them.
pub(super) fn shown(own: &user_regs_struct, float: Option<&user_fpregs_struct>) -> X86_64CoreRegs {
    let mut regs = X86_64CoreRegs {
        regs: [
            own.rax, own.rbx, own.rcx, own.rdx, own.rsi, own.rdi, own.rbp, own.rsp, own.r8, own.r9,
            own.r10, own.r11, own.r12, own.r13, own.r14, own.r15,
        ],
        rip: own.rip,
        eflags: low(own.eflags),
        ..X86_64CoreRegs::default()
    };
    regs.segments.cs = low(own.cs);
    regs.segments.ss = low(own.ss);
    regs.segments.ds = low(own.ds);
    regs.segments.es = low(own.es);
    regs.segments.fs = low(own.fs);
    regs.segments.gs = low(own.gs);
    let Some(float) = float else { return regs };
    for (to, words) in regs.st.iter_mut().zip(float.st_space.chunks_exact(4)) {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        to.copy_from_slice(&bytes[..10]);
    }
    for (to, words) in regs.xmm.iter_mut().zip(float.xmm_space.chunks_exact(4)) {
        let words = words.iter().rev();
        *to = words.fold(0, |sum, &word| (sum << 32) | u128::from(word));
    }
    regs.mxcsr = float.mxcsr;
    regs.fpu = X87FpuInternalRegs {
        fctrl: float.cwd.into(),
        fstat: float.swd.into(),
        ftag: tags_in_full(float.ftw),
        fiseg: low(float.rip >> 32),
        fioff: low(float.rip),
        foseg: low(float.rdp >> 32),
        fooff: low(float.rdp),
        fop: float.fop.into(),
    };
    regs
}

/// The tags of the x87 registers with two bits per register, where 3 means empty, from those with
/// one bit, where 1 means in use.
fn tags_in_full(tags: u16) -> u32 {
    (0..8).fold(0, |sum, index| match tags & (1 << index) {
        0 => sum | 0b11 << (2 * index),
        _ => sum,
    })
}

fn tags_in_short(tags: u32) -> u16 {
    (0..8).fold(0, |sum, index| match (tags >> (2 * index)) & 0b11 {
        0b11 => sum,
        _ => sum | 1 << index,
    })
}

/// Applies the registers that GDB has changed.
pub(super) const fn take(regs: &X86_64CoreRegs, own: &mut user_regs_struct) {
    if own.rip != regs.rip {
        // The thread continues at another place, so the kernel must not repeat a call.
        own.orig_rax = u64::MAX;
    }
    [
        own.rax, own.rbx, own.rcx, own.rdx, own.rsi, own.rdi, own.rbp, own.rsp, own.r8, own.r9,
        own.r10, own.r11, own.r12, own.r13, own.r14, own.r15,
    ] = regs.regs;
    own.rip = regs.rip;
    own.eflags = regs.eflags as u64;
}

/// Applies the changed floating point registers.
pub(super) fn take_float(regs: &X86_64CoreRegs, float: &mut user_fpregs_struct) {
    for (from, words) in regs.st.iter().zip(float.st_space.chunks_exact_mut(4)) {
        let mut bytes = [0; 16];
        bytes[..10].copy_from_slice(from);
        for (word, four) in words.iter_mut().zip(bytes.chunks_exact(4)) {
            *word = u32::from_le_bytes([four[0], four[1], four[2], four[3]]);
        }
    }
    for (from, words) in regs.xmm.iter().zip(float.xmm_space.chunks_exact_mut(4)) {
        for (word, four) in words.iter_mut().zip(from.to_le_bytes().chunks_exact(4)) {
            *word = u32::from_le_bytes([four[0], four[1], four[2], four[3]]);
        }
    }
    float.mxcsr = regs.mxcsr;
    float.cwd = lowest(regs.fpu.fctrl);
    float.swd = lowest(regs.fpu.fstat);
    float.ftw = tags_in_short(regs.fpu.ftag);
}

/// Signals that have another number in GDB than in this system.
const NUMBERS: [(i32, GdbSignal); 17] = [
    (libc::SIGBUS, GdbSignal::SIGBUS),
    (libc::SIGUSR1, GdbSignal::SIGUSR1),
    (libc::SIGUSR2, GdbSignal::SIGUSR2),
    (libc::SIGCHLD, GdbSignal::SIGCHLD),
    (libc::SIGCONT, GdbSignal::SIGCONT),
    (libc::SIGSTOP, GdbSignal::SIGSTOP),
    (libc::SIGTSTP, GdbSignal::SIGTSTP),
    (libc::SIGTTIN, GdbSignal::SIGTTIN),
    (libc::SIGTTOU, GdbSignal::SIGTTOU),
    (libc::SIGURG, GdbSignal::SIGURG),
    (libc::SIGIO, GdbSignal::SIGIO),
    (libc::SIGPWR, GdbSignal::SIGPWR),
    (libc::SIGSYS, GdbSignal::SIGSYS),
    (libc::SIGXCPU, GdbSignal::SIGXCPU),
    (libc::SIGXFSZ, GdbSignal::SIGXFSZ),
    (libc::SIGWINCH, GdbSignal::SIGWINCH),
    (libc::SIGSTKFLT, GdbSignal::SIGLOST),
];

/// GDB's number of a signal of this system.
pub(super) fn to_gdb(signal: i32) -> GdbSignal {
    let row = NUMBERS.iter().find(|(own, _)| *own == signal);
    let same = GdbSignal(u8::try_from(signal).unwrap_or(GdbSignal::SIGTRAP.0));
    row.map_or(same, |(_, gdb)| *gdb)
}

/// The system's number of a signal of GDB.
pub(super) fn from_gdb(signal: GdbSignal) -> i32 {
    let row = NUMBERS.iter().find(|(_, gdb)| *gdb == signal);
    row.map_or(i32::from(signal.0), |(own, _)| *own)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of include/gdb/signals.def and of signal(7) for x86-64.
    #[test]
    fn signals_have_the_numbers_of_both_sides() {
        let rows = [(10, 30), (12, 31), (7, 10), (11, 11), (17, 20), (29, 23)];
        for (own, gdb) in rows {
            assert_eq!(to_gdb(own), GdbSignal(gdb), "{own}");
            assert_eq!(from_gdb(GdbSignal(gdb)), own, "{gdb}");
        }
    }

    /// Intel's manual, volume 1, 8.1.7: 11 in both bits is an empty register.
    #[test]
    fn tags_of_floating_point_registers_come_back() {
        assert_eq!(tags_in_full(0b1000_0001), 0b00_11_11_11_11_11_11_00);
        assert_eq!(tags_in_short(tags_in_full(0b1010_0110)), 0b1010_0110);
    }

    /// Registers with a number of their own each, in the order of GDB (gdb/features/i386/64bit-*).
    #[test]
    fn registers_are_shown_and_taken_in_the_order_of_gdb() {
        let mut own = crate::guest::tests::no_registers();
        let order = |it: &mut user_regs_struct, base: u64| {
            [it.rax, it.rbx, it.rcx, it.rdx] = [base, base + 1, base + 2, base + 3];
            [it.rsi, it.rdi, it.rbp, it.rsp] = [base + 4, base + 5, base + 6, base + 7];
            [it.r8, it.r9, it.r10, it.r11] = [base + 8, base + 9, base + 10, base + 11];
            [it.r12, it.r13, it.r14, it.r15] = [base + 12, base + 13, base + 14, base + 15];
        };
        order(&mut own, 1 << 40);
        (own.rip, own.eflags, own.orig_rax) = (1 << 41, 0xF_0000_0246, 7);
        [own.cs, own.ss, own.ds, own.es, own.fs, own.gs] = [1, 2, 3, 4, 5, 6];
        let regs = shown(&own, None);
        let expected: Vec<u64> = (0..16).map(|index| (1 << 40) + index).collect();
        assert_eq!(regs.regs.to_vec(), expected);
        assert_eq!((regs.rip, regs.eflags), (1 << 41, 0x246));
        let segments = &regs.segments;
        let segments = [
            segments.cs,
            segments.ss,
            segments.ds,
            segments.es,
            segments.fs,
            segments.gs,
        ];
        assert_eq!(segments, [1, 2, 3, 4, 5, 6]);
        let mut back = crate::guest::tests::no_registers();
        back.orig_rax = 7;
        back.rip = 1 << 41;
        take(&regs, &mut back);
        let all = |it: &user_regs_struct| {
            [
                it.rax, it.rbx, it.rcx, it.rdx, it.rsi, it.rdi, it.rbp, it.rsp, it.r8, it.r9,
                it.r10, it.r11, it.r12, it.r13, it.r14, it.r15,
            ]
        };
        assert_eq!(all(&back), all(&own));
        assert_eq!((back.rip, back.eflags, back.orig_rax), (1 << 41, 0x246, 7));
        // Elsewhere the kernel has no call to make again.
        back.rip = 5;
        take(&regs, &mut back);
        assert_eq!((back.rip, back.orig_rax), (1 << 41, u64::MAX));
    }

    /// A register of the x87 has 10 of 16 bytes; one of SSE is four words, the lowest first.
    #[test]
    fn floating_point_registers_are_shown_and_taken() {
        let stopped = crate::guest::tests::Stopped::new();
        let kind = nix::sys::ptrace::getregset::<nix::sys::ptrace::regset::NT_PRFPREG>;
        let mut float = kind(stopped.pid).expect("it stands");
        for (index, word) in float.st_space.iter_mut().enumerate() {
            *word = 0x0101_0101 * u32::try_from(index + 1).expect("few");
        }
        for (index, word) in float.xmm_space.iter_mut().enumerate() {
            *word = u32::try_from(index + 1).expect("few");
        }
        (float.cwd, float.swd, float.ftw, float.fop) = (0x37F, 0x3800, 0b1000_0001, 9);
        (float.rip, float.rdp, float.mxcsr) = (0x1_0000_0002, 0x3_0000_0004, 0x1F80);
        let own = crate::guest::tests::no_registers();
        let regs = shown(&own, Some(&float));
        assert_eq!(regs.st[0], [1, 1, 1, 1, 2, 2, 2, 2, 3, 3]);
        assert_eq!(regs.st[1], [5, 5, 5, 5, 6, 6, 6, 6, 7, 7]);
        assert_eq!(regs.xmm[0], 4 << 96 | 3 << 64 | 2 << 32 | 1);
        assert_eq!(regs.xmm[15], 64 << 96 | 63 << 64 | 62 << 32 | 61);
        let fpu = &regs.fpu;
        assert_eq!(
            [fpu.fctrl, fpu.fstat, fpu.fop, fpu.ftag],
            [0x37F, 0x3800, 9, 0b00_11_11_11_11_11_11_00]
        );
        assert_eq!([fpu.fiseg, fpu.fioff, fpu.foseg, fpu.fooff], [1, 2, 3, 4]);
        assert_eq!(regs.mxcsr, 0x1F80);
        let mut back = kind(stopped.pid).expect("it stands");
        take_float(&regs, &mut back);
        let st: Vec<u32> = back.st_space[..8].to_vec();
        assert_eq!(
            st,
            [
                0x0101_0101,
                0x0202_0202,
                0x0303,
                0,
                0x0505_0505,
                0x0606_0606,
                0x0707,
                0
            ]
        );
        assert_eq!(back.xmm_space.to_vec(), (1..=64).collect::<Vec<u32>>());
        assert_eq!(
            (back.cwd, back.swd, back.ftw, back.mxcsr),
            (0x37F, 0x3800, 0b1000_0001, 0x1F80)
        );
    }

    #[test]
    fn words_are_cut_to_their_lower_halves() {
        assert_eq!((low(0x1_2345_6789), low(u64::MAX)), (0x2345_6789, u32::MAX));
        assert_eq!((lowest(0x12_3456), lowest(u32::MAX)), (0x3456, u16::MAX));
        assert_eq!(
            (to_gdb(300), to_gdb(64)),
            (GdbSignal::SIGTRAP, GdbSignal(64))
        );
        assert_eq!((tags_in_full(0), tags_in_full(0xFF)), (0xFFFF, 0));
        assert_eq!(
            (
                tags_in_short(0xFFFF),
                tags_in_short(0),
                tags_in_short(0b10_01)
            ),
            (0, 0xFF, 0xFF)
        );
    }
}
