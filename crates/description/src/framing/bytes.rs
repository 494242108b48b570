//! The bytes of a frame; short frames need no heap.

use core::fmt;
use core::ops::Deref;

/// Maximum number of bytes of a frame that is stored without a heap.
const SHORT_MAX: usize = 40;

/// The bytes of a frame.
#[derive(Clone)]
pub struct FrameBytes(Held);

#[derive(Clone)]
enum Held {
    Short { len: u8, bytes: [u8; SHORT_MAX] },
    Long(Box<[u8]>),
}

impl From<&[u8]> for FrameBytes {
    fn from(all: &[u8]) -> Self {
        match u8::try_from(all.len()) {
            Ok(len) if all.len() <= SHORT_MAX => Self(Held::Short {
                len,
                bytes: short(all),
            }),
            _ => Self(Held::Long(all.into())),
        }
    }
}

/// A copy of at most [`SHORT_MAX`] bytes, padded with zeros. Two blocks that may overlap cost less
/// than a call for any length.
#[inline]
fn short(all: &[u8]) -> [u8; SHORT_MAX] {
    let mut bytes = [0; SHORT_MAX];
    match (all.first_chunk::<16>(), all.last_chunk::<16>()) {
        (Some(first), Some(last)) if all.len() <= 32 => {
            bytes[..16].copy_from_slice(first);
            bytes[all.len() - 16..all.len()].copy_from_slice(last);
        }
        _ => bytes[..all.len()].copy_from_slice(all),
    }
    bytes
}

impl Deref for FrameBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &self.0 {
            Held::Short { len, bytes } => &bytes[..usize::from(*len)],
            Held::Long(bytes) => bytes,
        }
    }
}

impl PartialEq for FrameBytes {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for FrameBytes {}

impl fmt::Debug for FrameBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_kept_whatever_their_number() {
        for len in (0..=SHORT_MAX + 1).chain([300]) {
            let all: Vec<u8> = (0..=255).cycle().take(len).collect();
            assert_eq!(*FrameBytes::from(&all[..]), all[..]);
        }
    }
}
