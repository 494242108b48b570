//! The memory of a stopped thread's process, read and written by the system's own calls for that.

use std::io::{IoSlice, IoSliceMut};

use nix::errno::Errno;
use nix::sys::uio::{RemoteIoVec, process_vm_readv, process_vm_writev};
use nix::unistd::Pid;

/// Maximum length of a text.
const TEXT_MAX: usize = 4096;
/// Page sizes are multiples of this.
const STEP: u64 = 256;

/// The memory of a thread.
#[derive(Clone, Copy, Debug)]
pub(super) struct Memory(pub(super) Pid);

impl Memory {
    /// Fills `buf` from `address` on.
    pub(super) fn read(self, address: u64, buf: &mut [u8]) -> Result<(), Errno> {
        if buf.is_empty() {
            return Ok(());
        }
        let (base, len) = place(address, buf.len())?;
        let remote = [RemoteIoVec { base, len }];
        let count = process_vm_readv(self.0, &mut [IoSliceMut::new(buf)], &remote)?;
        if count == len {
            Ok(())
        } else {
            Err(Errno::EFAULT)
        }
    }

    /// Writes `bytes` from `address` on.
    pub(super) fn write(self, address: u64, bytes: &[u8]) -> Result<(), Errno> {
        if bytes.is_empty() {
            return Ok(());
        }
        let (base, len) = place(address, bytes.len())?;
        let remote = [RemoteIoVec { base, len }];
        let count = process_vm_writev(self.0, &[IoSlice::new(bytes)], &remote)?;
        if count == len {
            Ok(())
        } else {
            Err(Errno::EFAULT)
        }
    }

    /// Fills several buffers in one call; a buffer with address 0 stays as it is.
    pub(super) fn read_all<'a>(
        self,
        places: impl Iterator<Item = (u64, &'a mut [u8])>,
    ) -> Result<(), Errno> {
        let (mut own, mut remote) = (Vec::new(), Vec::new());
        for (address, buf) in places.filter(|(address, buf)| *address != 0 && !buf.is_empty()) {
            let (base, len) = place(address, buf.len())?;
            remote.push(RemoteIoVec { base, len });
            own.push(IoSliceMut::new(buf));
        }
        if remote.is_empty() {
            return Ok(());
        }
        let wanted: usize = remote.iter().map(|one| one.len).sum();
        match process_vm_readv(self.0, &mut own, &remote)? == wanted {
            true => Ok(()),
            false => Err(Errno::EFAULT),
        }
    }

    /// Writes several pieces in one call; a piece with address 0 is not written.
    pub(super) fn write_all<'a>(
        self,
        places: impl Iterator<Item = (u64, &'a [u8])>,
    ) -> Result<(), Errno> {
        let (mut own, mut remote) = (Vec::new(), Vec::new());
        for (address, bytes) in places.filter(|(address, bytes)| *address != 0 && !bytes.is_empty())
        {
            let (base, len) = place(address, bytes.len())?;
            remote.push(RemoteIoVec { base, len });
            own.push(IoSlice::new(bytes));
        }
        if remote.is_empty() {
            return Ok(());
        }
        let wanted: usize = remote.iter().map(|one| one.len).sum();
        match process_vm_writev(self.0, &own, &remote)? == wanted {
            true => Ok(()),
            false => Err(Errno::EFAULT),
        }
    }

    pub(super) fn u32(self, address: u64) -> Result<u32, Errno> {
        let mut buf = [0; 4];
        self.read(address, &mut buf)?;
        Ok(u32::from_ne_bytes(buf))
    }

    pub(super) fn u64(self, address: u64) -> Result<u64, Errno> {
        let mut buf = [0; 8];
        self.read(address, &mut buf)?;
        Ok(u64::from_ne_bytes(buf))
    }

    /// Two consecutive numbers, as in a `timespec`.
    pub(super) fn pair(self, address: u64) -> Result<[i64; 2], Errno> {
        let mut pair = [[0; 8]; 2];
        self.read(address, pair.as_flattened_mut())?;
        Ok(pair.map(i64::from_ne_bytes))
    }

    pub(super) fn write_pair(self, address: u64, pair: [i64; 2]) -> Result<(), Errno> {
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&pair[0].to_ne_bytes());
        bytes[8..].copy_from_slice(&pair[1].to_ne_bytes());
        self.write(address, &bytes)
    }

    /// The text at `address` up to its NUL; unreadable parts are left out.
    pub(super) fn text(self, address: u64) -> String {
        let mut text = Vec::new();
        let mut at = address;
        while text.len() < TEXT_MAX {
            // Up to the end of a block, so that the read touches no page after the page of the NUL.
            let len = STEP - at % STEP;
            let mut buf = vec![0; usize::try_from(len).unwrap_or_default()];
            if self.read(at, &mut buf).is_err() {
                break;
            }
            let end = buf.iter().position(|&byte| byte == 0);
            text.extend_from_slice(&buf[..end.unwrap_or(buf.len())]);
            if end.is_some() {
                break;
            }
            at += len;
        }
        String::from_utf8_lossy(&text).into_owned()
    }

    /// The buffers in an array of `count` `iovec`s: address and length.
    pub(super) fn iovecs(self, address: u64, count: u64) -> Result<Vec<(u64, usize)>, Errno> {
        if count > 1024 {
            return Err(Errno::EINVAL);
        }
        let mut words = vec![[0; 8]; 2 * usize::try_from(count).unwrap_or_default()];
        self.read(address, words.as_flattened_mut())?;
        let words: Vec<u64> = words.into_iter().map(u64::from_ne_bytes).collect();
        let buffers = words.chunks_exact(2).map(|pair| {
            let len = usize::try_from(pair[1]).map_err(|_| Errno::EINVAL)?;
            Ok((pair[0], len))
        });
        buffers.collect()
    }
}

