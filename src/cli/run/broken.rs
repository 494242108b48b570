//! Files that cannot be read or run, beside others that can.

use std::path::Path;

use crate::cli::CliError;
use crate::run::check::Check;
use crate::show::junit::Suite;

/// Such files, each as a failed check: the report of `--junit` contains them and the verdicts of
/// all other files.
#[derive(Default)]
pub(super) struct Broken(Vec<(String, [Check; 1], CliError)>);

impl Broken {
    /// Keeps the error of a file if `is_reported`, so that the other files run. All but the first
    /// are printed here; the command ends with the first.
    pub(super) fn keep(
        &mut self,
        is_reported: bool,
        path: &Path,
        error: CliError,
    ) -> Result<(), CliError> {
        if !is_reported {
            return Err(error);
        }
        if !self.0.is_empty() {
            eprintln!("error: {error}");
        }
        let check = Check::new("file", false, error.to_string());
        self.0.push((path.display().to_string(), [check], error));
        Ok(())
    }

    pub(super) fn suites(&self) -> impl Iterator<Item = Suite<'_>> {
        self.0.iter().map(|(name, checks, _)| Suite {
            name,
            file: None,
            seed: None,
            checks,
            unproved: Vec::new(),
            again: None,
            probable_cause: None,
        })
    }

    /// The first error, if any.
    pub(super) fn end(self) -> Result<(), CliError> {
        let first = self.0.into_iter().next();
        first.map_or(Ok(()), |(.., error)| Err(error))
    }
}
