//! `firmware`: a device whose own firmware, an ELF file, runs on a simulated board.

use core::any::Any;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ::boards::{Board, check_name, program};
use emulators::world::World;
use nodes::{Drive, NUMBERS_MAX, NodeDevice, NodePort, NodeSpec, Quantity, Role, forever};
use protocols::{LineConfig, Port};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use toml::de::ValueDeserializer;

use super::{
    BuildContext, Built, DeviceKind, DeviceValue, Drives, PortInfo, Settings, ValueRow, played,
    read_settings, schema_of,
};
use crate::rig::{AnyDevice, Rig};
use crate::scenario::drives::DrivesSpec;
use crate::scenario::{ScenarioError, SourceSpec};

/// Maximum number of motor drivers, and of encoders.
const PARTS_MAX: usize = 8;
/// Maximum length of the path of an ELF file.
const PATH_MAX: usize = 4_095;

/// The kind `firmware`.
pub(super) const FIRMWARE: &dyn DeviceKind = &FirmwareKind;

struct FirmwareKind;

/// A device whose firmware runs on a simulated board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FirmwareSpec {
    /// The firmware: an ELF file, relative to the scenario's folder.
    pub elf: PathBuf,
    /// The board: `arduino-uno`, `arduino-mega`, `leonardo`, `mighty-1284p`, or a file that ends
    /// with `.toml`, relative to the scenario's folder.
    pub board: String,
    /// UARTs of the board that are ports of the device; the board's first UART if not given. The
    /// first one is the device's link. Bytes of other UARTs go to the log.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ports: Vec<String>,
    /// Rate of its lines until the firmware sets one, bit/s, 300 to 4000000; 115200 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 300, max = 4_000_000))]
    pub rate: Option<u32>,
    /// Pins that the rig drives, by their names. The value of an analog pin is in millivolts. Any
    /// other pin is high unless the value is 0.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub inputs: BTreeMap<String, SourceSpec>,
    /// Pins whose level or duty the rig shows, 0 to 1. `PIN_us` is the width of the pin's last
    /// pulse, microseconds.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<String>,
    /// Actuators of the robot's chassis that follow a pin of `outputs`, or its `PIN_us`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub drives: BTreeMap<String, DrivesSpec>,
    /// Motor drivers.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub bridges: BTreeMap<String, BridgeSpec>,
    /// Encoders of wheels.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub encoders: BTreeMap<String, ContactsSpec>,
    /// Delay of all outputs of the board, microseconds, 10 to 10000; 200 if not given. A longer
    /// delay makes the run faster.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 10.0, max = 10_000.0))]
    pub slice_us: Option<f64>,
    /// Folder of the paths in `elf` and `board`, relative to the scenario's folder. Saved cases
    /// include it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
}

/// A motor driver with one pin for its power and two for its direction. Its value is -1 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BridgeSpec {
    /// Pin whose duty is the power.
    pub power: String,
    /// Pin that is high for forward motion.
    pub forward: String,
    /// Pin that is high for backward motion.
    pub backward: String,
    /// Actuator of the robot's chassis that it drives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drives: Option<DrivesSpec>,
}

/// An encoder with two contacts: while its count rises, contact A switches before B.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ContactsSpec {
    /// Pin of contact A.
    pub a: String,
    /// Pin of contact B.
    pub b: String,
    /// Source of the count; each edge counts one.
    pub count: SourceSpec,
}

impl FirmwareSpec {
    /// Stores the folder `base`, so that a saved case runs in any folder.
    pub(in crate::scenario) fn embed(&mut self, base: &Path) {
        played::embed(&mut self.folder, base);
    }

    fn base(&self, context: &BuildContext<'_>) -> PathBuf {
        played::base(self.folder.as_deref(), context)
    }

    /// Names of its ports with the numbers of their UARTs.
    fn uarts(&self, board: &Board) -> Result<Vec<(String, u8)>, String> {
        let known = || {
            let names: Vec<_> = board.uarts.keys().map(String::as_str).collect();
            names.join(", ")
        };
        if self.ports.is_empty() {
            let first = board.uarts.iter().min_by_key(|(_, number)| **number);
            let first = first.map(|(name, number)| (name.clone(), *number));
            return Ok(first.into_iter().collect());
        }
        let mut found: Vec<(String, u8)> = Vec::new();
        for name in &self.ports {
            let Some(number) = board.uarts.get(name) else {
                let board = &board.name;
                return Err(format!(
                    "the board {board} has no UART \"{name}\", expected one of {}",
                    known()
                ));
            };
            if found.iter().any(|(other, _)| other == name) {
                return Err(format!("\"{name}\" is given twice, expected another UART"));
            }
            found.push((name.clone(), *number));
        }
        Ok(found)
    }

