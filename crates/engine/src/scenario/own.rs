//! Small slaves that are defined in a scenario: a register table, or a simple text protocol.

mod text;

use core::time::Duration;

use emulators::quantity::{Sink, SinkKind, ValueSource, Variable, VariableError};
use emulators::registers::{Access, Register, Registers, RegistersConfig, Width};
use emulators::world::Wheel;
use protocols::LineConfig;
use protocols::avr::ChecksumOrder;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

pub use text::{CommandSpec, PeriodicSpec, TextSpec, VariableSpec};

use super::board::{BoardKeys, RaisesSpec, ResetSpec};
use super::device::{Drives, PortInfo, ValueRow};
use super::drives::DrivesSpec;
use super::{ScenarioError, Source, Span};
use crate::codec::{NamedRegister, RegisterNames};
use crate::rig::Rig;

/// Range of accepted baud rates; others are probably mistakes.
const BAUD: core::ops::RangeInclusive<u32> = 300..=4_000_000;

/// A slave with a table of registers behind the frames of the AVR base's bus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegistersSpec {
    /// Rate of its line, 8N1, bit/s, 300 to 4000000.
    #[schemars(with = "u32", range(min = 300, max = 4_000_000))]
    pub baud: Spanned<u32>,
    /// Byte order of the checksum.
    #[serde(default)]
    pub checksum: OrderSpec,
    /// Time from a request to its answer.
    #[serde(default = "default_latency")]
    pub latency: Span,
    /// Pause that ends a half-received frame.
    #[serde(default = "default_idle_gap")]
    pub idle_gap: Span,
    /// Silence of the master after which values become safe; never if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watchdog: Option<Span>,
    /// Event that resets its board: `dtr` as with an Arduino, `rts` or `break`; none if not given.
    /// The reset restores all initial values; the board receives nothing until it has started.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resets_on: Option<ResetSpec>,
    /// Boot time after a reset; 1.6 s if not given, as an Arduino Uno.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub boot: Option<Span>,
    /// Modem lines that it sets, each with the register that it follows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raises: Option<RaisesSpec>,
    /// Its values.
    #[schemars(with = "Vec<RegisterSpec>")]
    pub register: Vec<Spanned<RegisterSpec>>,
}

/// Byte orders of a checksum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OrderSpec {
    /// As in the seed document.
    #[default]
    LowFirst,
    /// As the fielded base does.
    HighFirst,
}

/// A value of the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterSpec {
    /// Address of its first, lowest byte, 0 to 255.
    pub address: u8,
    /// Name, for reports.
    pub name: String,
    /// Type of the value in the registers.
    pub width: WidthSpec,
    /// Whether a master may write it.
    #[serde(default)]
    pub access: AccessSpec,
    /// Initial value; also the start of a counter or an encoder.
    #[serde(default)]
    pub initial: i64,
    /// Minimum and maximum; the range of the width if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[i64; 2]>,
    /// Value after the watchdog time; unchanged if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub safe: Option<i64>,
    /// Source of the value.
    #[serde(default)]
    pub source: SourceSpec,
    /// Actuator of the robot's chassis that follows the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drives: Option<DrivesSpec>,
}

/// Widths as in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "each is what it says")]
pub enum WidthSpec {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
}

impl WidthSpec {
    /// The least and the greatest value.
    pub(super) fn range(self) -> [f64; 2] {
        match self {
            Self::U8 => [0.0, u8::MAX.into()],
            Self::I8 => [i8::MIN.into(), i8::MAX.into()],
            Self::U16 => [0.0, u16::MAX.into()],
            Self::I16 => [i16::MIN.into(), i16::MAX.into()],
            Self::U32 => [0.0, u32::MAX.into()],
            Self::I32 => [i32::MIN.into(), i32::MAX.into()],
        }
    }
}

/// Access as in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum AccessSpec {
    /// Only the device changes it.
    #[default]
    Read,
    /// The master may write it.
    Write,
}

