//! Checksums in Lua, for the dissector: each is a function of bytes.

use super::Algorithm;
use super::engine::Engine;
use crate::lua::quoted;

/// The parameters of a CRC with a register of any width.
struct Crc {
    width: u8,
    poly: u128,
    init: u128,
    refin: bool,
    refout: bool,
    xorout: u128,
}

macro_rules! crc {
    ($crc:expr) => {{
        let of = $crc.algorithm;
        Crc {
            width: of.width,
            poly: of.poly.into(),
            init: of.init.into(),
            refin: of.refin,
            refout: of.refout,
            xorout: of.xorout.into(),
        }
        .lua()
    }};
}

impl Algorithm {
    /// The function in Lua.
    pub(crate) fn lua(&self) -> String {
        match self.part() {
            None => self.whole_lua(),
            Some((bits, plus)) => format!("D.part({}, {bits}, {plus})", self.whole_lua()),
        }
    }

    /// The function without the limit of its bits.
    fn whole_lua(&self) -> String {
        let name = match &*self.engine {
            Engine::U8(of) => return crc!(of),
            Engine::U16(of) => return crc!(of),
            Engine::U32(of) => return crc!(of),
            Engine::U64(of) => return crc!(of),
            Engine::U128(of) => return crc!(of),
            Engine::Fletcher(modulus) => return format!("D.sum.fletcher({modulus})"),
            Engine::Sum => "add",
            Engine::TwosComplement => "twos",
            Engine::OnesComplement => "ones",
            Engine::Xor8 => "xor",
            Engine::Xor16 => "xor16",
            Engine::Fletcher32 => "fletcher32",
            Engine::Adler32 => "adler32",
            Engine::Internet => "internet",
            Engine::Lin => "lin",
            Engine::Xv11 => "xv11",
        };
        format!("D.sum.{name}")
    }
}

impl Crc {
    fn lua(&self) -> String {
        let size = usize::from(self.width.div_ceil(8));
        let pad = 8 * size - usize::from(self.width);
        let bytes = |value: u128| quoted(&value.to_be_bytes()[16 - size..]);
        let (width, refin, refout) = (self.width, self.refin, self.refout);
        // The register of the dissector begins at the highest bit of its first byte.
        let [poly, init] = [self.poly, self.init].map(|value| bytes(value << pad));
        let xorout = bytes(self.xorout);
        format!("D.crc({width}, {poly}, {init}, {refin}, {refout}, {xorout})")
    }
}
