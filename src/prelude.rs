//! All items that a test or a tool in another crate needs, from this single dependency: `use
//! hilrig::prelude::*`.
//!
//! The crates below this one are here too, as [`emulators`], [`firmware_core`] and [`protocols`],
//! and also `serde`, `schemars` and `toml`, which the settings of a [`DeviceKind`] need. Derive
//! macros need the paths of these crates:
//!
//! ```
//! use hilrig::prelude::*;
//!
//! #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
//! #[serde(crate = "hilrig::serde", deny_unknown_fields)]
//! #[schemars(crate = "hilrig::schemars")]
//! struct BeaconSpec {
//!     /// Time between two packets.
//!     period: Span,
//! }
//!
//! let verdict = judge("schema = 2").map(|outcome| outcome.passed());
//! assert!(verdict.is_err_and(|error| error.to_string().contains("schema: is 2, expected 1")));
//! ```
//!
//! | to | start with |
//! |---|---|
//! | judge a scenario | [`judge`], [`Run`], [`Outcome::assert_passed`] |
//! | test a driver that reads and writes a serial port | [`Bench`] |
//! | add a device | [`Device`], [`DeviceKind`], [`register_device`] |
//! | add a robot | [`Robot`], [`Instruments`], [`register_robot`] |
//! | run a program in this process | [`Master`], [`Inspect`] |
//! | add a wire format | [`Format`], [`Wire`], [`Codec`], [`register_codec`] |
//! | add a check | [`Checker`] |

pub use core::time::Duration;

pub use emulators::world::{
    Ackermann, AckermannConfig, BodyConfig, Chassis, Command, Differential, Point, Pose, Scene,
    Shape, World,
};
pub use emulators::{Device, Event, EventKind};
pub use firmware_core::map_view::MapView;
pub use firmware_core::pose::Pose as ProgramPose;
pub use firmware_core::{Inspect, Master, Work};
pub use ports::{Bench, VirtualPort};
pub use protocols::{
    Candidate, Decode, Decoder, Format, FrameError, Instant, LineConfig, LineEvent, Port,
};
pub use schemars::{JsonSchema, Schema, SchemaGenerator};
pub use serde::{Deserialize, Serialize};
pub use toml::de::ValueDeserializer;

pub use crate::NameTaken;
pub use crate::codec::wire::{Choices, Wire};
pub use crate::codec::{Codec, register as register_codec};
pub use crate::rig::line::{Direction, End};
pub use crate::rig::{AnyDevice, LinkKind, Logged, PortRate, Program, Rig};
pub use crate::robots::{
    Alone, Axis, Check, Checker, Dut, Instruments, Look, OpenEnd, Overlay, OverlayRole, Panel,
    PanelRow, PcEnd, Robot, Status, WirePlan, Wired, register as register_robot,
};
pub use crate::run::{Outcome, Run, judge};
pub use crate::scenario::device::scan::{Beam, ScanDecoder};
pub use crate::scenario::device::{
    BuildContext, Built, DeviceKind, PortInfo, Settings, ValueRow, kind as device_kind,
    read_settings, register as register_device, schema_of,
};
pub use crate::scenario::{FaultKind, FaultSpec, Scenario, ScenarioError, Source, Span};
#[cfg(feature = "command")]
pub use capture::Capture;
