//! Numbers as bytes: widths, signs, byte orders and word orders.

use crate::schema::wire::Endian;

/// The layout of a number in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number {
    /// Bytes, 1 to 8.
    pub bytes: u8,
    /// The interpretation of the bits.
    pub kind: NumberKind,
    /// Order of bytes within a word.
    pub endian: Endian,
    /// Order of words of two bytes.
    pub words: Endian,
}

/// The interpretation of a number's bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberKind {
    /// An unsigned integer.
    Unsigned,
    /// A signed integer in two's complement.
    Signed,
    /// IEEE 754.
    Float,
}

/// The names of number types, without byte order.
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

/// Orders that are given beside the type name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Orders {
    /// Byte order.
    pub(crate) endian: Option<Endian>,
    /// Word order.
    pub(crate) words: Option<Endian>,
}

impl Number {
    /// The number type `name`; `None` if the name is not a number type.
    ///
    /// # Errors
    /// If the byte order in the name is unknown.
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

    /// Least and greatest value of an integer type.
    pub(crate) fn range(self) -> [i128; 2] {
        let values = 1_i128 << (8 * u32::from(self.bytes));
        match self.kind {
            NumberKind::Unsigned => [0, values - 1],
            NumberKind::Signed => [-values / 2, values / 2 - 1],
            NumberKind::Float => [i128::MIN, i128::MAX],
        }
    }

    /// The bits of an integer that this integer type can hold.
    pub(crate) fn exact_bits(self, int: i128) -> Option<u64> {
        let int = i64::try_from(int).ok()?;
        let len = 8 * u32::from(self.bytes);
        let rest = match self.kind {
            NumberKind::Unsigned if len < 64 => int >> len,
            NumberKind::Unsigned => int >> 63,
            // The sign bit and all bits above it are equal.
            NumberKind::Signed => (int >> (len - 1)) ^ (int >> 63),
            NumberKind::Float => return None,
        };
        (rest == 0).then(|| int.cast_unsigned() & (u64::MAX >> (64 - len)))
    }

    /// Converts between the wire order and highest byte first.
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

    /// The bits in `bytes`, which has the length of the number.
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
            let bytes = bits.to_le_bytes();
            // A copy of known length needs no call.
            return match (len, bytes) {
                (1, [one, ..]) => out.push(one),
                (2, [one, two, ..]) => out.extend_from_slice(&[one, two]),
                (4, [one, two, three, four, ..]) => {
                    out.extend_from_slice(&[one, two, three, four]);
                }
                _ => out.extend_from_slice(&bytes[..len]),
            };
        }
        let mut ordered = bits.to_be_bytes();
        let bytes = &mut ordered[8 - len..];
        self.arrange(bytes);
        out.extend_from_slice(bytes);
    }

    /// The integer that `bits` encodes.
    pub(crate) fn int(self, bits: u64) -> i128 {
        let value = i128::from(bits);
        let [_, greatest] = self.range();
        match self.kind {
            NumberKind::Signed if value > greatest => value - 2 * (greatest + 1),
            _ => value,
        }
    }

    /// The IEEE 754 number that `bits` encodes.
    pub(crate) fn float(self, bits: u64) -> f64 {
        match self.bytes {
            4 => f64::from(f32::from_bits(u32::try_from(bits).unwrap_or(u32::MAX))),
            _ => f64::from_bits(bits),
        }
    }

    /// The IEEE 754 encoding of `value`.
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

    /// The four orders of 0x11223344 that Modbus devices use: ABCD, CDAB, BADC, DCBA.
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
