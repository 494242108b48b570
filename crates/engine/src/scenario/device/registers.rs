//! `registers`: a slave with a table of registers, described by the scenario.

use core::any::Any;

use emulators::registers::Registers;
use emulators::world::World;
use protocols::LineConfig;
use schemars::{Schema, SchemaGenerator};
use toml::de::ValueDeserializer;

use super::{
    BuildContext, Built, DeviceKind, Drives, PortInfo, Settings, ValueRow, read_settings, schema_of,
};
use crate::codec;
use crate::rig::{AnyDevice, Rig};
use crate::scenario::{Operand, OrderSpec, RegistersSpec, ScenarioError};

const EXAMPLE: &str = r#"[device.gripper.registers]
baud = 115200
watchdog = "500ms"
resets_on = "break"
boot = "300ms"
raises = { cts = "wall-ahead-mm" }

[[device.gripper.registers.register]]
address = 4
name = "wall-ahead-mm"
width = "u16"
source = { range = { angle_deg = 0, max_mm = 4000 } }

[[device.gripper.registers.register]]
address = 8
name = "closing-speed"
width = "i8"
access = "write"
limits = [-50, 50]
safe = 0
"#;

/// The kind `registers`.
pub(super) const REGISTERS: &dyn DeviceKind = &RegistersKind;

struct RegistersKind;

impl DeviceKind for RegistersKind {
    fn name(&self) -> &'static str {
        "registers"
    }

    fn about(&self) -> &'static str {
        "Register slave described by data"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<RegistersSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<RegistersSpec>(settings)
    }

    fn rows(&self, settings: &dyn Settings, rig: &Rig, name: &str) -> Vec<ValueRow> {
        let settings: &dyn Any = settings;
        let spec = settings.downcast_ref::<RegistersSpec>();
        spec.map_or(Vec::new(), |spec| spec.rows(rig, name))
    }

    fn set(&self, rig: &mut Rig, name: &str, value: &str, to: &Operand) -> Result<(), String> {
        let whole = to.whole()?;
        let now = rig.now();
        let device = rig.device_mut::<Registers>(name);
        device.map_or(Ok(()), |device| device.set(now, value, whole))
    }

    fn drives(&self, settings: &dyn Settings) -> Option<Drives> {
        let settings: &dyn Any = settings;
        settings.downcast_ref::<RegistersSpec>()?.driven()
    }

    fn check(
        &self,
        context: &BuildContext<'_>,
        device: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        let spec: &RegistersSpec = context.settings()?;
        let device: &dyn Any = device;
        let device = device.downcast_ref::<Registers>();
        let checked = device.map_or(Ok(()), |device| device.check_chassis(world.chassis()));
        checked.map_err(|error| spec.register_error(&context.key(), context.source, error))
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &RegistersSpec = context.settings()?;
        let device = spec.device(&context.key(), context.source)?;
        let line = LineConfig::new_8n1(*spec.baud.get_ref());
        let port = PortInfo::uart("bus", Registers::BUS, line, "your own program");
        let port = port.speaking(match spec.checksum {
            OrderSpec::LowFirst => &codec::BUS,
            OrderSpec::HighFirst => &codec::BUS_HIGH_FIRST,
        });
        Ok(Built {
            device: Box::new(device),
            ports: core::iter::once(port).chain(spec.pins()).collect(),
        })
    }
}
