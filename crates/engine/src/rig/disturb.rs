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
}
