//! The time and bytes that are lent to a thread until its next stop, and the thread's use of them:
//! see [`clock_page`](super::clock_page).

use protocols::Instant;

/// Maximum number of bytes of a port that are lent at once.
pub(super) const LENT_BYTES: usize = 64;

/// Time that a thread may count by itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loan {
    /// Virtual time, and its limit, nanoseconds.
    pub(super) now: u64,
    pub(super) limit: u64,
    /// Virtual time that a look at a clock takes, nanoseconds.
    pub(super) cost: u64,
    /// Maximum number of looks and calls, now and after a new turn.
    pub(super) looks: u64,
    pub(super) turn: u64,
    /// Bits of the files below 64 whose readiness is known.
    pub(super) known: u64,
    /// Whether bytes may be counted before any is read.
    pub(super) counts: bool,
}

/// A port whose bytes are lent.
#[derive(Clone, Debug)]
pub(super) struct LentPort {
    pub(super) port: usize,
    /// The program's number of the file, below 64.
    pub(super) fd: i32,
    /// Whether a read waits for a byte.
    pub(super) waits: bool,
    /// Whether a write never waits.
    pub(super) takes: bool,
    /// Time from which on there may be other bytes than those in `bytes`.
    pub(super) known_until: Instant,
    /// Bytes in order of time. Those with an earlier time than now have arrived.
    pub(super) bytes: Vec<(Instant, u8)>,
}

/// A read of a lent port: its time, the index of the port, and the number of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LentRead {
    pub(super) at: Instant,
    pub(super) index: usize,
    pub(super) len: usize,
}

/// A count of the bytes of a lent port: its time, the index of the port, the number of bytes, and
/// the address to which this number was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LentCount {
    pub(super) at: Instant,
    pub(super) index: usize,
    pub(super) len: usize,
    pub(super) address: u64,
}

/// A thread's use of a loan.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Taken {
    pub(super) now: u64,
    pub(super) looks: u64,
    /// Number of looks and calls that are left.
    pub(super) left: u64,
    pub(super) selects: u64,
    pub(super) reads: Vec<LentRead>,
    /// Number of all counts of bytes, and the counts after the last read and select.
    pub(super) counts: u64,
    pub(super) last_counts: Vec<LentCount>,
}

impl Taken {
    /// Whether the thread has neither looked at a clock nor made a call.
    pub(super) const fn is_nothing(&self) -> bool {
        self.looks == 0 && self.selects == 0 && self.counts == 0 && self.reads.is_empty()
    }

    /// Limits the values in the page to the loan: times between `times` in order, at most `calls`
    /// calls in each turn, and bytes of `ports`. Returns whether no value was beyond the loan,
    /// because the program can write to its page.
    pub(super) fn bound(&mut self, times: [Instant; 2], calls: u64, ports: &[LentPort]) -> bool {
        let before = self.clone();
        let [from, limit] = times;
        let now = Instant::from_nanos(self.now).clamp(from, limit.max(from));
        self.now = now.as_nanos();
        // Each wait for a byte begins a turn.
        let lent = ports.iter().map(|port| port.bytes.len().min(LENT_BYTES));
        let mut left: Vec<usize> = lent.collect();
        let turns = 1 + left.iter().sum::<usize>() as u64;
        let most = calls.saturating_mul(turns);
        for count in [&mut self.looks, &mut self.selects, &mut self.counts] {
            *count = (*count).min(most);
        }
        self.reads.retain(|read| read.index < left.len());
        let mut last = from;
        for read in &mut self.reads {
            last = read.at.clamp(last, now.max(last));
            read.at = last;
            read.len = read.len.min(left[read.index]);
            left[read.index] -= read.len;
        }
        for count in &mut self.last_counts {
            count.at = count.at.clamp(from, now);
        }
        *self == before
    }
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
    /// The port in the format of the page.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    /// A lease from 100 to 200 ns of one port with two bytes: permitted values stay, and each other
    /// value that a program wrote to the page is limited to the loan.
    #[test]
    fn a_page_says_no_more_than_was_lent() {
        let port = LentPort {
            port: 0,
            fd: 3,
            waits: true,
            takes: true,
            known_until: at(201),
            bytes: vec![(at(0), 1), (at(150), 2)],
        };
        let read = |nanos, index, len| LentRead {
            at: at(nanos),
            index,
            len,
        };
        let honest = Taken {
            now: 160,
            looks: 3,
            reads: vec![read(110, 0, 1), read(150, 0, 1)],
            ..Taken::default()
        };
        let times = [at(100), at(200)];
        let mut taken = honest.clone();
        assert!(taken.bound(times, 10, core::slice::from_ref(&port)));
        assert_eq!(taken, honest);
        let mut taken = Taken {
            now: u64::MAX,
            looks: u64::MAX,
            selects: u64::MAX,
            counts: u64::MAX,
            reads: vec![read(150, 0, 1), read(99, 0, 255), read(1 << 50, 3, 1)],
            ..Taken::default()
        };
        assert!(!taken.bound(times, 10, core::slice::from_ref(&port)));
        // Two bytes, so at most three turns of ten calls.
        assert_eq!(
            [taken.now, taken.looks, taken.selects, taken.counts],
            [200, 30, 30, 30]
        );
        assert_eq!(taken.reads, [read(150, 0, 1), read(150, 0, 1)]);
    }

