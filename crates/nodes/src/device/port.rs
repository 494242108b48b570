//! The output of a node program until the line accepts it.

use std::collections::VecDeque;

use protocols::{Instant, LineConfig, LineEvent};

use crate::spec::NodePort;

/// A port with its output.
#[derive(Clone)]
pub(super) struct PortState {
    pub(super) line: LineConfig,
    carries_messages: bool,
    /// Output in order of time.
    out: VecDeque<(Instant, Out)>,
    /// Number of bytes in `out`.
    pub(super) waiting: usize,
}

/// A piece of output.
#[derive(Clone)]
pub(super) enum Out {
    Bytes(VecDeque<u8>),
    Line(LineEvent),
    Coding(LineConfig),
}

impl PortState {
    /// A port with the settings of the scenario.
    pub(super) fn new(port: &NodePort) -> Self {
        Self {
            line: port.line,
            carries_messages: port.carries_messages,
            out: VecDeque::new(),
            waiting: 0,
        }
    }

    /// Discards the output.
    pub(super) fn clear(&mut self) {
        self.out.clear();
        self.waiting = 0;
    }

    /// Whether output is due at `now`.
    pub(super) fn is_due(&self, now: Instant) -> bool {
        self.due(now).is_some()
    }

    /// The line event or coding before the next bytes.
    pub(super) fn line_change(&mut self, now: Instant) -> Option<LineEvent> {
        loop {
            match self.due(now)? {
                Out::Bytes(_) => return None,
                Out::Coding(line) => self.line = *line,
                Out::Line(event) => {
                    let event = *event;
                    self.out.pop_front();
                    return Some(event);
                }
            }
            self.out.pop_front();
        }
    }

    pub(super) fn put(&mut self, at: Instant, out: Out) {
        if let Out::Bytes(bytes) = &out {
            if bytes.is_empty() {
                return;
            }
            self.waiting += bytes.len();
        }
        let place = self.out.partition_point(|(other, _)| *other <= at);
        self.out.insert(place, (at, out));
    }

    /// The first piece of output, if it is due.
    fn due(&self, now: Instant) -> Option<&Out> {
        let (_, out) = self.out.front().filter(|(at, _)| *at <= now)?;
        Some(out)
    }

    pub(super) fn transmit(&mut self, now: Instant, buf: &mut [u8]) -> usize {
        let mut len = 0;
        while len < buf.len()
            && let Some((at, Out::Bytes(bytes))) = self.out.front_mut()
            && *at <= now
        {
            len += emulators::device::take(bytes, &mut buf[len..]);
            // A message that does not fit is lost beyond the available space.
            if bytes.is_empty() || self.carries_messages {
                self.waiting -= bytes.len();
                self.out.pop_front();
            }
            if self.carries_messages {
                break;
            }
        }
        self.waiting -= len;
        len
    }

    /// Time at which the next output becomes due; at once if the first piece is not bytes.
    pub(super) fn poll_at(&self, now: Instant) -> Option<Instant> {
        match self.out.front() {
            Some((at, Out::Bytes(_))) => Some(*at).filter(|at| *at > now),
            Some((at, _)) => Some(*at),
            None => None,
        }
    }
}
