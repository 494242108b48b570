//! Descriptions by name or file.

use core::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use ::description::{Description, DescriptionError, shipped};

use crate::near;

/// Error when a description cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read; the text names the expected file.
    #[error("{0}")]
    Read(String),
    /// The file was read, but its contents are wrong.
    #[error(transparent)]
    Description(#[from] DescriptionError),
}

/// Reads the description `name`: one that comes with the tool, or a file that ends with `.toml`,
/// relative to the folder `base`.
///
/// # Errors
/// If the description does not exist or is wrong.
pub fn load(name: &str, base: &Path) -> Result<Arc<Description>, LoadError> {
    if !name.ends_with(".toml") {
        let nothing = |file: &str| Err(format!("cannot read {file}: there is no folder"));
        let text = shipped::text(name).ok_or_else(|| {
            let known: Vec<_> = shipped::ALL.iter().map(|(name, _)| *name).collect();
            let all = known.join(", ");
            let expected = match near::meant(name, &known) {
                Some(meant) => format!("did you mean \"{meant}\"? Expected one of {all}"),
                None => format!("expected one of {all}"),
            };
            LoadError::Read(format!(
                "there is no description \"{name}\", {expected}, or a file that ends with .toml"
            ))
        })?;
        return Ok(Description::parse(&format!("<{name}>"), text, &nothing)?);
    }
    Ok(read_file(name, base)?.0)
}

/// A description, its text, and the files that it names.
type Read = (Arc<Description>, String, BTreeMap<String, String>);

fn read_file(name: &str, base: &Path) -> Result<Read, LoadError> {
    let path = base.join(name);
    let read = |path: &Path| {
        std::fs::read_to_string(path)
            .map_err(|error| format!("cannot read {}: {error}", path.display()))
    };
    let text = read(&path).map_err(LoadError::Read)?;
    let folder = path.parent().unwrap_or(base);
    let files = RefCell::new(BTreeMap::new());
    let beside = |file: &str| {
        let text = read(&folder.join(file))?;
        files.borrow_mut().insert(file.to_owned(), text.clone());
        Ok(text)
    };
    let description = Description::parse(&path.display().to_string(), &text, &beside)?;
    Ok((description, text, files.into_inner()))
}

/// The text of the description in the file `name`, and the texts of the files that it names.
///
/// # Errors
/// If a file cannot be read or is wrong.
pub(super) fn texts(
    name: &str,
    base: &Path,
) -> Result<(String, BTreeMap<String, String>), LoadError> {
    let (_, text, files) = read_file(name, base)?;
    Ok((text, files))
}
