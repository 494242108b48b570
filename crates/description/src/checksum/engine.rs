//! The computation of checksums.

use core::fmt;

use crc::{Algorithm, Crc, Table};

/// An algorithm with its table.
pub(super) enum Engine {
    U8(Box<Crc<u8>>),
    U16(Box<Crc<u16>>),
    U32(Box<Crc<u32>>),
    U64(Box<Crc<u64>>),
    U128(Box<Crc<u128, Table<1>>>),
    /// Sum of bytes, modulo the width.
    Sum,
    /// The two's complement of the sum: sum and checksum add up to 0.
    TwosComplement,
    /// The sum with all bits inverted.
    OnesComplement,
    Xor8,
    /// Exclusive or of words, low byte first.
    Xor16,
    /// Two sums of bytes, each modulo the number; the first one is the low byte.
    Fletcher(u32),
    /// Two sums of words, low byte first, modulo 65535.
    Fletcher32,
    Adler32,
    /// The checksum of RFC 1071.
    Internet,
    /// The checksum of LIN: the inverted sum of bytes, whose carries are added to it.
    Lin,
    /// The sum of a Neato XV-11: 15 bits of shifted words.
    Xv11,
}

/// The parameters of a user-defined CRC, with the names of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Polynomial {
    /// Bits of the register, 3 to 64.
    pub width: u8,
    /// The polynomial without its highest bit.
    pub poly: u64,
    /// The register at the start.
    pub init: u64,
    /// Whether bytes are read lowest bit first.
    pub refin: bool,
    /// Whether the register is reflected at the end.
    pub refout: bool,
    /// The value that is XORed with the register at the end.
    pub xorout: u64,
}

macro_rules! own {
    ($engine:ident, $type:ty, $of:expr) => {{
        let of: Polynomial = $of;
        let narrow = |value: u64| <$type>::try_from(value).unwrap_or(<$type>::MAX);
        // `crc` needs parameters with a static lifetime: some 40 bytes leak for each description.
        let algorithm: &'static Algorithm<$type> = Box::leak(Box::new(Algorithm {
            width: of.width,
            poly: narrow(of.poly),
            init: narrow(of.init),
            refin: of.refin,
            refout: of.refout,
            xorout: narrow(of.xorout),
            check: 0,
            residue: 0,
        }));
        Engine::$engine(Box::new(Crc::<$type, Table<1>>::new(algorithm)))
    }};
}

impl Engine {
    /// A CRC with user-defined parameters.
    pub(super) fn of(polynomial: Polynomial) -> Self {
        match polynomial.width {
            0..=8 => own!(U8, u8, polynomial),
            9..=16 => own!(U16, u16, polynomial),
            17..=32 => own!(U32, u32, polynomial),
            _ => own!(U64, u64, polynomial),
        }
    }

    /// Bits of the result.
    pub(super) const fn bits(&self) -> u8 {
        match self {
            Self::U8(crc) => crc.algorithm.width,
            Self::U16(crc) => crc.algorithm.width,
            Self::U32(crc) => crc.algorithm.width,
            Self::U64(crc) => crc.algorithm.width,
            Self::U128(crc) => crc.algorithm.width,
            Self::Sum | Self::TwosComplement | Self::OnesComplement => 8,
            Self::Xor8 | Self::Lin => 8,
            Self::Xor16 | Self::Fletcher(_) | Self::Internet | Self::Xv11 => 16,
            Self::Fletcher32 | Self::Adler32 => 32,
        }
    }

    /// Maximum number of bits of the result. The width of a sum is that of its field.
    pub(super) const fn bits_max(&self) -> u8 {
        match self {
            Self::Sum | Self::TwosComplement | Self::OnesComplement => u8::MAX,
            _ => self.bits(),
        }
    }

    /// The checksum of `bytes`; the caller cuts it to its width.
    pub(super) fn compute(&self, bytes: &[u8]) -> u128 {
        match self {
            Self::U128(crc) => crc.checksum(bytes),
            _ => self.short(bytes).into(),
        }
    }

    /// Whether results have at most 64 bits.
    pub(super) const fn is_short(&self) -> bool {
        !matches!(self, Self::U128(_))
    }

