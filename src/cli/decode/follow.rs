//! A file that grows while it is read, and that a new file of the same name may replace.

use core::time::Duration;
use std::fs::File;
use std::io::{self, Read as _, Write};
use std::os::unix::fs::MetadataExt as _;

use protocols::Instant;

use super::source::{PCAPNG, raw_link, raw_record};
use super::{CliError, DecodeArgs, Failure, print_entry};
use crate::capture::decode::pause::Pauses;
use crate::capture::decode::transcript::Transcript;
use crate::capture::{Interface, Item, Reader};
use crate::cli::stop::Stop;
use crate::realtime::clock::{Clock, WallClock};

/// Time between two checks of a file that has ended.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Maximum time for which a writer buffers bytes, with a margin; after it the lines are silent.
const QUIET: Duration = Duration::from_secs(2);

/// The read part of one file.
struct Followed {
    file: File,
    /// None until the first bytes show the file's format.
    is_capture: Option<bool>,
    reader: Reader,
    links: Vec<Interface>,
    transcript: Transcript,
    /// None until the first record, unless the section tells it.
    start: Option<Instant>,
    last: Instant,
}

pub(super) fn follow(args: &DecodeArgs, out: &mut dyn Write) -> Result<(), Failure> {
    let stop = Stop::new(args.duration.map(|duration| duration.0))?;
    let clock = WallClock::start();
    let mut followed = Followed::open(args)?;
    let mut grown_at = clock.now();
    let mut piece = vec![0; 1 << 16];
    while !stop.is_due(clock.now()) {
        let len = followed
            .file
            .read(&mut piece)
            .map_err(|e| unreadable(args, e))?;
        let now = clock.now();
        if len > 0 {
            grown_at = now;
            followed.take(args, &piece[..len], out)?;
            continue;
        }
        if followed.was_replaced(args) {
            followed.finish(out)?;
            followed = Followed::open(args)?;
            continue;
        }
        if now - grown_at >= QUIET {
            followed.finish(out)?;
            grown_at = now;
        }
        out.flush()?;
        clock.sleep_until(now + LOOK_EVERY);
    }
    followed.finish(out)
}

fn unreadable(args: &DecodeArgs, error: io::Error) -> Failure {
    Failure::Other(CliError::read(&args.file, error))
}

impl Followed {
    fn open(args: &DecodeArgs) -> Result<Self, Failure> {
        Ok(Self {
            file: File::open(&args.file).map_err(|error| unreadable(args, error))?,
            is_capture: None,
            reader: Reader::default(),
            links: Vec::new(),
            transcript: Transcript::new(args.protocol),
            start: None,
            last: Instant::ZERO,
        })
    }

    /// Whether the name now belongs to another file, e.g. because a recording has started its next
    /// file.
    fn was_replaced(&self, args: &DecodeArgs) -> bool {
        let (Ok(own), Ok(named)) = (self.file.metadata(), std::fs::metadata(&args.file)) else {
            return false;
        };
        (own.dev(), own.ino()) != (named.dev(), named.ino())
    }

    fn take(
        &mut self,
        args: &DecodeArgs,
        bytes: &[u8],
        out: &mut dyn Write,
    ) -> Result<(), Failure> {
        let is_capture = *self.is_capture.get_or_insert(bytes.starts_with(&PCAPNG));
        if !is_capture {
            self.links.resize(1, raw_link());
            let record = raw_record(bytes.to_vec());
            self.transcript.record(&record, &self.links[0]);
            for entry in self.transcript.all() {
                print_entry(&entry, &["raw"], None, out)?;
            }
            return Ok(());
        }
        self.reader.push(bytes);
        while let Some(item) = self.reader.next_item() {
            match item {
                Ok(Item::Section(section)) => {
                    self.start = section.zero();
                    let transcript = core::mem::take(&mut self.transcript);
                    self.transcript = transcript.pausing(Pauses::of(&[section]));
                }
                Ok(Item::Interface(interface)) => self.links.push(interface),
                Ok(Item::Record(record)) => {
                    let link = &self.links[record.link];
                    self.start.get_or_insert(record.at);
                    if args.link.as_ref().is_none_or(|name| *name == link.name) {
                        self.last = self.last.max(record.at);
                        self.transcript.record(&record, link);
                    }
                }
                Err(error) => {
                    let path = args.file.display();
                    eprintln!("{path} is broken {error}; nothing more is read of it");
                }
            }
        }
        let names: Vec<&str> = self.links.iter().map(|link| &*link.name).collect();
        for entry in self.transcript.ready(self.last) {
            print_entry(&entry, &names, self.start, out)?;
        }
        Ok(())
    }

    /// Flushes the pending bytes if no more bytes follow soon.
    fn finish(&mut self, out: &mut dyn Write) -> Result<(), Failure> {
        let names: Vec<&str> = self.links.iter().map(|link| &*link.name).collect();
        let start = self.start.filter(|_| self.is_capture == Some(true));
        for entry in self.transcript.finish() {
            print_entry(&entry, &names, start, out)?;
        }
        out.flush()?;
        Ok(())
    }
}
