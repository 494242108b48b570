//! Functions for the owner of an outside end, except bytes: levels of pins, modem lines set by
//! hand, flow control, damaged characters, a pulled plug.

use super::Rig;
use super::line::Mark;
use super::node::Body;

impl Rig {
    /// The level of a pin at an outside end: on unless the last received byte is 0; `None` before
    /// the first byte.
    pub fn level(&self, node: usize) -> Option<bool> {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.last.map(|level| level != 0),
            _ => None,
        }
    }

    /// Modem lines set by hand at an outside end, in the order of drivers: CTS, DSR, RI, DCD. The
    /// rig itself does not use them.
    pub fn forced_lines(&self, node: usize) -> [Option<bool>; 4] {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.forced,
            _ => [None; 4],
        }
    }

    /// Sets the lines; those that are `None` stay.
    pub fn force_lines(&mut self, node: usize, lines: [Option<bool>; 4]) {
        if let Body::Outside(outside) = &mut self.nodes[node].body {
            let forced = outside.forced.iter_mut().zip(lines);
            forced.for_each(|(forced, line)| *forced = line.or(*forced));
        }
    }

    /// Stops or continues sending the injected bytes of an outside end.
    pub fn hold(&mut self, node: usize, is_held: bool) {
        if let Body::Outside(outside) = &mut self.nodes[node].body
            && outside.hold(is_held)
        {
            self.nodes[node].stir();
        }
    }

    /// Takes the damaged characters that arrived at an outside end since the last call, with their
    /// positions among the bytes that [`take_output`](Self::take_output) returns next. Call this
    /// first: `take_output` discards them.
    pub fn take_marks(&mut self, node: usize) -> Vec<Mark> {
        match &mut self.nodes[node].body {
            Body::Outside(outside) => core::mem::take(&mut outside.marks),
            _ => Vec::new(),
        }
    }

    /// Discards the injected bytes of an outside end that the line has not sent yet.
    pub fn discard_input(&mut self, node: usize) {
        if let Body::Outside(outside) = &mut self.nodes[node].body {
            outside.discard();
        }
    }

    /// Input and control modes of the terminal at an outside end, as in termios(3); `None` if they
    /// are not known. The rig itself does not use them.
    pub fn terminal_modes(&self, node: usize) -> Option<[u32; 2]> {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.modes,
            _ => None,
        }
    }

    /// Sets the modes of the terminal at an outside end, see
    /// [`terminal_modes`](Self::terminal_modes).
    pub fn set_terminal_modes(&mut self, node: usize, modes: Option<[u32; 2]>) {
        if let Body::Outside(outside) = &mut self.nodes[node].body {
            outside.modes = modes;
        }
    }

    /// Whether the plug at an outside end is pulled.
    pub fn is_unplugged(&self, node: usize) -> bool {
        matches!(&self.nodes[node].body, Body::Outside(outside) if outside.unplugged.0 > 0)
    }

    /// The new name of the port at an outside end after a fault; `None` if the name is the same.
    pub fn back_as(&self, node: usize) -> Option<&str> {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.unplugged.1.as_deref(),
            _ => None,
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
        rig_of(LinkKind::Pin)
    }

    fn rig_of(kind: LinkKind) -> Rig {
        let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1);
        let mut rig = Rig::new(world.expect("free"));
        let ends = ["board", "host"].map(|name| End {
            node: rig.add_outside(name, LineConfig::new_8n1(1_000_000)),
            port: Port(0),
        });
        rig.connect_by(kind, "pin", ends[0], ends[1], 1);
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

    /// A break is a damaged character at an open end, at its position among the bytes. If two
    /// faults pull the plug, it is back when both are over.
    #[test]
    fn an_end_is_told_of_a_break_and_of_its_plug() {
        use crate::rig::Disturbance;
        use crate::rig::line::{Direction, MarkDamage};
        use protocols::LineEvent;
        let mut rig = rig();
        rig.inject(0, &[7]);
        rig.run_until(Instant::from_millis(1));
        let (link, direction) = ("pin".to_owned(), Direction::ToMaster);
        rig.disturb(
            &Disturbance::Tell {
                link: link.clone(),
                direction,
                begin: LineEvent::Break,
                end: None,
            },
            true,
        );
        assert_eq!(rig.output_len(1), 2);
        let marks = rig.take_marks(1);
        assert_eq!((marks.len(), marks[0].before), (1, 1));
        assert_eq!(marks[0].damage, MarkDamage::Break);
        assert_eq!(&*rig.take_output(1), [7]);

        let unplug = Disturbance::Unplug {
            link,
            direction,
            back_as: Some("other".to_owned()),
        };
        let seen = [true, true, false, false].map(|begins| {
            rig.disturb(&unplug, begins);
            rig.is_unplugged(1)
        });
        assert_eq!(seen, [true, true, true, false]);
        assert_eq!(rig.back_as(1), Some("other"));
        assert!(!rig.is_unplugged(0));
    }

    /// Discarded messages leave no rest: the next message arrives completely.
    #[test]
    fn messages_that_are_discarded_are_gone() {
        let mut rig = rig_of(LinkKind::Datagram);
        rig.hold(0, true);
        rig.inject(0, &[1, 2, 3]);
        rig.discard_input(0);
        rig.hold(0, false);
        rig.inject(0, &[7]);
        rig.run_until(Instant::from_millis(5));
        let messages: Vec<_> = rig.take_messages(1).into_iter().collect();
        assert_eq!(messages, [[7u8].as_slice()]);
    }

    /// Held bytes wait until sending continues.
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

    #[test]
    fn the_modes_of_a_terminal_are_those_that_were_set() {
        let mut rig = rig();
        rig.set_terminal_modes(1, Some([2, 5]));
        assert_eq!(
            [0, 1].map(|node| rig.terminal_modes(node)),
            [None, Some([2, 5])]
        );
        rig.set_terminal_modes(1, None);
        assert_eq!(rig.terminal_modes(1), None);
    }
}
