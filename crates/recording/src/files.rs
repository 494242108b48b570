//! The files of a recording: the newest has the plain name, older ones are put aside, the oldest
//! go. Other processes may move or delete those at any time; a recording does without.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

use crate::pcapng::SECTION;

/// How much a recording may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// A file that has grown to this is put aside and a new one begun.
    pub file_bytes: u64,
    /// Files put aside that are kept; older ones are deleted.
    pub files: u64,
    /// What becomes of files that are there already.
    pub existing: Existing,
}

/// What becomes of a file that has a recording's name already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// It is replaced.
    Replaced,
    /// It is put aside as if this recording had written it, and numbers continue where they were.
    SetAside,
}

impl Default for Limits {
    /// Three quarters of an hour a file, at 6 MB a minute of the rescue robot; 2 GiB in all.
    fn default() -> Self {
        Self {
            file_bytes: 256 << 20,
            files: 7,
            existing: Existing::Replaced,
        }
    }
}

/// Writes whole blocks, and begins the next file when one is full.
#[derive(Debug)]
pub(super) struct Files {
    path: PathBuf,
    file: File,
    limits: Limits,
    head: Vec<u8>,
    written: u64,
    set_aside: u64,
}

impl Files {
    /// Begins the first file with `head`, as each file begins.
    pub(super) fn create(path: &Path, head: Vec<u8>, limits: Limits) -> io::Result<Self> {
        let mut set_aside = 0;
        if limits.existing == Existing::SetAside {
            set_aside = last_number(path)?;
            if holds_capture(path)? {
                set_aside += 1;
                safefs::rename(path, &aside(path, set_aside))?;
            }
        }
        let mut files = Self {
            file: safefs::create(path)?,
            path: path.to_owned(),
            limits,
            head,
            written: 0,
            set_aside,
        };
        files.begin()?;
        Ok(files)
    }

    fn begin(&mut self) -> io::Result<()> {
        self.file.write_all(&self.head)?;
        self.written = self.head.len() as u64;
        Ok(())
    }

    /// After an error nothing more can be written; what is in the file stays whole.
    pub(super) fn write(&mut self, blocks: &[u8]) -> io::Result<()> {
        if let Err(error) = self.file.write_all(blocks) {
            // A piece of a block may have come through before the disk was full.
            let _ = self.file.set_len(self.written);
            return Err(error);
        }
        self.written += blocks.len() as u64;
        if self.written >= self.limits.file_bytes {
            self.rotate()?;
        }
        Ok(())
    }

    /// `capture.1.pcapng` is the first put aside. One that is gone needs neither be named nor
    /// deleted.
    fn rotate(&mut self) -> io::Result<()> {
        self.set_aside += 1;
        or_gone(safefs::rename(
            &self.path,
            &aside(&self.path, self.set_aside),
        ))?;
        if let Some(old) = self.set_aside.checked_sub(self.limits.files)
            && old > 0
        {
            or_gone(safefs::remove_file(&aside(&self.path, old)))?;
        }
        self.file = safefs::create(&self.path)?;
        self.begin()
    }
}

/// The file with this number among those put aside.
fn aside(path: &Path, number: u64) -> PathBuf {
    path.with_extension(format!("{number}.{EXTENSION}"))
}

const EXTENSION: &str = "pcapng";

/// The files around `path` that the same recording may have written, in the order of time, and the
/// place of `path` among them: those put aside, the newest last. A gap in their numbers ends them.
pub(super) fn around(path: &Path) -> (Vec<PathBuf>, usize) {
    let alone = || (vec![path.to_owned()], 0);
    let Some(stem) = path.file_stem().map(Path::new) else {
        return alone();
    };
    let number: Option<u64> = stem
        .extension()
        .and_then(|number| number.to_str()?.parse().ok());
    let newest = match number {
        Some(_) => path.with_file_name(stem).with_extension(EXTENSION),
        None => path.to_owned(),
    };
    // No other name, as 01, is one that a recording gave.
    if number.is_some_and(|number| aside(&newest, number) != path) {
        return alone();
    }
    let is_there = |number: &u64| aside(&newest, *number).is_file();
    let last = match number {
        Some(number) => (number..=u64::MAX)
            .take_while(is_there)
            .last()
            .unwrap_or(number),
        None => last_number(path).unwrap_or(0),
    };
    let first = (1..=last).rev().take_while(is_there).last();
    let numbers = first.into_iter().flat_map(|first| first..=last);
    let mut files: Vec<PathBuf> = numbers.map(|number| aside(&newest, number)).collect();
    if number.is_none() || newest.is_file() {
        files.push(newest);
    }
    let place = files.iter().position(|file| file == path);
    place.map_or_else(alone, |place| (files, place))
}

fn or_gone(done: io::Result<()>) -> io::Result<()> {
    match done {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

/// The highest number of a file put aside; 0 if there is none.
fn last_number(path: &Path) -> io::Result<u64> {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mut last = 0;
    for entry in fs::read_dir(folder)? {
        let name = PathBuf::from(entry?.file_name());
        let number = name.file_stem().map(Path::new).and_then(Path::extension);
        let number = number.and_then(|number| number.to_str()?.parse().ok());
        let is_ours = |number| aside(path, number).file_name() == Some(name.as_os_str());
        if let Some(number) = number.filter(|&number| is_ours(number)) {
            last = last.max(number);
        }
    }
    Ok(last)
}

/// Whether an earlier recording is at `path`.
///
/// # Errors
/// If something else is there, which must not be touched.
fn holds_capture(path: &Path) -> io::Result<bool> {
    let meta = match fs::metadata(path) {
        Ok(meta) => meta,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
    };
    // A pipe, say, with another reader.
    if !meta.is_file() || meta.len() == 0 {
        return Ok(false);
    }
    let mut head = [0; 4];
    let read = File::open(path)?.read_exact(&mut head);
    match read.is_ok() && head == SECTION.to_le_bytes() {
        true => Ok(true),
        false => Err(io::Error::new(
            io::ErrorKind::AlreadyExists,
            "the file there is no capture, expected one or a free name",
        )),
    }
}

#[cfg(test)]
mod tests;