    /// Checks the names and the number of parts, because the node program has limited room.
    fn check_parts(&self) -> Result<(), (String, String)> {
        let many = [
            ("bridges", self.bridges.len(), PARTS_MAX),
            ("encoders", self.encoders.len(), PARTS_MAX),
            (
                "inputs",
                self.inputs.len() + self.encoders.len(),
                NUMBERS_MAX,
            ),
        ];
        if let Some((key, len, most)) = many.into_iter().find(|(_, len, most)| len > most) {
            return Err((
                key.to_owned(),
                format!("has {len}, expected at most {most}"),
            ));
        }
        let bridges = self.bridges.keys().map(|name| ("bridges", name));
        let encoders = self.encoders.keys().map(|name| ("encoders", name));
        for (key, name) in bridges.chain(encoders) {
            check_name(name).map_err(|message| (key.to_owned(), message))?;
        }
        Ok(())
    }

    fn check_pins(&self, board: &Board) -> Result<(), (String, String)> {
        let inputs = self.inputs.keys().map(|pin| ("inputs".to_owned(), pin));
        let outputs = self.outputs.iter().map(|pin| ("outputs".to_owned(), pin));
        let bridges = self.bridges.iter().flat_map(|(name, bridge)| {
            let pins = [
                ("power", &bridge.power),
                ("forward", &bridge.forward),
                ("backward", &bridge.backward),
            ];
            pins.map(|(key, pin)| (format!("bridges.{name}.{key}"), pin))
        });
        let encoders = self.encoders.iter().flat_map(|(name, contacts)| {
            let pins = [("a", &contacts.a), ("b", &contacts.b)];
            pins.map(|(key, pin)| (format!("encoders.{name}.{key}"), pin))
        });
        let pins = inputs.chain(outputs).chain(bridges).chain(encoders);
        for (key, pin) in pins {
            if !board.pins.contains_key(pin) {
                let known: Vec<_> = board.pins.keys().map(String::as_str).collect();
                let message = format!(
                    "the board {} has no pin \"{pin}\", expected one of {}",
                    board.name,
                    known.join(", ")
                );
                return Err((key, message));
            }
        }
        let shown: Vec<_> = self
            .outputs
            .iter()
            .flat_map(|pin| [pin.clone(), format!("{pin}_us")])
            .collect();
        if let Some(output) = self.drives.keys().find(|output| !shown.contains(output)) {
            let message = format!("\"{output}\" is not among outputs, expected one of those");
            return Err(("drives".to_owned(), message));
        }
        let twice = self.bridges.keys().find(|name| shown.contains(name));
        let twice = twice.map(|name| ("bridges", name));
        let pins = &board.pins;
        let twice = twice.or_else(|| {
            let pin = self.encoders.keys().find(|name| pins.contains_key(*name));
            pin.map(|name| ("encoders", name))
        });
        twice.map_or(Ok(()), |(key, name)| {
            Err((
                key.to_owned(),
                format!("\"{name}\" is a pin, expected another name"),
            ))
        })
    }

    fn drive_list(&self) -> Result<Vec<Drive>, (String, String)> {
        let pins = self
            .drives
            .iter()
            .map(|(output, spec)| (format!("drives.{output}"), output, spec));
        let bridges = self.bridges.iter().filter_map(|(name, bridge)| {
            Some((
                format!("bridges.{name}.drives"),
                name,
                bridge.drives.as_ref()?,
            ))
        });
        let drive = |(key, output, spec): (String, &String, &DrivesSpec)| {
            let sink = spec.sink().map_err(|message| (key, message))?;
            let output = output.clone();
            Ok(Drive { output, sink })
        };
        pins.chain(bridges).map(drive).collect()
    }

    fn quantities(&self) -> Vec<Quantity> {
        let pins = self.inputs.iter();
        let wheels = self.encoders.iter();
        let wheels = wheels.map(|(name, contacts)| (name, &contacts.count));
        let quantity = |(name, source): (&String, &SourceSpec)| Quantity {
            name: name.clone(),
            source: source.clone().into(),
        };
        pins.chain(wheels).map(quantity).collect()
    }
}

/// The absolute path of an ELF file, as text.
///
/// # Errors
/// A sentence, if there is no such file.
pub fn elf_path(elf: &Path) -> Result<String, String> {
    if !elf.is_file() {
        return Err(format!(
            "{}: no such file, expected the ELF file that the linker wrote",
            elf.display()
        ));
    }
    let elf = std::path::absolute(elf).unwrap_or_else(|_| elf.to_owned());
    // The path travels as text.
    let path = elf.to_str().filter(|path| path.len() <= PATH_MAX);
    path.map(str::to_owned).ok_or_else(|| {
        format!(
            "{}: expected a path of at most {PATH_MAX} bytes of UTF-8; move the file",
            elf.display()
        )
    })
}

