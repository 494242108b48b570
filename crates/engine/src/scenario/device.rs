//! Devices of a scenario: each has a kind, found by name, and the settings of that kind.

mod avr_base;
mod camera;
pub mod camera_scans;
mod car_board;
#[cfg(feature = "described")]
pub mod description;
#[cfg(feature = "programs")]
pub mod firmware;
mod hc06;
mod kind;
#[cfg(feature = "described")]
pub mod master;
mod mount;
mod mpu6050;
mod odometer;
#[cfg(feature = "programs")]
mod played;
#[cfg(feature = "programs")]
pub mod program;
mod read;
mod registers;
mod rplidar;
pub mod rplidar_scans;
pub mod scan;
mod srf08;
mod text;
mod touch_panel;
mod wheel_board;
mod xv11;
pub mod xv11_scans;

use core::any::Any;
use core::fmt;
use std::collections::BTreeMap;
use std::path::Path;

use serde::ser::{Serialize, SerializeMap, Serializer};
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use emulators::world::World;

use super::{Operand, Scenario, ScenarioError, Source};
use crate::codec::RegisterNames;
use crate::registry::{Named, Registry};
use crate::rig::{AnyDevice, Rig};
use crate::scenario::device::scan::ScanDecoder;

pub use crate::registry::NameTaken;
pub use avr_base::{AVR_BASE, AvrBaseSpec};
pub use camera::{CAMERA, CameraSpec, MarkerSpec};
pub use car_board::{CAR_BOARD, CarBoardSpec};
pub use hc06::{HC06, Hc06Spec};
pub use kind::{
    BuildContext, Built, DeviceKind, DeviceValue, Drives, PortInfo, Settings, ValueRow,
    read_settings, schema_of,
};
pub use mount::MountSpec;
pub use mpu6050::{MPU6050, Mpu6050Spec};
pub use odometer::{ODOMETER, OdometerSpec};
pub(super) use read::read_devices;
pub use rplidar::{MotorSpec, RPLIDAR, RplidarSpec};
pub use srf08::{SRF08, Srf08Spec};
pub use touch_panel::{TOUCH_PANEL, TapSpec, TouchPanelSpec};
pub use wheel_board::{PressSpec, WHEEL_BOARD, WheelBoardSpec};
pub use xv11::{DetailSpec, SupplySpec, TurnSpec, XV11, Xv11Spec};

impl Named for dyn DeviceKind {
    fn name(&self) -> &str {
        DeviceKind::name(self)
    }
}

static KINDS: Registry<dyn DeviceKind> = Registry::new(&[
    XV11,
    AVR_BASE,
    HC06,
    TOUCH_PANEL,
    RPLIDAR,
    WHEEL_BOARD,
    CAR_BOARD,
    ODOMETER,
    CAMERA,
    SRF08,
    MPU6050,
    registers::REGISTERS,
    text::TEXT,
    #[cfg(feature = "described")]
    description::DESCRIPTION,
    #[cfg(feature = "described")]
    master::MASTER,
    #[cfg(feature = "programs")]
    program::PROGRAM,
    #[cfg(feature = "programs")]
    firmware::FIRMWARE,
]);

/// Makes relative paths in the settings of devices relative to `base`, the folder of their file.
pub(super) fn embed(devices: &mut BTreeMap<String, DeviceSpec>, base: &Path) {
    #[cfg(not(feature = "described"))]
    let _ = (devices, base);
    #[cfg(feature = "described")]
    for device in devices.values_mut() {
        if let Some(described) = device.settings_mut::<description::DescriptionSpec>() {
            described.embed(base);
        }
        if let Some(master) = device.settings_mut::<master::MasterSpec>() {
            master.embed(base);
        }
        #[cfg(feature = "programs")]
        if let Some(program) = device.settings_mut::<program::NodeProgramSpec>() {
            program.embed(base);
        }
        #[cfg(feature = "programs")]
        if let Some(firmware) = device.settings_mut::<firmware::FirmwareSpec>() {
            firmware.embed(base);
        }
    }
}

