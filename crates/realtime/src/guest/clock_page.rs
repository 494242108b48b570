//! Clocks and ports that a program reads without a stop: our pages replace the kernel's page
//! (vDSO).
//!
//! Each new program gets a copy of the kernel's page, whose functions jump to ours. Ours count
//! virtual time in memory beside them. Before a thread continues, the supervisor lends time to
//! these functions: up to the next event at the rig, and for as many looks (clock reads) as the
//! thread may make before another thread has its turn. Beyond that, a look is a system call. So a
//! run is the same with the page and without.
//!
//! ```text
//!  stop --lend: now, limit, cost--> looks, looks, .. --stop, take: now, how many--> supervisor
//! ```

use nix::errno::Errno;
use nix::libc::{self, user_regs_struct};
use nix::unistd::Pid;

use super::inject::{Hands, NotMade, kernel_page};
use super::lent::{LentCount, LentPort, LentRead, Loan, Taken};
use super::memory::Memory;

/// Machine code of `clock_page.s`; a test assembles the file and compares.
#[rustfmt::skip]
const CODE: [u8; 1106] = [
    0x48, 0xB9, 0x00, 0x00, 0xFA, 0xED, 0x51, 0x72, 0x86, 0x18, 0x85, 0xFF, 0x74, 0x20, 0x48, 0xB9,
    0x00, 0x10, 0xA5, 0xD4, 0xE8, 0x00, 0x00, 0x00, 0x83, 0xFF, 0x01, 0x74, 0x11, 0x83, 0xFF, 0x04,
    0x74, 0x0C, 0x83, 0xFF, 0x06, 0x74, 0x07, 0x83, 0xFF, 0x07, 0x74, 0x02, 0xEB, 0x11, 0xE8, 0x89,
    0x00, 0x00, 0x00, 0x72, 0x0A, 0x48, 0x89, 0x06, 0x48, 0x89, 0x56, 0x08, 0x31, 0xC0, 0xC3, 0xB8,
    0xE4, 0x00, 0x00, 0x00, 0x0F, 0x05, 0xC3, 0x48, 0x85, 0xF6, 0x75, 0x2E, 0x48, 0x85, 0xFF, 0x74,
    0x29, 0x48, 0xB9, 0x00, 0x00, 0xFA, 0xED, 0x51, 0x72, 0x86, 0x18, 0xE8, 0x5C, 0x00, 0x00, 0x00,
    0x72, 0x18, 0x48, 0x89, 0x07, 0x48, 0x89, 0xD0, 0x31, 0xD2, 0x41, 0xB9, 0xE8, 0x03, 0x00, 0x00,
    0x49, 0xF7, 0xF1, 0x48, 0x89, 0x47, 0x08, 0x31, 0xC0, 0xC3, 0xB8, 0x60, 0x00, 0x00, 0x00, 0x0F,
    0x05, 0xC3, 0x48, 0xB9, 0x00, 0x00, 0xFA, 0xED, 0x51, 0x72, 0x86, 0x18, 0xE8, 0x2B, 0x00, 0x00,
    0x00, 0x72, 0x09, 0x48, 0x85, 0xFF, 0x74, 0x03, 0x48, 0x89, 0x07, 0xC3, 0xB8, 0xC9, 0x00, 0x00,
    0x00, 0x0F, 0x05, 0xC3, 0xB8, 0xE5, 0x00, 0x00, 0x00, 0x0F, 0x05, 0xC3, 0xB8, 0x35, 0x01, 0x00,
    0x00, 0x0F, 0x05, 0xC3, 0x48, 0xC7, 0xC0, 0xDA, 0xFF, 0xFF, 0xFF, 0xC3, 0x4C, 0x8D, 0x05, 0x3D,
    0x0F, 0x00, 0x00, 0x49, 0x8B, 0x00, 0x49, 0x03, 0x40, 0x10, 0x49, 0x3B, 0x40, 0x08, 0x77, 0x1D,
    0x49, 0xFF, 0x48, 0x20, 0x78, 0x17, 0x49, 0x89, 0x00, 0x49, 0xFF, 0x40, 0x18, 0x48, 0x01, 0xC8,
    0x31, 0xD2, 0x41, 0xB9, 0x00, 0xCA, 0x9A, 0x3B, 0x49, 0xF7, 0xF1, 0xF8, 0xC3, 0xF9, 0xC3, 0x53,
    0x52, 0x56, 0x57, 0x41, 0x50, 0x41, 0x51, 0x41, 0x52, 0x41, 0x54, 0x41, 0x55, 0x41, 0x56, 0x41,
    0x57, 0x55, 0x4C, 0x8D, 0x1D, 0xF7, 0x0E, 0x00, 0x00, 0x49, 0x8B, 0x0B, 0x49, 0x03, 0x4B, 0x10,
    0x49, 0x3B, 0x4B, 0x08, 0x77, 0x21, 0x4D, 0x8B, 0x73, 0x20, 0x49, 0xFF, 0xCE, 0x78, 0x18, 0x85,
    0xC0, 0x74, 0x1A, 0x83, 0xF8, 0x10, 0x0F, 0x84, 0xB6, 0x00, 0x00, 0x00, 0x3D, 0x0E, 0x01, 0x00,
    0x00, 0x0F, 0x84, 0x5B, 0x01, 0x00, 0x00, 0xF9, 0xE9, 0x01, 0x03, 0x00, 0x00, 0x48, 0x85, 0xD2,
    0x74, 0xF5, 0x49, 0x83, 0x7B, 0x40, 0x40, 0x73, 0xEE, 0xE8, 0x23, 0x01, 0x00, 0x00, 0x72, 0xE7,
    0x31, 0xFF, 0x48, 0x8B, 0x43, 0x20, 0x48, 0x01, 0xF8, 0x48, 0x3B, 0x43, 0x18, 0x73, 0x1E, 0x48,
    0x8B, 0x44, 0xC3, 0x28, 0x49, 0x89, 0xC0, 0x49, 0xC1, 0xE8, 0x08, 0x49, 0x39, 0xC8, 0x77, 0x1A,
    0x88, 0x04, 0x3E, 0x48, 0xFF, 0xC7, 0x48, 0x39, 0xD7, 0x72, 0xD7, 0xEB, 0x28, 0x48, 0x3B, 0x4B,
    0x10, 0x73, 0xB4, 0x48, 0x85, 0xFF, 0x74, 0xAF, 0xEB, 0x1B, 0x48, 0x85, 0xFF, 0x75, 0x16, 0x48,
    0x83, 0x7B, 0x08, 0x00, 0x74, 0xA1, 0x4D, 0x3B, 0x43, 0x08, 0x77, 0x9B, 0x4C, 0x89, 0xC1, 0x4D,
    0x8B, 0x73, 0x28, 0xEB, 0xAD, 0x49, 0x8B, 0x43, 0x40, 0x48, 0x89, 0xCA, 0x48, 0xC1, 0xE2, 0x0A,
    0x49, 0xC1, 0xE4, 0x08, 0x4C, 0x09, 0xE2, 0x48, 0x09, 0xFA, 0x49, 0x89, 0x94, 0xC3, 0x00, 0x09,
    0x00, 0x00, 0x49, 0xFF, 0x43, 0x40, 0x49, 0xC7, 0x43, 0x50, 0x00, 0x00, 0x00, 0x00, 0x48, 0x01,
    0x7B, 0x20, 0x49, 0x89, 0x0B, 0x4D, 0x89, 0x73, 0x20, 0x48, 0x89, 0xF8, 0xF8, 0xE9, 0x5C, 0x02,
    0x00, 0x00, 0x81, 0xFE, 0x1B, 0x54, 0x00, 0x00, 0x0F, 0x85, 0x49, 0xFF, 0xFF, 0xFF, 0x49, 0x83,
    0x7B, 0x50, 0x07, 0x0F, 0x83, 0x3E, 0xFF, 0xFF, 0xFF, 0xE8, 0x73, 0x00, 0x00, 0x00, 0x0F, 0x82,
    0x33, 0xFF, 0xFF, 0xFF, 0x31, 0xFF, 0x48, 0x8B, 0x43, 0x20, 0x48, 0x01, 0xF8, 0x48, 0x3B, 0x43,
    0x18, 0x73, 0x13, 0x48, 0x8B, 0x44, 0xC3, 0x28, 0x48, 0xC1, 0xE8, 0x08, 0x48, 0x39, 0xC8, 0x77,
    0x0F, 0x48, 0xFF, 0xC7, 0xEB, 0xE0, 0x48, 0x3B, 0x4B, 0x10, 0x0F, 0x83, 0x07, 0xFF, 0xFF, 0xFF,
    0x89, 0x3A, 0x49, 0x8B, 0x43, 0x50, 0x48, 0xC1, 0xE0, 0x04, 0x49, 0x89, 0x94, 0x03, 0x08, 0x0B,
    0x00, 0x00, 0x48, 0x89, 0xCA, 0x48, 0xC1, 0xE2, 0x0A, 0x49, 0xC1, 0xE4, 0x08, 0x4C, 0x09, 0xE2,
    0x48, 0x09, 0xFA, 0x49, 0x89, 0x94, 0x03, 0x00, 0x0B, 0x00, 0x00, 0x49, 0xFF, 0x43, 0x50, 0x49,
    0xFF, 0x43, 0x58, 0x49, 0x89, 0x0B, 0x4D, 0x89, 0x73, 0x20, 0x31, 0xC0, 0xE9, 0xCD, 0x01, 0x00,
    0x00, 0x49, 0x8D, 0x5B, 0x60, 0x45, 0x31, 0xE4, 0x4D, 0x3B, 0x63, 0x38, 0x73, 0x10, 0x3B, 0x3B,
    0x74, 0x0E, 0x48, 0x81, 0xC3, 0x28, 0x02, 0x00, 0x00, 0x49, 0xFF, 0xC4, 0xEB, 0xEA, 0xF9, 0xC3,
    0xF8, 0xC3, 0x4D, 0x85, 0xC9, 0x0F, 0x85, 0x9C, 0xFE, 0xFF, 0xFF, 0x48, 0x85, 0xF6, 0x0F, 0x84,
    0x93, 0xFE, 0xFF, 0xFF, 0x8D, 0x47, 0xFF, 0x83, 0xF8, 0x3E, 0x0F, 0x87, 0x87, 0xFE, 0xFF, 0xFF,
    0x4D, 0x85, 0xD2, 0x74, 0x0A, 0x49, 0x83, 0x3A, 0x00, 0x0F, 0x85, 0x78, 0xFE, 0xFF, 0xFF, 0x89,
    0xFF, 0x31, 0xC0, 0x48, 0x0F, 0xAB, 0xF8, 0x48, 0xFF, 0xC8, 0x48, 0x89, 0xD5, 0x31, 0xFF, 0x48,
    0x85, 0xD2, 0x74, 0x19, 0x48, 0x8B, 0x3A, 0x48, 0x21, 0xC7, 0x4D, 0x8B, 0xA3, 0x70, 0x0B, 0x00,
    0x00, 0x49, 0xF7, 0xD4, 0x49, 0x85, 0xFC, 0x0F, 0x85, 0x4A, 0xFE, 0xFF, 0xFF, 0x49, 0x89, 0xBB,
    0x78, 0x0B, 0x00, 0x00, 0x48, 0x8B, 0x16, 0x48, 0x21, 0xC2, 0x48, 0x09, 0xD7, 0x0F, 0x84, 0x34,
    0xFE, 0xFF, 0xFF, 0x49, 0x8B, 0x43, 0x30, 0x48, 0xF7, 0xD0, 0x48, 0x85, 0xD0, 0x0F, 0x85, 0x24,
    0xFE, 0xFF, 0xFF, 0x49, 0xBD, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F, 0x4D, 0x85, 0xC0,
    0x74, 0x2C, 0x49, 0x8B, 0x00, 0x48, 0x3D, 0x00, 0xCA, 0x9A, 0x3B, 0x0F, 0x83, 0x06, 0xFE, 0xFF,
    0xFF, 0x4C, 0x69, 0xE8, 0x00, 0xCA, 0x9A, 0x3B, 0x49, 0x8B, 0x40, 0x08, 0x48, 0x3D, 0x00, 0xCA,
    0x9A, 0x3B, 0x0F, 0x83, 0xEF, 0xFD, 0xFF, 0xFF, 0x49, 0x01, 0xC5, 0x49, 0x01, 0xCD, 0x31, 0xFF,
    0x49, 0xBC, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F, 0x4D, 0x89, 0xE7, 0x49, 0x8D, 0x5B,
    0x60, 0x4D, 0x8B, 0x4B, 0x38, 0x4D, 0x85, 0xC9, 0x74, 0x46, 0x49, 0xFF, 0xC9, 0x8B, 0x03, 0x48,
    0x0F, 0xA3, 0xC2, 0x73, 0x32, 0x4C, 0x8B, 0x53, 0x20, 0x4C, 0x3B, 0x53, 0x18, 0x73, 0x1D, 0x4E,
    0x8B, 0x54, 0xD3, 0x28, 0x49, 0xC1, 0xEA, 0x08, 0x49, 0x39, 0xCA, 0x77, 0x06, 0x48, 0x0F, 0xAB,
    0xC7, 0xEB, 0x14, 0x4D, 0x39, 0xE2, 0x4D, 0x0F, 0x42, 0xE2, 0xEB, 0x0B, 0x4C, 0x8B, 0x53, 0x10,
    0x4D, 0x39, 0xFA, 0x4D, 0x0F, 0x42, 0xFA, 0x48, 0x81, 0xC3, 0x28, 0x02, 0x00, 0x00, 0xEB, 0xB5,
    0x4C, 0x39, 0xF9, 0x0F, 0x83, 0x7E, 0xFD, 0xFF, 0xFF, 0x48, 0x89, 0xF8, 0x49, 0x0B, 0x83, 0x78,
    0x0B, 0x00, 0x00, 0x75, 0x28, 0x4D, 0x39, 0xFC, 0x0F, 0x83, 0x69, 0xFD, 0xFF, 0xFF, 0x4D, 0x3B,
    0x63, 0x08, 0x0F, 0x87, 0x5F, 0xFD, 0xFF, 0xFF, 0x4D, 0x39, 0xEC, 0x0F, 0x83, 0x56, 0xFD, 0xFF,
    0xFF, 0x4C, 0x89, 0xE1, 0x4D, 0x8B, 0x73, 0x28, 0xE9, 0x61, 0xFF, 0xFF, 0xFF, 0x48, 0x89, 0x3E,
    0x4D, 0x85, 0xC0, 0x74, 0x18, 0x4C, 0x89, 0xE8, 0x48, 0x29, 0xC8, 0x31, 0xD2, 0x41, 0xB9, 0x00,
    0xCA, 0x9A, 0x3B, 0x49, 0xF7, 0xF1, 0x49, 0x89, 0x00, 0x49, 0x89, 0x50, 0x08, 0xF3, 0x48, 0x0F,
    0xB8, 0xC7, 0x48, 0x85, 0xED, 0x74, 0x13, 0x49, 0x8B, 0x93, 0x78, 0x0B, 0x00, 0x00, 0x48, 0x89,
    0x55, 0x00, 0xF3, 0x48, 0x0F, 0xB8, 0xD2, 0x48, 0x01, 0xD0, 0x49, 0xFF, 0x43, 0x48, 0x49, 0xC7,
    0x43, 0x50, 0x00, 0x00, 0x00, 0x00, 0x49, 0x89, 0x0B, 0x4D, 0x89, 0x73, 0x20, 0xF8, 0x5D, 0x41,
    0x5F, 0x41, 0x5E, 0x41, 0x5D, 0x41, 0x5C, 0x41, 0x5A, 0x41, 0x59, 0x41, 0x58, 0x5F, 0x5E, 0x5A,
    0x5B, 0xC3,
];
/// For each function of the kernel's page, the offset of our function in `CODE`.
const FUNCTIONS: [(&str, u64); 6] = [
    ("clock_gettime", 0x00),
    ("gettimeofday", 0x47),
    ("time", 0x82),
    ("clock_getres", 0xA4),
    ("getcpu", 0xAC),
    ("getrandom", 0xB4),
];
/// Offsets of the code that answers calls, of its part that gives up, and of its end.
const SERVE: u64 = 0xEF;
const GIVE_UP: u64 = 0x137;
/// Range of this code between its pushes and its pops.
const SERVED: core::ops::Range<u64> = 0x102..0x43E;
/// Offsets of its pushes.
const PUSHES: [u64; 12] = [0, 1, 2, 3, 4, 6, 8, 10, 12, 14, 16, 18];
/// The instruction that calls this code from a detour, the instruction's length, and the flag that
/// means that the code gave up.
const CALL: [u8; 2] = [0xE8, 5];
const CARRY: u64 = 1;
/// Range for detours, from the start of the code.
const DETOURS: core::ops::Range<u64> = 2048..4096;
/// Offset of the data from the start of the code. The data has its own page, because processors are
/// slow if changing data is close to code.
const DATA: u64 = 4096;
/// Offset of our code from the start of the copy of the kernel's page.
const OURS: u64 = 8192;
/// Offsets and sizes in the data: ports, reads of ports, counts of their bytes.
const PORTS: u64 = 96;
const PORT: u64 = 552;
const READS: u64 = 2304;
const PORTS_MAX: usize = 4;
const READS_MAX: usize = 64;
const ASKS: u64 = 2816;
const ASKS_MAX: usize = 7;
const TAKES: u64 = 2928;
/// The relative jump instruction.
const JUMP: u8 = 0xE9;
/// Constants of the ELF format.
const SECTIONS: core::ops::Range<usize> = 0..64;
const DYNAMIC: u64 = 2;
const DT_HASH: u64 = 4;
const DT_STRTAB: u64 = 5;
const DT_SYMTAB: u64 = 6;
const FUNCTION: u8 = 2;

