//! `bus` and `bus-high-first`: the register bus with either order of its checksum.

use core::fmt::Write as _;
use core::marker::PhantomData;

use protocols::Decode as _;
use protocols::avr::{self, ChecksumOrder, ERROR_REGISTER, registers};

use super::answers::Answers;
use super::lua::{Lua, LuaField, field};
use super::row::{Codec, OtherOrder};
use super::wire::{Broken, Choices, Wire, made_again};

/// The register bus as documented.
pub static BUS: Codec = Codec::of::<Avr<LowFirst>>("Register bus, checksum low byte first")
    .fuzzed_as("avr-low-first")
    .with_answers(ANSWERS)
    .with_other_order(OtherOrder::Row(&BUS_HIGH_FIRST))
    .with_lua(lua("judge_bus_low_first", "tell_bus_low_first"));

/// The register bus as fielded.
pub static BUS_HIGH_FIRST: Codec =
    Codec::of::<Avr<HighFirst>>("Register bus, checksum high byte first")
        .fuzzed_as("avr-high-first")
        .with_answers(ANSWERS)
        .with_other_order(OtherOrder::Row(&BUS))
        .with_lua(lua("judge_bus_high_first", "tell_bus_high_first"));

/// The row of the bus with that order.
pub const fn bus(order: ChecksumOrder) -> &'static Codec {
    match order {
        ChecksumOrder::LowFirst => &BUS,
        ChecksumOrder::HighFirst => &BUS_HIGH_FIRST,
    }
}

const ANSWERS: Answers = Answers {
    // Register and direction, with the count: a reply repeats both.
    kind: |frame| &frame[1..3],
    head: 3,
    // Register of the answer to a bad checksum.
    is_refusal: |frame| frame[1] == ERROR_REGISTER,
    // Few of 256 registers exist, mostly the first ones; a short read does no harm.
    likely: &[(0, 32), (1, 4)],
};

const fn lua(judge: &'static str, tell: &'static str) -> Lua {
    Lua {
        source: include_str!("lua/bus.lua"),
        judge,
        tell,
        fields: &FIELDS,
    }
}

const FIELDS: [LuaField; 6] = [
    field("register", "uint8", "hilrig.bus.register", "Register"),
    field("count", "uint8", "hilrig.bus.count", "Count"),
    field("write", "bool", "hilrig.bus.write", "Carries data"),
    field("order", "string", "hilrig.bus.order", "Checksum order"),
    field("name", "string", "hilrig.bus.name", "Name"),
    field("value", "int32", "hilrig.bus.value", "Value"),
];

/// An order of the register bus's checksum.
pub trait Order {
    /// Order of the checksum's bytes.
    const ORDER: ChecksumOrder;
    /// Name of the row.
    const NAME: &'static str;
}

/// The documented variant.
#[derive(Clone, Copy, Debug)]
pub struct LowFirst;

impl Order for LowFirst {
    const ORDER: ChecksumOrder = ChecksumOrder::LowFirst;
    const NAME: &'static str = "bus";
}

/// The fielded variant.
#[derive(Clone, Copy, Debug)]
pub struct HighFirst;

impl Order for HighFirst {
    const ORDER: ChecksumOrder = ChecksumOrder::HighFirst;
    const NAME: &'static str = "bus-high-first";
}

/// The register bus.
#[derive(Clone, Copy, Debug)]
pub struct Avr<O>(PhantomData<O>);

impl<O: Order> Wire for Avr<O> {
    type Decoder = avr::Decoder;
    const NAME: &'static str = O::NAME;

    fn decoder() -> avr::Decoder {
        avr::Decoder::new(O::ORDER)
    }

