//! A directory in which ports appear under stable names.
//!
//! The names are links to whatever the system hands out. One rig owns a directory at a time: it
//! holds a lock on the record file, which lists the links that were made. So after a rig was
//! killed the next one knows which links are its predecessor's, replaces those, and touches
//! nothing else. Links are made in one step; a client sees either none or one that works.
//!
//! Somebody else may have prepared the directory: files are written without following links.

use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::io::Errno;

use super::TransportError;

/// The record of links made, one `name target` a line, locked while the rig runs.
const RECORD: &str = ".hilrig-ports";
/// Owners that may vanish between our opening the record and locking it before we give up.
const TRIES: usize = 8;
/// Longest record that is believed: a rig has a handful of ports.
const RECORD_LEN_MAX: u64 = 64 * 1024;

/// A directory for ports, owned until dropped.
#[derive(Debug)]
pub struct PortDir {
    path: PathBuf,
    record: File,
    /// Links that a predecessor left, as `(name, target)`.
    left_behind: Vec<(String, String)>,
    /// Whether the directory was not there before.
    created: bool,
    notes: Vec<PathBuf>,
}

/// What a rig tells about itself in its directory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// The scenario as it runs.
    Scenario,
}

impl Note {
    /// Where it is in a directory of ports.
    pub fn path_in(self, dir: &Path) -> PathBuf {
        match self {
            Self::Scenario => dir.join(".hilrig-scenario.toml"),
        }
    }
}

impl PortDir {
    /// Takes `path`, making it if need be.
    ///
    /// # Errors
    /// If it cannot be made or written, or if another rig has it.
    pub fn open(path: &Path) -> Result<Self, TransportError> {
        let fail = |source| TransportError::Directory {
            path: path.to_owned(),
            source,
        };
        let created = !path.exists();
        fs::create_dir_all(path).map_err(fail)?;
        let record_path = path.join(RECORD);
        for _ in 0..TRIES {
            let mut record = open_record(&record_path)?;
            match record.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(TransportError::DirectoryInUse {
                        path: path.to_owned(),
                    });
                }
                Err(TryLockError::Error(source)) => return Err(fail(source)),
            }
            // The previous owner may have removed the file between our opening and locking it.
            if is_file_at(&record, &record_path) {
                let left_behind = read_record(&mut record).map_err(fail)?;
                return Ok(Self {
                    path: path.to_owned(),
                    record,
                    left_behind,
                    created,
                    notes: Vec::new(),
                });
            }
        }
        Err(TransportError::DirectoryInUse {
            path: path.to_owned(),
        })
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Leaves a note for clients that know of this tool, gone when the directory is given up.
    ///
    /// # Errors
    /// If it cannot be written, or if a link is in its place.
    pub fn leave_note(&mut self, note: Note, text: &str) -> Result<(), TransportError> {
        let path = note.path_in(&self.path);
        if path.is_symlink() {
            return Err(TransportError::LinkInTheWay { path });
        }
        replace_file(&path, text).map_err(|source| TransportError::Directory {
            path: self.path.clone(),
            source,
        })?;
        self.notes.push(path);
        Ok(())
    }

    /// Makes `name` a link to `target`, which must not be a link that somebody else made.
    pub(super) fn publish(&self, name: &str, target: &Path) -> Result<Link, TransportError> {
        if name.is_empty() || name.starts_with('.') || name.contains(['/', '\n', ' ', '\0']) {
            return Err(TransportError::Name {
                name: name.to_owned(),
            });
        }
        let path = self.path.join(name);
        let fail = |source| TransportError::Directory {
            path: self.path.clone(),
            source,
        };
        // Recorded first: a link that the record does not know would never be replaced.
        writeln!(&self.record, "{name} {}", target.display()).map_err(fail)?;
        if let Ok(found) = fs::read_link(&path)
            && self
                .left_behind
                .iter()
                .any(|(left, to)| left == name && Path::new(to) == found)
        {
            fs::remove_file(&path).map_err(fail)?;
        }
        match symlink(target, &path) {
            Ok(()) => Ok(Link {
                path,
                target: target.to_owned(),
                record: self.record.try_clone().map_err(fail)?,
            }),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                Err(TransportError::Occupied { path })
            }
            Err(source) => Err(fail(source)),
        }
    }
}

