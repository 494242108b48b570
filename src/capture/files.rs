//! The files of a recording: the newest has the plain name, older ones are put aside, the oldest
//! go.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// How much a recording may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// A file that has grown to this is put aside and a new one begun.
    pub file_bytes: u64,
    /// Files put aside that are kept; older ones are deleted.
    pub files: u64,
}

impl Default for Limits {
    /// Three quarters of an hour a file, at 6 MB a minute of the rescue robot; 2 GiB in all.
    fn default() -> Self {
        Self {
            file_bytes: 256 << 20,
            files: 7,
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
        let mut files = Self {
            file: File::create(path)?,
            path: path.to_owned(),
            limits,
            head,
            written: 0,
            set_aside: 0,
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

    /// `capture.1.pcapng` is the first put aside.
    fn rotate(&mut self) -> io::Result<()> {
        self.set_aside += 1;
        fs::rename(&self.path, self.aside(self.set_aside))?;
        if let Some(old) = self.set_aside.checked_sub(self.limits.files)
            && old > 0
        {
            fs::remove_file(self.aside(old))?;
        }
        self.file = File::create(&self.path)?;
        self.begin()
    }

    fn aside(&self, number: u64) -> PathBuf {
        self.path.with_extension(format!("{number}.pcapng"))
    }
}
