//! Descriptions given to commands by name or file, and the described device of a scenario.

use std::path::Path;
use std::sync::Arc;

use ::description::Description;
use ::description::peer::Emulated;

use super::CliError;
use crate::scenario::device::description::{self, DescriptionSpec};
use crate::scenario::{Scenario, Source};

/// Reads the description `name`: one that comes with the tool, or a file that ends with `.toml`.
/// Errors name `option`.
pub(super) fn load(option: &str, name: &str) -> Result<Arc<Description>, CliError> {
    let loaded = description::load(name, Path::new(""));
    loaded.map_err(|error| CliError::Usage(format!("{option}: {error}")))
}

/// The same for a device with another address than the described one.
pub(super) fn load_at(name: &str, address: Option<u32>) -> Result<Arc<Description>, CliError> {
    let described = load("--description", name)?;
    let Some(address) = address else {
        return Ok(described);
    };
    let other = described.with_address(address);
    other.map_err(|error| CliError::Usage(format!("--address: {error}")))
}

/// The name of a scenario's device: `link`, or the only one.
pub(super) fn device_name(scenario: &Scenario, link: Option<&str>) -> Result<String, CliError> {
    let names: Vec<&str> = scenario.device.keys().map(String::as_str).collect();
    let wrong = |message: String| {
        let known = names.join(", ");
        CliError::Usage(format!("{message}, expected one of: {known}"))
    };
    match (link, &names[..]) {
        (Some(name), names) if names.contains(&name) => Ok(name.to_owned()),
        (Some(name), _) => Err(wrong(format!("--link {name}: no such device"))),
        (None, [only]) => Ok((*only).to_owned()),
        (None, many) => {
            let count = many.len();
            Err(wrong(format!(
                "--link is missing: there are {count} devices"
            )))
        }
    }
}

/// A device of a scenario in virtual time, without the scenario's faults.
pub(super) fn emulated(
    (scenario, source): (&Scenario, &Source),
    name: &str,
    seed: u64,
) -> Result<Emulated, CliError> {
    let spec = scenario.device.get(name);
    let spec = spec.ok_or_else(|| CliError::Usage(format!("--link {name}: no such device")))?;
    let built = spec.build(name, seed, source)?;
    let port = built.ports.first().map(|port| port.port);
    let port = port.ok_or_else(|| CliError::Usage(format!("--link {name}: it has no port")))?;
    Ok(Emulated::new(built.device, port))
}

/// The description of a scenario's device, at its address; of several on one wire the first one.
pub(super) fn of_device(
    (scenario, source): (&Scenario, &Source),
    name: &str,
) -> Result<Option<Arc<Description>>, CliError> {
    let spec = scenario.device.get(name);
    let Some(DescriptionSpec(units)) = spec.and_then(|spec| spec.settings()) else {
        return Ok(None);
    };
    let Some(unit) = units.first() else {
        return Ok(None);
    };
    let base = source.path.parent().unwrap_or_else(|| ".".as_ref());
    let wrong = |error: String| CliError::Usage(format!("--link {name}: {error}"));
    let described = unit.load(base).map_err(|error| wrong(error.to_string()))?;
    match unit.address {
        Some(address) => described.with_address(address).map(Some).map_err(wrong),
        None => Ok(Some(described)),
    }
}
