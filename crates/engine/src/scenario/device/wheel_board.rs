//! `wheel-board`: timers, PWM and ADC of a motor board.

use emulators::wheel_board::{BAUD, Config, Press, RangeSensor, WheelBoard};
use emulators::world::World;
use protocols::LineConfig;
use protocols::peripherals::{CHANNELS, SAMPLE_LEN};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{
    BuildContext, Built, DeviceKind, MountSpec, PortInfo, Settings, ValueRow, read_settings,
    schema_of,
};
use crate::codec;
use crate::rig::{AnyDevice, LinkKind, Rig};
use crate::scenario::{ScenarioError, Span};

/// Settings of a motor board. It drives and counts the wheels `left` and `right` of the chassis.
/// The defaults are those of a robot with two 12 V gear motors and six range sensors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WheelBoardSpec {
    /// Radius of the wheels, metres, 0.001 to 1; 0.0375 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.001, max = 1.0))]
    pub wheel_radius_m: Option<f64>,
    /// Speed of a wheel per volt at its motor, rpm, 0.1 to 10000; 40 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.1, max = 10_000.0))]
    pub rpm_per_v: Option<f64>,
    /// Greatest relative deviation of a motor from `rpm_per_v`, drawn once per run, 0 to 0.5; 0.05
    /// if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub rpm_spread: Option<f64>,
    /// Voltage below which friction stops a wheel, 0 to 100; 0.5 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub dead_band_v: Option<f64>,
    /// Whether the left and the right motor are mounted reversed; only the right one if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mirrored: Option<[bool; 2]>,
    /// Voltage of the full battery, 1 to 160; 12 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1.0, max = 160.0))]
    pub supply_v: Option<f64>,
    /// Voltage loss of the battery per hour: at rest, and in addition at full drive, volts, 0 to
    /// 100000 each; 0.1 and 0.9 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drain_v_per_h: Option<[f64; 2]>,
    /// Standard deviation of a range sensor's voltage, 0 to 3; 0.015 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 3.0))]
    pub range_noise_v: Option<f64>,
    /// Range sensors at the channels of the ADC from 0 on, eight at most; six around the robot,
    /// clockwise from ahead, if none is given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub range_sensor: Vec<MountSpec>,
    /// Times at which the button is pressed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub press: Vec<PressSpec>,
}

/// A press of the button.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PressSpec {
    /// Start time.
    pub at: Span,
    /// Duration; 200 ms if not given.
    #[serde(default = "usual_press")]
    pub lasting: Span,
}

fn usual_press() -> Span {
    Span::from_millis(200)
}

impl From<PressSpec> for Press {
    fn from(spec: PressSpec) -> Self {
        Self {
            at: spec.at.instant(),
            lasting: spec.lasting.0,
        }
    }
}

const EXAMPLE: &str = r#"[device.wheels.wheel-board]
rpm_per_v = 25
mirrored = [false, true]
range_sensor = [{ x_m = 0.1, y_m = 0, heading_deg = 0 }]

[[device.wheels.wheel-board.press]]
at = "2s"
"#;

/// The kind `wheel-board`.
pub const WHEEL_BOARD: &dyn DeviceKind = &WheelBoardKind;

struct WheelBoardKind;

impl DeviceKind for WheelBoardKind {
    fn name(&self) -> &'static str {
        "wheel-board"
    }

    fn about(&self) -> &'static str {
        "Motor board of timers, PWM and ADC, with range sensors"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<WheelBoardSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<WheelBoardSpec>(settings)
    }

    fn rows(&self, _: &dyn Settings, rig: &Rig, name: &str) -> Vec<ValueRow> {
        let board = rig.device::<WheelBoard>(name);
        board.map_or(Vec::new(), rows)
    }

    fn check(
        &self,
        context: &BuildContext<'_>,
        _: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        let source = context.source;
        WheelBoard::check_chassis(world.chassis())
            .map_err(|message| source.invalid(source.find(context.name), context.key(), message))
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &WheelBoardSpec = context.settings()?;
        let config = spec.config(context)?;
        let line = LineConfig::new_8n1(BAUD);
        let bus = PortInfo::uart("bus", WheelBoard::BUS, line, "the robot's timers and ADC");
        let bus = bus.in_pieces(SAMPLE_LEN).on(LinkKind::Pin);
        Ok(Built {
            device: Box::new(WheelBoard::new(context.name, context.seed, config)),
            ports: vec![bus.at_any_rate(line).speaking(&codec::PERIPHERALS)],
        })
    }
}

