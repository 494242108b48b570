//! `program`: a device that your own program emulates, in any language.

use core::any::Any;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::description::Description;
use emulators::world::World;
use nodes::{Drive, NUMBERS_MAX, NodeDevice, NodePort, NodeSpec, Quantity, forever, line_of};
use protocols::{LineConfig, Port};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use toml::de::ValueDeserializer;

use super::description::{LoadError, codec_of, load};
use super::{
    BuildContext, Built, DeviceKind, DeviceValue, Drives, PortInfo, Settings, ValueRow, played,
    read_settings, schema_of,
};
use crate::codec::Codec;
use crate::rig::{AnyDevice, Rig};
use crate::scenario::drives::DrivesSpec;
use crate::scenario::{ScenarioError, SourceSpec};

const EXAMPLE: &str = r#"[device.scale.program]
exec = "python3 scale.py"
rate = 9600
settings = { capacity_g = 3000 }
"#;

/// Range of accepted baud rates; others are probably mistakes.
const RATES: core::ops::RangeInclusive<u32> = 300..=4_000_000;
/// Maximum number of ports of a program.
const PORTS_MAX: usize = 64;

/// The kind `program`.
pub(super) const PROGRAM: &dyn DeviceKind = &ProgramKind;

struct ProgramKind;

/// A device that a program implements.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NodeProgramSpec {
    /// Shell command that starts the program. It runs in the scenario's folder and speaks the node
    /// protocol on its standard input and output.
    pub exec: String,
    /// Rate of its line, bit/s, 300 to 4000000; the description's if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<u32>,
    /// Data bits, parity and stop bits of its line; `8N1` if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Description of the device: a file that ends with `.toml`, relative to the scenario's folder,
    /// or one that comes with the tool, by its name. Only its line settings, frames and names are
    /// used; the program defines the behaviour.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Maximum number of bytes in one message to the program, 1 to 64; 1 if not given. A larger
    /// number is faster, but all bytes of a message arrive when the last one is complete.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 64))]
    pub piece: Option<u8>,
    /// Working directory, relative to the scenario's folder. Saved cases include it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
    /// Ports, if it has several; one called `uart` if not given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ports: Vec<NodePortSpec>,
    /// Values that the rig gives to the program, by their names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub quantities: BTreeMap<String, SourceSpec>,
    /// Actuators of the robot's chassis that follow outputs of the program, by the outputs' names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub drives: BTreeMap<String, DrivesSpec>,
    /// Names of the events that the program logs. A condition on another event of the device is an
    /// error; without this list, a rule with `never` cannot show that the name is right.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<String>,
    /// Settings for the program, sent at its start.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub settings: Map<String, Value>,
}

/// A port of a program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NodePortSpec {
    /// Its name: letters, digits, `-` and `_`.
    pub name: String,
    /// Rate of its line, bit/s, 300 to 4000000.
    #[schemars(range(min = 300, max = 4_000_000))]
    pub rate: u32,
    /// Data bits, parity and stop bits of its line; `8N1` if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
}

/// A port with all defaults applied.
struct Planned {
    port: NodePort,
    codec: Option<&'static Codec>,
}

impl NodeProgramSpec {
    /// Stores the folder `base`, so that a saved case runs in any folder.
    pub(in crate::scenario) fn embed(&mut self, base: &Path) {
        played::embed(&mut self.folder, base);
    }

    fn base(&self, context: &BuildContext<'_>) -> PathBuf {
        played::base(self.folder.as_deref(), context)
    }

    /// The description that the device names, if any.
    fn described(
        &self,
        context: &BuildContext<'_>,
    ) -> Result<Option<Arc<Description>>, ScenarioError> {
        let Some(name) = &self.description else {
            return Ok(None);
        };
        let loaded = load(name, &self.base(context));
        loaded.map(Some).map_err(|error| match error {
            LoadError::Description(error) => ScenarioError::Description(error),
            LoadError::Read(message) => {
                let span = context.source.find(context.name);
                let key = format!("{}.description", context.key());
                context.source.invalid(span, key, message)
            }
        })
    }

