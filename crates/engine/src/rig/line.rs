//! One direction of a link: bytes leave one node, take their time, meet faults, and arrive at
//! another node.

mod message;
pub(super) mod passage;

use std::collections::VecDeque;

use core::time::Duration;

use protocols::{Instant, LineConfig, LineEvent, Port};

pub use super::direction::Direction;
use crate::rig::fault::{Budget, LineFaults, Passed};
use crate::rig::resample::Resampler;
use message::Message;
pub use message::{MESSAGE_MAX, message_time};
use passage::Errors;
pub use passage::{Delivery, Mark, MarkDamage, Original, PIECE_MAX};

/// A port of a node of the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// Index of the node.
    pub node: usize,
    /// The node's port.
    pub port: Port,
}

/// Counts of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes that left the sender.
    pub sent: u64,
    /// Bytes that were lost by faults.
    pub lost: u64,
    /// Bytes that were added by faults.
    pub added: u64,
    /// Bytes that reached the receiver.
    pub delivered: u64,
    /// Characters without a valid stop bit: never delivered as data.
    pub framing_errors: u64,
    /// Difference in the number of bytes at a receiver with another baud rate: bytes after
    /// resampling minus bytes before.
    pub resampled: i64,
}

/// Bytes in flight.
#[derive(Clone, Debug)]
struct Chunk {
    arrives: Instant,
    bytes: Vec<u8>,
    errors: Errors,
    original: Option<Box<Original>>,
}

/// One direction of a link.
#[derive(Clone, Debug)]
pub struct Line {
    /// Source of the bytes.
    pub from: End,
    /// Destination of the bytes.
    pub to: End,
    /// A fault.
    pub faults: LineFaults,
    /// Time between the last bit on the wire and the arrival at the receiver.
    pub latency: Duration,
    /// Maximum number of bytes that travel as one piece. Byte times stay exact, but the receiver of
    /// a larger piece gets all its bytes when the last one is complete.
    pub piece: usize,
    /// Whether a recording replaces the sender: the sender's bytes are lost, those of
    /// [`play`](Self::play) arrive.
    pub is_played: bool,
    /// Whether the sender had nothing to send at the last poll. The line polls it again after an
    /// event for the sender.
    pub(crate) is_silent: bool,
    traffic: Traffic,
    free_at: Instant,
    /// Time of the next [`deliver`](Self::deliver).
    due: Instant,
    chunks: VecDeque<Chunk>,
    in_flight: u64,
    /// Arrival time of the last chunk; later chunks do not arrive earlier.
    last_arrives: Instant,
    /// Echoed bytes for the sender, and their time.
    echo: Option<(Instant, Vec<u8>)>,
    /// Time at which the receiver last could not read, and the size of its buffer until then.
    overrun: (Instant, usize),
    resampler: Resampler,
    spare: Vec<Vec<u8>>,
    /// Number of messages sent so far, and the message that waits for the next one.
    messages: u64,
    waiting: Option<Message>,
}

/// Maximum number of chunks in flight; the sender is polled only below this limit.
const CHUNKS_MAX: usize = 1 << 16;
/// Maximum number of consecutive stalls that withhold a byte.
const GATES_MAX: usize = 1000;
/// A time later than any run.
pub(super) const NEVER: Instant = Instant::from_nanos(u64::MAX);

impl Line {
    /// An ideal line.
    pub fn new(from: End, to: End) -> Self {
        Self {
            from,
            to,
            faults: LineFaults::default(),
            latency: Duration::ZERO,
            piece: 1,
            is_played: false,
            is_silent: false,
            traffic: Traffic::default(),
            free_at: Instant::ZERO,
            due: NEVER,
            chunks: VecDeque::new(),
            in_flight: 0,
            last_arrives: Instant::ZERO,
            echo: None,
            overrun: (Instant::ZERO, 0),
            resampler: Resampler::default(),
            spare: Vec::new(),
            messages: 0,
            waiting: None,
        }
    }

    /// The counts so far.
    pub const fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// Time at which the sender has sent all bits that it was asked for.
    pub const fn free_at(&self) -> Instant {
        self.free_at
    }

