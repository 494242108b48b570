//! `rplidar`: the RPLIDAR A1 lidar.

use core::any::Any;

use emulators::lidar::Mount;
use emulators::rplidar::{Config, Fault, MotorControl, Profile, Rplidar};
use protocols::LineConfig;
use protocols::rplidar::{BAUD, NODE_LEN};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::rplidar_scans::RplidarScans;
use super::{
    BuildContext, Built, DeviceKind, MountSpec, PortInfo, Settings, read_settings, schema_of,
};
use crate::codec;
use crate::rig::LinkKind;
use crate::scenario::ScenarioError;
use crate::scenario::device::scan::ScanDecoder;

/// Settings of an RPLIDAR A1.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RplidarSpec {
    /// Firmware: `fw1.20`, `fw1.24`, `fw1.29`; `fw1.20` if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub profile: Option<toml::Spanned<String>>,
    /// Drive of the head; if not given, the rig keeps 330 rpm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor: Option<MotorSpec>,
    /// Mount on the robot; in the middle, its angle 0 ahead, if not given. The robot's program does
    /// not know it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<MountSpec>,
    /// Maximum current of the supply, mA at 5 V, 0 to 5000; no limit if not given. A scan draws
    /// 300, and 550 while the head starts; with less, the sensor restarts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub supply_ma: Option<f64>,
    /// Faults of the sensor that act from the start, by their names, e.g. `unclean-stop`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<String>")]
    pub faults: Vec<toml::Spanned<String>>,
}

/// Drive of an RPLIDAR's head.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum MotorSpec {
    /// The rig keeps this speed, turns per minute, 0 to 1200.
    RegulatedRpm(#[schemars(range(min = 0.0, max = 1200.0))] f64),
    /// The host's PWM on the motor pin, the link `NAME-motor`: each byte is the duty in 255ths.
    Pwm,
    /// DTR of the USB adapter, the link `NAME-dtr`: each byte is a level. The motor runs while DTR
    /// is low (0), the initial level. A pseudo-terminal has no DTR.
    Dtr,
    /// The request F0, as on an accessory board; the motor stands still before it.
    Command,
}

impl From<MotorSpec> for MotorControl {
    fn from(spec: MotorSpec) -> Self {
        match spec {
            MotorSpec::RegulatedRpm(rpm) => Self::Regulated { rpm },
            MotorSpec::Pwm => Self::Pwm,
            MotorSpec::Dtr => Self::Dtr,
            MotorSpec::Command => Self::Command,
        }
    }
}

const EXAMPLE: &str = r#"[device.scanner.rplidar]
profile = "fw1.29"
motor = "pwm"
mount = { x_m = 0.05, heading_deg = 180 }
supply_ma = 600
faults = ["unclean-stop"]
"#;

/// The kind `rplidar`.
pub const RPLIDAR: &dyn DeviceKind = &RplidarKind;

struct RplidarKind;

impl DeviceKind for RplidarKind {
    fn name(&self) -> &'static str {
        "rplidar"
    }

    fn about(&self) -> &'static str {
        "RPLIDAR A1 lidar"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<RplidarSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<RplidarSpec>(settings)
    }

    fn scanner(&self, settings: &dyn Settings) -> Option<Box<dyn ScanDecoder>> {
        let settings: &dyn Any = settings;
        let mount = settings.downcast_ref::<RplidarSpec>()?.mount;
        let mount = mount.unwrap_or_default();
        let scans = RplidarScans::new(mount.heading_deg.to_radians());
        Some(Box::new(scans.at([mount.x_m, mount.y_m])))
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &RplidarSpec = context.settings()?;
        let config = spec.config(context)?;
        let motor = config.motor;
        let device = Rplidar::new(context.name, context.seed, config);
        let line = LineConfig::new_8n1(BAUD);
        let uart = PortInfo::uart("uart", Rplidar::UART, line, "the robot's lidar input")
            .in_pieces(NODE_LEN)
            .speaking(&codec::RPLIDAR);
        // A level takes the time of a byte at the UART's rate, 87 us, to arrive.
        let pin = |name, port, connect| {
            let info = PortInfo::uart(name, port, line, connect);
            info.optional().on(LinkKind::Pin).at_any_rate(line)
        };
        let drive = match motor {
            MotorControl::Pwm => {
                let connect = "the lidar's motor drive, one duty per byte";
                Some(pin("motor", Rplidar::MOTOR, connect))
            }
            MotorControl::Dtr => {
                let connect = "DTR of the lidar's adapter, a level a byte, optional";
                Some(pin("dtr", Rplidar::DTR, connect))
            }
            _ => None,
        };
        Ok(Built {
            device: Box::new(device),
            ports: core::iter::once(uart).chain(drive).collect(),
        })
    }
}

impl RplidarSpec {
    fn config(&self, context: &BuildContext<'_>) -> Result<Config, ScenarioError> {
        let mut config = Config::default();
        let (source, at) = (context.source, context.key());
        if let Some(name) = &self.profile {
            let known = Profile::ALL.map(Profile::name);
            config.profile = Profile::from_name(name.get_ref())
                .ok_or_else(|| source.unknown(&format!("{at}.profile"), name, &known))?;
        }
        if let Some(motor) = self.motor {
            if let MotorSpec::RegulatedRpm(rpm) = motor {
                context.within("motor.regulated-rpm", Some(rpm), 0.0..=1200.0)?;
            }
            config.motor = motor.into();
        }
        let mount = self.mount.unwrap_or_default();
        mount.check(context)?;
        config.mount = Mount {
            x_m: mount.x_m,
            y_m: mount.y_m,
            yaw_deg: mount.heading_deg,
        };
        context.within("supply_ma", self.supply_ma, 0.0..=5000.0)?;
        for name in &self.faults {
            let known = Fault::ALL.map(Fault::name);
            let fault = Fault::from_name(name.get_ref())
                .ok_or_else(|| source.unknown(&format!("{at}.faults"), name, &known))?;
            config.faults.push((fault, None));
        }
        if let Some(ma) = self.supply_ma {
            config.faults.push((Fault::WeakSupply, Some(ma)));
        }
        Ok(config)
    }
}
