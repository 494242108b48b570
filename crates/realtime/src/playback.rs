//! A capture played into ports, in the place of a device or of a program.

use core::time::Duration;

use protocols::Instant;

use crate::clock::Clock;
use crate::transport::{PortEvent, Transport, TransportError, wait};
use capture::divergence::{Divergence, Track, compare};
use capture::replay::{Passage, Played, Recorded};
use engine::rig::line::Direction;

/// Whose part the capture takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Side {
    /// The device's: a program on the port is told what it was told
    Device,
    /// The program's: a device on the port is told what it was told
    Program,
}

impl Side {
    /// The direction in which the capture speaks.
    pub const fn speaks(self) -> Direction {
        match self {
            Self::Device => Direction::ToMaster,
            Self::Program => Direction::ToDevice,
        }
    }

    /// The direction in which it listens.
    pub const fn hears(self) -> Direction {
        match self {
            Self::Device => Direction::ToDevice,
            Self::Program => Direction::ToMaster,
        }
    }
}

/// How fast a capture is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplayPace {
    /// This many times as fast as it was recorded.
    Times(f64),
    /// A piece whenever [`Playback::step`] is called.
    Stepped,
}

/// A link of the capture and the port that it is played into.
pub struct Socket {
    link: String,
    side: Side,
    port: Box<dyn Transport>,
    is_open: bool,
    /// What is said, piece by piece.
    lines: std::vec::IntoIter<(Instant, Vec<u8>)>,
    /// Said, and not taken by the port yet.
    pending: Vec<u8>,
    expected: Track,
    got: Track,
    said: u64,
}

impl Socket {
    /// Plays one `side` of `passage` into `port`.
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
            lines: pieces.collect::<Vec<_>>().into_iter(),
            pending: Vec::new(),
            expected: expected.clone(),
            got: Track::default(),
            said: 0,
            port,
        }
    }

    /// Name of the link.
    pub fn link(&self) -> &str {
        &self.link
    }

    /// Bytes said and heard so far.
    pub fn counts(&self) -> [u64; 2] {
        [self.said, self.got.bytes().len() as u64]
    }

    /// Where what was heard first differs from the capture.
    pub fn divergence(&self) -> Option<Divergence> {
        compare(&self.link, self.side.hears(), &self.expected, &self.got)
    }

    /// What was heard, beside what the capture says.
    pub fn played(&self) -> Played {
        Played {
            link: self.link.clone(),
            expected: self.expected.clone(),
            got: self.got.clone(),
        }
    }

    fn next_at(&self) -> Option<Instant> {
        self.lines.as_slice().first().map(|&(at, _)| at)
    }

    fn listen(&mut self, now: Instant) -> Result<(), TransportError> {
        let mut buf = [0; 1024];
        for _ in 0..READS_MAX {
            let len = self.port.read(&mut buf)?;
            while let Some(event) = self.port.next_event() {
                self.is_open = match event {
                    PortEvent::Opened => true,
                    PortEvent::Closed => false,
                    PortEvent::BaudChanged(_) => self.is_open,
                };
            }
            if len == 0 {
                break;
            }
            self.got.push(now, &buf[..len]);
        }
        Ok(())
    }

    /// Hands over as much as the port takes; the rest waits, so that nothing is lost however fast
    /// the capture is played.
    fn say(&mut self) {
        while !self.pending.is_empty() {
            let len = self.pending.len().min(PIECE_MAX);
            let taken = self.port.write(&self.pending[..len]);
            self.said += taken as u64;
            self.pending.drain(..taken);
            if taken < len {
                break;
            }
        }
    }
}

const READS_MAX: usize = 16;
/// Most bytes handed over in one go.
const PIECE_MAX: usize = 256;
/// Bytes of a link that wait for a port before the capture is held up.
const PENDING_MAX: usize = 1 << 16;
/// Longest wait: a port may have no way to wake us.
const WAIT_MAX: Duration = Duration::from_millis(5);

/// A port went away while a capture was played into it.
#[derive(Debug, thiserror::Error)]
#[error("link {link}: {source}")]
pub struct PlaybackError {
    /// The link that belongs there.
    pub link: String,
    /// What happened.
    pub source: TransportError,
}