    fn bytes(frame: &avr::Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn words(frame: &avr::Frame) -> String {
        words(frame)
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let (register, control) = (choices.byte(), choices.byte());
        let frame = if control & 0x80 == 0 {
            avr::Frame::read(register, control, O::ORDER)
        } else {
            let data = choices.take(usize::from(control & 0x7F));
            avr::Frame::write(register, data, O::ORDER)
        };
        out.extend(frame.as_bytes());
    }

    fn repair(frame: &mut [u8]) {
        let Some(end) = frame.len().checked_sub(2).filter(|end| *end >= 3) else {
            return;
        };
        if frame[2] & 0x80 != 0 && end - 3 <= avr::DATA_MAX {
            frame[2] = 0x80 | u8::try_from(end - 3).expect("at most 127");
        }
        let sum = avr::checksum(&frame[..end]);
        let sum = match O::ORDER {
            ChecksumOrder::LowFirst => sum.to_le_bytes(),
            ChecksumOrder::HighFirst => sum.to_be_bytes(),
        };
        frame[end..].copy_from_slice(&sum);
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let control = usize::from(*bytes.get(2)?);
        let end = 3 + control.saturating_sub(128);
        let sum: usize = bytes
            .get(..end)?
            .iter()
            .map(|&byte| usize::from(byte))
            .sum();
        let (first, second) = (*bytes.get(end)?, *bytes.get(end + 1)?);
        let (low, high) = match O::ORDER {
            ChecksumOrder::LowFirst => (first, second),
            ChecksumOrder::HighFirst => (second, first),
        };
        let holds = sum % 65_536 == usize::from(low) + 256 * usize::from(high);
        (bytes[0] == 0xAB && holds).then_some(end + 2)
    }

    fn kind(frame: &avr::Frame) -> u64 {
        let size = u64::from(u8::BITS - frame.count().leading_zeros());
        u64::from(frame.is_write()) << 16 | u64::from(frame.register() / 8) << 8 | size
    }

    fn means_itself(frame: &avr::Frame) -> Result<(), Broken> {
        let made = if frame.is_write() {
            avr::Frame::write(frame.register(), frame.data(), O::ORDER)
        } else {
            avr::Frame::read(frame.register(), frame.count(), O::ORDER)
        };
        made_again(frame.as_bytes(), made.as_bytes())
    }
}

/// A register of a slave: its address, length and format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedRegister {
    /// Address of its first byte.
    pub address: u8,
    /// Bytes of its value, 1, 2 or 4, the lowest first.
    pub bytes: u8,
    /// Whether the value has a sign.
    pub is_signed: bool,
    /// Its name.
    pub name: String,
    /// Unit of the value; empty if it has none.
    pub unit: String,
}

/// The registers of one slave, to print frames with its own names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RegisterNames(Vec<NamedRegister>);

impl RegisterNames {
    /// The table of these registers, in any order.
    pub fn new(registers: impl IntoIterator<Item = NamedRegister>) -> Self {
        Self(registers.into_iter().collect())
    }

    /// The registers of the AVR base.
    fn of_the_base() -> Self {
        use registers::Width;
        let all = registers::TABLE.iter().map(|register| NamedRegister {
            address: register.address,
            bytes: register.width.bytes(),
            is_signed: register.width != Width::U8,
            name: register.name.to_owned(),
            unit: register.unit.to_owned(),
        });
        Self::new(all)
    }

    /// The register that contains `address`.
    fn at(&self, address: u8) -> Option<&NamedRegister> {
        let holds = |register: &&NamedRegister| {
            let end = u16::from(register.address) + u16::from(register.bytes);
            (u16::from(register.address)..end).contains(&address.into())
        };
        self.0.iter().find(holds)
    }

    /// A valid frame of the bus as text; `None` if `bytes` are not a frame.
    pub fn words(&self, bytes: &[u8]) -> Option<String> {
        [ChecksumOrder::LowFirst, ChecksumOrder::HighFirst]
            .into_iter()
            .find_map(|order| {
                let frame = avr::Decoder::new(order).push(bytes).find_map(Result::ok)?;
                (frame.as_bytes() == bytes).then(|| self.frame_words(&frame))
            })
    }

    fn frame_words(&self, frame: &avr::Frame) -> String {
        let (register, count) = (frame.register(), frame.count());
        if frame.is_write() {
            return format!("{register}:{}", self.values(register, frame.data()));
        }
        if count == 0 && register == ERROR_REGISTER {
            return "error".to_owned();
        }
        if count == 0 {
            return format!("acknowledge {register}{}", self.names(register, 1));
        }
        format!(
            "read {count} from {register}:{}",
            self.names(register, count)
        )
    }

    /// Names of the values that begin or end among `count` registers from `first` on.
    fn names(&self, first: u8, count: u8) -> String {
        let last = u16::from(first) + u16::from(count);
        let (mut out, mut at) = (String::new(), u16::from(first));
        while at < last {
            let address = u8::try_from(at).ok();
            let Some(register) = address.and_then(|address| self.at(address)) else {
                at += 1;
                continue;
            };
            write!(out, " {}", register.name).expect(TAKES_ALL);
            at = u16::from(register.address) + u16::from(register.bytes);
        }
        out
    }

