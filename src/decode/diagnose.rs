//! Damage that a whole stream shows: a host's terminal in text mode, a line of seven bits.

/// What a host did to every byte of a kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// A byte value that such a stream must have never occurs.
    Missing {
        /// Which value.
        value: u8,
        /// How often it occurs in a sound stream of this length, were all values equally frequent.
        expected: u64,
    },
    /// No byte has its highest bit set.
    SevenBits,
}

impl core::fmt::Display for Damage {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Missing { value, expected } => {
                let name = match value {
                    0x00 => "NUL bytes are missing: the host strips 0x00",
                    0x0D => "carriage returns are missing: the host turns CR into LF",
                    0x11 => "XON bytes are missing: the host does software flow control",
                    _ => "XOFF bytes are missing: the host does software flow control",
                };
                write!(
                    f,
                    "{name} (0 times 0x{value:02X}, some {expected} by chance)"
                )
            }
            Self::SevenBits => f.write_str("no byte has bit 7: the line carries seven bits"),
        }
    }
}

/// Values that terminals in text mode take out.
const SPECIAL: [u8; 4] = [0x00, 0x0D, 0x11, 0x13];
/// Fewest expected occurrences of a value whose absence says something: chance leaves out a value
/// that is this frequent once in 4e8 streams.
const EXPECTED_MIN: u64 = 20;

/// What is wrong with all of `bytes`, of which `framed` are in sound frames. A stream that is
/// nearly all frames is not accused, whatever it contains.
pub fn diagnose(bytes: &[u8], framed: u64) -> Vec<Damage> {
    let len = bytes.len() as u64;
    let expected = len / 256;
    if framed * 10 >= len * 9 || expected < EXPECTED_MIN {
        return Vec::new();
    }
    let mut counts = [0_u64; 256];
    bytes
        .iter()
        .for_each(|&byte| counts[usize::from(byte)] += 1);
    if counts[0x80..].iter().all(|&count| count == 0) {
        return vec![Damage::SevenBits];
    }
    let missing = SPECIAL
        .into_iter()
        .filter(|&value| counts[usize::from(value)] == 0);
    missing
        .map(|value| Damage::Missing { value, expected })
        .collect()
}
