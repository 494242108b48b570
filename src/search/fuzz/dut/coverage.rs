//! What a program says of the places that it reaches: counters in a file, if it was built with
//! SanitizerCoverage and [`RUNTIME`].
//!
//! The file is mapped by the program into its memory and read here as a file, so that a program
//! that crashes or is killed leaves what it counted.

use core::cell::Cell;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use crate::search::fuzz::subject::{Behaviour, size};

/// What a program is linked with to be seen, in C.
pub const RUNTIME: &str = include_str!("hilrig-coverage.c");
/// The variable that names the file.
pub(super) const VARIABLE: &str = "HILRIG_COVERAGE";

/// Counters; as many as [`RUNTIME`] has.
const SIZE: usize = 1 << 16;
/// Where files are that are no more than memory.
const MEMORY: &str = "/dev/shm";

/// Counters that programs share with us.
#[derive(Debug)]
pub(super) struct Counters {
    path: PathBuf,
    file: File,
    was_used: Cell<bool>,
}

impl Counters {
    /// New ones, all 0; in `dir` if the system has no file system in memory.
    pub(super) fn new(dir: &Path) -> io::Result<Self> {
        let memory = Path::new(MEMORY);
        let dir = if memory.is_dir() { memory } else { dir };
        // As long in each run: the environment lies in the program's memory.
        let path = dir.join(format!("hilrig-coverage-{:010}", std::process::id()));
        // What a process of this number has left.
        let _ = fs::remove_file(&path);
        let mut options = OpenOptions::new();
        let file = options
            .read(true)
            .write(true)
            .create_new(true)
            .open(&path)?;
        file.set_len(SIZE as u64)?;
        let was_used = Cell::new(false);
        Ok(Self {
            path,
            file,
            was_used,
        })
    }

    /// For the program.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether any program ever counted.
    pub(super) const fn was_used(&self) -> bool {
        self.was_used.get()
    }

    /// What was reached since the last call, and how often: once, twice, up to 3, 7, 15 times ..
    pub(super) fn take(&self) -> Behaviour {
        let (mut counts, mut behaviour) = (vec![0; SIZE], Behaviour::default());
        if self.file.read_exact_at(&mut counts, 0).is_err() {
            return behaviour;
        }
        for (place, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            behaviour.note(&[place as u64, size(count.into())]);
        }
        if !behaviour.marks().is_empty() {
            self.was_used.set(true);
            // If this fails, places count as reached once more, which is nothing new.
            let _ = self.file.write_all_at(&vec![0; SIZE], 0);
        }
        behaviour
    }
}

impl Drop for Counters {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three times is as often as twice, but not as once or four times; a place is reached anew
    /// after each look.
    #[test]
    fn a_place_reached_another_number_of_times_is_news_by_its_size() {
        let counters = Counters::new(&std::env::temp_dir()).expect("room");
        let marks = |place: u64, count: u8| {
            counters.file.write_all_at(&[count], place).expect("room");
            counters.take().marks().to_vec()
        };
        assert!(counters.take().marks().is_empty() && !counters.was_used());
        let [once, twice, thrice, four] = [1, 2, 3, 4].map(|count| marks(7, count));
        assert_eq!(twice, thrice);
        assert!(once != twice && twice != four && once.len() == 1);
        assert_ne!(marks(8, 1), once);
        assert!(counters.take().marks().is_empty() && counters.was_used());
    }
}
