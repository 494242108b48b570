//! Faults that are planned on a rig: effects on its lines, and disturbances of its devices.

use protocols::{Instant, LineEvent};

use super::{Body, Rig};
use crate::fault::{Effect, FaultId};
use crate::line::Direction;
use crate::scenario::{FaultKind, FaultSpec, Flaw, Place};

/// What happens to a rig when a fault begins and when it ends, besides what happens to bytes.
#[derive(Clone, Debug, PartialEq)]
pub enum Disturbance {
    /// Something is wrong with a device.
    Device {
        /// Which.
        name: String,
        /// What, by a name that the device knows.
        fault: String,
        /// By which factor, or how much.
        figure: Option<f64>,
    },
    /// A receiver is told something.
    Tell {
        /// Which link.
        link: String,
        /// Which way.
        direction: Direction,
        /// At the begin.
        begin: LineEvent,
        /// At the end.
        end: Option<LineEvent>,
    },
    /// The receivers of two lines change places.
    Cross {
        /// The links.
        links: [String; 2],
        /// Which of their lines.
        direction: Direction,
    },
}

impl Disturbance {
    /// Device, fault and figure, if it is one of a device.
    fn ailment(&self) -> Option<(&str, &str, Option<f64>)> {
        match self {
            Self::Device {
                name,
                fault,
                figure,
            } => Some((name, fault, *figure)),
            _ => None,
        }
    }
}

impl Rig {
    /// Plans `fault` on the lines that it names and returns what else there is to do when it
    /// begins and ends. Nothing is planned yet for one that waits for a condition. `seed` and `id`
    /// choose its dice.
    ///
    /// # Errors
    /// If the fault makes no sense in this rig; nothing was changed then.
    pub fn plan_fault(
        &mut self,
        fault: &FaultSpec,
        id: FaultId,
        seed: u64,
    ) -> Result<Vec<Disturbance>, Flaw> {
        fault.check()?;
        let strike = fault.strike()?;
        let effect = fault.effect(id, seed)?;
        let disturbances = self.disturbances(fault)?;
        let lines = self.lines_of(fault)?;
        if fault.when.is_some() {
            return Ok(disturbances);
        }
        let activity = fault.activity(id, seed);
        for (link, direction) in lines {
            let line = self.links[link].line_mut(direction);
            if let Some(strike) = strike {
                line.faults.add_strike(strike);
            } else if let Some(effect) = &effect {
                line.faults.add(id, activity.clone(), Effect::clone(effect));
            }
            line.note_due();
        }
        Ok(disturbances)
    }

    /// The lines that a fault acts on.
    fn lines_of(&self, fault: &FaultSpec) -> Result<Vec<(usize, Direction)>, Flaw> {
        match (&fault.link, &fault.device, fault.direction) {
            (Some(link), _, Some(direction)) => {
                let link = self.index_of("link", link)?;
                Ok(vec![(link, direction.into())])
            }
            // All that a device sends.
            (None, Some(device), _) if fault.kind == FaultKind::Delayed => {
                let sends = |(index, link): (usize, &super::Link)| {
                    let directions = [Direction::ToMaster, Direction::ToDevice];
                    let from = |direction| self.nodes[link.line(direction).from.node].name.as_str();
                    let sent = directions
                        .into_iter()
                        .filter(|&d| from(d) == device.as_str());
                    sent.map(|direction| (index, direction)).collect::<Vec<_>>()
                };
                Ok(self.links.iter().enumerate().flat_map(sends).collect())
            }
            _ => Ok(Vec::new()),
        }
    }

    fn index_of(&self, key: &'static str, name: &str) -> Result<usize, Flaw> {
        let found = self.links.iter().position(|link| link.name == name);
        found.ok_or_else(|| {
            let names: Vec<&str> = self.links.iter().map(|link| link.name.as_str()).collect();
            let message = format!("is \"{name}\", expected one of {}", names.join(", "));
            Flaw::new(key, message)
        })
    }

    /// What there is to do when `fault` begins and ends, besides what happens to bytes.
    ///
    /// # Errors
    /// If it names a device that is not there, or that knows no such fault.
    pub fn disturbances(&self, fault: &FaultSpec) -> Result<Vec<Disturbance>, Flaw> {
        let kind = fault.kind;
        match (kind.place(), &fault.link, fault.direction) {
            (Place::Line, Some(link), Some(direction)) => {
                let (link, direction) = (link.clone(), direction.into());
                let tell = |begin, end| Disturbance::Tell {
                    link: link.clone(),
                    direction,
                    begin,
                    end,
                };
                Ok(match kind {
                    FaultKind::Unplugged => {
                        vec![tell(LineEvent::Closed, Some(LineEvent::Opened))]
                    }
                    FaultKind::Break => vec![tell(LineEvent::Break, None)],
                    FaultKind::Swizzle => vec![self.crossing(fault, &link, direction)?],
                    _ => Vec::new(),
                })
            }
            (Place::Device, ..) => {
                let name = fault.device.as_deref().unwrap_or_default();
                let of_its_own = || {
                    let missing = "is missing, expected a name that the device knows";
                    fault.fault.as_deref().ok_or(Flaw::new("fault", missing))
                };
                let what = match kind {
                    FaultKind::Delayed => {
                        self.known_faults("device", name)?;
                        return Ok(Vec::new());
                    }
                    FaultKind::Intermittent => "off",
                    FaultKind::Device => of_its_own()?,
                    _ => kind.name(),
                };
                Ok(vec![self.ailment("device", name, what, fault.factor)?])
            }
            _ => {
                let devices = fault.devices.iter().flatten();
                let off = devices.map(|name| self.ailment("devices", name, "off", None));
                off.collect()
            }
        }
    }

