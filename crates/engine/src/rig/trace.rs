//! The run as a fingerprint: two runs are the same when every byte on every line was the same at
//! the same nanosecond.

use crc64fast::Digest;
use protocols::{Instant, LineEvent};

use crate::rig::line::{Delivery, Direction};

/// Running CRC-64/XZ over all bytes on the lines.
#[derive(Clone)]
pub struct Trace {
    digest: Digest,
    /// Bytes that were not passed to `digest` yet: pieces are short, and the digest is fast only
    /// with long ones.
    waiting: Vec<u8>,
}

/// Number of bytes that are passed to the digest at once.
const BLOCK: usize = 4096;

impl Default for Trace {
    fn default() -> Self {
        Self {
            digest: Digest::new(),
            waiting: Vec::with_capacity(2 * BLOCK),
        }
    }
}

impl core::fmt::Debug for Trace {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Trace({})", self.hash())
    }
}

/// The side of the faults on which bytes are observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Bytes as the sender put them on the wire.
    Sent,
    /// Bytes as the receiver got them.
    Received,
}

/// Observes every chunk on every line while the rig runs.
pub trait Tap: Send {
    /// `bytes` passed `link` in `direction`; the last one ended at `at`.
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]);

    /// `delivery` reached the receiver, or would have reached it if the line had not lost all of
    /// it. Calls come in order of time and include the effects of faults.
    fn arrived(&mut self, _link: usize, _direction: Direction, _delivery: &Delivery) {}

    /// The sender's end reported `event` at `at`: a port opened or closed, a break.
    fn line_event(&mut self, _link: usize, _to: Direction, _at: Instant, _event: LineEvent) {}

    /// The run has reached `now`: all earlier events have been reported. Called now and then.
    fn reached(&mut self, _now: Instant) {}

    /// Takes, as text, the error that stopped the tap since the last call. [`finish`](Self::finish)
    /// returns the same error again.
    fn take_trouble(&mut self) -> Option<String> {
        None
    }

    /// Ends the tap after the run. Returns the error that stopped the tap, also if it was an
    /// earlier one.
    fn finish(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Tap for Trace {
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]) {
        let mut head = [0; 12];
        head[0] = u8::try_from(link).unwrap_or(u8::MAX);
        head[1] = direction as u8;
        head[2] = side as u8;
        head[3] = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
        head[4..].copy_from_slice(&at.as_nanos().to_le_bytes());
        self.waiting.extend_from_slice(&head);
        self.waiting.extend_from_slice(bytes);
        if self.waiting.len() >= BLOCK {
            self.digest.write(&self.waiting);
            self.waiting.clear();
        }
    }
}

impl Trace {
    /// The fingerprint so far, sixteen hex digits.
    pub fn hash(&self) -> String {
        let mut digest = self.digest.clone();
        digest.write(&self.waiting);
        format!("{:016x}", digest.sum64())
    }
}

/// Fingerprint of one block of bytes, e.g. a map.
pub fn fingerprint(bytes: &[u8]) -> String {
    let mut digest = Digest::new();
    digest.write(bytes);
    format!("{:016x}", digest.sum64())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value of CRC-64/XZ in the catalogue of parametrised CRC algorithms.
    #[test]
    fn the_fingerprint_is_that_of_the_catalogue() {
        assert_eq!(fingerprint(b"123456789"), "995dc9bbdf1939fa");
    }

    /// Number of the link, direction, side, length, time in nanoseconds with the lowest byte first,
    /// and all bytes.
    #[test]
    fn a_trace_is_the_fingerprint_of_all_records_in_a_row() {
        let mut trace = Trace::default();
        assert_eq!(trace.hash(), fingerprint(&[]));
        let at = Instant::from_nanos(0x0102_0304);
        trace.record(2, Direction::ToDevice, Side::Received, at, &[7, 8, 9]);
        let mut all = vec![2, 1, 1, 3, 4, 3, 2, 1, 0, 0, 0, 0, 7, 8, 9];
        assert_eq!(trace.hash(), fingerprint(&all));
        for _ in 0..1000 {
            trace.record(300, Direction::ToMaster, Side::Sent, at, &[5; 300]);
            all.extend([255, 0, 0, 255, 4, 3, 2, 1, 0, 0, 0, 0]);
            all.extend([5; 300]);
        }
        assert_eq!(trace.hash(), fingerprint(&all));
        assert_eq!(format!("{trace:?}"), format!("Trace({})", trace.hash()));
    }

    /// A fingerprint writes no file, so nothing can go wrong with one.
    #[test]
    fn a_trace_has_no_trouble() {
        let mut trace = Trace::default();
        assert_eq!(trace.take_trouble(), None);
        assert!(trace.finish().is_ok());
    }
}
