//! `avr-base`: the base with motors and sensors behind a register bus.

use emulators::avr_base::{Announce, AvrBase, AvrBaseConfig, Heat, Imu, Profile};
use protocols::LineConfig;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{BuildContext, Built, DeviceKind, PortInfo, Settings, read_settings, schema_of};
use crate::codec;
use crate::scenario::{ScenarioError, Source, Span};

/// Settings of an AVR base.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AvrBaseSpec {
    /// Firmware: `document`, `rcj2015-2015`, `rcj2015-2014`; `document` if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub profile: Option<toml::Spanned<String>>,
    /// Time between the last common start of the base's tasks and the start of the run, up to 200.8
    /// ms; random if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<Span>,
    /// Whether the base has a thermometer on each side, and rescue kits; only with the firmware
    /// `document`. The robot then also searches for victims.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub heat: bool,
    /// Whether the base has a gyroscope; the robot uses the integral of its turn rate as heading.
    /// Only with the firmware `document`.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub imu: bool,
    /// Whether the base reports its stop button to the robot immediately; the fault `stop-button`
    /// holds the button. Only with the firmware `document`.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub announce: bool,
}

impl AvrBaseSpec {
    /// The settings of the base called `name`.
    ///
    /// # Errors
    /// If there is no such profile.
    pub fn config(&self, name: &str, source: &Source) -> Result<AvrBaseConfig, ScenarioError> {
        let mut config = AvrBaseConfig {
            phase: self.phase.map(|phase| phase.0),
            ..AvrBaseConfig::default()
        };
        if let Some(found) = &self.profile {
            let known = Profile::ALL.map(Profile::name);
            let key = format!("device.{name}.avr-base.profile");
            config.profile = Profile::from_name(found.get_ref())
                .ok_or_else(|| source.unknown(&key, found, &known))?;
        }
        let own = [
            ("heat", self.heat),
            ("imu", self.imu),
            ("announce", self.announce),
        ];
        for (key, _) in own.into_iter().filter(|(_, is_there)| *is_there) {
            if config.profile != Profile::Document {
                let message = "is possible only with profile = \"document\"";
                let path = format!("device.{name}.avr-base.{key}");
                return Err(source.invalid(source.find(key), path, message));
            }
        }
        if self.heat {
            config.heat = Heat::Fitted;
        }
        if self.imu {
            config.imu = Imu::Fitted;
        }
        if self.announce {
            config.announce = Announce::StopButton;
        }
        Ok(config)
    }
}

const EXAMPLE: &str = r#"[device.base.avr-base]
profile = "rcj2015-2015"
phase = "10ms"
"#;

/// The kind `avr-base`.
pub const AVR_BASE: &dyn DeviceKind = &AvrBaseKind;

struct AvrBaseKind;

impl DeviceKind for AvrBaseKind {
    fn name(&self) -> &'static str {
        "avr-base"
    }

    fn about(&self) -> &'static str {
        "Base with motors and sensors behind a register bus"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<AvrBaseSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<AvrBaseSpec>(settings)
    }

    fn is_own(&self) -> bool {
        false
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &AvrBaseSpec = context.settings()?;
        let config = spec.config(context.name, context.source)?;
        let line = LineConfig::new_8n1(protocols::avr::BAUD);
        // Bytes are delivered one by one, because the slave ignores bytes between a request and its
        // answer.
        let bus = PortInfo::uart("bus", AvrBase::BUS, line, "the robot's register bus");
        let bus = bus.speaking(match config.profile {
            Profile::Document => &codec::BUS,
            Profile::Rcj2015 | Profile::Rcj2014 => &codec::BUS_HIGH_FIRST,
        });
        Ok(Built {
            device: Box::new(AvrBase::new(config, context.seed)),
            ports: vec![bus],
        })
    }
}
