//! Expectations of a scenario, judged at the end.

use emulators::world::Pose;

use super::check::safety::overruns;
use super::check::{Check, violations};
use super::score::{PoseError, WallOverlap, wall_overlap};
use super::{Run, WAY_EVERY, explored, golden, victims};
use crate::scenario::Flaw;

/// Whether the check `name` judges an expectation at the end of the run. A run that is too short
/// fails such a check.
pub fn is_of_the_end(name: &str) -> bool {
    let names = [
        "waypoints-visited",
        "returned",
        "settled",
        "wall-overlap",
        "map-received",
        "home",
        "explored",
        "victims-found",
        "golden-path",
        "golden-map",
    ];
    names.contains(&name) || name.starts_with("mission-step-")
}

impl Run {
    /// Expectations on the robot's own search.
    fn search_expectations(&self, checks: &mut Vec<Check>) {
        let (expect, start) = (&self.scenario.expect, self.scenario.world.start_pose());
        if let Some(most) = expect.home_within_mm {
            let far = self.progress.distance_from_mm(start.point());
            let far = far.unwrap_or(f64::INFINITY);
            let is_done = self.instruments.is_done(&self.rig) == Some(true);
            let says = if is_done { "says" } else { "does not say" };
            let detail = format!(
                "{far:.1} mm from the start, at most {most}; the robot {says} that it is home"
            );
            checks.push(Check::new("home", is_done && far <= most, detail));
        }
        if let Some(most) = expect.victims_within_mm {
            let found = self.instruments.found(&self.rig).unwrap_or_default();
            checks.push(victims::check(&found, &self.rig.world, most));
        }
        if let Some(least) = expect.explored_min {
            let map = self.instruments.map(&self.rig);
            let share = map.and_then(|map| explored::explored(map, &self.rig.world, start));
            let detail = match share {
                Some(share) => format!("{share:.4} of the floor, at least {least}"),
                None => format!("no map to the end, expected at least {least}"),
            };
            let pass = share.is_some_and(|share| share >= least);
            checks.push(Check::new("explored", pass, detail));
        }
    }

    /// Comparison with an earlier run.
    fn golden_expectations(&self, checks: &mut Vec<Check>) {
        let Some(spec) = &self.scenario.expect.golden else {
            return;
        };
        let refused = |name: &str, flaw: Flaw| Check::new(name, false, flaw.to_string());
        match spec.read_path() {
            Ok(Some(path)) => {
                let ours: Vec<_> = self.truth.iter().map(|(_, pose)| pose.point()).collect();
                let within = spec.path_within_mm.unwrap_or_default();
                checks.push(golden::path_check(&path, &ours, within));
            }
            Ok(None) => {}
            Err(flaw) => checks.push(refused("golden-path", flaw)),
        }
        match spec.read_map() {
            Ok(Some(walls)) => {
                let map = self.instruments.map(&self.rig);
                let within = spec.map_within_cells.unwrap_or(1);
                let least = spec.map_walls_min.unwrap_or_default();
                checks.push(golden::map_check(&walls, map, within, least));
            }
            Ok(None) => {}
            Err(flaw) => checks.push(refused("golden-map", flaw)),
        }
    }

    /// Agreement of map and world, if the scenario expects a minimum.
    pub(super) fn expected_overlap(&self) -> Option<WallOverlap> {
        let is_expected = self.scenario.expect.wall_overlap_min.is_some();
        is_expected.then(|| self.wall_overlap()).flatten()
    }

    /// Agreement of map and world for the walls visible from the robot's path.
    pub(super) fn wall_overlap(&self) -> Option<WallOverlap> {
        let way = self.truth.iter().step_by(WAY_EVERY as usize);
        let mut way: Vec<Pose> = way.map(|&(_, pose)| pose).collect();
        // A resting robot sees nothing new.
        way.dedup();
        let map = self.instruments.map(&self.rig)?;
        let within_mm = self.scenario.expect.wall_within_mm;
        Some(wall_overlap(map, &self.rig.world, &way, within_mm))
    }

    pub(super) fn expectations(
        &self,
        pose_error: Option<PoseError>,
        wall_overlap: Option<WallOverlap>,
        is_over: bool,
    ) -> Vec<Check> {
        let expect = &self.scenario.expect;
        let mut checks = Vec::new();
        let mut at_most = |name: &str, max: Option<f64>, value: Option<f64>, unit: &str| {
            if let Some(max) = max {
                let pass = value.is_some_and(|value| value <= max);
                checks.push(match value {
                    Some(value) => {
                        Check::new(name, pass, format!("{value:.1} {unit}, at most {max}"))
                    }
                    // In a run that continues, the event may still come.
                    None if !is_over => {
                        Check::not_observed(name, format!("no value yet, at most {max} {unit}"))
                    }
                    None => {
                        let detail = format!("no value to the end, expected at most {max} {unit}");
                        Check::new(name, false, detail)
                    }
                });
            }
        };
        let rms = pose_error;
        at_most(
            "pose-rms",
            expect.pose_rms_mm_max,
            rms.map(|e| e.rms_mm),
            "mm",
        );
        at_most(
            "heading-rms",
            expect.heading_rms_deg_max,
            rms.map(|e| e.rms_deg),
            "deg",
        );
        let from_last = self.progress.distance_from_last_mm();
        at_most(
            "returned",
            expect.return_within_mm,
            from_last,
            "mm from the last waypoint",
        );
        self.search_expectations(&mut checks);
        self.golden_expectations(&mut checks);
        if let Some(within) = expect.visit_within_mm {
            let (visits, all) = (self.progress.visits().len(), self.progress.waypoints());
            let detail = match all {
                0 => "the mission has no waypoints that could be visited".to_owned(),
                _ => format!("{visits} of {all} waypoints within {within} mm"),
            };
            let pass = all > 0 && visits == all;
            checks.push(Check::new("waypoints-visited", pass, detail));
        }
        if let Some(settle) = expect.settle {
            let rested = self.progress.rested(self.rig.now());
            let seconds = rested.as_secs_f64();
            let detail = format!("at rest for {seconds:.2} s, at least {settle}");
            checks.push(Check::new("settled", rested >= settle.0, detail));
        }
        if let Some(min) = expect.wall_overlap_min {
            let overlap = wall_overlap.unwrap_or_default();
            let detail = format!(
                "{:.1} % of the walls found, {:.1} % of the found ones right, at least {:.1} %",
                overlap.found * 100.0,
                overlap.right * 100.0,
                min * 100.0
            );
            let within = expect.wall_within_mm.map(|mm| format!(" within {mm} mm"));
            let detail = detail + &within.unwrap_or_default();
            checks.push(Check::new("wall-overlap", overlap.least() >= min, detail));
        }
        if let (Some(max), None) = (expect.violations_max, expect.violations_from) {
            checks.push(violations(max, &self.rig));
        }
        let most = expect
            .safety
            .as_ref()
            .and_then(|safety| safety.overruns_max);
        if let Some(most) = most {
            checks.push(overruns(most, &self.rig, self.rig.events()));
        }
        if let Some(wanted) = expect.map_received {
            let received = self.map_received();
            let pass = received == Some(wanted);
            let detail = if received == Some(true) {
                "all rows"
            } else {
                "rows are missing"
            };
            checks.push(Check::new("map-received", pass, detail));
        }
        checks
    }
}