/// Registers a kind of device, for scenarios that are read afterwards.
///
/// # Errors
/// If there is a kind of its name.
pub fn register(kind: impl DeviceKind + 'static) -> Result<(), NameTaken> {
    KINDS.register(Box::new(kind)).map(drop)
}

/// The kind called `name`.
pub fn kind(name: &str) -> Option<&'static dyn DeviceKind> {
    KINDS.find(name)
}

/// All kinds, built-in ones first.
pub fn kinds() -> Vec<&'static dyn DeviceKind> {
    KINDS.all()
}

/// A device of a scenario: its kind and the settings of that kind.
pub struct DeviceSpec {
    kind: &'static dyn DeviceKind,
    settings: Box<dyn Settings>,
}

impl DeviceSpec {
    /// A device of `kind` with `settings`, which must be of the type that the kind reads.
    pub fn new(kind: &'static dyn DeviceKind, settings: impl Settings) -> Self {
        let settings = Box::new(settings);
        Self { kind, settings }
    }

    /// A device of `kind` with default settings.
    ///
    /// # Errors
    /// If the kind requires a key.
    pub fn plain(kind: &'static dyn DeviceKind) -> Result<Self, toml::de::Error> {
        let nothing = Spanned::new(0..0, DeValue::Table(DeTable::new()));
        let settings = kind.parse(ValueDeserializer::from(nothing))?;
        Ok(Self { kind, settings })
    }

    /// Name of the kind, as in a file.
    pub fn kind(&self) -> &'static str {
        self.kind.name()
    }

    /// Whether the names of its values are known only after the run has started.
    pub fn has_late_values(&self) -> bool {
        self.kind.has_late_values()
    }

    /// Names of the events that its settings declare; `None` if they declare none.
    pub fn events(&self) -> Option<&[String]> {
        self.kind.events(&*self.settings)
    }

    /// Adds a touch, if the device is a display.
    pub fn tap(&mut self, tap: TapSpec) {
        if let Some(spec) = self.settings_mut::<TouchPanelSpec>() {
            spec.tap.push(tap);
        }
    }

    /// Whether the scenario describes the device completely. Such a device needs no support by the
    /// robot.
    pub fn is_own(&self) -> bool {
        self.kind.is_own()
    }

    /// The settings, if they are a `T`.
    pub fn settings<T: Settings>(&self) -> Option<&T> {
        let settings: &dyn Any = self.settings.as_ref();
        settings.downcast_ref()
    }

    /// The settings, if they are a `T`, to change them.
    pub fn settings_mut<T: Settings>(&mut self) -> Option<&mut T> {
        let settings: &mut dyn Any = self.settings.as_mut();
        settings.downcast_mut()
    }

    /// Makes the device; `name` and `seed` choose its random stream.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn build(&self, name: &str, seed: u64, source: &Source) -> Result<Built, ScenarioError> {
        self.kind.build(&self.context(name, seed, source))
    }

    fn context<'a>(&'a self, name: &'a str, seed: u64, source: &'a Source) -> BuildContext<'a> {
        BuildContext {
            name,
            seed,
            settings: self.settings.as_ref(),
            kind: self.kind(),
            source,
            has_robot: true,
        }
    }

    /// Checks that `world` contains the actuators and encoders named in the settings of `device`.
    ///
    /// # Errors
    /// If an actuator or encoder does not exist.
    pub fn check(
        &self,
        name: &str,
        source: &Source,
        device: &dyn AnyDevice,
        world: &World,
    ) -> Result<(), ScenarioError> {
        self.check_with(name, source, (device, world), true)
    }

    /// As [`check`](Self::check), for a device that may be used without a robot.
    pub(crate) fn check_with(
        &self,
        name: &str,
        source: &Source,
        (device, world): (&dyn AnyDevice, &World),
        has_robot: bool,
    ) -> Result<(), ScenarioError> {
        let context = BuildContext {
            has_robot,
            ..self.context(name, 0, source)
        };
        self.kind.check(&context, device, world)
    }

    /// Decoder of the turns on the first port, if the device is a lidar.
    pub fn scanner(&self) -> Option<Box<dyn ScanDecoder>> {
        self.kind.scanner(self.settings.as_ref())
    }

    /// Its actuators and its watchdog; `None` without actuators.
    pub fn drives(&self) -> Option<Drives> {
        self.kind.drives(self.settings.as_ref())
    }

    /// The names of the registers, if the device is a slave as data on the bus of registers.
    pub fn register_names(&self) -> Option<RegisterNames> {
        self.settings::<super::RegistersSpec>()
            .map(super::RegistersSpec::names)
    }

    /// Sets the value called `value` of the device `name`.
    ///
    /// # Errors
    /// The reason why the value cannot be set.
    pub fn set(&self, rig: &mut Rig, name: &str, value: &str, to: &Operand) -> Result<(), String> {
        self.kind.set(rig, name, value, to)
    }

    /// Whether the device is a master.
    pub fn is_master(&self) -> bool {
        #[cfg(feature = "described")]
        return self.settings::<master::MasterSpec>().is_some();
        #[cfg(not(feature = "described"))]
        return false;
    }

    /// The device of the scenario that this one polls, if it is a master.
    pub fn polled(&self) -> Option<&str> {
        #[cfg(feature = "described")]
        return self.settings::<master::MasterSpec>()?.of.as_deref();
        #[cfg(not(feature = "described"))]
        return None;
    }

    /// Values of the device `name` in `rig` by their plain names, for conditions.
    pub fn values(&self, rig: &Rig, name: &str) -> Vec<DeviceValue> {
        self.kind.values(self.settings.as_ref(), rig, name)
    }

    /// Names of its values, also of those that it has declared but not shown yet.
    pub fn value_names(&self, rig: &Rig, name: &str) -> Vec<String> {
        self.kind.value_names(self.settings.as_ref(), rig, name)
    }

    /// Rules that the device `name` logs besides those of its kind.
    pub fn own_rules(&self, rig: &Rig, name: &str) -> Vec<&'static str> {
        self.kind.own_rules(rig, name)
    }

    /// The names that `value` of the device `name` can have; `None` if it can have other values.
    pub fn names_of_value<'a>(
        &self,
        rig: &'a Rig,
        name: &str,
        value: &str,
    ) -> Option<Vec<&'a str>> {
        self.kind.names_of_value(rig, name, value)
    }

    /// Values of the device `name` in `rig`, for display.
    pub fn rows(&self, rig: &Rig, name: &str) -> Vec<ValueRow> {
        self.kind.rows(self.settings.as_ref(), rig, name)
    }
}

