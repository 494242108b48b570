//! Boards as data: the files of the folder `boards`, and user-defined files.

use core::fmt;
use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde_json::{Map, Value, json};
use toml::Spanned;

use crate::qemu::{Machine, Tier};

/// Names and texts of the shipped boards.
const SHIPPED: [(&str, &str); 7] = [
    ("arduino-uno", include_str!("../boards/arduino-uno.toml")),
    ("arduino-mega", include_str!("../boards/arduino-mega.toml")),
    ("leonardo", include_str!("../boards/leonardo.toml")),
    ("mighty-1284p", include_str!("../boards/mighty-1284p.toml")),
    ("cortex-m4", include_str!("../boards/cortex-m4.toml")),
    ("mps2-an386", include_str!("../boards/mps2-an386.toml")),
    (
        "netduinoplus2",
        include_str!("../boards/netduinoplus2.toml"),
    ),
];

/// Supported chips: those of Debian's simavr 1.6 with a UART.
const MCUS: [&str; 12] = [
    "atmega328p",
    "atmega2560",
    "atmega32u4",
    "atmega1284p",
    "atmega328",
    "atmega168p",
    "atmega1280",
    "atmega644p",
    "atmega1284",
    "atmega32",
    "atmega128",
    "atmega8",
];

/// Maximum length of the name of a pin, a UART, a bus or a part: the size of the node program's
/// buffer.
const NAME_MAX: usize = 60;

/// Checks the name of a pin, a UART, a bus or a part of a board.
///
/// # Errors
/// If the name is empty, too long or has other characters.
pub fn check_name(name: &str) -> Result<(), String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    match name.len() {
        1..=NAME_MAX if name.chars().all(is_plain) => Ok(()),
        _ => Err(format!(
            "\"{}\" is no name, expected 1 to {NAME_MAX} letters, digits, '-', '_' and '.'",
            name.escape_debug()
        )),
    }
}

/// Names of the shipped boards.
pub fn names() -> impl Iterator<Item = &'static str> {
    SHIPPED.iter().map(|(name, _)| *name)
}

/// A board.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// Its name.
    pub name: String,
    /// Description, for display.
    pub about: String,
    /// The chip, with the name that the compiler uses; empty if QEMU runs the board.
    pub mcu: String,
    /// The machine of QEMU that runs the board; `None`: simavr runs it.
    pub qemu: Option<Machine>,
    /// Clock frequency.
    pub clock_hz: u32,
    /// Supply voltage of the chip.
    pub vcc_volts: f64,
    /// Reference voltage of the A/D converter.
    pub aref_volts: f64,
    /// Name of the two-wire bus.
    pub i2c: Option<String>,
    /// Name of the SPI bus.
    pub spi: Option<String>,
    /// UARTs: names and numbers.
    pub uarts: BTreeMap<String, u8>,
    /// Pins by name.
    pub pins: BTreeMap<String, Pin>,
}

/// The position of a pin of a board.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pin {
    /// Port and bit of the chip, e.g. `B5`.
    pub at: String,
    /// Channel of the A/D converter.
    pub adc: Option<u8>,
}

/// The content of a board's file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoardText {
    name: Spanned<String>,
    #[serde(default)]
    about: String,
    /// Documents on which the file is based.
    #[serde(default, rename = "documents")]
    _documents: Vec<String>,
    mcu: Option<Spanned<String>>,
    qemu: Option<Spanned<Machine>>,
    clock_hz: Spanned<u32>,
    vcc_volts: Option<Spanned<f64>>,
    aref_volts: Option<Spanned<f64>>,
    i2c: Option<Spanned<String>>,
    spi: Option<Spanned<String>>,
    #[serde(default)]
    uarts: BTreeMap<String, Spanned<u8>>,
    #[serde(default)]
    pins: BTreeMap<String, Spanned<Pin>>,
}

