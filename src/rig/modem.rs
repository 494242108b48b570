//! What the owner of an outside end sees and does besides bytes: levels of pins, modem lines that
//! are set by hand, flow control.

use super::Rig;
use super::node::Body;

impl Rig {
    /// The level of a pin at an outside end: on unless the byte that arrived last is 0; `None`:
    /// none ever did.
    pub fn level(&self, node: usize) -> Option<bool> {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.last.map(|level| level != 0),
            _ => None,
        }
    }

    /// Modem lines that somebody sets by hand at an outside end, in the order of drivers: CTS, DSR,
    /// RI, DCD. Nothing here looks at them.
    pub fn forced_lines(&self, node: usize) -> [Option<bool>; 4] {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.forced,
            _ => [None; 4],
        }
    }

    /// Sets them; those that are `None` stay.
    pub fn force_lines(&mut self, node: usize, lines: [Option<bool>; 4]) {
        if let Body::Outside(outside) = &mut self.nodes[node].body {
            let forced = outside.forced.iter_mut().zip(lines);
            forced.for_each(|(forced, line)| *forced = line.or(*forced));
        }
    }

    /// The owner of an outside end sends nothing more of what was injected, or goes on.
    pub fn hold(&mut self, node: usize, is_held: bool) {
        if let Body::Outside(outside) = &mut self.nodes[node].body
            && outside.hold(is_held)
        {
            self.nodes[node].stir();
        }
    }
}
