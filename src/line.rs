//! One direction of a link: bytes leave one node, take their time, meet faults, and arrive at
//! another node.

use std::collections::VecDeque;

use core::time::Duration;

use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::fault::{LineFaults, Strike};
use crate::resample::Resampler;

/// A port of a node of the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// Index of the node.
    pub node: usize,
    /// The node's port.
    pub port: Port,
}

/// Which way bytes go on a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// From the device to the robot's program (on the air: from the PC to the radio's air end).
    ToMaster,
    /// From the robot's program to the device.
    ToDevice,
}

impl Direction {
    /// Name as in scenarios and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ToMaster => "to-master",
            Self::ToDevice => "to-device",
        }
    }
}

/// What has passed a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes that left the sender.
    pub sent: u64,
    /// Bytes that faults took away.
    pub lost: u64,
    /// Bytes that faults added.
    pub added: u64,
    /// Bytes that reached the receiver.
    pub delivered: u64,
    /// Characters without a valid stop bit: never delivered as data.
    pub framing_errors: u64,
    /// Bytes that a receiver at another baud rate read differently in number: what came out of
    /// resampling, minus what went in.
    pub resampled: i64,
}

/// Bytes on their way.
#[derive(Clone, Debug)]
struct Chunk {
    arrives: Instant,
    bytes: Vec<u8>,
    framing_errors: u32,
    original: Option<Box<Original>>,
}

/// One direction of a link.
#[derive(Clone, Debug)]
pub struct Line {
    /// Where bytes come from.
    pub from: End,
    /// Where they go.
    pub to: End,
    /// What goes wrong.
    pub faults: LineFaults,
    /// Time between the last bit on the wire and the receiver seeing the byte.
    pub latency: Duration,
    /// Most bytes that travel as one piece. Byte times are exact all the same; a larger piece
    /// only means that the receiver hears of all its bytes when the last one is complete.
    pub piece: usize,
    /// Whether the sender is unplugged and a recording plays in its place: what the sender puts on
    /// the wire is lost, what [`play`](Self::play) adds arrives.
    pub is_played: bool,
    /// The sender's epoch in which it had nothing to send: not asked again before the next.
    pub(crate) silent_since: Option<u64>,
    traffic: Traffic,
    free_at: Instant,
    /// When [`deliver`](Self::deliver) next has something to do.
    due: Instant,
    chunks: VecDeque<Chunk>,
    in_flight: u64,
    resampler: Resampler,
    spare: Vec<Vec<u8>>,
}

