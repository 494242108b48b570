//! `description`: a device that a file describes, or several of them on one wire.

mod codec;
mod load;
mod spec;

use core::any::Any;

use ::description::value::Value;
use ::description::wire::Wire;
use ::description::{Described, Place};
use emulators::device::Device as _;
use schemars::{Schema, SchemaGenerator};
use toml::de::ValueDeserializer;

use super::{
    BuildContext, Built, DeviceKind, DeviceValue, PortInfo, Settings, ValueRow, read_settings,
    schema_of,
};
use crate::rig::Rig;
use crate::scenario::{Operand, ScenarioError};

pub use codec::codec_of;
use codec::codec_of_all;
pub use load::{LoadError, load};
pub use spec::{DescriptionSpec, UnitSpec};

const EXAMPLE: &str = "[device]\nmeter = { description = \"modbus-meter\" }\n";

/// The kind `description`.
pub(super) const DESCRIPTION: &dyn DeviceKind = &DescriptionKind;

struct DescriptionKind;

impl DeviceKind for DescriptionKind {
    fn name(&self) -> &'static str {
        "description"
    }

    fn about(&self) -> &'static str {
        "Device that a file describes, or several on one wire"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<DescriptionSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<DescriptionSpec>(settings)
    }

    fn rows(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<ValueRow> {
        let device = rig.device::<Wire>(name);
        let values = device.map(|device| device.values(rig.now(), &rig.world));
        let rows = values.unwrap_or_default().into_iter();
        let rows = rows.filter_map(|(address, name, value, words)| {
            let whole = match &value {
                Value::Bytes(_) | Value::List(_) | Value::Record(_) => return None,
                Value::Text(_) => 0,
                number => number.as_int().and_then(|int| i64::try_from(int).ok())?,
            };
            let is_plain = words.parse::<i64>().is_ok() && !matches!(value, Value::Text(_));
            Some(ValueRow {
                shown: (!is_plain).then_some(words),
                ..ValueRow::new(address, name, whole)
            })
        });
        rows.collect()
    }

    fn values(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<DeviceValue> {
        let device = rig.device::<Wire>(name);
        let values = device.map(|device| device.values(rig.now(), &rig.world));
        let values = values.unwrap_or_default().into_iter();
        let value = |(address, name, value, words): (_, _, Value, String)| {
            // A number with a name, e.g. of a state, is compared as that name.
            let named = words.split(' ').next().map(Operand::from_words);
            let value = match (&value, value.as_f64(), named) {
                (Value::Bool(is), ..) => Operand::Flag(*is),
                (_, Some(_), Some(Operand::Text(name))) if name == words => Operand::Text(name),
                (_, Some(number), _) => Operand::Number(number),
                (Value::Text(text), ..) => Operand::Text(text.clone()),
                (other, ..) => Operand::Text(other.to_string()),
            };
            DeviceValue {
                address,
                name,
                value,
            }
        };
        values.map(value).collect()
    }

    fn own_rules(&self, rig: &Rig, name: &str) -> Vec<&'static str> {
        rig.device::<Wire>(name).map_or(Vec::new(), Wire::own_rules)
    }

    fn names_of_value<'a>(&self, rig: &'a Rig, name: &str, value: &str) -> Option<Vec<&'a str>> {
        rig.device::<Wire>(name)?.names_of_value(value)
    }

    fn set(&self, rig: &mut Rig, name: &str, value: &str, to: &Operand) -> Result<(), String> {
        let to = match to {
            Operand::Flag(is) => Value::Bool(*is),
            Operand::Text(text) => Value::Text(text.clone()),
            Operand::Number(number) => match to.whole() {
                Ok(whole) => Value::Int(whole.into()),
                Err(_) => Value::Float(*number),
            },
        };
        let device = rig.device_mut::<Wire>(name);
        device.map_or(Ok(()), |device| device.set(value, to))
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &DescriptionSpec = context.settings()?;
        let (source, key) = (context.source, context.key());
        let at = || source.find(context.name);
        let is_alone = spec.0.len() == 1;
        let mut units: Vec<(String, Described)> = Vec::new();
        let mut lines = Vec::new();
        for unit in &spec.0 {
            let base = source.path.parent().unwrap_or_else(|| ".".as_ref());
            let description = unit.load(base).map_err(|error| match error {
                LoadError::Description(error) => ScenarioError::Description(error),
                LoadError::Read(message) => source.invalid(at(), key.clone(), message),
            })?;
            if let Some(Err(message)) = unit.address.map(|one| description.check_address(one)) {
                let span = source.find("address").filter(|_| is_alone).or_else(at);
                let key = match is_alone {
                    true => format!("{key}.address"),
                    false => format!("{key}[{}].address", units.len()),
                };
                return Err(source.invalid(span, key, message));
            }
            let name = unit
                .name
                .clone()
                .unwrap_or_else(|| description.name().to_owned());
            let place = Place {
                name: match is_alone {
                    true => context.name.to_owned(),
                    false => format!("{}.{name}", context.name),
                },
                seed: context.seed,
                address: unit.address,
                is_alone,
            };
            let device = Described::new(description.clone(), place);
            lines.push((device.address(), description));
            units.push((name, device));
        }
        let device = Wire::new(units).map_err(|error| source.invalid(at(), key, error.0))?;
        let line = device.line_config(Described::UART);
        let port = PortInfo::uart("uart", Described::UART, line, "your own program");
        let port = codec_of_all(&lines).map_or(port, |codec| port.speaking(codec));
        Ok(Built {
            device: Box::new(device),
            ports: vec![port],
        })
    }
}

/// The wire of a node with described devices; `None` for other devices.
pub fn wire_of(device: &dyn crate::rig::AnyDevice) -> Option<&Wire> {
    let device: &dyn Any = device;
    device.downcast_ref()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::scenario::Scenario;

    /// No Modbus device answers at these addresses; the error names the key and the line.
    #[test]
    fn an_address_of_no_device_is_refused() {
        let unit = |address: u32| {
            format!("{{ file = \"modbus-meter\", name = \"m{address}\", address = {address} }}")
        };
        for (device, key) in [
            (unit(0), Some("5: device.bus.description.address: is 0,")),
            (
                unit(248),
                Some("5: device.bus.description.address: is 248,"),
            ),
            (
                format!("[{}, {}]", unit(17), unit(300)),
                Some("5: device.bus.description[1].address: is 300,"),
            ),
            (format!("[{}, {}]", unit(17), unit(247)), None),
        ] {
            let text = format!(
                "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                 device.bus = {{ description = {device} }}\n"
            );
            let (scenario, source) =
                Scenario::parse(Path::new("s.toml"), text).expect("it is read");
            let built = scenario.device["bus"].build("bus", 1, &source);
            let error = built.err().map(|error| error.to_string());
            let is_right = match (&error, key) {
                (Some(error), Some(key)) => {
                    error.contains(key) && error.contains("expected 1 to 247")
                }
                (error, key) => error.is_none() && key.is_none(),
            };
            assert!(is_right, "{device}: {error:?}");
        }
    }
}
