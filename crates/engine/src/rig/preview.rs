//! Preview of a rig: the bytes that its outside ends will receive without further input.

use bytes::Bytes;
use protocols::Instant;

use super::trace::Trace;
use super::{Body, Rig};

/// A chunk that arrives at an outside end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// The number of the end's node.
    pub node: usize,
    /// Time of the arrival.
    pub at: Instant,
    /// The bytes.
    pub bytes: Bytes,
    /// Damaged characters arrive with them.
    pub is_damaged: bool,
}

impl Rig {
    /// All chunks that arrive at outside ends up to `until` without further input, in order of
    /// time. The rig does not advance. `None` if the rig has a node program, which cannot be
    /// copied.
    pub fn preview(&self, until: Instant) -> Option<Vec<Arrival>> {
        if self.has_node_programs() {
            return None;
        }
        let mut copy = Self {
            now: self.now,
            world: self.world.clone(),
            cpu: self.cpu,
            nodes: self.nodes.clone(),
            links: self.links.clone(),
            trace: Trace::default(),
            taps: Vec::new(),
            events: Vec::new(),
            events_dropped: 0,
            violations: 0,
            excused_until: self.excused_until,
            excused: 0,
            excused_counts: 0,
            budget: self.budget.clone(),
            disturbed: self.disturbed.clone(),
            was_heard: self.was_heard,
            room: self.room,
            plan: super::Plan::default(),
        };
        let mut arrivals = Vec::new();
        copy.foresee();
        loop {
            let next = copy.settle();
            copy.take_arrivals(&mut arrivals);
            let Some(at) = next.filter(|&at| at <= until) else {
                return Some(arrivals);
            };
            copy.now = at.max(copy.now);
        }
    }

    /// Moves the bytes that have arrived at outside ends to `arrivals`.
    fn take_arrivals(&mut self, arrivals: &mut Vec<Arrival>) {
        for (index, node) in self.nodes.iter_mut().enumerate() {
            let Body::Outside(outside) = &mut node.body else {
                continue;
            };
            if outside.from_rig.is_empty() && outside.marks.is_empty() {
                continue;
            }
            arrivals.push(Arrival {
                node: index,
                at: self.now,
                bytes: outside.from_rig.split().freeze(),
                is_damaged: !core::mem::take(&mut outside.marks).is_empty(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::*;
    use crate::rig::bare;
    use crate::rig::fault::{Damage, Strike};
    use crate::rig::line::Direction;

    /// At 9600 baud a byte takes 1.0417 ms: two of three bytes arrive within 3 ms. The preview does
    /// not advance the rig; the rig later does the same, to the nanosecond.
    #[test]
    fn a_preview_is_what_comes() {
        let (mut rig, [[device, master]]) = bare::linked(["line"], 9600);
        rig.inject(device.node, b"abc");
        let arrivals = rig.preview(Instant::from_millis(3)).expect("no programs");
        let found: Vec<(u64, usize, &[u8])> = arrivals
            .iter()
            .map(|it| (it.at.as_nanos() / 100_000, it.node, &it.bytes[..]))
            .collect();
        let node = master.node;
        assert_eq!(found, [(10, node, &b"a"[..]), (20, node, &b"b"[..])]);
        assert_eq!((rig.now(), rig.output_len(node)), (Instant::ZERO, 0));
        for arrival in arrivals {
            let before = Instant::from_nanos(arrival.at.as_nanos() - 1);
            rig.run_until(before);
            assert_eq!(rig.output_len(node), 0);
            rig.run_for(Duration::from_nanos(1));
            assert_eq!(rig.take_output(node), arrival.bytes);
        }
    }

    /// A byte of 10 us with a wrong parity bit, then two bytes. The first arrives as a damaged
    /// character without a byte; the last one arrives when the preview ends.
    #[test]
    fn a_preview_covers_damaged_characters_and_its_last_instant() {
        let (mut rig, [[device, master]]) = bare::linked(["line"], 1_000_000);
        let damage = Damage::ParityError;
        let strike = Strike { byte: 0, damage };
        rig.line_mut(0, Direction::ToMaster)
            .faults
            .add_strike(strike);
        rig.inject(device.node, b"abc");
        rig.run_until(Instant::from_micros(3));
        let found = |until| {
            let arrivals = rig
                .preview(Instant::from_micros(until))
                .expect("no programs");
            let arrivals = arrivals.into_iter();
            let arrivals = arrivals.map(|it| {
                assert_eq!(it.node, master.node);
                (it.at.as_micros(), it.bytes.to_vec(), it.is_damaged)
            });
            arrivals.collect::<Vec<_>>()
        };
        let expected = [
            (10, vec![], true),
            (20, b"b".to_vec(), false),
            (30, b"c".to_vec(), false),
        ];
        assert_eq!(found(30), expected);
        assert_eq!(found(29), expected[..2]);
        assert_eq!(found(9), []);
    }

    /// What waits at an end already is part of the preview.
    #[test]
    fn a_preview_begins_with_what_has_arrived() {
        let (mut rig, [[device, master]]) = bare::linked(["line"], 1_000_000);
        rig.inject(device.node, b"a");
        rig.run_until(Instant::from_micros(15));
        let arrivals = rig.preview(Instant::from_micros(15)).expect("no programs");
        let expected = Arrival {
            node: master.node,
            at: Instant::from_micros(15),
            bytes: Bytes::from_static(b"a"),
            is_damaged: false,
        };
        assert_eq!(arrivals, [expected]);
    }
}
