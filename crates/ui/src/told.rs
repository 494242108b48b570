//! JSON data of a run for a page.

use core::time::Duration;
use std::collections::BTreeMap;

use emulators::world::Point;
use protocols::Instant;
use serde_json::{Value, json};

use super::pace::{SPEED_MAX, Tempo};
use super::wire::Tally;
use engine::rig::line::Direction;
use engine::robots::{Overlay, Station};
use engine::run::check::{Check, Status};
use engine::run::{Run, Visit, is_of_the_end};
use engine::scenario::fault_catalogue;
use show::meaning::meaning;
use show::view;

/// Additional drawings of the robot.
pub(super) fn overlays(overlays: &[Overlay]) -> String {
    json!({"type": "overlays", "overlays": overlays}).to_string()
}

/// Constant data.
pub(super) fn stage(run: &Run, number: u64, tempo: Tempo, branched: Option<Instant>) -> Value {
    let scenario = run.scenario();
    let links = run.rig.links().iter().map(|link| {
        let line = link.line(Direction::ToMaster);
        let [sender, _] = run.rig.line_configs(line);
        json!({"name": link.name, "kind": link.kind.name(), "baud": sender.baud})
    });
    let devices = run.rig.devices();
    let devices = devices.map(|(name, faults)| json!({"name": name, "faults": faults}));
    let station = run.instruments().station(&run.rig);
    json!({
        "type": "stage",
        "run": number,
        "kind": "rig",
        "name": scenario.name,
        "description": scenario.description,
        "seed": scenario.seed,
        "scene": view::scene(&run.rig.world),
        "robot": scenario.robot,
        "footprint": view::footprint(&run.rig.world),
        "links": links.collect::<Vec<_>>(),
        "pace": tempo.is_ours,
        "speed_max": SPEED_MAX,
        "body": run.instruments().has_body(),
        "goals": scenario.mission.waypoints_m,
        "pc": station.is_some(),
        "modes": station.map(Station::modes),
        "mode_words": station.map(mode_words),
        "place_acts": station.map(Station::place_acts),
        "keys": station.and_then(Station::keys),
        "duration_ns": scenario.duration.instant().as_nanos(),
        "branched_ns": branched.map(Instant::as_nanos),
        "devices": devices.collect::<Vec<_>>(),
        "faults": fault_catalogue(),
    })
}

/// Words for the modes whose names do not explain them.
pub(super) fn mode_words(station: &dyn Station) -> BTreeMap<&'static str, &'static str> {
    let modes = station.modes().iter();
    let words = modes.filter_map(|mode| Some((*mode, station.mode_words(mode)?)));
    words.collect()
}

/// The waypoints of the mission, each with the time of its visit, seconds.
fn goals(run: &Run) -> Vec<Value> {
    let mission = &run.scenario().mission;
    let mut visits: Vec<_> = run.progress().visits().iter().collect();
    let goal = |&[x, y]: &[f64; 2]| {
        let is_here = |visit: &&Visit| visit.waypoint == Point::new(x, y);
        let visit = visits.iter().position(is_here);
        let visit = visit.map(|index| visits.remove(index));
        json!({"at": [x, y], "visited": visit.map(|visit| visit.at.as_secs_f64())})
    };
    mission.waypoints_m.iter().map(goal).collect()
}

/// Slowly changing data: wires, registers, counters, faults.
pub(super) fn slow(
    run: &Run,
    before: &[[Tally; 2]],
    after: &[[Tally; 2]],
    span: Duration,
) -> Value {
    let lanes = run.rig.links().iter().zip(before.iter().zip(after));
    let lanes = lanes.map(|(link, (before, after))| {
        let lane = |direction: Direction| {
            let index = direction as usize;
            let [sender, _] = run.rig.line_configs(link.line(direction));
            let bytes = after[index].bytes - before[index].bytes;
            let busy = sender.bytes_time(bytes).as_secs_f64();
            let load = busy / span.as_secs_f64().max(1e-9);
            json!({"load": (load * 1000.0).round() / 1000.0, "tally": after[index]})
        };
        json!({
            "name": link.name,
            "to-master": lane(Direction::ToMaster),
            "to-device": lane(Direction::ToDevice),
        })
    });
    let mut counters = Vec::new();
    if let Some(program) = run.rig.program() {
        program.counters(&mut |name, value| counters.push((name, value)));
    }
    json!({
        "type": "slow",
        "lanes": lanes.collect::<Vec<_>>(),
        "axes": run.instruments().axes(&run.rig),
        "panels": run.instruments().panels(&run.rig),
        "counters": counters,
        "faults": run.faults().collect::<Vec<_>>(),
        "goals": goals(run),
        "violations": run.rig.violations(),
        "trace": run.rig.trace_hash(),
    })
}

/// The verdicts so far. A check that can still pass has not failed yet.
pub(super) fn checks(run: &Run) -> Value {
    let is_over = run.is_over() || run.rig.now() >= run.scenario().duration.instant();
    let told = |check: Check| {
        let is_late = is_of_the_end(&check.name) || check.name == "returned";
        let may_come = check.status == Status::Fail && !is_over && is_late;
        let state = match check.status {
            _ if may_come => "open",
            Status::Pass => "pass",
            Status::Fail => "fail",
            Status::NotObserved => "unseen",
        };
        json!({
            "name": check.name,
            "state": state,
            "detail": check.detail,
            "meaning": meaning(&check.name),
        })
    };
    let checks: Vec<Value> = run.checks().into_iter().map(told).collect();
    json!({"type": "checks", "over": is_over, "checks": checks})
}
