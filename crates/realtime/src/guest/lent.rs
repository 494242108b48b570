//! What is lent to a thread until its next stop, and what it has made of it: see
//! [`clock_page`](super::clock_page).

use protocols::Instant;

/// Most bytes of a port that are lent at once.
pub(super) const LENT_BYTES: usize = 64;

/// Time that a thread may count by itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loan {
    /// Nanoseconds of virtual time, and up to which it may go.
    pub(super) now: u64,
    pub(super) limit: u64,
    /// What a look costs.
    pub(super) cost: u64,
    /// Most looks and calls, and those of a new turn.
    pub(super) looks: u64,
    pub(super) turn: u64,
    /// Files below 64, as bits, of which is known what is ready.
    pub(super) known: u64,
    /// Bytes may be counted before any is read.
    pub(super) counts: bool,
}

/// A port whose bytes are lent.
#[derive(Clone, Debug)]
pub(super) struct LentPort {
    pub(super) port: usize,
    /// The program's file, below 64.
    pub(super) fd: i32,
    /// A read waits for a byte.
    pub(super) waits: bool,
    /// A write does not wait.
    pub(super) takes: bool,
    /// From here on there may be other bytes than those below.
    pub(super) known_until: Instant,
    /// In order of time; those that are there have an earlier one than now.
    pub(super) bytes: Vec<(Instant, u8)>,
}

/// A read of a lent port: when, which of the ports, how many bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LentRead {
    pub(super) at: Instant,
    pub(super) index: usize,
    pub(super) len: usize,
}

/// A count of the bytes of a lent port: when, which of the ports, how many, and where the count
/// went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LentCount {
    pub(super) at: Instant,
    pub(super) index: usize,
    pub(super) len: usize,
    pub(super) address: u64,
}

/// What a thread has made of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Taken {
    pub(super) now: u64,
    pub(super) looks: u64,
    /// Looks and calls that were left.
    pub(super) left: u64,
    pub(super) selects: u64,
    pub(super) reads: Vec<LentRead>,
    /// All counts of bytes, and those behind the last read and select.
    pub(super) counts: u64,
    pub(super) last_counts: Vec<LentCount>,
}

impl LentRead {
    pub(super) fn of(word: [u8; 8]) -> Self {
        let word = u64::from_ne_bytes(word);
        let [len, index, ..] = (word & 0x3FF).to_le_bytes();
        Self {
            at: Instant::from_nanos(word >> 10),
            index: usize::from(index),
            len: usize::from(len),
        }
    }
}

impl LentPort {
    /// The port as the code knows it.
    pub(super) fn image(&self) -> Vec<u8> {
        let bytes = &self.bytes[..self.bytes.len().min(LENT_BYTES)];
        let mut words = vec![
            u64::from(self.fd.cast_unsigned()),
            u64::from(self.waits),
            self.known_until.as_nanos(),
            bytes.len() as u64,
            0,
        ];
        let bytes = bytes.iter();
        words.extend(bytes.map(|&(at, byte)| at.as_nanos() << 8 | u64::from(byte)));
        words.into_iter().flat_map(u64::to_ne_bytes).collect()
    }
}
