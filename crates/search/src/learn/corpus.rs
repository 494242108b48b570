//! Frames and conversations from files: captures, dumps of other tools, hexadecimal text, bytes.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::seeds::{self, Gathered};
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

/// The different chunks of a conversation in each direction.
#[derive(Clone, Debug, Default)]
pub(crate) struct Directions {
    pub(crate) to_device: Vec<Vec<u8>>,
    pub(crate) to_master: Vec<Vec<u8>>,
}

/// The role of the program in a capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Role {
    /// Whether the program's bytes are those to the master.
    pub(crate) is_swapped: bool,
    /// Whether the program answers requests instead of sending them.
    pub(crate) answers: bool,
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

    /// The chunks of each capture about `link` to the device and to the master, and behind the
    /// captures those without a direction.
    pub(crate) fn sides(&self, link: &str) -> Vec<Directions> {
        let captures = self.captures.iter().map(|capture| {
            let spoken = seeds::chunks(&super::conversation(capture, Some(link)));
            let of = |is_program: bool| {
                let side = spoken.iter().filter(|one| one.is_program == is_program);
                let mut different: Vec<Vec<u8>> = Vec::new();
                for one in side {
                    if !different.contains(&one.bytes) {
                        different.push(one.bytes.clone());
                    }
                }
                different
            };
            Directions {
                to_device: of(true),
                to_master: of(false),
            }
        });
        let chunks = Directions {
            to_device: Vec::new(),
            to_master: self.chunks.clone(),
        };
        captures.chain([chunks]).collect()
    }

    /// The role of a program that sent the requests in `gathered`, in each capture: the side whose
    /// chunks it sent, or if it sent none of both, the side with similar chunks.
    pub(crate) fn roles(&self, link: &str, gathered: &Gathered) -> Vec<Role> {
        let role = |side: &Directions| {
            let count = |is_known: &dyn Fn(&[u8]) -> bool| {
                let of = |chunks: &[Vec<u8>]| chunks.iter().filter(|one| is_known(one)).count();
                [of(&side.to_device), of(&side.to_master)]
            };
            let known = match count(&|chunk| gathered.knows_request(chunk)) {
                [0, 0] => count(&|chunk| gathered.knows_like(chunk)),
                known => known,
            };
            Role {
                is_swapped: known[1] > known[0] || side.to_master.is_empty(),
                answers: false,
            }
        };
        let captures = self.captures.len();
        self.sides(link)[..captures].iter().map(role).collect()
    }

    /// Adds the data about `link` to `gathered`. The program has one of `roles` in each capture;
    /// without one, it sends the bytes to the device.
    pub(crate) fn teach(&self, link: &str, roles: &[Role], gathered: &mut Gathered) {
        for (at, capture) in self.captures.iter().enumerate() {
            let role = roles.get(at).copied().unwrap_or_default();
            let mut spoken = super::conversation(capture, Some(link));
            for one in &mut spoken {
                one.is_program ^= role.is_swapped;
            }
            match role.answers {
                true => gathered.questions(&spoken),
                false => gathered.conversation(&spoken),
            }
        }
        for chunk in &self.chunks {
            gathered.unasked(chunk.clone());
        }
    }
}
