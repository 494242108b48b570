//! What a node program sends, until the line takes it.

use std::collections::VecDeque;

use protocols::{Instant, LineConfig, LineEvent};

use crate::spec::NodePort;

/// A port, and what it is to send.
#[derive(Clone)]
pub(super) struct PortState {
    pub(super) line: LineConfig,
    carries_messages: bool,
    /// In the order of their times.
    out: VecDeque<(Instant, Out)>,
    /// Bytes in `out`.
    pub(super) waiting: usize,
}

/// Something that a port is to send.
#[derive(Clone)]
pub(super) enum Out {
    Bytes(VecDeque<u8>),
    Line(LineEvent),
    Coding(LineConfig),
}

impl PortState {
    /// The port as the scenario has it.
    pub(super) fn new(port: &NodePort) -> Self {
        Self {
            line: port.line,
            carries_messages: port.carries_messages,
            out: VecDeque::new(),
            waiting: 0,
        }
    }

    /// Forgets what it was to send.
    pub(super) fn clear(&mut self) {
        self.out.clear();
        self.waiting = 0;
    }

    /// Whether it has something to send at `now`.
    pub(super) fn is_due(&self, now: Instant) -> bool {
        self.due(now).is_some()
    }

    /// What the far end is told before the next bytes.
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

    /// What is first, if its time has come.
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
            // A message for which there is no room is lost with its end.
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

    /// When something becomes due that is not yet; at once if something waits that is no bytes.
    pub(super) fn poll_at(&self, now: Instant) -> Option<Instant> {
        match self.out.front() {
            Some((at, Out::Bytes(_))) => Some(*at).filter(|at| *at > now),
            Some((at, _)) => Some(*at),
            None => None,
        }
    }
}
