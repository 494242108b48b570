//! A build without node programs: a rig has none.

use super::Rig;

impl Rig {
    pub(crate) const fn has_lost_node(&self) -> bool {
        false
    }

    pub(super) const fn has_node_programs(&self) -> bool {
        false
    }

    pub(super) const fn can_save_nodes(&self) -> bool {
        true
    }

    pub(crate) const fn is_lost(&self, _name: &str) -> bool {
        false
    }

    /// The node programs with the names of their nodes: none.
    pub(super) fn node_programs(&self) -> impl Iterator<Item = (&str, ())> {
        core::iter::empty()
    }

    pub(crate) const fn start_nodes(&self) {}

    /// Ends all node programs and waits for them.
    pub const fn end_nodes(&mut self) {}

    /// The end of the node programs' standard error.
    pub const fn node_words(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    /// Sentence that names the node program with late answers in real time.
    pub const fn slow_node(&self) -> Option<String> {
        None
    }
}