/// The page of a process.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockPage {
    /// Address of the copy.
    pub(super) place: u64,
    data: u64,
    /// Address for the next detour.
    next_detour: u64,
}

impl ClockPage {
    /// Puts the page into the process `tid`, which has just executed another program and has
    /// stopped at the end of that call.
    pub(super) fn put(tid: Pid, hands: &mut Hands) -> Result<Self, NotMade> {
        let (_, mut image) = kernel_page(tid).ok_or(NotMade::Refused)?;
        let len = image.len() as u64;
        let jumps = lead(&image, len).ok_or(NotMade::Refused)?;
        for (at, jump) in jumps {
            let to = image.get_mut(at..at + jump.len());
            to.ok_or(NotMade::Refused)?.copy_from_slice(&jump);
        }
        image.extend(CODE);
        let access = libc::PROT_READ | libc::PROT_WRITE | libc::PROT_EXEC;
        let kind = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
        let [access, kind] = [access, kind].map(|flags| u64::from(flags.unsigned_abs()));
        let asked = [0, len + OURS, access, kind, u64::MAX, 0];
        let place = hands.call(libc::SYS_mmap, &asked)?;
        let place = u64::try_from(place).map_err(|_| NotMade::Refused)?;
        Memory(tid).write(place, &image)?;
        let code = place + len;
        Ok(Self {
            place,
            data: code + DATA,
            next_detour: code + DETOURS.start,
        })
    }

