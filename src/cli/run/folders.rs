//! The result folders of the files of one command: each file has its own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{RunArgs, Runnable};
use crate::cli::{CliError, default_out};

/// The result folder of a scenario.
pub(super) fn folder_of(args: &RunArgs, name: &str, seed: u64, several: bool) -> PathBuf {
    match &args.out {
        Some(out) if several => out.join(format!("{name}-{seed}")),
        Some(out) => out.clone(),
        None => default_out(name, seed),
    }
}

/// Rejects two runs with the same result folder; names the file that writes no folder.
pub(super) fn check_folders(
    args: &RunArgs,
    files: &[(&PathBuf, Runnable)],
) -> Result<(), CliError> {
    let mut taken = BTreeMap::new();
    for (path, file) in files {
        match file {
            Runnable::Scenario(scenario) => {
                let seed = args.seed.unwrap_or(scenario.0.seed);
                let first = taken.insert((&scenario.0.name, seed), path);
                if let Some(first) = first {
                    let (name, first, path) = (&scenario.0.name, first.display(), path.display());
                    return Err(CliError::Usage(format!(
                        "{first} and {path} are both \"{name}\" with seed {seed} and would write the \
                         same result folder; change one of the names, or run one file at a time"
                    )));
                }
            }
            Runnable::Case(_) if args.out.is_some() && args.program.exec.is_none() => {
                let path = path.display();
                eprintln!("{path}: a case of bytes writes no result folder, so --out is ignored");
            }
            Runnable::Case(_) => {}
        }
    }
    Ok(())
}

/// The folders of cases of bytes. The name of a case is that of its file, so cases of several
/// folders may have the same name.
#[derive(Debug, Default)]
pub(super) struct Folders(Vec<PathBuf>);

impl Folders {
    /// A folder for the case `name`: `out`, or the usual one; with `several` files, one in it.
    pub(super) fn of_case(&mut self, out: Option<&Path>, name: &str, several: bool) -> PathBuf {
        let own = match out {
            Some(out) if !several => out.to_owned(),
            Some(out) => out.join(name),
            None => Path::new("hilrig-out").join(name),
        };
        let numbered = (2..).map(|number| {
            let mut name = own.clone().into_os_string();
            name.push(format!("-{number}"));
            PathBuf::from(name)
        });
        let mut all = core::iter::once(own.clone()).chain(numbered);
        let free = all.find(|folder| !self.0.contains(folder)).unwrap_or(own);
        self.0.push(free.clone());
        free
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_of_one_name_have_folders_of_their_own() {
        let mut folders = Folders::default();
        let mut of = |out: Option<&str>, several| folders.of_case(out.map(Path::new), "x", several);
        assert_eq!(of(None, true), Path::new("hilrig-out/x"));
        assert_eq!(of(None, true), Path::new("hilrig-out/x-2"));
        assert_eq!(of(Some("o"), true), Path::new("o/x"));
        assert_eq!(of(Some("o"), true), Path::new("o/x-2"));
        assert_eq!(of(Some("o"), false), Path::new("o"));
    }
}
