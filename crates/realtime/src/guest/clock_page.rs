//! Clocks and ports that a program reads without a stop: pages of ours in place of the kernel's own.
//!
//! A copy of the kernel's page is put into each new program, its functions led to ours, which count
//! virtual time in memory beside them. The supervisor lends time to them before it lets a thread go
//! on: up to the next event at the rig, and for so many looks as the thread may make before others
//! have their turn. Beyond that a look is a call. So a run is the same with the page and without.
//!
//! ```text
//!  stop --lend: now, limit, cost--> looks, looks, .. --stop, take: now, how many--> supervisor
//! ```

use nix::libc;
use nix::unistd::Pid;
use protocols::Instant;

use super::inject::{Hands, NotMade, kernel_page};
use super::memory::Memory;

/// Made of `clock_page.s`, which a test assembles.
#[rustfmt::skip]
const CODE: [u8; 1043] = [
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
    0x57, 0x4C, 0x8D, 0x1D, 0xF8, 0x0E, 0x00, 0x00, 0x49, 0x8B, 0x0B, 0x49, 0x03, 0x4B, 0x10, 0x49,
    0x3B, 0x4B, 0x08, 0x77, 0x21, 0x4D, 0x8B, 0x73, 0x20, 0x49, 0xFF, 0xCE, 0x78, 0x18, 0x85, 0xC0,
    0x74, 0x1A, 0x83, 0xF8, 0x10, 0x0F, 0x84, 0xB6, 0x00, 0x00, 0x00, 0x3D, 0x0E, 0x01, 0x00, 0x00,
    0x0F, 0x84, 0x5B, 0x01, 0x00, 0x00, 0xF9, 0xE9, 0xC4, 0x02, 0x00, 0x00, 0x48, 0x85, 0xD2, 0x74,
    0xF5, 0x49, 0x83, 0x7B, 0x40, 0x40, 0x73, 0xEE, 0xE8, 0x23, 0x01, 0x00, 0x00, 0x72, 0xE7, 0x31,
    0xFF, 0x48, 0x8B, 0x43, 0x20, 0x48, 0x01, 0xF8, 0x48, 0x3B, 0x43, 0x18, 0x73, 0x1E, 0x48, 0x8B,
    0x44, 0xC3, 0x28, 0x49, 0x89, 0xC0, 0x49, 0xC1, 0xE8, 0x08, 0x49, 0x39, 0xC8, 0x77, 0x1A, 0x88,
    0x04, 0x3E, 0x48, 0xFF, 0xC7, 0x48, 0x39, 0xD7, 0x72, 0xD7, 0xEB, 0x28, 0x48, 0x3B, 0x4B, 0x10,
    0x73, 0xB4, 0x48, 0x85, 0xFF, 0x74, 0xAF, 0xEB, 0x1B, 0x48, 0x85, 0xFF, 0x75, 0x16, 0x48, 0x83,
    0x7B, 0x08, 0x00, 0x74, 0xA1, 0x4D, 0x3B, 0x43, 0x08, 0x77, 0x9B, 0x4C, 0x89, 0xC1, 0x4D, 0x8B,
    0x73, 0x28, 0xEB, 0xAD, 0x49, 0x8B, 0x43, 0x40, 0x48, 0x89, 0xCA, 0x48, 0xC1, 0xE2, 0x0A, 0x49,
    0xC1, 0xE4, 0x08, 0x4C, 0x09, 0xE2, 0x48, 0x09, 0xFA, 0x49, 0x89, 0x94, 0xC3, 0x00, 0x09, 0x00,
    0x00, 0x49, 0xFF, 0x43, 0x40, 0x49, 0xC7, 0x43, 0x50, 0x00, 0x00, 0x00, 0x00, 0x48, 0x01, 0x7B,
    0x20, 0x49, 0x89, 0x0B, 0x4D, 0x89, 0x73, 0x20, 0x48, 0x89, 0xF8, 0xF8, 0xE9, 0x1F, 0x02, 0x00,
    0x00, 0x81, 0xFE, 0x1B, 0x54, 0x00, 0x00, 0x0F, 0x85, 0x49, 0xFF, 0xFF, 0xFF, 0x49, 0x83, 0x7B,
    0x50, 0x07, 0x0F, 0x83, 0x3E, 0xFF, 0xFF, 0xFF, 0xE8, 0x73, 0x00, 0x00, 0x00, 0x0F, 0x82, 0x33,
    0xFF, 0xFF, 0xFF, 0x31, 0xFF, 0x48, 0x8B, 0x43, 0x20, 0x48, 0x01, 0xF8, 0x48, 0x3B, 0x43, 0x18,
    0x73, 0x13, 0x48, 0x8B, 0x44, 0xC3, 0x28, 0x48, 0xC1, 0xE8, 0x08, 0x48, 0x39, 0xC8, 0x77, 0x0F,
    0x48, 0xFF, 0xC7, 0xEB, 0xE0, 0x48, 0x3B, 0x4B, 0x10, 0x0F, 0x83, 0x07, 0xFF, 0xFF, 0xFF, 0x89,
    0x3A, 0x49, 0x8B, 0x43, 0x50, 0x48, 0xC1, 0xE0, 0x04, 0x49, 0x89, 0x94, 0x03, 0x08, 0x0B, 0x00,
    0x00, 0x48, 0x89, 0xCA, 0x48, 0xC1, 0xE2, 0x0A, 0x49, 0xC1, 0xE4, 0x08, 0x4C, 0x09, 0xE2, 0x48,
    0x09, 0xFA, 0x49, 0x89, 0x94, 0x03, 0x00, 0x0B, 0x00, 0x00, 0x49, 0xFF, 0x43, 0x50, 0x49, 0xFF,
    0x43, 0x58, 0x49, 0x89, 0x0B, 0x4D, 0x89, 0x73, 0x20, 0x31, 0xC0, 0xE9, 0x90, 0x01, 0x00, 0x00,
    0x49, 0x8D, 0x5B, 0x60, 0x45, 0x31, 0xE4, 0x4D, 0x3B, 0x63, 0x38, 0x73, 0x10, 0x3B, 0x3B, 0x74,
    0x0E, 0x48, 0x81, 0xC3, 0x28, 0x02, 0x00, 0x00, 0x49, 0xFF, 0xC4, 0xEB, 0xEA, 0xF9, 0xC3, 0xF8,
    0xC3, 0x4D, 0x85, 0xC9, 0x0F, 0x85, 0x9C, 0xFE, 0xFF, 0xFF, 0x48, 0x85, 0xF6, 0x0F, 0x84, 0x93,
    0xFE, 0xFF, 0xFF, 0x8D, 0x47, 0xFF, 0x83, 0xF8, 0x3E, 0x0F, 0x87, 0x87, 0xFE, 0xFF, 0xFF, 0x48,
    0x85, 0xD2, 0x74, 0x0A, 0x48, 0x83, 0x3A, 0x00, 0x0F, 0x85, 0x78, 0xFE, 0xFF, 0xFF, 0x4D, 0x85,
    0xD2, 0x74, 0x0A, 0x49, 0x83, 0x3A, 0x00, 0x0F, 0x85, 0x69, 0xFE, 0xFF, 0xFF, 0x89, 0xFF, 0x31,
    0xC0, 0x48, 0x0F, 0xAB, 0xF8, 0x48, 0xFF, 0xC8, 0x48, 0x8B, 0x16, 0x48, 0x21, 0xC2, 0x0F, 0x84,
    0x52, 0xFE, 0xFF, 0xFF, 0x49, 0x8B, 0x43, 0x30, 0x48, 0xF7, 0xD0, 0x48, 0x85, 0xD0, 0x0F, 0x85,
    0x42, 0xFE, 0xFF, 0xFF, 0x49, 0xBD, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F, 0x4D, 0x85,
    0xC0, 0x74, 0x2C, 0x49, 0x8B, 0x00, 0x48, 0x3D, 0x00, 0xCA, 0x9A, 0x3B, 0x0F, 0x83, 0x24, 0xFE,
    0xFF, 0xFF, 0x4C, 0x69, 0xE8, 0x00, 0xCA, 0x9A, 0x3B, 0x49, 0x8B, 0x40, 0x08, 0x48, 0x3D, 0x00,
    0xCA, 0x9A, 0x3B, 0x0F, 0x83, 0x0D, 0xFE, 0xFF, 0xFF, 0x49, 0x01, 0xC5, 0x49, 0x01, 0xCD, 0x31,
    0xFF, 0x49, 0xBC, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F, 0x4D, 0x89, 0xE7, 0x49, 0x8D,
    0x5B, 0x60, 0x4D, 0x8B, 0x4B, 0x38, 0x4D, 0x85, 0xC9, 0x74, 0x46, 0x49, 0xFF, 0xC9, 0x8B, 0x03,
    0x48, 0x0F, 0xA3, 0xC2, 0x73, 0x32, 0x4C, 0x8B, 0x53, 0x20, 0x4C, 0x3B, 0x53, 0x18, 0x73, 0x1D,
    0x4E, 0x8B, 0x54, 0xD3, 0x28, 0x49, 0xC1, 0xEA, 0x08, 0x49, 0x39, 0xCA, 0x77, 0x06, 0x48, 0x0F,
    0xAB, 0xC7, 0xEB, 0x14, 0x4D, 0x39, 0xE2, 0x4D, 0x0F, 0x42, 0xE2, 0xEB, 0x0B, 0x4C, 0x8B, 0x53,
    0x10, 0x4D, 0x39, 0xFA, 0x4D, 0x0F, 0x42, 0xFA, 0x48, 0x81, 0xC3, 0x28, 0x02, 0x00, 0x00, 0xEB,
    0xB5, 0x4C, 0x39, 0xF9, 0x0F, 0x83, 0x9C, 0xFD, 0xFF, 0xFF, 0x48, 0x85, 0xFF, 0x75, 0x28, 0x4D,
    0x39, 0xFC, 0x0F, 0x83, 0x8E, 0xFD, 0xFF, 0xFF, 0x4D, 0x3B, 0x63, 0x08, 0x0F, 0x87, 0x84, 0xFD,
    0xFF, 0xFF, 0x4D, 0x39, 0xEC, 0x0F, 0x83, 0x7B, 0xFD, 0xFF, 0xFF, 0x4C, 0x89, 0xE1, 0x4D, 0x8B,
    0x73, 0x28, 0xE9, 0x68, 0xFF, 0xFF, 0xFF, 0x48, 0x89, 0x3E, 0x4D, 0x85, 0xC0, 0x74, 0x18, 0x4C,
    0x89, 0xE8, 0x48, 0x29, 0xC8, 0x31, 0xD2, 0x41, 0xB9, 0x00, 0xCA, 0x9A, 0x3B, 0x49, 0xF7, 0xF1,
    0x49, 0x89, 0x00, 0x49, 0x89, 0x50, 0x08, 0x49, 0xFF, 0x43, 0x48, 0x49, 0xC7, 0x43, 0x50, 0x00,
    0x00, 0x00, 0x00, 0x49, 0x89, 0x0B, 0x4D, 0x89, 0x73, 0x20, 0xF3, 0x48, 0x0F, 0xB8, 0xC7, 0xF8,
    0x41, 0x5F, 0x41, 0x5E, 0x41, 0x5D, 0x41, 0x5C, 0x41, 0x5A, 0x41, 0x59, 0x41, 0x58, 0x5F, 0x5E,
    0x5A, 0x5B, 0xC3,
];
/// Where in it each function of the kernel's page has its own.
const FUNCTIONS: [(&str, u64); 6] = [
    ("clock_gettime", 0x00),
    ("gettimeofday", 0x47),
    ("time", 0x82),
    ("clock_getres", 0xA4),
    ("getcpu", 0xAC),
    ("getrandom", 0xB4),
];
/// The code that answers calls, where it gives up, and its end.
const SERVE: u64 = 0xEF;
const GIVE_UP: u64 = 0x136;
const SERVED: core::ops::Range<u64> = SERVE..CODE.len() as u64;
/// Room for detours, from the beginning of the code.
const DETOURS: core::ops::Range<u64> = 2048..4096;
/// Where the data is, from the beginning of the code: in a page of its own, because processors are
/// slow where code and data that change are close.
const DATA: u64 = 4096;
/// What is put behind the copy of the kernel's page.
const OURS: u64 = 8192;
/// The data: ports, reads of them, counts of their bytes.
const PORTS: u64 = 96;
const PORT: u64 = 552;
const READS: u64 = 2304;
const PORTS_MAX: usize = 4;
const READS_MAX: usize = 64;
const ASKS: u64 = 2816;
const ASKS_MAX: usize = 7;
/// Most bytes of a port that are lent at once.
pub(super) const LENT_BYTES: usize = 64;
/// The instruction that goes on somewhere else, by so many bytes.
const JUMP: u8 = 0xE9;
/// What a file of the program format says of itself.
const SECTIONS: core::ops::Range<usize> = 0..64;
const DYNAMIC: u64 = 2;
const DT_HASH: u64 = 4;
const DT_STRTAB: u64 = 5;
const DT_SYMTAB: u64 = 6;
const FUNCTION: u8 = 2;

