//! A capture file that consists of complete blocks at any moment, also on a full disk.

use core::time::Duration;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use protocols::Instant;

/// A capture cannot be written. All blocks before the error are complete.
#[derive(Debug, thiserror::Error)]
#[error(
    "cannot write {}: {source}; its first {whole} bytes are a whole capture",
    .path.display()
)]
pub struct FileError {
    /// Path of the file.
    pub path: PathBuf,
    /// Number of its bytes in complete blocks.
    pub whole: u64,
    /// The error of the operating system.
    pub source: io::Error,
}

/// A buffered file that keeps only complete blocks.
#[derive(Debug)]
pub struct CaptureFile {
    path: PathBuf,
    file: File,
    buf: Vec<u8>,
    whole: u64,
    sequence: u64,
    flushed_at: Instant,
}

/// Maximum number of buffered bytes.
const BUFFER: usize = 64 << 10;
/// Maximum time of data that a killed process loses.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

impl CaptureFile {
    /// Creates or truncates the file.
    ///
    /// # Errors
    /// Errors of the operating system.
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

    /// A unique number for the next record.
    pub const fn next_sequence(&mut self) -> u64 {
        let sequence = self.sequence;
        self.sequence += 1;
        sequence
    }

    /// Appends the block that `block` writes.
    ///
    /// # Errors
    /// If the disk is full or the file cannot be written.
    pub fn put(&mut self, block: impl FnOnce(&mut Vec<u8>)) -> Result<(), FileError> {
        block(&mut self.buf);
        if self.buf.len() >= BUFFER {
            self.flush()?;
        }
        Ok(())
    }

    /// Writes the buffer if the last write is long ago.
    ///
    /// # Errors
    /// If the disk is full or the file cannot be written.
    pub fn flush_if_due(&mut self, now: Instant) -> Result<(), FileError> {
        if now - self.flushed_at >= FLUSH_EVERY {
            self.flushed_at = now;
            self.flush()?;
        }
        Ok(())
    }

    /// Writes the buffer.
    ///
    /// # Errors
    /// If the disk is full or the file cannot be written; the file is then truncated to its last
    /// complete block.
    pub fn flush(&mut self) -> Result<(), FileError> {
        let written = self.file.write_all(&self.buf);
        let len = self.buf.len() as u64;
        self.buf.clear();
        written.map_err(|source| {
            // The disk may have taken some blocks and a part of the next one. If the file cannot be
            // truncated, e.g. a pipe, the reader must skip this part.
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
