//! Clocks that a program reads without a stop: a page of ours in place of the kernel's own.
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

use super::inject::{Hands, NotMade, kernel_page};
use super::memory::Memory;

/// Made of `clock_page.s`, which a test assembles.
#[rustfmt::skip]
const CODE: [u8; 239] = [
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
    0x03, 0x00, 0x00, 0x49, 0x8B, 0x00, 0x49, 0x03, 0x40, 0x10, 0x49, 0x3B, 0x40, 0x08, 0x77, 0x1D,
    0x49, 0xFF, 0x48, 0x20, 0x78, 0x17, 0x49, 0x89, 0x00, 0x49, 0xFF, 0x40, 0x18, 0x48, 0x01, 0xC8,
    0x31, 0xD2, 0x41, 0xB9, 0x00, 0xCA, 0x9A, 0x3B, 0x49, 0xF7, 0xF1, 0xF8, 0xC3, 0xF9, 0xC3,
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
/// Where the data is, from the beginning of the code.
const DATA: u64 = 1024;
/// What is put behind the copy of the kernel's page.
const OURS: u64 = 4096;
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
}

/// Time that a thread may count by itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loan {
    /// Nanoseconds of virtual time, and up to which it may go.
    pub(super) now: u64,
    pub(super) limit: u64,
    /// What a look costs.
    pub(super) cost: u64,
    /// Most looks.
    pub(super) looks: u64,
}

/// What a thread has made of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Taken {
    pub(super) now: u64,
    pub(super) looks: u64,
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
        let data = place + len + DATA;
        Ok(Self { place, data })
    }

    /// Whether its code is at this address.
    pub(super) const fn has_code_at(self, address: u64) -> bool {
        self.place <= address && address < self.data
    }

    /// Lets the thread count time by itself.
    pub(super) fn lend(self, tid: Pid, loan: Loan) {
        let words = [loan.now, loan.limit, loan.cost, 0, loan.looks];
        let _ = Memory(tid).write(self.data, words.map(u64::to_ne_bytes).as_flattened());
    }

    /// How far it has come.
    pub(super) fn take(self, tid: Pid) -> Option<Taken> {
        let mut words = [[0; 8]; 4];
        Memory(tid).read(self.data, words.as_flattened_mut()).ok()?;
        let [now, _, _, looks] = words.map(u64::from_ne_bytes);
        Some(Taken { now, looks })
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
