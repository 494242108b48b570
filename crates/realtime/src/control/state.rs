//! State of a run, for a client.

use std::collections::BTreeMap;

use emulators::world::Pose;
use serde_json::{Value, json};

use super::perform::{Office, Session};
use super::{CLIENTS_MAX, LINE_MAX, PROTOCOL, VERBS};
use crate::held::Held;
use engine::rig::line::Direction;
use engine::run::check::{Check, Status};
use engine::run::{Run, unobserved};

impl Office<'_> {
    pub(super) fn hello(&self) -> Value {
        let (run, scenario) = (&*self.run, self.run.scenario());
        let links = run.rig.links().iter().map(|link| {
            let [sender, _] = run.rig.line_configs(link.line(Direction::ToMaster));
            let port = self.ports.iter().find(|port| port.name == link.name);
            let codec = run.instruments().codec(&run.rig, &link.name);
            json!({
                "name": link.name,
                "baud": sender.baud,
                "codec": codec.map(|codec| codec.name()),
                "port": port.map(|port| port.path.to_string_lossy()),
            })
        });
        let ports = self.ports.iter().map(|port| {
            let path = port.path.to_string_lossy();
            json!({"name": port.name, "path": path, "baud": port.baud})
        });
        json!({
            "protocol": PROTOCOL,
            "tool": "hilrig",
            "version": env!("CARGO_PKG_VERSION"),
            "scenario": scenario.name,
            "seed": scenario.seed,
            "robot": scenario.robot,
            "duration_ns": scenario.duration.instant().as_nanos(),
            "time_ns": run.rig.now().as_nanos(),
            "requests": VERBS,
            "links": links.collect::<Vec<_>>(),
            "ports": ports.collect::<Vec<_>>(),
            "limits": {"line_bytes": LINE_MAX, "clients": CLIENTS_MAX},
        })
    }

    pub(super) fn state(&self, session: &mut Session) -> Value {
        let run = &*self.run;
        let (rig, instruments, progress) = (&run.rig, run.instruments(), run.progress());
        let mut counters = BTreeMap::new();
        if let Some(program) = rig.program() {
            program.counters(&mut |name, value| {
                counters.insert(name, value);
            });
        }
        let believed = run.estimate().map(|(at, estimate)| {
            let mut believed = pose(estimate);
            believed["at_ns"] = at.as_nanos().into();
            believed
        });
        let station = instruments.station(rig);
        json!({
            "time_ns": rig.now().as_nanos(),
            "over": run.is_over(),
            "paused": self.tempo.map(Held::stands),
            "speed": self.tempo.map(Held::speed),
            "pose": pose(rig.world.pose()),
            "believed": believed,
            "mode": instruments.mode(rig),
            "axes": instruments.axes(rig),
            "panels": instruments.panels(rig),
            "counters": counters,
            "contacts": contacts(run, session),
            "waypoints": {"visited": progress.visits().len(), "of": progress.waypoints()},
            "violations": rig.violations(),
            "events": rig.events().len(),
            "map_known": run.known_share(),
            "pc": station.map(|station| station.view(rig.now())),
            "links": links(run),
            "control": {
                "clients": self.clients,
                "requests": self.tally.requests,
                "refused": self.tally.refused,
            },
        })
    }

    /// The checks so far. Expectations about the map and pose of a program in another process are
    /// not judged.
    pub(super) fn verdict(&self) -> Value {
        let mut checks = self.run.checks();
        let beliefs = ["pose-rms", "heading-rms", "wall-overlap"];
        let is_unseen = self.run.rig.program().is_none();
        let is_belief = |check: &Check| {
            is_unseen && check.status == Status::Fail && beliefs.contains(&check.name.as_str())
        };
        let unjudged = checks.iter().filter(|check| is_belief(check));
        let unjudged: Vec<String> = unjudged.map(|check| check.name.clone()).collect();
        checks.retain(|check| !is_belief(check));
        let is = |status| checks.iter().any(|check| check.status == status);
        let expect = &self.run.scenario().expect;
        let is_whole = unobserved(expect, &checks).next().is_none();
        let verdict = match (is(Status::Fail), is(Status::Pass) && is_whole) {
            (true, _) => Status::Fail,
            (false, true) => Status::Pass,
            (false, false) => Status::NotObserved,
        };
        json!({"verdict": verdict, "checks": checks, "unjudged": unjudged})
    }
}

fn contacts(run: &Run, session: &mut Session) -> Value {
    let contacts = run.contacts();
    let new = contacts.since(session.contacts).map(|contact| {
        json!({
            "at_ns": contact.at.as_nanos(),
            "x_m": contact.place.x,
            "y_m": contact.place.y,
            "speed_m_s": contact.speed_m_s,
            "own_m_s": contact.own_m_s,
        })
    });
    let new: Vec<Value> = new.collect();
    session.contacts = contacts.count();
    json!({"count": contacts.count(), "new": new})
}

/// Bytes that arrived on each link so far.
fn links(run: &Run) -> Vec<Value> {
    let links = run.rig.links().iter().map(|link| {
        let arrived = |direction| link.line(direction).traffic().delivered;
        json!({
            "name": link.name,
            "to-master": {"bytes": arrived(Direction::ToMaster)},
            "to-device": {"bytes": arrived(Direction::ToDevice)},
        })
    });
    links.collect()
}

fn pose(pose: Pose) -> Value {
    json!({"x_m": pose.x, "y_m": pose.y, "heading_deg": pose.theta.to_degrees()})
}
