//! One round of a rig: lines deliver bytes that have arrived, nodes work, lines take the nodes'
//! bytes.

use protocols::{Instant, LineEvent};

use super::deadlines::LineSet;
use super::line::{Direction, End, MESSAGE_MAX, NEVER, PIECE_MAX};
use super::node::Body;
use super::trace::{Side, Tap as _};
use super::{LinkKind, Rig};

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
        let polls = self.nodes.iter().map(|node| node.polled_at);
        self.plan.polls.fill(self.nodes.len(), polls);
        let lines = || self.links.iter().flat_map(|link| &link.lines);
        let times = lines().map(|line| line.next_at(self.now));
        self.plan.lines_due.fill(2 * self.links.len(), times);
        let none = LineSet::with_room(2 * self.links.len());
        self.plan.asked = none.clone();
        self.plan.lines_from.clear();
        self.plan.lines_from.resize(self.nodes.len(), none);
        self.plan.senders.clear();
        for (number, line) in lines().enumerate() {
            self.plan.senders.push(line.from);
            self.plan.lines_from[line.from.node].insert(number);
            if !line.is_silent {
                self.plan.asked.insert(number);
            }
        }
    }

    /// Marks the node `index`, which may have bytes to send.
    #[inline]
    fn touch(&mut self, index: usize) {
        self.plan.asked.insert_all(&self.plan.lines_from[index]);
    }

    /// Plans the next poll of the node `index` after an event.
    #[inline]
    fn note_poll(&mut self, index: usize) {
        self.plan.polls.set(index, self.nodes[index].polled_at);
    }

    /// Plans the next time of a line after an event.
    #[inline]
    fn note_line(&mut self, link: usize, direction: Direction) {
        let due = self.links[link].lines[direction as usize].next_at(self.now);
        let number = 2 * link + direction as usize;
        self.plan.lines_due.set(number, due);
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
            let next = self.plan.polls.next().min(self.plan.lines_due.next());
            if next > self.now {
                return (next < NEVER).then_some(next);
            }
        }
        Some(self.now)
    }

    fn deliver(&mut self) {
        let mut from = 0;
        while let Some(number) = self.plan.lines_due.due_from(from, self.now) {
            self.plan.asked.insert(number);
            let (link, direction) = (number / 2, Direction::BOTH[number % 2]);
            self.deliver_on(link, direction);
            self.note_line(link, direction);
            from = number + 1;
        }
    }

    /// Delivers all bytes that have arrived on one line.
    fn deliver_on(&mut self, index: usize, direction: Direction) {
        let may_hear = !self.was_heard && direction == Direction::ToDevice;
        let may_hear =
            may_hear && !self.is_off(self.links[index].lines[direction as usize].to.node);
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
                self.was_heard |= may_hear;
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
        let to = line.to.node;
        self.note_poll(to);
    }

    fn poll(&mut self) {
        let mut from = 0;
        while let Some(index) = self.plan.polls.due_from(from, self.now) {
            from = index + 1;
            self.touch(index);
            let node = &mut self.nodes[index];
            node.poll(self.now, &mut self.world, self.cpu);
            self.plan.polls.set(index, node.polled_at);
            if let Body::Device(device) = &mut node.body {
                let events = device.take_events();
                if self.now < self.excused_until
                    && let Some(broken) = device.broken_rules()
                {
                    let total = broken.total();
                    let fresh = total - core::mem::replace(&mut node.excused_from, total);
                    self.excused += fresh;
                    self.excused_counts += fresh;
                }
                if !events.is_empty() {
                    let counts = device.broken_rules().is_some();
                    let is_kept = !device.logs().is_empty();
                    let name = node.name.clone();
                    for event in events {
                        self.log_from(&name, event, !counts, is_kept);
                    }
                }
            }
        }
    }

    /// Takes bytes from senders that may have some.
    fn take(&mut self) {
        let mut from = 0;
        while let Some(number) = self.next_sending(from) {
            from = number + 1;
            let (link, direction) = (number / 2, Direction::BOTH[number % 2]);
            self.ask(link, direction);
            self.note_line(link, direction);
        }
        // A node that is touched after its own line was polled is handled at its next poll.
        self.plan.asked.clear();
    }

    /// The first line from `from` on that is to be asked and whose sender may send. Most senders
    /// have no bytes, so they are passed in a loop of their own.
    fn next_sending(&mut self, mut from: usize) -> Option<usize> {
        let Self { nodes, plan, .. } = self;
        loop {
            let number = plan.asked.take_from(from)?;
            let End { node, port } = plan.senders[number];
            if nodes[node].may_send(port) {
                return Some(number);
            }
            debug_assert!(nodes[node].is_silent(port), "it said it was");
            from = number + 1;
        }
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
            self.note_poll(to.node);
            self.touch(to.node);
            for tap in &mut self.taps {
                tap.line_event(index, direction, self.now, event);
            }
        }
        let link = &mut self.links[index];
        let line = &mut link.lines[direction as usize];
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
            // A pin has a level, which is read without a rate.
            let receiver = match kind {
                LinkKind::Pin => sender_line,
                _ => self.nodes[to.node].line_config(to.port),
            };
            line.take(self.now, sender_line, receiver, budget, sent)
        };
        if let Some((at, bytes)) = line.take_echo() {
            let other = 1 - direction as usize;
            link.lines[other].receive(at, bytes);
            let due = link.lines[other].next_at(self.now);
            self.plan.lines_due.set(2 * index + other, due);
        }
        self.nodes[from.node].replan(self.now);
        self.trace.record(index, direction, Side::Sent, ends, sent);
        for tap in &mut self.taps {
            tap.record(index, direction, Side::Sent, ends, sent);
        }
        self.note_poll(from.node);
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::World;
    use emulators::{Device, Event};
    use protocols::{Instant, LineConfig, Port};

    use super::*;
    use crate::rig::bare;
    use crate::rig::fault::{Damage, Effect, FaultId, Strike, Window};
    use crate::rig::tests::probe::Probe;
    use crate::rig::tests::watched;

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

    /// A change announced at 10 ms for 20 ms has no effect before that time, and has the same
    /// result as a change known from the start. An immediate change wakes its device.
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

    /// A node that received an event is polled at once, then it rings at 20 ms; there are no events
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
    /// 33 links have 66 lines, more than the first 64. Each carries its byte.
    #[test]
    fn many_links_carry_as_one_does() {
        let mut rig = bare::rig();
        let ends: Vec<[usize; 2]> = (0..33)
            .map(|number| {
                let ends = [0, 1].map(|_| End {
                    node: rig.add_outside("end", LineConfig::new_8n1(9600)),
                    port: Port(0),
                });
                rig.connect(&format!("line-{number}"), ends[0], ends[1], 1);
                ends.map(|end| end.node)
            })
            .collect();
        for (byte, ends) in (0..).zip(&ends) {
            rig.inject(ends[0], &[byte]);
            rig.inject(ends[1], &[byte + 100]);
        }
        rig.run_until(Instant::from_millis(10));
        for (byte, ends) in (0..).zip(ends) {
            let received = ends.map(|end| rig.take_output(end).to_vec());
            assert_eq!(received, [vec![byte + 100], vec![byte]]);
        }
    }

    /// The second of two links echoes. The first byte comes back when it is sent, which takes 10
    /// bits of 9600 baud, and not with the next event.
    #[test]
    fn an_echo_of_the_second_link_arrives_in_time() {
        let (mut rig, [_, [device, master]]) = bare::linked(["quiet", "loud"], 9600);
        for direction in Direction::BOTH {
            let faults = &mut rig.line_mut(1, direction).faults;
            faults.add(FaultId(0), Window::ALWAYS.into(), Effect::Echo);
        }
        for (sender, byte) in [(master, 1), (device, 2)] {
            rig.inject(sender.node, &[byte]);
            rig.run_for(core::time::Duration::from_micros(1_042));
            let received = [device, master].map(|end| rig.take_output(end.node).to_vec());
            assert_eq!(received, [[byte], [byte]]);
        }
    }

    /// A byte to the master does not count as heard by a device.
    #[test]
    fn a_device_has_heard_what_was_sent_to_it() {
        let (mut rig, [[device, master]]) = bare::linked(["line"], 9600);
        let mut heard = |sender: End| {
            rig.inject(sender.node, &[1]);
            rig.run_for(core::time::Duration::from_millis(2));
            rig.was_heard()
        };
        assert_eq!(
            [heard(device), heard(master), heard(device)],
            [false, true, true]
        );
    }

    const fn at(us: u64) -> Instant {
        Instant::from_micros(us)
    }

    /// A device and an open end at 1 Mbaud, where a byte takes 10 us, joined by a link of `kind`.
    fn board(kind: LinkKind, piece: usize, probe: Probe) -> (Rig, usize) {
        let mut rig = bare::rig();
        let [board, port] = [
            rig.add_device("board", probe),
            rig.add_outside("port", LineConfig::new_8n1(1_000_000)),
        ]
        .map(|node| End {
            node,
            port: Port(0),
        });
        rig.connect_by(kind, "line", board, port, piece);
        (rig, port.node)
    }

    fn events(rig: &Rig) -> Vec<(u8, u64, LineEvent)> {
        let board = rig.device::<Probe>("board").expect("it is there");
        board.line_events.clone()
    }

    /// A character with a wrong parity bit is seen by observers and by its receiver.
    #[test]
    fn observers_see_a_parity_error() {
        let (mut rig, port) = board(LinkKind::Uart, 1, Probe::default());
        let notes = watched(&mut rig);
        let damage = Damage::ParityError;
        let strike = Strike { byte: 0, damage };
        rig.line_mut(0, Direction::ToDevice)
            .faults
            .add_strike(strike);
        rig.inject(port, &[7]);
        rig.run_until(at(10));
        let expected = [
            "0 to-device Sent 10 [7]",
            "0 to-device arrived 10 []",
            "0 to-device ParityError 10",
            "reached 10",
        ];
        assert_eq!(notes.take(), expected);
        assert_eq!(events(&rig), [(0, 10, LineEvent::ParityError)]);
        let board = rig.device::<Probe>("board").expect("it is there");
        assert_eq!(
            (board.polls.as_slice(), rig.was_heard()),
            (&[0, 10][..], false)
        );
    }

    /// Zero at 100 kbaud is low for 90 us, longer than a character at 1 Mbaud. The receiver gets
    /// the error; observers, which know the rates, get none.
    #[test]
    fn observers_see_no_framing_error() {
        let (mut rig, port) = board(LinkKind::Uart, 1, Probe::default());
        let notes = watched(&mut rig);
        rig.set_line_config(port, LineConfig::new_8n1(100_000));
        rig.inject(port, &[0]);
        rig.run_until(Instant::from_millis(1));
        let seen = events(&rig);
        assert!(!seen.is_empty());
        assert!(seen.iter().all(|event| event.2 == LineEvent::FramingError));
        let notes = notes.take();
        assert!(
            notes.iter().all(|line| !line.contains("FramingError")),
            "{notes:?}"
        );
    }

    /// A pin has a level and no rate: its value arrives at any rate of the receiver.
    #[test]
    fn a_pin_is_read_without_a_rate() {
        let received = |kind| {
            let (mut rig, port) = board(kind, 1, Probe::default());
            rig.set_line_config(port, LineConfig::new_8n1(300_000));
            rig.inject(port, &[0x55]);
            rig.run_until(Instant::from_millis(1));
            let board = rig.device::<Probe>("board").expect("it is there");
            let bytes = board.received.iter().flat_map(|(.., bytes)| bytes.clone());
            bytes.collect::<Vec<u8>>()
        };
        assert_eq!(received(LinkKind::Pin), [0x55]);
        assert_ne!(received(LinkKind::Uart), [0x55]);
    }

    /// A capture takes the place of the sender: the change of the sender's end is no part of it.
    #[test]
    fn a_played_line_carries_no_change_of_its_sender() {
        let seen = |is_played| {
            let (mut rig, port) = board(LinkKind::Uart, 1, Probe::default());
            let notes = watched(&mut rig);
            rig.line_mut(0, Direction::ToDevice).is_played = is_played;
            rig.change_line(port, LineEvent::Opened);
            rig.run_until(at(0));
            (notes.take().len(), events(&rig).len())
        };
        assert_eq!(seen(true), (1, 0));
        assert_eq!(seen(false), (2, 1));
    }

    /// A piece has as many bytes as the link says, but at most 64. Then the line is free for the
    /// next one.
    #[test]
    fn a_sender_is_asked_for_pieces_of_64_bytes_at_most() {
        let sent = |piece| {
            let probe = Probe {
                to_send: [7; 100].into(),
                ..Probe::default()
            };
            let (mut rig, port) = board(LinkKind::Uart, piece, probe);
            let times = [at(30), at(640), at(1_000)];
            times.map(|time| {
                rig.run_until(time);
                rig.output_len(port)
            })
        };
        assert_eq!(sent(3), [3, 63, 100]);
        assert_eq!(sent(64), [0, 64, 100]);
        assert_eq!(sent(65), [0, 64, 100]);
    }

    /// From 5 to 100 us the device does not read; two bytes then reach it at once.
    #[test]
    fn bytes_that_arrive_together_are_heard() {
        let (mut rig, port) = board(LinkKind::Uart, 1, Probe::default());
        let window = Window {
            from: at(5),
            until: at(100),
        };
        let faults = &mut rig.line_mut(0, Direction::ToDevice).faults;
        faults.add(FaultId(0), window.into(), Effect::Stall);
        rig.inject(port, &[1, 2]);
        rig.run_until(at(99));
        assert!(!rig.was_heard());
        rig.run_until(at(100));
        assert!(rig.was_heard());
        let board = rig.device::<Probe>("board").expect("it is there");
        assert_eq!(board.received, [(0, 100, vec![1]), (0, 100, vec![2])]);
        assert_eq!(board.polls, [0, 100]);
    }

    /// The line is free again at 10 us and asks for more; the byte arrives 5 us later. Then nothing
    /// comes.
    #[test]
    fn the_next_event_is_the_earliest_of_lines_and_nodes() {
        let probe = Probe {
            wakes_at: Some(at(12)),
            ..Probe::default()
        };
        let (mut rig, port) = board(LinkKind::Uart, 1, probe);
        rig.line_mut(0, Direction::ToDevice).latency = core::time::Duration::from_micros(5);
        rig.inject(port, &[1]);
        let mut seen = vec![rig.next_event()];
        for us in [0, 10, 12, 15] {
            rig.run_until(at(us));
            seen.push(rig.next_event());
        }
        assert_eq!(
            seen,
            [Some(at(0)), Some(at(10)), Some(at(12)), Some(at(15)), None]
        );
    }

    /// The bytes of the third of three links arrive 5 ms late; their echo does not. It is back when
    /// its byte is sent, after 10 us, although nothing else happens at its end then.
    #[test]
    fn an_echo_does_not_wait_for_its_late_byte() {
        for side in [0, 1] {
            let names = ["one", "two", "three"];
            let (mut rig, [.., ends]) = bare::linked(names, 1_000_000);
            for direction in Direction::BOTH {
                let line = rig.line_mut(2, direction);
                line.faults
                    .add(FaultId(0), Window::ALWAYS.into(), Effect::Echo);
                line.latency = core::time::Duration::from_millis(5);
            }
            // Both ends of all links have been asked once, and have nothing to send.
            rig.run_until(at(0));
            rig.inject(ends[side].node, &[1]);
            rig.run_until(at(10));
            assert_eq!(rig.take_output(ends[side].node).to_vec(), [1]);
            assert_eq!(rig.output_len(ends[1 - side].node), 0);
        }
    }

    /// At 5 us a device gets the order to send a byte at 20 us. Until then the line does not ask
    /// for it, also if another run begins before.
    #[test]
    fn bytes_that_are_planned_leave_at_their_time() {
        let (mut rig, port) = board(LinkKind::Uart, 1, Probe::default());
        rig.run_until(at(5));
        let probe = rig.device_to_plan::<Probe>("board").expect("it is there");
        probe.to_send.push_back(7);
        probe.wakes_at = Some(at(20));
        let arrived = [at(15), at(29), at(30)].map(|time| {
            rig.run_until(time);
            rig.output_len(port)
        });
        assert_eq!(arrived, [0, 0, 1]);
    }
}