    /// The low 64 bits of the checksum.
    #[inline]
    pub(super) fn short(&self, bytes: &[u8]) -> u64 {
        match self {
            Self::U8(crc) => crc.checksum(bytes).into(),
            Self::U16(crc) => crc.checksum(bytes).into(),
            Self::U32(crc) => crc.checksum(bytes).into(),
            Self::U64(crc) => crc.checksum(bytes),
            Self::U128(crc) => {
                let low = crc.checksum(bytes) & u128::from(u64::MAX);
                u64::try_from(low).unwrap_or(0)
            }
            Self::Sum => sum(bytes),
            Self::TwosComplement => sum(bytes).wrapping_neg(),
            Self::OnesComplement => !sum(bytes),
            Self::Xor8 => bytes.iter().fold(0, |all, &byte| all ^ byte).into(),
            Self::Xor16 => words(bytes).fold(0, |all, word| all ^ word).into(),
            Self::Fletcher(modulus) => {
                let [first, second] = fletcher(bytes.iter().map(|&byte| byte.into()), *modulus);
                (second << 8 | first).into()
            }
            Self::Fletcher32 => {
                let [first, second] = fletcher(words(bytes).map(u32::from), 65_535);
                (u64::from(second) << 16) | u64::from(first)
            }
            Self::Adler32 => {
                let (mut low, mut high) = (1_u32, 0_u32);
                for &byte in bytes {
                    low = (low + u32::from(byte)) % 65_521;
                    high = (high + low) % 65_521;
                }
                (u64::from(high) << 16) | u64::from(low)
            }
            Self::Internet => {
                let words = bytes.chunks(2);
                let words = words.map(|pair| u64::from(pair[0]) << 8 | last(pair));
                let mut sum: u64 = words.sum();
                while sum > 0xffff {
                    sum = (sum & 0xffff) + (sum >> 16);
                }
                !sum & 0xffff
            }
            Self::Lin => {
                let mut sum = sum(bytes);
                while sum > 0xff {
                    sum = (sum & 0xff) + (sum >> 8);
                }
                !sum & 0xff
            }
            Self::Xv11 => xv11(bytes).into(),
        }
    }
}

/// Number of covered bytes in a frame of the sensor.
const XV11_LEN: usize = 20;

/// The manufacturer's sample code computes the sum with 32 bits.
fn xv11(bytes: &[u8]) -> u32 {
    let add = |all: u32, word: u16| (all << 1).wrapping_add(word.into());
    let folded = |all: u32| ((all & 0x7fff) + (all >> 15)) & 0x7fff;
    // The sensor's own frames need no loop.
    if let Ok(frame) = <&[u8; XV11_LEN]>::try_from(bytes) {
        let (words, _) = frame.as_chunks::<2>();
        return folded(
            words
                .iter()
                .map(|word| u16::from_le_bytes(*word))
                .fold(0, add),
        );
    }
    // Four words at a time take a fraction of the loop.
    let (fours, rest) = bytes.as_chunks::<8>();
    let all = fours.iter().fold(0, |all, [a, b, c, d, e, f, g, h]| {
        let words = [[*a, *b], [*c, *d], [*e, *f], [*g, *h]];
        words.into_iter().map(u16::from_le_bytes).fold(all, add)
    });
    folded(words(rest).fold(all, add))
}

impl fmt::Debug for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Engine({} bits)", self.bits())
    }
}

fn sum(bytes: &[u8]) -> u64 {
    bytes.iter().map(|&byte| u64::from(byte)).sum()
}

/// Words, low byte first; a last odd byte is padded with a zero.
fn words(bytes: &[u8]) -> impl Iterator<Item = u16> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let pairs = pairs.iter().map(|pair| u16::from_le_bytes(*pair));
    pairs.chain(rest.first().map(|byte| u16::from(*byte)))
}

fn last(pair: &[u8]) -> u64 {
    pair.get(1).copied().unwrap_or(0).into()
}

fn fletcher(parts: impl Iterator<Item = u32>, modulus: u32) -> [u32; 2] {
    parts.fold([0, 0], |[first, second], part| {
        let first = (first + part) % modulus;
        [first, (second + first) % modulus]
    })
}