    /// `data` as the values of the registers from `first` on; incomplete values as bytes.
    fn values(&self, first: u8, mut data: &[u8]) -> String {
        let (mut out, mut at) = (String::new(), first);
        while let [byte, rest @ ..] = data {
            let known = self.at(at).filter(|register| register.address == at);
            let len = known.map_or(1, |register| usize::from(register.bytes));
            let (Some(register), true) = (known, len <= data.len()) else {
                write!(out, " {byte:02X}").expect(TAKES_ALL);
                (data, at) = (rest, at.wrapping_add(1));
                continue;
            };
            let value = register.value(&data[..len]);
            let gap = if register.unit.is_empty() { "" } else { " " };
            write!(out, " {}={value}{gap}{}", register.name, register.unit).expect(TAKES_ALL);
            data = &data[len..];
            at = at.wrapping_add(register.bytes);
        }
        out
    }
}

impl NamedRegister {
    fn value(&self, data: &[u8]) -> i64 {
        let bits = 8 * u32::from(self.bytes);
        let value = data
            .iter()
            .rev()
            .fold(0_i64, |value, &byte| value << 8 | i64::from(byte));
        match self.is_signed && value >> (bits - 1) & 1 == 1 {
            true => value - (1 << bits),
            false => value,
        }
    }
}

/// A frame of the register bus, by the names of the base's registers.
fn words(frame: &avr::Frame) -> String {
    use std::sync::LazyLock;
    static BASE: LazyLock<RegisterNames> = LazyLock::new(RegisterNames::of_the_base);
    BASE.frame_words(frame)
}

const TAKES_ALL: &str = "a string takes everything";

#[cfg(test)]
mod tests {
    use super::*;

    fn of_bus(bytes: &[u8]) -> String {
        let mut decoder = avr::Decoder::new(ChecksumOrder::HighFirst);
        let frame = decoder.push(bytes).find_map(Result::ok);
        words(&frame.expect("sound"))
    }

    /// A custom slave: 286461187 is 0x11131B03, sums by hand. No name of the base appears.
    #[test]
    fn another_slave_has_its_own_names() {
        let register = |address, bytes, is_signed, name: &str| NamedRegister {
            address,
            bytes,
            is_signed,
            name: name.to_owned(),
            unit: String::new(),
        };
        let names = RegisterNames::new([register(0, 4, false, "a"), register(8, 1, true, "w")]);
        let of = |bytes: &[u8]| names.words(bytes).unwrap_or_default();
        assert_eq!(of(&[0xAB, 0, 4, 0xAF, 0]), "read 4 from 0: a");
        let answer = [0xAB, 0, 0x84, 0x03, 0x1B, 0x13, 0x11, 0x71, 0x01];
        assert_eq!(of(&answer), "0: a=286464771");
        assert_eq!(of(&[0xAB, 8, 0x81, 0xFF, 0x02, 0x33]), "8: w=-1");
        assert_eq!(of(&[0xAB, 5, 5, 0xB5, 0]), "read 5 from 5: w");
        assert_eq!(of(&[0xAB, 50, 1, 0xDE, 0]), "read 1 from 50:");
        assert_eq!(names.words(&[0xAB, 0]), None);
    }

    /// Vectors of the fielded firmware, register names of its map.
    #[test]
    fn the_bus_is_told_by_the_names_of_its_registers() {
        let read = of_bus(&[0xAB, 0x24, 0x0A, 0x00, 0xD9]);
        let names = "encoder_left encoder_right speed_left_is speed_right_is";
        assert_eq!(read, format!("read 10 from 36: {names}"));
        let write = of_bus(&[0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C]);
        let values = "speed_left_to=20 ticks/40 ms speed_right_to=-20 ticks/40 ms motor_standby=0";
        assert_eq!(write, format!("46: {values}"));
        let ack = of_bus(&[0xAB, 0x2E, 0x00, 0x00, 0xD9]);
        assert_eq!(ack, "acknowledge 46 speed_left_to");
        assert_eq!(of_bus(&[0xAB, 0xFF, 0x00, 0x01, 0xAA]), "error");
    }
}