    const fn code(self) -> u64 {
        self.data - DATA
    }

    /// Address of the code that answers calls.
    pub(super) const fn serve(self) -> u64 {
        self.code() + SERVE
    }

    /// Handles a fault of a thread in the code that answers calls: a buffer of its call is invalid,
    /// or its stack has no room for that code. Leads the thread out of this code. `None` if the
    /// thread is not in it.
    pub(super) fn gives_up(self, tid: Pid, registers: &mut user_regs_struct) -> Option<()> {
        let inside = registers.rip.wrapping_sub(self.code());
        if SERVED.contains(&inside) {
            registers.rip = self.code() + GIVE_UP;
            return Some(());
        }
        if DETOURS.contains(&inside) {
            let [call, len] = CALL;
            let mut found = [0];
            Memory(tid).read(registers.rip, &mut found).ok()?;
            if found != [call] {
                return None;
            }
            registers.rip += u64::from(len);
        } else {
            let from = inside.wrapping_sub(SERVE);
            let pushed = PUSHES.iter().position(|&at| at == from)?;
            let place = registers.rsp + 8 * pushed as u64;
            registers.rip = Memory(tid).u64(place).ok()?;
            registers.rsp = place + 8;
        }
        registers.eflags |= CARRY;
        Some(())
    }

