//! `registers`: a slave with a table of registers, described by the scenario.

use emulators::registers::Registers;
use protocols::LineConfig;
use schemars::{Schema, SchemaGenerator};
use toml::de::ValueDeserializer;

use super::{BuildContext, Built, DeviceKind, PortInfo, Settings, read_settings, schema_of};
use crate::scenario::{RegistersSpec, ScenarioError};

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

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<RegistersSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<RegistersSpec>(settings)
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &RegistersSpec = context.settings()?;
        let device = spec.device(&context.key(), context.source)?;
        let line = LineConfig::new_8n1(*spec.baud.get_ref());
        let port = PortInfo::uart("bus", Registers::BUS, line, "your own program");
        Ok(Built {
            device: Box::new(device),
            ports: vec![port],
        })
    }
}
