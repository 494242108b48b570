//! The participants of a rig: devices, the program under test, and ends that are served from
//! outside.

use core::any::Any;
use core::time::Duration;
use std::collections::VecDeque;

use bytes::{Buf as _, Bytes, BytesMut};
use emulators::world::World;
use emulators::{BrokenRules, Device};
use firmware_core::{Inspect, Master};
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::rig::cpu::CpuModel;
use crate::rig::line::{MESSAGE_MAX, Mark, MarkDamage, NEVER};

/// An emulated device in a rig: any [`Device`] that owns its data and can be cloned, so that a rig
/// can continue from one state in several ways.
pub trait AnyDevice: Device + Any + Send {
    /// Clones the device with its state. Changes of one do not affect the other.
    fn clone_device(&self) -> Box<dyn AnyDevice>;
}

impl<T: Device + Any + Clone + Send> AnyDevice for T {
    fn clone_device(&self) -> Box<dyn AnyDevice> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn AnyDevice> {
    fn clone(&self) -> Self {
        self.as_ref().clone_device()
    }
}

/// A robot's program in a rig: any [`Master`] that can be checked and cloned.
pub trait Program: Master + Inspect + Any + Send {
    /// Clones the program with its state.
    fn clone_program(&self) -> Box<dyn Program>;
}

impl<T: Master + Inspect + Any + Clone + Send> Program for T {
    fn clone_program(&self) -> Box<dyn Program> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn Program> {
    fn clone(&self) -> Self {
        self.as_ref().clone_program()
    }
}

/// The end of a link whose other side is outside the rig: a pseudo-terminal, a serial port, a test.
#[derive(Clone, Debug)]
pub(super) struct Outside {
    pub(super) line: LineConfig,
    pub(super) to_rig: BytesMut,
    pub(super) from_rig: BytesMut,
    pub(super) change: Option<LineEvent>,
    /// Damaged characters that arrived, with their positions in `from_rig`.
    pub(super) marks: Vec<Mark>,
    /// Number of faults that keep the plug out, and the port's name when it comes back.
    pub(super) unplugged: (u32, Option<String>),
    /// Input and control modes of the client's terminal, if known.
    pub(super) modes: Option<[u32; 2]>,
    /// The last received byte.
    pub(super) last: Option<u8>,
    /// Whether sending is stopped.
    is_held: bool,
    /// Modem lines set by hand at this end.
    pub(super) forced: [Option<bool>; 4],
    /// Lengths of the messages in `to_rig` and `from_rig`, if its link carries messages.
    messages: Option<[VecDeque<usize>; 2]>,
}

/// Maximum number of bytes that wait for an outside reader, as in a UART's driver. Further bytes
/// are lost.
const OUTSIDE_MAX: usize = 4096;

impl Outside {
    pub(super) fn new(line: LineConfig) -> Self {
        Self {
            line,
            to_rig: BytesMut::new(),
            from_rig: BytesMut::new(),
            change: None,
            marks: Vec::new(),
            unplugged: (0, None),
            modes: None,
            last: None,
            is_held: false,
            forced: [None; 4],
            messages: None,
        }
    }

    /// Switches to whole messages, in both directions.
    pub(super) fn carry_messages(&mut self) {
        self.messages.get_or_insert_default();
    }

    /// Takes bytes that its owner writes. A message that is too long is lost.
    pub(super) fn put(&mut self, bytes: &[u8]) {
        if let Some([to_rig, _]) = &mut self.messages {
            if bytes.is_empty() || bytes.len() > MESSAGE_MAX {
                return;
            }
            to_rig.push_back(bytes.len());
        }
        self.to_rig.extend_from_slice(bytes);
    }

    /// Stops or continues sending; returns whether this is a change.
    pub(super) const fn hold(&mut self, is_held: bool) -> bool {
        core::mem::replace(&mut self.is_held, is_held) != is_held
    }

