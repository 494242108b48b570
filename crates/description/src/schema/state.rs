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
    /// Unit, for display.
    #[serde(default)]
    pub unit: String,
    /// Names of values: the name of a table of `[enums]`.
    #[serde(default, rename = "enum")]
    pub names: Option<String>,
    /// Least and greatest value.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// The source of the value; the last written value if not given.
    #[serde(default)]
    pub source: Option<SourceSpec>,
    /// An expression over other variables that computes the value.
    #[serde(default)]
    pub value: Option<String>,
    /// Value after the watchdog time.
    #[serde(default)]
    pub safe: Option<Plain>,
    /// Keeps its value when the device restarts.
    #[serde(default)]
    pub keeps: bool,
    /// A description of the variable, for display.
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

/// The source of a value.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceSpec {
    /// The last written value, or the initial value.
    Stored,
    /// Counts up by one in each period.
    Counter(Span),
    /// Changes evenly from one value to another, repeatedly.
    Ramp {
        /// Value at the beginning.
        from: f64,
        /// Value at the end.
        to: f64,
        /// Time of one rise.
        period: Span,
    },
    /// A sine.
    Sine {
        /// Mean value.
        mean: f64,
        /// Greatest deviation from the mean.
        amplitude: f64,
        /// Period of the wave.
        period: Span,
    },
    /// Normally distributed values, selected by the run's seed.
    Noise {
        /// Mean value.
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
        /// Repeats the recording; the last value stays if not given.
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
    /// Distance ahead from the robot's centre to the nearest obstacle, metres, at most 10.
    RangeM,
    /// Number of collisions of the robot.
    Contacts,
}

/// Registers: Modbus' four tables, or one of bytes.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegistersSpec {
    /// Byte order of values; if not given, big for Modbus and little for a table of bytes.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Word order of values in several registers; the same as `endian` if not given.
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
    /// Function codes that the device knows; if not given, all codes with a table.
    #[serde(default)]
    pub functions: Vec<u8>,
    /// Addresses without a register read as 0 and accept writes, instead of causing an error.
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
    /// Type, as for fields; `u16` if not given.
    #[serde(default, rename = "type")]
    pub kind: Option<String>,
    /// Number of bytes of a `str`.
    #[serde(default)]
    pub size: Option<u16>,
    /// Whether the driver may write the register.
    #[serde(default)]
    pub access: Option<Access>,
    /// Byte order of the register.
    #[serde(default)]
    pub endian: Option<Endian>,
    /// Word order of the register.
    #[serde(default)]
    pub words: Option<Endian>,
    /// Value of one count: the value is count * scale + offset.
    #[serde(default)]
    pub scale: Option<f64>,
    /// The value of count 0.
    #[serde(default)]
    pub offset: Option<f64>,
    /// Unit of the value, for display.
    #[serde(default)]
    pub unit: String,
    /// Names of values: the name of a table of `[enums]`.
    #[serde(default, rename = "enum")]
    pub names: Option<String>,
    /// Least and greatest accepted value.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Value at the start; 0 if not given.
    #[serde(default)]
    pub initial: Option<Plain>,
    /// The source of the value.
    #[serde(default)]
    pub source: Option<SourceSpec>,
    /// An expression over variables and other registers that computes the value.
    #[serde(default)]
    pub value: Option<String>,
    /// Value after the watchdog time.
    #[serde(default)]
    pub safe: Option<Plain>,
    /// Keeps its value when the device restarts.
    #[serde(default)]
    pub keeps: bool,
    /// A description of the register, for display.
    #[serde(default)]
    pub about: String,
}

/// Access to a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Access {
    /// Only the device changes the register.
    Read,
    /// The driver may write the register too.
    Write,
}
