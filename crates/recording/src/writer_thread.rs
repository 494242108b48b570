//! Writer thread: encodes delivered bytes and writes them to the file, so that a run waits neither
//! for the disk nor for the encoding.

use core::mem::{replace, take};
use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use protocols::Instant;

use crate::files::Files;
use crate::join::{Extra, Joiner};
use crate::record::Kind;

/// Deliveries of all lines, in their order.
#[derive(Debug, Default)]
pub(super) struct Batch {
    happened: Vec<Happened>,
    /// The bytes of all deliveries, one after the other.
    bytes: Vec<u8>,
    /// Further fields of the deliveries that are never joined.
    extras: Vec<Extra>,
    /// All deliveries before this time are in the batch; they can be written.
    reached: Option<Instant>,
}

/// One delivery.
#[derive(Clone, Copy, Debug)]
struct Happened {
    at: Instant,
    /// Time from its last bit to its arrival.
    delay_ns: u64,
    line: u32,
    len: u32,
    /// `None` for data that may be joined; otherwise the kind of a delivery with an [`Extra`].
    single: Option<Kind>,
}

impl Batch {
    /// Adds bytes that arrived unchanged on `line` at `at`, `delay_ns` after their last bit was
    /// sent.
    pub(super) fn bytes(&mut self, line: usize, at: Instant, bytes: &[u8], delay_ns: u64) {
        self.put(line, at, bytes, delay_ns, None);
    }

    /// Adds an item that is never merged with others.
    pub(super) fn single(
        &mut self,
        line: usize,
        at: Instant,
        kind: Kind,
        bytes: &[u8],
        extra: Extra,
    ) {
        self.put(line, at, bytes, 0, Some(kind));
        self.extras.push(extra);
    }

    fn put(&mut self, line: usize, at: Instant, bytes: &[u8], delay_ns: u64, single: Option<Kind>) {
        self.bytes.extend_from_slice(bytes);
        self.happened.push(Happened {
            at,
            delay_ns,
            line: u32::try_from(line).expect("few links"),
            len: u32::try_from(bytes.len()).expect("chunks are short"),
            single,
        });
    }

    fn is_full(&self) -> bool {
        self.happened.len() >= HAPPENED_MAX || self.bytes.len() >= BYTES_MAX
    }

    fn is_empty(&self) -> bool {
        self.happened.is_empty() && self.reached.is_none()
    }

    fn clear(&mut self) {
        self.happened.clear();
        self.bytes.clear();
        self.extras.clear();
        self.reached = None;
    }
}

/// Number of deliveries at which a batch goes to the thread.
const HAPPENED_MAX: usize = 4096;
const BYTES_MAX: usize = 128 << 10;
/// Maximum number of batches in flight. If the thread falls behind, the run waits.
const BATCHES_MAX: usize = 4;

/// The rig's side of the thread, which accepts deliveries.
#[derive(Debug)]
pub(super) struct WriterThread {
    /// Deliveries that were not sent yet.
    pub(super) batch: Batch,
    full: Option<SyncSender<Batch>>,
    empty: Receiver<Batch>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl WriterThread {
    /// Starts the thread; `piece` is the number of bytes of the file that are written at once.
    pub(super) fn start(joiner: Joiner, files: Files, piece: usize) -> io::Result<Self> {
        let (full, batches) = sync_channel::<Batch>(BATCHES_MAX);
        let (back, empty) = sync_channel(BATCHES_MAX);
        let mut state = WriterState {
            joiner,
            files,
            piece,
            out: Vec::new(),
        };
        let thread = thread::Builder::new().name("capture".to_owned());
        let thread = thread.spawn(move || {
            for mut batch in batches {
                state.take(&mut batch)?;
                batch.clear();
                // The recorder may have ended, or may hold enough batches.
                let _ = back.try_send(batch);
            }
            state.finish()
        })?;
        Ok(Self {
            batch: Batch::default(),
            full: Some(full),
            empty,
            thread: Some(thread),
        })
    }

    /// Sends the batch if it is full; false if no more can be written.
    pub(super) fn relieve(&mut self) -> bool {
        !self.batch.is_full() || self.send()
    }

    /// Requests the write of everything due before `now`; false if no more can be written.
    pub(super) fn reached(&mut self, now: Instant) -> bool {
        self.batch.reached = Some(now);
        self.send()
    }

    fn send(&mut self) -> bool {
        let empty = self.empty.try_recv().unwrap_or_default();
        let batch = replace(&mut self.batch, empty);
        let full = self.full.as_ref();
        full.is_some_and(|full| full.send(batch).is_ok())
    }

    /// Waits until all is written; returns the first error, if any.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        if !self.batch.is_empty() {
            self.send();
        }
        self.full = None;
        let ended = self.thread.take().map(JoinHandle::join);
        ended.map_or(Ok(()), |ended| {
            ended.unwrap_or_else(|_| Err(io::Error::other("the writer of the capture panicked")))
        })
    }
}