    /// By hand: 10 bits of port and length, the time above them.
    #[test]
    fn a_read_is_one_word() {
        let read = |word: u64| LentRead::of(word.to_ne_bytes());
        let expected = |nanos, index, len| LentRead {
            at: at(nanos),
            index,
            len,
        };
        assert_eq!(read(0), expected(0, 0, 0));
        assert_eq!(read(5 << 10 | 3 << 8 | 64), expected(5, 3, 64));
        assert_eq!(read(u64::MAX), expected((1 << 54) - 1, 3, 255));
    }

    #[test]
    fn a_port_is_words_and_then_its_bytes() {
        let port = |waits, bytes| LentPort {
            port: 9,
            fd: 3,
            waits,
            takes: false,
            known_until: at(201),
            bytes,
        };
        let words = |port: LentPort| -> Vec<u64> {
            let image = port.image();
            let words = image.chunks_exact(8);
            words
                .map(|word| u64::from_ne_bytes(word.try_into().expect("eight")))
                .collect()
        };
        let some = port(true, vec![(at(0), 0x41), (at(150), 0xFF)]);
        assert_eq!(words(some), [3, 1, 201, 2, 0, 0x41, 150 << 8 | 0xFF]);
        assert_eq!(words(port(false, vec![])), [3, 0, 201, 0, 0]);
        let many = words(port(true, vec![(at(1), 2); 65]));
        assert_eq!((many.len(), many[3]), (5 + 64, 64));
    }

    #[test]
    fn each_sign_of_use_counts() {
        assert!(Taken::default().is_nothing());
        let reads = vec![LentRead {
            at: at(0),
            index: 0,
            len: 0,
        }];
        for taken in [
            Taken {
                looks: 1,
                ..Taken::default()
            },
            Taken {
                selects: 1,
                ..Taken::default()
            },
            Taken {
                counts: 1,
                ..Taken::default()
            },
            Taken {
                reads,
                ..Taken::default()
            },
        ] {
            assert!(!taken.is_nothing(), "{taken:?}");
        }
        let left = Taken {
            now: 5,
            left: 6,
            ..Taken::default()
        };
        assert!(left.is_nothing());
    }

    /// Each word beyond what was lent is one of a page that was written to.
    #[test]
    fn each_limit_of_a_lease_holds_by_itself() {
        let port = |count| LentPort {
            port: 0,
            fd: 3,
            waits: true,
            takes: true,
            known_until: at(201),
            bytes: vec![(at(0), 1); count],
        };
        let ports = [port(2), port(100)];
        let base = Taken {
            now: 150,
            ..Taken::default()
        };
        let read = |nanos, index, len| LentRead {
            at: at(nanos),
            index,
            len,
        };
        let count = |nanos| LentCount {
            at: at(nanos),
            index: 0,
            len: 0,
            address: 8,
        };
        let is_within = |taken: Taken| taken.clone().bound([at(100), at(200)], 10, &ports);
        assert!(is_within(base.clone()));
        for (now, expected) in [(99, false), (100, true), (200, true), (201, false)] {
            assert_eq!(
                is_within(Taken {
                    now,
                    ..base.clone()
                }),
                expected,
                "{now}"
            );
        }
        // Of the second port 64 bytes can be lent: 1 + 2 + 64 turns of ten calls.
        for (number, expected) in [(670, true), (671, false)] {
            assert_eq!(
                is_within(Taken {
                    looks: number,
                    ..base.clone()
                }),
                expected
            );
            assert_eq!(
                is_within(Taken {
                    selects: number,
                    ..base.clone()
                }),
                expected
            );
            assert_eq!(
                is_within(Taken {
                    counts: number,
                    ..base.clone()
                }),
                expected
            );
        }
        for (reads, expected) in [
            (vec![read(100, 0, 1), read(150, 0, 1)], true),
            (vec![read(100, 0, 1), read(150, 0, 2)], false),
            (vec![read(100, 0, 2), read(100, 1, 64)], true),
            (vec![read(100, 1, 65)], false),
            (vec![read(99, 0, 1)], false),
            (vec![read(151, 0, 1)], false),
            (vec![read(140, 0, 1), read(139, 0, 1)], false),
            (vec![read(120, 2, 0)], false),
        ] {
            let taken = Taken {
                reads: reads.clone(),
                ..base.clone()
            };
            assert_eq!(is_within(taken), expected, "{reads:?}");
        }
        for (nanos, expected) in [(99, false), (100, true), (150, true), (151, false)] {
            let taken = Taken {
                last_counts: vec![count(nanos)],
                ..base.clone()
            };
            assert_eq!(is_within(taken), expected, "{nanos}");
        }
        // A limit before the beginning is no limit at all.
        let none = Taken {
            now: 100,
            ..Taken::default()
        };
        assert!(none.clone().bound([at(100), at(50)], 10, &[]));
        let mut many = Taken {
            now: 100,
            looks: 11,
            ..Taken::default()
        };
        assert!(!many.bound([at(100), at(200)], 10, &[]));
        assert_eq!(many.looks, 10);
    }
}
