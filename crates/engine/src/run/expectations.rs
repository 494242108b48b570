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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::check::Status;

    #[test]
    fn only_some_checks_judge_the_end_of_a_run() {
        for name in ["home", "golden-map", "returned", "mission-step-3"] {
            assert!(is_of_the_end(name), "{name}");
        }
        for name in ["pose-rms", "violations", "rule-home", "mission-steps"] {
            assert!(!is_of_the_end(name), "{name}");
        }
    }

    fn run(expect: &str) -> Run {
        let text = format!("[mission]\nwaypoints_m = [[1.5, 1.0]]\n[expect]\n{expect}");
        let (scenario, source) = super::super::check::safety::puppet::scenario(&text);
        Run::new(scenario, &source, None).expect("can be wired")
    }

    fn told(
        run: &Run,
        error: Option<PoseError>,
        overlap: Option<WallOverlap>,
        is_over: bool,
    ) -> Vec<(String, Status, String)> {
        let checks = run.expectations(error, overlap, is_over).into_iter();
        checks
            .map(|check| (check.name, check.status, check.detail))
            .collect()
    }

    fn one(name: &str, status: Status, detail: &str) -> Vec<(String, Status, String)> {
        vec![(name.to_owned(), status, detail.to_owned())]
    }

    use Status::{Fail, NotObserved, Pass};

    /// The greatest permitted error is permitted; without a value it may still come in a run that
    /// continues.
    #[test]
    fn errors_of_the_pose_have_a_limit() {
        let error = |rms_mm, rms_deg| {
            Some(PoseError {
                rms_mm,
                rms_deg,
                ..PoseError::default()
            })
        };
        let place = run("pose_rms_mm_max = 50\n");
        let name = "pose-rms";
        let judged = |value, over| told(&place, value, None, over);
        assert_eq!(
            judged(error(50.0, 9.0), true),
            one(name, Pass, "50.0 mm, at most 50")
        );
        assert_eq!(
            judged(error(50.1, 0.0), true),
            one(name, Fail, "50.1 mm, at most 50")
        );
        let none = "no value yet, at most 50 mm";
        assert_eq!(judged(None, false), one(name, NotObserved, none));
        let none = "no value to the end, expected at most 50 mm";
        assert_eq!(judged(None, true), one(name, Fail, none));
        let heading = run("heading_rms_deg_max = 3\n");
        let judged = |value| told(&heading, value, None, true);
        let name = "heading-rms";
        assert_eq!(
            judged(error(99.0, 3.0)),
            one(name, Pass, "3.0 deg, at most 3")
        );
        assert_eq!(
            judged(error(0.0, 3.1)),
            one(name, Fail, "3.1 deg, at most 3")
        );
    }

    #[test]
    fn an_overlap_of_walls_has_a_least_value() {
        let walls = run("wall_overlap_min = 0.8\nwall_within_mm = 50\n");
        let judged = |found, right| told(&walls, None, Some(WallOverlap { found, right }), true);
        let words = "90.0 % of the walls found, 80.0 % of the found ones right, at least 80.0 % within 50 mm";
        assert_eq!(judged(0.9, 0.8), one("wall-overlap", Pass, words));
        assert_eq!(judged(0.79, 0.9)[0].1, Fail);
        assert_eq!(told(&walls, None, None, true)[0].1, Fail);
    }

    /// The robot stands at (1, 1), the only waypoint is half a metre ahead.
    #[test]
    fn the_mission_is_judged_by_the_true_place() {
        let judged = |expect: &str, looks: u64| {
            let mut run = run(expect);
            for look in 1..=looks {
                run.go_on_until(Instant::from_millis(10 * look));
            }
            told(&run, None, None, true)
        };
        let visited = one("waypoints-visited", Fail, "0 of 1 waypoints within 100 mm");
        assert_eq!(judged("visit_within_mm = 100\n", 1), visited);
        let visited = one("waypoints-visited", Pass, "1 of 1 waypoints within 501 mm");
        assert_eq!(judged("visit_within_mm = 501\n", 1), visited);
        let settled = one("settled", Pass, "at rest for 0.20 s, at least 0.2s");
        let found = judged("settle = \"200ms\"\n", 21);
        assert_eq!(
            (&found[0].0, found[0].1),
            (&settled[0].0, Pass),
            "{found:?}"
        );
        assert_eq!(judged("settle = \"200ms\"\n", 20)[0].1, Fail);
        let far = judged("return_within_mm = 499\n", 1);
        assert_eq!((&*far[0].0, far[0].1), ("returned", Fail), "{far:?}");
        assert_eq!(judged("return_within_mm = 501\n", 1)[0].1, Pass);
        let none = one(
            "returned",
            Fail,
            "no value to the end, expected at most 9 mm from the last waypoint",
        );
        assert_eq!(judged("return_within_mm = 9\n", 0), none);
        let nowhere = judged("home_within_mm = 9\n", 1);
        let words = "0.0 mm from the start, at most 9; the robot does not say that it is home";
        assert_eq!(nowhere, one("home", Fail, words));
    }

    use protocols::Instant;

    #[test]
    fn an_expected_map_is_received_or_not() {
        let missing = "rows are missing";
        let [yes, no] = [true, false].map(|wanted| {
            let run = run(&format!("map_received = {wanted}\n"));
            told(&run, None, None, true)
        });
        assert_eq!(yes, one("map-received", Fail, missing));
        assert_eq!(no, one("map-received", Pass, missing));
    }

    /// Violations from a time on are judged by their checker.
    #[test]
    fn violations_of_the_whole_run_are_judged_at_its_end() {
        let names = |expect: &str| {
            let checks = told(&run(expect), None, None, true);
            checks
                .into_iter()
                .map(|(name, ..)| name)
                .collect::<Vec<_>>()
        };
        assert_eq!(names("violations_max = 0\n"), ["violations"]);
        assert_eq!(
            names("violations_max = 0\nviolations_from = \"3s\"\n"),
            [""; 0]
        );
        assert_eq!(
            names("[expect.safety]\noverruns_max = 3\n"),
            ["queue-overruns"]
        );
        assert_eq!(names("explored_min = 0.5\n"), ["explored"]);
        assert_eq!(names(""), [""; 0]);
    }

    /// Without waypoints none can be visited, which is no success.
    #[test]
    fn a_mission_without_waypoints_visits_none() {
        use super::super::mission::Progress;
        use crate::scenario::{Expect, Mission};
        let mut run = run("visit_within_mm = 100\n");
        run.progress = Progress::new(&Mission::default(), &Expect::default());
        let words = "the mission has no waypoints that could be visited";
        assert_eq!(
            told(&run, None, None, true),
            one("waypoints-visited", Fail, words)
        );
    }
}
