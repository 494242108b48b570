//! Settings of devices, by kind.

use serde::{Deserialize, Serialize};

use super::{RegistersSpec, Span, TextSpec};

/// Settings of a device, named by its kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum DeviceSpec {
    /// Neato XV-11 lidar.
    Xv11(Xv11Spec),
    /// AVR base with its register bus.
    AvrBase(AvrBaseSpec),
    /// HC-06 radio.
    Hc06(Hc06Spec),
    /// Touch display.
    TouchPanel(TouchPanelSpec),
    /// A register slave of one's own.
    Registers(RegistersSpec),
    /// A text slave of one's own.
    Text(TextSpec),
}

impl DeviceSpec {
    /// Name of the kind, as in a file.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Xv11(_) => "xv11",
            Self::AvrBase(_) => "avr-base",
            Self::Hc06(_) => "hc06",
            Self::TouchPanel(_) => "touch-panel",
            Self::Registers(_) => "registers",
            Self::Text(_) => "text",
        }
    }

    /// Adds a touch, if it is a display.
    pub fn tap(&mut self, tap: TapSpec) {
        if let Self::TouchPanel(spec) = self {
            spec.tap.push(tap);
        }
    }

    /// Whether the scenario describes all of it, so that no robot has to know it.
    pub const fn is_own(&self) -> bool {
        matches!(self, Self::Registers(_) | Self::Text(_))
    }
}

/// Settings of an XV-11.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Xv11Spec {
    /// Firmware: `fw2.1`, `fw2.4.13386`, `fw2.6.15295`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<toml::Spanned<String>>,
    /// What turns the head; 300 rpm held by the rig if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supply: Option<SupplySpec>,
    /// Angle of the first reading to the axis of the housing; sources say -10 or 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub index0_deg: Option<f64>,
    /// Distance between laser beam and axis; sources say 0 to 25.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beam_offset_mm: Option<f64>,
    /// Which way the head turns, seen from above.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<TurnSpec>,
    /// What is wrong with the sensor from the start, by the names of its faults, e.g. `dust`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<toml::Spanned<String>>,
}

/// Senses of rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TurnSpec {
    /// As every report but one says.
    CounterClockwise,
    /// As that one says.
    Clockwise,
}

/// What turns the head of a lidar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SupplySpec {
    /// The rig holds this speed, turns per minute.
    RegulatedRpm(f64),
    /// A fixed voltage.
    FixedV(f64),
    /// The host's drive, this voltage at full duty.
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

/// Settings of an AVR base.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AvrBaseSpec {
    /// Firmware: `document`, `rcj2015-2015`, `rcj2015-2014`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<toml::Spanned<String>>,
    /// How long before the run its tasks ran together, up to 200.8 ms; drawn if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<Span>,
}

/// Settings of an HC-06.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hc06Spec {
    /// Bytes between UART and radio, 700 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fifo_bytes: Option<u16>,
    /// Bytes a second that it moves in one direction, 20500 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_bytes_s: Option<core::num::NonZeroU32>,
    /// Radio silence after which the connection is given up, 20 s if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supervision: Option<Span>,
    /// Firmware: `linvor-1.8`, `hc01-2.0`, `3.0-20170609`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<toml::Spanned<String>>,
    /// Rate of the wire to the microcontroller; the robot's own rate if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Time from the PC opening its port to the first byte passing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub connect_delay: Option<Span>,
}

/// Settings of a touch display.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchPanelSpec {
    /// When it is touched, and where: column and row, 0, 0 at the upper left.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tap: Vec<TapSpec>,
}

/// A touch of a tenth of a second.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TapSpec {
    /// When.
    pub at: Span,
    /// Column and row.
    pub place: [u16; 2],
}
