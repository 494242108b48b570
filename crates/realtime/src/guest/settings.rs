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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::tests::Room;

    const SETS: [u64; 9] = [
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

    /// ioctl_tty(2): the requests with W wait for the output, those with F discard the input as
    /// well.
    #[test]
    fn requests_wait_and_discard_by_their_names() {
        let waits: Vec<bool> = SETS.map(waits_until_sent).to_vec();
        let three = |it: [bool; 3]| it.map(|it| [it; 3]).concat();
        assert_eq!(waits, three([false, true, true]));
        assert_eq!(SETS.map(flushes).to_vec(), three([false, false, true]));
        for request in SETS
            .into_iter()
            .chain([libc::TCGETS, TCGETS2, libc::TCGETA])
        {
            assert!(is_settings(request), "{request:x}");
            assert!(SETTINGS.contains(&request), "{request:x}");
        }
        for request in [libc::TCSBRK, libc::FIONREAD, libc::TCFLSH] {
            assert!(!is_settings(request) && !waits_until_sent(request) && !flushes(request));
        }
        for request in [libc::TCGETS, TCGETS2, libc::TCGETA] {
            assert!(!waits_until_sent(request) && !flushes(request));
        }
    }

    fn some() -> Settings {
        let bytes: Vec<u8> = (1..45).collect();
        Settings::default().with(&bytes)
    }

    /// 36 bytes of `termios`, 44 of `termios2`, 18 of `termio`.
    #[test]
    fn settings_are_read_back_in_the_form_that_is_asked_for() {
        let len = |request| read_back(&some(), request).map(|bytes| bytes.len());
        assert_eq!(len(libc::TCGETS), Some(36));
        assert_eq!(len(TCGETS2), Some(44));
        assert_eq!(len(libc::TCGETA), Some(18));
        assert!(SETS.iter().all(|&request| len(request).is_none()));
        let bytes: Vec<u8> = (1..45).collect();
        assert_eq!(read_back(&some(), TCGETS2), Some(bytes.clone()));
        assert_eq!(read_back(&some(), libc::TCGETS), Some(bytes[..36].to_vec()));
    }

    /// B9600 is 13; with BOTHER, 0o10000, the rates are written out at the end of `termios2`. The
    /// old `termio` has the lower halves of the modes.
    #[test]
    fn settings_are_read_in_the_form_of_the_request() {
        let memory = Memory(crate::guest::tests::own());
        let mut words = [0_u32; 11];
        [words[0], words[1], words[2], words[3]] = [0o400, 0o5, 0o10_060, 0o12];
        [words[9], words[10]] = [250_000, 250_000];
        let room = Room::of(&words.map(u32::to_ne_bytes).concat());
        let modes = |it: Settings| [it.input, it.output, it.control, it.local];
        for request in [TCSETS2, TCSETSW2, TCSETSF2] {
            let it = wanted(memory, &some(), request, room.at(0)).expect("own");
            assert_eq!(
                (modes(it), it.speeds),
                ([0o400, 0o5, 0o10_060, 0o12], [250_000; 2])
            );
        }
        room.put(8, &0o15_u32.to_ne_bytes());
        for request in [libc::TCSETS, libc::TCSETSW, libc::TCSETSF] {
            let it = wanted(memory, &some(), request, room.at(0)).expect("own");
            assert_eq!(
                (modes(it), it.speeds),
                ([0o400, 0o5, 0o15, 0o12], [9600; 2])
            );
        }
        let old = [0o400_u16, 0o5, 0o15, 0o12].map(u16::to_ne_bytes).concat();
        room.put(0, &[old, vec![0; 10]].concat());
        for request in [libc::TCSETA, libc::TCSETAW, libc::TCSETAF] {
            let it = wanted(memory, &Settings::default(), request, room.at(0)).expect("own");
            assert_eq!(
                (modes(it), it.speeds),
                ([0o400, 0o5, 0o15, 0o12], [9600; 2])
            );
        }
        let fault = wanted(memory, &some(), libc::TCSETS, 8);
        assert_eq!(fault.map(modes), Err(Errno::EFAULT));
    }

    /// `flags` is the fifth word of `serial_struct` (linux/serial.h), which has 72 bytes.
    #[test]
    fn of_a_drivers_chip_the_flags_are_kept() {
        let memory = Memory(crate::guest::tests::own());
        let room = Room::of(&(0..80).collect::<Vec<u8>>());
        let mut flags = 0;
        assert_eq!(serial(memory, true, room.at(0), &mut flags), Ok(()));
        assert_eq!(flags, u32::from_ne_bytes([16, 17, 18, 19]));
        flags = 0x2000;
        assert_eq!(serial(memory, false, room.at(0), &mut flags), Ok(()));
        let mut expected = vec![0; 72];
        expected[16..20].copy_from_slice(&0x2000_u32.to_ne_bytes());
        assert_eq!(room.bytes()[..72], expected);
        assert_eq!(room.bytes()[72..], (72..80).collect::<Vec<u8>>());
        assert_eq!(serial(memory, true, 8, &mut flags), Err(Errno::EFAULT));
    }

    #[test]
    fn errors_of_both_libraries_are_the_same() {
        assert_eq!(errno_of(rustix::io::Errno::PERM), Errno::EPERM);
        assert_eq!(errno_of(rustix::io::Errno::IO), Errno::EIO);
    }
}
