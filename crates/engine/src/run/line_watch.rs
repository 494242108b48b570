//! Watches a line for conditions on its bytes or frames.

use protocols::Instant;

use crate::Shared;
use crate::codec::{Codec, Stream, What};
use crate::rig::line::Direction;
use crate::rig::trace::{Side, Tap};
use crate::shared::WeakShared;

/// Pattern in the bytes of a line.
pub(super) enum Wanted {
    /// Number of further bytes.
    Count(u64),
    /// These bytes in sequence; the matched beginning so far.
    Pattern { pattern: Vec<u8>, tail: Vec<u8> },
    /// A frame with these words, in the line's protocol.
    Frame {
        contains: String,
        codec: &'static Codec,
        stream: Stream,
        heard: Instant,
    },
}

impl Wanted {
    /// Whether it was found by now.
    fn is_in(&mut self, at: Instant, bytes: &[u8]) -> bool {
        match self {
            Self::Count(left) => {
                *left = left.saturating_sub(bytes.len() as u64);
                *left == 0
            }
            Self::Pattern { pattern, tail } => {
                tail.extend_from_slice(bytes);
                let found = tail.windows(pattern.len()).any(|part| part == *pattern);
                let kept = tail.len().saturating_sub(pattern.len() - 1);
                tail.drain(..kept);
                found
            }
            Self::Frame {
                contains,
                codec,
                stream,
                heard,
            } => {
                if at - *heard > codec.idle() {
                    drop(stream.idle());
                }
                *heard = at;
                let found = stream.push(bytes);
                let is_it =
                    |what: &What| matches!(what, What::Frame(words) if words.contains(&**contains));
                found.iter().any(|found| is_it(&found.what))
            }
        }
    }
}

/// A watch on one direction of a link.
pub(super) struct LineWatch {
    pub(super) link: usize,
    pub(super) direction: Direction,
    pub(super) wanted: Wanted,
    pub(super) is_found: bool,
}

/// All watches. A watch is forgotten when its owner drops it.
#[derive(Clone, Default)]
pub(super) struct LineWatches(Shared<Vec<WeakShared<LineWatch>>>);

impl LineWatches {
    /// Begins to look.
    pub(super) fn add(&self, watch: LineWatch) -> Shared<LineWatch> {
        let watch = Shared::new(watch);
        self.0.lock().push(watch.downgrade());
        watch
    }
}

impl Tap for LineWatches {
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if side == Side::Sent {
            return;
        }
        self.0.lock().retain(|watch| {
            let Some(watch) = watch.upgrade() else {
                return false;
            };
            let mut watch = watch.lock();
            if watch.link == link && watch.direction == direction && !watch.is_found {
                watch.is_found = watch.wanted.is_in(at, bytes);
            }
            true
        });
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::*;
    use crate::codec::BUS_HIGH_FIRST;

    /// A pattern across the border of two chunks is found, and half of it is not enough.
    #[test]
    fn a_pattern_is_found_however_the_bytes_are_cut() {
        let pattern = || Wanted::Pattern {
            pattern: vec![1, 2, 3],
            tail: Vec::new(),
        };
        let mut wanted = pattern();
        let hits = [&[1_u8][..], &[2], &[9], &[1, 2], &[3, 4]];
        let found = hits.map(|bytes| wanted.is_in(Instant::ZERO, bytes));
        assert_eq!(found, [false, false, false, false, true]);
        assert!(pattern().is_in(Instant::ZERO, &[0, 1, 2, 3]));
    }

    /// Five bytes, however they come; then it stays found.
    #[test]
    fn so_many_bytes_are_counted() {
        let mut wanted = Wanted::Count(5);
        let found = [2, 0, 2, 1, 0].map(|len| wanted.is_in(Instant::ZERO, &vec![7; len]));
        assert_eq!(found, [false, false, false, true, true]);
        assert!(Wanted::Count(5).is_in(Instant::ZERO, &[7; 6]));
    }

    /// Of a pattern of three bytes two are kept, which may begin it.
    #[test]
    fn no_more_is_kept_than_may_begin_the_pattern() {
        let mut wanted = Wanted::Pattern {
            pattern: vec![1, 1, 2],
            tail: Vec::new(),
        };
        for (bytes, kept) in [
            (&[1_u8][..], &[1_u8][..]),
            (&[9, 8, 7], &[8, 7]),
            (&[1, 1], &[1, 1]),
        ] {
            assert!(!wanted.is_in(Instant::ZERO, bytes));
            let Wanted::Pattern { tail, .. } = &wanted else {
                unreachable!("it is one");
            };
            assert_eq!(tail, kept);
        }
        assert!(wanted.is_in(Instant::ZERO, &[2]));
    }

    /// The golden read of ten registers from 36 (field firmware b77a6df) in two halves: a pause as
    /// long as the protocol's idle time still joins them, a longer one cuts them.
    #[test]
    fn a_frame_is_found_unless_a_pause_cuts_it() {
        let is_found_after = |pause: Duration| {
            let mut wanted = Wanted::Frame {
                contains: "36".to_owned(),
                codec: &BUS_HIGH_FIRST,
                stream: Stream::new(&BUS_HIGH_FIRST),
                heard: Instant::ZERO,
            };
            let begin = Instant::from_secs(1);
            assert!(!wanted.is_in(begin, &[0xAB, 0x24]));
            wanted.is_in(begin + pause, &[0x0A, 0x00, 0xD9])
        };
        let idle = BUS_HIGH_FIRST.idle();
        assert!(is_found_after(idle));
        assert!(!is_found_after(idle + Duration::from_nanos(1)));
    }

    /// Only what is received on the own line counts, and only while a condition waits.
    #[test]
    fn a_watch_hears_its_own_line_alone() {
        let mut watches = LineWatches::default();
        let watch = watches.add(LineWatch {
            link: 1,
            direction: Direction::ToMaster,
            wanted: Wanted::Count(1),
            is_found: false,
        });
        let (to_master, to_device) = (Direction::ToMaster, Direction::ToDevice);
        watches.record(1, to_master, Side::Sent, Instant::ZERO, &[1]);
        watches.record(1, to_device, Side::Received, Instant::ZERO, &[1]);
        watches.record(0, to_master, Side::Received, Instant::ZERO, &[1]);
        assert!(!watch.lock().is_found);
        watches.record(1, to_master, Side::Received, Instant::ZERO, &[1]);
        assert!(watch.lock().is_found);
        watches.record(1, to_master, Side::Received, Instant::ZERO, &[]);
        assert!(watch.lock().is_found);
        assert_eq!(watches.0.lock().len(), 1);
        drop(watch);
        watches.record(1, to_master, Side::Received, Instant::ZERO, &[1]);
        assert!(watches.0.lock().is_empty());
    }
}
