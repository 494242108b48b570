//! The scenario's view of a kind of device.

use core::any::Any;
use core::fmt::Debug;
use core::ops::{Range, RangeInclusive};
use core::time::Duration;

use emulators::world::World;
use protocols::{LineConfig, Port};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::DeserializeOwned;
use toml::de::ValueDeserializer;

use crate::codec::Codec;
use crate::rig::{AnyDevice, LinkKind, PortRate, Rig};
use crate::scenario::device::scan::ScanDecoder;
use crate::scenario::{Operand, ScenarioError, Source};

/// A kind of device that a scenario can name, as in `[device.NAME.KIND]`.
///
/// Kinds are found by name; [`register`](super::register) adds one from another crate. The scenario
/// reads, keeps and writes settings without knowing their type.
pub trait DeviceKind: Send + Sync {
    /// Name in scenarios, in kebab case; never changes.
    fn name(&self) -> &'static str;

    /// One-line description without a full stop, e.g. `Neato XV-11 lidar`.
    fn about(&self) -> &'static str;

    /// JSON Schema of its settings, usually [`schema_of`].
    fn schema(&self, generator: &mut SchemaGenerator) -> Schema;

    /// An example of its tables in a scenario, for the reference. With a robot and a world, the
    /// example runs.
    fn example(&self) -> &'static str {
        ""
    }

    /// Reads its settings, usually with [`read_settings`]. A robot with such a device but without
    /// settings passes an empty table.
    ///
    /// # Errors
    /// If a key is unknown or missing, or a value has the wrong type; the error contains the
    /// position.
    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error>;

    /// Whether the scenario describes the device completely, so that any robot can have it on its
    /// own links. Otherwise the robot must support it.
    fn is_own(&self) -> bool {
        true
    }

    /// Decoder of the turns on the first port, for a lidar.
    fn scanner(&self, _settings: &dyn Settings) -> Option<Box<dyn ScanDecoder>> {
        None
    }

    /// Its actuators of the chassis and its watchdog; `None` without actuators.
    fn drives(&self, _settings: &dyn Settings) -> Option<Drives> {
        None
    }

    /// Values for display, if `device` is of this kind.
    fn rows(&self, _settings: &dyn Settings, _rig: &Rig, _name: &str) -> Vec<ValueRow> {
        Vec::new()
    }

    /// Values by their plain names, for conditions: those of [`rows`](Self::rows) by default.
    fn values(&self, settings: &dyn Settings, rig: &Rig, name: &str) -> Vec<DeviceValue> {
        let rows = self.rows(settings, rig, name).into_iter();
        rows.map(DeviceValue::from).collect()
    }

    /// Names of its [`values`](Self::values), also of those that it has declared but not shown yet.
    fn value_names(&self, settings: &dyn Settings, rig: &Rig, name: &str) -> Vec<String> {
        let values = self.values(settings, rig, name).into_iter();
        values.map(|value| value.name).collect()
    }

    /// Rules that the device `name` logs besides those of its kind.
    fn own_rules(&self, _rig: &Rig, _name: &str) -> Vec<&'static str> {
        Vec::new()
    }

    /// The names of the values that `value` of the device `name` can have; `None` if it can have
    /// others, or if they are unknown.
    fn names_of_value<'a>(&self, _rig: &'a Rig, _name: &str, _value: &str) -> Option<Vec<&'a str>> {
        None
    }

    /// Whether the names of its [`values`](Self::values) are known only after the run has started.
    fn has_late_values(&self) -> bool {
        false
    }

    /// Names of the events that its settings declare; `None` if they declare none.
    fn events<'a>(&self, _settings: &'a dyn Settings) -> Option<&'a [String]> {
        None
    }

    /// Sets the value called `value` of the device `name`.
    ///
    /// # Errors
    /// The reason why the value cannot be set.
    fn set(&self, rig: &mut Rig, name: &str, value: &str, to: &Operand) -> Result<(), String> {
        let _ = (rig, value, to);
        Err(format!("{name} has no values that a step can set"))
    }

    /// Checks that `world` contains the actuators and encoders named in the settings.
    ///
    /// # Errors
    /// If an actuator or encoder does not exist.
    fn check(
        &self,
        _context: &BuildContext<'_>,
        _device: &dyn AnyDevice,
        _world: &World,
    ) -> Result<(), ScenarioError> {
        Ok(())
    }

    /// Makes the device.
    ///
    /// # Errors
    /// If a setting is out of range.
    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError>;
}

