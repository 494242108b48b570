//! `hc06`: the HC-06 Bluetooth radio.

use core::num::NonZeroU32;

use emulators::hc06::{AIR_LINE, Hc06, Profile};
use protocols::LineConfig;
use protocols::hc06::Family;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{BuildContext, Built, DeviceKind, PortInfo, Settings, read_settings, schema_of};
use crate::scenario::{ScenarioError, Span};

/// Settings of an HC-06.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hc06Spec {
    /// Buffer between UART and radio, bytes, 0 to 65535; 700 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fifo_bytes: Option<u16>,
    /// Throughput in one direction, bytes per second, at least 1; 20500 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_bytes_s: Option<NonZeroU32>,
    /// Radio silence after which the connection is closed, 20 s if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supervision: Option<Span>,
    /// Firmware: `linvor-1.8`, `hc01-2.0`, `3.0-20170609`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub family: Option<toml::Spanned<String>>,
    /// Rate of the wire to the microcontroller, bit/s; 460800 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Silence after a command until the module answers, families without line ends, 0 to 10 s;
    /// 0.5 s if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub silence: Option<Span>,
    /// Time from the opening of the PC's port to the first byte that passes; the firmware's own if
    /// not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub connect_delay: Option<Span>,
}

const EXAMPLE: &str = r#"[device.radio.hc06]
fifo_bytes = 64
connect_delay = "2s"
silence = "1s"
"#;

/// The kind `hc06`.
pub const HC06: &dyn DeviceKind = &Hc06Kind;

struct Hc06Kind;

impl DeviceKind for Hc06Kind {
    fn name(&self) -> &'static str {
        "hc06"
    }

    fn about(&self) -> &'static str {
        "HC-06 Bluetooth radio"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<Hc06Spec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<Hc06Spec>(settings)
    }

    fn is_own(&self) -> bool {
        false
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &Hc06Spec = context.settings()?;
        let profile = spec.profile(context)?;
        let line = LineConfig::new_8n1(spec.baud.unwrap_or(protocols::pcui::BAUD));
        Ok(Built {
            device: Box::new(Hc06::new(profile, context.seed)),
            ports: vec![
                PortInfo::uart("uart", Hc06::UART, line, "the robot's radio UART").in_pieces(16),
                PortInfo::uart("air", Hc06::AIR, AIR_LINE, "a PC program")
                    .in_pieces(64)
                    .at_any_rate(LineConfig::new_8n1(protocols::pcui::BAUD)),
            ],
        })
    }
}

impl Hc06Spec {
    fn profile(&self, context: &BuildContext<'_>) -> Result<Profile, ScenarioError> {
        let family = match &self.family {
            None => Family::default(),
            Some(name) => {
                let families = [Family::Linvor18, Family::Hc01V20, Family::V30];
                let known = families.map(Family::name);
                let found = families
                    .into_iter()
                    .find(|family| family.name() == name.get_ref());
                let key = format!("{}.family", context.key());
                found.ok_or_else(|| context.source.unknown(&key, name, &known))?
            }
        };
        let baud = self.baud.unwrap_or(protocols::pcui::BAUD);
        let mut profile = Profile::of(family).at_baud(baud);
        if let Some(delay) = self.connect_delay {
            profile.connect_delay = delay.0;
        }
        profile.fifo_len = self.fifo_bytes.map_or(profile.fifo_len, usize::from);
        profile.rate_bytes_s = self
            .rate_bytes_s
            .map_or(profile.rate_bytes_s, NonZeroU32::get);
        context.within(
            "silence",
            self.silence.map(|span| span.0.as_secs_f64()),
            0.0..=10.0,
        )?;
        profile.silence = self.silence.map_or(profile.silence, |span| span.0);
        profile.supervision = self.supervision.map_or(profile.supervision, |span| span.0);
        Ok(profile)
    }
}
