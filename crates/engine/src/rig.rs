//! A rig: world, devices and the robot's program, connected by lines, under one clock that jumps
//! from event to event.

pub mod bare;
pub mod cpu;
mod deadlines;
pub mod direction;
mod disturb;
pub mod fault;
pub mod line;
mod link_kind;
mod logged;
mod modem;
mod node;
#[cfg(feature = "programs")]
mod node_programs;
#[cfg(not(feature = "programs"))]
#[path = "rig/no_node_programs.rs"]
mod node_programs;
mod paced;
mod preview;
mod reach;
pub(crate) mod resample;
mod round;
mod swap;
pub mod trace;
mod violations;

use core::any::Any;
use core::time::Duration;

use bytes::Bytes;
use emulators::world::World;
use emulators::{Device, Event, EventKind};
use protocols::{Instant, LineConfig, LineEvent};

use crate::rig::line::{Direction, End, Line};
use crate::rig::trace::{Tap, Trace};
use crate::rig::{cpu::CpuModel, fault::Budget};
#[cfg(feature = "programs")]
pub use ::nodes::Stopwatch;
use deadlines::Plan;
pub use disturb::Disturbance;
pub use link_kind::{LinkKind, PortRate};
pub use logged::Logged;
pub(crate) use logged::{LogMoment, LogPoint};
use node::{AT_ONCE, Body, Node, Outside};
pub use node::{AnyDevice, Program};
pub use paced::{Paced, Rigs};
pub use preview::Arrival;
pub use violations::NO_FRAME;

/// A connection between two nodes, or a node and the outside.
#[derive(Clone, Debug)]
pub struct Link {
    /// Name as in the scenario.
    pub name: String,
    /// Type of the link.
    pub kind: LinkKind,
    /// From device to master, then from master to device.
    pub lines: [Line; 2],
}

impl Link {
    /// The line of one direction.
    pub const fn line(&self, direction: Direction) -> &Line {
        &self.lines[direction as usize]
    }

    /// The line of one direction.
    pub const fn line_mut(&mut self, direction: Direction) -> &mut Line {
        &mut self.lines[direction as usize]
    }
}

/// Maximum number of events kept; further ones are only counted.
pub const EVENTS_MAX: usize = 10_000;

/// World, nodes, links, and the clock.
pub struct Rig {
    now: Instant,
    /// Ground truth.
    pub world: World,
    /// Computing times of the program's processor.
    pub cpu: CpuModel,
    nodes: Vec<Node>,
    links: Vec<Link>,
    trace: Trace,
    taps: Vec<Box<dyn Tap>>,
    events: Vec<Logged>,
    events_dropped: u64,
    violations: u64,
    /// Time until which broken rules do not count.
    excused_until: Instant,
    excused: u64,
    /// Number of excused violations that devices count by themselves.
    excused_counts: u64,
    /// Limits of random faults.
    pub budget: Budget,
    /// Active effects other than damage to bytes.
    disturbed: Vec<Disturbance>,
    /// Whether a device that is on has received a byte.
    was_heard: bool,
    /// Buffer for the bytes that nodes send.
    room: [u8; line::MESSAGE_MAX],
    /// Deadlines, computed again at the start of a run.
    plan: Plan,
}

impl Rig {
    /// An empty rig in `world`.
    pub fn new(world: World) -> Self {
        Self {
            now: Instant::ZERO,
            world,
            cpu: CpuModel::STM32F4,
            nodes: Vec::new(),
            links: Vec::new(),
            trace: Trace::default(),
            taps: Vec::new(),
            events: Vec::new(),
            events_dropped: 0,
            violations: 0,
            excused_until: Instant::ZERO,
            excused: 0,
            excused_counts: 0,
            budget: Budget::default(),
            disturbed: Vec::new(),
            was_heard: false,
            room: [0; line::MESSAGE_MAX],
            plan: Plan::default(),
        }
    }

    /// Adds a device; returns the number of its node.
    pub fn add_device(&mut self, name: &str, device: impl AnyDevice) -> usize {
        self.add_boxed_device(name, Box::new(device))
    }

    /// Adds a device whose type is not known here; returns the number of its node.
    pub fn add_boxed_device(&mut self, name: &str, device: Box<dyn AnyDevice>) -> usize {
        self.add_node(name, Body::Device(device))
    }

    /// Adds the program under test; returns the number of its node.
    pub fn add_program(&mut self, name: &str, program: Box<dyn Program>) -> usize {
        self.add_node(
            name,
            Body::Program {
                program,
                busy_until: Instant::ZERO,
                last_cost: Duration::ZERO,
                hasty: 0,
            },
        )
    }

    /// Adds an end that is served from outside; returns the number of its node.
    pub fn add_outside(&mut self, name: &str, line: LineConfig) -> usize {
        self.add_node(name, Body::Outside(Box::new(Outside::new(line))))
    }

    fn add_node(&mut self, name: &str, body: Body) -> usize {
        let name = name.to_owned();
        self.nodes.push(Node {
            name,
            body,
            polled_at: AT_ONCE,
            excused_from: 0,
        });
        self.nodes.len() - 1
    }

