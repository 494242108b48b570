//! The sending end of a port: bytes and when each of them is ready.

use std::collections::VecDeque;

use core::time::Duration;

use protocols::Instant;

/// Maximum number of queued bytes if the line takes none; a queue of the longest replies fits.
const CAPACITY: usize = 2_048;

/// Transmit queue.
#[derive(Clone, Debug)]
pub(super) struct Sender {
    byte_time: Duration,
    queue: VecDeque<(Instant, u8)>,
    /// Time at which the line has sent all bytes.
    free_at: Instant,
}

impl Sender {
    pub(super) const fn new(byte_time: Duration) -> Self {
        Self {
            byte_time,
            queue: VecDeque::new(),
            free_at: Instant::ZERO,
        }
    }

    /// Sends `bytes` from `at` on, behind the bytes that are queued.
    pub(super) fn send(&mut self, at: Instant, bytes: &[u8]) {
        let start = at.max(self.free_at);
        let room = CAPACITY - self.queue.len().min(CAPACITY);
        for &byte in &bytes[..bytes.len().min(room)] {
            self.queue.push_back((start, byte));
            self.free_at = self.free_at.max(start) + self.byte_time;
        }
    }

    /// Discards all queued bytes.
    pub(super) fn clear(&mut self) {
        self.queue.clear();
    }

    /// Whether a byte is ready at `now`.
    pub(super) fn has_ready(&self, now: Instant) -> bool {
        self.queue.front().is_some_and(|&(at, _)| at <= now)
    }

    /// Moves the bytes that are ready at `now` into `buf`.
    pub(super) fn take(&mut self, now: Instant, buf: &mut [u8]) -> usize {
        let ready = self.queue.iter().take_while(|&&(at, _)| at <= now).count();
        let len = ready.min(buf.len());
        for (slot, (_, byte)) in buf.iter_mut().zip(self.queue.drain(..len)) {
            *slot = byte;
        }
        len
    }

    /// Time at which the next byte after `now` is ready. Bytes ready before it wait for the line.
    pub(super) fn ready_after(&self, now: Instant) -> Option<Instant> {
        let ready = self.queue.partition_point(|&(at, _)| at <= now);
        self.queue.get(ready).map(|&(at, _)| at)
    }

    /// Time at which the line has sent all bytes.
    pub(super) const fn free_at(&self) -> Instant {
        self.free_at
    }

    /// Time of one byte in a long reply.
    pub(super) const fn byte_time(&self) -> Duration {
        self.byte_time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEN_US: Duration = Duration::from_micros(10);

    fn taken(sender: &mut Sender, micros: u64) -> Vec<u8> {
        let mut buf = [0; 16];
        let len = sender.take(Instant::from_micros(micros), &mut buf);
        buf[..len].to_vec()
    }

    #[test]
    fn a_reply_waits_for_the_one_before() {
        let mut sender = Sender::new(TEN_US);
        sender.send(Instant::from_micros(100), &[1, 2]);
        sender.send(Instant::from_micros(105), &[3]);
        assert_eq!(taken(&mut sender, 119), [1, 2]);
        assert_eq!(taken(&mut sender, 120), [3]);
        assert_eq!(sender.free_at(), Instant::from_micros(130));
    }

    #[test]
    fn a_reader_that_never_reads_costs_bounded_memory() {
        let mut sender = Sender::new(TEN_US);
        for _ in 0..1_000 {
            sender.send(Instant::ZERO, &[0; 100]);
        }
        assert_eq!(sender.queue.len(), CAPACITY);
    }

    #[test]
    fn the_next_byte_is_that_behind_now() {
        let mut sender = Sender::new(TEN_US);
        assert_eq!(sender.ready_after(Instant::ZERO), None);
        sender.send(Instant::from_micros(100), &[1, 2]);
        sender.send(Instant::from_micros(105), &[3]);
        let next = [99, 100, 119, 120].map(|micros| {
            let now = Instant::from_micros(micros);
            (
                sender.ready_after(now).map(Instant::as_micros),
                sender.has_ready(now),
            )
        });
        let expected = [
            (Some(100), false),
            (Some(120), true),
            (Some(120), true),
            (None, true),
        ];
        assert_eq!(next, expected);
        sender.clear();
        assert!(!sender.has_ready(Instant::from_secs(9)));
        assert_eq!(sender.byte_time(), TEN_US);
    }
}