    /// Allocates a detour of `len` bytes.
    pub(super) fn detour(&mut self, len: u64) -> Option<u64> {
        let place = self.next_detour;
        let end = place + len;
        if end > self.code() + DETOURS.end {
            return None;
        }
        self.next_detour = end;
        Some(place)
    }

    /// Whether `address` is in the page's code.
    pub(super) const fn has_code_at(self, address: u64) -> bool {
        self.place <= address && address < self.data
    }

    /// Lets the thread count time by itself, and read the bytes of `ports`, at most four. Fails if
    /// the program has made the page read-only: then nothing is lent.
    pub(super) fn lend(self, tid: Pid, loan: Loan, ports: &[LentPort]) -> Result<(), Errno> {
        let ports = &ports[..ports.len().min(PORTS_MAX)];
        let words = [
            loan.now,
            loan.limit,
            loan.cost,
            0,
            loan.looks,
            loan.turn,
            if ports.is_empty() { 0 } else { loan.known },
            ports.len() as u64,
            0,
            0,
            if loan.counts { 0 } else { ASKS_MAX as u64 },
            0,
        ];
        let words = words.map(u64::to_ne_bytes);
        let lent: Vec<Vec<u8>> = ports.iter().map(LentPort::image).collect();
        let places = (self.data + PORTS..).step_by(usize::try_from(PORT).unwrap_or(usize::MAX));
        let places = places.zip(lent.iter().map(Vec::as_slice));
        let takes = ports.iter().filter(|port| port.takes);
        let takes = takes.fold(0, |all, port| all | 1_u64 << port.fd);
        let takes = takes.to_ne_bytes();
        let head = [
            (self.data, words.as_flattened()),
            (self.data + TAKES, &takes[..]),
        ];
        let head = head.into_iter().take(1 + usize::from(!ports.is_empty()));
        let all = head.chain(places);
        Memory(tid).write_all(all)
    }

