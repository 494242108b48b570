//! Frames and conversations from files: captures, dumps of other tools, hexadecimal text, bytes.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::seeds::{Gathered, Spoken};
use capture::Capture;
use capture::import::{self, Format, Options};
use engine::codec::wire::{Piece, Stream};

/// Maximum number of files in a folder, and maximum size of a file that is not a capture, bytes.
const FILES_MAX: usize = 10_000;
const FILE_BYTES_MAX: u64 = 16 << 20;
/// The first bytes of a pcapng file.
const PCAPNG: &[u8] = &[0x0A, 0x0D, 0x0D, 0x0A];

/// The content of the files.
#[derive(Clone, Debug, Default)]
pub struct Corpus {
    /// Captures, each with the names of its links.
    captures: Vec<Capture>,
    /// Chunks of bytes without a known direction.
    chunks: Vec<Vec<u8>>,
}

/// The reason why a corpus cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum CorpusError {
    /// A file or folder cannot be read.
    #[error("--corpus {path}: {1}", path = .0.display())]
    Read(PathBuf, io::Error),
    /// A file has the wrong content.
    #[error("--corpus {path}: {1}", path = .0.display())]
    Content(PathBuf, String),
}

impl Corpus {
    /// Reads a file, or all files of a folder in order of their names.
    ///
    /// # Errors
    /// If a file cannot be read, or if all files are empty.
    pub fn read(path: &Path) -> Result<Self, CorpusError> {
        let wrong = |error| CorpusError::Read(path.to_owned(), error);
        let mut corpus = Self::default();
        if fs::metadata(path).map_err(wrong)?.is_dir() {
            let mut files = Vec::new();
            for entry in fs::read_dir(path).map_err(wrong)? {
                let file = entry.map_err(wrong)?.path();
                let name = file.file_name().map(|name| name.to_string_lossy());
                let is_hidden = name.is_none_or(|name| name.starts_with('.'));
                if file.is_file() && !is_hidden {
                    files.push(file);
                }
            }
            files.sort();
            if files.len() > FILES_MAX {
                let text = format!("{} files, expected at most {FILES_MAX}", files.len());
                return Err(CorpusError::Content(path.to_owned(), text));
            }
            for file in files {
                corpus.take(&file)?;
            }
        } else {
            corpus.take(path)?;
        }
        let is_empty = |capture: &Capture| capture.records.is_empty();
        if corpus.chunks.is_empty() && corpus.captures.iter().all(is_empty) {
            let text = "no bytes there; expected captures, or files of frames: bytes, or pairs of \
                        hexadecimal digits with a frame on each line";
            return Err(CorpusError::Content(path.to_owned(), text.to_owned()));
        }
        Ok(corpus)
    }

    fn take(&mut self, path: &Path) -> Result<(), CorpusError> {
        let read = |error| CorpusError::Read(path.to_owned(), error);
        let content = |text: String| CorpusError::Content(path.to_owned(), text);
        let len = fs::metadata(path).map_err(read)?.len();
        if len > FILE_BYTES_MAX {
            let text = format!("{len} bytes, expected at most {FILE_BYTES_MAX}");
            return Err(content(text));
        }
        let bytes = fs::read(path).map_err(read)?;
        if bytes.starts_with(PCAPNG) {
            let capture = Capture::of(&bytes);
            if let (Some(broken), true) = (&capture.broken, capture.records.is_empty()) {
                return Err(content(broken.to_string()));
            }
            self.captures.push(capture);
            return Ok(());
        }
        let text = core::str::from_utf8(&bytes).ok();
        let stream = text.and_then(|text| Stream::parse(text).ok());
        // In a corpus, plain hexadecimal digits are one frame per line.
        let format = Format::detect(&bytes);
        if let Some(format) = format.filter(|&format| format != Format::Hex || stream.is_none()) {
            let options = Options::default();
            let imported = import::read(&bytes, format, &options);
            let imported = imported.map_err(|error| content(error.to_string()))?;
            self.captures.push(Capture::of(&imported.to_pcapng(format)));
            return Ok(());
        }
        match stream {
            Some(stream) => {
                let pieces = stream.pieces().filter_map(|piece| match piece {
                    Piece::Bytes(bytes) => Some(bytes.to_vec()),
                    Piece::Idle => None,
                });
                self.chunks.extend(pieces.filter(|bytes| !bytes.is_empty()));
            }
            None => self.chunks.push(bytes),
        }
        Ok(())
    }

    /// Adds the data about `link` to `gathered`.
    pub(crate) fn teach(&self, link: &str, gathered: &mut Gathered) {
        for capture in &self.captures {
            let mut spoken = super::conversation(capture, Some(link));
            let known = |is_program: bool, spoken: &[Spoken]| {
                let side = spoken.iter().filter(|one| one.is_program == is_program);
                side.filter(|one| gathered.knows_request(&one.bytes))
                    .count()
            };
            let is_one_sided = spoken.iter().all(|one| one.is_program);
            // The capture does not say which side is the program; known requests identify it.
            if is_one_sided || known(false, &spoken) > known(true, &spoken) {
                for one in &mut spoken {
                    one.is_program = !one.is_program;
                }
            }
            gathered.conversation(&spoken);
        }
        for chunk in &self.chunks {
            gathered.unasked(chunk.clone());
        }
    }
}
