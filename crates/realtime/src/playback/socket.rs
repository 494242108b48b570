//! A link of a capture and its port.

use core::ops::Range;

use protocols::Instant;

use crate::transport::{PortEvent, Transport, TransportError};
use capture::divergence::{Divergence, Track, compare};
use capture::replay::{Conversation, Passage, Played, Talked};
use engine::rig::line::Direction;

/// Side of the link that the capture replaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Side {
    /// The device: a program at the port receives the recorded bytes of the device
    Device,
    /// The program: a device at the port receives the recorded bytes of the program
    Program,
}

impl Side {
    /// Direction of the played bytes.
    pub const fn speaks(self) -> Direction {
        match self {
            Self::Device => Direction::ToMaster,
            Self::Program => Direction::ToDevice,
        }
    }

    /// Direction of the received bytes.
    pub const fn hears(self) -> Direction {
        match self {
            Self::Device => Direction::ToDevice,
            Self::Program => Direction::ToMaster,
        }
    }
}

/// Source of the bytes for a port.
enum Voice {
    /// Pieces of the capture with their times.
    Clock(std::vec::IntoIter<(Instant, Vec<u8>)>),
    /// Answers of the capture to requests of the program.
    Conversation(Box<Conversation>),
}

/// A link of the capture and its port.
pub struct Socket {
    pub(super) link: String,
    side: Side,
    pub(super) port: Box<dyn Transport>,
    pub(super) is_open: bool,
    pub(super) was_opened: bool,
    voice: Voice,
    /// Bytes that the port has not taken yet.
    pub(super) pending: Vec<u8>,
    pub(super) expected: Track,
    pub(super) got: Track,
    /// Bytes that the port has taken.
    spoken: Track,
    pub(super) said: u64,
}

impl Socket {
    /// Answers at `port` like the device on `passage` in the `session` of a capture.
    pub fn talking(passage: &Passage, session: &Range<Instant>, port: Box<dyn Transport>) -> Self {
        let talk = Conversation::new(passage, session, false);
        Self {
            voice: Voice::Conversation(Box::new(talk)),
            ..Self::new(passage, Side::Device, port)
        }
    }

    /// Plays one `side` of `passage` to `port`, each piece at its time.
    pub fn new(passage: &Passage, side: Side, port: Box<dyn Transport>) -> Self {
        let mut answers = Track::default();
        for arrival in &passage.arrivals {
            answers.push(arrival.at, &arrival.bytes);
        }
        let (said, expected) = match side {
            Side::Device => (&answers, &passage.sent),
            Side::Program => (&passage.sent, &answers),
        };
        let pieces = said.pieces().map(|(at, bytes)| (at, bytes.to_vec()));
        Self {
            link: passage.link.clone(),
            side,
            is_open: false,
            was_opened: false,
            voice: Voice::Clock(pieces.collect::<Vec<_>>().into_iter()),
            pending: Vec::new(),
            expected: expected.clone(),
            got: Track::default(),
            spoken: Track::default(),
            said: 0,
            port,
        }
    }

    /// Name of the link.
    pub fn link(&self) -> &str {
        &self.link
    }

    /// Number of bytes sent and received so far.
    pub fn counts(&self) -> [u64; 2] {
        [self.said, self.got.bytes().len() as u64]
    }

    /// First difference between the received bytes and the capture.
    pub fn divergence(&self) -> Option<Divergence> {
        match &self.voice {
            Voice::Conversation(talk) => talk.divergence(),
            Voice::Clock(_) => compare(&self.link, self.side.hears(), &self.expected, &self.got),
        }
    }

    /// The conversation, if it is one.
    pub fn talk(&self) -> Option<&Conversation> {
        match &self.voice {
            Voice::Conversation(talk) => Some(talk),
            Voice::Clock(_) => None,
        }
    }

    /// Sent and received bytes, with their times in the capture.
    pub const fn passed(&self) -> [&Track; 2] {
        [&self.spoken, &self.got]
    }

