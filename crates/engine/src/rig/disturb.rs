//! Effects of an active fault on a rig, except damage to bytes.

use protocols::{Instant, LineEvent};

use super::{Body, Rig};
use crate::rig::fault::{FaultId, Window};
use crate::rig::line::Direction;

/// The fault of a device without supply.
const OFF: &str = "off";

/// Actions on a rig at the start and end of a fault, except those on bytes.
#[derive(Clone, Debug, PartialEq)]
pub enum Disturbance {
    /// A fault of a device.
    Device {
        /// Name of the device.
        name: String,
        /// Name of the fault in the device.
        fault: String,
        /// Factor or amount.
        figure: Option<f64>,
    },
    /// A receiver gets a line event.
    Tell {
        /// The link.
        link: String,
        /// Direction.
        direction: Direction,
        /// Line event at the start.
        begin: LineEvent,
        /// Line event at the end.
        end: Option<LineEvent>,
    },
    /// A plug is pulled, and reconnected at the end: the receiver gets an error, and a client's
    /// port disappears meanwhile.
    Unplug {
        /// The link.
        link: String,
        /// Direction.
        direction: Direction,
        /// New name of the client's port after the fault; `None` if the name is the same.
        back_as: Option<String>,
    },
    /// The receivers of two lines are exchanged.
    Cross {
        /// The links.
        links: [String; 2],
        /// The direction of both lines.
        direction: Direction,
    },
}

impl Disturbance {
    /// Device, fault and figure, if the disturbance is a fault of a device.
    fn ailment(&self) -> Option<(&str, &str, Option<f64>)> {
        match self {
            Self::Device {
                name,
                fault,
                figure,
            } => Some((name, fault, *figure)),
            _ => None,
        }
    }
}

