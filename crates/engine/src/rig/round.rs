//! One round of a rig: lines deliver arrived bytes, nodes work, lines take the nodes' bytes.

use protocols::{Instant, LineEvent};

use super::line::{Direction, End, MESSAGE_MAX, NEVER, PIECE_MAX};
use super::node::Body;
use super::trace::{Side, Tap as _};
use super::{LinkKind, Rig};

/// Due times of a line. Stored apart from the lines, because all of them are checked between any
/// two events.
#[derive(Clone, Copy, Debug)]
pub(super) struct Due {
    /// Time of its next delivery, or of more bytes from a sender that had more.
    at: Instant,
    /// The sender.
    from: End,
    /// Whether the sender is asked in this round, even without an event for it.
    asks: bool,
}

const ROUNDS_MAX: usize = 1000;

impl Rig {
    /// Time of the next event without further input.
    pub fn next_event(&self) -> Option<Instant> {
        let lines = self.links.iter().flat_map(|link| &link.lines);
        let lines = lines.map(|line| line.next_at(self.now));
        let next = lines.fold(self.next_poll(), Instant::min);
        (next < NEVER).then_some(next)
    }

    /// Time of the next poll of a node.
    fn next_poll(&self) -> Instant {
        let polls = self.nodes.iter().map(|node| node.polled_at);
        polls.fold(NEVER, Instant::min).max(self.now)
    }

    /// Plans all lines and devices again, after any change from outside.
    pub(super) fn foresee(&mut self) {
        for node in &mut self.nodes {
            node.replan(self.now);
        }
        let lines = self.links.iter().flat_map(|link| &link.lines);
        self.due.clear();
        self.due.extend(lines.map(|line| Due {
            at: line.next_at(self.now),
            from: line.from,
            asks: !line.is_silent,
        }));
    }

    /// Does all work due now, until nothing changes any more; returns the time of the next event
    /// without further input.
    pub(super) fn settle(&mut self) -> Option<Instant> {
        self.world.advance(self.now);
        // A further round needs a byte that takes no time, or a node that another one stirred; the
        // bound only guards against a broken device.
        for _ in 0..ROUNDS_MAX {
            self.deliver();
            self.poll();
            self.take();
            let mut next = self.next_poll();
            for due in &self.due {
                next = next.min(due.at);
            }
            if next > self.now {
                return (next < NEVER).then_some(next);
            }
        }
        Some(self.now)
    }

    fn deliver(&mut self) {
        let (now, mut number) = (self.now, 0);
        while let Some(ahead) = self.due[number..].iter().position(|due| due.at <= now) {
            number += ahead;
            self.due[number].asks = true;
            self.deliver_on(number / 2, Direction::BOTH[number % 2]);
            number += 1;
        }
    }