fn place(address: u64, len: usize) -> Result<(usize, usize), Errno> {
    let base = usize::try_from(address).map_err(|_| Errno::EFAULT)?;
    Ok((base, len))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::tests::Room;

    fn own() -> Memory {
        Memory(crate::guest::tests::own())
    }

    #[test]
    fn numbers_are_read_and_written() {
        let room = Room::of_words(&[0x1_0000_0002, u64::MAX, 5]);
        assert_eq!(own().u32(room.at(0)), Ok(2));
        assert_eq!(own().u32(room.at(4)), Ok(1));
        assert_eq!(own().u64(room.at(0)), Ok(0x1_0000_0002));
        assert_eq!(own().pair(room.at(8)), Ok([-1, 5]));
        own().write_pair(room.at(8), [7, -2]).expect("own");
        assert_eq!(room.words(), [0x1_0000_0002, 7, u64::MAX - 1]);
        assert_eq!(own().u64(8), Err(Errno::EFAULT));
        assert_eq!(own().write(8, &[1]), Err(Errno::EFAULT));
    }

    #[test]
    fn nothing_is_read_or_written_without_a_fault() {
        assert_eq!(own().read(8, &mut []), Ok(()));
        assert_eq!(own().write(8, &[]), Ok(()));
        assert_eq!(own().read_all([(8, &mut [][..])].into_iter()), Ok(()));
        assert_eq!(own().write_all([(8, &[][..])].into_iter()), Ok(()));
    }

    /// A piece with the address 0 is left out, as NULL in the calls that take several.
    #[test]
    fn several_pieces_are_read_and_written_in_one_call() {
        let room = Room::of(b"abcdefgh");
        let [mut one, mut none, mut other] = [[0; 2], [9; 2], [0; 2]];
        let places = [
            (room.at(0), &mut one[..]),
            (0, &mut none[..]),
            (room.at(6), &mut other[..]),
        ];
        assert_eq!(own().read_all(places.into_iter()), Ok(()));
        assert_eq!((&one, &none, &other), (b"ab", &[9; 2], b"gh"));
        let places = [(room.at(1), &b"XY"[..]), (0, b"--"), (room.at(5), b"Z")];
        assert_eq!(own().write_all(places.into_iter()), Ok(()));
        assert_eq!(room.bytes(), b"aXYdeZgh");
        assert_eq!(
            own().write_all([(8, &b"Z"[..])].into_iter()),
            Err(Errno::EFAULT)
        );
        assert_eq!(
            own().read_all([(8, &mut one[..])].into_iter()),
            Err(Errno::EFAULT)
        );
    }

    /// The address at which the stack of this process ends: nothing is behind it.
    fn end_of_stack() -> u64 {
        let maps = std::fs::read_to_string("/proc/self/maps").expect("Linux");
        let line = maps
            .lines()
            .find(|line| line.ends_with("[stack]"))
            .expect("each has one");
        let (_, rest) = line.split_once('-').expect("two addresses");
        let (end, _) = rest.split_once(' ').expect("rights");
        u64::from_str_radix(end, 16).expect("an address")
    }

    /// The last eight bytes of a stack are zeros.
    #[test]
    fn memory_that_is_there_in_part_is_a_fault() {
        let at = end_of_stack() - 8;
        let mut buf = [1; 16];
        assert_eq!(own().read(at, &mut buf[..8]), Ok(()));
        assert_eq!(own().read(at, &mut buf), Err(Errno::EFAULT));
        assert_eq!(own().write(at, &[0; 8]), Ok(()));
        assert_eq!(own().write(at, &[0; 16]), Err(Errno::EFAULT));
        assert_eq!(
            own().read_all([(at, &mut buf[..])].into_iter()),
            Err(Errno::EFAULT)
        );
        assert_eq!(
            own().write_all([(at, &[0; 16][..])].into_iter()),
            Err(Errno::EFAULT)
        );
    }

    /// Wherever it begins in a block of 256 bytes, and however long it is, up to 4,096 bytes.
    #[test]
    fn a_text_ends_at_its_nul() {
        let mut bytes = vec![b'a'; 8192];
        bytes[700] = 0;
        let room = Room::of(&bytes);
        for from in [0, 1, 188, 255, 256, 300, 699] {
            assert_eq!(own().text(room.at(from)), "a".repeat(700 - from), "{from}");
        }
        assert_eq!(own().text(room.at(700)), "");
        assert_eq!(own().text(8), "");
        let endless = own().text(room.at(701));
        assert!(
            (4096..4096 + 256).contains(&endless.len()),
            "{}",
            endless.len()
        );
    }

    /// readv(2): an array of addresses and lengths, 1,024 at most.
    #[test]
    fn buffers_are_addresses_and_lengths() {
        let room = Room::new(16 * 1024);
        room.put(0, &[5_u64, 6, 7, 8].map(u64::to_ne_bytes).concat());
        assert_eq!(own().iovecs(room.at(0), 2), Ok(vec![(5, 6), (7, 8)]));
        assert_eq!(own().iovecs(room.at(0), 0), Ok(vec![]));
        assert_eq!(
            own().iovecs(room.at(0), 1024).map(|all| all.len()),
            Ok(1024)
        );
        assert_eq!(own().iovecs(room.at(0), 1025), Err(Errno::EINVAL));
    }
}