/// Settings of a device with any type: a plain value that can be written to a file.
pub trait Settings: Any + Debug + Send + Sync + erased_serde::Serialize {
    /// Clones the settings.
    fn boxed_clone(&self) -> Box<dyn Settings>;

    /// Whether `other` is of the same type and equal.
    fn equals(&self, other: &dyn Settings) -> bool;
}

impl<T: Any + Debug + Send + Sync + Clone + PartialEq + serde::Serialize> Settings for T {
    fn boxed_clone(&self) -> Box<dyn Settings> {
        Box::new(self.clone())
    }

    fn equals(&self, other: &dyn Settings) -> bool {
        let other: &dyn Any = other;
        other.downcast_ref() == Some(self)
    }
}

/// Reads settings of the type `T`.
///
/// # Errors
/// As `T` says.
pub fn read_settings<T: Settings + DeserializeOwned>(
    settings: ValueDeserializer<'_>,
) -> Result<Box<dyn Settings>, toml::de::Error> {
    T::deserialize(settings).map(|settings| Box::new(settings) as Box<dyn Settings>)
}

/// JSON Schema of settings of the type `T`.
pub fn schema_of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    generator.subschema_for::<T>()
}

/// The input for making a device.
#[derive(Clone, Copy, Debug)]
pub struct BuildContext<'a> {
    /// Name of the device, which chooses its random stream.
    pub name: &'a str,
    /// Seed of the run.
    pub seed: u64,
    /// Its settings, as its kind read them.
    pub settings: &'a dyn Settings,
    /// Name of its kind.
    pub kind: &'static str,
    /// The scenario's file, for messages.
    pub source: &'a Source,
    /// Whether the device is on a robot; without a robot it senses nothing.
    pub has_robot: bool,
}

impl BuildContext<'_> {
    /// The settings with their own type.
    ///
    /// # Errors
    /// If the settings belong to another kind.
    pub fn settings<T: Settings>(&self) -> Result<&T, ScenarioError> {
        let settings: &dyn Any = self.settings;
        settings.downcast_ref().ok_or_else(|| {
            let message = format!("expected the settings of {}", self.kind);
            self.source
                .invalid(self.source.find(self.name), self.key(), message)
        })
    }

    /// Checks that the robot of `world` has the encoder `name`, which this device counts.
    ///
    /// # Errors
    /// If the encoder does not exist; the error lists the existing ones. Without a robot nothing
    /// turns, and any name is accepted.
    pub fn needs_encoder(&self, name: &str, world: &World) -> Result<(), ScenarioError> {
        let encoders = world.encoders();
        if !self.has_robot || encoders.iter().any(|encoder| encoder.name == name) {
            return Ok(());
        }
        let known: Vec<&str> = encoders.iter().map(|encoder| &*encoder.name).collect();
        let known = match known.as_slice() {
            [] => "no encoder".to_owned(),
            known => format!("\"{}\"", known.join("\", \"")),
        };
        let message = format!("counts the encoder \"{name}\", and the chassis has {known}");
        let span = self.source.find(self.name);
        Err(self.source.invalid(span, self.key(), message))
    }

    /// Path of the device in the scenario, e.g. `device.lidar.xv11`.
    pub fn key(&self) -> String {
        format!("device.{}.{}", self.name, self.kind)
    }

    /// Checks that the setting `key`, if given, is within `range`.
    ///
    /// # Errors
    /// If the value is out of range or not a number; the error contains the key and the range.
    pub fn within(
        &self,
        key: &str,
        value: Option<f64>,
        range: RangeInclusive<f64>,
    ) -> Result<(), ScenarioError> {
        let Some(found) = value.filter(|found| !range.contains(found)) else {
            return Ok(());
        };
        let (least, most) = (*range.start(), *range.end());
        let message = format!("is {found}, expected {least} to {most}");
        let name = key.split('.').next().unwrap_or(key);
        let (source, at) = (self.source, self.key());
        Err(source.invalid(source.find(name), format!("{at}.{key}"), message))
    }
}

