//! What takes the place of something else in a rig: an open end that of a device, another program
//! that of the robot's, a recording that of a sender.

use protocols::LineConfig;

use super::Rig;
use super::node::{Body, Node, Outside, Program};
use crate::rig::line::{Direction, End, Line, NEVER};

impl Rig {
    /// The links whose master end is the program under test, by their numbers.
    pub fn program_links(&self) -> Vec<usize> {
        let is_program = |node: usize| matches!(self.nodes[node].body, Body::Program { .. });
        let ends = self.links.iter().map(|link| link.lines[0].to.node);
        let own = (0..).zip(ends).filter(|&(_, node)| is_program(node));
        own.map(|(link, _)| link).collect()
    }

    /// The lines of the link with this number: towards the program, then towards the device.
    pub fn lines_mut(&mut self, link: usize) -> Option<&mut [Line; 2]> {
        self.links.get_mut(link).map(|link| &mut link.lines)
    }

    /// Takes the device at the other end of `link` out of the rig and opens its end of the link to
    /// the outside; the number of the new node. Whatever else the device was connected to leads
    /// nowhere from then on. `None` if there is no such link, or no device on it.
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

    /// Puts another program in the place of the one under test, e.g. one that is to be shown
    /// broken; what `replace` is given is the one that was there. Nothing without a program.
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
        } = core::mem::replace(&mut node.body, silent)
        {
            node.body = Body::Program {
                program: replace(program),
                busy_until,
                last_cost,
            };
        }
    }
}