impl WheelBoardSpec {
    fn config(&self, context: &BuildContext<'_>) -> Result<Config, ScenarioError> {
        context.within("wheel_radius_m", self.wheel_radius_m, 0.001..=1.0)?;
        context.within("rpm_per_v", self.rpm_per_v, 0.1..=10_000.0)?;
        context.within("rpm_spread", self.rpm_spread, 0.0..=0.5)?;
        context.within("dead_band_v", self.dead_band_v, 0.0..=100.0)?;
        context.within("supply_v", self.supply_v, 1.0..=160.0)?;
        for volts in self.drain_v_per_h.iter().flatten() {
            context.within("drain_v_per_h", Some(*volts), 0.0..=100_000.0)?;
        }
        context.within("range_noise_v", self.range_noise_v, 0.0..=3.0)?;
        let sensors = self.range_sensor.len();
        if sensors > usize::from(CHANNELS) {
            let source = context.source;
            let message = format!("has {sensors} sensors, expected at most {CHANNELS}");
            let key = format!("{}.range_sensor", context.key());
            return Err(source.invalid(source.find("range_sensor"), key, message));
        }
        let mut config = Config::default();
        let motor = &mut config.motor;
        motor.rpm_per_v = self.rpm_per_v.unwrap_or(motor.rpm_per_v);
        motor.spread = self.rpm_spread.unwrap_or(motor.spread);
        motor.dead_band_v = self.dead_band_v.unwrap_or(motor.dead_band_v);
        config.wheel_radius_m = self.wheel_radius_m.unwrap_or(config.wheel_radius_m);
        config.mirrored = self.mirrored.unwrap_or(config.mirrored);
        config.supply_v = self.supply_v.unwrap_or(config.supply_v);
        config.drain_v_per_h = self.drain_v_per_h.unwrap_or(config.drain_v_per_h);
        config.range_noise_v = self.range_noise_v.unwrap_or(config.range_noise_v);
        if sensors > 0 {
            config.range_sensors = range_sensors(&self.range_sensor, context)?;
        }
        config.presses = self.press.iter().copied().map(Press::from).collect();
        Ok(config)
    }
}

fn range_sensors(
    mounts: &[MountSpec],
    context: &BuildContext<'_>,
) -> Result<Vec<RangeSensor>, ScenarioError> {
    let sensor = |mount: &MountSpec| {
        mount.check(context)?;
        Ok(RangeSensor {
            x_m: mount.x_m,
            y_m: mount.y_m,
            angle_rad: mount.heading_deg.to_radians(),
        })
    };
    mounts.iter().map(sensor).collect()
}

fn rows(board: &WheelBoard) -> Vec<ValueRow> {
    let row = |name: String, value: i64| ValueRow::new(None, name, value);
    let outputs = board.outputs();
    let [left, right] = board.counters().map(i64::from);
    let fixed = [
        ("counter left", left),
        ("counter right", right),
        ("duty left, of 10000", outputs.duty[0].into()),
        ("duty right, of 10000", outputs.duty[1].into()),
        ("drivers on", outputs.enable.into()),
        ("supply, mV", millivolts(board.supply_v())),
    ];
    let fixed = fixed.map(|(name, value)| row(name.to_owned(), value));
    let ranges = board.range_volts().enumerate();
    let ranges = ranges.map(|(index, volts)| row(format!("range {index}, mV"), millivolts(volts)));
    fixed.into_iter().chain(ranges).collect()
}

fn millivolts(volts: f64) -> i64 {
    #[expect(clippy::cast_possible_truncation, reason = "a few volts")]
    let whole = (volts * 1_000.0).round() as i64;
    whole
}
