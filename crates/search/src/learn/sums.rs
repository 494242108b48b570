//! Checksum algorithms: CRCs of the catalogue with whole bytes, and sums of common serial
//! protocols.

use std::sync::LazyLock;

use crc::{Algorithm, Crc};

/// A checksum algorithm.
pub(crate) struct Sum {
    /// The name; for a CRC that of the catalogue.
    pub(crate) name: &'static str,
    /// Number of bytes of the value.
    pub(crate) bytes: usize,
    /// Whether a constant may be added to the value, or combined with it in an exclusive or. Such a
    /// constant covers initial values and complements.
    pub(crate) is_free: bool,
    how: How,
}

enum How {
    Crc8(Box<Crc<u8>>),
    Crc16(Box<Crc<u16>>),
    Crc32(Box<Crc<u32>>),
    Xor,
    Add,
    Subtract,
    Xor7,
    Add7,
    Subtract7,
    Fletcher(u32),
    Adler,
}

impl core::fmt::Debug for Sum {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name)
    }
}

impl Sum {
    const fn new(name: &'static str, bytes: usize, is_free: bool, how: How) -> Self {
        Self {
            name,
            bytes,
            is_free,
            how,
        }
    }

    /// Whether zero bytes do not change the sum.
    pub(crate) const fn skips_zeros(&self) -> bool {
        self.is_of_7_bits() || matches!(self.how, How::Xor | How::Add | How::Subtract)
    }

    /// Whether the highest bit of the value is 0.
    const fn is_of_7_bits(&self) -> bool {
        matches!(self.how, How::Xor7 | How::Add7 | How::Subtract7)
    }

    /// Whether the value is one byte and each byte of a frame is the same sum of the others.
    pub(crate) const fn is_symmetric(&self) -> bool {
        let is_byte = self.bytes == 1;
        is_byte
            && matches!(
                self.how,
                How::Xor | How::Xor7 | How::Subtract | How::Subtract7
            )
    }

    /// The kind of sum; sums of one kind differ in the number of their bits.
    pub(crate) const fn family(&self) -> Option<&'static str> {
        match self.how {
            How::Xor | How::Xor7 => Some("exclusive or"),
            How::Add | How::Add7 => Some("sum"),
            How::Subtract | How::Subtract7 => Some("negative sum"),
            _ => None,
        }
    }

    /// Evidence of one matching value, bits.
    pub(crate) const fn bits(&self) -> usize {
        match self.is_of_7_bits() {
            true => 7,
            false => 8 * self.bytes,
        }
    }

    /// The checksum over the concatenation of `parts`.
    pub(crate) fn of<'a>(&self, parts: impl IntoIterator<Item = &'a [u8]>) -> u64 {
        let mut parts = parts.into_iter();
        let mask = self.mask();
        let each = |fold: fn(u64, u8) -> u64, parts: &mut dyn Iterator<Item = &'a [u8]>| {
            parts.flatten().fold(0, |sum, byte| fold(sum, *byte)) & mask
        };
        match &self.how {
            How::Crc8(crc) => {
                let mut digest = crc.digest();
                parts.for_each(|part| digest.update(part));
                digest.finalize().into()
            }
            How::Crc16(crc) => {
                let mut digest = crc.digest();
                parts.for_each(|part| digest.update(part));
                digest.finalize().into()
            }
            How::Crc32(crc) => {
                let mut digest = crc.digest();
                parts.for_each(|part| digest.update(part));
                digest.finalize().into()
            }
            How::Xor | How::Xor7 => each(|sum, byte| sum ^ u64::from(byte), &mut parts),
            How::Add | How::Add7 => each(|sum, byte| sum.wrapping_add(byte.into()), &mut parts),
            How::Subtract | How::Subtract7 => {
                each(|sum, byte| sum.wrapping_sub(byte.into()), &mut parts)
            }
            How::Fletcher(modulus) => {
                let (first, second) = parts.flatten().fold((0, 0), |(first, second), byte| {
                    let first = (first + u32::from(*byte)) % modulus;
                    (first, (second + first) % modulus)
                });
                u64::from(second << 8 | first)
            }
            How::Adler => {
                let (first, second) = parts.flatten().fold((1, 0), |(first, second), byte| {
                    let first = (first + u32::from(*byte)) % 65_521;
                    (first, (second + first) % 65_521)
                });
                u64::from(second << 16 | first)
            }
        }
    }

    /// The bits of a value.
    const fn mask(&self) -> u64 {
        u64::MAX >> (64 - self.bits())
    }

    /// `value` combined with the constant `free`.
    pub(crate) const fn with(&self, value: u64, free: u64) -> u64 {
        match self.how {
            How::Xor | How::Xor7 => value ^ free,
            _ => value.wrapping_add(free) & self.mask(),
        }
    }

    /// The constant that turns `value` into `wanted`.
    pub(crate) const fn free(&self, value: u64, wanted: u64) -> u64 {
        match self.how {
            How::Xor | How::Xor7 => (value ^ wanted) & self.mask(),
            _ => wanted.wrapping_sub(value) & self.mask(),
        }
    }

    /// Prior preference for this algorithm, bits.
    pub(crate) fn prior(&self) -> f64 {
        match self.name {
            "CRC_16_MODBUS" | "CRC_16_IBM_3740" | "CRC_16_XMODEM" | "CRC_16_KERMIT"
            | "CRC_32_ISO_HDLC" | "CRC_8_SMBUS" | "CRC_8_MAXIM_DOW" | "CRC_16_ARC" => 2.0,
            _ => 0.0,
        }
    }
}

