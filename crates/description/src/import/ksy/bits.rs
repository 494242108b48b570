//! Fields of bits.

use super::Level;
use super::field::{Len, Made};

/// Bits of a byte that is not complete.
#[derive(Default)]
pub(super) struct Bits {
    count: usize,
    is_low_first: bool,
    pads: usize,
}

impl Bits {
    /// Adds the bits that are missing at the end of a byte.
    pub(super) fn pad(&mut self, out: &mut Vec<Made>) {
        let missing = self.count.next_multiple_of(8) - self.count;
        if missing > 0 {
            self.pads += 1;
            let order = if self.is_low_first { "le" } else { "" };
            let keys = vec![format!("type = \"b{missing}{order}\"")];
            let len = Len::Fixed(self.count.div_ceil(8));
            let name = format!("unused_bits_{}", self.pads);
            out.push(Made::new(&name, keys, len).named());
        }
        self.count = 0;
    }

    /// Adds a bit field; its bytes count at the field that completes them.
    pub(super) fn add(&mut self, count: usize, is_low_first: bool) -> Len {
        self.count += count;
        self.is_low_first = is_low_first;
        let is_whole = self.count.is_multiple_of(8);
        let bytes = if is_whole { self.count / 8 } else { 0 };
        if is_whole {
            self.count = 0;
        }
        Len::Fixed(bytes)
    }
}

/// Number of bits and their order, if `kind` is a type of bits.
pub(super) fn bits_of(kind: &str, level: &Level<'_>) -> Option<(usize, bool)> {
    let digits = kind.strip_prefix('b')?;
    let (digits, is_low_first) = match (digits.strip_suffix("le"), digits.strip_suffix("be")) {
        (Some(digits), _) => (digits, true),
        (_, Some(digits)) => (digits, false),
        _ => (digits, level.orders.is_low_first),
    };
    let count = digits
        .parse()
        .ok()
        .filter(|count| (1..=64).contains(count))?;
    Some((count, is_low_first))
}
