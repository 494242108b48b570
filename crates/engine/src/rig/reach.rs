//! Connections of nodes, directly or through others.

use std::collections::BTreeSet;

use super::{Link, Rig};
use crate::rig::line::Direction;

impl Link {
    /// The nodes at the ends of the link.
    fn nodes(&self) -> [usize; 2] {
        let line = self.line(Direction::ToMaster);
        [line.from.node, line.to.node]
    }
}

impl Rig {
    /// Whether `name`, a node or a link, can be reached over links from those called `from`.
    pub fn reaches(&self, from: &[&str], name: &str) -> bool {
        let own = |link: &&Link| from.contains(&&*link.name);
        let mut nodes: BTreeSet<usize> = self
            .links
            .iter()
            .filter(own)
            .flat_map(Link::nodes)
            .collect();
        // A rig has a handful of links: a round for each of them reaches the farthest node.
        for _ in &self.links {
            for link in &self.links {
                let ends = link.nodes();
                if ends.iter().any(|end| nodes.contains(end)) {
                    nodes.extend(ends);
                }
            }
        }
        let is_reached = |link: &Link| link.nodes().iter().any(|end| nodes.contains(end));
        nodes.iter().any(|&node| self.nodes[node].name == name)
            || self
                .links
                .iter()
                .any(|link| link.name == name && is_reached(link))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::robots::{self, Dut, PcEnd};
    use crate::scenario::Scenario;

    /// The PC of a scenario waits for the program at the radio. A program that only reads the lidar
    /// is not connected to it.
    #[test]
    fn a_client_reaches_what_hangs_on_its_port_and_nothing_else() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        let (scenario, source) = Scenario::read(&path).expect("sound");
        let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::Scripted);
        let rig = wired.expect("can be wired").rig;
        assert!(rig.reaches(&["radio"], "pc"));
        assert!(rig.reaches(&["radio"], "radio"));
        assert!(rig.reaches(&["base", "lidar"], "lidar"));
        assert!(!rig.reaches(&["lidar", "motor", "base"], "pc"));
        assert!(!rig.reaches(&[], "lidar"));
    }

    /// The program has a name of its own, unlike the links that end at it.
    #[test]
    fn a_node_is_reached_by_its_own_name() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        let (scenario, source) = Scenario::read(&path).expect("sound");
        let wired = robots::wire(&scenario, &source, Dut::Internal, PcEnd::Scripted);
        let rig = wired.expect("can be wired").rig;
        assert!(rig.link("program").is_none());
        assert!(rig.reaches(&["lidar"], "program") && rig.reaches(&["lidar"], "pc"));
    }
}