    fn crossing(
        &self,
        fault: &FaultSpec,
        link: &str,
        direction: Direction,
    ) -> Result<Disturbance, Flaw> {
        let with = fault.with.as_deref().unwrap_or_default();
        if self.index_of("with", with)? == self.index_of("link", link)? {
            return Err(Flaw::new("with", "is the same link, expected another one"));
        }
        Ok(Disturbance::Cross {
            links: [link, with].map(str::to_owned),
            direction,
        })
    }

    fn ailment(
        &self,
        key: &'static str,
        name: &str,
        fault: &str,
        figure: Option<f64>,
    ) -> Result<Disturbance, Flaw> {
        let known = self.known_faults(key, name)?;
        if !known.contains(&fault) {
            let known = known.join(", ");
            let message = format!("\"{name}\" knows no fault \"{fault}\", expected one of {known}");
            return Err(Flaw::new(key, message));
        }
        if figure.is_some_and(|figure| !(-1e6..=1e6).contains(&figure)) {
            return Err(Flaw::new("factor", "expected -1000000 to 1000000"));
        }
        Ok(Disturbance::Device {
            name: name.to_owned(),
            fault: fault.to_owned(),
            figure,
        })
    }

    /// The devices, each with the faults that it knows.
    pub fn devices(&self) -> impl Iterator<Item = (&str, &'static [&'static str])> {
        self.nodes.iter().filter_map(|node| match &node.body {
            Body::Device(device) => Some((node.name.as_str(), device.known_faults())),
            _ => None,
        })
    }

    /// The faults that the device `name` knows.
    fn known_faults(&self, key: &'static str, name: &str) -> Result<&'static [&'static str], Flaw> {
        let mut names = Vec::new();
        for (found, faults) in self.devices() {
            if found == name {
                return Ok(faults);
            }
            names.push(found);
        }
        let message = format!("is \"{name}\", expected one of {}", names.join(", "));
        Err(Flaw::new(key, message))
    }

    /// Ends what a fault does to lines at `at`.
    pub fn end_fault(&mut self, id: FaultId, at: Instant) {
        for line in self.links.iter_mut().flat_map(|link| &mut link.lines) {
            line.faults.end(id, at);
            line.note_due();
        }
    }

    /// Begins or ends what a fault does besides damaging bytes. What two faults do at a time ends
    /// with the second.
    pub fn disturb(&mut self, what: &Disturbance, begins: bool) {
        match what {
            Disturbance::Device { .. } => self.ail(what, begins),
            Disturbance::Tell {
                link,
                direction,
                begin,
                end,
            } => {
                let event = if begins { Some(*begin) } else { *end };
                if let Some(event) = event {
                    self.tell(link, *direction, event);
                }
            }
            Disturbance::Cross { .. } => self.cross(what, begins),
        }
    }

    /// Something begins or ends to be wrong with a device.
    fn ail(&mut self, what: &Disturbance, begins: bool) {
        let ended = self.disturbed.iter().position(|other| other == what);
        if begins {
            self.disturbed.push(what.clone());
        } else if let Some(place) = ended {
            self.disturbed.remove(place);
        }
        let Some((name, fault, mut figure)) = what.ailment() else {
            return;
        };
        let others = self.disturbed.iter().filter_map(Disturbance::ailment);
        let mut others = others.filter(|(n, f, _)| (*n, *f) == (name, fault));
        let mut is_on = begins;
        if let Some((.., still)) = others.next_back().filter(|_| !begins) {
            (figure, is_on) = (still, true);
        }
        let now = self.now;
        let node = self.nodes.iter_mut().find(|node| node.name == name);
        if let Some(node) = node
            && let Body::Device(device) = &mut node.body
        {
            device.set_fault(now, fault, figure, is_on);
            node.stir();
        }
    }

    /// Receivers change places, or get their own back. Those that changed later do so anew.
    fn cross(&mut self, what: &Disturbance, begins: bool) {
        let place = self.disturbed.iter().position(|other| other == what);
        let place = place.filter(|_| !begins).unwrap_or(self.disturbed.len());
        let mut later = self.disturbed.split_off(place);
        later
            .iter()
            .rev()
            .for_each(|other| self.swap_receivers(other));
        if begins {
            later.push(what.clone());
        } else {
            later.drain(..later.len().min(1));
        }
        later.iter().for_each(|other| self.swap_receivers(other));
        self.disturbed.append(&mut later);
    }

    fn swap_receivers(&mut self, what: &Disturbance) {
        let Disturbance::Cross { links, direction } = what else {
            return;
        };
        let index = |name: &str| self.links.iter().position(|link| link.name == name);
        if let (Some(a), Some(b)) = (index(&links[0]), index(&links[1])) {
            let [to_a, to_b] = [a, b].map(|link| self.links[link].line(*direction).to);
            self.links[a].line_mut(*direction).to = to_b;
            self.links[b].line_mut(*direction).to = to_a;
        }
    }

    /// Tells the receiver of a line, and all who watch, that `event` happened.
    fn tell(&mut self, link: &str, direction: Direction, event: LineEvent) {
        let now: Instant = self.now;
        if let Some(index) = self.links.iter().position(|found| found.name == link) {
            let to = self.links[index].line(direction).to;
            self.nodes[to.node].line_event(to.port, now, event);
            for tap in &mut self.taps {
                tap.line_event(index, direction, now, event);
            }
        }
    }

    /// The value of a register of the device `name`, if it has such a one.
    pub fn register(&self, name: &str, address: u8) -> Option<u8> {
        let node = self.nodes.iter().find(|node| node.name == name)?;
        match &node.body {
            Body::Device(device) => device.peek(address),
            _ => None,
        }
    }
}
