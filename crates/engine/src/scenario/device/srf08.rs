//! `srf08`: an ultrasonic ranger on a separate I2C bus.

use emulators::i2c::OnBus;
use emulators::srf08::{Srf08, Srf08Config};
use protocols::LineConfig;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{
    BuildContext, Built, DeviceKind, MountSpec, PortInfo, Settings, read_settings, schema_of,
};
use crate::rig::LinkKind;
use crate::scenario::ScenarioError;

/// Settings of an ultrasonic ranger.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Srf08Spec {
    /// Mount on the robot; in the middle, looking ahead, if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<MountSpec>,
    /// Height above the floor, metres, 0 to 5; 0.1 if not given. It does not detect lower objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub height_m: Option<f64>,
    /// Address in eight bits, even, 224 to 254; 224 (E0) if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 224, max = 254))]
    pub address: Option<u8>,
    /// Standard deviation of a range, metres, 0 to 1; 0.003 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub noise_m: Option<f64>,
}

const EXAMPLE: &str = r#"[device.ranger.srf08]
mount = { x_m = 0.2, heading_deg = 10 }
height_m = 0.15
address = 0xE2
noise_m = 0.01
"#;

/// The kind `srf08`.
pub const SRF08: &dyn DeviceKind = &Srf08Kind;

struct Srf08Kind;

impl DeviceKind for Srf08Kind {
    fn name(&self) -> &'static str {
        "srf08"
    }

    fn about(&self) -> &'static str {
        "SRF08 ultrasonic ranger on an I2C bus"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<Srf08Spec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<Srf08Spec>(settings)
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &Srf08Spec = context.settings()?;
        let mount = spec.mount.unwrap_or_default();
        mount.check(context)?;
        context.within("height_m", spec.height_m, 0.0..=5.0)?;
        context.within("address", spec.address.map(f64::from), 224.0..=254.0)?;
        if let Some(odd) = spec.address.filter(|address| address % 2 == 1) {
            let message = format!("is {odd}, expected an even address, 224 to 254");
            let (span, at) = (context.source.find("address"), context.key());
            return Err(context
                .source
                .invalid(span, format!("{at}.address"), message));
        }
        context.within("noise_m", spec.noise_m, 0.0..=1.0)?;
        let usual = Srf08Config::default();
        let config = Srf08Config {
            address: spec.address.unwrap_or(usual.address),
            x_m: mount.x_m,
            y_m: mount.y_m,
            yaw_rad: mount.heading_deg.to_radians(),
            height_m: spec.height_m.unwrap_or(usual.height_m),
            noise_m: spec.noise_m.unwrap_or(usual.noise_m),
            ..usual
        };
        Ok(Built {
            device: Box::new(OnBus::new(Srf08::new(config, context.seed, context.name))),
            ports: vec![bus("the robot's I2C bus")],
        })
    }
}

/// The port of a chip alone on its bus.
pub(super) const fn bus(connect: &'static str) -> PortInfo {
    let line = LineConfig::new_8n1(100_000);
    PortInfo::uart("i2c", OnBus::<Srf08>::BUS, line, connect)
        .on(LinkKind::I2c)
        .at_any_rate(line)
}