    /// Takes bytes that arrive from the rig; a message without room is lost as a whole.
    fn receive(&mut self, bytes: &[u8]) {
        self.last = bytes.last().copied().or(self.last);
        let mut room = OUTSIDE_MAX - self.from_rig.len();
        if let Some([_, from_rig]) = &mut self.messages {
            if bytes.len() > room {
                room = 0;
            } else {
                from_rig.push_back(bytes.len());
            }
        }
        let taken = bytes.len().min(room);
        self.from_rig.extend_from_slice(&bytes[..taken]);
    }

    /// Takes marks of damaged bytes from the rig, before the bytes that come with them.
    fn mark(&mut self, marks: &[Mark]) {
        let arrived = self.from_rig.len();
        let room = OUTSIDE_MAX.saturating_sub(self.marks.len());
        let marks = marks.iter().take(room).map(|mark| Mark {
            before: arrived + mark.before,
            ..*mark
        });
        self.marks.extend(marks);
    }

    /// Discards the bytes of the owner that the rig has not taken yet.
    pub(super) fn discard(&mut self) {
        self.to_rig.clear();
        if let Some([to_rig, _]) = &mut self.messages {
            to_rig.clear();
        }
    }

    /// Pulls the plug, or plugs it in again; then the owner's port is called `back_as`. Earlier
    /// bytes of the owner are lost.
    pub(super) fn plug(&mut self, is_out: bool, back_as: Option<&str>) {
        self.discard();
        let (depth, name) = &mut self.unplugged;
        *depth = match is_out {
            true => *depth + 1,
            false => depth.saturating_sub(1),
        };
        *name = back_as.map(str::to_owned);
    }

    /// Moves the bytes that the node can send now into `buf`; returns how many.
    fn transmit(&mut self, buf: &mut [u8]) -> usize {
        let len = match &mut self.messages {
            _ if self.is_held => 0,
            Some([to_rig, _]) => to_rig.pop_front().unwrap_or(0).min(buf.len()),
            None => buf.len().min(self.to_rig.len()),
        };
        self.to_rig.split_to(len).copy_to_slice(&mut buf[..len]);
        len
    }

    /// Takes the messages that arrived.
    pub(super) fn take_messages(&mut self) -> Vec<Bytes> {
        let Some([_, from_rig]) = &mut self.messages else {
            return Vec::new();
        };
        let lens = from_rig.drain(..);
        lens.map(|len| self.from_rig.split_to(len).freeze())
            .collect()
    }
}

/// A participant of the rig.
#[derive(Clone)]
pub(super) enum Body {
    Device(Box<dyn AnyDevice>),
    Program {
        program: Box<dyn Program>,
        busy_until: Instant,
        /// Duration of the last work that took time.
        last_cost: Duration,
        /// Number of polls in a row after which the program requested a past time.
        hasty: u32,
    },
    /// On the heap, so that a node is small and its kind is read at once.
    Outside(Box<Outside>),
}

#[derive(Clone)]
pub(super) struct Node {
    pub(super) name: String,
    pub(super) body: Body,
    /// Time of the next poll, or [`AT_ONCE`]. Stored, so that the node is not asked each time.
    pub(super) polled_at: Instant,
    /// Number of broken rules of its device that do not count against a client.
    pub(super) excused_from: u64,
}

/// Poll time of a node that received something since its last poll.
pub(super) const AT_ONCE: Instant = Instant::ZERO;

impl Node {
    pub(super) fn line_config(&self, port: Port) -> LineConfig {
        match &self.body {
            Body::Device(device) => device.line_config(port),
            Body::Program { program, .. } => program.line_config(port),
            Body::Outside(outside) => outside.line,
        }
    }

    /// Number of violations of each rule by its master, if the device counts them.
    pub(super) fn broken_rules(&self) -> Option<&BrokenRules> {
        match &self.body {
            Body::Device(device) => device.broken_rules(),
            Body::Program { .. } | Body::Outside(_) => None,
        }
    }

    /// See [`Device::unframed`].
    pub(super) fn unframed(&self) -> u64 {
        match &self.body {
            Body::Device(device) => device.unframed(),
            Body::Program { .. } | Body::Outside(_) => 0,
        }
    }

