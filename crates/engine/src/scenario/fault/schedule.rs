//! Faults of a scenario on a rig: their lines, and their effects on devices.

use crate::near;
use crate::rig::fault::{Effect, FaultId};
use crate::rig::line::Direction;
use crate::rig::{Disturbance, Link, Rig};
use protocols::LineEvent;

use super::{FaultKind, FaultPlace, FaultSpec, Flaw};

/// Name of the rig's socket, which is beside the ports.
const CONTROL: &str = "control";

impl Rig {
    /// Schedules `fault` on its lines and returns the other actions at its start and end. A fault
    /// with a condition is not scheduled yet. `seed` and `id` choose its random stream.
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
        if fault.waits_for_condition() {
            return Ok(disturbances);
        }
        let activity = fault.activity(id, seed);
        for (link, direction) in lines {
            let line = self.line_mut(link, direction);
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
                self.check_link("kind", fault.kind, link)?;
                Ok(vec![(link, direction.into())])
            }
            // The fault acts on all bytes that the device sends.
            (None, Some(device), _) if fault.kind == FaultKind::Delayed => {
                let sends = |(index, link): (usize, &Link)| {
                    let directions = [Direction::ToMaster, Direction::ToDevice];
                    let from = |direction| link.line(direction).from.node;
                    let sent = directions
                        .into_iter()
                        .filter(|&d| self.is_device(from(d), device));
                    sent.map(|direction| (index, direction)).collect::<Vec<_>>()
                };
                Ok(self.links().iter().enumerate().flat_map(sends).collect())
            }
            _ => Ok(Vec::new()),
        }
    }

    fn index_of(&self, key: &'static str, name: &str) -> Result<usize, Flaw> {
        let found = self.links().iter().position(|link| link.name == name);
        found.ok_or_else(|| {
            let names: Vec<&str> = self.links().iter().map(|link| link.name.as_str()).collect();
            Flaw::new(key, near::expected(name, &names))
        })
    }

    /// Whether a fault of `kind` can act on the link with this number.
    fn check_link(&self, key: &'static str, kind: FaultKind, link: usize) -> Result<(), Flaw> {
        let Link {
            name, kind: found, ..
        } = &self.links()[link];
        if kind.fits(*found) {
            return Ok(());
        }
        let fitting: Vec<&str> = kind.links().iter().map(|kind| kind.name()).collect();
        let (kind, fitting) = (kind.name(), fitting.join(", "));
        let message = format!(
            "{kind} has no effect on \"{name}\", a link of kind {found}, expected one of kind {fitting}"
        );
        Err(Flaw::new(key, message))
    }

    /// Actions when `fault` begins and ends, except those on bytes.
    ///
    /// # Errors
    /// If the device does not exist, or does not support the fault.
    pub fn disturbances(&self, fault: &FaultSpec) -> Result<Vec<Disturbance>, Flaw> {
        let kind = fault.kind;
        match (kind.place(), &fault.link, fault.direction) {
            (FaultPlace::Line, Some(link), Some(direction)) => {
                let (link, direction) = (link.clone(), direction.into());
                let tell = |begin, end| Disturbance::Tell {
                    link: link.clone(),
                    direction,
                    begin,
                    end,
                };
                Ok(match kind {
                    FaultKind::Unplugged => vec![self.unplugging(fault, &link, direction)?],
                    FaultKind::Break => vec![tell(LineEvent::Break, None)],
                    FaultKind::Swizzle => vec![self.crossing(fault, &link, direction)?],
                    _ => Vec::new(),
                })
            }
            (FaultPlace::Device, ..) => {
                let name = fault.device.as_deref().unwrap_or_default();
                let of_its_own = || {
                    let missing = "is missing, expected the name of a fault of the device";
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
                let key = match kind {
                    FaultKind::Device => "fault",
                    _ => "kind",
                };
                Ok(vec![self.ailment(
                    ["device", key],
                    name,
                    what,
                    fault.factor,
                )?])
            }
            _ => {
                let devices = fault.devices.iter().flatten();
                let off = devices.map(|name| self.ailment(["devices"; 2], name, "off", None));
                off.collect()
            }
        }
    }

    fn unplugging(
        &self,
        fault: &FaultSpec,
        link: &str,
        direction: Direction,
    ) -> Result<Disturbance, Flaw> {
        if let Some(name) = &fault.back_as {
            let is_plain = !name.is_empty()
                && !name.starts_with('.')
                && !name.contains(|c: char| c == '/' || c.is_whitespace() || c.is_control());
            let is_taken = name == CONTROL || self.links().iter().any(|other| other.name == *name);
            let wanted = match (is_plain, is_taken) {
                (false, _) => "a plain file name such as lidar-1",
                (true, true) => "a name that no other link has, and not that of the rig's socket",
                (true, false) => "",
            };
            if !wanted.is_empty() {
                let message = format!("is \"{name}\", expected {wanted}");
                return Err(Flaw::new("back_as", message));
            }
        }
        Ok(Disturbance::Unplug {
            link: link.to_owned(),
            direction,
            back_as: fault.back_as.clone(),
        })
    }

    fn crossing(
        &self,
        fault: &FaultSpec,
        link: &str,
        direction: Direction,
    ) -> Result<Disturbance, Flaw> {
        let with = fault.with.as_deref().unwrap_or_default();
        let other = self.index_of("with", with)?;
        if other == self.index_of("link", link)? {
            return Err(Flaw::new("with", "is the same link, expected another one"));
        }
        self.check_link("with", fault.kind, other)?;
        Ok(Disturbance::Cross {
            links: [link, with].map(str::to_owned),
            direction,
        })
    }

    /// The fault of the device `name`. The keys are those of the device's name and of the fault.
    fn ailment(
        &self,
        [key, of_fault]: [&'static str; 2],
        name: &str,
        fault: &str,
        figure: Option<f64>,
    ) -> Result<Disturbance, Flaw> {
        let known = self.known_faults(key, name)?;
        // A node program that does not answer its first message fails the run by itself.
        if !known.contains(&fault) && !self.is_lost(name) {
            let message = format!("{} (faults of {name})", near::expected(fault, known));
            return Err(Flaw::new(of_fault, message));
        }
        if let Some(figure) = figure.filter(|figure| !(-1e6..=1e6).contains(figure)) {
            let message = format!("is {figure}, expected -1000000 to 1000000");
            return Err(Flaw::new("factor", message));
        }
        if figure.is_some() && !self.takes_figure(name, fault) {
            let message = format!("has no effect: the fault {fault} of {name} has no figure");
            return Err(Flaw::new("factor", message));
        }
        Ok(Disturbance::Device {
            name: name.to_owned(),
            fault: fault.to_owned(),
            figure,
        })
    }

    /// The faults that the device `name` supports.
    fn known_faults(&self, key: &'static str, name: &str) -> Result<&'static [&'static str], Flaw> {
        let mut names = Vec::new();
        for (found, faults) in self.devices() {
            if found == name {
                return Ok(faults);
            }
            names.push(found);
        }
        Err(Flaw::new(key, near::expected(name, &names)))
    }
}