/// An error in a board's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoardError {
    /// File, and line if the error has one.
    pub place: String,
    /// The key with the error; empty if there is none.
    pub key: String,
    /// The error and the expected value.
    pub message: String,
}

impl fmt::Display for BoardError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            place,
            key,
            message,
        } = self;
        let colon = if key.is_empty() { "" } else { ": " };
        write!(f, "{place}: {key}{colon}{message}")
    }
}

impl core::error::Error for BoardError {}

/// The text of a file, to find the line of an error.
struct Source<'a> {
    file: &'a str,
    text: &'a str,
}

impl Source<'_> {
    fn error(&self, at: usize, key: impl Into<String>, message: impl Into<String>) -> BoardError {
        let before = &self.text.as_bytes()[..at.min(self.text.len())];
        let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
        BoardError {
            place: format!("{}:{line}", self.file),
            key: key.into(),
            message: message.into(),
        }
    }

    fn wrong<T>(&self, value: &Spanned<T>, key: &str, message: String) -> BoardError {
        self.error(value.span().start, key, message)
    }
}

impl Board {
    /// The shipped board `name`, or the board in the file `name`, which ends with `.toml` and is
    /// relative to the folder `base`.
    ///
    /// # Errors
    /// If the board does not exist, or its file has an error.
    pub fn load(name: &str, base: &Path) -> Result<Self, BoardError> {
        if let Some((_, text)) = SHIPPED.iter().find(|(known, _)| *known == name) {
            return Self::parse(text, &format!("boards/{name}.toml"));
        }
        let path = base.join(name);
        let wrong = |message: String| BoardError {
            place: format!("board \"{name}\""),
            key: String::new(),
            message,
        };
        if !name.ends_with(".toml") {
            let known: Vec<_> = names().collect();
            let message = format!(
                "unknown, expected {} or a file that ends with .toml",
                known.join(", ")
            );
            return Err(wrong(message));
        }
        let text = std::fs::read_to_string(&path)
            .map_err(|error| wrong(format!("{}: {error}", path.display())))?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Parses the text of `file`.
    ///
    /// # Errors
    /// If the text has an error: file, line, key and the expected value.
    pub fn parse(text: &str, file: &str) -> Result<Self, BoardError> {
        let source = Source { file, text };
        let read: BoardText = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            let message = error.message().trim().replace('\n', "; ");
            source.error(at, "", message)
        })?;
        read.check(&source)?;
        let volts = |given: Option<Spanned<f64>>| given.map(Spanned::into_inner);
        let vcc_volts = volts(read.vcc_volts).unwrap_or(5.0);
        let uarts = read.uarts.into_iter();
        let pins = read.pins.into_iter();
        Ok(Self {
            name: read.name.into_inner(),
            about: read.about,
            mcu: read.mcu.map(Spanned::into_inner).unwrap_or_default(),
            qemu: read.qemu.map(Spanned::into_inner),
            clock_hz: read.clock_hz.into_inner(),
            vcc_volts,
            aref_volts: volts(read.aref_volts).unwrap_or(vcc_volts),
            i2c: read.i2c.map(Spanned::into_inner),
            spi: read.spi.map(Spanned::into_inner),
            uarts: uarts.map(|(name, at)| (name, at.into_inner())).collect(),
            pins: pins.map(|(name, at)| (name, at.into_inner())).collect(),
        })
    }

    /// The settings of the board for the node program.
    pub fn settings(&self) -> Value {
        let pin = |(name, pin): (&String, &Pin)| {
            let mut told = Map::new();
            told.insert("at".to_owned(), json!(pin.at));
            if let Some(channel) = pin.adc {
                told.insert("channel".to_owned(), json!(channel));
            }
            (name.clone(), Value::Object(told))
        };
        json!({
            "name": self.name,
            "mcu": self.mcu,
            "clock_hz": self.clock_hz,
            "vcc_volts": self.vcc_volts,
            "aref_volts": self.aref_volts,
            "uarts": self.uarts,
            "pins": self.pins.iter().map(pin).collect::<Map<_, _>>(),
        })
    }
}