macro_rules! crcs {
    ($how:path, $word:ty, $($name:ident,)+) => {
        [$({
            let algorithm: &'static Algorithm<$word> = &crc::$name;
            let bytes = usize::from(algorithm.width) / 8;
            Sum::new(stringify!($name), bytes, false, $how(Box::new(Crc::<$word>::new(algorithm))))
        },)+]
    };
}

/// All algorithms.
pub(crate) static ALL: LazyLock<Vec<Sum>> = LazyLock::new(|| {
    let mut all = vec![
        Sum::new("exclusive or", 1, true, How::Xor),
        Sum::new("sum of bytes", 1, true, How::Add),
        Sum::new("negative sum of bytes", 1, true, How::Subtract),
        Sum::new("exclusive or, 7 bits", 1, true, How::Xor7),
        Sum::new("sum of bytes, 7 bits", 1, true, How::Add7),
        Sum::new("negative sum of bytes, 7 bits", 1, true, How::Subtract7),
        Sum::new("sum of bytes, 16 bits", 2, true, How::Add),
        Sum::new("negative sum of bytes, 16 bits", 2, true, How::Subtract),
        Sum::new("Fletcher, modulus 256", 2, false, How::Fletcher(256)),
        Sum::new("Fletcher, modulus 255", 2, false, How::Fletcher(255)),
        Sum::new("sum of bytes, 32 bits", 4, true, How::Add),
        Sum::new("Adler-32", 4, false, How::Adler),
    ];
    #[rustfmt::skip]
    all.extend(crcs!(
        How::Crc8, u8,
        CRC_8_AUTOSAR, CRC_8_BLUETOOTH, CRC_8_CDMA2000, CRC_8_DARC, CRC_8_DVB_S2, CRC_8_GSM_A,
        CRC_8_GSM_B, CRC_8_HITAG, CRC_8_I_432_1, CRC_8_I_CODE, CRC_8_LTE, CRC_8_MAXIM_DOW,
        CRC_8_MIFARE_MAD, CRC_8_NRSC_5, CRC_8_OPENSAFETY, CRC_8_ROHC, CRC_8_SAE_J1850,
        CRC_8_SMBUS, CRC_8_TECH_3250, CRC_8_WCDMA,
    ));
    #[rustfmt::skip]
    all.extend(crcs!(
        How::Crc16, u16,
        CRC_16_ARC, CRC_16_CDMA2000, CRC_16_CMS, CRC_16_DDS_110, CRC_16_DECT_R, CRC_16_DECT_X,
        CRC_16_DNP, CRC_16_EN_13757, CRC_16_GENIBUS, CRC_16_GSM, CRC_16_IBM_3740, CRC_16_IBM_SDLC,
        CRC_16_ISO_IEC_14443_3_A, CRC_16_KERMIT, CRC_16_LJ1200, CRC_16_M17, CRC_16_MAXIM_DOW,
        CRC_16_MCRF4XX, CRC_16_MODBUS, CRC_16_NRSC_5, CRC_16_OPENSAFETY_A, CRC_16_OPENSAFETY_B,
        CRC_16_PROFIBUS, CRC_16_RIELLO, CRC_16_SPI_FUJITSU, CRC_16_T10_DIF, CRC_16_TELEDISK,
        CRC_16_TMS37157, CRC_16_UMTS, CRC_16_USB, CRC_16_XMODEM,
    ));
    #[rustfmt::skip]
    all.extend(crcs!(
        How::Crc32, u32,
        CRC_24_BLE, CRC_24_FLEXRAY_A, CRC_24_FLEXRAY_B, CRC_24_INTERLAKEN, CRC_24_LTE_A,
        CRC_24_LTE_B, CRC_24_OPENPGP, CRC_24_OS_9, CRC_32_AIXM, CRC_32_AUTOSAR, CRC_32_BASE91_D,
        CRC_32_BZIP2, CRC_32_CD_ROM_EDC, CRC_32_CKSUM, CRC_32_ISCSI, CRC_32_ISO_HDLC,
        CRC_32_JAMCRC, CRC_32_MEF, CRC_32_MPEG_2, CRC_32_XFER,
    ));
    all
});

