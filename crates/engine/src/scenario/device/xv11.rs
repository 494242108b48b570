//! `xv11`: the Neato XV-11 lidar.

use core::any::Any;

use emulators::xv11::{Config, Detail, Direction, Fault, Mount, Profile, Xv11};
use protocols::LineConfig;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{
    BuildContext, Built, DeviceKind, MountSpec, PortInfo, Settings, read_settings, schema_of,
};
use crate::codec::{self, Codec};
use crate::rig::LinkKind;
use crate::scenario::ScenarioError;
use crate::scenario::device::scan::ScanDecoder;
use crate::scenario::device::xv11_scans::Xv11Scans;

/// Settings of an XV-11.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Xv11Spec {
    /// Firmware: `fw2.1`, `fw2.4.13386`, `fw2.6.15295`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub profile: Option<toml::Spanned<String>>,
    /// Drive of the head; if not given, the rig keeps 300 rpm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supply: Option<SupplySpec>,
    /// Mount on the robot; in the middle and looking ahead if not given. The robot's program does
    /// not know it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<MountSpec>,
    /// Angle of the first reading to the axis of the housing, degrees, -360 to 360; 0 if not given.
    /// Sources differ: -10 or 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub index0_deg: Option<f64>,
    /// Distance between laser beam and axis, millimetres, 0 to 100; sources say 0 to 25; 0 if not
    /// given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub beam_offset_mm: Option<f64>,
    /// Direction of the head's rotation, seen from above; counter-clockwise if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<TurnSpec>,
    /// Variation in addition to the noise of each reading; `captured` if not given, `even` on the
    /// rescue robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<DetailSpec>,
    /// Faults of the sensor that act from the start, by their names, e.g. `dust`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<String>")]
    pub faults: Vec<toml::Spanned<String>>,
}

/// Variation of a lidar.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DetailSpec {
    /// Variation of a captured real unit: the speed within a turn, the reflectivity and roughness
    /// of surfaces, the noise from turn to turn. Firmware 2.1 has its own noise.
    Captured,
    /// No variation: all surfaces are equal.
    Even,
}

/// Senses of rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TurnSpec {
    /// Counter-clockwise, as in all sources except one.
    CounterClockwise,
    /// Clockwise, as in that one source.
    Clockwise,
}

/// Drive of a lidar's head: one of these keys.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SupplySpec {
    /// The rig keeps this speed, turns per minute.
    RegulatedRpm(f64),
    /// A fixed voltage at the motor, volts.
    FixedV(f64),
    /// The host's drive, this voltage at full duty, volts.
    HostV(f64),
}

impl From<SupplySpec> for emulators::xv11::MotorSupply {
    fn from(spec: SupplySpec) -> Self {
        match spec {
            SupplySpec::RegulatedRpm(rpm) => Self::Regulated { rpm },
            SupplySpec::FixedV(volts) => Self::Fixed { volts },
            SupplySpec::HostV(volts) => Self::Host { volts },
        }
    }
}

impl From<MountSpec> for Mount {
    /// The sensor's own angle 90 is ahead if the sensor is not rotated.
    fn from(spec: MountSpec) -> Self {
        Self::turned(spec.x_m, spec.y_m, spec.heading_deg)
    }
}

/// The duty of the motor is a level, not a message: it arrives at once.
const PIN: LineConfig = LineConfig::new_8n1(10_000_000);

const EXAMPLE: &str = r#"[device.lidar.xv11]
profile = "fw2.6.15295"
supply = { fixed-v = 3.3 }
mount = { x_m = 0.05, heading_deg = 30 }
detail = "even"
faults = ["dust"]
"#;

/// The kind `xv11`.
pub const XV11: &dyn DeviceKind = &Xv11Kind;

struct Xv11Kind;

impl DeviceKind for Xv11Kind {
    fn name(&self) -> &'static str {
        "xv11"
    }

    fn about(&self) -> &'static str {
        "Neato XV-11 lidar"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<Xv11Spec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<Xv11Spec>(settings)
    }

    fn is_own(&self) -> bool {
        false
    }

    fn scanner(&self, settings: &dyn Settings) -> Option<Box<dyn ScanDecoder>> {
        let settings: &dyn Any = settings;
        let mount = settings
            .downcast_ref::<Xv11Spec>()?
            .mount
            .unwrap_or_default();
        let first_bearing = -core::f64::consts::FRAC_PI_2 + mount.heading_deg.to_radians();
        let scans = Xv11Scans::new(first_bearing).at([mount.x_m, mount.y_m]);
        Some(Box::new(scans))
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &Xv11Spec = context.settings()?;
        let device = Xv11::new(context.name, context.seed, spec.config(context)?);
        let uart = LineConfig::new_8n1(protocols::xv11::BAUD);
        let drive = "the lidar's motor drive, optional";
        Ok(Built {
            device: Box::new(device),
            // It sends packets of 22 bytes.
            ports: vec![
                PortInfo::uart("uart", Xv11::UART, uart, "the robot's lidar input")
                    .in_pieces(22)
                    .speaking(spec.codec()),
                PortInfo::uart("motor", Xv11::MOTOR, PIN, drive)
                    .optional()
                    .on(LinkKind::Pin)
                    .at_any_rate(PIN),
            ],
        })
    }
}

impl Xv11Spec {
    /// Firmware 2.1 sends another format.
    fn codec(&self) -> &'static Codec {
        let is_old = |name: &toml::Spanned<String>| name.get_ref() == Profile::Fw21.name();
        match self.profile.as_ref().is_some_and(is_old) {
            true => &codec::XV11_TURN,
            false => &codec::XV11,
        }
    }

    fn config(&self, context: &BuildContext<'_>) -> Result<Config, ScenarioError> {
        let mut config = Config::default();
        let (source, at) = (context.source, context.key());
        self.check(context)?;
        let optics = &mut config.optics;
        optics.index0_deg = self.index0_deg.unwrap_or(optics.index0_deg);
        optics.beam_offset_mm = self.beam_offset_mm.unwrap_or(optics.beam_offset_mm);
        optics.direction = match self.direction {
            Some(TurnSpec::Clockwise) => Direction::Clockwise,
            Some(TurnSpec::CounterClockwise) | None => Direction::CounterClockwise,
        };
        config.mount = self.mount.map_or(config.mount, Mount::from);
        for name in &self.faults {
            let known = Fault::ALL.map(Fault::name);
            let fault = Fault::from_name(name.get_ref())
                .ok_or_else(|| source.unknown(&format!("{at}.faults"), name, &known))?;
            config.faults.push(fault);
        }
        if let Some(name) = &self.profile {
            let known = Profile::ALL.map(Profile::name);
            config.profile = Profile::from_name(name.get_ref())
                .ok_or_else(|| source.unknown(&format!("{at}.profile"), name, &known))?;
        }
        if let Some(supply) = self.supply {
            config.supply = supply.into();
        }
        config.detail = match self.detail {
            Some(DetailSpec::Even) => Detail::Even,
            Some(DetailSpec::Captured) | None => Detail::Captured,
        };
        Ok(config)
    }

    /// Whether all figures are in their ranges.
    fn check(&self, context: &BuildContext<'_>) -> Result<(), ScenarioError> {
        context.within("index0_deg", self.index0_deg, -360.0..=360.0)?;
        context.within("beam_offset_mm", self.beam_offset_mm, 0.0..=100.0)?;
        self.mount.unwrap_or_default().check(context)
    }
}
