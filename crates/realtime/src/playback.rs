//! A capture that is played to ports, instead of a device or a program.

mod socket;

use core::time::Duration;

use protocols::Instant;

use crate::clock::Clock;
use crate::transport::{TransportError, wait};
use capture::replay::{Conversation, Recorded, are_over};

pub use socket::{Side, Socket};

/// Speed of a playback.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplayPace {
    /// Multiple of the recorded speed.
    Times(f64),
    /// One piece for each call of [`Playback::step`].
    Stepped,
}

/// Maximum number of bytes of a link that wait for a port; then the playback stops.
const PENDING_MAX: usize = 1 << 16;
/// Time without a taken byte after which the playback reports a problem.
const STUCK: Duration = Duration::from_secs(5);
/// Maximum wait, because some ports cannot wake this thread.
const WAIT_MAX: Duration = Duration::from_millis(5);

/// A port disappeared during a playback.
#[derive(Debug, thiserror::Error)]
#[error("link {link}: {source}")]
pub struct PlaybackError {
    /// Link of the port.
    pub link: String,
    /// Error of the port.
    pub source: TransportError,
}

/// A playback of a capture to ports.
pub struct Playback<C> {
    clock: C,
    pace: ReplayPace,
    sockets: Vec<Socket>,
    /// The clock's time at which the capture begins; `None`: the ports are not open yet.
    started: Option<Instant>,
    /// Time in the capture; in a conversation, time since its beginning.
    now: Instant,
    end: Instant,
    /// Time at which a port last took bytes, and the number of taken bytes.
    taken: (Instant, u64),
}

impl<C: Clock> Playback<C> {
    /// Plays `recorded` to `sockets`. A playback by time begins when all ports have been opened, a
    /// conversation when one has been.
    pub fn new(clock: C, recorded: &Recorded, sockets: Vec<Socket>, pace: ReplayPace) -> Self {
        let is_talk = sockets.iter().any(|socket| socket.talk().is_some());
        let end = match is_talk {
            true => Instant::ZERO + (recorded.end - recorded.origin()),
            false => recorded.end,
        };
        Self {
            clock,
            pace,
            sockets,
            started: None,
            now: Instant::ZERO,
            end,
            taken: (Instant::ZERO, 0),
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

    /// An unopened port for which the playback waits.
    pub fn waits_for(&self) -> Option<&Socket> {
        self.unopened().filter(|_| self.started.is_none())
    }

    /// A port that was never opened.
    pub fn unopened(&self) -> Option<&Socket> {
        self.sockets.iter().find(|socket| !socket.was_opened)
    }

    /// Whether all bytes were sent and taken; in a conversation, whether it has ended.
    pub fn is_over(&self) -> bool {
        let talks: Vec<&Conversation> = self.sockets.iter().filter_map(Socket::talk).collect();
        let mut sockets = self.sockets.iter();
        if !talks.is_empty() {
            return self.started.is_some()
                && sockets.all(|one| one.pending.is_empty())
                && are_over(talks, self.now, self.end);
        }
        let is_done = |one: &Socket| one.next_at().is_none() && one.pending.is_empty();
        sockets.all(is_done) && (self.now >= self.end || self.pace == ReplayPace::Stepped)
    }

    /// Reason for a stopped playback: for some time, a port has not taken bytes that are due.
    pub fn trouble(&self) -> Option<String> {
        if self.clock.now() - self.taken.0 < STUCK || self.started.is_none() {
            return None;
        }
        let waits = |one: &&Socket| !one.pending.is_empty();
        let mut stuck = self.sockets.iter().filter(waits);
        stuck.find_map(Socket::trouble)
    }

    /// Whether all clients have closed their ports.
    pub fn is_left(&self) -> bool {
        self.started.is_some() && self.sockets.iter().all(Socket::was_closed)
    }

    /// Whether as many bytes were received as the capture contains.
    pub fn has_heard_all(&self) -> bool {
        let has_all = |one: &Socket| one.got.bytes().len() >= one.expected.bytes().len();
        let mut sockets = self.sockets.iter();
        sockets.all(|one| one.talk().is_some() || has_all(one))
    }

    /// Sends the bytes that are due, receives, and waits a little.
    ///
    /// # Errors
    /// If a port disappeared.
    pub fn turn(&mut self) -> Result<(), PlaybackError> {
        self.listen()?;
        let clock = self.clock.now();
        let mut sockets = self.sockets.iter();
        let is_ready = match sockets.any(|socket| socket.talk().is_some() && socket.was_opened) {
            true => true,
            false => self.unopened().is_none(),
        };
        if self.started.is_none() && is_ready {
            self.started = Some(clock);
            self.taken.0 = clock;
        }
        if let (Some(started), ReplayPace::Times(times)) = (self.started, self.pace)
            && self
                .sockets
                .iter()
                .all(|socket| socket.pending.len() < PENDING_MAX)
        {
            self.now = Instant::ZERO + (clock - started).mul_f64(times);
            self.sockets
                .iter_mut()
                .for_each(|socket| socket.gather(self.now));
        }
        let now = self.now;
        self.sockets.iter_mut().for_each(|socket| socket.say(now));
        let taken = self.sockets.iter().map(|socket| socket.said).sum();
        let all_taken = self.sockets.iter().all(|socket| socket.pending.is_empty());
        if taken != self.taken.1 || all_taken {
            self.taken = (self.clock.now(), taken);
        }
        self.wait();
        Ok(())
    }

    /// Sends the next piece at once: its time, its link and its bytes. `None` after the last piece.
    pub fn step(&mut self) -> Option<(Instant, String, Vec<u8>)> {
        let due = self
            .sockets
            .iter_mut()
            .filter(|socket| socket.next_at().is_some());
        let socket = due.min_by_key(|socket| socket.next_at())?;
        let (at, bytes) = socket.next_line()?;
        socket.pending.extend_from_slice(&bytes);
        socket.say(at);
        self.now = at;
        Some((at, socket.link.clone(), bytes))
    }

    /// Whether a client has read since the last write, if the transport can detect this. Call it
    /// after the last write, before the ports are closed.
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
    use crate::transport::{Memory, Transport as _};
    use capture::divergence::Track;
    use capture::replay::Passage;

    fn track(pieces: &[(u64, &[u8])]) -> Track {
        let mut track = Track::default();
        for (millis, bytes) in pieces {
            track.push(Instant::from_millis(*millis), bytes);
        }
        track
    }

    /// A link whose program sent `sent`, played as the program.
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

    /// A port that holds 4096 bytes blocks until a client reads; no byte is lost.
    #[test]
    fn what_a_port_does_not_take_waits() {
        let (mut socket, mut far) = socket("base", &[]);
        let all: Vec<u8> = (0..5_000_u32).map(|n| n.to_le_bytes()[0]).collect();
        socket.pending = all.clone();
        socket.say(Instant::ZERO);
        assert_eq!((socket.counts(), socket.pending.len()), ([4_096, 0], 904));
        let mut got = read(&mut far);
        socket.say(Instant::ZERO);
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

    /// Pieces are sent in the order of their times over all links.
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

    /// Twice as fast: bytes recorded at 10 ms are due after 5 ms.
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