/// The actuators of a device.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drives {
    /// Silence of the master after which the device stops all actuators; `None` without a watchdog.
    pub silence_max: Option<Duration>,
    /// Names of the actuators, each with the device's limit of the absolute set-point in the
    /// actuator's unit, if there is one.
    pub actuators: Vec<(String, Option<f64>)>,
    /// Key in the device's settings, and position in the file, of each of `actuators`.
    pub places: Vec<(String, Range<usize>)>,
}

/// A value of a device, for page and report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ValueRow {
    /// Its address in the device, if it has one.
    pub address: Option<u32>,
    /// Its name.
    pub name: String,
    /// Its current value.
    pub value: i64,
    /// The value as text with its unit, if it is not a plain whole number.
    pub shown: Option<String>,
}

impl ValueRow {
    /// A row of a whole number.
    pub fn new(address: Option<u32>, name: impl Into<String>, value: i64) -> Self {
        Self {
            address,
            name: name.into(),
            value,
            shown: None,
        }
    }

    /// The value as text, and its unit: `230.4` and `V`.
    pub fn value_and_unit(&self) -> (String, String) {
        let Some(shown) = &self.shown else {
            return (self.value.to_string(), String::new());
        };
        match shown.split_once(' ') {
            Some((value, unit)) if value.parse::<f64>().is_ok() => (value.into(), unit.into()),
            _ => (shown.clone(), String::new()),
        }
    }
}

/// A value of a device, for conditions.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceValue {
    /// Its address in the device, if it has one.
    pub address: Option<u32>,
    /// Its name.
    pub name: String,
    /// Its current value.
    pub value: Operand,
}

impl From<ValueRow> for DeviceValue {
    fn from(row: ValueRow) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "a condition compares numbers")]
        let value = row.value as f64;
        Self {
            address: row.address,
            name: row.name,
            value: Operand::Number(value),
        }
    }
}

/// A device and its connections.
pub struct Built {
    /// The device.
    pub device: Box<dyn AnyDevice>,
    /// Its ports; the first one is the main port, on the link with the device's name.
    pub ports: Vec<PortInfo>,
}

impl Built {
    /// The port called `name`.
    pub fn port(&self, name: &str) -> Option<PortInfo> {
        self.ports.iter().copied().find(|port| port.name == name)
    }
}

/// A port of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortInfo {
    /// Its name, e.g. `uart`.
    pub name: &'static str,
    /// The device's number of the port.
    pub port: Port,
    /// Coding of its line.
    pub line: LineConfig,
    /// Bytes that are delivered at once, see [`Line::piece`](crate::rig::line::Line::piece).
    pub piece: usize,
    /// Description of the program that connects here, for messages.
    pub connect: &'static str,
    /// Whether the other end may leave the port closed.
    pub is_optional: bool,
    /// Type of its link.
    pub kind: LinkKind,
    /// The accepted baud rates of a client at the other end.
    pub rate: PortRate,
    /// Protocol of the port, if the device fixes it.
    pub codec: Option<&'static Codec>,
    /// Whether the port is the master's end of its link: the device is at the other end.
    pub is_master: bool,
}

impl PortInfo {
    /// A required serial port whose bytes are delivered one by one.
    pub const fn uart(
        name: &'static str,
        port: Port,
        line: LineConfig,
        connect: &'static str,
    ) -> Self {
        Self {
            name,
            port,
            line,
            piece: 1,
            connect,
            is_optional: false,
            kind: LinkKind::Uart,
            rate: PortRate::OfLine,
            codec: None,
            is_master: false,
        }
    }

    /// The same at the master's end of its link.
    pub const fn of_master(self) -> Self {
        Self {
            is_master: true,
            ..self
        }
    }

    /// The same with up to `piece` bytes delivered at once.
    pub const fn in_pieces(self, piece: usize) -> Self {
        Self { piece, ..self }
    }

    /// The same, but the other end may leave the port closed.
    pub const fn optional(self) -> Self {
        Self {
            is_optional: true,
            ..self
        }
    }

    /// The same with the protocol of `codec`.
    pub const fn speaking(self, codec: &'static Codec) -> Self {
        Self {
            codec: Some(codec),
            ..self
        }
    }

    /// A port that accepts any rate of the client; the rate is `usual` until the client sets one.
    pub const fn at_any_rate(self, usual: LineConfig) -> Self {
        let rate = PortRate::Any { usual };
        Self { rate, ..self }
    }

    /// The same on a link of `kind`.
    pub const fn on(self, kind: LinkKind) -> Self {
        Self { kind, ..self }
    }
}
