//! The state of a port, which all its handles share.

use core::time::Duration;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read as _};

use bytes::Bytes;
use engine::rig::LinkKind;
use engine::robots::OpenEnd;
use engine::run::Run;
use protocols::{Instant, LineConfig};

/// Bytes written that may wait for the line before a write waits too, as in a UART's driver.
const BACKLOG_MAX: usize = 4096;

/// A port of the rig.
#[derive(Debug)]
pub(crate) struct PortState {
    pub(crate) end: OpenEnd,
    pub(crate) kind: LinkKind,
    /// Baud rate and format of the program's end.
    pub(crate) line: LineConfig,
    received: VecDeque<u8>,
    messages: VecDeque<Bytes>,
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
        }
    }

    /// Takes the arrived bytes; whether there are any.
    pub(crate) fn collect(&mut self, run: &mut Run) -> bool {
        let (rig, node) = (&mut run.rig, self.end.node);
        match self.kind.carries_messages() {
            true => self.messages.extend(rig.take_messages(node)),
            false => self.received.extend(rig.take_output(node)),
        }
        self.len() > 0
    }

    /// Bytes that can be read now; of the next message, if it carries messages.
    pub(crate) fn len(&self) -> usize {
        let message = self.messages.front().map(Bytes::len);
        message.unwrap_or(self.received.len())
    }

    /// Moves the available bytes into `buf`. What does not fit of a message is lost.
    pub(crate) fn take(&mut self, buf: &mut [u8]) -> usize {
        let Some(message) = self.messages.pop_front() else {
            return self.received.read(buf).unwrap_or(0);
        };
        let len = message.len().min(buf.len());
        buf[..len].copy_from_slice(&message[..len]);
        len
    }

    /// Takes the next message.
    #[cfg(feature = "embedded")]
    pub(crate) fn take_message(&mut self) -> Option<Bytes> {
        self.messages.pop_front()
    }

    /// Discards what arrived.
    #[cfg(any(feature = "embedded", feature = "serialport"))]
    pub(crate) fn clear(&mut self, run: &mut Run) {
        self.collect(run);
        self.received.clear();
        self.messages.clear();
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

    /// Writes bytes, for which there is room, or one message.
    pub(crate) fn put(&self, run: &mut Run, bytes: &[u8]) {
        run.rig.inject(self.end.node, bytes);
        // The line takes the first byte now, not at the next wait.
        run.go_on_until(run.rig.now());
    }

    /// Whether all that was written has left.
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