    /// The logs of its device that keep each moment.
    pub(super) fn logs(&self) -> Vec<&BrokenRules> {
        match &self.body {
            Body::Device(device) => device.logs(),
            Body::Program { .. } | Body::Outside(_) => Vec::new(),
        }
    }

    /// Records the current number of broken rules. Later ones may be excused.
    pub(super) fn note_breaks(&mut self) {
        self.excused_from = self.broken_rules().map_or(0, BrokenRules::total);
    }

    /// The device of this node, if it is a `T`.
    pub(super) fn device_mut<T: Any>(&mut self) -> Option<&mut T> {
        let Body::Device(device) = &mut self.body else {
            return None;
        };
        let device: &mut dyn Any = device.as_mut();
        device.downcast_mut()
    }

    /// Marks the node after an event: it is polled next, and asked for bytes to send.
    pub(super) fn stir(&mut self) {
        self.polled_at = AT_ONCE;
    }

    pub(super) fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        self.stir();
        match &mut self.body {
            Body::Device(device) => device.receive(port, now, bytes),
            Body::Program { program, .. } => program.receive(port, now, bytes),
            Body::Outside(outside) => outside.receive(bytes),
        }
    }

    /// Marks the node for damaged characters, which precede the bytes that arrive with them.
    pub(super) fn mark(&mut self, marks: &[Mark]) {
        if let Body::Outside(outside) = &mut self.body
            && !marks.is_empty()
        {
            outside.mark(marks);
            self.stir();
        }
    }

    pub(super) fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        self.stir();
        match &mut self.body {
            Body::Device(device) => device.line_event(port, now, event),
            Body::Program { program, .. } => program.line_event(port, now, event),
            Body::Outside(outside) if event == LineEvent::Break => outside.mark(&[Mark {
                before: 0,
                value: 0,
                damage: MarkDamage::Break,
            }]),
            Body::Outside(_) => {}
        }
    }

    /// Whether a line must poll the node.
    pub(super) fn may_send(&self, port: Port) -> bool {
        match &self.body {
            Body::Device(device) => device.may_send(port),
            Body::Program { program, .. } => program.may_send(port),
            Body::Outside(_) => true,
        }
    }

    /// Whether the node has nothing to send on a line. If it has bytes, they are lost.
    pub(super) fn is_silent(&mut self, port: Port) -> bool {
        self.line_change(port).is_none() && self.transmit(port, &mut [0]) == 0
    }

    pub(super) fn line_change(&mut self, port: Port) -> Option<LineEvent> {
        match &mut self.body {
            Body::Device(device) => device.line_change(port),
            Body::Program { program, .. } => program.line_change(port),
            Body::Outside(outside) => outside.change.take(),
        }
    }

    pub(super) fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match &mut self.body {
            Body::Device(device) => device.transmit(port, buf),
            Body::Program { program, .. } => program.transmit(port, buf),
            Body::Outside(outside) => outside.transmit(buf),
        }
    }

    /// Asks a device again for its next poll: it may have waited for room in its transmitter, or
    /// received an event that it handles later.
    pub(super) fn replan(&mut self, now: Instant) {
        if let Body::Device(device) = &self.body
            && self.polled_at > AT_ONCE
        {
            self.polled_at = later_than(now, device.poll_at());
        }
    }

    /// Polls the node, which is due.
    pub(super) fn poll(&mut self, now: Instant, world: &mut World, cpu: CpuModel) {
        self.polled_at = match &mut self.body {
            Body::Device(device) => {
                device.poll(now, world);
                later_than(now, device.poll_at())
            }
            Body::Program { busy_until, .. } if *busy_until > now => *busy_until,
            Body::Program {
                program,
                busy_until,
                last_cost,
                hasty,
            } => {
                program.poll(now);
                let cost = cpu.cost(program.take_work());
                if cost > Duration::ZERO {
                    *busy_until = now + cost;
                    *last_cost = cost;
                    *busy_until
                } else {
                    let at = program.poll_at();
                    let is_hasty = at.is_some_and(|at| at <= now);
                    *hasty = if is_hasty { hasty.saturating_add(1) } else { 0 };
                    match *hasty > HASTY_MAX {
                        true => now + HASTY_POLL,
                        false => later_than(now, at),
                    }
                }
            }
            Body::Outside(_) => NEVER,
        };
    }
}

