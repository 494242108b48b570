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

#[cfg(test)]
mod tests {
    use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
    use protocols::{Instant, LineConfig, Port};

    use super::*;
    use crate::rig::LinkKind;
    use crate::rig::line::End;

    /// Two ends of a pin.
    fn rig() -> Rig {
        let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1);
        let mut rig = Rig::new(world.expect("free"));
        let ends = ["board", "host"].map(|name| End {
            node: rig.add_outside(name, LineConfig::new_8n1(1_000_000)),
            port: Port(0),
        });
        rig.connect_by(LinkKind::Pin, "pin", ends[0], ends[1], 1);
        rig
    }

    #[test]
    fn lines_that_are_set_by_hand_stay() {
        let mut rig = rig();
        assert_eq!(rig.forced_lines(1), [None; 4]);
        rig.force_lines(1, [Some(true), None, Some(false), None]);
        rig.force_lines(1, [None, Some(true), None, None]);
        assert_eq!(
            rig.forced_lines(1),
            [Some(true), Some(true), Some(false), None]
        );
        rig.force_lines(1, [Some(false), None, None, None]);
        assert_eq!(rig.forced_lines(1)[0], Some(false));
        assert_eq!(rig.forced_lines(0), [None; 4]);
    }

    #[test]
    fn a_pin_has_the_level_that_arrived_last() {
        let mut rig = rig();
        let mut level = |byte: Option<u8>, at| {
            if let Some(byte) = byte {
                rig.inject(0, &[byte]);
            }
            rig.run_until(Instant::from_millis(at));
            rig.level(1)
        };
        assert_eq!(level(None, 1), None);
        let levels = [(1, 2), (0, 3), (200, 4)].map(|(byte, at)| level(Some(byte), at));
        assert_eq!(levels, [Some(true), Some(false), Some(true)]);
        assert_eq!(level(None, 9), Some(true));
    }

    /// What is held waits; with the line free again it goes.
    #[test]
    fn an_end_that_is_held_sends_nothing() {
        let mut rig = rig();
        rig.hold(0, true);
        rig.inject(0, &[1]);
        rig.run_until(Instant::from_millis(5));
        assert_eq!((rig.level(1), rig.backlog(0)), (None, 1));
        rig.hold(0, false);
        rig.run_until(Instant::from_millis(6));
        assert_eq!((rig.level(1), rig.backlog(0)), (Some(true), 0));
    }
}
