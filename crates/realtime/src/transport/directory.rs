//! A directory with ports under stable names.
//!
//! The names are links to the files of the system. A directory has one rig at a time: the rig locks
//! the record file, which lists its links. After a killed rig, the next one therefore knows the
//! links of its predecessor, replaces them, and changes nothing else. Links are created in one
//! step; a client sees either no link or a working one.
//!
//! Another user may have prepared the directory. All accesses use its handle and do not follow
//! links. The record is data: a name that no port can have is ignored.

use std::fs::{File, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use safefs::Dir;

use super::TransportError;

/// The record of links, one `name target` per line, locked while the rig runs.
const RECORD: &str = ".hilrig-ports";
/// Maximum number of tries, if owners disappear between our opening and locking of the record.
const TRIES: usize = 8;
/// Maximum length of a valid record: a rig has few ports.
const RECORD_LEN_MAX: u64 = 64 * 1024;

/// A directory for ports, owned until dropped.
#[derive(Debug)]
pub struct PortDir {
    dir: Arc<Dir>,
    record: File,
    /// Links of a predecessor, as `(name, target)`.
    left_behind: Vec<(String, String)>,
    /// Whether this rig created the directory.
    created: bool,
    notes: Vec<Note>,
    /// Directories in it, for the ports of further robots, with their names.
    parts: Vec<(String, Self)>,
}

/// A file about the rig in its directory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// The scenario as it runs.
    Scenario,
}

impl Note {
    /// Its path in a directory of ports.
    pub fn path_in(self, dir: &Path) -> PathBuf {
        dir.join(self.name())
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Scenario => ".hilrig-scenario.toml",
        }
    }
}