/// A capture being played into ports.
pub struct Playback<C> {
    clock: C,
    pace: ReplayPace,
    sockets: Vec<Socket>,
    /// The clock's time at which the capture begins; `None`: not all ports are open yet.
    started: Option<Instant>,
    /// Time of the capture.
    now: Instant,
    end: Instant,
}

impl<C: Clock> Playback<C> {
    /// Plays `recorded` into `sockets`, from when somebody has each of them open.
    pub fn new(clock: C, recorded: &Recorded, sockets: Vec<Socket>, pace: ReplayPace) -> Self {
        Self {
            clock,
            pace,
            sockets,
            started: None,
            now: Instant::ZERO,
            end: recorded.end,
        }
    }

    /// The clock.
    pub const fn clock(&self) -> &C {
        &self.clock
    }

    /// Time of the capture.
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// The links being played.
    pub fn sockets(&self) -> &[Socket] {
        &self.sockets
    }

    /// A port that nobody has open yet, if that is what is waited for.
    pub fn waits_for(&self) -> Option<&Socket> {
        self.sockets
            .iter()
            .find(|socket| !socket.is_open)
            .filter(|_| self.started.is_none())
    }

    /// Whether all was said and taken.
    pub fn is_over(&self) -> bool {
        let is_done = |one: &Socket| one.next_at().is_none() && one.pending.is_empty();
        self.sockets.iter().all(is_done)
            && (self.now >= self.end || self.pace == ReplayPace::Stepped)
    }

    /// Whether all that the capture says was heard.
    pub fn has_heard_all(&self) -> bool {
        let has_all = |one: &Socket| one.got.bytes().len() >= one.expected.bytes().len();
        self.sockets.iter().all(has_all)
    }

    /// Says what is due, listens, and waits a little.
    ///
    /// # Errors
    /// If a port went away.
    pub fn turn(&mut self) -> Result<(), PlaybackError> {
        self.listen()?;
        let clock = self.clock.now();
        if self.started.is_none() && self.sockets.iter().all(|socket| socket.is_open) {
            self.started = Some(clock);
        }
        if let (Some(started), ReplayPace::Times(times)) = (self.started, self.pace)
            && self
                .sockets
                .iter()
                .all(|socket| socket.pending.len() < PENDING_MAX)
        {
            self.now = Instant::ZERO + (clock - started).mul_f64(times);
            for socket in &mut self.sockets {
                while socket.next_at().is_some_and(|at| at <= self.now) {
                    let (_, bytes) = socket.lines.next().expect("was there");
                    socket.pending.extend(bytes);
                }
            }
        }
        self.sockets.iter_mut().for_each(Socket::say);
        self.wait();
        Ok(())
    }

    /// Says the next piece, whenever it was due: its time, its link and its bytes. `None`: all
    /// was said.
    pub fn step(&mut self) -> Option<(Instant, String, Vec<u8>)> {
        let due = self
            .sockets
            .iter_mut()
            .filter(|socket| socket.next_at().is_some());
        let socket = due.min_by_key(|socket| socket.next_at())?;
        let (at, bytes) = socket.lines.next()?;
        socket.pending.extend_from_slice(&bytes);
        socket.say();
        self.now = at;
        Some((at, socket.link.clone(), bytes))
    }

    /// Whether somebody read since the last was said, where that can be known. To be asked when all
    /// was said, before the ports are given up.
    pub fn is_drained(&mut self) -> bool {
        let mut sockets = self.sockets.iter_mut();
        sockets.all(|socket| socket.port.is_drained())
    }

    fn listen(&mut self) -> Result<(), PlaybackError> {
        for socket in &mut self.sockets {
            socket.listen(self.now).map_err(|source| PlaybackError {
                link: socket.link.clone(),
                source,
            })?;
        }
        Ok(())
    }