    fn plan(&self, context: &BuildContext<'_>) -> Result<Vec<Planned>, ScenarioError> {
        let (source, at) = (context.source, context.key());
        let wrong = |key: &str, message: String| {
            Err(source.invalid(source.find(context.name), format!("{at}{key}"), message))
        };
        let line = |key: &str, rate: u32, format: &Option<String>| {
            if !RATES.contains(&rate) {
                let (least, most) = (RATES.start(), RATES.end());
                let message = format!("is {rate}, expected {least} to {most}");
                return wrong(&format!("{key}.rate"), message).map(|()| None);
            }
            let format = format.as_deref().unwrap_or("8N1");
            let message = format!("is \"{format}\", expected e.g. 8N1, 8E1 or 7O2");
            match line_of(rate, format) {
                None => wrong(&format!("{key}.format"), message).map(|()| None),
                line => Ok(line),
            }
        };
        let described = self.described(context)?;
        let codec = described.as_ref().map(codec_of);
        let uart = |line: LineConfig| {
            let port = NodePort::uart("uart", line);
            vec![Planned { port, codec }]
        };
        if self.format.is_some() && self.rate.is_none() {
            let message =
                "is given without rate, expected rate too, or a format in each of ports".to_owned();
            return wrong(".format", message).map(|()| Vec::new());
        }
        match (&self.ports[..], self.rate, &described) {
            ([], None, Some(described)) => Ok(uart(described.line())),
            ([], Some(rate), _) => {
                let line = line("", rate, &self.format)?;
                Ok(line.map(uart).unwrap_or_default())
            }
            ([], None, None) => wrong(
                ".rate",
                "is missing, expected rate, ports or description".to_owned(),
            )
            .map(|()| Vec::new()),
            (_, Some(_), _) => wrong(
                ".rate",
                "is given together with ports, expected a rate in each of them".to_owned(),
            )
            .map(|()| Vec::new()),
            (ports, None, _) => {
                if ports.len() > PORTS_MAX {
                    let message = format!("has {}, expected at most {PORTS_MAX}", ports.len());
                    return wrong(".ports", message).map(|()| Vec::new());
                }
                let mut planned: Vec<Planned> = Vec::new();
                for (index, spec) in ports.iter().enumerate() {
                    let key = format!(".ports[{index}]");
                    let name = &spec.name;
                    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
                    if name.is_empty() || !name.chars().all(is_plain) {
                        let message =
                            format!("is \"{name}\", expected letters, digits, '-' and '_'");
                        return wrong(&format!("{key}.name"), message).map(|()| Vec::new());
                    }
                    if planned.iter().any(|other| other.port.name == *name) {
                        let message = format!("\"{name}\" is given twice, expected another name");
                        return wrong(&format!("{key}.name"), message).map(|()| Vec::new());
                    }
                    let line = line(&key, spec.rate, &spec.format)?;
                    planned.extend(line.map(|line| Planned {
                        port: NodePort::uart(name, line),
                        codec: codec.filter(|_| index == 0),
                    }));
                }
                Ok(planned)
            }
        }
    }

    fn drive_list(&self, context: &BuildContext<'_>) -> Result<Vec<Drive>, ScenarioError> {
        let drive = |(output, spec): (&String, &DrivesSpec)| {
            let sink = spec.sink().map_err(|message| {
                let key = format!("{}.drives.{output}", context.key());
                context
                    .source
                    .invalid(context.source.find(output), key, message)
            })?;
            let output = output.clone();
            Ok(Drive { output, sink })
        };
        self.drives.iter().map(drive).collect()
    }
}

