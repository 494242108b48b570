//! The verdict on node programs: each answered until the end, and ended correctly.

use nodes::{NodeError, last_words};

use super::Check;
use crate::rig::Rig;

/// Name of the check.
pub const NODE_PROGRAMS: &str = "node-programs";

/// Whether all node programs of `rig` keep the contract; `None` without node programs.
pub(crate) fn node_programs(rig: &Rig) -> Option<Check> {
    rig.node_programs().next()?;
    // A stopped program proves less than one that broke the contract.
    let is_stopped = |error: &NodeError| matches!(error, NodeError::Stopped { .. });
    let lost = rig.lost_nodes().min_by_key(|(_, error)| is_stopped(error));
    if let Some((name, error)) = lost {
        let node = rig.node_programs().find(|(known, _)| *known == name);
        let said = node.map(|(_, node)| node.said()).unwrap_or_default();
        let words = last_words(&said).map(|line| format!("; its last words: {line}"));
        let detail = format!("{name} {error}{}", words.unwrap_or_default());
        return Some(match error {
            // The program may have been just about to answer.
            NodeError::Stopped { .. } => Check::not_observed(NODE_PROGRAMS, detail),
            _ => Check::new(NODE_PROGRAMS, false, detail),
        });
    }
    let counts = rig.node_programs().map(|(name, node)| {
        let exchanges = node.exchanges();
        format!("{name}: {exchanges} exchanges")
    });
    let detail = counts.collect::<Vec<_>>().join(", ");
    let observed = rig.node_programs().all(|(_, node)| node.exchanges() > 0);
    Some(Check::new(NODE_PROGRAMS, true, detail).if_observed(observed))
}
