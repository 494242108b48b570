//! `master`: the host's side of a described device, which polls a device of the scenario or your
//! own program.

use ::description::master::{Master, MasterPlan};
use ::description::value::Value;
use emulators::device::Device as _;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use span::Span;
use std::path::Path;
use toml::de::ValueDeserializer;

use super::description::{DescriptionSpec, LoadError, codec_of};
use super::{
    BuildContext, Built, DeviceKind, DeviceValue, PortInfo, Settings, ValueRow, read_settings,
    schema_of,
};
use crate::rig::Rig;
use crate::scenario::{Operand, ScenarioError};

const EXAMPLE: &str = r#"[device]
meter = { description = "modbus-meter" }
plc = { master = { description = "modbus-meter", of = "meter", requests = ["read voltage"] } }
"#;

/// Shortest period and timeout.
const TIME_MIN: Span = Span::from_millis(1);

/// The kind `master`.
pub(super) const MASTER: &dyn DeviceKind = &MasterKind;

struct MasterKind;

/// A master that polls a described device. It reports missing and wrong replies as violations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MasterSpec {
    /// Description of the device that it polls, as for a described device; one, not a list.
    pub description: DescriptionSpec,
    /// Name of the device of this scenario that it polls. If not given, it polls the program at the
    /// port with the master's name: your own device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
    /// Requests in words, as for `hilrig talk`, e.g. `read voltage`; sent in turn.
    pub requests: Vec<String>,
    /// Time from a request to the next one.
    #[serde(default = "default_period")]
    pub period: Span,
    /// Time from the end of a request within which its reply must be complete.
    #[serde(default = "default_timeout")]
    pub timeout: Span,
}

const fn default_period() -> Span {
    Span::from_millis(1_000)
}

const fn default_timeout() -> Span {
    Span::from_millis(500)
}

impl MasterSpec {
    /// Includes the text of the description relative to the folder `base`.
    pub(in crate::scenario) fn embed(&mut self, base: &Path) {
        self.description.embed(base);
    }

    fn plan(&self) -> MasterPlan {
        MasterPlan {
            requests: self.requests.clone(),
            period: self.period.0,
            timeout: self.timeout.0,
        }
    }
}

impl DeviceKind for MasterKind {
    fn name(&self) -> &'static str {
        "master"
    }

    fn about(&self) -> &'static str {
        "Host that polls a described device, or your own program in its place"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<MasterSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<MasterSpec>(settings)
    }

    fn rows(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<ValueRow> {
        let values = rig.device::<Master>(name).map(Master::values);
        let rows = values.into_iter().flatten();
        let rows = rows.filter_map(|(name, value, words)| {
            let whole = match value {
                Value::Bytes(_) | Value::List(_) | Value::Record(_) => return None,
                Value::Text(_) => 0,
                number => number.as_int().and_then(|int| i64::try_from(int).ok())?,
            };
            let is_plain = words.parse::<i64>().is_ok() && !matches!(value, Value::Text(_));
            Some(ValueRow {
                shown: (!is_plain).then(|| words.clone()),
                ..ValueRow::new(None, name.as_str(), whole)
            })
        });
        rows.collect()
    }

    fn values(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<DeviceValue> {
        let values = rig.device::<Master>(name).map(Master::values);
        let values = values.into_iter().flatten();
        let values = values.map(|(name, value, words)| DeviceValue {
            address: None,
            name: name.clone(),
            value: match value {
                Value::Bool(is) => Operand::Flag(*is),
                Value::Text(text) => Operand::Text(text.clone()),
                other => match other.as_f64() {
                    Some(number) => Operand::Number(number),
                    None => Operand::Text(words.clone()),
                },
            },
        });
        values.collect()
    }

    fn has_late_values(&self) -> bool {
        true
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &MasterSpec = context.settings()?;
        let (source, key) = (context.source, context.key());
        let wrong = |part: &str, message: String| {
            let span = source.find(part).or_else(|| source.find(context.name));
            source.invalid(span, format!("{key}.{part}"), message)
        };
        let [unit] = &spec.description.0[..] else {
            let message = "is a list, expected one description: a master polls one device";
            return Err(wrong("description", message.to_owned()));
        };
        for (part, span) in [("period", spec.period), ("timeout", spec.timeout)] {
            if span.0 < TIME_MIN.0 {
                return Err(wrong(
                    part,
                    format!("is {span}, expected {TIME_MIN} at least"),
                ));
            }
        }
        let base = source.path.parent().unwrap_or_else(|| ".".as_ref());
        let description = unit.load(base).map_err(|error| match error {
            LoadError::Description(error) => ScenarioError::Description(error),
            LoadError::Read(message) => wrong("description", message),
        })?;
        let description = match unit.address {
            None => description,
            Some(address) => description
                .with_address(address)
                .map_err(|message| wrong("description.address", message))?,
        };
        let codec = codec_of(&description);
        let master = Master::new(description, &spec.plan());
        let master = master.map_err(|(index, message)| {
            let part = format!("requests[{index}]");
            let span = source.find("requests");
            source.invalid(span, format!("{key}.{part}"), message)
        })?;
        let line = master.line_config(Master::UART);
        let port = PortInfo::uart("uart", Master::UART, line, "your own device");
        Ok(Built {
            device: Box::new(master),
            ports: vec![port.speaking(codec).of_master()],
        })
    }
}
