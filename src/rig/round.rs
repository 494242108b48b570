//! One round of a rig: what has arrived is delivered, nodes do their work, lines take what they
//! send.

use protocols::{Instant, LineEvent};

use super::line::{Direction, MESSAGE_MAX, PIECE_MAX};
use super::node::Body;
use super::trace::{Side, Tap as _};
use super::{LinkKind, Rig};

const ROUNDS_MAX: usize = 1000;

impl Rig {
    /// Does all that is due now, until nothing changes any more; when something will next happen by
    /// itself.
    pub(super) fn settle(&mut self) -> Option<Instant> {
        self.world.advance(self.now);
        // A further round needs a byte that takes no time, or a node that another one stirred; the
        // bound only guards against a broken device.
        for _ in 0..ROUNDS_MAX {
            self.deliver();
            self.poll();
            self.take();
            let next = self.next_event();
            if next.is_none_or(|at| at > self.now) {
                return next;
            }
        }
        Some(self.now)
    }

    fn deliver(&mut self) {
        for (index, link) in self.links.iter_mut().enumerate() {
            for direction in [Direction::ToMaster, Direction::ToDevice] {
                let line = &mut link.lines[direction as usize];
                if !line.is_due(self.now) {
                    continue;
                }
                while let Some(delivery) = line.deliver(self.now) {
                    for tap in &mut self.taps {
                        tap.arrived(index, direction, &delivery);
                    }
                    let node = &mut self.nodes[line.to.node];
                    if let Some(event) = delivery.event {
                        node.line_event(line.to.port, delivery.at, event);
                        if event != LineEvent::FramingError {
                            for tap in &mut self.taps {
                                tap.line_event(index, direction, delivery.at, event);
                            }
                        }
                    }
                    if !delivery.bytes.is_empty() {
                        let bytes = &delivery.bytes;
                        self.trace
                            .record(index, direction, Side::Received, delivery.at, bytes);
                        for tap in &mut self.taps {
                            tap.record(index, direction, Side::Received, delivery.at, bytes);
                        }
                        node.receive(line.to.port, delivery.at, bytes);
                    }
                    line.recycle(delivery.bytes);
                }
            }
        }
    }

    fn poll(&mut self) {
        for index in 0..self.nodes.len() {
            let node = &mut self.nodes[index];
            if !node.is_due(self.now) {
                continue;
            }
            node.poll(self.now, &mut self.world, self.cpu);
            if let Body::Device(device) = &mut node.body {
                let events = device.take_events();
                if !events.is_empty() {
                    let name = node.name.clone();
                    events.into_iter().for_each(|event| self.log(&name, event));
                }
            }
        }
    }

    fn take(&mut self) {
        for (index, link) in self.links.iter_mut().enumerate() {
            let kind = link.kind;
            for direction in [Direction::ToMaster, Direction::ToDevice] {
                let line = &mut link.lines[direction as usize];
                let epoch = self.nodes[line.from.node].epoch;
                if line.silent_since == Some(epoch) {
                    continue;
                }
                if let Some(event) = self.nodes[line.from.node].line_change(line.from.port)
                    && !line.is_played
                {
                    self.nodes[line.to.node].line_event(line.to.port, self.now, event);
                    for tap in &mut self.taps {
                        tap.line_event(index, direction, self.now, event);
                    }
                }
                if !line.has_room(self.now) {
                    continue;
                }
                let (port, to) = (line.from.port, line.to);
                let sender = self.nodes[line.from.node].line_config(port);
                let room = match kind.carries_messages() {
                    true => MESSAGE_MAX,
                    false => line.piece.min(PIECE_MAX),
                };
                let len = self.nodes[line.from.node].transmit(port, &mut self.room[..room]);
                if len == 0 {
                    line.silent_since = Some(epoch);
                    continue;
                }
                line.silent_since = None;
                let sent = &self.room[..len];
                let budget = &mut self.budget;
                let ends = if kind.carries_messages() {
                    line.take_message(kind, self.now, sender, budget, sent)
                } else {
                    // A level has no rate that its receiver could read at.
                    let receiver = match kind {
                        LinkKind::Pin => sender,
                        _ => self.nodes[to.node].line_config(to.port),
                    };
                    line.take(self.now, sender, receiver, budget, sent)
                };
                if let Some((at, bytes)) = line.take_echo() {
                    link.lines[1 - direction as usize].receive(at, bytes);
                }
                let from = link.lines[direction as usize].from.node;
                self.nodes[from].after_transmit(self.now);
                self.trace.record(index, direction, Side::Sent, ends, sent);
                for tap in &mut self.taps {
                    tap.record(index, direction, Side::Sent, ends, sent);
                }
            }
        }
    }
}