/// The node program that runs firmware on a board in simavr: its command and its settings.
///
/// # Errors
/// A sentence, if the simulator is missing or there is no such file.
pub fn node_of(name: &str, elf: &Path, board: &Board, wires: Value) -> Result<NodeSpec, String> {
    let path = elf_path(elf)?;
    let program = program().map_err(|error| error.to_string())?;
    let mut settings = Map::new();
    settings.insert("elf".to_owned(), json!(path));
    settings.insert("board".to_owned(), board.settings());
    settings.insert("wires".to_owned(), wires);
    let quoted = program.to_string_lossy().replace('\'', "'\\''");
    Ok(NodeSpec {
        settings,
        role: Role::Device,
        ..NodeSpec::new(name, &format!("exec '{quoted}'"))
    })
}

impl DeviceKind for FirmwareKind {
    fn name(&self) -> &'static str {
        "firmware"
    }

    fn about(&self) -> &'static str {
        "Device that its own firmware plays: an ELF file on a simulated AVR board"
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<FirmwareSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<FirmwareSpec>(settings)
    }

    fn drives(&self, settings: &dyn Settings) -> Option<Drives> {
        let settings: &dyn Any = settings;
        let spec = settings.downcast_ref::<FirmwareSpec>()?;
        let pins = spec.drives.iter();
        let pins = pins.map(|(output, spec)| (format!("drives.{output}"), spec));
        let bridges = spec.bridges.iter().filter_map(|(name, bridge)| {
            Some((format!("bridges.{name}.drives"), bridge.drives.as_ref()?))
        });
        played::driven(pins.chain(bridges))
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

    fn check(
        &self,
        context: &BuildContext<'_>,
        device: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        played::check(context, device, world)
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &FirmwareSpec = context.settings()?;
        let (source, at) = (context.source, context.key());
        let wrong = |key: &str, message: String| {
            let span = source.find(key.split('.').next().unwrap_or(key));
            source.invalid(span, format!("{at}.{key}"), message)
        };
        context.within("rate", spec.rate.map(f64::from), 300.0..=4_000_000.0)?;
        context.within("slice_us", spec.slice_us, 10.0..=10_000.0)?;
        let base = spec.base(context);
        let board =
            Board::load(&spec.board, &base).map_err(|error| wrong("board", error.to_string()))?;
        if board.qemu.is_some() {
            let message = format!(
                "{} runs in QEMU, which plays the robot's program only (hilrig run --firmware), \
                 expected a board with an AVR",
                board.name
            );
            return Err(wrong("board", message));
        }
        let uarts = spec
            .uarts(&board)
            .map_err(|message| wrong("ports", message))?;
        spec.check_parts()
            .and_then(|()| spec.check_pins(&board))
            .map_err(|(key, message)| wrong(&key, message))?;
        let drives = spec
            .drive_list()
            .map_err(|(key, message)| wrong(&key, message))?;
        let wires: Map<_, _> = uarts
            .iter()
            .map(|(name, number)| (name.clone(), json!({ "unit": "uart", "number": number })))
            .collect();
        let mut node = node_of(context.name, &base.join(&spec.elf), &board, wires.into())
            .map_err(|message| wrong("elf", message))?;
        let bridges: Map<_, _> = spec
            .bridges
            .iter()
            .map(|(name, bridge)| {
                let BridgeSpec {
                    power,
                    forward,
                    backward,
                    ..
                } = bridge;
                let pins = json!({ "power": power, "forward": forward, "backward": backward });
                (name.clone(), pins)
            })
            .collect();
        let encoders: Map<_, _> = spec
            .encoders
            .iter()
            .map(|(name, contacts)| (name.clone(), json!({ "a": contacts.a, "b": contacts.b })))
            .collect();
        node.settings.insert("bridges".to_owned(), bridges.into());
        node.settings.insert("encoders".to_owned(), encoders.into());
        node.settings
            .insert("outputs".to_owned(), json!(spec.outputs));
        if let Some(slice_us) = spec.slice_us {
            node.settings.insert("slice_us".to_owned(), json!(slice_us));
        }
        let line = LineConfig::new_8n1(spec.rate.unwrap_or(115_200));
        node.ports = uarts
            .iter()
            .map(|(name, _)| NodePort::uart(name, line))
            .collect();
        node.seed = context.seed;
        node.quantities = spec.quantities();
        node.drives = drives;
        let port = |(number, (name, _)): (u8, &(String, u8))| {
            PortInfo::uart(forever(name), Port(number), line, "your own program")
        };
        Ok(Built {
            device: Box::new(NodeDevice::new(node)),
            ports: (0..).zip(&uarts).map(port).collect(),
        })
    }
}
