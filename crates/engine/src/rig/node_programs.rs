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

#[cfg(test)]
mod tests {
    use core::fmt::Write as _;
    use core::time::Duration;
    use std::sync::{Arc, Mutex};

    use nodes::message::{Answer, Reply};
    use nodes::{NodeSpec, binary};
    use protocols::{Instant, LineConfig};
    use serde_json::json;

    use super::*;
    use crate::rig::bare;
    use crate::rig::line::Direction;
    use crate::rig::tests::probe::Probe;

    fn node(command: &str) -> NodeDevice {
        NodeDevice::new(NodeSpec::new("node", command))
    }

    /// A shell that gives these answers, whatever it is asked, and then listens. The output starts
    /// only after the first bytes of the rig.
    fn answers(answers: &[Answer]) -> NodeDevice {
        let mut bytes = Vec::new();
        for answer in answers {
            binary::write_answer(&mut bytes, answer).expect("short items");
        }
        let text = bytes.iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "\\{byte:03o}");
            text
        });
        node(&format!(
            "head -c 4 >/dev/null; printf '{text}'; exec cat >/dev/null"
        ))
    }

    fn hello(save: bool) -> Answer {
        Answer::Hello(json!({ "hilrig_node": 1, "save": save }))
    }

    fn reply(next: Option<Instant>) -> Answer {
        let items = Vec::new();
        Answer::Exchange(Reply { next, items })
    }

    /// A program that ends at once cannot continue. Its rig cannot be copied, and its next event
    /// is unknown.
    #[test]
    fn a_program_that_ended_is_lost() {
        let mut rig = bare::rig();
        rig.add_device("board", Probe::default());
        assert!(!rig.has_node_programs() && rig.can_save_nodes() && !rig.has_lost_node());
        rig.add_device("scale", node("echo trouble >&2; exit 3"));
        let names = |rig: &Rig| {
            let nodes = rig.node_programs().map(|(name, _)| name.to_owned());
            nodes.collect::<Vec<_>>()
        };
        assert_eq!(names(&rig), ["scale"]);
        assert!(rig.has_node_programs() && !rig.is_lost("scale"));
        assert!(rig.takes_figure("scale", "off") && !rig.takes_figure("board", "off"));
        assert!(rig.faults_without_start("scale").is_empty());
        assert!(rig.preview(Instant::ZERO).is_none() && rig.node_words().is_empty());
        rig.start_nodes();
        assert!(rig.has_lost_node() && rig.is_lost("scale") && !rig.is_lost("board"));
        let lost: Vec<_> = rig.lost_nodes().map(|(name, _)| name).collect();
        assert_eq!(lost, ["scale"]);
        assert!(!rig.can_save_nodes() && rig.fork().is_none());
        let words = rig.node_words();
        let words: Vec<_> = words
            .iter()
            .map(|(name, said)| (&**name, said.trim()))
            .collect();
        assert_eq!(words, [("scale", "trouble")]);
    }

    /// A rig can be copied if each of its programs can.
    #[test]
    fn programs_are_saved_if_they_say_so() {
        let mut rig = bare::rig();
        rig.add_device("one", answers(&[hello(true)]));
        assert!(rig.can_save_nodes() && !rig.has_lost_node() && rig.node_words().is_empty());
        rig.add_device("two", answers(&[hello(false)]));
        assert!(!rig.can_save_nodes());
        rig.end_nodes();
        // None of them runs any more.
        assert!(rig.node_programs().all(|(_, node)| !node.can_save()));
        assert!(!rig.has_lost_node());
    }

    /// The clock stands at these times, in ms, when it is read before and after each answer.
    fn slow(times: [u64; 6]) -> Option<String> {
        let mut rig = bare::rig();
        let next = Some(Instant::from_micros(5));
        rig.add_device("one", answers(&[hello(true), reply(next), reply(None)]));
        rig.add_device("two", answers(&[hello(true), reply(None)]));
        let times = Mutex::new(times.into_iter());
        let stopwatch: Stopwatch = Arc::new(move || {
            let time = times.lock().expect("one thread").next();
            Duration::from_millis(time.expect("three answers"))
        });
        rig.measure_nodes(&stopwatch);
        assert_eq!(rig.slow_node(), None);
        rig.run_until(Instant::from_micros(10));
        rig.slow_node()
    }

    /// An answer is late after more than 5 ms, and the program with the latest one is named.
    #[test]
    fn the_slowest_program_is_named() {
        let sentence = |name, answers, longest| {
            Some(format!(
                "node program {name} was late: {answers} answers took longer than 5 ms, the \
                 longest {longest} ms"
            ))
        };
        assert_eq!(slow([0, 5, 10, 15, 20, 25]), None);
        assert_eq!(slow([0, 6, 10, 17, 20, 29]), sentence("one", 2, 9));
        assert_eq!(slow([0, 6, 10, 30, 40, 49]), sentence("two", 1, 20));
    }

    /// Ends 3 and 0 become ports 0 and 1 of the device. The other ends stay.
    #[test]
    fn a_device_takes_the_place_of_open_ends() {
        let mut rig = bare::rig();
        let ends = [0, 1, 2, 3].map(|_| End {
            node: rig.add_outside("end", LineConfig::new_8n1(9600)),
            port: Port(7),
        });
        rig.connect("one", ends[0], ends[1], 1);
        rig.connect("two", ends[2], ends[3], 1);
        let node = rig.seat("board", Box::new(Probe::default()), &[3, 0]);
        assert_eq!((node, rig.node_name(node)), (4, "board"));
        let port = |port| End {
            node,
            port: Port(port),
        };
        let lines = |name: &str| {
            let link = rig.link(name).expect("it is connected");
            Direction::BOTH.map(|direction| link.line(direction))
        };
        let [to_master, to_device] = lines("one");
        assert_eq!([to_master.from, to_master.to], [port(1), ends[1]]);
        assert_eq!([to_device.from, to_device.to], [ends[1], port(1)]);
        let [to_master, to_device] = lines("two");
        assert_eq!([to_master.from, to_master.to], [ends[2], port(0)]);
        assert_eq!([to_device.from, to_device.to], [port(0), ends[2]]);
    }

    /// A node program at the master's end is under test; a device of the rig is not.
    #[test]
    fn a_link_of_a_node_program_is_under_test() {
        let mut rig = bare::rig();
        let [board, program, other] = [
            rig.add_device("board", Probe::default()),
            rig.add_device("robot", node("exit 3")),
            rig.add_device("other", Probe::default()),
        ]
        .map(|node| End {
            node,
            port: Port(0),
        });
        rig.connect("inside", board, other, 1);
        rig.connect("line", board, program, 1);
        assert_eq!(rig.links_under_test(&[]), [1]);
    }
}
