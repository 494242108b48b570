//! Common parts of `program` and `firmware`, the kinds of devices that a process emulates.

use core::any::Any;
use std::path::{Path, PathBuf};

use emulators::quantity::{ValueSource, Wanted};
use emulators::world::World;
use nodes::NodeDevice;

use super::{BuildContext, DeviceValue, Drives, ValueRow, kind};
use crate::rig::{AnyDevice, Rig};
use crate::scenario::drives::DrivesSpec;
use crate::scenario::{Operand, ScenarioError};

/// Stores the folder `base` in `folder`, so that a saved case runs in any folder.
pub(super) fn embed(folder: &mut Option<PathBuf>, base: &Path) {
    let base = match base.as_os_str().is_empty() {
        true => Path::new("."),
        false => base,
    };
    let whole = match folder {
        Some(folder) => base.join(folder),
        None => base.to_owned(),
    };
    *folder = Some(std::path::absolute(&whole).unwrap_or(whole));
}

/// The folder to which the paths of the device's files are relative.
pub(super) fn base(folder: Option<&Path>, context: &BuildContext<'_>) -> PathBuf {
    let parent = context.source.path.parent();
    let base = parent.unwrap_or_else(|| Path::new(""));
    match folder {
        Some(folder) => base.join(folder),
        None => base.to_owned(),
    }
}

/// Output values of a node program, for conditions.
pub(super) fn values_of(rig: &Rig, name: &str) -> Vec<DeviceValue> {
    let node = rig.device::<NodeDevice>(name).into_iter();
    let outputs = node.flat_map(NodeDevice::outputs);
    let value = |(name, value): (&str, f64)| DeviceValue {
        address: None,
        name: name.to_owned(),
        value: Operand::Number(value),
    };
    outputs.map(value).collect()
}

/// Names of the outputs that a node program has declared.
pub(super) fn names_of(rig: &Rig, name: &str) -> Vec<String> {
    let node = rig.device::<NodeDevice>(name).into_iter();
    let names = node.flat_map(NodeDevice::output_names);
    names.map(str::to_owned).collect()
}

/// Output values of a node program, for display.
pub(super) fn rows_of(rig: &Rig, name: &str) -> Vec<ValueRow> {
    let node = rig.device::<NodeDevice>(name).into_iter();
    let outputs = node.flat_map(NodeDevice::outputs);
    let row = |(name, value): (&str, f64)| {
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let whole = value.round() as i64;
        #[expect(
            clippy::cast_precision_loss,
            reason = "compared with what it came from"
        )]
        let is_whole = (whole as f64 - value).abs() < 1e-9;
        ValueRow {
            shown: (!is_whole).then(|| value.to_string()),
            ..ValueRow::new(None, name, whole)
        }
    };
    outputs.map(row).collect()
}

/// The actuators of the outputs `drives`, each with its key; such a device has no watchdog.
pub(super) fn driven<'a>(drives: impl Iterator<Item = (String, &'a DrivesSpec)>) -> Option<Drives> {
    let driven = drives.map(|(key, spec)| {
        let actuator = spec.actuator.get_ref().clone();
        let place = (format!("{key}.actuator"), spec.actuator.span());
        ((actuator, None), place)
    });
    let (actuators, places): (Vec<_>, Vec<_>) = driven.unzip();
    (!actuators.is_empty()).then_some(Drives {
        silence_max: None,
        actuators,
        places,
    })
}

/// Checks that the chassis of `world` has the encoders and actuators of the node.
pub(super) fn check(
    context: &BuildContext<'_>,
    device: &dyn AnyDevice,
    world: &World,
) -> Result<(), ScenarioError> {
    let device: &dyn Any = device;
    let Some(node) = device
        .downcast_ref::<NodeDevice>()
        .filter(|_| context.has_robot)
    else {
        return Ok(());
    };
    let chassis = world.chassis();
    let mut wrong = Vec::new();
    for drive in &node.spec().drives {
        if let Some(message) = Wanted::Actuator(&drive.sink).missing(chassis) {
            let own = format!("drives.{}", drive.output);
            let drives = kind(context.kind).and_then(|kind| kind.drives(context.settings));
            let mut places = drives.into_iter().flat_map(|drives| drives.places);
            let place = places.find(|(key, _)| *key == format!("{own}.actuator"));
            let span = place.map(|(_, span)| span);
            let span = span.or_else(|| context.source.find(context.name));
            let key = format!("{}.{own}", context.key());
            wrong.push(context.source.invalid(span, key, message));
        }
    }
    for quantity in &node.spec().quantities {
        let encoder = match &quantity.source {
            ValueSource::Encoder(wheel) => wheel.name(),
            ValueSource::EncoderNamed(name) => name,
            _ => continue,
        };
        if let Some(message) = Wanted::Encoder(encoder).missing(chassis) {
            let span = context.source.find(&quantity.name);
            let key = format!("{}.quantities.{}", context.key(), quantity.name);
            wrong.push(context.source.invalid(span, key, message));
        }
    }
    ScenarioError::none_of(wrong)
}
