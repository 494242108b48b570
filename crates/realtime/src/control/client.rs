//! A client of the socket: requests in, answers out.

use std::io::{self, Read as _, Write as _};
use std::os::unix::net::UnixStream;

use protocols::Instant;

use super::LINE_MAX;
use super::answer::{Answer, Refusal};
use super::perform::{Office, Pending, Reply, Session};

/// Maximum number of requests of one client in one turn, so that no client blocks the rig.
const REQUESTS_MAX: usize = 8;
/// Maximum number of answer bytes that wait for a client that does not read. While there are more,
/// its requests wait.
const UNREAD_MAX: usize = 64 << 10;

#[derive(Debug)]
pub(super) struct Client {
    stream: UnixStream,
    session: Session,
    request: Vec<u8>,
    /// Whether the rest of a too long request is being skipped.
    skips: bool,
    /// The event for which the answer to the last request waits.
    pending: Option<Pending>,
    unread: Vec<u8>,
    /// Whether the client has closed its side.
    has_ended: bool,
    is_broken: bool,
    /// Time of its last request: twice the number of the poll, plus one if the poll found a
    /// request.
    heard: u64,
}

impl Client {
    pub(super) fn new(stream: UnixStream, look: u64) -> Self {
        Self {
            stream,
            session: Session::default(),
            request: Vec::new(),
            skips: false,
            pending: None,
            unread: Vec::new(),
            has_ended: false,
            is_broken: false,
            heard: 2 * look,
        }
    }

    /// Whether the connection is finished.
    pub(super) fn is_gone(&self) -> bool {
        let is_done = self.pending.is_none() && self.unread.is_empty();
        self.is_broken || (self.has_ended && is_done)
    }

    /// Whether the client has left or closed its side.
    pub(super) const fn has_ended(&self) -> bool {
        self.has_ended || self.is_broken
    }

    /// Whether the client sets modem lines.
    pub(super) const fn has_modem(&self) -> bool {
        self.session.has_modem
    }

    /// Time since which the client is idle, if it has no pending answer or has closed its side.
    /// Only for comparison between clients.
    pub(super) fn idle_since(&self) -> Option<u64> {
        (self.pending.is_none() || self.has_ended).then_some(self.heard)
    }

    /// Reads available requests, up to the longest line; returns whether there were any.
    pub(super) fn hear(&mut self, look: u64) -> bool {
        let before = self.request.len();
        while self.fill(look) {}
        self.request.len() > before
    }

    /// Executes the requests that were read, and sends the answers.
    pub(super) fn serve(&mut self, office: &mut Office<'_>, now: Instant) -> Vec<Answer> {
        let mut answers = Vec::new();
        self.write();
        while answers.len() < REQUESTS_MAX && self.unread.len() <= UNREAD_MAX {
            let reply = match self.pending.take() {
                Some(pending) => office.look_again(pending),
                None => match self.next_line() {
                    None => break,
                    Some(Err(refusal)) => {
                        office.tally.requests += 1;
                        office.tally.refused += 1;
                        Reply::Now(refusal.into())
                    }
                    Some(Ok(line)) => office.perform(&mut self.session, &line, now),
                },
            };
            match reply {
                Reply::Now(answer) => {
                    self.unread.extend_from_slice(answer.line().as_bytes());
                    answers.push(answer);
                }
                Reply::Later(pending) => {
                    self.pending = Some(pending);
                    break;
                }
            }
        }
        self.write();
        answers
    }

    /// Sends a refusal without a request, and closes the connection.
    pub(super) fn hang_up(&mut self, refusal: Refusal) {
        let answer = Answer::from(refusal);
        self.unread.extend_from_slice(answer.line().as_bytes());
        self.write();
        self.is_broken = true;
    }

    /// Answers a client that waits for an event in a run that has ended.
    pub(super) fn end(&mut self) {
        if self.pending.take().is_some() {
            self.hang_up(Refusal::new("run", "the run has ended"));
        }
    }

    /// The next complete line, or the refusal of a too long one.
    fn next_line(&mut self) -> Option<Result<Vec<u8>, Refusal>> {
        while let Some(end) = self.request.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.request.drain(..=end).collect();
            if !core::mem::take(&mut self.skips) {
                return Some(Ok(line));
            }
        }
        if self.request.len() < LINE_MAX {
            return None;
        }
        self.request.clear();
        let is_first = !core::mem::replace(&mut self.skips, true);
        is_first.then(|| {
            let message = format!("is too long, expected at most {LINE_MAX} bytes a line");
            Err(Refusal::new("request", message))
        })
    }

    /// Reads the bytes that are available now; returns whether there were any.
    fn fill(&mut self, look: u64) -> bool {
        let mut buf = [0; 4096];
        let room = LINE_MAX.saturating_sub(self.request.len()).min(buf.len());
        if room == 0 || self.has_ended {
            return false;
        }
        loop {
            match self.stream.read(&mut buf[..room]) {
                Ok(0) => self.has_ended = true,
                Ok(len) => {
                    self.request.extend_from_slice(&buf[..len]);
                    self.heard = 2 * look + 1;
                    return true;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => self.is_broken |= error.kind() != io::ErrorKind::WouldBlock,
            }
            return false;
        }
    }

    fn write(&mut self) {
        while !self.unread.is_empty() {
            match self.stream.write(&self.unread) {
                Ok(len) => drop(self.unread.drain(..len)),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    self.is_broken |= error.kind() != io::ErrorKind::WouldBlock;
                    return;
                }
            }
        }
    }
}
