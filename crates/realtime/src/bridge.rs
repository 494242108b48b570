//! A line between two ports outside of the rig: with its byte times, latency and faults, and
//! without a device.
//!
//! ```text
//!   one port <--> outside end | line | outside end <--> another port
//!                            faults, capture
//! ```

use core::time::Duration;

use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Instant, LineConfig, Port};

use engine::rig::fault::FaultId;
use engine::rig::line::{Direction, End, Traffic};
use engine::rig::{Paced, PortRate, Rig};
use engine::robots::OpenEnd;
use engine::run::agenda::Agenda;
use engine::scenario::{FaultSpec, Flaw};

/// Lines between ports, and their faults.
pub struct Bridge {
    rig: Rig,
    agenda: Agenda,
    seed: u64,
    faults: usize,
}

impl Bridge {
    /// A bridge without lines; `seed` selects the random numbers of the faults.
    pub fn new(seed: u64) -> Self {
        let nothing = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("nothing overlaps");
        let body = BodyConfig::default().ideal();
        let world = World::new(nothing, body, Pose::default(), seed);
        Self {
            rig: Rig::new(world.expect("there is nothing to stand in")),
            agenda: Agenda::default(),
            seed,
            faults: 0,
        }
    }

    /// Adds a link with the name of the first of `names`. Bytes of this end have the direction to
    /// the master.
    pub fn connect(
        &mut self,
        names: [&str; 2],
        line: LineConfig,
        latency: Duration,
    ) -> [OpenEnd; 2] {
        let ends = names.map(|name| OpenEnd {
            name: name.to_owned(),
            link: names[0].to_owned(),
            node: self.rig.add_outside(name, line),
            line,
            rate: PortRate::OfLine,
            connect: "any program",
            is_optional: false,
            robot: 0,
        });
        let port = Port(0);
        let [first, second] = ends.each_ref().map(|end| End {
            node: end.node,
            port,
        });
        let link = self.rig.connect(names[0], first, second, 1);
        for direction in [Direction::ToMaster, Direction::ToDevice] {
            self.rig.line_mut(link, direction).latency = latency;
        }
        ends
    }

    /// Adds `fault`; its times count from the start.
    ///
    /// # Errors
    /// If the fault is impossible on these lines.
    pub fn add_fault(&mut self, fault: &FaultSpec) -> Result<(), Flaw> {
        if fault.when.is_some() {
            let message = "waits for a robot or a device, which a link between two ports does not \
                           have; expected a time (from) or a byte (at_byte)";
            return Err(Flaw::new("when", message));
        }
        let id = FaultId(self.faults);
        let what = self.rig.plan_fault(fault, id, self.seed)?;
        self.agenda.add(id, fault.activity(id, self.seed), what);
        self.faults += 1;
        Ok(())
    }

    /// Traffic of each line: the names of its ends, and the number of bytes.
    pub fn lines(&self) -> impl Iterator<Item = ([&str; 2], Traffic)> {
        let ways = [Direction::ToMaster, Direction::ToDevice];
        let lines = self
            .rig
            .links()
            .iter()
            .flat_map(move |link| ways.map(|way| link.line(way)));
        lines.map(|line| {
            let ends = [line.from.node, line.to.node].map(|node| self.rig.node_name(node));
            (ends, line.traffic())
        })
    }
}

impl Paced for Bridge {
    fn rig(&mut self) -> &mut Rig {
        &mut self.rig
    }

    fn run_until(&mut self, deadline: Instant) {
        while let Some(at) = self.agenda.due().filter(|&at| at <= deadline) {
            self.rig.run_until(at);
            self.agenda.perform(&mut self.rig);
        }
        self.rig.run_until(deadline);
    }
}
