//! The files of the repository, without build results and results of runs.

use std::fs;
use std::path::{Path, PathBuf};

/// A text file: its path from the root with forward slashes, and its content.
pub(crate) struct File {
    pub(crate) path: String,
    pub(crate) text: String,
}

impl File {
    /// An invented file, to test a rule.
    pub(crate) fn sample(path: &str, text: &str) -> Self {
        Self {
            path: path.to_owned(),
            text: text.to_owned(),
        }
    }

    /// Whether the whole file is part of the tests.
    pub(crate) fn is_test(&self) -> bool {
        let is_in = |folder: &&str| {
            self.path.starts_with(*folder) || self.path.contains(&format!("/{folder}"))
        };
        // The folder "fuzz" below the sources is product code, the one beside them is not.
        ["tests/", "benches/"].iter().any(is_in)
            || self.path.starts_with("fuzz/")
            || self.path.ends_with("/tests.rs")
    }

    /// The lines of a Rust file before its own tests, numbered from 1.
    pub(crate) fn product_lines(&self) -> impl Iterator<Item = (usize, &str)> {
        let lines = (1..).zip(self.text.lines());
        lines.take_while(|&(_, line)| line != "#[cfg(test)]")
    }
}

/// Names of the functions that `text` defines without type parameters, as tests are.
pub(crate) fn functions(text: &str) -> impl Iterator<Item = &str> {
    let rust = text.split("fn ").skip(1);
    let python = text.split("def ").skip(1);
    rust.chain(python).filter_map(|rest| {
        let after = rest.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
        after
            .starts_with('(')
            .then(|| &rest[..rest.len() - after.len()])
    })
}

/// The root of the repository.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All text files whose name ends in one of `endings`, in order of their paths.
pub(crate) fn all(endings: &[&str]) -> Vec<File> {
    let mut paths = Vec::new();
    collect(root(), &mut paths);
    paths.sort();
    let files: Vec<File> = paths
        .into_iter()
        .filter(|path| {
            endings
                .iter()
                .any(|ending| path.to_string_lossy().ends_with(ending))
        })
        .map(|path| File {
            text: fs::read_to_string(&path)
                .unwrap_or_else(|error| panic!("{}: {error}", path.display())),
            path: path
                .strip_prefix(root())
                .expect("below the root")
                .to_string_lossy()
                .into_owned(),
        })
        .collect();
    assert!(!files.is_empty(), "no file ends in {endings:?}");
    files
}

fn collect(folder: &Path, paths: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    for entry in entries {
        let path = entry.expect("a readable entry").path();
        let name = path
            .file_name()
            .expect("entries have names")
            .to_string_lossy();
        let skipped = ["target", "hilrig-out", "node_modules"].contains(&&*name)
            || (name.starts_with('.') && name != ".ci");
        if path.is_symlink() || skipped {
            continue;
        }
        if path.is_dir() {
            collect(&path, paths);
        } else {
            paths.push(path);
        }
    }
}