/// State of the thread.
struct WriterState {
    joiner: Joiner,
    files: Files,
    piece: usize,
    out: Vec<u8>,
}

impl WriterState {
    fn take(&mut self, batch: &mut Batch) -> io::Result<()> {
        let mut extras = take(&mut batch.extras).into_iter();
        let mut rest = &batch.bytes[..];
        for one in &batch.happened {
            let (bytes, behind) = rest.split_at(one.len as usize);
            rest = behind;
            let (line, at, out) = (one.line as usize, one.at, &mut self.out);
            match one.single {
                None => self.joiner.bytes(line, at, bytes, one.delay_ns, out),
                Some(kind) => {
                    let extra = extras.next().expect("one came with it");
                    self.joiner.single(line, at, kind, bytes, extra, out);
                }
            }
            if self.out.len() >= self.piece {
                self.write()?;
            }
        }
        if let Some(now) = batch.reached {
            self.joiner.reached(now);
            self.joiner.emit(&mut self.out);
            self.write()?;
        }
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        self.joiner.finish(&mut self.out);
        self.write()
    }

    fn write(&mut self) -> io::Result<()> {
        if !self.out.is_empty() {
            self.files.write(&self.out)?;
            self.out.clear();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Interface, Section};
    use crate::{Capture, Limits};
    use engine::rig::bare;

    /// A batch that the thread returns is reused; its old content is not written twice.
    #[test]
    fn a_batch_that_comes_back_is_empty() {
        let (rig, _) = bare::linked(["one"], 9600);
        let mut head = Vec::new();
        Section::default().write(&mut head);
        Interface::new("one", 9600).write(&mut head);
        let name = format!("hilrig-batch-{}.pcapng", std::process::id());
        let path = std::env::temp_dir().join(name);
        let files = Files::create(&path, head, Limits::default()).expect("writable");
        let joiner = Joiner::new(&rig, Instant::ZERO);
        let mut writer = WriterThread::start(joiner, files, 1024).expect("a thread");
        for second in 1..=3 {
            let at = Instant::from_secs(u64::from(second));
            writer.batch.bytes(0, at, &[second], 0);
            assert!(writer.reached(at));
            writer.batch = writer.empty.recv().expect("it comes back");
        }
        writer.finish().expect("writable");
        let capture = Capture::read(&path).expect("readable");
        let _ = std::fs::remove_file(&path);
        let records = capture.records.iter().map(|one| one.bytes.to_vec());
        assert_eq!(records.collect::<Vec<_>>(), [[1], [2], [3]]);
    }

    /// A batch is full with 4096 deliveries or 128 KiB.
    #[test]
    fn a_batch_is_full_of_deliveries_or_of_bytes() {
        let full_after = |bytes: &[u8], most: usize| {
            let mut batch = Batch::default();
            (1..=most).find(|_| {
                batch.put(0, Instant::ZERO, bytes, 0, None);
                batch.is_full()
            })
        };
        assert_eq!(full_after(&[1], 5_000), Some(4_096));
        assert_eq!(full_after(&[1; 1024], 5_000), Some(128));
        assert_eq!(full_after(&[1; (128 << 10) - 1], 1), None);
    }
}
