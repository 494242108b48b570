//! Files of a recording. The newest file has the plain name; a full file is renamed with a number;
//! the oldest files are deleted. Other processes may move or delete these files at any time; the
//! recording continues.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

use crate::pcapng::{SECTION, write_whole};

/// Limits on the disk space of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Size at which a file is renamed and the next file begins.
    pub file_bytes: u64,
    /// Number of renamed files that are kept; older ones are deleted.
    pub files: u64,
    /// Treatment of existing files.
    pub existing: Existing,
}

/// Treatment of a file that already has the name of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// The existing file is replaced.
    Replaced,
    /// The existing file is renamed as if this recording had written it; numbers continue from the
    /// highest existing one.
    SetAside,
}

impl Default for Limits {
    /// A file lasts 45 minutes at 6 MB a minute, the rate of the rescue robot; 2 GiB in all.
    fn default() -> Self {
        Self {
            file_bytes: 256 << 20,
            files: 7,
            existing: Existing::Replaced,
        }
    }
}

/// Writer of whole blocks, which begins the next file when one is full.
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
    /// Begins the first file with `head`; each later file begins with the same bytes.
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

    /// Appends whole blocks. After an error, nothing more can be written; the file keeps whole
    /// blocks only.
    pub(super) fn write(&mut self, blocks: &[u8]) -> io::Result<()> {
        if let Err((kept, error)) = write_whole(&mut self.file, blocks) {
            // A part of a block may have been written before the disk was full.
            self.written += kept as u64;
            let _ = self.file.set_len(self.written);
            let whole = self.written;
            let message =
                format!("{error}; the first {whole} bytes of the file are a whole capture");
            return Err(io::Error::new(error.kind(), message));
        }
        self.written += blocks.len() as u64;
        if self.written >= self.limits.file_bytes {
            self.rotate()?;
        }
        Ok(())
    }

    /// Renames the full file; `capture.1.pcapng` is the first. A file that another process removed
    /// needs neither a rename nor a deletion.
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

/// Path of the renamed file with this number.
fn aside(path: &Path, number: u64) -> PathBuf {
    path.with_extension(format!("{number}.{EXTENSION}"))
}

const EXTENSION: &str = "pcapng";

/// Files that the same recording as `path` may have written, in order of time, and the index of
/// `path` among them: renamed files first, the newest file last. A gap in the numbers ends the
/// list.
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
    // A recording never writes a name such as 01.
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

/// The highest number of a renamed file; 0 if there is none.
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

/// Whether `path` holds an earlier recording.
///
/// # Errors
/// If `path` holds another file, which the recording must not overwrite.
fn holds_capture(path: &Path) -> io::Result<bool> {
    let meta = match fs::metadata(path) {
        Ok(meta) => meta,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
    };
    // For example a pipe that another process reads.
    if !meta.is_file() || meta.len() == 0 {
        return Ok(false);
    }
    let mut head = [0; 4];
    let read = safefs::open(path)?.read_exact(&mut head);
    match read.is_ok() && head == SECTION.to_le_bytes() {
        true => Ok(true),
        false => Err(io::Error::new(
            io::ErrorKind::AlreadyExists,
            "the existing file is not a capture, expected a capture or a free name",
        )),
    }
}

#[cfg(test)]
mod tests;