    /// Delivers all that has arrived on one line.
    fn deliver_on(&mut self, index: usize, direction: Direction) {
        let line = &mut self.links[index].lines[direction as usize];
        let node = &mut self.nodes[line.to.node];
        while let Some(delivery) = line.deliver(self.now) {
            for tap in &mut self.taps {
                tap.arrived(index, direction, &delivery);
            }
            if let Some(event) = delivery.event {
                node.line_event(line.to.port, delivery.at, event);
                if event != LineEvent::FramingError {
                    for tap in &mut self.taps {
                        tap.line_event(index, direction, delivery.at, event);
                    }
                }
            }
            node.mark(&delivery.marks);
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

    fn poll(&mut self) {
        for index in 0..self.nodes.len() {
            let node = &mut self.nodes[index];
            if !node.is_due(self.now) {
                continue;
            }
            node.poll(self.now, &mut self.world, self.cpu);
            self.touched[index] = true;
            if let Body::Device(device) = &mut node.body {
                let events = device.take_events();
                let counts = device.broken_rules().is_some();
                if self.now < self.excused_until
                    && let Some(broken) = device.broken_rules()
                {
                    let total = broken.total();
                    let fresh = total - core::mem::replace(&mut node.excused_from, total);
                    self.excused += fresh;
                    self.excused_counts += fresh;
                }
                if !events.is_empty() {
                    let name = node.name.clone();
                    let events = events.into_iter();
                    events.for_each(|event| self.log_from(&name, event, !counts));
                }
            }
        }
    }

    /// Takes bytes from senders that may have some.
    fn take(&mut self) {
        let mut number = 0;
        loop {
            let touched = &self.touched[..];
            let asks = |due: &Due| due.asks || touched[due.from.node];
            let Some(ahead) = self.due[number..].iter().position(asks) else {
                break;
            };
            number += ahead;
            let due = &mut self.due[number];
            let was_due = core::mem::take(&mut due.asks);
            let may_send = self.nodes[due.from.node].may_send(due.from.port);
            let (link, direction) = (number / 2, Direction::BOTH[number % 2]);
            if may_send {
                self.ask(link, direction);
            } else {
                let End { node, port } = due.from;
                debug_assert!(self.nodes[node].is_silent(port), "it said it was");
            }
            if may_send || was_due {
                let [one, other] = &self.links[link].lines;
                self.due[2 * link].at = one.next_at(self.now);
                self.due[2 * link + 1].at = other.next_at(self.now);
            }
            number += 1;
        }
        self.touched.fill(false);
    }

    /// Polls the sender of one line.
    fn ask(&mut self, index: usize, direction: Direction) {
        let link = &mut self.links[index];
        let (kind, line) = (link.kind, &mut link.lines[direction as usize]);
        let (from, to) = (line.from, line.to);
        if let Some(event) = self.nodes[from.node].line_change(from.port)
            && !line.is_played
        {
            self.nodes[to.node].line_event(to.port, self.now, event);
            self.touched[to.node] = true;
            for tap in &mut self.taps {
                tap.line_event(index, direction, self.now, event);
            }
        }
        if !line.has_room(self.now) {
            return;
        }
        let sender = &mut self.nodes[from.node];
        let sender_line = sender.line_config(from.port);
        let room = match kind.carries_messages() {
            true => MESSAGE_MAX,
            false => line.piece.min(PIECE_MAX),
        };
        let len = sender.transmit(from.port, &mut self.room[..room]);
        line.is_silent = len == 0;
        if line.is_silent {
            return;
        }
        let sent = &self.room[..len];
        let budget = &mut self.budget;
        let ends = if kind.carries_messages() {
            line.take_message(kind, self.now, sender_line, budget, sent)
        } else {
            // A level has no rate that its receiver could read at.
            let receiver = match kind {
                LinkKind::Pin => sender_line,
                _ => self.nodes[to.node].line_config(to.port),
            };
            line.take(self.now, sender_line, receiver, budget, sent)
        };
        if let Some((at, bytes)) = line.take_echo() {
            link.lines[1 - direction as usize].receive(at, bytes);
        }
        self.nodes[from.node].replan(self.now);
        self.trace.record(index, direction, Side::Sent, ends, sent);
        for tap in &mut self.taps {
            tap.record(index, direction, Side::Sent, ends, sent);
        }
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::World;
    use emulators::{Device, Event};
    use protocols::{Instant, LineConfig, Port};

    use super::*;
    use crate::rig::bare;

    /// A device with one poll, which stores its time.
    #[derive(Clone, Default)]
    struct Clockwork {
        rings_at: Option<Instant>,
        polls: Vec<Instant>,
    }

    impl Device for Clockwork {
        fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

        fn poll(&mut self, now: Instant, _: &mut World) {
            self.polls.push(now);
        }

        fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
            0
        }

        fn poll_at(&self) -> Option<Instant> {
            let is_to_come = |at: &Instant| self.polls.last().is_none_or(|last| last < at);
            self.rings_at.filter(is_to_come)
        }

        fn line_config(&self, _: Port) -> LineConfig {
            LineConfig::new_8n1(9600)
        }

        fn take_events(&mut self) -> Vec<Event> {
            Vec::new()
        }
    }

    /// A rig that contains only such a clock, at 10 ms.
    fn rig() -> Rig {
        let mut rig = bare::rig();
        rig.add_device("clock", Clockwork::default());
        rig.run_until(Instant::from_millis(10));
        rig
    }

    fn ring(clock: Option<&mut Clockwork>) {
        clock.expect("it is there").rings_at = Some(Instant::from_millis(20));
    }

    /// A change announced at 10 ms for 20 ms has no effect before that, and has the same result as
    /// one that was known from the start. A change with immediate effect wakes its device.
    #[test]
    fn what_is_planned_later_wakes_nobody_now() {
        let polls = |tell: &dyn Fn(&mut Rig)| {
            let mut rig = rig();
            tell(&mut rig);
            rig.run_until(Instant::from_millis(30));
            let clock = rig.device::<Clockwork>("clock").expect("it is there");
            let millis = clock.polls.iter().map(|at| at.as_millis());
            millis.collect::<Vec<u64>>()
        };
        assert_eq!(polls(&|_| {}), [0]);
        assert_eq!(polls(&|rig| ring(rig.device_to_plan("clock"))), [0, 20]);
        assert_eq!(polls(&|rig| ring(rig.device_mut("clock"))), [0, 10, 20]);
    }

    /// A node that received an event is asked at once, then it rings at 20 ms; there are no events
    /// after that.
    #[test]
    fn where_nobody_waits_for_anything_nothing_comes_next() {
        let mut rig = rig();
        assert_eq!(rig.next_event(), None);
        ring(rig.device_mut("clock"));
        let millis = Instant::from_millis;
        assert_eq!(rig.next_event(), Some(millis(10)));
        rig.run_until(millis(15));
        assert_eq!(rig.next_event(), Some(millis(20)));
        rig.run_until(millis(30));
        assert_eq!(rig.next_event(), None);
    }
}
