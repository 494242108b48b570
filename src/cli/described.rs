//! Descriptions given to commands by name or file.

use std::path::Path;
use std::sync::Arc;

use ::description::Description;

use super::CliError;
use crate::scenario::device::description;

/// Reads the description `name`: one that comes with the tool, or a file that ends with `.toml`.
/// Errors name `option`.
pub(super) fn load(option: &str, name: &str) -> Result<Arc<Description>, CliError> {
    let loaded = description::load(name, Path::new(""));
    loaded.map_err(|error| CliError::Usage(format!("{option}: {error}")))
}
