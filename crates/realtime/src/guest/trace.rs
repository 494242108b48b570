//! Record of the supervisor's decisions, call by call: a fingerprint, a readable file, and the
//! first difference between two runs.

use core::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use protocols::Instant;

use super::GuestError;
use super::call;

/// Maximum number of records that are kept for a comparison.
const KEPT_MAX: usize = 4_000_000;

/// A finished call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Record {
    /// Virtual time.
    pub(super) at: Instant,
    /// Number of the thread, in the order of creation.
    pub(super) thread: u32,
    /// Its number.
    pub(super) number: i64,
    /// Number of looks at a clock, or of calls about ports, without a stop, that this record stands
    /// for; 0: it is a stopped call.
    pub(super) looks: u32,
    /// The supervisor's answer; `None` if the kernel executed the call.
    pub(super) result: Option<i64>,
}

impl fmt::Display for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { at, thread, .. } = self;
        if self.looks > 0 {
            let what = match self.number {
                nix::libc::SYS_clock_gettime => "looks at a clock",
                _ => "reads and selects without a stop",
            };
            return write!(f, "{at} thread {thread} {} {what}", self.looks);
        }
        write!(f, "{at} thread {thread} {}", call::name(self.number))?;
        match self.result {
            Some(result) => write!(f, " = {result}"),
            None => write!(f, " by the kernel"),
        }
    }
}

/// All calls of a run.
#[derive(Debug)]
pub struct Calls {
    kept: Vec<Record>,
    file: Option<BufWriter<File>>,
    pub(super) count: u64,
}

impl Calls {
    /// An empty record, with a readable file if one is requested.
    pub(super) fn new(file: Option<&Path>) -> Result<Self, GuestError> {
        let file = file.map(|path| {
            safefs::create(path).map_err(|source| GuestError::Trace {
                path: path.to_owned(),
                source,
            })
        });
        Ok(Self {
            kept: Vec::new(),
            file: file.transpose()?.map(BufWriter::new),
            count: 0,
        })
    }

    pub(super) fn add(&mut self, record: Record) {
        if self.kept.len() < KEPT_MAX {
            self.kept.push(record);
        }
        if let Some(file) = &mut self.file {
            // A full disk must not stop the program.
            let _ = writeln!(file, "{record}");
        }
    }

    /// Whether each call is written to a file.
    pub(super) const fn is_written(&self) -> bool {
        self.file.is_some()
    }

    /// Number of calls.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The first difference between `self` and `other`, as text; `None` if they are equal.
    pub fn part_from(&self, other: &Self) -> Option<String> {
        let both = self.kept.iter().zip(&other.kept);
        let first = both.clone().position(|(one, other)| one != other);
        let shorter = self.kept.len().min(other.kept.len());
        let at = match first {
            Some(at) => at,
            None if self.kept.len() == other.kept.len() => return None,
            None => shorter,
        };
        let said = |calls: &Self| {
            let record = calls.kept.get(at);
            record.map_or_else(|| "nothing more".to_owned(), Record::to_string)
        };
        Some(format!(
            "at call {at}: {}, then {}",
            said(self),
            said(other)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calls(results: &[i64]) -> Calls {
        let mut calls = Calls::new(None).expect("no file");
        for (index, &result) in results.iter().enumerate() {
            calls.add(Record {
                at: Instant::from_micros(index as u64),
                thread: 0,
                number: nix::libc::SYS_read,
                looks: 0,
                result: Some(result),
            });
        }
        calls
    }

    #[test]
    fn the_first_call_at_which_two_runs_part_is_named() {
        let one = calls(&[1, 2, 3]);
        assert_eq!(one.part_from(&calls(&[1, 2, 3])), None);
        assert_eq!(
            one.part_from(&calls(&[1, 5, 3])).as_deref(),
            Some("at call 1: 0.000001 thread 0 read = 2, then 0.000001 thread 0 read = 5")
        );
        assert_eq!(
            one.part_from(&calls(&[1, 2])).as_deref(),
            Some("at call 2: 0.000002 thread 0 read = 3, then nothing more")
        );
    }

    /// A line says the time, the thread, the call and what was answered.
    #[test]
    fn a_record_is_one_line() {
        let record = |number, looks, result| Record {
            at: Instant::from_micros(1_500_000),
            thread: 2,
            number,
            looks,
            result,
        };
        let read = nix::libc::SYS_read;
        let clock = nix::libc::SYS_clock_gettime;
        for (record, expected) in [
            (record(read, 0, Some(-11)), "1.500000 thread 2 read = -11"),
            (
                record(read, 0, None),
                "1.500000 thread 2 read by the kernel",
            ),
            (
                record(clock, 0, Some(0)),
                "1.500000 thread 2 clock_gettime = 0",
            ),
            (
                record(clock, 7, Some(0)),
                "1.500000 thread 2 7 looks at a clock",
            ),
            (
                record(read, 1, Some(0)),
                "1.500000 thread 2 1 reads and selects without a stop",
            ),
        ] {
            assert_eq!(record.to_string(), expected);
        }
    }

    #[test]
    fn calls_are_written_to_a_file() {
        let path = std::env::temp_dir().join(format!("hilrig-trace-{}", std::process::id()));
        let mut calls = Calls::new(Some(&path)).expect("a free name");
        assert!(calls.is_written() && !Calls::new(None).expect("no file").is_written());
        calls.add(self::calls(&[5]).kept[0]);
        calls.count = 9;
        assert_eq!(calls.count(), 9);
        drop(calls);
        let text = std::fs::read_to_string(&path).expect("written");
        assert_eq!(text, "0.000000 thread 0 read = 5\n");
        std::fs::remove_file(&path).expect("ours");
        let folder = Calls::new(Some(&std::env::temp_dir()));
        assert!(matches!(folder, Err(GuestError::Trace { .. })));
    }
}
