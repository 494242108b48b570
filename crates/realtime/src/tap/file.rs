//! A capture file that consists of complete blocks at any moment, also on a full disk.

use core::time::Duration;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use capture::write_whole;
use protocols::Instant;

/// A capture cannot be written. All blocks before the error are complete.
#[derive(Debug, thiserror::Error)]
#[error(
    "cannot write {}: {source}; its first {whole} bytes are a whole capture{}",
    .path.display(), with_received(.received)
)]
pub struct FileError {
    /// Path of the file.
    pub path: PathBuf,
    /// Number of its bytes in complete blocks.
    pub whole: u64,
    /// Number of recorded bytes of the lines in these blocks, and of all that were received.
    pub received: [u64; 2],
    /// The error of the operating system.
    pub source: io::Error,
}

fn with_received([kept, all]: &[u64; 2]) -> String {
    match all {
        0 => String::new(),
        _ => format!(" with {kept} of the {all} received bytes"),
    }
}

/// A buffered file that keeps only complete blocks.
#[derive(Debug)]
pub struct CaptureFile {
    path: PathBuf,
    file: File,
    buf: Vec<u8>,
    /// End of each buffered block, and the number of recorded bytes in it.
    ends: Vec<(usize, u64)>,
    whole: u64,
    /// Number of recorded bytes in the written blocks.
    kept: u64,
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
            received: [0; 2],
            source,
        })?;
        Ok(Self {
            path: path.to_owned(),
            file,
            buf: Vec::new(),
            ends: Vec::new(),
            whole: 0,
            kept: 0,
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

    /// Appends the block that `block` writes, which has `data` recorded bytes.
    ///
    /// # Errors
    /// If the disk is full or the file cannot be written.
    pub fn put(&mut self, data: usize, block: impl FnOnce(&mut Vec<u8>)) -> Result<(), FileError> {
        block(&mut self.buf);
        self.ends.push((self.buf.len(), data as u64));
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
        let written = write_whole(&mut self.file, &self.buf);
        let len = match &written {
            Ok(()) => self.buf.len(),
            Err((whole, _)) => *whole,
        };
        let all: u64 = self.ends.iter().map(|(_, data)| data).sum();
        let all = self.kept + all;
        let kept = self.ends.iter().filter(|(end, _)| *end <= len);
        self.kept += kept.map(|(_, data)| data).sum::<u64>();
        self.whole += len as u64;
        self.buf.clear();
        self.ends.clear();
        written.map_err(|(_, source)| {
            // The disk may have taken a part of the next block. If the file cannot be truncated,
            // e.g. a pipe, the reader must skip this part.
            let _ = self.file.set_len(self.whole);
            FileError {
                path: self.path.clone(),
                whole: self.whole,
                received: [self.kept, all],
                source,
            }
        })
    }
}