impl BoardText {
    fn check(&self, source: &Source<'_>) -> Result<(), BoardError> {
        self.check_simulator(source)?;
        let clock = *self.clock_hz.get_ref();
        let clocks = match self.qemu {
            Some(_) => 32_768..=1_000_000_000,
            None => 32_768..=20_000_000,
        };
        if !clocks.contains(&clock) {
            let message = format!(
                "is {clock}, expected {} to {}",
                clocks.start(),
                clocks.end()
            );
            return Err(source.wrong(&self.clock_hz, "clock_hz", message));
        }
        let volts = [
            ("vcc_volts", &self.vcc_volts, 1.8),
            ("aref_volts", &self.aref_volts, 1.0),
        ];
        for (key, given, least) in volts {
            let outside = given
                .as_ref()
                .filter(|volts| !(least..=5.5).contains(volts.get_ref()));
            if let Some(volts) = outside {
                let message = format!("is {}, expected {least} to 5.5", volts.get_ref());
                return Err(source.wrong(volts, key, message));
            }
        }
        self.check_names(source)?;
        self.check_ports(source)?;
        self.check_pins(source)
    }

    /// Checks that exactly one simulator runs the board, and that a board in QEMU has no settings
    /// of other boards.
    fn check_simulator(&self, source: &Source<'_>) -> Result<(), BoardError> {
        let (mcu, qemu) = match (&self.mcu, &self.qemu) {
            (Some(mcu), None) if MCUS.contains(&&**mcu.get_ref()) => return Ok(()),
            (None, Some(qemu)) => (None, qemu),
            (Some(mcu), Some(qemu)) => (Some(mcu), qemu),
            (Some(mcu), None) => {
                let known = MCUS.join(", ");
                let message = format!("is \"{}\", expected one of {known}", mcu.get_ref());
                return Err(source.wrong(mcu, "mcu", message));
            }
            (None, None) => {
                let message =
                    "missing field `mcu` for a board in simavr, or `qemu` for one in QEMU";
                return Err(source.wrong(&self.name, "", message.to_owned()));
            }
        };
        let Machine { machine, firmware } = qemu.get_ref();
        check_name(machine).map_err(|message| source.wrong(qemu, "qemu.machine", message))?;
        let at = |part: Option<usize>, key| part.map(|at| (at, key));
        let start = |part: &Option<Spanned<String>>| part.as_ref().map(|part| part.span().start);
        let pin = self.pins.values().next().map(|pin| pin.span().start);
        let uart = self.uarts.values().next().map(|uart| uart.span().start);
        let volts = self.vcc_volts.as_ref().or(self.aref_volts.as_ref());
        let others = [
            at(mcu.map(|mcu| mcu.span().start), "mcu"),
            at(start(&self.i2c), "i2c"),
            at(start(&self.spi), "spi"),
            at(volts.map(|volts| volts.span().start), "vcc_volts"),
            at(pin, "pins"),
            at(uart.filter(|_| *firmware == Tier::Lockstep), "uarts"),
        ];
        others
            .into_iter()
            .flatten()
            .next()
            .map_or(Ok(()), |(at, key)| {
                let message = match key {
                    "uarts" => "expected none: firmware in lockstep names its ports itself",
                    _ => "expected none: a board in QEMU has UARTs only",
                };
                Err(source.error(at, key, message))
            })
    }

    fn check_names(&self, source: &Source<'_>) -> Result<(), BoardError> {
        let at = |value: &Spanned<u8>| value.span().start;
        let uarts = self.uarts.iter();
        let uarts = uarts.map(|(name, number)| ("uarts", name, at(number)));
        let pins = self.pins.iter();
        let pins = pins.map(|(name, pin)| ("pins", name, pin.span().start));
        let named = [
            ("name", Some(&self.name)),
            ("i2c", self.i2c.as_ref()),
            ("spi", self.spi.as_ref()),
        ];
        let named = named.into_iter().filter_map(|(key, name)| {
            let name = name?;
            Some((key, name.get_ref(), name.span().start))
        });
        for (key, name, at) in named.chain(uarts).chain(pins) {
            check_name(name).map_err(|message| source.error(at, key, message))?;
        }
        Ok(())
    }