/// Number of polls in a row for which a program may request a past time. A program that requests
/// more of them waits in a loop, for instance for a deadline that it never gives up.
const HASTY_MAX: u32 = 1_000;
/// Interval at which such a program is polled: a round of its loop.
const HASTY_POLL: Duration = Duration::from_micros(500);

/// A node that requests a past time is polled a nanosecond later, so that time advances.
fn later_than(now: Instant, at: Option<Instant>) -> Instant {
    at.map_or(NEVER, |at| at.max(now + Duration::from_nanos(1)))
}

#[cfg(test)]
mod tests {
    use firmware_core::Work;
    use firmware_core::map_view::MapView;
    use firmware_core::pose::Pose;

    use super::*;
    use crate::rig::bare;
    use crate::rig::tests::probe::Probe;

    fn outside() -> Outside {
        Outside::new(LineConfig::new_8n1(9600))
    }

    fn taken(end: &mut Outside, room: usize) -> Vec<u8> {
        let mut buf = vec![0; room];
        let len = end.transmit(&mut buf);
        buf[..len].to_vec()
    }

    /// Bytes are sent when there is room for them, and wait while sending is stopped.
    #[test]
    fn an_open_end_gives_what_was_put_into_it() {
        let mut end = outside();
        end.put(b"hello");
        assert!(end.hold(true) && !end.hold(true));
        assert_eq!(taken(&mut end, 9), b"");
        assert!(end.hold(false) && !end.hold(false));
        assert_eq!(
            [taken(&mut end, 2), taken(&mut end, 9)],
            [b"he".to_vec(), b"llo".to_vec()]
        );
        assert_eq!(taken(&mut end, 9), b"");
    }

    /// 4096 bytes wait for the reader; the rest is lost, but the last one is known.
    #[test]
    fn an_open_end_has_room_for_4096_bytes() {
        let mut end = outside();
        assert_eq!(end.last, None);
        end.receive(&[1; 4_000]);
        end.receive(&[2; 100]);
        assert_eq!((end.from_rig.len(), end.last), (4_096, Some(2)));
        assert_eq!(end.from_rig[3_999..4_001], [1, 2]);
        end.receive(&[]);
        end.receive(&[3]);
        assert_eq!((end.from_rig.len(), end.last), (4_096, Some(3)));
        assert!(end.take_messages().is_empty());
    }

    /// Messages keep their lengths. An empty or too long one is no message; one without room is
    /// lost as a whole.
    #[test]
    fn messages_stay_whole() {
        let mut end = outside();
        end.carry_messages();
        end.put(b"");
        end.put(&vec![7; MESSAGE_MAX + 1]);
        end.put(b"one");
        end.put(b"two!");
        end.put(&vec![7; MESSAGE_MAX]);
        assert_eq!(taken(&mut end, MESSAGE_MAX), b"one");
        end.hold(true);
        assert_eq!(taken(&mut end, MESSAGE_MAX), b"");
        end.hold(false);
        assert_eq!(taken(&mut end, MESSAGE_MAX), b"two!");
        assert_eq!(taken(&mut end, MESSAGE_MAX).len(), MESSAGE_MAX);
        assert_eq!(taken(&mut end, MESSAGE_MAX), b"");
        end.receive(&[1; 4_000]);
        end.receive(&[2; 97]);
        end.receive(&[3; 96]);
        end.receive(&[4]);
        let lens: Vec<usize> = end.take_messages().iter().map(Bytes::len).collect();
        assert_eq!(lens, [4_000, 96]);
        assert!(end.from_rig.is_empty() && end.take_messages().is_empty());
        end.receive(&[5; 2]);
        assert_eq!(end.take_messages(), [Bytes::from_static(&[5; 2])]);
    }

