//! Coverage and comparisons of a program that was built with SanitizerCoverage and [`RUNTIME`]:
//! counters and pairs in a shared file.
//!
//! The program maps the file into its memory; hilrig reads it as a file. Therefore the counters
//! survive a crash or a kill.

use core::cell::Cell;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::{FileExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use super::compare::{Comparison, PAIR};

/// The C source that is linked to the program to be observed.
pub const RUNTIME: &str = include_str!("hilrig-coverage.c");
/// The environment variable that names the file.
pub(super) const VARIABLE: &str = "HILRIG_COVERAGE";

/// Number of classes of counts.
pub(super) const SIZES: u32 = 16;
/// Number of counters; the same as in [`RUNTIME`].
const SIZE: usize = 1 << 16;
/// Behind the counters: the number of pairs, the pairs, and the number of pairs per location.
const HEAD: usize = 8;
const PAIRS: usize = 1024;
const PLACES: usize = 4096;
/// Prefix of the file name; our process id follows.
const NAME: &str = "hilrig-coverage-";
/// The folder of a file system in memory.
const MEMORY: &str = "/dev/shm";

/// The activity of a program between two reads.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reached {
    /// Locations that were reached, as numbers below [`SIZE`], times [`SIZES`], plus the class of
    /// the count: 1, 2, up to 3, 7, 15 ..
    pub(super) marks: Vec<u32>,
    /// Comparisons of unequal values.
    pub(super) compared: Vec<Comparison>,
}

/// Counters that are shared with programs.
#[derive(Debug)]
pub(super) struct Counters {
    path: PathBuf,
    file: File,
    was_used: Cell<bool>,
}

impl Counters {
    /// Creates counters that are all 0; the file lies in `dir` if the system has no file system in
    /// memory.
    pub(super) fn new(dir: &Path) -> io::Result<Self> {
        let memory = Path::new(MEMORY);
        let dir = if memory.is_dir() { memory } else { dir };
        // The name has the same length in each run: the environment is part of the program's
        // memory.
        let path = dir.join(format!("{NAME}{:010}", std::process::id()));
        remove_orphans(dir);
        Self::at(path)
    }

    fn at(path: PathBuf) -> io::Result<Self> {
        // Replaces a file of an earlier process with the same id.
        let file = safefs::create(&path)?;
        file.set_len((SIZE + HEAD + PAIRS * PAIR + PLACES) as u64)?;
        let was_used = Cell::new(false);
        Ok(Self {
            path,
            file,
            was_used,
        })
    }

    /// The path, for the program.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether any program has ever counted.
    pub(super) const fn was_used(&self) -> bool {
        self.was_used.get()
    }

    /// The activity since the last call. A read error counts as no activity. If the counters cannot
    /// be reset, the activity is counted twice, which is not new behaviour.
    pub(super) fn take(&self) -> Reached {
        let (mut counts, mut marks) = (vec![0; SIZE + HEAD], Vec::new());
        if self.file.read_exact_at(&mut counts, 0).is_err() {
            return Reached::default();
        }
        let head = counts.split_off(SIZE);
        for (place, &count) in (0_u32..).zip(&counts).filter(|(_, count)| **count > 0) {
            marks.push(place * SIZES + (u8::BITS - count.leading_zeros()));
        }
        if !marks.is_empty() {
            self.was_used.set(true);
            let _ = self.file.write_all_at(&[0; SIZE], 0);
        }
        let pairs = head.first_chunk().copied().map_or(0, u32::from_le_bytes);
        let pairs = usize::try_from(pairs).unwrap_or(PAIRS).min(PAIRS);
        Reached {
            marks,
            compared: self.take_pairs(pairs),
        }
    }

    fn take_pairs(&self, count: usize) -> Vec<Comparison> {
        if count == 0 {
            return Vec::new();
        }
        let (at, mut pairs) = (SIZE + HEAD, vec![0; count * PAIR]);
        let read = self.file.read_exact_at(&mut pairs, at as u64);
        let _ = self.file.write_all_at(&[0; HEAD], SIZE as u64);
        let places = at + PAIRS * PAIR;
        let _ = self.file.write_all_at(&[0; PLACES], places as u64);
        match read {
            Ok(()) => pairs.chunks(PAIR).filter_map(Comparison::read).collect(),
            Err(_) => Vec::new(),
        }
    }
}

/// Removes files of processes that no longer exist.
fn remove_orphans(dir: &Path) {
    for file in fs::read_dir(dir).into_iter().flatten().flatten() {
        let name = file.file_name();
        let number = name.to_str().and_then(|name| name.strip_prefix(NAME));
        let process = number.and_then(|number| number.parse::<u32>().ok());
        let processes = Path::new("/proc");
        let is_gone = |id: u32| !processes.join(id.to_string()).exists();
        let is_ours = file
            .metadata()
            .is_ok_and(|meta| meta.is_file() && meta.uid() == rustix::process::geteuid().as_raw());
        if processes.join("self").exists() && is_ours && process.is_some_and(is_gone) {
            let _ = safefs::remove_file(&file.path());
        }
    }
}

impl Drop for Counters {
    fn drop(&mut self) {
        let _ = safefs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The counts 2 and 3 are in the same class, 1 and 4 are not; each read resets the counts.
    #[test]
    fn a_place_reached_another_number_of_times_is_news_by_its_size() {
        let counters = Counters::at(
            std::env::temp_dir().join(format!("{NAME}test-sizes-{}", std::process::id())),
        )
        .expect("room");
        let marks = |place: u64, count: u8| {
            counters.file.write_all_at(&[count], place).expect("room");
            counters.take().marks
        };
        assert!(counters.take().marks.is_empty() && !counters.was_used());
        let [once, twice, thrice, four] = [1, 2, 3, 4].map(|count| marks(7, count));
        assert_eq!(twice, thrice);
        assert!(once != twice && twice != four && once.len() == 1);
        assert_ne!(marks(8, 1), once);
        assert!(counters.take().marks.is_empty() && counters.was_used());
    }

    /// The program claims two pairs: one is valid, the other has an impossible side of 255 bytes.
    /// The next read finds none. A claim of 4 thousand million pairs is rejected.
    #[test]
    fn what_was_compared_is_taken_once() {
        let counters = Counters::at(
            std::env::temp_dir().join(format!("{NAME}test-pairs-{}", std::process::id())),
        )
        .expect("room");
        let put = |bytes: &[u8], at: usize| {
            let put = counters.file.write_all_at(bytes, at as u64);
            put.expect("room");
        };
        put(&2_u32.to_le_bytes(), SIZE);
        put(&[9, 0, 0, 0, 1, 8, 8], SIZE + HEAD);
        put(&[9, 0, 0, 0, 1, 255, 8], SIZE + HEAD + PAIR);
        let compared = counters.take().compared;
        assert_eq!(compared.len(), 1);
        assert_eq!(compared[0].place, 9);
        assert_eq!(counters.take().compared, []);
        put(&u32::MAX.to_le_bytes(), SIZE);
        assert!(counters.take().compared.len() <= PAIRS);
    }
}
