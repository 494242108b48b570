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
        let mut bytes = [0; SHORT_MAX];
        match (bytes.get_mut(..all.len()), u8::try_from(all.len())) {
            (Some(place), Ok(len)) => {
                place.copy_from_slice(all);
                Self(Held::Short { len, bytes })
            }
            _ => Self(Held::Long(all.into())),
        }
    }
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
        for len in [0, 1, SHORT_MAX, SHORT_MAX + 1, 300] {
            let all: Vec<u8> = (0..=255).cycle().take(len).collect();
            assert_eq!(*FrameBytes::from(&all[..]), all[..]);
        }
    }
}