    fn check_ports(&self, source: &Source<'_>) -> Result<(), BoardError> {
        let mut taken = BTreeMap::new();
        for (name, number) in &self.uarts {
            let key = format!("uarts.{name}");
            if *number.get_ref() > 3 {
                let message = format!("is {}, expected 0 to 3", number.get_ref());
                return Err(source.wrong(number, &key, message));
            }
            if let Some(other) = taken.insert(*number.get_ref(), name) {
                let message = format!("is the UART of \"{other}\" already, expected another one");
                return Err(source.wrong(number, &key, message));
            }
        }
        for (key, bus) in [("i2c", &self.i2c), ("spi", &self.spi)] {
            let twice = bus
                .as_ref()
                .filter(|bus| self.uarts.contains_key(bus.get_ref()));
            if let Some(bus) = twice {
                let message = format!("is \"{}\", which is the name of a UART", bus.get_ref());
                return Err(source.wrong(bus, key, message));
            }
        }
        Ok(())
    }

    fn check_pins(&self, source: &Source<'_>) -> Result<(), BoardError> {
        for (name, pin) in &self.pins {
            let Pin { at, adc } = pin.get_ref();
            let is_place = matches!(at.as_bytes(), [b'A'..=b'L', b'0'..=b'7']);
            if !is_place {
                let message = format!("is \"{at}\", expected a port and a bit, e.g. \"B5\"");
                return Err(source.wrong(pin, &format!("pins.{name}.at"), message));
            }
            if let Some(channel) = adc.filter(|channel| *channel > 15) {
                let message = format!("is {channel}, expected 0 to 15");
                return Err(source.wrong(pin, &format!("pins.{name}.adc"), message));
            }
        }
        if self.pins.len() > 120 {
            let message = format!("has {}, expected at most 120", self.pins.len());
            return Err(source.wrong(&self.name, "pins", message));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        Board::parse(text, "b.toml").expect_err("wrong").to_string()
    }

    /// Values from the schematics of the boards: pin 13 is B5 of the Uno, B7 of the Mega, C7 of the
    /// Leonardo; analog input 0 of the Leonardo is channel 7.
    #[test]
    fn shipped_boards_are_sound() {
        let board = |name| Board::load(name, Path::new("")).expect("is shipped");
        assert_eq!(board("arduino-uno").pins["d13"].at, "B5");
        assert_eq!(board("arduino-mega").pins["d13"].at, "B7");
        assert_eq!(board("leonardo").pins["d13"].at, "C7");
        assert_eq!(board("leonardo").pins["a0"].adc, Some(7));
        assert_eq!(board("arduino-mega").uarts.len(), 4);
        assert_eq!(board("mighty-1284p").mcu, "atmega1284p");
        // In QEMU's sources, stm32f405_soc.c gives USART1 the first serial port, UART4 the fourth.
        assert_eq!(board("netduinoplus2").uarts["uart4"], 3);
        let tiers = names().filter_map(|name| Some((name, board(name).qemu?.firmware)));
        let expected = [
            ("cortex-m4", Tier::Lockstep),
            ("mps2-an386", Tier::RealTime),
            ("netduinoplus2", Tier::RealTime),
        ];
        assert_eq!(tiers.collect::<Vec<_>>(), expected);
    }

    const SOUND: &str = "name = \"b\"\nmcu = \"atmega328p\"\nclock_hz = 8000000\n";

    #[test]
    fn an_error_names_file_line_key_and_what_was_expected() {
        assert!(Board::parse(SOUND, "b.toml").is_ok());
        let wrong = SOUND.replace("328p", "8515");
        assert!(
            error(&wrong)
                .starts_with("b.toml:2: mcu: is \"atmega8515\", expected one of atmega328p"),
            "{}",
            error(&wrong)
        );
        let cases = [
            ("clock = 1", "b.toml:4: unknown field `clock`"),
            (
                "vcc_volts = 12.0",
                "b.toml:4: vcc_volts: is 12, expected 1.8 to 5.5",
            ),
            ("[uarts]\na = 4", "b.toml:5: uarts.a: is 4, expected 0 to 3"),
            (
                "[uarts]\na = 0\nb = 0",
                "b.toml:6: uarts.b: is the UART of \"a\" already, expected another one",
            ),
            (
                "i2c = \"a\"\n[uarts]\na = 0",
                "b.toml:4: i2c: is \"a\", which is the name of a UART",
            ),
            (
                "[pins]\nd1 = { at = \"M9\" }",
                "b.toml:5: pins.d1.at: is \"M9\", expected a port and a bit, e.g. \"B5\"",
            ),
            (
                "[pins]\na1 = { at = \"C1\", adc = 16 }",
                "b.toml:5: pins.a1.adc: is 16, expected 0 to 15",
            ),
            (
                "qemu = { machine = \"m\", firmware = \"lockstep\" }",
                "b.toml:2: mcu: expected none: a board in QEMU has UARTs only",
            ),
        ];
        for (line, expected) in cases {
            let said = error(&format!("{SOUND}{line}\n"));
            assert!(said.starts_with(expected), "{said}");
        }
        assert!(error("").starts_with("b.toml:1: missing field `name`"));
        let none = SOUND.replace("mcu = \"atmega328p\"\n", "");
        assert!(
            error(&none).starts_with("b.toml:1: missing field `mcu`"),
            "{}",
            error(&none)
        );
        let lockstep = "qemu = { machine = \"m\", firmware = \"lockstep\" }\n";
        let qemu = SOUND.replace("mcu = \"atmega328p\"\n", lockstep);
        assert!(Board::parse(&qemu, "b.toml").is_ok());
        for (line, expected) in [
            (
                "i2c = \"bus\"",
                "b.toml:4: i2c: expected none: a board in QEMU",
            ),
            (
                "[uarts]\na = 0",
                "b.toml:5: uarts: expected none: firmware in lockstep",
            ),
        ] {
            let said = error(&format!("{qemu}{line}\n"));
            assert!(said.starts_with(expected), "{said}");
        }
    }

    /// Names are passed to other processes as text and compared there.
    #[test]
    fn names_are_plain_and_short() {
        let long = "x".repeat(NAME_MAX + 1);
        for name in ["a\\\"b", "a b", "é", &long] {
            for line in [
                format!("[uarts]\n\"{name}\" = 0"),
                format!("[pins]\n\"{name}\" = {{ at = \"B5\" }}"),
                format!("i2c = \"{name}\""),
            ] {
                let said = error(&format!("{SOUND}{line}\n"));
                assert!(
                    said.contains("is no name, expected 1 to 60 letters"),
                    "{said}"
                );
            }
        }
    }

    /// The chips for boards are the chips that the node program lists.
    #[test]
    fn the_node_program_knows_the_same_chips() {
        let main = include_str!("../simavr/main.c");
        let (_, list) = main.split_once("MCUS[] = {").expect("the list");
        let (list, _) = list.split_once('}').expect("its end");
        let listed: Vec<_> = list.split('"').skip(1).step_by(2).collect();
        assert_eq!(listed, MCUS);
    }

    #[test]
    fn an_unknown_board_names_the_known_ones() {
        let said = Board::load("arduino", Path::new("")).expect_err("unknown");
        assert_eq!(
            said.to_string(),
            "board \"arduino\": unknown, expected arduino-uno, arduino-mega, leonardo, \
             mighty-1284p, cortex-m4, mps2-an386, netduinoplus2 or a file that ends with .toml"
        );
    }
}
