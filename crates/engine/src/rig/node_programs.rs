//! Node programs of a rig: devices that are programs of their own.

use core::any::Any;

use nodes::device::SLOW;
use nodes::{NodeDevice, NodeError, Slowness, Stopwatch};
use protocols::Port;

use super::{AnyDevice, Body, End, Rig};

impl Rig {
    /// The node programs with the names of their nodes.
    pub fn node_programs(&self) -> impl Iterator<Item = (&str, &NodeDevice)> {
        self.nodes.iter().filter_map(|node| {
            let Body::Device(device) = &node.body else {
                return None;
            };
            let device: &dyn Any = device.as_ref();
            Some((node.name.as_str(), device.downcast_ref()?))
        })
    }

    fn node_programs_mut(&mut self) -> impl Iterator<Item = &mut NodeDevice> {
        let nodes = self.nodes.iter_mut();
        nodes.filter_map(|node| node.device_mut())
    }

    /// The node programs that cannot continue, with the reason.
    pub fn lost_nodes(&self) -> impl Iterator<Item = (&str, NodeError)> {
        let nodes = self.node_programs();
        nodes.filter_map(|(name, node)| Some((name, node.error()?)))
    }

    /// Whether a node program cannot continue, apart from those for which the rig no longer waits.
    pub(crate) fn has_lost_node(&self) -> bool {
        let stopped = |error: &NodeError| matches!(error, NodeError::Stopped { .. });
        self.lost_nodes().any(|(_, error)| !stopped(&error))
    }

    /// Whether the rig has a node program.
    pub(super) fn has_node_programs(&self) -> bool {
        self.node_programs().next().is_some()
    }

    /// Whether all node programs can be copied with their state.
    pub(super) fn can_save_nodes(&self) -> bool {
        self.node_programs().all(|(_, node)| node.can_save())
    }

    /// Whether the node `name` is a program that cannot continue.
    pub(crate) fn is_lost(&self, name: &str) -> bool {
        self.lost_nodes().any(|(lost, _)| lost == name)
    }

    /// Starts all node programs.
    pub(crate) fn start_nodes(&self) {
        for (_, node) in self.node_programs() {
            // The answer is in the greeting, which needs the program.
            let _ = node.can_save();
        }
    }

    /// Ends all node programs and waits for them.
    pub fn end_nodes(&mut self) {
        self.node_programs_mut().for_each(NodeDevice::end);
    }

    /// The end of the node programs' standard error.
    pub fn node_words(&self) -> Vec<(String, String)> {
        let words = self.node_programs();
        let words = words.map(|(name, node)| (name.to_owned(), node.said()));
        words.filter(|(_, said)| !said.is_empty()).collect()
    }

    /// Starts to measure the response times of node programs.
    pub fn measure_nodes(&mut self, stopwatch: &Stopwatch) {
        self.node_programs_mut()
            .for_each(|node| node.measure_by(stopwatch.clone()));
    }

    /// Sentence that names the node program with late answers in real time.
    pub fn slow_node(&self) -> Option<String> {
        let nodes = self.node_programs();
        let nodes = nodes.map(|(name, node)| (name, node.slowness()));
        let slow = nodes.filter(|(_, slowness)| slowness.answers > 0);
        let (name, Slowness { answers, longest }) =
            slow.max_by_key(|(_, slowness)| slowness.longest)?;
        let (most, longest) = (SLOW.as_millis(), longest.as_millis());
        Some(format!(
            "node program {name} was late: {answers} answers took longer than {most} ms, the \
             longest {longest} ms"
        ))
    }

    /// Replaces the outside ends `ends` by `device`. Each end becomes one of its ports, numbered in
    /// this order. Returns the number of its node.
    pub fn seat(&mut self, name: &str, device: Box<dyn AnyDevice>, ends: &[usize]) -> usize {
        let node = self.add_boxed_device(name, device);
        let lines = self.links.iter_mut().flat_map(|link| &mut link.lines);
        for end in lines.flat_map(|line| [&mut line.from, &mut line.to]) {
            let port = ends.iter().position(|outside| *outside == end.node);
            if let Some(port) = port.and_then(|port| u8::try_from(port).ok()) {
                *end = End {
                    node,
                    port: Port(port),
                };
            }
        }
        node
    }
}
