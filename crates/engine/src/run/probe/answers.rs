//! Whether a condition answers another one that holds at the same moment.

use super::{Node, Probe, Source};
use crate::scenario::Condition;

impl Probe {
    /// Whether this condition holds at the last judged moment because of another event than
    /// `question`: a frame on another line, or a log entry of another rule or source. The same
    /// frame, contact or entry is no answer.
    pub(in crate::run) fn answers(&self, question: &Self) -> bool {
        let (mut asked, mut held) = (Vec::new(), Vec::new());
        question.add_held(&mut asked);
        self.add_held(&mut held);
        let is_same = |one: &&Condition| asked.iter().any(|asked| may_be_one(asked, one));
        held.iter().any(|one| !is_same(one))
    }

    /// Adds its momentary parts that hold at the last judged moment.
    fn add_held<'a>(&'a self, into: &mut Vec<&'a Condition>) {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => {
                parts.iter().for_each(|part| part.add_held(into));
            }
            Node::Not(_) => {}
            Node::Leaf(leaf) => {
                let holds = leaf.now.as_ref().and_then(|reading| reading.holds);
                if holds == Some(true) && !matches!(leaf.source, Source::State) {
                    into.push(&self.condition);
                }
            }
        }
    }
}

/// Whether two conditions that hold at one moment may hold because of the same frame, contact or
/// entry.
pub(super) fn may_be_one(one: &Condition, other: &Condition) -> bool {
    let line = |condition: &Condition| match condition {
        Condition::Bytes(bytes) => Some((bytes.link.clone(), bytes.direction)),
        Condition::Frame(frame) => Some((frame.link.clone(), frame.direction)),
        _ => None,
    };
    match (one, other) {
        (Condition::Event(one), Condition::Event(other)) => {
            let is_open = one.source.is_none() || other.source.is_none();
            one.rule == other.rule && (is_open || one.source == other.source)
        }
        (Condition::Contact(_), Condition::Contact(_)) => true,
        _ => line(one).is_some_and(|one| line(other) == Some(one)),
    }
}