    /// Number of bytes that the port has not taken, or that are not yet due.
    fn left(&self) -> usize {
        let lines = match &self.voice {
            Voice::Clock(lines) => lines.as_slice().iter().map(|(_, bytes)| bytes.len()).sum(),
            Voice::Conversation(_) => 0,
        };
        self.pending.len() + lines
    }

    /// Problem of the client: it closed the port too early, or does not read.
    pub fn trouble(&self) -> Option<String> {
        let (link, left) = (&self.link, self.left());
        let talk = self.talk().filter(|talk| !talk.is_done());
        match (self.was_opened, self.is_open) {
            (true, false) if left > 0 => Some(format!(
                "{link}: the client closed the port; {left} bytes were not played"
            )),
            (true, false) => {
                let tally = talk?.tally();
                Some(format!("{link}: the client closed the port; {tally}"))
            }
            (true, true) if !self.pending.is_empty() => {
                let waiting = self.pending.len();
                Some(format!(
                    "{link}: the client does not read; {waiting} bytes wait"
                ))
            }
            _ => None,
        }
    }

    /// Received bytes, beside those of the capture.
    pub fn played(&self) -> Played {
        Played {
            link: self.link.clone(),
            expected: self.expected.clone(),
            got: self.got.clone(),
            talk: self.talk().map(Talked::of),
        }
    }

    pub(super) fn next_at(&self) -> Option<Instant> {
        match &self.voice {
            Voice::Clock(lines) => lines.as_slice().first().map(|&(at, _)| at),
            Voice::Conversation(talk) => talk.poll_at(),
        }
    }

    /// The next piece in a playback by time.
    pub(super) fn next_line(&mut self) -> Option<(Instant, Vec<u8>)> {
        match &mut self.voice {
            Voice::Clock(lines) => lines.next(),
            Voice::Conversation(_) => None,
        }
    }

    /// Collects the bytes that are due at `now`.
    pub(super) fn gather(&mut self, now: Instant) {
        if let Voice::Conversation(talk) = &mut self.voice {
            talk.poll(now);
            let mut buf = [0; PIECE_MAX];
            while let len @ 1.. = talk.transmit(&mut buf) {
                self.pending.extend_from_slice(&buf[..len]);
            }
            if self.was_closed() {
                // Without a client the bytes are lost, as on a wire.
                self.pending.clear();
            }
            return;
        }
        while self.next_at().is_some_and(|at| at <= now)
            && let Some((_, bytes)) = self.next_line()
        {
            self.pending.extend(bytes);
        }
    }

    pub(super) fn listen(&mut self, now: Instant) -> Result<(), TransportError> {
        let mut buf = [0; 1024];
        for _ in 0..READS_MAX {
            let len = self.port.read(&mut buf)?;
            while let Some(event) = self.port.next_event() {
                self.is_open = match event {
                    PortEvent::Opened => true,
                    PortEvent::Closed => false,
                    PortEvent::BaudChanged(_) => self.is_open,
                };
                self.was_opened |= self.is_open;
                match &mut self.voice {
                    Voice::Conversation(talk) if self.is_open => talk.open(now),
                    Voice::Conversation(talk) => talk.close(),
                    Voice::Clock(_) => {}
                }
            }
            if len == 0 {
                break;
            }
            self.got.push(now, &buf[..len]);
            if let Voice::Conversation(talk) = &mut self.voice {
                talk.receive(now, &buf[..len]);
            }
        }
        Ok(())
    }

    pub(super) const fn was_closed(&self) -> bool {
        self.was_opened && !self.is_open
    }

    /// Writes as many bytes as the port takes. The rest waits, so that no byte is lost at any speed
    /// of the playback.
    pub(super) fn say(&mut self, now: Instant) {
        while !self.pending.is_empty() {
            let len = self.pending.len().min(PIECE_MAX);
            let taken = self.port.write(&self.pending[..len]);
            self.said += taken as u64;
            self.spoken.push(now, &self.pending[..taken]);
            self.pending.drain(..taken);
            if taken < len {
                break;
            }
        }
    }
}

const READS_MAX: usize = 16;
/// Maximum number of bytes in one write.
const PIECE_MAX: usize = 256;
