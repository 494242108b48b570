//! Hears a line for whoever waits for bytes or frames on it.

use core::cell::RefCell;
use std::rc::{Rc, Weak};

use protocols::Instant;

use crate::codec::{Codec, Stream, What};
use crate::rig::line::Direction;
use crate::rig::trace::{Side, Tap};

/// What is looked for in the bytes of a line.
pub(super) enum Wanted {
    /// So many more bytes.
    Count(u64),
    /// These bytes in a row; what could be their beginning so far.
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

/// One who waits at one direction of a link.
pub(super) struct LineWatch {
    pub(super) link: usize,
    pub(super) direction: Direction,
    pub(super) wanted: Wanted,
    pub(super) is_found: bool,
}

/// All who wait. A watch is forgotten when its owner drops it.
#[derive(Clone, Default)]
pub(super) struct LineWatches(Rc<RefCell<Vec<Weak<RefCell<LineWatch>>>>>);

impl LineWatches {
    /// Begins to look.
    pub(super) fn add(&self, watch: LineWatch) -> Rc<RefCell<LineWatch>> {
        let watch = Rc::new(RefCell::new(watch));
        self.0.borrow_mut().push(Rc::downgrade(&watch));
        watch
    }
}

impl Tap for LineWatches {
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if side == Side::Sent {
            return;
        }
        self.0.borrow_mut().retain(|watch| {
            let Some(watch) = watch.upgrade() else {
                return false;
            };
            let mut watch = watch.borrow_mut();
            if watch.link == link && watch.direction == direction && !watch.is_found {
                watch.is_found = watch.wanted.is_in(at, bytes);
            }
            true
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
