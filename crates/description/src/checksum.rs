//! Checksums by name: the CRC catalogue, user-defined polynomials, sums.
//!
//! The comparison of names ignores case and separators: `CRC-16/IBM-SDLC`, `crc-16-ibm-sdlc` and
//! the alias `X-25` name the same algorithm.

mod catalogue;
mod engine;
mod lua;

use std::sync::Arc;

use engine::Engine;
pub use engine::Polynomial;

/// A checksum algorithm.
#[derive(Clone, Debug)]
pub struct Algorithm {
    engine: Arc<Engine>,
    name: Arc<str>,
    /// Bits of the result that are sent.
    kept: u128,
    /// Number that is added to them.
    plus: u64,
}

/// A sum: its names, and the constructor of its engine with the width of the result in bits.
type Sum = (&'static [&'static str], fn() -> (Engine, u8));

/// Sums, with their aliases. Sums of 7 bits are those of protocols whose bytes are below 128.
const SUMS: [Sum; 22] = [
    (&["SUM", "SUM8"], || (Engine::Sum, 8)),
    (&["SUM7"], || (Engine::Sum, 7)),
    (&["SUM15"], || (Engine::Sum, 15)),
    (&["SUM16"], || (Engine::Sum, 16)),
    (&["SUM24"], || (Engine::Sum, 24)),
    (&["SUM32"], || (Engine::Sum, 32)),
    (&["TWOS_COMPLEMENT", "LRC"], || (Engine::TwosComplement, 8)),
    (&["TWOS_COMPLEMENT7"], || (Engine::TwosComplement, 7)),
    (&["TWOS_COMPLEMENT16"], || (Engine::TwosComplement, 16)),
    (&["ONES_COMPLEMENT"], || (Engine::OnesComplement, 8)),
    (&["ONES_COMPLEMENT7"], || (Engine::OnesComplement, 7)),
    (&["ONES_COMPLEMENT16"], || (Engine::OnesComplement, 16)),
    (&["XOR", "XOR8", "BCC", "NMEA"], || (Engine::Xor8, 8)),
    (&["XOR7"], || (Engine::Xor8, 7)),
    (&["XOR16"], || (Engine::Xor16, 16)),
    (&["FLETCHER8", "UBX"], || (Engine::Fletcher(256), 16)),
    (&["FLETCHER16"], || (Engine::Fletcher(255), 16)),
    (&["FLETCHER32"], || (Engine::Fletcher32, 32)),
    (&["ADLER32"], || (Engine::Adler32, 32)),
    (&["INTERNET"], || (Engine::Internet, 16)),
    (&["LIN_CLASSIC"], || (Engine::Lin, 8)),
    (&["LIN_ENHANCED"], || (Engine::Lin, 8)),
];

/// Aliases of algorithms in the catalogue.
const ALIASES: [(&str, &str); 30] = [
    ("MODBUS", "CRC_16_MODBUS"),
    ("X_25", "CRC_16_IBM_SDLC"),
    ("CRC_16_X_25", "CRC_16_IBM_SDLC"),
    ("CRC_B", "CRC_16_IBM_SDLC"),
    ("CRC_16_ISO_HDLC", "CRC_16_IBM_SDLC"),
    ("CRC_16_CCITT_FALSE", "CRC_16_IBM_3740"),
    ("CRC_16_AUTOSAR", "CRC_16_IBM_3740"),
    ("CRC_16_CCITT", "CRC_16_KERMIT"),
    ("CRC_16_CCITT_TRUE", "CRC_16_KERMIT"),
    ("KERMIT", "CRC_16_KERMIT"),
    ("XMODEM", "CRC_16_XMODEM"),
    ("CRC_16_ACORN", "CRC_16_XMODEM"),
    ("CRC_16_LTE", "CRC_16_XMODEM"),
    ("ZMODEM", "CRC_16_XMODEM"),
    ("ARC", "CRC_16_ARC"),
    ("CRC_16", "CRC_16_ARC"),
    ("CRC_16_LHA", "CRC_16_ARC"),
    ("CRC_16_AUG_CCITT", "CRC_16_SPI_FUJITSU"),
    ("CRC_16_BUYPASS", "CRC_16_UMTS"),
    ("CRC_16_VERIFONE", "CRC_16_UMTS"),
    ("CRC_16_MAXIM", "CRC_16_MAXIM_DOW"),
    ("CRC_8", "CRC_8_SMBUS"),
    ("CRC_8_MAXIM", "CRC_8_MAXIM_DOW"),
    ("DOW_CRC", "CRC_8_MAXIM_DOW"),
    ("CRC_8_ITU", "CRC_8_I_432_1"),
    ("CRC_32", "CRC_32_ISO_HDLC"),
    ("CRC_32_ADCCP", "CRC_32_ISO_HDLC"),
    ("CRC_32C", "CRC_32_ISCSI"),
    ("CRC_32_CASTAGNOLI", "CRC_32_ISCSI"),
    ("XV11", "XV_11"),
];

