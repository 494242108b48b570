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
        self.nodes[old].body = Body::Outside(Outside::new(line));
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
        let silent = Body::Outside(Outside::new(LineConfig::new_8n1(1)));
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