    /// Bytes sent and not yet delivered.
    pub const fn in_flight(&self) -> u64 {
        self.in_flight + self.faults.held()
    }

    /// Whether each sent byte was delivered, lost or garbled, or is in flight.
    pub fn conserves_bytes(&self) -> bool {
        let t = &self.traffic;
        let [sent, lost, added, delivered, errors, in_flight] = [
            t.sent,
            t.lost,
            t.added,
            t.delivered,
            t.framing_errors,
            self.in_flight(),
        ]
        .map(u64::cast_signed);
        sent - lost + added + t.resampled == delivered + errors + in_flight
    }

    /// Time at which the line can next deliver, or can poll a sender that had more bytes.
    pub fn poll_at(&self, now: Instant) -> Option<Instant> {
        let at = self.next_at(now);
        (at < NEVER).then_some(at)
    }

    /// As [`poll_at`](Self::poll_at), with [`NEVER`] instead of `None`.
    #[inline]
    pub(super) fn next_at(&self, now: Instant) -> Instant {
        let asks_again = !self.is_silent && self.free_at > now;
        if asks_again {
            self.free_at.min(self.due)
        } else {
            self.due
        }
    }

    /// Updates the next time after a change of the faults.
    #[inline]
    pub fn note_due(&mut self) {
        let front = self.chunks.front();
        let front = front.map_or(NEVER, |chunk| self.release(chunk.arrives).0);
        let idle = self.resampler.idle_at().unwrap_or(NEVER);
        self.due = front.min(idle);
    }

    /// Delivery time of bytes that arrive at `at`, and the receiver's buffer size until then.
    #[inline]
    fn release(&self, at: Instant) -> (Instant, Option<usize>) {
        if self.faults.is_clean() || self.faults.is_calm(at) {
            return (at, None);
        }
        self.release_late(at)
    }

    /// As [`release`](Self::release), for a line with a fault.
    fn release_late(&self, at: Instant) -> (Instant, Option<usize>) {
        let (mut release, mut room) = (at, None);
        for _ in 0..GATES_MAX {
            let Some(gate) = self.faults.gate(release) else {
                break;
            };
            release = gate.opens;
            room = room.into_iter().chain(gate.fifo).min();
        }
        (release, room)
    }

    /// Whether the line can take bytes from its sender at `now`.
    pub fn has_room(&self, now: Instant) -> bool {
        self.free_at <= now && self.chunks.len() < CHUNKS_MAX
    }

    /// Puts the sender's bytes `sent` on the wire; returns the end of the last one.
    pub fn take(
        &mut self,
        now: Instant,
        sender: LineConfig,
        receiver: LineConfig,
        budget: &mut Budget,
        sent: &[u8],
    ) -> Instant {
        let (start, agreed, len) = (now, sender, sent.len());
        if self.is_played {
            let ends = start + agreed.bytes_time(len as u64);
            self.free_at = ends;
            self.traffic.sent += len as u64;
            self.traffic.lost += len as u64;
            return ends;
        }
        let first = self.traffic.sent;
        let is_clean = self.faults.spare(first, len as u64, start, agreed);
        let is_at_once = self.latency == Duration::ZERO;
        if is_clean && is_at_once && sender.agrees_with(receiver) {
            return self.take_clean(start, sender, sent);
        }
        let mut passed = Passed {
            bytes: self.spare.pop().unwrap_or_default(),
            ..Passed::default()
        };
        passed.bytes.clear();
        let (struck, held) = (self.faults.struck_len(), self.faults.held());
        let mut sender = agreed;
        if is_clean {
            passed.bytes.extend_from_slice(sent);
        } else {
            sender = self.faults.sender_line(agreed, start);
            self.faults
                .pass(first, sent, start, sender, budget, &mut passed);
        }
        let ends = start + sender.bytes_time(len as u64);
        self.free_at = ends + passed.pauses.iter().map(|(_, by)| *by).sum();
        if passed.echo {
            self.echo = Some((ends, passed.bytes.clone()));
        }
        self.traffic.sent += len as u64;
        self.count(len as u64 + held, passed.bytes.len() as u64);

        let is_changed = !is_clean && (passed.bytes != sent || !passed.effects.is_empty());
        let mut original = (is_changed || self.faults.struck_len() > struck)
            .then(|| Box::new(self.original(ends, &passed, sent, struck)));
        let mut errors = Errors {
            framing: 0,
            parity: passed.parity_errors,
            marks: core::mem::take(&mut passed.marks),
        };
        if !sender.agrees_with(receiver) {
            let before = passed.bytes.len();
            errors.framing = self
                .resampler
                .feed(&mut passed.bytes, start, sender, receiver);
            // The marks refer to the sent bytes, not to the resampled ones.
            errors.marks = self.resampler.take_marks();
            self.traffic.resampled +=
                passed.bytes.len() as i64 + i64::from(errors.framing) - before as i64;
            let original = original
                .get_or_insert_with(|| Box::new(self.original(ends, &passed, sent, struck)));
            original.bauds = Some([sender.baud, receiver.baud]);
        } else if original.is_none() && self.latency > Duration::ZERO {
            original = Some(Box::new(self.original(ends, &passed, sent, struck)));
        }
        self.send_off(start, ends, sender, passed, errors, original);
        ends
    }