impl Algorithm {
    /// The number of bytes behind the sync byte that the checksum leaves out by its definition:
    /// LIN's classic checksum leaves out the protected identifier.
    pub(crate) fn left_out(&self) -> Option<i64> {
        match &*self.name {
            "lin-classic" => Some(1),
            "lin-enhanced" => Some(0),
            _ => None,
        }
    }

    /// The algorithm called `name`, and the width of its result in bytes.
    ///
    /// # Errors
    /// If no algorithm has this name; the text suggests similar names.
    pub fn named(name: &str) -> Result<(Self, u8), String> {
        let plain = plain(name);
        let aliased = ALIASES.iter().find(|(alias, _)| *alias == plain);
        let wanted = aliased.map_or(plain.as_str(), |(_, name)| name);
        if wanted == "XV_11" {
            return Ok((Self::new(Engine::Xv11, "xv11"), 2));
        }
        if let Some((_, make)) = SUMS.iter().find(|(names, _)| names.contains(&wanted)) {
            let (engine, bits) = make();
            let sum = Self::new(engine, &pretty(wanted));
            let sum = match bits % 8 {
                0 => sum,
                _ => sum.of_low_bits(bits),
            };
            return Ok((sum, bits.div_ceil(8)));
        }
        if let Some(engine) = catalogue::find(wanted) {
            let bytes = engine.bits().div_ceil(8);
            return Ok((Self::new(engine, &pretty(wanted)), bytes));
        }
        let alike = alike(&plain);
        Err(format!(
            "there is no algorithm \"{name}\", expected a name of the CRC catalogue or a sum, e.g. \
            {alike}"
        ))
    }

    /// A CRC with user-defined parameters, and the width of its result in bytes.
    ///
    /// # Errors
    /// If the width is not 3 to 64 bits, or a parameter has more bits than the width.
    pub fn of(polynomial: Polynomial) -> Result<(Self, u8), String> {
        let width = polynomial.width;
        if !(3..=64).contains(&width) {
            return Err(format!("width is {width}, expected 3 to 64 bits"));
        }
        let Polynomial {
            poly, init, xorout, ..
        } = polynomial;
        for (name, value) in [("poly", poly), ("init", init), ("xorout", xorout)] {
            if width < 64 && value >> width != 0 {
                return Err(format!(
                    "{name} is {value:#x}, expected {width} bits at most"
                ));
            }
        }
        let name = format!("CRC-{width} with the polynomial {poly:#x}");
        let bytes = width.div_ceil(8);
        Ok((Self::new(Engine::of(polynomial), &name), bytes))
    }

    /// The same algorithm; only the low `bits` bits of its result are sent.
    #[must_use]
    pub fn of_low_bits(self, bits: u8) -> Self {
        let low = u128::MAX >> (128 - u32::from(bits.clamp(1, 128)));
        let kept = self.kept & low;
        Self { kept, ..self }
    }

    /// Maximum number of bits of a result that is sent in `width` bytes.
    pub(crate) fn bits(&self, width: u8) -> u8 {
        let own = match self.kept {
            u128::MAX => self.engine.bits_max(),
            kept => u8::try_from(kept.count_ones()).unwrap_or(u8::MAX),
        };
        own.min(width.saturating_mul(8))
    }

    /// The same algorithm with a number that is added to its result.
    #[must_use]
    pub fn plus(self, plus: u64) -> Self {
        Self { plus, ..self }
    }

