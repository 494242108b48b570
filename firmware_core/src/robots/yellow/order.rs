//! Plausibility check of the lidar's nodes.
//!
//! A node has two check bits and no checksum. A quarter of all wrong offsets in the stream
//! therefore look like a node, and a node that lost a byte takes one of the next. But the head
//! turns evenly. The program therefore accepts a node under two conditions. Another node follows
//! without a byte in between, at about the next angle of the head. And the head can have reached
//! the node's own angle since the last accepted node.

use protocols::rplidar::Node;

/// Maximum angle between neighbouring nodes, 64ths of a degree. Neighbours differ by 1.8 degrees at
/// most (10 turns a second of 2,000 samples); an invalid node is up to 7 degrees ahead of its true
/// angle.
const APART_Q6: u16 = 10 * 64;
/// Maximum turn of the head from one node to the next, rounded up.
const STEP_Q6: u32 = 116;
const TURN_Q6: u16 = 360 * 64;

/// Content of a node's five bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Group {
    pub(super) starts_turn: bool,
    pub(super) quality: u8,
    pub(super) angle_q6: u16,
    pub(super) distance_mm: Option<f32>,
}

impl Group {
    pub(super) fn of(node: Node) -> Self {
        Self {
            starts_turn: node.starts_turn(),
            quality: node.quality(),
            angle_q6: node.angle_q6(),
            distance_mm: node.distance_mm(),
        }
    }
}

/// Order of the nodes.
#[derive(Clone, Debug)]
pub(super) struct Order {
    /// The last node, if no other bytes came since.
    last: Option<Group>,
    /// Angle of the last accepted node.
    believed_q6: Option<u16>,
    /// Nodes since.
    since: u32,
}

impl Order {
    pub(super) const NEW: Self = Self {
        last: None,
        believed_q6: None,
        since: 0,
    };

    /// Notes bytes that are no node.
    pub(super) const fn gap(&mut self) {
        self.last = None;
    }

    /// Takes a node; returns the one before it, if that is accepted.
    pub(super) fn take(&mut self, group: Group) -> Option<Group> {
        self.since = self.since.saturating_add(1);
        let before = self.last.replace(group)?;
        let is_followed = is_near(ahead(before.angle_q6, group.angle_q6), APART_Q6);
        let is_in_time = self.believed_q6.is_none_or(|believed| {
            let way = self.since.saturating_mul(STEP_Q6).min(TURN_Q6.into());
            let most = u16::try_from(way).unwrap_or(TURN_Q6) + APART_Q6;
            is_near(ahead(believed, before.angle_q6), most)
        });
        if !(is_followed && is_in_time) {
            return None;
        }
        self.believed_q6 = Some(before.angle_q6);
        self.since = 0;
        Some(before)
    }
}

/// Angle from `from` to `to`, less than a turn.
const fn ahead(from: u16, to: u16) -> u16 {
    (to % TURN_Q6 + TURN_Q6 - from % TURN_Q6) % TURN_Q6
}

/// Whether the angle is at most `most`, or backwards by no more than neighbours differ.
const fn is_near(ahead_q6: u16, most: u16) -> bool {
    ahead_q6 <= most || ahead_q6 >= TURN_Q6 - APART_Q6
}

#[cfg(test)]
mod tests {
    use alloc::vec::Vec;

    use super::*;

    fn node(degrees: u16) -> Group {
        Group {
            starts_turn: false,
            quality: 47,
            angle_q6: degrees * 64,
            distance_mm: Some(1_000.0),
        }
    }

    /// The accepted ones of these angles, degrees.
    fn believed(order: &mut Order, degrees: impl IntoIterator<Item = u16>) -> Vec<u16> {
        let nodes = degrees.into_iter();
        nodes
            .filter_map(|degrees| Some(order.take(node(degrees))?.angle_q6 / 64))
            .collect()
    }

    #[test]
    fn a_node_is_believed_when_the_next_one_follows_it() {
        let mut order = Order::NEW;
        assert_eq!(
            believed(&mut order, [350, 351, 359, 0, 1]),
            [350, 351, 359, 0]
        );
        order.gap();
        // The node before the gap and one without a successor are rejected; invalid nodes lie
        // ahead.
        assert_eq!(believed(&mut order, [3, 200, 5, 12, 9, 10]), [5, 12, 9]);
    }

    /// The seventh bit of each byte is cleared, so 256 degrees and more arrive as 0 and more: these
    /// nodes are in order, but too early.
    #[test]
    fn the_head_cannot_be_elsewhere_at_once() {
        let mut order = Order::NEW;
        let told = (0..720_u16).map(|degrees| degrees % 360 % 256);
        let seen = believed(&mut order, told);
        let twice = seen.iter().filter(|degrees| **degrees == 50).count();
        assert_eq!((twice, seen.iter().max()), (2, Some(&254)));
    }

    /// A wrong first angle is corrected when the head reaches the true one.
    #[test]
    fn a_wrong_beginning_is_forgotten() {
        let mut order = Order::NEW;
        assert_eq!(believed(&mut order, [100, 101]), [100]);
        order.gap();
        let seen = believed(&mut order, 10..350);
        assert_eq!((seen.first(), seen.last()), (Some(&90), Some(&348)));
    }
}