/// The page of a process.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockPage {
    /// Where the copy begins.
    pub(super) place: u64,
    data: u64,
    /// Where the next detour goes.
    next_detour: u64,
}

/// Time that a thread may count by itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loan {
    /// Nanoseconds of virtual time, and up to which it may go.
    pub(super) now: u64,
    pub(super) limit: u64,
    /// What a look costs.
    pub(super) cost: u64,
    /// Most looks and calls, and those of a new turn.
    pub(super) looks: u64,
    pub(super) turn: u64,
    /// Files below 64, as bits, of which is known what is ready.
    pub(super) known: u64,
    /// Bytes may be counted before any is read.
    pub(super) counts: bool,
}

/// A port whose bytes are lent.
#[derive(Clone, Debug)]
pub(super) struct LentPort {
    pub(super) port: usize,
    /// The program's file, below 64.
    pub(super) fd: i32,
    /// A read waits for a byte.
    pub(super) waits: bool,
    /// From here on there may be other bytes than those below.
    pub(super) known_until: Instant,
    /// In order of time; those that are there have an earlier one than now.
    pub(super) bytes: Vec<(Instant, u8)>,
}

/// A read of a lent port: when, which of the ports, how many bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LentRead {
    pub(super) at: Instant,
    pub(super) index: usize,
    pub(super) len: usize,
}

