//! Damage to single bytes.

use core::fmt;
use core::time::Duration;

/// Damage to a byte, or to some bytes from it on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Damage {
    /// One bit is inverted; 0 is the least significant, larger numbers wrap at 8.
    Flip {
        /// Number of the bit.
        bit: u8,
    },
    /// The byte never arrives.
    Drop,
    /// Another byte arrives before it.
    Insert {
        /// The other byte.
        value: u8,
    },
    /// The byte arrives twice.
    Duplicate,
    /// This byte and the following ones are garbled.
    Burst {
        /// Number of bytes, including this one.
        len: u16,
        /// The inverted bits in each byte.
        mask: u8,
    },
    /// This byte and the rest of its frame never arrive: all bytes up to the next pause of two
    /// characters.
    Truncate {
        /// Maximum number of lost bytes.
        len: u16,
    },
    /// The byte arrives after the next one.
    Swap,
    /// The byte's parity is wrong: the receiver reports an error and gets no byte.
    ParityError,
    /// The sender pauses before the byte.
    Idle {
        /// Duration of the pause.
        by: Duration,
    },
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flip { bit } => write!(f, "flip bit {bit}"),
            Self::Drop => f.write_str("drop"),
            Self::Insert { value } => write!(f, "insert {value:#04x}"),
            Self::Duplicate => f.write_str("duplicate"),
            Self::Burst { len, mask } => write!(f, "burst of {len} with {mask:#04x}"),
            Self::Truncate { len } => write!(f, "truncate at most {len}"),
            Self::Swap => f.write_str("swap"),
            Self::ParityError => f.write_str("parity error"),
            Self::Idle { by } => write!(f, "idle {by:?}"),
        }
    }
}

/// The kinds of [`Damage`], without their random values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DamageKind {
    /// See [`Damage::Flip`].
    Flip,
    /// See [`Damage::Drop`].
    Drop,
    /// See [`Damage::Insert`].
    Insert,
    /// See [`Damage::Duplicate`].
    Duplicate,
    /// See [`Damage::Burst`].
    Burst {
        /// Number of bytes.
        len: u16,
    },
    /// See [`Damage::Truncate`].
    Truncate {
        /// Maximum number of bytes.
        len: u16,
    },
    /// See [`Damage::Swap`].
    Swap,
    /// See [`Damage::ParityError`].
    ParityError,
    /// See [`Damage::Idle`].
    Idle {
        /// Duration of the pause.
        by: Duration,
    },
}

impl DamageKind {
    /// All kinds, with a value if one is needed.
    pub const ALL: [Self; 9] = [
        Self::Flip,
        Self::Drop,
        Self::Insert,
        Self::Duplicate,
        Self::Burst { len: 4 },
        Self::Truncate { len: 64 },
        Self::Swap,
        Self::ParityError,
        Self::Idle {
            by: Duration::from_millis(1),
        },
    ];

    /// The damage of this kind with the random number `detail`.
    pub(super) fn with_detail(self, detail: u8) -> Damage {
        match self {
            Self::Flip => Damage::Flip { bit: detail % 8 },
            Self::Drop => Damage::Drop,
            Self::Insert => Damage::Insert { value: detail },
            Self::Duplicate => Damage::Duplicate,
            // A mask of 0 would be no damage.
            Self::Burst { len } => Damage::Burst {
                len,
                mask: detail.max(1),
            },
            Self::Truncate { len } => Damage::Truncate { len },
            Self::Swap => Damage::Swap,
            Self::ParityError => Damage::ParityError,
            Self::Idle { by } => Damage::Idle { by },
        }
    }
}

/// A byte that was damaged, or will be damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Strike {
    /// Number of the byte on its line, counted from zero as sent.
    pub byte: u64,
    /// Kind of the damage.
    pub damage: Damage,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Any random number from 0 to 255 gives a valid bit, byte or mask, never one without an
    /// effect.
    #[test]
    fn what_is_drawn_completes_a_damage() {
        let with = |kind: DamageKind, detail| kind.with_detail(detail).to_string();
        assert_eq!(
            [with(DamageKind::Flip, 7), with(DamageKind::Flip, 13)],
            ["flip bit 7", "flip bit 5"]
        );
        assert_eq!(with(DamageKind::Insert, 10), "insert 0x0a");
        let burst = DamageKind::Burst { len: 3 };
        assert_eq!(
            [with(burst, 0), with(burst, 255)],
            ["burst of 3 with 0x01", "burst of 3 with 0xff"]
        );
        let words = DamageKind::ALL.map(|kind| with(kind, 2));
        let expected = [
            "flip bit 2",
            "drop",
            "insert 0x02",
            "duplicate",
            "burst of 4 with 0x02",
            "truncate at most 64",
            "swap",
            "parity error",
            "idle 1ms",
        ];
        assert_eq!(words, expected);
    }
}
