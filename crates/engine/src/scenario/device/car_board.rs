//! `car-board`: the board of a model car.

use core::any::Any;

use emulators::car_board::{BoardConfig, CarBoard, OutOfRange};
use emulators::world::World;
use protocols::LineConfig;
use protocols::car_board::BAUD;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{BuildContext, Built, DeviceKind, PortInfo, Settings, read_settings, schema_of};
use crate::rig::AnyDevice;
use crate::scenario::{ScenarioError, Span};

/// Settings of a car's board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CarBoardSpec {
    /// Period of frames; 66.7 ms if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<Span>,
    /// Silence of the host after which the motor stops; never, as fielded, if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dead_man: Option<Span>,
    /// Whether the board clamps a command outside its range, instead of ignoring it.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub clamps: bool,
    /// Voltage of the battery at the start, 6 to 10; 8 if not given. Below 6.8 V the board is off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 6.0, max = 10.0))]
    pub battery_v: Option<f64>,
}

const EXAMPLE: &str = r#"schema = 1
name = "a-car"
robot = "custom"
duration = "20s"

[chassis.ackermann]

[device.car.car-board]
period = "50ms"
dead_man = "1s"
clamps = true
battery_v = 7.4

[world]
start = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }
"#;

/// The kind `car-board`.
pub const CAR_BOARD: &dyn DeviceKind = &CarBoardKind;

struct CarBoardKind;

impl DeviceKind for CarBoardKind {
    fn name(&self) -> &'static str {
        "car-board"
    }

    fn about(&self) -> &'static str {
        "Board of a model car: motor, servo, ultrasonic ranges, hall, line, battery"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<CarBoardSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<CarBoardSpec>(settings)
    }

    /// A robot must have the motor and the servo for this device.
    fn is_own(&self) -> bool {
        false
    }

    fn check(
        &self,
        context: &BuildContext<'_>,
        device: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        let device: &dyn Any = device;
        let actuators = world.actuators();
        let lacks = |name: &&str| !actuators.iter().any(|actuator| actuator.name == *name);
        match ["drive", "steering"].iter().find(|name| lacks(name)) {
            Some(name) if device.is::<CarBoard>() => {
                let message = format!("the chassis has no actuator \"{name}\"");
                let span = context.source.find(context.name);
                Err(context.source.invalid(span, context.key(), message))
            }
            _ if BoardConfig::default()
                .encoder_of(world.encoders())
                .is_none() =>
            {
                context.needs_encoder("drive", world)
            }
            _ => Ok(()),
        }
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &CarBoardSpec = context.settings()?;
        context.within("battery_v", spec.battery_v, 6.0..=10.0)?;
        let period_s = spec.period.map(|period| period.0.as_secs_f64());
        context.within("period", period_s, 0.005..=10.0)?;
        let usual = BoardConfig::default();
        let mut config = BoardConfig {
            frame_period: spec.period.map_or(usual.frame_period, |period| period.0),
            dead_man: spec.dead_man.map(|time| time.0),
            out_of_range: match spec.clamps {
                true => OutOfRange::Clamped,
                false => OutOfRange::Ignored,
            },
            seed: context.seed,
            ..usual
        };
        if let Some(volts) = spec.battery_v {
            config.battery.start_mv = volts * 1e3;
        }
        let line = LineConfig::new_8n1(BAUD);
        let uart = PortInfo::uart(
            "uart",
            CarBoard::UART,
            line,
            "the robot's port for its board",
        );
        Ok(Built {
            device: Box::new(CarBoard::new(config)),
            ports: vec![uart],
        })
    }
}
