//! A build without node programs: a rig has none.

use super::Rig;

impl Rig {
    pub(crate) const fn has_lost_node(&self) -> bool {
        false
    }

    pub(super) const fn can_save_nodes(&self) -> bool {
        true
    }

    pub(crate) const fn is_lost(&self, _name: &str) -> bool {
        false
    }

    /// Tells all node programs to exit and waits for them.
    pub const fn end_nodes(&mut self) {}

    /// What node programs said on standard error, the end of it.
    pub const fn node_words(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    /// Which node program answered late in real time, in a sentence.
    pub const fn slow_node(&self) -> Option<String> {
        None
    }
}