impl Drop for PortDir {
    fn drop(&mut self) {
        // Best effort: what stays behind is recognised by the next owner.
        for (name, target) in &self.left_behind {
            remove_link(&self.path.join(name), Path::new(target));
        }
        for note in &self.notes {
            let _ = fs::remove_file(note);
        }
        let _ = fs::remove_file(self.path.join(RECORD));
        if self.created {
            let _ = fs::remove_dir(&self.path);
        }
    }
}

/// Opens the record, or makes it. What is not a file of its own may lead to a file of somebody
/// else's.
fn open_record(path: &Path) -> Result<File, TransportError> {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let opened = File::options()
        .read(true)
        .append(true)
        .create(true)
        .custom_flags(flags.bits().cast_signed())
        .open(path);
    let in_the_way = || TransportError::LinkInTheWay {
        path: path.to_owned(),
    };
    let fail = |source: io::Error| match source.raw_os_error().map(Errno::from_raw_os_error) {
        Some(Errno::LOOP) => in_the_way(),
        _ => TransportError::Directory {
            path: path.parent().unwrap_or(path).to_owned(),
            source,
        },
    };
    let record = opened.map_err(fail)?;
    let meta = record.metadata().map_err(fail)?;
    // No link at all: removed by its owner right now, which the caller notices.
    match meta.is_file() && meta.nlink() <= 1 {
        true => Ok(record),
        false => Err(in_the_way()),
    }
}

/// Writes a new file beside `path` and lets it take that name.
fn replace_file(path: &Path, text: &str) -> io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let beside = Path::new(&beside);
    // Of a rig that was killed. A link goes itself, not what it leads to.
    match fs::remove_file(beside) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut file = File::create_new(beside)?;
    let written = file.write_all(text.as_bytes());
    let renamed = written.and_then(|()| fs::rename(beside, path));
    renamed.inspect_err(|_| drop(fs::remove_file(beside)))
}

/// A published name; gone when dropped.
#[derive(Debug)]
pub(super) struct Link {
    path: PathBuf,
    target: PathBuf,
    record: File,
}

impl Link {
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Takes the name away.
    pub(super) fn withdraw(&self) {
        remove_link(&self.path, &self.target);
    }

    /// Publishes another `target`, under `name` if that is given.
    ///
    /// # Errors
    /// If something else has taken the name meanwhile.
    pub(super) fn publish_again(
        &mut self,
        name: Option<&str>,
        target: &Path,
    ) -> Result<(), TransportError> {
        self.withdraw();
        if let Some(name) = name {
            self.path.set_file_name(name);
        }
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        // As in `PortDir::publish`.
        let recorded = writeln!(&self.record, "{name} {}", target.display());
        let made = recorded.and_then(|()| symlink(target, &self.path));
        match made {
            Ok(()) => {
                target.clone_into(&mut self.target);
                Ok(())
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                Err(TransportError::Occupied {
                    path: self.path.clone(),
                })
            }
            Err(source) => Err(TransportError::Directory {
                path: self.path.parent().unwrap_or(&self.path).to_owned(),
                source,
            }),
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        remove_link(&self.path, &self.target);
    }
}

/// Removes the link unless somebody put something else in its place.
fn remove_link(path: &Path, target: &Path) {
    if fs::read_link(path).is_ok_and(|found| found == target) {
        let _ = fs::remove_file(path);
    }
}

fn is_file_at(file: &File, path: &Path) -> bool {
    let identity = |meta: &fs::Metadata| (meta.dev(), meta.ino());
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(held), Ok(there)) => identity(&held) == identity(&there),
        _ => false,
    }
}

fn read_record(record: &mut File) -> io::Result<Vec<(String, String)>> {
    let mut text = Vec::new();
    record.take(RECORD_LEN_MAX).read_to_end(&mut text)?;
    Ok(String::from_utf8_lossy(&text)
        .lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(name, target)| (name.to_owned(), target.to_owned()))
        .collect())
}
