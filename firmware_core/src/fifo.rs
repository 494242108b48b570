//! A byte queue of fixed size between a program and its transmitter.

/// A queue with room for `N` bytes. A write that does not fit completely is refused and counted, so
/// a queue of frames never holds half a frame.
#[derive(Clone, Debug)]
pub struct Fifo<const N: usize> {
    buf: [u8; N],
    head: usize,
    len: usize,
    refused: u32,
}

impl<const N: usize> Fifo<N> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self {
            buf: [0; N],
            head: 0,
            len: 0,
            refused: 0,
        }
    }

    /// Appends all of `bytes`, or nothing if they do not fit; returns whether they fit.
    pub fn push(&mut self, bytes: &[u8]) -> bool {
        if bytes.len() > self.room() {
            self.refused = self.refused.saturating_add(1);
            return false;
        }
        let tail = (self.head + self.len) % N.max(1);
        let first = bytes.len().min(N - tail);
        let (to_end, rest) = bytes.split_at(first);
        self.buf[tail..tail + first].copy_from_slice(to_end);
        self.buf[..rest.len()].copy_from_slice(rest);
        self.len += bytes.len();
        true
    }

    /// Moves up to `out.len()` bytes out, oldest first; returns how many.
    pub fn pop(&mut self, out: &mut [u8]) -> usize {
        let count = out.len().min(self.len);
        let first = count.min(N - self.head);
        out[..first].copy_from_slice(&self.buf[self.head..self.head + first]);
        out[first..count].copy_from_slice(&self.buf[..count - first]);
        self.head = (self.head + count) % N.max(1);
        self.len -= count;
        count
    }

    /// Discards all queued bytes.
    pub const fn clear(&mut self) {
        self.len = 0;
    }

    /// Bytes queued.
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Whether nothing is queued.
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Bytes that still fit.
    pub const fn room(&self) -> usize {
        N - self.len
    }

    /// Number of refused writes.
    pub const fn refused(&self) -> u32 {
        self.refused
    }
}

impl<const N: usize> Default for Fifo<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::VecDeque;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_does_not_fit_whole_is_refused_whole() {
        let mut fifo = Fifo::<4>::new();
        assert!(fifo.push(b"abc"));
        assert!(!fifo.push(b"de"));
        let mut out = [0; 8];
        assert_eq!((fifo.pop(&mut out), &out[..3]), (3, &b"abc"[..]));
        assert_eq!((fifo.refused(), fifo.room()), (1, 4));
    }

    proptest! {
        /// Against the standard library's queue.
        #[test]
        fn bytes_come_out_in_the_order_they_went_in(
            steps in prop::collection::vec(
                (prop::collection::vec(any::<u8>(), 0..9), 0_usize..9),
                0..60,
            )
        ) {
            let mut fifo = Fifo::<13>::new();
            let mut model = VecDeque::new();
            for (bytes, take) in steps {
                if fifo.push(&bytes) {
                    model.extend(bytes);
                } else {
                    prop_assert!(model.len() + bytes.len() > 13);
                }
                let mut out = [0; 9];
                let taken = fifo.pop(&mut out[..take]);
                let expected: Vec<u8> = model.drain(..take.min(model.len())).collect();
                prop_assert_eq!(&out[..taken], &expected[..]);
                prop_assert_eq!(fifo.len(), model.len());
            }
        }
    }
}
