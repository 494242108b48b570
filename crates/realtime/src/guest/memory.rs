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
