//! Checksums in the usual place, checked without searching for it.
//!
//! Most checksums cover the bytes from a fixed offset up to themselves and are numbers at a fixed
//! distance from the end. Their places are computed when a description is read; a frame then costs
//! the sum itself and one comparison. Any other checksum takes the general route, and so does a
//! wrong one, which needs the reason in words.

use super::{Check, Cut};
use crate::checksum::Algorithm;

/// A checksum that covers the bytes from `from` up to itself.
#[derive(Clone, Debug)]
pub(crate) struct Plain {
    algorithm: Algorithm,
    from: usize,
    /// Number of bytes from the first byte of the checksum to the end of the frame.
    behind: usize,
    width: usize,
    is_little: bool,
    /// Bits of the checksum.
    kept: u64,
}

impl Plain {
    /// The checksums of a format, if all of them are plain.
    pub(super) fn all(checks: &[Check], cut: &Cut) -> Option<Box<[Self]>> {
        checks.iter().map(|check| Self::of(check, cut)).collect()
    }

    fn of(check: &Check, cut: &Cut) -> Option<Self> {
        let is_plain = check.extra.is_empty()
            && check.before.is_empty()
            && check.separator.is_empty()
            && check.to.is_none()
            && !check.is_hex
            && check.width <= 8
            && check.algorithm.is_short();
        let width = usize::from(check.width);
        let behind = match (usize::try_from(check.at), cut) {
            (Err(_), _) => usize::try_from(-check.at).ok()?,
            (Ok(at), Cut::Fixed(size)) => size.checked_sub(at)?,
            (Ok(_), _) => return None,
        };
        (is_plain && behind >= width).then_some(())?;
        Some(Self {
            algorithm: check.algorithm.clone(),
            from: usize::try_from(check.from).ok()?,
            behind,
            width,
            is_little: check.is_little,
            kept: u64::MAX >> (64 - 8 * u32::from(check.width)),
        })
    }

    /// The correct checksum of `content`, and its offset.
    #[inline]
    fn expected(&self, content: &[u8]) -> Option<(u64, usize)> {
        let at = content.len().checked_sub(self.behind)?;
        let covered = content.get(self.from..at)?;
        Some((self.algorithm.short(covered) & self.kept, at))
    }

    /// Whether the checksum is correct.
    #[inline]
    pub(super) fn holds(&self, content: &[u8]) -> bool {
        let Some((expected, at)) = self.expected(content) else {
            return false;
        };
        let Some(written) = content.get(at..at + self.width) else {
            return false;
        };
        let found = match (written, self.is_little) {
            ([one], _) => u64::from(*one),
            ([one, two], true) => u64::from(u16::from_le_bytes([*one, *two])),
            ([one, two], false) => u64::from(u16::from_be_bytes([*one, *two])),
            (more, true) => more.iter().rev().fold(0, whole),
            (more, false) => more.iter().fold(0, whole),
        };
        found == expected
    }

    /// Writes the checksum.
    pub(super) fn fill(&self, content: &mut [u8]) -> Option<()> {
        let (value, at) = self.expected(content)?;
        let place = content.get_mut(at..at + self.width)?;
        match self.is_little {
            true => place.copy_from_slice(&value.to_le_bytes()[..self.width]),
            false => place.copy_from_slice(&value.to_be_bytes()[8 - self.width..]),
        }
        Some(())
    }
}

fn whole(value: u64, byte: &u8) -> u64 {
    value << 8 | u64::from(*byte)
}