    /// A node that requests a past time is polled a nanosecond later.
    #[test]
    fn time_moves_between_two_polls() {
        let at = Instant::from_nanos;
        assert_eq!(
            [5, 10, 11, 12].map(|nanos| later_than(at(10), Some(at(nanos)))),
            [11, 11, 11, 12].map(at)
        );
        let mut node = Node {
            name: "end".to_owned(),
            body: Body::Outside(Box::new(outside())),
            polled_at: at(10),
            excused_from: 0,
        };
        node.polled_at = later_than(at(10), None);
        assert_eq!(node.polled_at, NEVER);
        node.receive(Port(0), at(1), b"x");
        assert!(node.polled_at == AT_ONCE && node.may_send(Port(0)) && node.is_silent(Port(0)));
        if let Body::Outside(end) = &mut node.body {
            end.put(b"y");
        }
        assert!(!node.is_silent(Port(0)));
        if let Body::Outside(end) = &mut node.body {
            end.change = Some(LineEvent::Opened);
        }
        assert!(!node.is_silent(Port(0)) && node.line_change(Port(0)).is_none());
    }

    /// A program that always requests a poll at once, and counts its polls.
    #[derive(Clone)]
    struct Busy(u32);

    impl Master for Busy {
        fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

        fn poll(&mut self, _: Instant) {
            self.0 += 1;
        }

        fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
            0
        }

        fn poll_at(&self) -> Option<Instant> {
            Some(Instant::ZERO)
        }

        fn line_config(&self, _: Port) -> LineConfig {
            LineConfig::new_8n1(9600)
        }

