//! Memory that the processor watches: its debug registers.

use core::mem::offset_of;
use core::ptr;

use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;

/// Number of debug registers with addresses.
pub(super) const WATCHES: usize = 4;
/// Numbers of the debug registers for the hit watchpoint, and for the enabled ones.
const STATUS: usize = 6;
const CONTROL: usize = 7;
/// Memory that is watched by the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::guest) struct Watchpoint {
    pub(in crate::guest) address: u64,
    /// Length, 1, 2, 4 or 8; the address is a multiple of it.
    pub(in crate::guest) len: u64,
    /// Whether reads also cause a stop.
    pub(in crate::guest) reads: bool,
}

impl Watchpoint {
    /// Its bits in the control register, for the debug register `index` (Intel's manual, volume 3,
    /// 17.2.4).
    const fn control(self, index: usize) -> u64 {
        let kind: u64 = if self.reads { 0b11 } else { 0b01 };
        let len: u64 = match self.len {
            1 => 0b00,
            2 => 0b01,
            4 => 0b11,
            _ => 0b10,
        };
        (1 << (2 * index)) | ((kind | (len << 2)) << (16 + 4 * index))
    }
}

/// Position of a debug register in the kernel's data of a thread.
fn debug_register(index: usize) -> *mut libc::c_void {
    ptr::without_provenance_mut(offset_of!(libc::user, u_debugreg) + 8 * index)
}

pub(super) fn write_watches(pid: Pid, watches: &[Watchpoint]) -> nix::Result<()> {
    // An address must not change while its watchpoint is enabled.
    ptrace::write_user(pid, debug_register(CONTROL), 0)?;
    ptrace::write_user(pid, debug_register(STATUS), 0)?;
    let mut control = 0;
    for (index, watch) in watches.iter().enumerate() {
        ptrace::write_user(pid, debug_register(index), watch.address.cast_signed())?;
        control |= watch.control(index);
    }
    match control {
        0 => Ok(()),
        control => ptrace::write_user(pid, debug_register(CONTROL), control.cast_signed()),
    }
}

/// Index of the watchpoint that a thread has hit, among `count`.
pub(super) fn hit_watch(pid: Pid, count: usize) -> Option<usize> {
    if count == 0 {
        return None;
    }
    let status = ptrace::read_user(pid, debug_register(STATUS)).ok()?;
    let hit = (0..count).find(|index| status & (1 << index) != 0)?;
    let _ = ptrace::write_user(pid, debug_register(STATUS), 0);
    Some(hit)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Intel's manual, volume 3, 17.2.4: L0 is bit 0, R/W0 bits 16 and 17, LEN0 bits 18 and 19.
    #[test]
    fn watchpoints_are_bits_of_the_control_register() {
        let watch = |len, reads| Watchpoint {
            address: 0,
            len,
            reads,
        };
        assert_eq!(watch(4, false).control(0), 0b1101 << 16 | 0b1);
        assert_eq!(watch(8, true).control(1), 0b1011 << 20 | 0b100);
        assert_eq!(watch(1, false).control(3), 0b0001 << 28 | 0b100_0000);
        assert_eq!(watch(2, true).control(2), 0b0111 << 24 | 0b1_0000);
    }
}
