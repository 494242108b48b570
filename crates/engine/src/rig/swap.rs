//! Replacements in a rig: an open end for a device, another program for the robot's, a recording
//! for a sender.

use protocols::LineConfig;

use super::node::{Body, Node, Outside, Program};
use super::{Link, Rig};
use crate::rig::line::{Direction, End, Line, NEVER};

impl Rig {
    /// The links whose master end is the program under test, by their numbers.
    pub fn program_links(&self) -> Vec<usize> {
        let is_program = |node: usize| matches!(self.nodes[node].body, Body::Program { .. });
        let ends = self.links.iter().map(|link| link.lines[0].to.node);
        let own = (0..).zip(ends).filter(|&(_, node)| is_program(node));
        own.map(|(link, _)| link).collect()
    }

    /// The links whose master end is a program under test, by their numbers: the robot's own, one
    /// outside of the rig, or a node program. A link of `station` with an outside end leads to the
    /// operator.
    pub(crate) fn links_under_test(&self, station: &[&str]) -> Vec<usize> {
        let is_tested = |link: &&Link| {
            let node = &self.nodes[link.lines[0].to.node];
            match node.body {
                Body::Program { .. } => true,
                Body::Outside(_) => !station.contains(&link.name.as_str()),
                Body::Device(_) => self.node_programs().any(|(name, _)| name == node.name),
            }
        };
        let links = self.links.iter().enumerate();
        let tested = links.filter(|(_, link)| is_tested(link));
        tested.map(|(number, _)| number).collect()
    }

    /// The lines of the link with this number: towards the program, then towards the device.
    pub fn lines_mut(&mut self, link: usize) -> Option<&mut [Line; 2]> {
        self.links.get_mut(link).map(|link| &mut link.lines)
    }

    /// Removes the device at the other end of `link` from the rig and opens its end of the link to
    /// the outside; returns the number of the new node. Other links of the device lead nowhere from
    /// then on. `None` if the link does not exist, or no device is on it.
    pub fn replace_device(&mut self, link: &str) -> Option<usize> {
        let End { node: old, port } = self.link(link)?.line(Direction::ToMaster).from;
        let Body::Device(device) = &self.nodes[old].body else {
            return None;
        };
        let line = device.line_config(port);
        self.nodes[old].body = Body::Outside(Box::new(Outside::new(line)));
        self.nodes[old].polled_at = NEVER;
        let name = self.nodes[old].name.clone();
        let end = End {
            node: self.add_outside(&name, line),
            port,
        };
        let link = self.link_mut(link)?;
        link.line_mut(Direction::ToMaster).from = end;
        link.line_mut(Direction::ToDevice).to = end;
        Some(end.node)
    }

    /// Replaces the program under test, e.g. by a broken one. `replace` receives the old program.
    /// Without a program this has no effect.
    pub fn replace_program(&mut self, replace: impl FnOnce(Box<dyn Program>) -> Box<dyn Program>) {
        let is_program = |node: &&mut Node| matches!(node.body, Body::Program { .. });
        let Some(node) = self.nodes.iter_mut().find(is_program) else {
            return;
        };
        node.stir();
        let silent = Body::Outside(Box::new(Outside::new(LineConfig::new_8n1(1))));
        if let Body::Program {
            program,
            busy_until,
            last_cost,
            hasty,
        } = core::mem::replace(&mut node.body, silent)
        {
            node.body = Body::Program {
                program: replace(program),
                busy_until,
                last_cost,
                hasty,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use protocols::{Instant, Port};

    use super::*;
    use crate::rig::bare;
    use crate::rig::tests::pair;
    use crate::rig::tests::probe::Probe;

    const fn end(node: usize, port: u8) -> End {
        let port = Port(port);
        End { node, port }
    }

    fn line(baud: u32) -> LineConfig {
        LineConfig::new_8n1(baud)
    }

    /// Links 0 and 3 end at the program, link 1 at an open end, link 2 at a device. A link of the
    /// station with an open end leads to the operator.
    #[test]
    fn links_are_under_test_whose_master_is_a_program() {
        let mut rig = pair(Probe::default(), Probe::default());
        let port = rig.add_outside("port", line(9600));
        let board = rig.add_device("second", Probe::default());
        rig.connect("radio", end(board, 0), end(port, 0), 1);
        rig.connect("inside", end(board, 1), end(0, 1), 1);
        rig.connect("other", end(board, 2), end(1, 2), 1);
        assert_eq!(rig.program_links(), [0, 3]);
        assert_eq!(rig.links_under_test(&["inside"]), [0, 1, 3]);
        assert_eq!(rig.links_under_test(&["radio", "line"]), [0, 3]);
        let latency = Duration::from_millis(3);
        let lines = rig.lines_mut(1).expect("it is connected");
        lines[1].latency = latency;
        let found = rig.link("radio").expect("it is connected");
        assert_eq!(found.line(Direction::ToDevice).latency, latency);
        assert!(rig.lines_mut(4).is_none());
    }

    /// The open end has the coding and the port of the device, and the link leads there in both
    /// directions. The other link of the device is dead, and the device is gone.
    #[test]
    fn an_open_end_takes_the_place_of_a_device() {
        let board = Probe {
            line: line(500_000),
            ..Probe::default()
        };
        let mut rig = pair(board.clone(), board);
        let port = rig.add_outside("port", line(9600));
        rig.connect("spare", end(0, 3), end(port, 0), 1);
        assert_eq!(rig.replace_device("missing"), None);
        assert_eq!(rig.replace_device("line"), Some(3));
        assert_eq!(rig.node_name(3), "board");
        assert!(rig.device::<Probe>("board").is_none());
        let lines = rig.links()[0].lines.each_ref();
        let ends = lines.map(|line| (line.from, line.to));
        assert_eq!(ends, [(end(3, 2), end(1, 5)), (end(1, 5), end(3, 2))]);
        assert_eq!(rig.line_configs(&rig.links()[0].lines[0])[0], line(500_000));
        assert_eq!(rig.links()[1].lines[0].from, end(0, 3));
        assert_eq!(
            (rig.replace_device("spare"), rig.replace_device("line")),
            (None, None)
        );
        rig.inject(3, &[7]);
        rig.run_until(Instant::from_millis(1));
        let robot = rig.program_as::<Probe>().expect("it is there");
        assert_eq!(robot.received.len(), 1);
    }

    /// The new program is polled at once, and knows what the old one was. Its processor was not
    /// busy, and has the cost of the last work.
    #[test]
    fn another_program_takes_the_place_of_the_old_one() {
        let robot = Probe {
            line: line(9_600),
            work: firmware_core::Work {
                scans: 1,
                ..firmware_core::Work::NONE
            },
            ..Probe::default()
        };
        let mut rig = pair(Probe::default(), robot);
        rig.cpu.per_scan = Duration::from_millis(1);
        rig.run_until(Instant::from_millis(5));
        let mut old = None;
        rig.replace_program(|program| {
            old = Some(program.line_config(Port(0)).baud);
            Box::new(Probe::default())
        });
        assert_eq!(old, Some(9_600));
        assert_eq!(rig.last_cost(), Some(Duration::from_millis(1)));
        rig.run_until(Instant::from_millis(6));
        let robot = rig.program_as::<Probe>().expect("it is there");
        assert_eq!(robot.polls, [5_000]);

        let mut rig = bare::rig();
        rig.add_device("board", Probe::default());
        rig.replace_program(|program| program);
        assert!(rig.program().is_none() && rig.device::<Probe>("board").is_some());
    }
}
