//! What a program says of the places that it reaches and of what it compares: counters and pairs in
//! a file, if it was built with SanitizerCoverage and [`RUNTIME`].
//!
//! The file is mapped by the program into its memory and read here as a file, so that a program
//! that crashes or is killed leaves what it counted.

use core::cell::Cell;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::{FileExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use super::compare::{Comparison, PAIR};

/// What a program is linked with to be seen, in C.
pub const RUNTIME: &str = include_str!("hilrig-coverage.c");
/// The variable that names the file.
pub(super) const VARIABLE: &str = "HILRIG_COVERAGE";

/// Different sizes of a count.
pub(super) const SIZES: u32 = 16;
/// Counters; as many as [`RUNTIME`] has.
const SIZE: usize = 1 << 16;
/// Behind them: how many pairs there are, the pairs, and how often each place has one.
const HEAD: usize = 8;
const PAIRS: usize = 1024;
const PLACES: usize = 4096;
/// The name of the file, before the number of our process.
const NAME: &str = "hilrig-coverage-";
/// Where files are that are no more than memory.
const MEMORY: &str = "/dev/shm";

/// What a program did from one look to the next.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reached {
    /// Where it came, as numbers below [`SIZE`], times [`SIZES`], and how often: once, twice, up to
    /// 3, 7, 15 times ..
    pub(super) marks: Vec<u32>,
    /// What it compared and found not to be equal.
    pub(super) compared: Vec<Comparison>,
}

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
        let path = dir.join(format!("{NAME}{:010}", std::process::id()));
        remove_orphans(dir);
        Self::at(path)
    }

    fn at(path: PathBuf) -> io::Result<Self> {
        // What a process of this number has left is replaced.
        let file = safefs::create(&path)?;
        file.set_len((SIZE + HEAD + PAIRS * PAIR + PLACES) as u64)?;
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

    /// What was done since the last call. What cannot be read was not; what cannot be set back
    /// counts as done once more, which is nothing new.
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

/// Removes files of processes that are no more.
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

    /// Three times is as often as twice, but not as once or four times; a place is reached again
    /// after each look.
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

    /// Of two pairs that a program says it wrote one is there; the other is nonsense, a side of 255
    /// bytes. They are gone at the next look. A program that says it wrote 4 thousand million of
    /// them is not believed.
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