    fn wait(&self) {
        let now = self.clock.now();
        let next = self.sockets.iter().filter_map(Socket::next_at).min();
        let mut timeout = WAIT_MAX;
        if let (Some(next), ReplayPace::Times(times)) = (next, self.pace) {
            timeout = timeout.min((next - self.now).div_f64(times));
        }
        if self.sockets.iter().any(|socket| !socket.pending.is_empty()) {
            timeout = timeout.min(Duration::from_millis(1));
        }
        let mut fds = Vec::new();
        self.sockets
            .iter()
            .for_each(|socket| socket.port.readiness(&mut fds));
        if fds.is_empty() || wait(&fds, timeout).is_err() {
            self.clock.sleep_until(now + timeout);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SimClock;
    use crate::transport::Memory;

    fn track(pieces: &[(u64, &[u8])]) -> Track {
        let mut track = Track::default();
        for (millis, bytes) in pieces {
            track.push(Instant::from_millis(*millis), bytes);
        }
        track
    }

    /// A link whose program said `sent`, played as the program.
    fn socket(link: &str, sent: &[(u64, &[u8])]) -> (Socket, Memory) {
        let (port, far) = Memory::pair(link);
        let passage = Passage {
            link: link.to_owned(),
            sent: track(sent),
            ..Passage::default()
        };
        (Socket::new(&passage, Side::Program, Box::new(port)), far)
    }

    fn read(far: &mut Memory) -> Vec<u8> {
        let mut buf = vec![0; 9_000];
        let len = far.read(&mut buf).expect("open");
        buf[..len].to_vec()
    }

    /// A port that holds 4096 bytes takes no more until somebody reads; nothing is lost.
    #[test]
    fn what_a_port_does_not_take_waits() {
        let (mut socket, mut far) = socket("base", &[]);
        let all: Vec<u8> = (0..5_000_u32).map(|n| n.to_le_bytes()[0]).collect();
        socket.pending = all.clone();
        socket.say();
        assert_eq!((socket.counts(), socket.pending.len()), ([4_096, 0], 904));
        let mut got = read(&mut far);
        socket.say();
        assert_eq!((socket.counts(), socket.pending.len()), ([5_000, 0], 0));
        got.extend(read(&mut far));
        assert_eq!(got, all);
    }

    #[test]
    fn what_the_far_end_says_is_heard_and_its_opening_noted() {
        let (mut socket, mut far) = socket("base", &[]);
        assert!(!socket.is_open && far.write(b"abc") == 3);
        socket.listen(Instant::from_millis(4)).expect("open");
        assert!(socket.is_open && socket.counts() == [0, 3]);
        drop(far);
        socket
            .listen(Instant::from_millis(5))
            .expect("closed is no error");
        socket
            .listen(Instant::from_millis(6))
            .expect("closed is no error");
        assert!(!socket.is_open && socket.played().got.bytes() == b"abc");
    }

    /// Pieces go by their times over all links.
    #[test]
    fn a_step_says_what_is_next() {
        let (one, mut far) = socket("one", &[(10, b"a"), (30, b"c")]);
        let (two, _far_two) = socket("two", &[(20, b"b")]);
        let recorded = Recorded {
            end: Instant::from_millis(40),
            ..Recorded::default()
        };
        let pace = ReplayPace::Stepped;
        let mut playback = Playback::new(SimClock::default(), &recorded, vec![one, two], pace);
        let mut said = Vec::new();
        while let Some((at, link, bytes)) = playback.step() {
            assert_eq!(playback.now(), at);
            said.push((at.as_millis(), link, bytes));
        }
        let expected = [(10, "one", b"a"), (20, "two", b"b"), (30, "one", b"c")];
        let expected = expected.map(|(at, link, bytes)| (at, link.to_owned(), bytes.to_vec()));
        assert_eq!(said, expected);
        assert!(playback.is_over() && read(&mut far) == b"ac");
    }

    /// Twice as fast: what was said at 10 ms is due after 5.
    #[test]
    fn a_capture_is_played_at_its_pace_once_all_ports_are_open() {
        let (one, mut far) = socket("one", &[(10, b"a"), (30, b"c")]);
        let recorded = Recorded {
            end: Instant::from_millis(40),
            ..Recorded::default()
        };
        let pace = ReplayPace::Times(2.0);
        let mut playback = Playback::new(SimClock::default(), &recorded, vec![one], pace);
        assert_eq!(playback.waits_for().map(Socket::link), Some("one"));
        let mut seen = Vec::new();
        while !playback.is_over() && seen.len() < 99 {
            playback.turn().expect("open");
            seen.push((playback.now().as_millis(), read(&mut far)));
        }
        assert!(playback.waits_for().is_none() && playback.has_heard_all());
        let said: Vec<_> = seen.iter().filter(|it| !it.1.is_empty()).collect();
        assert_eq!((said[0].0, said[1].0, said.len()), (10, 30, 2), "{seen:?}");
        assert!(playback.clock().now() >= Instant::from_millis(20));
        assert!(playback.clock().now() < Instant::from_millis(40));
    }
}