impl Rig {
    /// The devices, each with its supported faults.
    pub fn devices(&self) -> impl Iterator<Item = (&str, &'static [&'static str])> {
        self.nodes.iter().filter_map(|node| match &node.body {
            Body::Device(device) => Some((node.name.as_str(), device.known_faults())),
            _ => None,
        })
    }

    /// Whether a figure changes the effect of this fault of the device `name`. A program may use
    /// the figure of any fault.
    pub(crate) fn takes_figure(&self, name: &str, fault: &str) -> bool {
        let is_program = self.node_programs().any(|(program, _)| program == name);
        let mut nodes = self.nodes.iter();
        is_program
            || nodes.any(|node| match &node.body {
                Body::Device(device) => node.name == name && device.takes_figure(fault),
                _ => false,
            })
    }

    /// Whether the node is the device `name`. The end of a program outside has the name of its
    /// device, too.
    pub(crate) fn is_device(&self, node: usize, name: &str) -> bool {
        let node = &self.nodes[node];
        node.name == name && matches!(node.body, Body::Device(_))
    }

    /// The names of the devices. Unlike [`devices`](Self::devices), this starts no program that
    /// plays a device.
    pub fn device_names(&self) -> impl Iterator<Item = &str> {
        let devices = self.nodes.iter();
        let devices = devices.filter(|node| matches!(node.body, Body::Device(_)));
        devices.map(|node| node.name.as_str())
    }

    /// The faults that the device `name` supports. Faults of a program that plays a device are
    /// missing: they are known only after the program has started.
    pub fn faults_without_start(&self, name: &str) -> &'static [&'static str] {
        let is_program = self.node_programs().any(|(program, _)| program == name);
        let device = self.nodes.iter().find(|node| node.name == name);
        match device.map(|node| &node.body) {
            Some(Body::Device(device)) if !is_program => device.known_faults(),
            _ => &[],
        }
    }

    /// Whether a fault has switched the device of this node off.
    pub(super) fn is_off(&self, node: usize) -> bool {
        let name = &self.nodes[node].name;
        let mut faults = self.disturbed.iter().filter_map(Disturbance::ailment);
        faults.any(|(device, fault, _)| device == name && fault == OFF)
    }

    /// Ends a fault's effects on lines at `at`.
    pub fn end_fault(&mut self, id: FaultId, at: Instant) {
        for line in self.links.iter_mut().flat_map(|link| &mut link.lines) {
            line.faults.end(id, at);
            line.note_due();
        }
    }

    /// Changes the window of a fault that has one.
    pub(crate) fn move_fault(&mut self, id: FaultId, window: Window) {
        for line in self.links.iter_mut().flat_map(|link| &mut link.lines) {
            line.faults.move_to(id, window);
            line.note_due();
        }
    }

    /// Removes a fault that has not begun on any line.
    pub(crate) fn leave_out_fault(&mut self, id: FaultId) {
        for line in self.links.iter_mut().flat_map(|link| &mut link.lines) {
            line.faults.leave_out(id);
            line.note_due();
        }
    }

    /// Renumbers the faults.
    pub(crate) fn renumber_faults(&mut self, to: impl Fn(FaultId) -> FaultId) {
        for line in self.links.iter_mut().flat_map(|link| &mut link.lines) {
            line.faults.renumber(&to);
        }
    }

    /// Begins or ends the effects of a fault, except damage. If two faults have the same effect on
    /// a device, the effect ends when both faults are over.
    pub fn disturb(&mut self, what: &Disturbance, begins: bool) {
        match what {
            Disturbance::Device { .. } => self.set_device_fault(what, begins),
            Disturbance::Tell {
                link,
                direction,
                begin,
                end,
            } => {
                let event = if begins { Some(*begin) } else { *end };
                if let Some(event) = event {
                    self.notify_line(link, *direction, event);
                }
            }
            Disturbance::Unplug {
                link,
                direction,
                back_as,
            } => {
                let event = match begins {
                    true => LineEvent::Closed,
                    false => LineEvent::Opened,
                };
                self.notify_line(link, *direction, event);
                self.plug(link, *direction, begins, back_as.as_deref());
            }
            Disturbance::Cross { .. } => self.cross(what, begins),
        }
    }

    /// Begins or ends a fault of a device.
    fn set_device_fault(&mut self, what: &Disturbance, begins: bool) {
        let ended = self.disturbed.iter().position(|other| other == what);
        if begins {
            self.disturbed.push(what.clone());
        } else if let Some(place) = ended {
            self.disturbed.remove(place);
        }
        let Some((name, fault, mut figure)) = what.ailment() else {
            return;
        };
        let others = self.disturbed.iter().filter_map(Disturbance::ailment);
        let mut others = others.filter(|(n, f, _)| (*n, *f) == (name, fault));
        let mut is_on = begins;
        if let Some((.., still)) = others.next_back().filter(|_| !begins) {
            (figure, is_on) = (still, true);
        }
        let now = self.now;
        let node = self.nodes.iter_mut().find(|node| node.name == name);
        if let Some(node) = node
            && let Body::Device(device) = &mut node.body
        {
            device.set_fault(now, fault, figure, is_on);
            node.stir();
        }
    }

    /// Exchanges receivers, or undoes the exchange. Receivers that were exchanged later are
    /// exchanged again.
    fn cross(&mut self, what: &Disturbance, begins: bool) {
        let place = self.disturbed.iter().position(|other| other == what);
        let place = place.filter(|_| !begins).unwrap_or(self.disturbed.len());
        let mut later = self.disturbed.split_off(place);
        later
            .iter()
            .rev()
            .for_each(|other| self.swap_receivers(other));
        if begins {
            later.push(what.clone());
        } else {
            later.drain(..later.len().min(1));
        }
        later.iter().for_each(|other| self.swap_receivers(other));
        self.disturbed.append(&mut later);
    }

    fn swap_receivers(&mut self, what: &Disturbance) {
        let Disturbance::Cross { links, direction } = what else {
            return;
        };
        let index = |name: &str| self.links.iter().position(|link| link.name == name);
        if let (Some(a), Some(b)) = (index(&links[0]), index(&links[1])) {
            let [to_a, to_b] = [a, b].map(|link| self.links[link].line(*direction).to);
            self.links[a].line_mut(*direction).to = to_b;
            self.links[b].line_mut(*direction).to = to_a;
        }
    }

    /// Reports `event` to the receiver of a line and to all watches.
    fn notify_line(&mut self, link: &str, direction: Direction, event: LineEvent) {
        let now: Instant = self.now;
        if let Some(index) = self.links.iter().position(|found| found.name == link) {
            let to = self.links[index].line(direction).to;
            self.nodes[to.node].line_event(to.port, now, event);
            for tap in &mut self.taps {
                tap.line_event(index, direction, now, event);
            }
        }
    }

    /// Pulls the plug of a line's receiver, or plugs it in again.
    fn plug(&mut self, link: &str, direction: Direction, is_out: bool, back_as: Option<&str>) {
        if let Some(found) = self.links.iter().find(|found| found.name == link)
            && let Body::Outside(outside) = &mut self.nodes[found.line(direction).to.node].body
        {
            outside.plug(is_out, back_as);
        }
    }

    /// The value of a register of the device `name`, if it has this register.
    pub fn register(&self, name: &str, address: u8) -> Option<u8> {
        let node = self.nodes.iter().find(|node| node.name == name)?;
        match &node.body {
            Body::Device(device) => device.peek(address),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use emulators::Event;
    use emulators::world::World;
    use protocols::{LineConfig, Port};

    use super::*;
    use crate::rig::bare;

    /// The first of three links is not affected; the lines to the devices do not change.
    #[test]
    fn two_of_three_links_change_receivers_one_way_and_get_them_back() {
        let (mut rig, ends) = bare::linked(["one", "two", "three"], 9600);
        let ends = ends.map(|ends| ends.map(|end| end.node));
        // Bytes received by the three masters, then by the three devices.
        let received = |rig: &mut Rig| {
            for (byte, [device, master]) in (1..).zip(ends) {
                rig.inject(device, &[byte]);
                rig.inject(master, &[byte + 10]);
            }
            rig.run_for(Duration::from_millis(10));
            [1, 0].map(|side| ends.map(|nodes| rig.take_output(nodes[side]).to_vec()))
        };
        let crossed = Disturbance::Cross {
            links: ["two", "three"].map(str::to_owned),
            direction: Direction::ToMaster,
        };
        let to_devices = [[11], [12], [13]];
        rig.disturb(&crossed, true);
        assert_eq!(received(&mut rig), [[[1], [3], [2]], to_devices]);
        rig.disturb(&crossed, false);
        assert_eq!(received(&mut rig), [[[1], [2], [3]], to_devices]);
    }
    /// A board that can restart.
    #[derive(Clone)]
    struct Board;

    impl emulators::Device for Board {
        fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

        fn poll(&mut self, _: Instant, _: &mut World) {}

        fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
            0
        }

        fn poll_at(&self) -> Option<Instant> {
            None
        }

        fn line_config(&self, _: Port) -> LineConfig {
            LineConfig::new_8n1(9600)
        }

        fn known_faults(&self) -> &'static [&'static str] {
            &["restart"]
        }

        fn take_events(&mut self) -> Vec<Event> {
            Vec::new()
        }
    }

    #[test]
    fn a_device_of_the_rig_tells_its_faults_without_a_start() {
        let mut rig = bare::rig();
        rig.add_device("other", Board);
        rig.add_device("board", Board);
        assert_eq!(rig.faults_without_start("board"), ["restart"]);
        assert!(rig.faults_without_start("missing").is_empty());
    }

    use crate::rig::fault::{Activity, Effect};
    use crate::rig::tests::probe::Probe;
    use crate::rig::tests::{pair, watched};

    /// Node 0 is the device "board", node 1 the program "robot", joined by "line". Then come the
    /// device "other", and an outside end with the name of the first device.
    fn rig_of_four() -> Rig {
        let mut rig = pair(Probe::default(), Probe::default());
        rig.add_device("other", Probe::default());
        rig.add_outside("board", LineConfig::new_8n1(9600));
        rig
    }

    const fn at(us: u64) -> Instant {
        Instant::from_micros(us)
    }

    fn fault(name: &str, fault: &str, figure: Option<f64>) -> Disturbance {
        Disturbance::Device {
            name: name.to_owned(),
            fault: fault.to_owned(),
            figure,
        }
    }

    /// Only devices have faults and registers, and each is known by its name.
    #[test]
    fn devices_are_told_from_other_nodes() {
        let rig = rig_of_four();
        let known = ["off", "slow"];
        let devices: Vec<_> = rig.devices().collect();
        assert_eq!(devices, [("board", &known[..]), ("other", &known[..])]);
        assert!(rig.device_names().eq(["board", "other"]));
        let is_board = [0, 1, 2, 3].map(|node| rig.is_device(node, "board"));
        assert_eq!(is_board, [true, false, false, false]);
        assert!(!rig.is_device(1, "robot") && rig.is_device(2, "other"));

        let registers = [("board", 3), ("board", 4), ("robot", 3), ("none", 3)];
        let values = registers.map(|(name, address)| rig.register(name, address));
        assert_eq!(values, [Some(33), None, None, None]);

        let figures = [
            ("board", "slow"),
            ("board", "off"),
            ("robot", "slow"),
            ("none", "slow"),
        ];
        let takes = figures.map(|(name, fault)| rig.takes_figure(name, fault));
        assert_eq!(takes, [true, false, false, false]);
        assert_eq!(rig.faults_without_start("board"), known);
        assert!(rig.faults_without_start("robot").is_empty());
    }

    /// Of two faults of one kind the later one decides. When it ends, the other one holds again
    /// with its own figure, and the kind ends with the last of them. Faults of other kinds and
    /// devices change nothing.
    #[test]
    fn a_fault_of_a_device_ends_with_the_last_of_its_kind() {
        let mut rig = rig_of_four();
        let (one, two) = (
            fault("board", "slow", Some(1.0)),
            fault("board", "slow", Some(2.0)),
        );
        let steps = [
            (10, &one, true),
            (20, &fault("other", "slow", Some(7.0)), true),
            (30, &two, true),
            (40, &fault("board", "off", None), true),
            (50, &two, false),
            (60, &two, true),
            (70, &one, false),
            (80, &two, false),
            (90, &two, false),
        ];
        for (us, what, begins) in steps {
            rig.run_until(at(us));
            rig.disturb(what, begins);
        }
        rig.run_until(at(100));
        let slow = |us, figure, begins| (us, "slow".to_owned(), Some(figure), begins);
        let board = rig.device::<Probe>("board").expect("it is there");
        let expected = [
            slow(10, 1.0, true),
            slow(30, 2.0, true),
            (40, "off".to_owned(), None, true),
            slow(50, 1.0, true),
            slow(60, 2.0, true),
            slow(70, 2.0, true),
            slow(80, 2.0, false),
            slow(90, 2.0, false),
        ];
        assert_eq!(board.faults, expected);
        assert_eq!(board.polls, [0, 10, 30, 40, 50, 60, 70, 80, 90]);
        let other = rig.device::<Probe>("other").expect("it is there");
        assert_eq!(other.faults, [slow(20, 7.0, true)]);
    }

    /// A device without supply hears nothing: neither another fault of it nor the same fault of
    /// another device has this effect.
    #[test]
    fn a_device_that_is_off_has_heard_nothing() {
        let was_heard = |what: Disturbance| {
            let mut rig = rig_of_four();
            rig.disturb(&what, true);
            let robot = rig.program_as_mut::<Probe>().expect("it is there");
            robot.to_send.push_back(7);
            rig.run_until(at(10));
            rig.was_heard()
        };
        assert!(!was_heard(fault("board", "off", None)));
        assert!(was_heard(fault("board", "slow", None)));
        assert!(was_heard(fault("other", "off", None)));
    }

    fn tell(direction: Direction, end: Option<LineEvent>) -> Disturbance {
        Disturbance::Tell {
            link: "line".to_owned(),
            direction,
            begin: LineEvent::Break,
            end,
        }
    }

    /// The receiver of the line gets the events, its sender none, and observers see them.
    #[test]
    fn the_receiver_of_a_line_gets_its_events() {
        let mut rig = rig_of_four();
        let notes = watched(&mut rig);
        let breaks = tell(Direction::ToMaster, None);
        let opens = tell(Direction::ToDevice, Some(LineEvent::Overrun));
        let unplug = Disturbance::Unplug {
            link: "line".to_owned(),
            direction: Direction::ToDevice,
            back_as: None,
        };
        let elsewhere = Disturbance::Unplug {
            link: "none".to_owned(),
            direction: Direction::ToDevice,
            back_as: None,
        };
        for what in [&breaks, &opens, &unplug, &elsewhere] {
            rig.disturb(what, true);
            rig.disturb(what, false);
        }
        let expected = [
            "0 to-master Break 0",
            "0 to-device Break 0",
            "0 to-device Overrun 0",
            "0 to-device Closed 0",
            "0 to-device Opened 0",
        ];
        assert_eq!(notes.take(), expected);
        let board = rig.device::<Probe>("board").expect("it is there");
        let events = board
            .line_events
            .iter()
            .map(|(port, _, event)| (*port, *event));
        assert!(events.eq([
            (2, LineEvent::Break),
            (2, LineEvent::Overrun),
            (2, LineEvent::Closed),
            (2, LineEvent::Opened),
        ]));
        let robot = rig.program_as::<Probe>().expect("it is there");
        assert_eq!(robot.line_events, [(5, 0, LineEvent::Break)]);
        rig.run_until(at(1));
        let board = rig.device::<Probe>("board").expect("it is there");
        assert_eq!(board.polls, [0]);
    }

    /// An outside end learns of a break as a damaged character. Other events leave none, and a
    /// fault of one link does not pull the plug of another.
    #[test]
    fn only_a_break_leaves_a_character_at_an_outside_end() {
        let (mut rig, [[_, other], [_, master]]) = bare::linked(["other", "line"], 9600);
        let unplug = Disturbance::Unplug {
            link: "line".to_owned(),
            direction: Direction::ToMaster,
            back_as: None,
        };
        rig.disturb(&unplug, true);
        assert_eq!([other, master].map(|end| rig.output_len(end.node)), [0, 0]);
        assert_eq!(
            [other, master].map(|end| rig.is_unplugged(end.node)),
            [false, true]
        );
        rig.disturb(&tell(Direction::ToMaster, None), true);
        assert_eq!([other, master].map(|end| rig.output_len(end.node)), [0, 1]);
    }

    /// a and b change receivers, then b and c, so a leads to B, b to C and c to A. When the first
    /// change ends, only the second one is left: b leads to C and c to B.
    #[test]
    fn a_later_exchange_of_receivers_outlives_an_earlier_one() {
        let (mut rig, ends) = bare::linked(["a", "b", "c"], 9600);
        let masters = ends.map(|[_, master]| master.node);
        let cross = |one: &str, two: &str| Disturbance::Cross {
            links: [one, two].map(str::to_owned),
            direction: Direction::ToMaster,
        };
        let receivers = |rig: &Rig| {
            let lines = rig
                .links()
                .iter()
                .map(|link| link.line(Direction::ToMaster));
            let to = lines.map(|line| masters.iter().position(|node| *node == line.to.node));
            to.flatten().collect::<Vec<_>>()
        };
        let (first, second) = (cross("a", "b"), cross("b", "c"));
        let steps = [
            (&first, true, [1, 0, 2]),
            (&second, true, [1, 2, 0]),
            (&first, false, [0, 2, 1]),
            (&first, false, [0, 2, 1]),
            (&second, false, [0, 1, 2]),
            (&cross("a", "d"), true, [0, 1, 2]),
        ];
        for (what, begins, expected) in steps {
            rig.disturb(what, begins);
            assert_eq!(receivers(&rig), expected, "{what:?} {begins}");
        }
    }

    /// A stall until 1 ms withholds a byte that arrives at 10 us. At 20 us it is changed.
    #[test]
    fn a_fault_of_a_line_is_changed_while_it_lasts() {
        let arrives = |change: &dyn Fn(&mut Rig)| {
            let (mut rig, [[device, master]]) = bare::linked(["line"], 1_000_000);
            let window = Window {
                from: at(5),
                until: at(1_000),
            };
            let faults = &mut rig.line_mut(0, Direction::ToMaster).faults;
            faults.add(FaultId(3), Activity::from(window), Effect::Stall);
            rig.inject(device.node, &[7]);
            rig.run_until(at(20));
            change(&mut rig);
            (20..=1_000).find(|&us| {
                rig.run_until(at(us));
                rig.output_len(master.node) > 0
            })
        };
        let window = Window {
            from: at(5),
            until: at(60),
        };
        assert_eq!(arrives(&|_| {}), Some(1_000));
        assert_eq!(arrives(&|rig| rig.end_fault(FaultId(3), at(40))), Some(40));
        assert_eq!(
            arrives(&|rig| rig.end_fault(FaultId(2), at(40))),
            Some(1_000)
        );
        assert_eq!(arrives(&|rig| rig.move_fault(FaultId(3), window)), Some(60));
        assert_eq!(arrives(&|rig| rig.leave_out_fault(FaultId(3))), Some(20));
        let renumber = |rig: &mut Rig| {
            rig.renumber_faults(|id| FaultId(id.0 + 1));
            rig.end_fault(FaultId(4), at(50));
        };
        assert_eq!(arrives(&renumber), Some(50));
    }
}