/// A count of the bytes of a lent port: when, which of the ports, how many, and where the count
/// went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LentCount {
    pub(super) at: Instant,
    pub(super) index: usize,
    pub(super) len: usize,
    pub(super) address: u64,
}

/// What a thread has made of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Taken {
    pub(super) now: u64,
    pub(super) looks: u64,
    /// Looks and calls that were left.
    pub(super) left: u64,
    pub(super) selects: u64,
    pub(super) reads: Vec<LentRead>,
    /// All counts of bytes, and those behind the last read and select.
    pub(super) counts: u64,
    pub(super) last_counts: Vec<LentCount>,
}

impl ClockPage {
    /// Puts the page into the process `tid`, which has just become another program and stands at
    /// the end of that call.
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

    /// The code that answers calls.
    pub(super) const fn serve(self) -> u64 {
        self.code() + SERVE
    }

    /// Where a thread goes on that stands at `address` because a buffer of its call is none; `None`
    /// if it is not about to answer a call.
    pub(super) fn gives_up_at(self, address: u64) -> Option<u64> {
        let inside = address.wrapping_sub(self.code());
        SERVED.contains(&inside).then(|| self.code() + GIVE_UP)
    }

    /// Room for a detour of `len` bytes.
    pub(super) fn detour(&mut self, len: u64) -> Option<u64> {
        let place = self.next_detour;
        let end = place + len;
        if end > self.code() + DETOURS.end {
            return None;
        }
        self.next_detour = end;
        Some(place)
    }