    /// The use of the loan so far; `is_lent`: with ports.
    pub(super) fn take(self, tid: Pid, is_lent: bool) -> Option<Taken> {
        let mut words = [[0; 8]; 12];
        let mut reads = [[0; 8]; READS_MAX];
        let mut asks = [[0; 8]; 2 * ASKS_MAX];
        let [reads_at, asks_at] = [READS, ASKS].map(|at| if is_lent { self.data + at } else { 0 });
        let places = [
            (self.data, words.as_flattened_mut()),
            (reads_at, reads.as_flattened_mut()),
            (asks_at, asks.as_flattened_mut()),
        ];
        Memory(tid).read_all(places.into_iter()).ok()?;
        let words = words.map(u64::from_ne_bytes);
        let [
            now,
            _,
            _,
            looks,
            left,
            _,
            _,
            _,
            reads_len,
            selects,
            asked,
            counts,
        ] = words;
        let at_most = |count: u64, most: usize| {
            let count = usize::try_from(count).map_or(most, |count| count.min(most));
            if is_lent { count } else { 0 }
        };
        let reads = reads.iter().take(at_most(reads_len, READS_MAX));
        let asked = if counts > 0 { asked } else { 0 };
        let asks = asks.chunks_exact(2).take(at_most(asked, ASKS_MAX));
        Some(Taken {
            now,
            looks,
            left: u64::try_from(left.cast_signed()).unwrap_or(0),
            selects,
            counts,
            reads: reads.map(|&read| LentRead::of(read)).collect(),
            last_counts: asks
                .map(|ask| {
                    let LentRead { at, index, len } = LentRead::of(ask[0]);
                    let address = u64::from_ne_bytes(ask[1]);
                    LentCount {
                        at,
                        index,
                        len,
                        address,
                    }
                })
                .collect(),
        })
    }
}

/// The jumps to our functions and their offsets in the kernel's page, whose length is `len`.
fn lead(image: &[u8], len: u64) -> Option<Vec<(usize, [u8; 5])>> {
    let word = |at: u64| {
        let at = usize::try_from(at).ok()?;
        let bytes = image.get(at..at.checked_add(8)?)?;
        Some(u64::from_le_bytes(bytes.try_into().ok()?))
    };
    let half = |at: u64| Some(word(at)? & 0xFFFF);
    let low = |at: u64| Some(word(at)? & 0xFFFF_FFFF);
    image
        .get(SECTIONS)
        .filter(|head| head.starts_with(b"\x7FELF\x02"))?;
    let inside = |at: u64| (at < image.len() as u64).then_some(at);
    // Program headers: offset at 32, size at 54, count at 56.
    let (headers, size, count) = (inside(word(32)?)?, half(54)?, half(56)?);
    let mut parts = (0..count).map(|index| headers + index * size);
    let dynamic = parts.find(|&part| low(part) == Some(DYNAMIC))?;
    let table = inside(word(dynamic + 16)?)?;
    let entry = |kind: u64| {
        let mut entries = (0..64).map(|index| table + 16 * index);
        let found = entries.find(|&at| matches!(word(at), Some(it) if it == kind || it == 0))?;
        word(found)?
            .eq(&kind)
            .then(|| inside(word(found + 8)?))
            .flatten()
    };
    let (hash, names, symbols) = (entry(DT_HASH)?, entry(DT_STRTAB)?, entry(DT_SYMTAB)?);
    // The hash table's second number is that of symbols.
    let count = low(hash + 4)?;
    let mut jumps = Vec::new();
    for index in 0..count {
        let symbol = symbols + 24 * index;
        let name = usize::try_from(names + low(symbol)?).ok()?;
        let name = image.get(name..)?.split(|&byte| byte == 0).next()?;
        let name = name.strip_prefix(b"__vdso_").unwrap_or(name);
        let is_function = half(symbol + 4)?.to_le_bytes()[0] & 0xF == FUNCTION;
        let ours = FUNCTIONS.iter().find(|(known, _)| known.as_bytes() == name);
        let (Some(&(_, ours)), true) = (ours, is_function) else {
            continue;
        };
        let at = inside(word(symbol + 8)?)?;
        let distance = i32::try_from((len + ours).checked_sub(at + 5)?).ok()?;
        let mut jump = [JUMP, 0, 0, 0, 0];
        jump[1..].copy_from_slice(&distance.to_le_bytes());
        jumps.push((usize::try_from(at).ok()?, jump));
    }
    // Without these functions the page brings no gain.
    jumps.len().ge(&2).then_some(jumps)
}

