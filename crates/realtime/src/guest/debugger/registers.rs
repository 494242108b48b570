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
}
