//! A capture file that is whole at any moment, also on a disk that is full.

use core::time::Duration;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use protocols::Instant;

/// A capture cannot be written. What was written before is whole.
#[derive(Debug, thiserror::Error)]
#[error(
    "cannot write {}: {source}; its first {whole} bytes are a whole capture",
    .path.display()
)]
pub struct FileError {
    /// Which file.
    pub path: PathBuf,
    /// Bytes of it that are whole blocks.
    pub whole: u64,
    /// The error of the operating system.
    pub source: io::Error,
}

/// Blocks on their way to a file. Only whole blocks stay in it.
#[derive(Debug)]
pub struct CaptureFile {
    path: PathBuf,
    file: File,
    buf: Vec<u8>,
    whole: u64,
    sequence: u64,
    flushed_at: Instant,
}

/// Bytes gathered before they are written.
const BUFFER: usize = 64 << 10;
/// What a killed process may lose.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

impl CaptureFile {
    /// Makes the file, or empties it.
    ///
    /// # Errors
    /// Those of the system.
    pub fn create(path: &Path) -> Result<Self, FileError> {
        let file = safefs::create(path).map_err(|source| FileError {
            path: path.to_owned(),
            whole: 0,
            source,
        })?;
        Ok(Self {
            path: path.to_owned(),
            file,
            buf: Vec::new(),
            whole: 0,
            sequence: 0,
            flushed_at: Instant::ZERO,
        })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A number for the next record; each is given once.
    pub const fn next_sequence(&mut self) -> u64 {
        let sequence = self.sequence;
        self.sequence += 1;
        sequence
    }

    /// Appends what `block` appends: one whole block.
    ///
    /// # Errors
    /// If the file can take no more.
    pub fn put(&mut self, block: impl FnOnce(&mut Vec<u8>)) -> Result<(), FileError> {
        block(&mut self.buf);
        if self.buf.len() >= BUFFER {
            self.flush()?;
        }
        Ok(())
    }

    /// Writes what was gathered, if the last time is long ago.
    ///
    /// # Errors
    /// If the file can take no more.
    pub fn flush_if_due(&mut self, now: Instant) -> Result<(), FileError> {
        if now - self.flushed_at >= FLUSH_EVERY {
            self.flushed_at = now;
            self.flush()?;
        }
        Ok(())
    }

    /// Writes what was gathered.
    ///
    /// # Errors
    /// If the file can take no more; it is cut back to its last whole block.
    pub fn flush(&mut self) -> Result<(), FileError> {
        let written = self.file.write_all(&self.buf);
        let len = self.buf.len() as u64;
        self.buf.clear();
        written.map_err(|source| {
            // As many of the blocks may have come through as there was room for, and a piece of
            // the next. What cannot be cut off, e.g. of a pipe, is for the reader to skip.
            let _ = self.file.set_len(self.whole);
            FileError {
                path: self.path.clone(),
                whole: self.whole,
                source,
            }
        })?;
        self.whole += len;
        Ok(())
    }
}