#[cfg(test)]
mod tests {
    use crate::guest::tests::Room;
    use protocols::Instant;
    use std::process::Command;

    use super::*;

    /// The bytes of `CODE` are those of the assembled source file.
    #[test]
    fn the_code_is_that_of_its_source() {
        let folder = std::env::temp_dir().join(format!("hilrig-page-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a free name");
        let (object, binary) = (folder.join("page.o"), folder.join("page.bin"));
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/src/guest/clock_page.s");
        let made = Command::new("as")
            .arg(source)
            .arg("-o")
            .arg(&object)
            .status();
        let made = made.and_then(|_| {
            let mut copy = Command::new("objcopy");
            copy.args(["-O", "binary", "-j", ".text"])
                .arg(&object)
                .arg(&binary);
            copy.status()
        });
        if let Err(error) = made {
            eprintln!("SKIPPED: no assembler: {error}");
            return;
        }
        assert_eq!(std::fs::read(&binary).expect("assembled"), CODE);
        let names = Command::new("nm").arg(&object).output().expect("beside as");
        let names = String::from_utf8_lossy(&names.stdout).into_owned();
        for (name, at) in FUNCTIONS
            .into_iter()
            .chain([("serve", SERVE), ("give_up", GIVE_UP)])
            .chain([("served", SERVED.start), ("leave", SERVED.end)])
        {
            assert!(
                names.contains(&format!("{at:016x} t {name}\n")),
                "{name}: {names}"
            );
        }
        std::fs::remove_dir_all(&folder).expect("ours");
    }

    /// The kernel's page of this process has the functions that programs look for.
    #[test]
    fn the_kernels_page_is_led_to_ours() {
        let own = Pid::from_raw(std::process::id().cast_signed());
        let Some((_, image)) = kernel_page(own) else {
            eprintln!("SKIPPED: this kernel has no page of its own");
            return;
        };
        let jumps = lead(&image, image.len() as u64).expect("a file of the known format");
        for (at, jump) in jumps {
            let distance = i32::from_le_bytes([jump[1], jump[2], jump[3], jump[4]]);
            let target = at + 5 + usize::try_from(distance).expect("ours is behind it");
            let ours = FUNCTIONS.iter().map(|&(_, at)| image.len() as u64 + at);
            assert!(ours.into_iter().any(|at| at == target as u64), "{at:x}");
        }
    }

    #[test]
    fn an_image_of_another_format_is_refused() {
        assert_eq!(lead(&[], 0), None);
        assert_eq!(lead(&[0; 8192], 8192), None);
        let mut cut = b"\x7FELF\x02".to_vec();
        cut.resize(64, 0xFF);
        assert_eq!(lead(&cut, 64), None);
    }

    impl ClockPage {
        /// A page whose data are at `place`.
        pub(in crate::guest) const fn at(data: u64) -> Self {
            Self {
                place: data - DATA - 4_096,
                data,
                next_detour: data - DATA + DETOURS.start,
            }
        }
    }

    const PAGE: ClockPage = ClockPage {
        place: 0x1_0000,
        data: 0x2_1000,
        next_detour: 0x2_0800,
    };

    #[test]
    fn a_page_has_room_for_detours() {
        let mut page = PAGE;
        assert_eq!(page.code(), 0x2_0000);
        assert_eq!(page.serve(), 0x2_00EF);
        assert_eq!(page.detour(56), Some(0x2_0800));
        assert_eq!(page.detour(0x7C8 - 1), Some(0x2_0838));
        assert_eq!(page.detour(2), None);
        assert_eq!(page.detour(1), Some(0x2_0FFF));
        assert_eq!(page.detour(1), None);
        for (address, expected) in [
            (0xFFFF, false),
            (0x1_0000, true),
            (0x2_0FFF, true),
            (0x2_1000, false),
        ] {
            assert_eq!(PAGE.has_code_at(address), expected, "{address:x}");
        }
    }

    fn lent(fd: i32, takes: bool, bytes: &[(u64, u8)]) -> LentPort {
        let bytes = bytes
            .iter()
            .map(|&(at, byte)| (Instant::from_nanos(at), byte));
        LentPort {
            port: 0,
            fd,
            waits: true,
            takes,
            known_until: Instant::from_nanos(99),
            bytes: bytes.collect(),
        }
    }

    /// The words of `clock_page.s`: now, limit, cost, looks, left, turn, known, number of ports,
    /// reads, selects, counts that are left, all counts. Ports are at 96 and each 552 bytes behind,
    /// what takes bytes is at 2,928.
    #[test]
    fn what_is_lent_is_put_where_the_code_looks_for_it() {
        let room = Room::of(&[0xA5; 4_096]);
        let page = ClockPage::at(room.at(0));
        let own = crate::guest::tests::own();
        let loan = Loan {
            now: 1,
            limit: 2,
            cost: 3,
            looks: 4,
            turn: 5,
            known: 6,
            counts: true,
        };
        let untouched = u64::from_ne_bytes([0xA5; 8]);
        page.lend(own, loan, &[]).expect("own");
        let words = room.words();
        assert_eq!(words[..12], [1, 2, 3, 0, 4, 5, 0, 0, 0, 0, 0, 0]);
        assert!(words[12..].iter().all(|&word| word == untouched));
        let ports = [
            lent(3, true, &[(7, 0x41), (8, 0x42)]),
            lent(5, false, &[]),
            lent(4, true, &[]),
        ];
        let loan = Loan {
            counts: false,
            ..loan
        };
        page.lend(own, loan, &ports).expect("own");
        let words = room.words();
        assert_eq!(words[..12], [1, 2, 3, 0, 4, 5, 6, 3, 0, 0, 7, 0]);
        assert_eq!(words[12..19], [3, 1, 99, 2, 0, 0x741, 0x842]);
        assert_eq!(words[81..86], [5, 1, 99, 0, 0]);
        assert_eq!(words[150..155], [4, 1, 99, 0, 0]);
        assert_eq!((words[366], words[365]), (0b1_1000, untouched));
        let many: Vec<LentPort> = (0..5).map(|fd| lent(fd, true, &[])).collect();
        page.lend(own, loan, &many).expect("own");
        let words = room.words();
        assert_eq!((words[7], words[366]), (4, 0b1111), "four at most");
        assert_eq!(
            ClockPage::at(1 << 20).lend(own, loan, &[]),
            Err(Errno::EFAULT)
        );
    }

    /// Reads are at 2,304, counts of bytes at 2,816: a word has the time from bit 10 on, the port
    /// in bits 8 and 9, the length below.
    #[test]
    fn what_was_counted_is_taken() {
        let room = Room::new(4_096);
        let page = ClockPage::at(room.at(0));
        let own = crate::guest::tests::own();
        let put = |at: usize, words: &[u64]| {
            room.put(
                at,
                &words
                    .iter()
                    .map(|it| it.to_ne_bytes())
                    .collect::<Vec<_>>()
                    .concat(),
            );
        };
        put(0, &[100, 0, 0, 3, 7, 0, 0, 0, 2, 4, 1, 5]);
        put(2_304, &[50 << 10 | 1 << 8 | 9, 60 << 10 | 2, 77]);
        put(2_816, &[70 << 10 | 2 << 8 | 8, 0xABC, 1]);
        let at = Instant::from_nanos;
        let expected = Taken {
            now: 100,
            looks: 3,
            left: 7,
            selects: 4,
            counts: 5,
            reads: vec![
                LentRead {
                    at: at(50),
                    index: 1,
                    len: 9,
                },
                LentRead {
                    at: at(60),
                    index: 0,
                    len: 2,
                },
            ],
            last_counts: vec![LentCount {
                at: at(70),
                index: 2,
                len: 8,
                address: 0xABC,
            }],
        };
        assert_eq!(page.take(own, true), Some(expected.clone()));
        let alone = Taken {
            reads: Vec::new(),
            last_counts: Vec::new(),
            ..expected.clone()
        };
        assert_eq!(page.take(own, false), Some(alone));
        // Without a count there is none to be told, and less than nothing is left of a turn.
        put(32, &[u64::MAX]);
        put(88, &[0]);
        let taken = page.take(own, true).expect("own");
        assert_eq!((taken.left, taken.last_counts), (0, Vec::new()));
        // A page that was written to says no more than there is room for.
        put(64, &[u64::MAX, 0, u64::MAX, 1]);
        let taken = page.take(own, true).expect("own");
        assert_eq!((taken.reads.len(), taken.last_counts.len()), (64, 7));
        put(64, &[65, 0, 8, 1]);
        let taken = page.take(own, true).expect("own");
        assert_eq!((taken.reads.len(), taken.last_counts.len()), (64, 7));
        assert_eq!(ClockPage::at(1 << 20).take(own, true), None);
    }

    /// A fault between pushes and pops leads to where the code gives up; one at a push or at the
    /// call of a detour leads back behind that call, with the carry flag, which says so.
    #[test]
    fn a_thread_is_led_out_of_the_code_that_answers() {
        let own = crate::guest::tests::own();
        let code = Room::new(8_192);
        let page = ClockPage::at(code.at(4_096));
        let base = code.at(0);
        let stack = Room::of_words(&[11, 12, 13, 0xABCD, 15]);
        let led = |inside: u64| {
            let mut registers = crate::guest::tests::no_registers();
            (registers.rip, registers.rsp) = (base + inside, stack.at(0));
            registers.eflags = 0x202;
            let done = page.gives_up(own, &mut registers);
            done.map(|()| (registers.rip, registers.rsp, registers.eflags))
        };
        let top = stack.at(0);
        assert_eq!(led(0x102), Some((base + 0x137, top, 0x202)));
        assert_eq!(led(0x43D), Some((base + 0x137, top, 0x202)));
        assert_eq!(led(0x43E), None);
        assert_eq!(led(0x100), None, "no push begins there");
        // The first push is at 0xEF, the fourth at 0xF2.
        assert_eq!(led(0xEF), Some((11, top + 8, 0x203)));
        assert_eq!(led(0xF2), Some((0xABCD, top + 32, 0x203)));
        assert_eq!(led(0xEE), None);
        code.put(2_048, &[0xE8]);
        assert_eq!(led(2_048), Some((base + 2_053, top, 0x203)));
        assert_eq!(led(2_049), None, "another instruction");
        code.put(4_095, &[0xE8]);
        assert_eq!(led(4_095), Some((base + 4_100, top, 0x203)));
        assert_eq!(led(4_096), None);
        assert_eq!(led(2_047), None);
    }

    /// A file of the program format by hand (elf(5)): program headers at 64, of 56 bytes; the
    /// second one, of kind 2, leads to the table of the dynamic section.
    fn image() -> Vec<u8> {
        let mut image = vec![0; 2_048];
        let mut put = |at: usize, bytes: &[u8]| image[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, b"\x7FELF\x02");
        put(32, &64_u64.to_le_bytes());
        put(54, &56_u16.to_le_bytes());
        put(56, &2_u16.to_le_bytes());
        put(64, &1_u32.to_le_bytes());
        put(120, &2_u32.to_le_bytes());
        put(136, &256_u64.to_le_bytes());
        for (index, [kind, value]) in [[4, 400], [5, 500], [6, 600], [0, 0]]
            .into_iter()
            .enumerate()
        {
            put(256 + 16 * index, &u64::to_le_bytes(kind));
            put(264 + 16 * index, &u64::to_le_bytes(value));
        }
        put(404, &5_u32.to_le_bytes());
        put(501, b"__vdso_time\0getcpu\0other\0time\0");
        // Name, kind of symbol, place: time, getcpu, another function, time as an object, time.
        let symbols = [
            (1, 0x12, 1_000),
            (13, 0x22, 1_100),
            (20, 0x12, 1_200),
            (26, 0x11, 1_300),
            (26, 0x12, 1_400),
        ];
        for (index, (name, info, place)) in symbols.into_iter().enumerate() {
            put(600 + 24 * index, &u32::to_le_bytes(name));
            put(604 + 24 * index, &[info]);
            put(608 + 24 * index, &u64::to_le_bytes(place));
        }
        image
    }

    /// By hand: from behind a jump of 5 bytes at 1,000 to `time` at 0x82 behind 2,048 bytes are
    /// 2,048 + 130 - 1,005 = 1,173 bytes; from 1,100 to `getcpu` at 0xAC 2,048 + 172 - 1,105.
    #[test]
    fn functions_of_an_image_are_led_to_ours() {
        let jump = |distance: i32| {
            let [a, b, c, d] = distance.to_le_bytes();
            [0xE9, a, b, c, d]
        };
        let expected = vec![
            (1_000, jump(1_173)),
            (1_100, jump(1_115)),
            (1_400, jump(773)),
        ];
        assert_eq!(lead(&image(), 2_048), Some(expected));
        let with = |at: usize, bytes: &[u8]| {
            let mut image = image();
            image[at..at + bytes.len()].copy_from_slice(bytes);
            lead(&image, 2_048).map(|jumps| jumps.len())
        };
        assert_eq!(with(4, &[1]), None, "of 32 bits");
        assert_eq!(with(56, &[1]), None, "without a dynamic section");
        assert_eq!(with(32, &2_048_u64.to_le_bytes()), None, "outside");
        assert_eq!(with(136, &2_048_u64.to_le_bytes()), None, "outside");
        for entry in [256, 272, 288] {
            assert_eq!(with(entry, &[9]), None, "without a table");
            assert_eq!(with(entry + 8, &2_048_u64.to_le_bytes()), None, "outside");
        }
        assert_eq!(with(404, &[4]), Some(2), "of four symbols");
        assert_eq!(with(404, &[1]), None, "with one function only");
        assert_eq!(
            with(608, &2_048_u64.to_le_bytes()),
            None,
            "a function outside"
        );
        // The end of the dynamic section ends the search.
        assert_eq!(
            with(
                256,
                &[[9_u64, 0], [0, 0], [4, 400], [5, 500]]
                    .as_flattened()
                    .iter()
                    .flat_map(|it| it.to_le_bytes())
                    .collect::<Vec<u8>>()
            ),
            None
        );
    }
}