    /// The checksum of `bytes`, cut to its low `width` bytes.
    pub fn compute(&self, bytes: &[u8], width: u8) -> u128 {
        let sent = u128::MAX >> (128 - 8 * u32::from(width.clamp(1, 16)));
        let result = self.engine.compute(bytes) & self.kept;
        result.wrapping_add(self.plus.into()) & sent
    }

    /// Whether results have at most 64 bits.
    pub(crate) fn is_short(&self) -> bool {
        self.engine.is_short()
    }

    /// The low 64 bits of the checksum of `bytes`, not cut to a width.
    #[inline]
    pub(crate) fn short(&self, bytes: &[u8]) -> u64 {
        #[expect(clippy::cast_possible_truncation, reason = "the low 64 bits are meant")]
        let kept = self.kept as u64;
        (self.engine.short(bytes) & kept).wrapping_add(self.plus)
    }

    /// The number of bits that are sent if these are not all, and the number that is added.
    pub(crate) fn part(&self) -> Option<(u32, u64)> {
        let is_whole = self.kept == u128::MAX && self.plus == 0;
        (!is_whole).then(|| (self.kept.count_ones(), self.plus))
    }

    /// The name in the catalogue, or a description of a user-defined algorithm.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn new(engine: Engine, name: &str) -> Self {
        Self {
            engine: Arc::new(engine),
            name: name.into(),
            kept: u128::MAX,
            plus: 0,
        }
    }

    /// All names: the sums, then the catalogue.
    pub fn names() -> Vec<String> {
        let sums = SUMS.iter().map(|(names, _)| names[0]);
        let all = sums
            .chain(["XV_11"])
            .chain(catalogue::NAMES.iter().copied());
        all.map(pretty).collect()
    }
}

/// Converts a name to upper case with one `_` between its parts.
fn plain(name: &str) -> String {
    let parts = name.split(|c: char| !c.is_ascii_alphanumeric());
    let parts = parts.filter(|part| !part.is_empty());
    let parts: Vec<_> = parts.map(str::to_ascii_uppercase).collect();
    parts.join("_")
}

/// The usual spelling of a name: `CRC-16/MODBUS`, `sum8`.
fn pretty(name: &str) -> String {
    match name
        .strip_prefix("CRC_")
        .and_then(|rest| rest.split_once('_'))
    {
        Some((width, rest)) => format!("CRC-{width}/{}", rest.replace('_', "-")),
        None => name.to_ascii_lowercase().replace('_', "-"),
    }
}