/// Most chunks on their way at once; a sender is asked for more only below it.
const CHUNKS_MAX: usize = 64;
/// Later than any run.
const NEVER: Instant = Instant::from_nanos(u64::MAX);
/// Largest piece.
const PIECE_MAX: usize = 64;

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
            silent_since: None,
            traffic: Traffic::default(),
            free_at: Instant::ZERO,
            due: NEVER,
            chunks: VecDeque::new(),
            in_flight: 0,
            resampler: Resampler::default(),
            spare: Vec::new(),
        }
    }

    /// What has passed so far.
    pub const fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// Bytes sent and not yet delivered.
    pub const fn in_flight(&self) -> u64 {
        self.in_flight
    }

    /// Whether each byte sent was delivered, lost, garbled or is on its way.
    pub fn conserves_bytes(&self) -> bool {
        let t = &self.traffic;
        let [sent, lost, added, delivered, errors, in_flight] = [
            t.sent,
            t.lost,
            t.added,
            t.delivered,
            t.framing_errors,
            self.in_flight,
        ]
        .map(u64::cast_signed);
        sent - lost + added + t.resampled == delivered + errors + in_flight
    }

    /// When the line next has something to deliver, or can take more from a sender that had more
    /// the last time.
    pub fn poll_at(&self, now: Instant) -> Option<Instant> {
        let asks_again = self.silent_since.is_none() && self.free_at > now;
        let due = asks_again
            .then_some(self.free_at)
            .map_or(self.due, |at| at.min(self.due));
        (due < NEVER).then_some(due)
    }

    /// Whether something has arrived by `now`.
    pub(crate) fn is_due(&self, now: Instant) -> bool {
        self.due <= now
    }

    fn note_due(&mut self) {
        let front = self.chunks.front().map(|chunk| chunk.arrives);
        self.due = front
            .into_iter()
            .chain(self.resampler.idle_at())
            .min()
            .unwrap_or(NEVER);
    }

    /// Whether the line can take bytes from its sender at `now`.
    pub fn has_room(&self, now: Instant) -> bool {
        self.free_at <= now && self.chunks.len() < CHUNKS_MAX
    }

    /// Takes what the sender has ready, `transmit(buf) -> len`, and puts it on the wire. Returns
    /// the bytes as sent and when the last of them ends, or `None` if there was nothing.
    pub fn take(
        &mut self,
        now: Instant,
        sender: LineConfig,
        receiver: LineConfig,
        transmit: impl FnOnce(&mut [u8]) -> usize,
    ) -> Option<(Instant, SentBytes)> {
        let mut buf = [0; PIECE_MAX];
        let len = transmit(&mut buf[..self.piece.min(PIECE_MAX)]);
        if len == 0 {
            return None;
        }
        let sent = &buf[..len];
        let start = now;
        let ends = start + sender.bytes_time(len as u64);
        self.free_at = ends;
        if self.is_played {
            self.traffic.sent += len as u64;
            self.traffic.lost += len as u64;
            return Some((ends, SentBytes { buf, len }));
        }

        let mut bytes = self.spare.pop().unwrap_or_default();
        bytes.clear();
        let struck = self.faults.struck_len();
        if self.faults.is_clean() {
            bytes.extend_from_slice(sent);
        } else {
            for (number, &byte) in (self.traffic.sent..).zip(sent) {
                self.faults.strike(number, byte, start, &mut bytes);
            }
        }
        self.traffic.sent += len as u64;
        self.traffic.added += bytes.len().saturating_sub(len) as u64;
        self.traffic.lost += len.saturating_sub(bytes.len()) as u64;

        let mut original = (!self.faults.is_clean() && bytes != sent)
            .then(|| Box::new(self.original(ends, start, sent, struck)));
        let mut framing_errors = 0;
        if !sender.agrees_with(receiver) {
            let before = bytes.len();
            framing_errors = self.resampler.feed(&mut bytes, start, sender, receiver);
            self.traffic.resampled +=
                bytes.len() as i64 + i64::from(framing_errors) - before as i64;
            let original =
                original.get_or_insert_with(|| Box::new(self.original(ends, start, sent, struck)));
            original.bauds = Some([sender.baud, receiver.baud]);
        } else if original.is_none() && self.latency > Duration::ZERO {
            original = Some(Box::new(self.original(ends, start, sent, struck)));
        }
        self.send_off(ends, bytes, framing_errors, original);
        Some((ends, SentBytes { buf, len }))
    }

    /// What is kept of `sent` because something else will arrive, or later.
    fn original(&self, ends: Instant, start: Instant, sent: &[u8], struck: usize) -> Original {
        Original {
            at: ends,
            bytes: sent.to_vec(),
            strikes: self.faults.struck().skip(struck).copied().collect(),
            is_cut: self.faults.is_cut(start),
            bauds: None,
        }
    }

    fn send_off(
        &mut self,
        ends: Instant,
        bytes: Vec<u8>,
        framing_errors: u32,
        original: Option<Box<Original>>,
    ) {
        self.in_flight += bytes.len() as u64 + u64::from(framing_errors);
        self.chunks.push_back(Chunk {
            arrives: ends + self.latency,
            bytes,
            framing_errors,
            original,
        });
        self.note_due();
    }

    /// Lets `bytes` arrive at `at`, no earlier than what is on its way, whatever the sender does;
    /// `framing_errors` characters without a stop bit come before them.
    pub fn play(&mut self, at: Instant, bytes: &[u8], framing_errors: u32) {
        let added = bytes.len() as u64 + u64::from(framing_errors);
        self.traffic.added += added;
        self.in_flight += added;
        self.chunks.push_back(Chunk {
            arrives: at,
            bytes: bytes.to_vec(),
            framing_errors,
            original: None,
        });
        self.note_due();
    }

    /// Hands over what has arrived by `now`, one chunk a call.
    pub fn deliver(&mut self, now: Instant) -> Option<Delivery> {
        if self.due > now {
            return None;
        }
        if self.resampler.idle_at().is_some_and(|at| at <= now) {
            let mut bytes = self.spare.pop().unwrap_or_default();
            bytes.clear();
            let framing_errors = self.resampler.idle(&mut bytes);
            self.traffic.resampled += bytes.len() as i64 + i64::from(framing_errors);
            self.send_off(now, bytes, framing_errors, None);
        }
        if self.chunks.front()?.arrives > now {
            return None;
        }
        let chunk = self.chunks.pop_front()?;
        self.note_due();
        self.in_flight -= chunk.bytes.len() as u64 + u64::from(chunk.framing_errors);
        self.traffic.delivered += chunk.bytes.len() as u64;
        self.traffic.framing_errors += u64::from(chunk.framing_errors);
        let event = (chunk.framing_errors > 0).then_some(LineEvent::FramingError);
        Some(Delivery {
            at: chunk.arrives,
            bytes: chunk.bytes,
            event,
            framing_errors: chunk.framing_errors,
            original: chunk.original,
        })
    }

    /// Gives a delivered buffer back for later use.
    pub fn recycle(&mut self, bytes: Vec<u8>) {
        if self.spare.len() < 4 {
            self.spare.push(bytes);
        }
    }
}

/// What a sender gave in one go.
#[derive(Clone, Copy, Debug)]
pub struct SentBytes {
    buf: [u8; PIECE_MAX],
    len: usize,
}

impl core::ops::Deref for SentBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.buf[..self.len]
    }
}

/// What a receiver gets in one go.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// When the last byte was complete.
    pub at: Instant,
    /// The bytes, faults applied; may be empty.
    pub bytes: Vec<u8>,
    /// What happened besides.
    pub event: Option<LineEvent>,
    /// Characters without a valid stop bit among what was sent.
    pub framing_errors: u32,
    /// What was sent, if the line changed or delayed it.
    pub original: Option<Box<Original>>,
}

/// Bytes as they left the sender, and what the line did to them.
#[derive(Clone, Debug)]
pub struct Original {
    /// When the last of them ended on the wire.
    pub at: Instant,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// The damage, byte by byte.
    pub strikes: Vec<Strike>,
    /// Whether the line was cut.
    pub is_cut: bool,
    /// The rates of sender and receiver, if those do not agree.
    pub bauds: Option<[u32; 2]>,
}

impl Original {
    /// Whether `arrived` are the bytes as sent, which nothing but time befell.
    pub(crate) fn is_only_late(&self, arrived: &[u8]) -> bool {
        self.strikes.is_empty() && !self.is_cut && self.bauds.is_none() && self.bytes == arrived
    }
}