        fn take_work(&mut self) -> Work {
            Work::NONE
        }
    }

    impl Inspect for Busy {
        fn estimate(&self) -> Option<(Instant, Pose)> {
            None
        }

        fn map(&self) -> Option<MapView<'_>> {
            None
        }

        fn mode(&self) -> &'static str {
            "busy"
        }

        fn counters(&self, _: &mut dyn FnMut(&'static str, u64)) {}
    }

    /// A program that waits in a loop does not stop the clock: 1,001 polls, 1 ns apart, end 1 us
    /// after the first; 19 more, each 500 us later, are within 10 ms.
    #[test]
    fn a_program_that_waits_in_a_loop_does_not_stop_the_clock() {
        let mut rig = bare::rig();
        rig.add_program("busy", Box::new(Busy(0)));
        rig.run_until(Instant::from_millis(10));
        let polls = rig.program_as::<Busy>().map_or(0, |busy| busy.0);
        assert_eq!(polls, 1_020);
    }

    const fn mark(before: usize) -> Mark {
        Mark {
            before,
            value: 9,
            damage: MarkDamage::Parity,
        }
    }

    /// Three bytes wait already. Of the characters that come then, the first lies before the next
    /// byte and the second two bytes later. There is room for 4,096 marks.
    #[test]
    fn marks_are_counted_from_the_first_byte_that_waits() {
        let mut end = outside();
        end.receive(&[1, 2, 3]);
        end.mark(&[mark(0), mark(2)]);
        assert_eq!(end.marks, [mark(3), mark(5)]);
        end.mark(&[mark(0); 5_000]);
        assert_eq!(end.marks.len(), 4_096);
        end.mark(&[mark(0)]);
        assert_eq!(end.marks.len(), 4_096);
    }

    /// What the owner wrote before is lost with the plug, and with nothing else.
    #[test]
    fn a_pulled_plug_takes_the_bytes_of_the_owner_along() {
        for carries_messages in [false, true] {
            let mut end = outside();
            if carries_messages {
                end.carry_messages();
            }
            end.put(b"old");
            end.plug(true, Some("new"));
            assert_eq!(end.unplugged, (1, Some("new".to_owned())));
            end.plug(true, None);
            assert_eq!(end.unplugged, (2, None));
            end.put(b"ab");
            assert_eq!(taken(&mut end, 9), b"ab");
            for depth in [1, 0, 0] {
                end.plug(false, None);
                assert_eq!(end.unplugged, (depth, None));
            }
            assert_eq!(taken(&mut end, 9), b"");
        }
    }

    /// A device, a program and an open end; the first two with this probe.
    fn three(probe: Probe) -> [Node; 3] {
        let bodies = [
            Body::Device(Box::new(probe.clone())),
            Body::Program {
                program: Box::new(probe),
                busy_until: Instant::ZERO,
                last_cost: Duration::ZERO,
                hasty: 0,
            },
            Body::Outside(Box::new(outside())),
        ];
        bodies.map(|body| Node {
            name: "node".to_owned(),
            body,
            polled_at: NEVER,
            excused_from: 0,
        })
    }

    #[test]
    fn each_kind_of_node_has_its_own_coding() {
        let probe = Probe {
            line: LineConfig::new_8n1(4_800),
            ..Probe::default()
        };
        let bauds = three(probe).map(|node| node.line_config(Port(0)).baud);
        assert_eq!(bauds, [4_800, 4_800, 9_600]);
    }

    /// A node is silent that has neither bytes nor a change of its line. An open end is always
    /// asked.
    #[test]
    fn a_node_is_silent_without_bytes_and_changes() {
        let change = || Probe {
            change: Some(LineEvent::Closed),
            may_send: false,
            ..Probe::default()
        };
        let bytes = || Probe {
            to_send: [7].into(),
            ..Probe::default()
        };
        let silent = |probe| three(probe).map(|mut node| node.is_silent(Port(0)));
        assert_eq!(silent(Probe::default()), [true; 3]);
        assert_eq!(silent(change()), [false, false, true]);
        assert_eq!(silent(bytes()), [false, false, true]);
        let asked = |probe| three(probe).map(|node| node.may_send(Port(0)));
        assert_eq!(asked(change()), [false, false, true]);
        assert_eq!(asked(bytes()), [true; 3]);
    }

    /// Bytes and events wake any node; damaged characters only an open end, and only if there are
    /// some.
    #[test]
    fn an_event_wakes_its_node() {
        let woken = |event: &dyn Fn(&mut Node)| {
            three(Probe::default()).map(|mut node| {
                event(&mut node);
                node.polled_at == AT_ONCE
            })
        };
        let now = Instant::from_micros(5);
        assert_eq!(woken(&|_| {}), [false; 3]);
        assert_eq!(woken(&|node| node.receive(Port(0), now, b"x")), [true; 3]);
        let closed = |node: &mut Node| node.line_event(Port(0), now, LineEvent::Closed);
        assert_eq!(woken(&closed), [true; 3]);
        assert_eq!(woken(&|node| node.mark(&[])), [false; 3]);
        assert_eq!(woken(&|node| node.mark(&[mark(0)])), [false, false, true]);
    }

    /// At 20 us, a device that is asked again wants to be polled at 50 us. One that received
    /// something stays due at once; a program is not asked.
    #[test]
    fn only_a_device_is_asked_again_for_its_next_poll() {
        let probe = Probe {
            wakes_at: Some(Instant::from_micros(50)),
            ..Probe::default()
        };
        let replanned = |at| {
            three(probe.clone()).map(|mut node| {
                node.polled_at = at;
                node.replan(Instant::from_micros(20));
                node.polled_at
            })
        };
        let soon = Instant::from_nanos(1);
        assert_eq!(replanned(soon), [Instant::from_micros(50), soon, soon]);
        assert_eq!(replanned(AT_ONCE), [AT_ONCE; 3]);
    }

    /// Only a device counts broken rules: two of them, from which the excused ones are counted.
    #[test]
    fn only_a_device_counts_broken_rules() {
        let mut broken = BrokenRules::default();
        broken.count(Instant::ZERO, "too-soon");
        broken.count(Instant::ZERO, "too-late");
        let probe = Probe {
            broken: Some(broken),
            ..Probe::default()
        };
        let counts = three(probe).map(|mut node| {
            node.note_breaks();
            let total = node.broken_rules().map(BrokenRules::total);
            (total, node.logs().len(), node.excused_from, node.unframed())
        });
        assert_eq!(
            counts,
            [(Some(2), 1, 2, 0), (None, 0, 0, 0), (None, 0, 0, 0)]
        );
    }
}