    /// Connects two ports by a UART link; returns the number of the link. `piece`: see
    /// [`Line::piece`].
    pub fn connect(&mut self, name: &str, device: End, master: End, piece: usize) -> usize {
        self.connect_by(LinkKind::Uart, name, device, master, piece)
    }

    /// Connects two ports by a link of `kind`; returns the number of the link. `piece`: see
    /// [`Line::piece`]; a link that carries messages ignores it.
    pub fn connect_by(
        &mut self,
        kind: LinkKind,
        name: &str,
        device: End,
        master: End,
        piece: usize,
    ) -> usize {
        let mut lines = [Line::new(device, master), Line::new(master, device)];
        lines.iter_mut().for_each(|line| line.piece = piece);
        for End { node, .. } in [device, master] {
            if let Body::Outside(outside) = &mut self.nodes[node].body
                && kind.carries_messages()
            {
                outside.carry_messages();
            }
        }
        self.links.push(Link {
            name: name.to_owned(),
            kind,
            lines,
        });
        self.links.len() - 1
    }

    /// Adds an observer of every chunk.
    pub fn add_tap(&mut self, tap: Box<dyn Tap>) {
        self.taps.push(tap);
    }

    /// Errors that stopped taps since the last call, as text for immediate output.
    pub fn take_tap_trouble(&mut self) -> Option<String> {
        self.taps.iter_mut().find_map(|tap| tap.take_trouble())
    }

    /// Finishes the files of the taps; returns the first write error.
    pub fn finish_taps(&mut self) -> std::io::Result<()> {
        self.taps.iter_mut().try_for_each(|tap| tap.finish())
    }

    /// Copies the rig with its state; the copy continues independently. Observers of this rig do
    /// not see the copy. `None` if a node program cannot save its state.
    pub fn fork(&self) -> Option<Self> {
        if !self.can_save_nodes() {
            return None;
        }
        Some(Self {
            now: self.now,
            world: self.world.separated(),
            cpu: self.cpu,
            nodes: self.nodes.clone(),
            links: self.links.clone(),
            trace: self.trace.clone(),
            taps: Vec::new(),
            events: self.events.clone(),
            events_dropped: self.events_dropped,
            violations: self.violations,
            excused_until: self.excused_until,
            excused: self.excused,
            excused_counts: self.excused_counts,
            budget: self.budget.clone(),
            disturbed: self.disturbed.clone(),
            was_heard: self.was_heard,
            room: self.room,
            plan: Plan::default(),
        })
    }

    /// The line coding at both ends of a line: sender, receiver.
    pub fn line_configs(&self, line: &Line) -> [LineConfig; 2] {
        [line.from, line.to].map(|end| self.nodes[end.node].line_config(end.port))
    }

    /// The time.
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// The links in the order in which they were connected.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// The link called `name`.
    pub fn link(&self, name: &str) -> Option<&Link> {
        self.links.iter().find(|link| link.name == name)
    }

    /// The link called `name`, to plan faults on it.
    pub fn link_mut(&mut self, name: &str) -> Option<&mut Link> {
        self.links.iter_mut().find(|link| link.name == name)
    }

    /// The device called `name`, if it is a `T`.
    pub fn device<T: Device + Any>(&self, name: &str) -> Option<&T> {
        let node = self.nodes.iter().find(|node| node.name == name)?;
        let Body::Device(device) = &node.body else {
            return None;
        };
        let device: &dyn Any = device.as_ref();
        device.downcast_ref()
    }

    /// The device `name`, if it is a `T`. It is polled next, independent of its planned time.
    pub fn device_mut<T: Device + Any>(&mut self, name: &str) -> Option<&mut T> {
        let node = self.nodes.iter_mut().find(|node| node.name == name)?;
        node.stir();
        node.device_mut()
    }

    /// As [`device_mut`](Self::device_mut), for a change that acts later: the device is polled at
    /// its planned time, as if it had known the change from the start.
    pub fn device_to_plan<T: Device + Any>(&mut self, name: &str) -> Option<&mut T> {
        let mut nodes = self.nodes.iter_mut();
        nodes.find(|node| node.name == name)?.device_mut()
    }

    /// The program under test, if it runs in this process.
    pub fn program(&self) -> Option<&dyn Program> {
        self.nodes.iter().find_map(|node| match &node.body {
            Body::Program { program, .. } => Some(program.as_ref()),
            _ => None,
        })
    }

    /// Processor time of the program's last long work.
    pub fn last_cost(&self) -> Option<Duration> {
        self.nodes.iter().find_map(|node| match &node.body {
            Body::Program { last_cost, .. } => Some(*last_cost),
            _ => None,
        })
    }

    /// The program under test with its own type.
    pub fn program_as<T: Any>(&self) -> Option<&T> {
        let program: &dyn Any = self.program()?;
        program.downcast_ref()
    }

