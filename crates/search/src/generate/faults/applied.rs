//! Faults in a mission: its expectations while they act, and afterwards.

use core::time::Duration;

use super::{Adversity, millis};
use crate::generate::mission;
use crate::generate::profile::{MissionJudged, Profile};
use engine::scenario::{Action, Expect, FaultKind, FaultSpec, SafetySpec, Scenario, Span, Step};

/// Time after the faults until broken rules of devices count.
const SETTLED: Duration = Duration::from_secs(5);
/// Distance within which a waypoint counts as visited while faults are active, millimetres. A map
/// started with a lidar error of 2 % keeps it: 60 mm for walls 3 m away.
const WITHIN_MM: f64 = 150.0;
/// As [`WITHIN_MM`], if the mission's script drives manually: a late order acts late.
const BY_HAND_WITHIN_MM: f64 = 400.0;
/// As [`BY_HAND_WITHIN_MM`], for the final position, if the order to stop arrived late too.
const BY_HAND_REST_MM: f64 = 800.0;

impl Adversity {
    /// Adds the faults to `mission`, which must succeed within `recovery` afterwards.
    pub(in crate::generate) fn apply(
        self,
        profile: &Profile,
        mission: &mut Scenario,
        recovery: Span,
        walls_min: Option<f64>,
    ) {
        if profile.judge.mission == MissionJudged::WithoutFaults {
            return self.apply_without_mission(profile, mission, walls_min);
        }
        let longest = mission.duration.max(recovery);
        mission.duration = Span(Span::from_millis(self.until_ms).0 + longest.0);
        if profile.afterwards.operator && mission::takes_orders(mission) {
            let least_ms = profile.afterwards.recovery.map_or(millis(recovery), millis);
            let once_more = mission::once_more(&mission.mission, self.until_ms, least_ms);
            mission.mission.step.extend(once_more);
        }
        if let Some(safety) = &profile.judge.safety {
            mission.expect.safety.get_or_insert_with(|| safety.clone());
        }
        mission.fault = self.faults;
        mission.budget = self.budget;
        mission.phases = self.phases;
        if let Some(phases) = &self.phases {
            mission.duration = mission.duration.max(Span(phases.length()));
        }
        // A damaged line is not the fault of its sender. This case does not judge the believed pose
        // while the robot has no measurements.
        let end = Duration::from_millis(self.until_ms);
        let later = mission.duration.0.saturating_sub(end) / 2;
        let judged = mission.expect.violations_max;
        mission.expect.violations_from = judged.map(|_| Span(end + later.min(SETTLED)));
        let is_by_hand = |step: &Step| matches!(step.action, Action::Drive(_));
        let [visit_mm, rest_mm] = match mission.mission.step.iter().any(is_by_hand) {
            true => [BY_HAND_WITHIN_MM, BY_HAND_REST_MM],
            false => [WITHIN_MM; 2],
        };
        let expect = &mut mission.expect;
        expect.visit_within_mm = expect.visit_within_mm.map(|mm| mm.max(visit_mm));
        expect.return_within_mm = expect.return_within_mm.map(|mm| mm.max(rest_mm));
        mission.expect.pose_rms_mm_max = None;
        mission.expect.heading_rms_deg_max = None;
        mission.expect.map_received = None;
        // A map that is started while a lidar has an error of 2 % keeps it: 60 mm for a wall 3 m
        // away. An unreported motion of 10 cm along a corridor cannot be detected from its walls.
        let is_wrong = |fault: &FaultSpec| fault.kind == FaultKind::Wrong;
        let asked = mission.expect.wall_overlap_min;
        mission.expect.wall_overlap_min = match mission.fault.iter().any(is_wrong) {
            true => None,
            false => asked.map(|share| share.min(WALLS_MIN)),
        };
    }
}

impl Adversity {
    /// Applies the adversity to a scenario whose mission is judged only in runs without faults.
    /// `walls_min`: the agreement of map and world that the scenario expects in its own world.
    fn apply_without_mission(
        self,
        profile: &Profile,
        mission: &mut Scenario,
        walls_min: Option<f64>,
    ) {
        let is_by_hand = |step: &Step| matches!(step.action, Action::Drive(_));
        let is_by_hand = mission.mission.step.iter().any(is_by_hand);
        let mut safety = profile.judge.safety.clone().unwrap_or_default();
        if let Some(own) = &mission.expect.safety {
            safety = own.clone();
        }
        // The figures of a diagnosis are compared as well.
        mission.program.diagnosis |= safety.true_telemetry && mission::takes_orders(mission);
        if !self.has_faults() {
            safety.alive_for = None;
            let walls = profile.judge.walls_min.zip(walls_min);
            let walls = walls.map(|(least, own)| least.min(own));
            mission.expect.wall_overlap_min = mission.expect.wall_overlap_min.or(walls);
            mission.expect.safety = Some(safety);
            return;
        }
        safety.by_hand |= is_by_hand;
        safety.contacts_until = safety.contacts_until.or(self.blind_from);
        safety.steps_may_wait = true;
        let own = &mut safety.alive_without;
        let broken = self.stays_broken.into_iter();
        let broken: Vec<String> = broken.filter(|link| !own.contains(link)).collect();
        own.extend(broken);
        mission.duration = self.length;
        // The faults do not follow the phases of the scenario.
        mission.phases = None;
        mission.mission.to_the_end = true;
        mission
            .mission
            .step
            .retain(|step| step.at.is_none_or(|at| at < self.length));
        mission.fault = self.faults;
        mission.budget = self.budget;
        // A robot that faults stop may block the path of another one.
        for member in mission.team.values_mut() {
            let own = SafetySpec {
                steps_may_wait: true,
                ..member.expect.safety.take().unwrap_or_default()
            };
            member.mission.to_the_end = true;
            member.expect = Expect {
                safety: Some(own),
                violations_max: member.expect.violations_max,
                rule: member.expect.rules_throughout(),
                ..Expect::default()
            };
        }
        let alive = safety.alive_for;
        mission.expect = Expect {
            safety: Some(safety),
            violations_max: mission.expect.violations_max.filter(|_| alive.is_some()),
            violations_from: alive.map(|last| Span(self.length.0.saturating_sub(last.0))),
            rule: mission.expect.rules_throughout(),
            ..Expect::default()
        };
    }
}

/// Maximum required wall overlap of a map that was drawn during faults.
const WALLS_MIN: f64 = 0.5;
