//! Requests for the settings of a terminal: `termios`, `termios2` and the old `termio` structure.

use nix::errno::Errno;
use nix::libc;

use super::memory::Memory;
use crate::transport::Settings;

/// Requests with baud rates as numbers, which `libc` does not have for this system.
pub(super) const TCGETS2: u64 = 0x802C_542A;
pub(super) const TCSETS2: u64 = 0x402C_542B;
pub(super) const TCSETSW2: u64 = 0x402C_542C;
pub(super) const TCSETSF2: u64 = 0x402C_542D;

/// All requests for settings.
pub(super) const SETTINGS: [u64; 12] = [
    libc::TCGETS,
    TCGETS2,
    libc::TCGETA,
    libc::TCSETS,
    TCSETS2,
    libc::TCSETA,
    libc::TCSETSW,
    TCSETSW2,
    libc::TCSETAW,
    libc::TCSETSF,
    TCSETSF2,
    libc::TCSETAF,
];

/// Whether a request is about settings.
pub(super) const fn is_settings(request: u64) -> bool {
    matches!(request, libc::TCGETS | TCGETS2 | libc::TCGETA)
        || waits_until_sent(request)
        || matches!(request, libc::TCSETS | TCSETS2 | libc::TCSETA)
}

/// Whether the request takes effect after all written bytes have left.
pub(super) const fn waits_until_sent(request: u64) -> bool {
    matches!(request, libc::TCSETSW | TCSETSW2 | libc::TCSETAW) || flushes(request)
}

/// Whether the request discards unread bytes.
pub(super) const fn flushes(request: u64) -> bool {
    matches!(request, libc::TCSETSF | TCSETSF2 | libc::TCSETAF)
}

/// The bytes of `settings` for a request that reads them; `None` for a request that sets them.
pub(super) fn read_back(settings: &Settings, request: u64) -> Option<Vec<u8>> {
    match request {
        libc::TCGETS => Some(settings.bytes()[..Settings::LEN].to_vec()),
        TCGETS2 => Some(settings.bytes().to_vec()),
        libc::TCGETA => Some(settings.bytes_old().to_vec()),
        _ => None,
    }
}

/// The settings after a request that changes `before`.
pub(super) fn wanted(
    memory: Memory,
    before: &Settings,
    request: u64,
    address: u64,
) -> Result<Settings, Errno> {
    if matches!(request, libc::TCSETA | libc::TCSETAW | libc::TCSETAF) {
        let mut bytes = [0; Settings::LEN_OLD];
        memory.read(address, &mut bytes)?;
        return Ok(before.with_old(&bytes).with_named_speeds());
    }
    let mut bytes = [0; Settings::LEN_WITH_SPEEDS];
    let len = match request {
        TCSETS2 | TCSETSW2 | TCSETSF2 => Settings::LEN_WITH_SPEEDS,
        _ => Settings::LEN,
    };
    memory.read(address, &mut bytes[..len])?;
    Ok(before.with(&bytes[..len]).with_named_speeds())
}

/// The same error, in the type of the other library.
pub(super) fn errno_of(errno: rustix::io::Errno) -> Errno {
    Errno::from_raw(errno.raw_os_error())
}

/// Length of the driver's description of its chip (TIOCGSERIAL), and the offset of its flags.
const SERIAL_LEN: usize = 72;
const FLAGS_AT: usize = 16;

/// Reads or sets the driver's description of its chip. Only the `flags` are kept; programs set them
/// for low latency.
pub(super) fn serial(
    memory: Memory,
    is_set: bool,
    address: u64,
    flags: &mut u32,
) -> Result<(), Errno> {
    let mut serial = [0; SERIAL_LEN];
    let place = FLAGS_AT..FLAGS_AT + 4;
    if is_set {
        memory.read(address, &mut serial)?;
        let bytes = [0, 1, 2, 3].map(|index| serial[FLAGS_AT + index]);
        *flags = u32::from_ne_bytes(bytes);
        return Ok(());
    }
    serial[place].copy_from_slice(&flags.to_ne_bytes());
    memory.write(address, &serial)
}
