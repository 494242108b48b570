//! The state of a port, which all its handles share.

use core::time::Duration;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read as _};

use bytes::Bytes;
use engine::rig::LinkKind;
use engine::rig::line::MESSAGE_MAX;
use engine::robots::OpenEnd;
use engine::run::Run;
use protocols::{Instant, LineConfig};

/// Maximum number of written bytes before a write waits, as in the driver of a UART.
const BACKLOG_MAX: usize = 4096;

/// Maximum number of unread bytes; further bytes are lost, as in the driver of a UART.
const UNREAD_MAX: usize = 4096;

/// A port of the rig.
#[derive(Debug)]
pub(crate) struct PortState {
    pub(crate) end: OpenEnd,
    pub(crate) kind: LinkKind,
    /// Baud rate and format of the program's end.
    pub(crate) line: LineConfig,
    received: VecDeque<u8>,
    messages: VecDeque<Bytes>,
    /// Number of requests on a bus whose answers have not arrived.
    unanswered: usize,
    /// Whether the program has read a byte.
    pub(crate) was_read: bool,
}

impl PortState {
    pub(crate) fn new(end: OpenEnd, kind: LinkKind) -> Self {
        let line = end.line;
        Self {
            end,
            kind,
            line,
            received: VecDeque::new(),
            messages: VecDeque::new(),
            unanswered: 0,
            was_read: false,
        }
    }

    /// Receives the arrived bytes; returns whether there were any.
    pub(crate) fn collect(&mut self, run: &mut Run) -> bool {
        let (rig, node) = (&mut run.rig, self.end.node);
        match self.kind.carries_messages() {
            true => {
                for message in rig.take_messages(node) {
                    // A late answer does not belong to the last request.
                    self.unanswered = self.unanswered.saturating_sub(1);
                    if self.unanswered == 0 {
                        self.messages.push_back(message);
                    }
                }
            }
            false => {
                self.received.extend(rig.take_output(node));
                self.received.truncate(UNREAD_MAX);
            }
        }
        self.len() > 0
    }

    /// Number of bytes that can be read now; on a link with messages, those of the next message.
    pub(crate) fn len(&self) -> usize {
        let message = self.messages.front().map(Bytes::len);
        message.unwrap_or(self.received.len())
    }

    /// Moves the available bytes into `buf`. The rest of a message is lost.
    pub(crate) fn take(&mut self, buf: &mut [u8]) -> usize {
        let len = match self.messages.pop_front() {
            None => self.received.read(buf).unwrap_or(0),
            Some(message) => {
                let len = message.len().min(buf.len());
                buf[..len].copy_from_slice(&message[..len]);
                len
            }
        };
        self.was_read |= len > 0;
        len
    }

    /// Sends a request that gets one answer.
    #[cfg(feature = "embedded")]
    pub(crate) fn request(&mut self, run: &mut Run, frame: &[u8]) {
        self.clear(run);
        self.unanswered += 1;
        self.put(run, frame);
    }

    /// The answer to the last request, if it has arrived. A request that was lost on the line gets
    /// none.
    #[cfg(feature = "embedded")]
    pub(crate) fn take_answer(&mut self, run: &mut Run) -> Option<Bytes> {
        self.collect(run);
        let answer = self.messages.pop_front();
        let link = run.rig.link(&self.end.link);
        let mut lines = link.iter().flat_map(|link| &link.lines);
        let is_under_way = lines.any(|line| line.in_flight() > 0);
        if answer.is_none() && !is_under_way && run.rig.backlog(self.end.node) == 0 {
            self.unanswered = 0;
        }
        answer
    }

    /// Discards the arrived bytes.
    #[cfg(any(feature = "embedded", feature = "serialport"))]
    pub(crate) fn clear(&mut self, run: &mut Run) {
        self.collect(run);
        self.received.clear();
        self.messages.clear();
    }

    /// Writes as many of `bytes` as fit; returns their number. A message is written as a whole.
    pub(crate) fn give(&self, run: &mut Run, bytes: &[u8]) -> io::Result<usize> {
        if self.kind.carries_messages() && bytes.len() > MESSAGE_MAX {
            let (len, name) = (bytes.len(), &self.end.name);
            let message = format!(
                "a message of {len} bytes to the port {name}, expected at most {MESSAGE_MAX}: \
                 write it in several messages"
            );
            return Err(io::Error::new(ErrorKind::InvalidInput, message));
        }
        let taken = &bytes[..bytes.len().min(self.room(run))];
        self.put(run, taken);
        Ok(taken.len())
    }

    /// Number of bytes that can be written now.
    pub(crate) fn room(&self, run: &Run) -> usize {
        let backlog = run.rig.backlog(self.end.node);
        match self.kind.carries_messages() {
            true if backlog < BACKLOG_MAX => usize::MAX,
            true => 0,
            false => BACKLOG_MAX.saturating_sub(backlog),
        }
    }

    /// Writes bytes that fit, or one message.
    pub(crate) fn put(&self, run: &mut Run, bytes: &[u8]) {
        run.rig.inject(self.end.node, bytes);
        // The line takes the first byte now, not at the next wait.
        run.go_on_until(run.rig.now());
    }

    /// Whether all written bytes have been sent.
    pub(crate) fn is_sent(&self, run: &Run) -> bool {
        let node = self.end.node;
        let link = run.rig.link(&self.end.link);
        let mut lines = link.iter().flat_map(|link| &link.lines);
        let line = lines.find(|line| line.from.node == node);
        let free_at = line.map_or(Instant::ZERO, |line| line.free_at());
        run.rig.backlog(node) == 0 && free_at <= run.rig.now()
    }
}

pub(crate) fn hung_up() -> io::Error {
    io::Error::new(ErrorKind::BrokenPipe, "the run is over")
}

pub(crate) fn end_of(run: &Run) -> Instant {
    let duration: Duration = run.scenario().duration.0;
    Instant::ZERO + duration
}

/// Runs to the next event, at most to `deadline`.
pub(crate) fn step(run: &mut Run, deadline: Instant) {
    let next = run.rig.next_event().unwrap_or(deadline);
    run.go_on_until(next.clamp(run.rig.now(), deadline.max(run.rig.now())));
}
