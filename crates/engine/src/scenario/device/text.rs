//! `text`: a slave with a text protocol, described by the scenario.

use core::any::Any;

use emulators::text::Text;
use emulators::world::World;
use protocols::LineConfig;
use schemars::{Schema, SchemaGenerator};
use toml::de::ValueDeserializer;

use super::{
    BuildContext, Built, DeviceKind, Drives, PortInfo, Settings, ValueRow, read_settings, schema_of,
};
use crate::rig::{AnyDevice, Rig};
use crate::scenario::{Operand, ScenarioError, TextSpec};

const EXAMPLE: &str = r#"[device.sonar.text]
baud = 9600
unknown = "?"
refused = "range"
periodic = { line = "mm={distance}", period = "1s" }
resets_on = "dtr"
greeting = "sonar 1.0"
raises = { dcd = "distance" }

[[device.sonar.text.variable]]
name = "distance"
source = { range = { angle_deg = 90, max_mm = 3000 } }

[[device.sonar.text.command]]
request = "ping"
reply = "mm={distance}"
"#;

/// The kind `text`.
pub(super) const TEXT: &dyn DeviceKind = &TextKind;

struct TextKind;

impl DeviceKind for TextKind {
    fn name(&self) -> &'static str {
        "text"
    }

    fn about(&self) -> &'static str {
        "Text slave described by data"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<TextSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<TextSpec>(settings)
    }

    fn rows(&self, settings: &dyn Settings, rig: &Rig, name: &str) -> Vec<ValueRow> {
        let settings: &dyn Any = settings;
        let device = rig.device::<Text>(name);
        let Some((spec, device)) = settings.downcast_ref::<TextSpec>().zip(device) else {
            return Vec::new();
        };
        let values = device.values(rig.now(), &rig.world);
        let names = spec.variable.iter().map(|one| one.get_ref().name.clone());
        let rows = names.zip(values);
        rows.map(|(name, value)| ValueRow::new(None, name, value))
            .collect()
    }

    fn set(&self, rig: &mut Rig, name: &str, value: &str, to: &Operand) -> Result<(), String> {
        let whole = to.whole()?;
        let now = rig.now();
        let device = rig.device_mut::<Text>(name);
        device.map_or(Ok(()), |device| device.set(now, value, whole))
    }

    fn drives(&self, settings: &dyn Settings) -> Option<Drives> {
        let settings: &dyn Any = settings;
        settings.downcast_ref::<TextSpec>()?.driven()
    }

    fn check(
        &self,
        context: &BuildContext<'_>,
        device: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        let spec: &TextSpec = context.settings()?;
        let device: &dyn Any = device;
        let device = device.downcast_ref::<Text>();
        let checked = device.map_or(Ok(()), |device| device.check_chassis(world.chassis()));
        checked.map_err(|error| spec.variable_error(&context.key(), context.source, error))
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &TextSpec = context.settings()?;
        let device = spec.device(&context.key(), context.source)?;
        let line = LineConfig::new_8n1(*spec.baud.get_ref());
        let port = PortInfo::uart("uart", Text::UART, line, "your own program");
        Ok(Built {
            device: Box::new(device),
            ports: core::iter::once(port).chain(spec.pins()).collect(),
        })
    }
}
