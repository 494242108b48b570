//! Errors in the content of a valid frame.

/// Error in the content of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MessageError {
    /// No message has this id.
    Id([u8; 3]),
    /// The length of the payload differs from that of the message.
    Length {
        /// Bytes that the message has (for a row: at least).
        expected: usize,
        /// Received bytes.
        found: usize,
    },
    /// A mode that does not exist.
    Mode(u8),
}

impl core::fmt::Display for MessageError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Id(id) => write!(f, "no message is called \"{}\"", id.escape_ascii()),
            Self::Length { expected, found } => {
                write!(f, "payload has {found} bytes, expected {expected}")
            }
            Self::Mode(number) => write!(f, "mode is {number}, expected 0 to 4"),
        }
    }
}

impl core::error::Error for MessageError {}
