//! Damage to bytes on a bad line, as values that a test can print and minimise.

use proptest::prelude::*;
use proptest::sample::Index;

/// Damage to one byte.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Damage {
    /// A bit arrives wrong.
    Flip { at: Index, bit: u8 },
    /// A byte never arrives.
    Drop { at: Index },
    /// A byte arrives that was never sent.
    Insert { at: Index, byte: u8 },
}

impl Damage {
    /// Applies the damage to `bytes`, unless they are empty.
    pub(crate) fn apply(self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        match self {
            Self::Flip { at, bit } => *at.get_mut(bytes) ^= 1 << bit,
            Self::Drop { at } => drop(bytes.remove(at.index(bytes.len()))),
            Self::Insert { at, byte } => bytes.insert(at.index(bytes.len() + 1), byte),
        }
    }
}

/// Any single damage; inserted bytes are often among `telling`, to which the format reacts.
pub(crate) fn damage(telling: &'static [u8]) -> impl Strategy<Value = Damage> {
    let byte = prop_oneof![any::<u8>(), proptest::sample::select(telling)];
    prop_oneof![
        (any::<Index>(), 0_u8..8).prop_map(|(at, bit)| Damage::Flip { at, bit }),
        any::<Index>().prop_map(|at| Damage::Drop { at }),
        (any::<Index>(), byte).prop_map(|(at, byte)| Damage::Insert { at, byte }),
    ]
}