    /// As [`take`](Self::take), for a line without faults, which is the usual case.
    fn take_clean(&mut self, start: Instant, sender: LineConfig, sent: &[u8]) -> Instant {
        let mut bytes = self.spare.pop().unwrap_or_default();
        bytes.clear();
        bytes.extend_from_slice(sent);
        let ends = start + sender.bytes_time(sent.len() as u64);
        self.free_at = ends;
        self.traffic.sent += sent.len() as u64;
        self.put(ends, bytes, Errors::default(), None);
        ends
    }

    /// Counts the lost and added bytes. `given` bytes came in, which include those held back
    /// earlier; `passed` bytes go on, and others may be held back now.
    fn count(&mut self, given: u64, passed: u64) {
        let left = passed + self.faults.held();
        self.traffic.added += left.saturating_sub(given);
        self.traffic.lost += given.saturating_sub(left);
    }

    /// A copy of `sent` if other bytes will arrive, or if they arrive later.
    fn original(&self, ends: Instant, passed: &Passed, sent: &[u8], struck: usize) -> Original {
        Original {
            at: ends,
            bytes: sent.to_vec(),
            strikes: self.faults.struck().skip(struck).copied().collect(),
            effects: passed.effects.clone(),
            bauds: None,
        }
    }

    /// Puts the output bytes in flight, split into pieces if a fault requires it.
    fn send_off(
        &mut self,
        start: Instant,
        ends: Instant,
        sender: LineConfig,
        mut passed: Passed,
        mut errors: Errors,
        mut original: Option<Box<Original>>,
    ) {
        let (late, len) = (self.latency + passed.late, passed.bytes.len());
        if passed.pauses.is_empty() && passed.piece.is_none_or(|piece| piece >= len) {
            let (at, bytes) = (ends + late, passed.bytes);
            self.put(at, bytes, errors, original);
            return;
        }
        let mut paused = Duration::ZERO;
        let mut pauses = core::mem::take(&mut passed.pauses).into_iter().peekable();
        let piece = passed.piece.unwrap_or(usize::MAX).max(1);
        let mut from = 0;
        loop {
            while let Some((_, by)) = pauses.next_if(|(at, _)| *at <= from || from >= len) {
                paused += by;
            }
            let next_pause = pauses.peek().map_or(len, |(at, _)| *at);
            let to = len.min(next_pause).min(from.saturating_add(piece));
            if to >= len && pauses.peek().is_none() {
                break;
            }
            let so_far = start + sender.bytes_time(to as u64);
            let bytes = passed.bytes[from..to].to_vec();
            let early = Errors::framing(0, Mark::split(&mut errors.marks, from, to));
            let arrives = so_far.min(ends) + paused + late;
            self.put(arrives, bytes, early, original.take());
            from = to;
        }
        passed.bytes.drain(..from);
        errors.marks = Mark::split(&mut errors.marks, from, usize::MAX);
        let arrives = ends + paused + late;
        self.put(arrives, passed.bytes, errors, original);
    }

