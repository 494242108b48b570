//! The files of a recording: the newest has the plain name, older ones are put aside, the oldest
//! go. A thread writes them, so that a run does not wait for a disk.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use super::recording::Limits;

/// Pieces on their way to the disk. When it cannot keep up, the run waits.
const PIECES_MAX: usize = 8;

/// The end of the thread at which pieces go in.
#[derive(Debug)]
pub(super) struct Writer {
    full: Option<SyncSender<Vec<u8>>>,
    empty: Receiver<Vec<u8>>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl Writer {
    /// Begins the first file with `head`, as each file begins.
    pub(super) fn create(path: &Path, head: Vec<u8>, limits: Limits) -> io::Result<Self> {
        let mut files = Files {
            file: File::create(path)?,
            path: path.to_owned(),
            limits,
            written: 0,
            set_aside: 0,
            head,
        };
        files.begin()?;
        let (full, pieces) = sync_channel::<Vec<u8>>(PIECES_MAX);
        let (back, empty) = sync_channel(PIECES_MAX);
        let thread = thread::Builder::new().name("capture".to_owned());
        let thread = thread.spawn(move || {
            for mut piece in pieces {
                files.write(&piece)?;
                piece.clear();
                // Whoever gave it may be gone, or have enough of them.
                let _ = back.try_send(piece);
            }
            Ok(())
        })?;
        Ok(Self {
            full: Some(full),
            empty,
            thread: Some(thread),
        })
    }

    /// Sends whole blocks to the file and leaves an empty buffer; false if no more can be written.
    pub(super) fn write(&mut self, blocks: &mut Vec<u8>) -> bool {
        let empty = self.empty.try_recv().unwrap_or_default();
        let piece = core::mem::replace(blocks, empty);
        let full = self.full.as_ref();
        full.is_some_and(|full| full.send(piece).is_ok())
    }

    /// Waits until all is written; the first error, if there was one.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.full = None;
        let ended = self.thread.take().map(JoinHandle::join);
        ended.map_or(Ok(()), |ended| {
            ended.unwrap_or_else(|_| Err(io::Error::other("the writer of the capture panicked")))
        })
    }
}

#[derive(Debug)]
struct Files {
    path: PathBuf,
    file: File,
    limits: Limits,
    head: Vec<u8>,
    written: u64,
    set_aside: u64,
}

impl Files {
    fn begin(&mut self) -> io::Result<()> {
        self.file.write_all(&self.head)?;
        self.written = self.head.len() as u64;
        Ok(())
    }

    fn write(&mut self, blocks: &[u8]) -> io::Result<()> {
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