impl DeviceKind for ProgramKind {
    fn name(&self) -> &'static str {
        "program"
    }

    fn about(&self) -> &'static str {
        "Device that your own program plays, in any language"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<NodeProgramSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<NodeProgramSpec>(settings)
    }

    fn drives(&self, settings: &dyn Settings) -> Option<Drives> {
        let settings: &dyn Any = settings;
        let spec = settings.downcast_ref::<NodeProgramSpec>()?;
        let drives = spec.drives.iter();
        played::driven(drives.map(|(output, spec)| (format!("drives.{output}"), spec)))
    }

    fn rows(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<ValueRow> {
        played::rows_of(rig, name)
    }

    fn values(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<DeviceValue> {
        played::values_of(rig, name)
    }

    fn value_names(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<String> {
        played::names_of(rig, name)
    }

    fn has_late_values(&self) -> bool {
        true
    }

    fn events<'a>(&self, settings: &'a dyn Settings) -> Option<&'a [String]> {
        let settings: &dyn Any = settings;
        let spec = settings.downcast_ref::<NodeProgramSpec>()?;
        Some(&*spec.events).filter(|events| !events.is_empty())
    }

    fn check(
        &self,
        context: &BuildContext<'_>,
        device: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        played::check(context, device, world)
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &NodeProgramSpec = context.settings()?;
        let planned = spec.plan(context)?;
        if spec.quantities.len() > NUMBERS_MAX {
            let (source, len) = (context.source, spec.quantities.len());
            let message = format!("has {len}, expected at most {NUMBERS_MAX}");
            let key = format!("{}.quantities", context.key());
            return Err(source.invalid(source.find(context.name), key, message));
        }
        let piece = spec.piece.unwrap_or(1);
        context.within("piece", Some(piece.into()), 1.0..=64.0)?;
        let port = |(number, planned): (u8, &Planned)| {
            let (name, line) = (forever(&planned.port.name), planned.port.line);
            let port = PortInfo::uart(name, Port(number), line, "your own program");
            let port = port.in_pieces(piece.into());
            planned.codec.map_or(port, |codec| port.speaking(codec))
        };
        let ports = (0..).zip(&planned).map(port).collect();
        let quantity = |(name, source): (&String, &SourceSpec)| Quantity {
            name: name.clone(),
            source: source.clone().into(),
        };
        let node = NodeSpec {
            folder: Some(spec.base(context)),
            seed: context.seed,
            ports: planned.into_iter().map(|planned| planned.port).collect(),
            quantities: spec.quantities.iter().map(quantity).collect(),
            drives: spec.drive_list(context)?,
            settings: spec.settings.clone(),
            description: spec.described(context)?,
            ..NodeSpec::new(context.name, &spec.exec)
        };
        Ok(Built {
            device: Box::new(NodeDevice::new(node)),
            ports,
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::scenario::Scenario;

    use super::*;

    fn error(lines: &str) -> Option<String> {
        let text = format!(
            "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
             [device.scale.program]\nexec = \"true\"\n{lines}"
        );
        let (scenario, source) = Scenario::parse(Path::new("s.toml"), text).expect("it is read");
        let built = scenario.device["scale"].build("scale", 1, &source);
        built.err().map(|error| error.to_string())
    }

    /// Rejects a coding without a rate, which would silently get another rate. Rejects too many
    /// quantities: the protocol has one byte for the number of a quantity.
    #[test]
    fn what_would_be_lost_is_refused() {
        assert_eq!(error("rate = 9600\nformat = \"7E1\"\n"), None);
        for wrong in [
            "description = \"mt-sics\"\nformat = \"7E1\"\n",
            "format = \"7E1\"\nports = [{ name = \"a\", rate = 9600 }]\n",
        ] {
            let said = error(wrong).expect(wrong);
            assert!(
                said.contains("program.format: is given without rate"),
                "{said}"
            );
        }
        let quantities = |count: usize| -> String {
            let one = |number| format!("q{number} = {{ counter = \"1s\" }}\n");
            let all: String = (0..count).map(one).collect();
            format!("rate = 9600\n[device.scale.program.quantities]\n{all}")
        };
        assert_eq!(error(&quantities(256)), None);
        let said = error(&quantities(257)).expect("too many");
        assert!(
            said.contains("quantities: has 257, expected at most 256"),
            "{said}"
        );
    }
}
