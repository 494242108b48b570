//! The last bytes on each line, for a debugger.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use protocols::Instant;

use crate::guest::trial::Trial;
use engine::rig::line::Direction;
use engine::rig::trace::{Side, Tap};

/// Maximum number of stored pieces of all lines together.
const KEPT_MAX: usize = 20_000;

/// Bytes that arrived together.
#[derive(Clone, Debug)]
struct Piece {
    link: usize,
    direction: Direction,
    at: Instant,
    bytes: Vec<u8>,
}

/// Listens to all lines.
#[derive(Clone, Debug, Default)]
pub(super) struct Wires(Arc<Mutex<VecDeque<Piece>>>);

impl Tap for Wires {
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if side != Side::Received {
            return;
        }
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() >= KEPT_MAX {
            kept.pop_front();
        }
        kept.push_back(Piece {
            link,
            direction,
            at,
            bytes: bytes.to_vec(),
        });
    }
}

impl Wires {
    /// Listens to the lines of a run from now on.
    pub(super) fn listen(&self, trial: &mut Trial) {
        trial.run().rig.add_tap(Box::new(self.clone()));
    }

    /// The last `count` pieces that arrived on the link with this number, one per line.
    pub(super) fn last(&self, link: usize, count: usize) -> Vec<String> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let of_link = kept.iter().rev().filter(|piece| piece.link == link);
        let lines = of_link.take(count).map(|piece| {
            let bytes: Vec<String> = piece.bytes.iter().map(|it| format!("{it:02x}")).collect();
            let text = piece.bytes.iter().map(|&byte| match byte {
                b' '..=b'~' => char::from(byte),
                _ => '.',
            });
            let text: String = text.collect();
            let direction = piece.direction.name();
            format!("{} {direction:>9}  {}  {text}", piece.at, bytes.join(" "))
        });
        let mut lines: Vec<String> = lines.collect();
        lines.reverse();
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(wires: &mut Wires, link: usize, side: Side, millis: u64, bytes: &[u8]) {
        let at = Instant::from_millis(millis);
        wires.record(link, Direction::ToDevice, side, at, bytes);
    }

    /// A line has the time, the direction, the bytes in hex and as text.
    #[test]
    fn the_last_pieces_of_a_link_are_lines() {
        let mut wires = Wires::default();
        record(&mut wires, 0, Side::Received, 1, b"a~ \x1F\x7F");
        record(&mut wires, 1, Side::Received, 2, b"b");
        record(&mut wires, 0, Side::Sent, 3, b"c");
        record(&mut wires, 0, Side::Received, 4, b"d");
        let name = Direction::ToDevice.name();
        let line = |at: &str, hex: &str, text: &str| format!("{at} {name:>9}  {hex}  {text}");
        let first = line("0.001000", "61 7e 20 1f 7f", "a~ ..");
        let last = line("0.004000", "64", "d");
        assert_eq!(wires.last(0, 9), [first, last.clone()]);
        assert_eq!(wires.last(0, 1), [last]);
        assert_eq!(wires.last(1, 9).len(), 1);
        assert!(wires.last(2, 9).is_empty() && wires.last(0, 0).is_empty());
    }

    #[test]
    fn old_pieces_are_forgotten() {
        let mut wires = Wires::default();
        for millis in 0..=20_000 {
            record(&mut wires, 0, Side::Received, millis, b"x");
        }
        let all = wires.last(0, usize::MAX);
        assert_eq!(all.len(), 20_000);
        assert!(all[0].starts_with("0.001000 "), "{}", all[0]);
    }
}