/// Source of a value.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceSpec {
    /// The last written value, or the initial value.
    #[default]
    Stored,
    /// Counts up by one after each period.
    Counter(Span),
    /// Rises evenly and starts again, like a sawtooth.
    Ramp {
        /// At the beginning.
        from: i32,
        /// At the end.
        to: i32,
        /// Time of one rise.
        period: Span,
    },
    /// Counts of the encoder of this name: `left` and `right` of a differential chassis, `drive` of
    /// an Ackermann chassis.
    Encoder(String),
    /// True ground speed, millimetres per second.
    SpeedMmS,
    /// True turn rate, milliradians per second counter-clockwise.
    TurnRateMradS,
    /// 1 while the robot touches something, else 0.
    Touching,
    /// Number of collisions of the robot.
    Contacts,
    /// Encoder counts of the left wheel.
    EncoderLeft,
    /// Encoder counts of the right wheel.
    EncoderRight,
    /// True position of the robot, millimetres.
    XMm,
    /// True position of the robot, millimetres.
    YMm,
    /// True heading of the robot, milliradians.
    HeadingMrad,
    /// Distance from the middle of the robot to the nearest obstacle on the beam, millimetres.
    Range {
        /// Degrees counter-clockwise from ahead.
        angle_deg: f64,
        /// Maximum distance, millimetres; also the value without an obstacle.
        max_mm: u32,
    },
}

const fn default_latency() -> Span {
    Span(Duration::from_micros(200))
}

const fn default_idle_gap() -> Span {
    Span::from_millis(2)
}

impl From<SourceSpec> for ValueSource {
    fn from(spec: SourceSpec) -> Self {
        match spec {
            SourceSpec::Stored => Self::Stored,
            SourceSpec::Counter(period) => Self::Counter { period: period.0 },
            SourceSpec::Ramp { from, to, period } => Self::Ramp {
                from: from.into(),
                to: to.into(),
                period: period.0,
            },
            SourceSpec::Encoder(name) => Self::EncoderNamed(name),
            SourceSpec::SpeedMmS => Self::SpeedMmS,
            SourceSpec::TurnRateMradS => Self::TurnRateMradS,
            SourceSpec::Touching => Self::Touching,
            SourceSpec::Contacts => Self::Contacts,
            SourceSpec::EncoderLeft => Self::Encoder(Wheel::Left),
            SourceSpec::EncoderRight => Self::Encoder(Wheel::Right),
            SourceSpec::XMm => Self::XMm,
            SourceSpec::YMm => Self::YMm,
            SourceSpec::HeadingMrad => Self::HeadingMrad,
            SourceSpec::Range { angle_deg, max_mm } => Self::RangeMm {
                angle: angle_deg.to_radians(),
                max_mm: max_mm.into(),
            },
        }
    }
}

fn line(baud: &Spanned<u32>, key: &str, source: &Source) -> Result<LineConfig, ScenarioError> {
    let found = *baud.get_ref();
    if BAUD.contains(&found) {
        return Ok(LineConfig::new_8n1(found));
    }
    let message = format!("is {found}, expected {} to {}", BAUD.start(), BAUD.end());
    Err(source.invalid(Some(baud.span()), format!("{key}.baud"), message))
}

/// Checks the times for which 0 makes no sense. Each has its key and the effect that 0 would have.
fn check_times(
    times: &[(&str, Option<Span>, &str)],
    key: &str,
    source: &Source,
) -> Result<(), ScenarioError> {
    let zero = |(.., time, _): &&(&str, Option<Span>, &str)| *time == Some(Span::default());
    match times.iter().find(zero) {
        None => Ok(()),
        Some((name, _, what)) => {
            let message =
                format!("is 0s and would {what}, expected a longer time, or leave it out");
            Err(source.invalid(source.find(name), format!("{key}.{name}"), message))
        }
    }
}

const EXPIRES: &str = "expire at once";

impl RegistersSpec {
    /// The device; `key` is its path in the scenario.
    pub fn device(&self, key: &str, source: &Source) -> Result<Registers, ScenarioError> {
        let times = [
            ("watchdog", self.watchdog, EXPIRES),
            (
                "idle_gap",
                Some(self.idle_gap),
                "end each frame at its first byte",
            ),
        ];
        check_times(&times, key, source)?;
        let names = self.register.iter().map(|spec| &*spec.get_ref().name);
        let names: Vec<&str> = names.collect();
        let registers = self.register.iter().enumerate();
        let registers = registers.map(|(index, spec)| {
            let register = spec.get_ref().register();
            register.map_err(|message| {
                let key = format!("{key}.register[{index}].drives");
                source.invalid(Some(spec.span()), key, message)
            })
        });
        let config = RegistersConfig {
            line: line(&self.baud, key, source)?,
            order: match self.checksum {
                OrderSpec::LowFirst => ChecksumOrder::LowFirst,
                OrderSpec::HighFirst => ChecksumOrder::HighFirst,
            },
            latency: self.latency.0,
            idle_gap: self.idle_gap.0,
            watchdog: self.watchdog.map(|watchdog| watchdog.0),
            registers: registers.collect::<Result<_, _>>()?,
            board: self.board().config(&names, key, source)?,
        };
        Registers::new(config).map_err(|error| self.register_error(key, source, error))
    }