    /// Whether its code is at this address.
    pub(super) const fn has_code_at(self, address: u64) -> bool {
        self.place <= address && address < self.data
    }

    /// Lets the thread count time by itself, and read what `ports` bring, at most four.
    pub(super) fn lend(self, tid: Pid, loan: Loan, ports: &[LentPort]) {
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
        let all = core::iter::once((self.data, words.as_flattened())).chain(places);
        let _ = Memory(tid).write_all(all);
    }

    /// How far it has come; `is_lent`: with ports.
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

impl LentRead {
    fn of(word: [u8; 8]) -> Self {
        let word = u64::from_ne_bytes(word);
        let [len, index, ..] = (word & 0x3FF).to_le_bytes();
        Self {
            at: Instant::from_nanos(word >> 10),
            index: usize::from(index),
            len: usize::from(len),
        }
    }
}

impl LentPort {
    /// The port as the code knows it.
    fn image(&self) -> Vec<u8> {
        let bytes = &self.bytes[..self.bytes.len().min(LENT_BYTES)];
        let mut words = vec![
            u64::from(self.fd.cast_unsigned()),
            u64::from(self.waits),
            self.known_until.as_nanos(),
            bytes.len() as u64,
            0,
        ];
        let bytes = bytes.iter();
        words.extend(bytes.map(|&(at, byte)| at.as_nanos() << 8 | u64::from(byte)));
        words.into_iter().flat_map(u64::to_ne_bytes).collect()
    }
}

/// Where in the kernel's page, of `len` bytes, which jumps are to be.
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
    // Without that one there is nothing to gain.
    jumps.len().ge(&2).then_some(jumps)
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// The bytes above are those of the source beside them.
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
        {
            assert!(
                names.contains(&format!("{at:016x} t {name}\n")),
                "{name}: {names}"
            );
        }
        std::fs::remove_dir_all(&folder).expect("ours");
    }

    /// The kernel's page of this very process has the functions that programs look for.
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
}
