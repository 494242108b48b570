//! `[state]` and `[registers]`.

use schemars::JsonSchema;
use serde::Deserialize;

use super::short::{FromPlain, Plain};
use super::wire::Endian;
use crate::value::Value;
use span::Span;

/// A variable; its initial value is the short form.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StateSpec {
    /// Value at the start; 0 if not given.
    #[serde(default)]
    pub initial: Option<Plain>,
    /// Unit, for people.
    #[serde(default)]
    pub unit: String,
    /// Least and greatest value.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Where it comes from; what was written last if not given.
    #[serde(default)]
    pub source: Option<SourceSpec>,
    /// An expression over other variables that it always is.
    #[serde(default)]
    pub value: Option<String>,
    /// Value after the watchdog time.
    #[serde(default)]
    pub safe: Option<Plain>,
    /// It keeps its value when the device starts again.
    #[serde(default)]
    pub keeps: bool,
    /// What it is, for people.
    #[serde(default)]
    pub about: String,
}

impl FromPlain for StateSpec {
    const EXPECTED: &'static str = "the initial value, or a table";

    fn from_plain(value: Value) -> Option<Self> {
        let initial = Some(Plain(value));
        Some(Self {
            initial,
            ..Self::default()
        })
    }
}

/// Where a value comes from.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceSpec {
    /// What was written last, or the initial value.
    Stored,
    /// Counts one up each such time.
    Counter(Span),
    /// Goes evenly from one value to another, again and again.
    Ramp {
        /// At the beginning.
        from: f64,
        /// At the end.
        to: f64,
        /// Time of one rise.
        period: Span,
    },
    /// A sine.
    Sine {
        /// In the middle.
        mean: f64,
        /// Greatest distance from there.
        amplitude: f64,
        /// Time of one wave.
        period: Span,
    },
    /// Values around another, by the run's seed.
    Noise {
        /// In the middle.
        mean: f64,
        /// Standard deviation.
        deviation: f64,
        /// Time for which a value stays; 100 ms if not given.
        #[serde(default)]
        period: Option<Span>,
    },
    /// A column of a CSV file, beside the description, whose first column is the time in seconds.
    Csv {
        /// The file.
        file: String,
        /// Name of the column in the first line.
        column: String,
        /// Begins anew at the end; the last value stays if not given.
        #[serde(default)]
        repeats: bool,
    },
    /// A quantity of the simulated world.
    World(WorldQuantity),
}

/// Quantities of the simulated world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WorldQuantity {
    /// True position of the robot, metres.
    XM,
    /// True position of the robot, metres.
    YM,
    /// True heading of the robot, degrees counter-clockwise.
    HeadingDeg,
    /// True speed over the floor, metres per second.
    SpeedMS,
    /// True turn rate, degrees per second counter-clockwise.
    TurnRateDegS,
    /// Distance to what is ahead of the robot's middle, metres, at most 10.
    RangeM,
    /// Times that the robot ran into something.
    Contacts,
}

/// Registers: Modbus' four tables, or one of bytes.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegistersSpec {
    /// Order of the bytes of values; big for Modbus, little for a table of bytes if not given.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Order of the words of values with several registers; as `endian` if not given.
    #[serde(default)]
    pub words: Option<Endian>,
    /// Modbus coils: bits that can be written.
    #[serde(default)]
    pub coils: Vec<RegisterSpec>,
    /// Modbus discrete inputs: bits.
    #[serde(default)]
    pub discrete: Vec<RegisterSpec>,
    /// Modbus input registers.
    #[serde(default)]
    pub input: Vec<RegisterSpec>,
    /// Modbus holding registers, which can be written unless `access = "read"`.
    #[serde(default)]
    pub holding: Vec<RegisterSpec>,
    /// A table of bytes for protocols with frames of their own.
    #[serde(default)]
    pub bytes: Vec<RegisterSpec>,
    /// Function codes that the device knows; all for which there are tables if not given.
    #[serde(default)]
    pub functions: Vec<u8>,
    /// Addresses without a register read 0 and take writes, instead of an error.
    #[serde(default)]
    pub gaps: bool,
}

/// A register.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterSpec {
    /// Address of its first register or byte, as on the wire.
    pub at: u32,
    /// Name; expressions read and write it as a variable.
    pub name: String,
    /// Type as of fields; `u16` if not given.
    #[serde(default, rename = "type")]
    pub kind: Option<String>,
    /// Bytes of a `str`.
    #[serde(default)]
    pub size: Option<u16>,
    /// Whether the driver may write it.
    #[serde(default)]
    pub access: Option<Access>,
    /// Order of its bytes.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Order of its words.
    #[serde(default)]
    pub words: Option<Endian>,
    /// What one count is worth: the value is count * scale + offset.
    #[serde(default)]
    pub scale: Option<f64>,
    /// The value of count 0.
    #[serde(default)]
    pub offset: Option<f64>,
    /// Unit of the value, for people.
    #[serde(default)]
    pub unit: String,
    /// Names of values: the name of a table of `[enums]`.
    #[serde(default, rename = "enum")]
    pub names: Option<String>,
    /// Least and greatest value that is taken.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Value at the start; 0 if not given.
    #[serde(default)]
    pub initial: Option<Plain>,
    /// Where it comes from.
    #[serde(default)]
    pub source: Option<SourceSpec>,
    /// An expression over variables and other registers that it always is.
    #[serde(default)]
    pub value: Option<String>,
    /// Value after the watchdog time.
    #[serde(default)]
    pub safe: Option<Plain>,
    /// It keeps its value when the device starts again.
    #[serde(default)]
    pub keeps: bool,
    /// What it is, for people.
    #[serde(default)]
    pub about: String,
}

/// Access to a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Access {
    /// The device only.
    Read,
    /// The driver too.
    Write,
}