    fn put(
        &mut self,
        arrives: Instant,
        bytes: Vec<u8>,
        errors: Errors,
        original: Option<Box<Original>>,
    ) {
        self.in_flight += bytes.len() as u64 + u64::from(errors.framing);
        self.last_arrives = self.last_arrives.max(arrives);
        self.chunks.push_back(Chunk {
            arrives: self.last_arrives,
            bytes,
            errors,
            original,
        });
        self.note_due();
    }

    /// Delivers `bytes` at `at`, after all bytes in flight and independent of the sender;
    /// `framing_errors` characters without a stop bit precede them.
    pub fn play(&mut self, at: Instant, bytes: &[u8], framing_errors: u32) {
        self.traffic.added += bytes.len() as u64 + u64::from(framing_errors);
        let errors = Errors::framing(framing_errors, Vec::new());
        self.put(at, bytes.to_vec(), errors, None);
    }

    /// Echoed bytes for the sender, see [`receive`](Self::receive).
    pub(crate) const fn take_echo(&mut self) -> Option<(Instant, Vec<u8>)> {
        self.echo.take()
    }

    /// Puts `bytes` of the other direction on this line. They are lost if the queue to the receiver
    /// is full.
    pub(crate) fn receive(&mut self, at: Instant, bytes: Vec<u8>) {
        if self.chunks.len() >= CHUNKS_MAX {
            return;
        }
        self.traffic.added += bytes.len() as u64;
        self.put(at, bytes, Errors::default(), None);
    }

    /// Delivers the bytes that have arrived by `now`, one chunk a call.
    #[inline]
    pub fn deliver(&mut self, now: Instant) -> Option<Delivery> {
        if self.due > now {
            return None;
        }
        self.deliver_due(now)
    }

    fn deliver_due(&mut self, now: Instant) -> Option<Delivery> {
        if self.resampler.idle_at().is_some_and(|at| at <= now) {
            let mut bytes = self.spare.pop().unwrap_or_default();
            bytes.clear();
            let framing_errors = self.resampler.idle(&mut bytes);
            self.traffic.resampled += bytes.len() as i64 + i64::from(framing_errors);
            let errors = Errors::framing(framing_errors, self.resampler.take_marks());
            self.put(now, bytes, errors, None);
        }
        let (release, room) = self.release(self.chunks.front()?.arrives);
        if release > now {
            return None;
        }
        let mut chunk = self.chunks.pop_front()?;
        let framing_errors = chunk.errors.framing;
        self.in_flight -= chunk.bytes.len() as u64 + u64::from(framing_errors);
        let overrun = room.is_some_and(|room| self.overflow(release, room, &mut chunk.bytes));
        if overrun {
            let kept = chunk.bytes.len();
            chunk.errors.marks.retain(|mark| mark.before < kept);
        }
        self.note_due();
        self.traffic.delivered += chunk.bytes.len() as u64;
        self.traffic.framing_errors += u64::from(framing_errors);
        let event = match (framing_errors, chunk.errors.parity) {
            (1.., _) => Some(LineEvent::FramingError),
            (0, 1..) => Some(LineEvent::ParityError),
            (0, 0) => overrun.then_some(LineEvent::Overrun),
        };
        Some(Delivery {
            at: release,
            bytes: chunk.bytes,
            event,
            framing_errors,
            marks: chunk.errors.marks,
            original: chunk.original,
        })
    }

    /// Removes the bytes that exceed `room` before `release`; returns whether bytes were lost.
    fn overflow(&mut self, release: Instant, room: usize, bytes: &mut Vec<u8>) -> bool {
        if self.overrun.0 != release {
            self.overrun = (release, 0);
        }
        let keep = room.saturating_sub(self.overrun.1).min(bytes.len());
        let lost = bytes.len() - keep;
        bytes.truncate(keep);
        self.overrun.1 += keep;
        self.traffic.lost += lost as u64;
        lost > 0
    }

    /// Gives a delivered buffer back for later use.
    pub fn recycle(&mut self, bytes: Vec<u8>) {
        if self.spare.len() < 4 {
            self.spare.push(bytes);
        }
    }
}

#[cfg(test)]
mod tests;