    /// The program under test with its own type, mutable.
    pub fn program_as_mut<T: Any>(&mut self) -> Option<&mut T> {
        self.nodes.iter_mut().find_map(|node| match &mut node.body {
            Body::Program { program, .. } => {
                let program: &mut dyn Any = program.as_mut();
                program.downcast_mut()
            }
            _ => None,
        })
    }

    /// The name of the node `index`.
    pub fn node_name(&self, index: usize) -> &str {
        &self.nodes[index].name
    }

    /// One line of the link `index`.
    pub fn line_mut(&mut self, link: usize, direction: Direction) -> &mut Line {
        self.links[link].line_mut(direction)
    }

    /// Fingerprint of all bytes on all lines so far.
    pub fn trace_hash(&self) -> String {
        self.trace.hash()
    }

    /// Reports of devices and lines, oldest first, at most [`EVENTS_MAX`].
    pub fn events(&self) -> &[Logged] {
        &self.events
    }

    /// Events beyond [`EVENTS_MAX`], which were not kept.
    pub const fn events_dropped(&self) -> u64 {
        self.events_dropped
    }

    /// Runs for `duration`.
    pub fn run_for(&mut self, duration: Duration) {
        self.run_until(self.now + duration);
    }

    /// Runs until `deadline`; events at the deadline itself still happen.
    pub fn run_until(&mut self, deadline: Instant) {
        self.foresee();
        while let Some(at) = self.settle().filter(|&at| at <= deadline) {
            self.now = at.max(self.now);
        }
        self.now = self.now.max(deadline);
        self.world.advance(self.now);
        for tap in &mut self.taps {
            tap.reached(self.now);
        }
    }

    /// Runs until `condition` holds, at most until `deadline`. The condition is evaluated every
    /// `step`. Returns whether it held.
    pub fn run_until_condition(
        &mut self,
        step: Duration,
        deadline: Instant,
        mut condition: impl FnMut(&Self) -> bool,
    ) -> bool {
        while !condition(self) {
            if self.now >= deadline {
                return false;
            }
            self.run_until((self.now + step).min(deadline));
        }
        true
    }

    /// Gives bytes to an outside end, as if its owner had written them now. If the link carries
    /// messages, the bytes are one message of at most [`line::MESSAGE_MAX`] bytes.
    pub fn inject(&mut self, node: usize, bytes: &[u8]) {
        if let Body::Outside(outside) = &mut self.nodes[node].body {
            outside.put(bytes);
            self.nodes[node].stir();
        }
    }

    /// Number of injected bytes that the line has not taken yet.
    pub fn backlog(&self, node: usize) -> usize {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.to_rig.len(),
            _ => 0,
        }
    }

    /// Number of characters that wait at an outside end, damaged ones included.
    pub fn output_len(&self, node: usize) -> usize {
        match &self.nodes[node].body {
            Body::Outside(outside) => outside.from_rig.len() + outside.marks.len(),
            _ => 0,
        }
    }

    /// Takes the bytes that arrived at an outside end since the last call.
    pub fn take_output(&mut self, node: usize) -> Bytes {
        match &mut self.nodes[node].body {
            Body::Outside(outside) => {
                outside.marks.clear();
                outside.from_rig.split().freeze()
            }
            _ => Bytes::new(),
        }
    }

    /// Takes the messages that arrived at an outside end of a link that carries messages, since the
    /// last call.
    pub fn take_messages(&mut self, node: usize) -> Vec<Bytes> {
        match &mut self.nodes[node].body {
            Body::Outside(outside) => outside.take_messages(),
            _ => Vec::new(),
        }
    }

    /// Reports to the other end that the owner of an outside end opened or closed it.
    pub fn change_line(&mut self, node: usize, event: LineEvent) {
        if let Body::Outside(outside) = &mut self.nodes[node].body {
            outside.change = Some(event);
            self.nodes[node].stir();
        }
    }

    /// Sets the line coding that the owner of an outside end uses.
    pub fn set_line_config(&mut self, node: usize, line: LineConfig) {
        if let Body::Outside(outside) = &mut self.nodes[node].body {
            outside.line = line;
        }
    }

    /// Adds an entry to the log.
    pub fn log(&mut self, source: &str, event: Event) {
        self.log_from(source, event, true, false);
    }

    /// As [`log`](Self::log). With `counts`, a broken rule counts, because its source does not
    /// count it. With `is_kept`, the source keeps the moments of its log.
    fn log_from(&mut self, source: &str, mut event: Event, counts: bool, is_kept: bool) {
        if event.kind == EventKind::Violation && event.at < self.excused_until {
            event.kind = EventKind::Note;
            event.detail.push_str(" (not charged: the rig was late)");
            self.excused += u64::from(counts);
        }
        self.violations += u64::from(counts && event.kind == EventKind::Violation);
        if self.events.len() < EVENTS_MAX {
            self.events.push(Logged {
                source: source.to_owned(),
                event,
                is_kept,
            });
        } else {
            self.events_dropped += 1;
        }
    }
}

#[cfg(test)]
mod tests;