/// Start of the name of a CRC without a name in the catalogue; its polynomial follows.
const POLYNOMIAL: &str = "CRC-8 with polynomial ";

/// CRCs of 8 bits with each polynomial, from 0 and without a change at the end: some devices use
/// one that no catalogue has.
pub(crate) static UNNAMED: LazyLock<Vec<Sum>> = LazyLock::new(|| {
    let of = |poly: u8| -> Sum {
        let name: &'static str = Box::leak(format!("{POLYNOMIAL}{poly:#04X}").into());
        let algorithm: &'static Algorithm<u8> = Box::leak(Box::new(Algorithm {
            width: 8,
            poly,
            init: 0,
            refin: false,
            refout: false,
            xorout: 0,
            check: 0,
            residue: 0,
        }));
        Sum::new(
            name,
            1,
            false,
            How::Crc8(Box::new(Crc::<u8>::new(algorithm))),
        )
    };
    // The lowest bit of a usual polynomial is set.
    (0..=u8::MAX).filter(|poly| poly % 2 == 1).map(of).collect()
});

/// The key of a description for the algorithm of this name.
pub(crate) fn key(name: &str) -> String {
    match name.strip_prefix(POLYNOMIAL) {
        Some(poly) => format!("polynomial = {{ width = 8, poly = {poly} }}"),
        None => format!("algorithm = \"{name}\""),
    }
}

/// Sums with a name in descriptions: the name here, the constant, and the name there.
pub(crate) const DESCRIBED: [(&str, u64, &str); 16] = [
    ("exclusive or", 0, "xor"),
    ("exclusive or, 7 bits", 0, "xor7"),
    ("sum of bytes, 7 bits", 0, "sum7"),
    ("negative sum of bytes, 7 bits", 0, "twos-complement7"),
    ("negative sum of bytes, 7 bits", 0x7F, "ones-complement7"),
    ("sum of bytes", 0, "sum8"),
    ("negative sum of bytes", 0, "lrc"),
    ("negative sum of bytes", 0xFF, "ones-complement"),
    ("sum of bytes, 16 bits", 0, "sum16"),
    ("negative sum of bytes, 16 bits", 0, "twos-complement16"),
    (
        "negative sum of bytes, 16 bits",
        0xFFFF,
        "ones-complement16",
    ),
    ("sum of bytes, 32 bits", 0, "sum32"),
    ("Fletcher, modulus 256", 0, "fletcher8"),
    ("Fletcher, modulus 255", 0, "fletcher16"),
    ("Adler-32", 0, "adler32"),
    ("sum of bytes, 24 bits", 0, "sum24"),
];

/// The name in descriptions of a sum with this constant, if there is one.
pub(crate) fn described(name: &str, free: u64) -> Option<&'static str> {
    let found = DESCRIBED
        .iter()
        .find(|(known, constant, _)| *known == name && *constant == free);
    found.map(|(_, _, described)| *described)
}