/// Names with the same beginning as `name`, or with its last part.
fn alike(name: &str) -> String {
    let begin: String = name.chars().take(6).collect();
    let is_alike = |other: &str| other.starts_with(&begin);
    // A sum is also known by its other names, such as LRC.
    let sums = SUMS.iter().map(|(names, _)| *names);
    let sums = sums.filter(|names| names.iter().any(|name| is_alike(name)));
    let names = sums
        .flatten()
        .chain(catalogue::NAMES.iter().filter(|name| is_alike(name)));
    let mut names: Vec<_> = names.take(6).map(|name| pretty(name)).collect();
    if names.is_empty() {
        names = ["CRC_16_MODBUS", "CRC_32_ISO_HDLC", "SUM8", "XOR", "LRC"]
            .map(pretty)
            .to_vec();
    }
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, bytes: &[u8]) -> u128 {
        let (algorithm, width) = Algorithm::named(name).expect(name);
        algorithm.compute(bytes, width)
    }

    /// The check value of each algorithm is part of the catalogue itself.
    #[test]
    fn every_algorithm_of_the_catalogue_gives_its_check_value() {
        assert_eq!(catalogue::CHECKS.len(), 113);
        for (name, check) in catalogue::CHECKS {
            assert_eq!(of(&pretty(name), b"123456789"), *check, "{name}");
            assert_eq!(of(name, b"123456789"), *check, "{name}");
        }
    }

    /// A user-defined polynomial with the parameters of CRC-16/MODBUS gives the same checksum.
    #[test]
    fn a_polynomial_of_ones_own_is_computed() {
        let polynomial = Polynomial {
            width: 16,
            poly: 0x8005,
            init: 0xffff,
            refin: true,
            refout: true,
            xorout: 0,
        };
        let (own, width) = Algorithm::of(polynomial).expect("sound");
        assert_eq!((own.compute(b"123456789", width), width), (0x4b37, 2));
        let wide = Polynomial {
            poly: 0x1_8005,
            ..polynomial
        };
        let error = Algorithm::of(wide).expect_err("17 bits");
        assert_eq!(error, "poly is 0x18005, expected 16 bits at most");
    }

    /// Worked out by hand: 1+2+3 = 6, 256-6 = 250, 255-6 = 249, 1^2^3 = 0. NMEA: the example
    /// sentence on Dale DePriest's page on NMEA data. Fletcher-16, Fletcher-32 and Adler-32: the
    /// examples in their Wikipedia articles. RFC 1071 section 3: the same eight bytes add up to
    /// 0xddf2.
    #[test]
    fn sums_give_what_can_be_worked_out_by_hand() {
        let bytes = [1, 2, 3];
        assert_eq!(of("sum8", &bytes), 6);
        assert_eq!(of("lrc", &bytes), 250);
        assert_eq!(of("ones-complement", &bytes), 249);
        assert_eq!(of("twos-complement16", &bytes), 0xfffa);
        assert_eq!(of("xor", &bytes), 0);
        assert_eq!(of("xor16", &bytes), 0x0202);
        // The running sums are A = 1, 3, 6 and B = 1, 4, 10.
        assert_eq!(of("ubx", &bytes), 0x0a06);
        let sentence = b"GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,";
        assert_eq!(of("nmea", sentence), 0x47);
        assert_eq!(of("fletcher16", b"abcde"), 0xc8f0);
        assert_eq!(of("fletcher32", b"abcdef"), 0x5650_2d2a);
        assert_eq!(of("adler32", b"Wikipedia"), 0x11e6_0398);
        let words = [0x00, 0x01, 0xf2, 0x03, 0xf4, 0xf5, 0xf6, 0xf7];
        assert_eq!(of("internet", &words), 0x220d);
    }

    /// The example of the LIN specification 2.2A, section 2.8.3: the sum with carry of 4A, 55, 93
    /// and E5 is 19, inverted E6. With the protected identifier A3 of 23 the
    /// sum is BC. Sums of exactly FF and 0 stay.
    #[test]
    fn the_checksum_of_lin_adds_its_carries() {
        let data = [0x4A, 0x55, 0x93, 0xE5];
        assert_eq!(of("lin-classic", &data), 0xE6);
        assert_eq!(of("LIN enhanced", &[&[0xA3][..], &data].concat()), 0x43);
        assert_eq!(of("lin-classic", &[0xFF, 0xFF]), 0);
        assert_eq!(of("lin-classic", &[0, 0]), 0xFF);
    }

    /// 0x7F + 0x02 = 0x81, of which 7 bits are 1; 128 - 1 = 127; 127 - 1 = 126; 0x81 ^ 0x02 = 0x83.
    /// For a Roland MT-32 a note of 1988 gives the checksum 11 of these bytes. `IINST 002 Y` is a
    /// line of a French meter (forum.arduino.cc, topic 289581): 6 bits of the sum, plus 0x20.
    #[test]
    fn some_bits_of_a_sum_are_sent() {
        let bytes = [0x7F, 0x02];
        assert_eq!(of("sum7", &bytes), 1);
        assert_eq!(of("twos-complement7", &bytes), 127);
        assert_eq!(of("twos-complement7", &[0x40, 0x40]), 0);
        assert_eq!(of("ones-complement7", &bytes), 126);
        assert_eq!(of("xor7", &[0x81, 0x02]), 3);
        assert_eq!(of("sum15", &[0xFF; 129]), 0x7F);
        let mt32 = [0x03, 0x02, 0x00, 0x7F, 0x64, 0x07, 0x01, 0x7F];
        assert_eq!(of("twos-complement7", &mt32), 0x11);
        let (sum, width) = Algorithm::named("sum8").expect("known");
        let tic = sum.of_low_bits(6).plus(0x20);
        assert_eq!(
            (tic.compute(b"IINST 002", width), width),
            (u128::from(b'Y'), 1)
        );
    }

    #[test]
    fn an_unknown_name_is_answered_with_some_like_it() {
        let error = Algorithm::named("CRC-16/MODBUSS").expect_err("unknown");
        assert!(error.contains("CRC-16/ARC"), "{error}");
        let error = Algorithm::named("parity").expect_err("unknown");
        assert!(error.contains("sum8"), "{error}");
    }
}