    /// Its registers by their own names, for the words of its frames.
    pub fn names(&self) -> RegisterNames {
        let named = self.register.iter().map(|register| {
            let register = register.get_ref();
            let (bytes, is_signed) = match register.width {
                WidthSpec::U8 => (1, false),
                WidthSpec::I8 => (1, true),
                WidthSpec::U16 => (2, false),
                WidthSpec::I16 => (2, true),
                WidthSpec::U32 => (4, false),
                WidthSpec::I32 => (4, true),
            };
            NamedRegister {
                address: register.address,
                bytes,
                is_signed,
                name: register.name.clone(),
                unit: String::new(),
            }
        });
        RegisterNames::new(named)
    }

    /// Its pins, without the bus.
    pub(super) fn pins(&self) -> Vec<PortInfo> {
        self.board().ports()
    }

    const fn board(&self) -> BoardKeys<'_> {
        BoardKeys {
            resets_on: self.resets_on,
            boot: self.boot,
            raises: self.raises.as_ref(),
        }
    }

    /// The first error in the registers.
    pub(super) fn register_error(
        &self,
        key: &str,
        source: &Source,
        error: VariableError,
    ) -> ScenarioError {
        let span = self.register.get(error.index).map(Spanned::span);
        let list = format!("{key}.register");
        source.invalid_entry((&list, error.index), span, &error.message)
    }

    /// Its actuators and its watchdog.
    pub(super) fn driven(&self) -> Option<Drives> {
        let registers = self.register.iter().map(Spanned::get_ref);
        driven(
            self.watchdog,
            "register",
            registers.map(|spec| (spec.drives.as_ref(), spec.limits)),
        )
    }

    /// The current register values of the device `name`, as a master would read them.
    pub(super) fn rows(&self, rig: &Rig, name: &str) -> Vec<ValueRow> {
        let device = rig.device::<Registers>(name);
        let values = device.map(|device| device.values(rig.now(), &rig.world));
        let rows = self.register.iter().zip(values.unwrap_or_default());
        let row = |(spec, value): (&Spanned<RegisterSpec>, i64)| {
            let spec = spec.get_ref();
            ValueRow::new(Some(spec.address.into()), &*spec.name, value)
        };
        rows.map(row).collect()
    }
}

/// Watchdog and actuators of the values of `list`, each with its limits; `None` without actuators.
fn driven<'a>(
    watchdog: Option<Span>,
    list: &str,
    values: impl Iterator<Item = (Option<&'a DrivesSpec>, Option<[i64; 2]>)>,
) -> Option<Drives> {
    let values = values.enumerate();
    let driven = values.filter_map(|(index, (drives, limits))| {
        let sink = drives?.sink().ok()?;
        let key = format!("{list}[{index}].drives.actuator");
        let most = limits.map(|limits| limits.map(i64::unsigned_abs).into_iter().max());
        #[expect(clippy::cast_precision_loss, reason = "limits are below 2^32")]
        let limit = most.flatten().map(|most| most as f64 * sink.scale.abs());
        // Power is a whole number of a compare register.
        let limit = limit.map(|limit| match sink.kind {
            SinkKind::Power => limit.min(255.0).round(),
            SinkKind::Speed | SinkKind::Angle => limit,
        });
        Some(((sink.actuator, limit), (key, drives?.actuator.span())))
    });
    let (actuators, places): (Vec<_>, Vec<_>) = driven.unzip();
    (!actuators.is_empty()).then(|| Drives {
        silence_max: watchdog.map(|watchdog| watchdog.0),
        actuators,
        places,
    })
}

fn sink(drives: Option<&DrivesSpec>) -> Result<Option<Sink>, String> {
    drives.map(DrivesSpec::sink).transpose()
}

impl RegisterSpec {
    fn register(&self) -> Result<Register, String> {
        let width = match self.width {
            WidthSpec::U8 => Width::U8,
            WidthSpec::I8 => Width::I8,
            WidthSpec::U16 => Width::U16,
            WidthSpec::I16 => Width::I16,
            WidthSpec::U32 => Width::U32,
            WidthSpec::I32 => Width::I32,
        };
        Ok(Register {
            address: self.address,
            width,
            access: match self.access {
                AccessSpec::Read => Access::Read,
                AccessSpec::Write => Access::Write,
            },
            variable: Variable {
                name: self.name.clone(),
                initial: self.initial,
                limits: self.limits.unwrap_or(width.limits()),
                safe: self.safe,
                source: self.source.clone().into(),
                drives: sink(self.drives.as_ref())?,
            },
        })
    }
}