impl PortDir {
    /// Takes the directory `path`, and creates it if necessary.
    ///
    /// # Errors
    /// If the directory cannot be created or written, or if another rig uses it.
    pub fn open(path: &Path) -> Result<Self, TransportError> {
        let fail = |source| TransportError::Directory {
            path: path.to_owned(),
            source,
        };
        let created = !path.exists();
        let dir = Dir::create(path).map_err(fail)?;
        for _ in 0..TRIES {
            let mut record = open_record(&dir)?;
            match record.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(TransportError::DirectoryInUse {
                        path: path.to_owned(),
                    });
                }
                Err(TryLockError::Error(source)) => return Err(fail(source)),
            }
            // The previous owner may have removed the file before it was locked.
            if dir.holds(RECORD, &record) {
                let left_behind = read_record(&mut record).map_err(fail)?;
                return Ok(Self {
                    dir: Arc::new(dir),
                    record,
                    left_behind,
                    created,
                    notes: Vec::new(),
                    parts: Vec::new(),
                });
            }
        }
        Err(TransportError::DirectoryInUse {
            path: path.to_owned(),
        })
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    /// The handle of the directory.
    pub(crate) fn handle(&self) -> Arc<Dir> {
        Arc::clone(&self.dir)
    }

    /// Writes a note for clients that know this tool; it is removed with the rig.
    ///
    /// # Errors
    /// If the note cannot be written, or if a link has its name.
    pub fn leave_note(&mut self, note: Note, text: &str) -> Result<(), TransportError> {
        if self.dir.read_link(note.name()).is_ok() {
            let path = note.path_in(self.path());
            return Err(TransportError::LinkInTheWay { path });
        }
        let written = self.dir.write(note.name(), text);
        written.map_err(|source| TransportError::Directory {
            path: self.path().to_owned(),
            source,
        })?;
        self.notes.push(note);
        Ok(())
    }

    /// As [`leave_note`](Self::leave_note), in the directory `part` of this one, if that exists.
    pub(crate) fn leave_note_in(
        &mut self,
        part: &str,
        note: Note,
        text: &str,
    ) -> Result<(), TransportError> {
        let mut parts = self.parts.iter_mut();
        match parts.find(|(name, _)| name == part) {
            Some((_, part)) => part.leave_note(note, text),
            None => Ok(()),
        }
    }

    /// The directory `name` in this one, for the ports of a further robot.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn part(&mut self, name: &str) -> Result<&Self, TransportError> {
        let index = self.parts.iter().position(|(known, _)| known == name);
        let index = match index {
            Some(index) => index,
            None => {
                let part = Self::open(&self.path().join(name))?;
                self.parts.push((name.to_owned(), part));
                self.parts.len() - 1
            }
        };
        Ok(&self.parts[index].1)
    }

    /// Makes `name` a link to `target`. An existing link of another program is an error.
    pub(super) fn publish(&self, name: &str, target: &Path) -> Result<Link, TransportError> {
        if !is_port_name(name) {
            return Err(TransportError::Name {
                name: name.to_owned(),
            });
        }
        let path = self.path().join(name);
        let fail = |source| TransportError::Directory {
            path: self.path().to_owned(),
            source,
        };
        // Record the link first: a link that is not in the record would never be replaced.
        writeln!(&self.record, "{name} {}", target.display()).map_err(fail)?;
        if let Ok(found) = self.dir.read_link(name)
            && self
                .left_behind
                .iter()
                .any(|(left, to)| left == name && Path::new(to) == found)
        {
            self.dir.remove_file(name).map_err(fail)?;
        }
        match self.dir.link(name, target) {
            Ok(()) => Ok(Link {
                dir: self.handle(),
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
        self.parts.clear();
        // Best effort: the next owner recognises links that remain.
        for (name, target) in &self.left_behind {
            remove_link(&self.dir, name, Path::new(target));
        }
        for note in &self.notes {
            let _ = self.dir.remove_file(note.name());
        }
        let _ = self.dir.remove_file(RECORD);
        if self.created {
            let _ = safefs::remove_dir(self.path());
        }
    }
}

/// Opens or creates the record, which must be a plain file of this user.
fn open_record(dir: &Dir) -> Result<File, TransportError> {
    dir.append(RECORD)
        .map_err(|source| match source.raw_os_error() {
            // Rejected: a link, a second name of another file, or another user's file.
            None => TransportError::LinkInTheWay {
                path: dir.path().join(RECORD),
            },
            Some(_) => TransportError::Directory {
                path: dir.path().to_owned(),
                source,
            },
        })
}

/// A published name, removed when dropped.
#[derive(Debug)]
pub(super) struct Link {
    dir: Arc<Dir>,
    path: PathBuf,
    target: PathBuf,
    record: File,
}

impl Link {
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Removes the name.
    pub(super) fn withdraw(&self) {
        remove_link(&self.dir, &self.name(), &self.target);
    }

    fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// Publishes another `target`, with `name` if given.
    ///
    /// # Errors
    /// If another file has taken the name.
    pub(super) fn publish_again(
        &mut self,
        name: Option<&str>,
        target: &Path,
    ) -> Result<(), TransportError> {
        self.withdraw();
        if let Some(name) = name {
            self.path.set_file_name(name);
        }
        let name = self.name();
        // As in `PortDir::publish`.
        let recorded = writeln!(&self.record, "{name} {}", target.display());
        let made = recorded.and_then(|()| self.dir.link(&name, target));
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
                path: self.dir.path().to_owned(),
                source,
            }),
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.withdraw();
    }
}

/// Removes the link unless another program has replaced it.
fn remove_link(dir: &Dir, name: &str, target: &Path) {
    if dir.read_link(name).is_ok_and(|found| found == target) {
        let _ = dir.remove_file(name);
    }
}

/// Whether a port can have this name: a plain one in the directory, also with spaces inside.
fn is_port_name(name: &str) -> bool {
    let is_plain = |c: char| c == ' ' || c != '/' && !c.is_whitespace() && !c.is_control();
    !name.is_empty() && !name.starts_with('.') && name.trim() == name && name.chars().all(is_plain)
}

fn read_record(record: &mut File) -> io::Result<Vec<(String, String)>> {
    let mut text = Vec::new();
    record.take(RECORD_LEN_MAX).read_to_end(&mut text)?;
    Ok(String::from_utf8_lossy(&text)
        .lines()
        // The name may have spaces, its target, a terminal, has none.
        .filter_map(|line| line.rsplit_once(' '))
        // Other users can write this file: names are checked.
        .filter(|(name, _)| is_port_name(name))
        .map(|(name, target)| (name.to_owned(), target.to_owned()))
        .collect())
}
