//! Numbers as bytes: widths, signs, orders of bytes and words.

use crate::schema::wire::Endian;

/// How a number lies in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number {
    /// Bytes, 1 to 8.
    pub bytes: u8,
    /// What the bits mean.
    pub kind: NumberKind,
    /// Order of bytes within a word.
    pub endian: Endian,
    /// Order of words of two bytes.
    pub words: Endian,
}

/// What the bits of a number mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberKind {
    /// A whole number from 0 on.
    Unsigned,
    /// A whole number with sign, as two's complement.
    Signed,
    /// IEEE 754.
    Float,
}

/// The names of types of numbers, without their order.
pub(crate) const NAMES: [(&str, NumberKind, u8); 12] = [
    ("u8", NumberKind::Unsigned, 1),
    ("u16", NumberKind::Unsigned, 2),
    ("u24", NumberKind::Unsigned, 3),
    ("u32", NumberKind::Unsigned, 4),
    ("u64", NumberKind::Unsigned, 8),
    ("i8", NumberKind::Signed, 1),
    ("i16", NumberKind::Signed, 2),
    ("i24", NumberKind::Signed, 3),
    ("i32", NumberKind::Signed, 4),
    ("i64", NumberKind::Signed, 8),
    ("f32", NumberKind::Float, 4),
    ("f64", NumberKind::Float, 8),
];

/// Orders that are given beside the name of a type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Orders {
    /// Of bytes.
    pub(crate) endian: Option<Endian>,
    /// Of words.
    pub(crate) words: Option<Endian>,
}

impl Number {
    /// The number of the type `name`; `None` if it is none.
    ///
    /// # Errors
    /// If its order is not known.
    pub(crate) fn named(name: &str, orders: Orders) -> Option<Result<Self, String>> {
        let known = |name: &str| NAMES.iter().find(|(known, ..)| *known == name).copied();
        let ordered = |order: &str, endian| {
            let plain = known(name.strip_suffix(order)?)?;
            Some((plain, Some(endian)))
        };
        let (plain, suffix) = known(name)
            .map(|plain| (plain, None))
            .or_else(|| ordered("le", Endian::Little))
            .or_else(|| ordered("be", Endian::Big))?;
        let (_, kind, bytes) = plain;
        let endian = suffix
            .or(orders.endian)
            .or((bytes == 1).then_some(Endian::Big));
        Some(endian.map_or_else(
            || {
                let message = "has no order of bytes, expected e.g.";
                Err(format!(
                    "\"{name}\" {message} \"{name}le\", or the key \"endian\""
                ))
            },
            |endian| {
                let words = orders.words.unwrap_or(endian);
                Ok(Self {
                    bytes,
                    kind,
                    endian,
                    words,
                })
            },
        ))
    }

    /// Least and greatest value of a whole number.
    pub(crate) fn range(self) -> [i128; 2] {
        let values = 1_i128 << (8 * u32::from(self.bytes));
        match self.kind {
            NumberKind::Unsigned => [0, values - 1],
            NumberKind::Signed => [-values / 2, values / 2 - 1],
            NumberKind::Float => [i128::MIN, i128::MAX],
        }
    }

    /// Puts bytes of the wire into the order highest first, or back.
    fn arrange(self, bytes: &mut [u8]) {
        if self.words == Endian::Little && bytes.len().is_multiple_of(2) {
            bytes.reverse();
            bytes.chunks_mut(2).for_each(<[u8]>::reverse);
        } else if self.endian == Endian::Little && !bytes.len().is_multiple_of(2) {
            return bytes.reverse();
        }
        if self.endian == Endian::Little {
            bytes.chunks_mut(2).for_each(<[u8]>::reverse);
        }
    }

    /// The bits in `bytes`, of which there are as many as the number has.
    pub(crate) fn bits(self, bytes: &[u8]) -> u64 {
        let whole = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
        match (self.endian, self.words) {
            (Endian::Big, Endian::Big) => return bytes.iter().fold(0, whole),
            (Endian::Little, Endian::Little) => return bytes.iter().rev().fold(0, whole),
            _ => {}
        }
        let mut ordered = [0; 8];
        let len = usize::from(self.bytes);
        ordered[..len].copy_from_slice(bytes);
        self.arrange(&mut ordered[..len]);
        ordered[..len]
            .iter()
            .fold(0, |bits, &byte| bits << 8 | u64::from(byte))
    }

    /// The bytes of `bits`.
    pub(crate) fn put(self, bits: u64, out: &mut Vec<u8>) {
        let len = usize::from(self.bytes);
        if (self.endian, self.words) == (Endian::Little, Endian::Little) {
            return out.extend_from_slice(&bits.to_le_bytes()[..len]);
        }
        let mut ordered = bits.to_be_bytes();
        let bytes = &mut ordered[8 - len..];
        self.arrange(bytes);
        out.extend_from_slice(bytes);
    }

    /// The whole number of `bits`.
    pub(crate) fn int(self, bits: u64) -> i128 {
        let value = i128::from(bits);
        let [_, greatest] = self.range();
        match self.kind {
            NumberKind::Signed if value > greatest => value - 2 * (greatest + 1),
            _ => value,
        }
    }

    /// The number of `bits`, of IEEE 754.
    pub(crate) fn float(self, bits: u64) -> f64 {
        match self.bytes {
            4 => f64::from(f32::from_bits(u32::try_from(bits).unwrap_or(u32::MAX))),
            _ => f64::from_bits(bits),
        }
    }

    /// The bits of `value`, of IEEE 754.
    pub(crate) fn float_bits(self, value: f64) -> u64 {
        #[expect(clippy::cast_possible_truncation, reason = "the nearest one is meant")]
        match self.bytes {
            4 => (value as f32).to_bits().into(),
            _ => value.to_bits(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The four orders of 0x11223344 that Modbus devices have: ABCD, CDAB, BADC, DCBA.
    #[test]
    fn bytes_and_words_have_their_orders() {
        let orders = [
            (Endian::Big, Endian::Big, [0x11, 0x22, 0x33, 0x44]),
            (Endian::Big, Endian::Little, [0x33, 0x44, 0x11, 0x22]),
            (Endian::Little, Endian::Big, [0x22, 0x11, 0x44, 0x33]),
            (Endian::Little, Endian::Little, [0x44, 0x33, 0x22, 0x11]),
        ];
        for (endian, words, bytes) in orders {
            let orders = Orders {
                endian: Some(endian),
                words: Some(words),
            };
            let number = Number::named("u32", orders)
                .expect("a type")
                .expect("ordered");
            assert_eq!(number.bits(&bytes), 0x1122_3344, "{orders:?}");
            let mut out = Vec::new();
            number.put(0x1122_3344, &mut out);
            assert_eq!(out, bytes, "{orders:?}");
        }
        let of = |name| {
            Number::named(name, Orders::default())
                .expect("a type")
                .expect("ordered")
        };
        assert_eq!(of("u24le").bits(&[1, 2, 3]), 0x0003_0201);
        assert_eq!(of("i24be").int(0xff_ff_fe), -2);
        assert_eq!(of("i8").int(0x80), -128);
        assert_eq!(of("f32le").float(0x3fc0_0000), 1.5);
        assert!(Number::named("u16", Orders::default()).is_some_and(|found| found.is_err()));
        assert_eq!(Number::named("u15", Orders::default()), None);
    }
}