impl Scenario {
    /// Builds the device `name`; if the scenario does not mention it, a device of `kind` with
    /// default settings.
    ///
    /// # Errors
    /// If a setting is out of range, or a required one is missing.
    pub fn build_device(
        &self,
        name: &str,
        kind: &'static dyn DeviceKind,
        source: &Source,
    ) -> Result<Built, ScenarioError> {
        if let Some(spec) = self.device.get(name) {
            return spec.build(name, self.seed, source);
        }
        let plain = DeviceSpec::plain(kind).map_err(|error| {
            let key = format!("device.{name}.{}", kind.name());
            source.invalid(None, key, error.message())
        })?;
        plain.build(name, self.seed, source)
    }
}

impl Clone for DeviceSpec {
    fn clone(&self) -> Self {
        Self {
            kind: self.kind,
            settings: self.settings.boxed_clone(),
        }
    }
}

impl PartialEq for DeviceSpec {
    fn eq(&self, other: &Self) -> bool {
        self.kind() == other.kind() && self.settings.equals(other.settings.as_ref())
    }
}

impl fmt::Debug for DeviceSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DeviceSpec")
            .field("kind", &self.kind())
            .field("settings", &self.settings)
            .finish()
    }
}

impl Serialize for DeviceSpec {
    /// Serializes as an enum: the variant has the name of the kind and contains the settings.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let settings: &dyn erased_serde::Serialize = self.settings.as_ref();
        let mut map = serializer.serialize_map(Some(1))?;
        map.serialize_entry(self.kind(), settings)?;
        map.end()
    }
}
