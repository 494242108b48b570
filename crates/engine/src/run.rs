//! A run of a scenario in virtual time: wiring, simulation, observation, verdict.
//!
//! ```
//! use hilrig_engine::run::Run;
//! use hilrig_engine::scenario::Scenario;
//! use protocols::Instant;
//!
//! let (scenario, source) = Scenario::from_text(
//!     r#"
//!     schema = 1
//!     name = "sonar"
//!     robot = "none"
//!     duration = "3s"
//!     device.sonar.text.baud = 9600
//!     device.sonar.text.command = []
//!     device.sonar.text.periodic = { line = "mm=700", period = "1s" }
//!     "#,
//! )?;
//! let mut run = Run::new(scenario, &source, None)?;
//! run.go_on_until(Instant::from_millis(1_500));
//! assert_eq!(run.rig.now(), Instant::from_millis(1_500));
//! let outcome = run.finish();
//! assert!(outcome.trace_hash.len() > 0 && outcome.checks.len() > 0);
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

pub mod agenda;
pub mod check;
mod checkpoint;
mod command;
mod condition;
mod contacts;
mod deeds;
mod expectations;
mod explored;
mod faults;
mod golden;
pub mod history;
mod line_watch;
pub(crate) mod mission;
mod outcome;
mod own_breaks;
mod probe;
mod rules;
pub mod scene;
pub mod score;
mod steps;
mod team;
mod victims;
pub mod watch;
pub mod wire_log;

use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::Arc;

use emulators::world::{Contact, Pose};
use protocols::Instant;

use crate::Shared;
use crate::rig::fault::FaultId;
use crate::rig::{Paced, Rig};
use crate::robots::{self, Dut, Instruments, PcEnd};
use crate::run::check::{Check, Checker};
use crate::run::history::History;
use crate::run::mission::Progress;
pub use crate::run::mission::Visit;
use crate::run::score::{PoseError, PosePair, WallOverlap};
use crate::run::watch::Watchers;
use crate::scenario::world::PushSpec;
use crate::scenario::{Scenario, ScenarioError, Source};

use agenda::Agenda;
pub use checkpoint::Checkpoint;
pub use command::CommandError;
pub use condition::Watch;
pub use contacts::Contacts;
use deeds::Deeds;
pub use expectations::is_of_the_end;
pub use faults::{FAULTS_MAX, FaultReport, FaultState};
use line_watch::LineWatches;
pub use outcome::{Outcome, unobserved};
pub use own_breaks::{OwnBreaks, own_breaks};
use steps::Steps;
pub use team::{Member, wire_members};
use wire_log::{Logging, WireLog};

pub use crate::scenario::LOOK_EVERY;
/// Number of checker updates between two kept points of the true path.
const WAY_EVERY: u32 = 5;
/// Maximum time from an order to the robot's confirmation, with a failing radio.
const ORDER_ARRIVES: Duration = Duration::from_secs(5);

/// A run that can be advanced.
pub struct Run {
    /// The rig.
    pub rig: Rig,
    instruments: Arc<dyn Instruments>,
    /// The scenario as given; `scenario` changes during the run.
    asked: Arc<Scenario>,
    scenario: Scenario,
    seed: u64,
    watchers: Watchers,
    progress: Progress,
    pushes: Vec<PushSpec>,
    agenda: Agenda,
    /// Steps of the mission that the rig itself executes.
    deeds: Deeds,
    /// Faults that wait for a condition.
    waiting: Vec<FaultId>,
    /// Faults that wait for a byte or a frame.
    triggers: Vec<FaultId>,
    /// Watches on the conditions of faults, by fault and key.
    fault_watches: BTreeMap<(FaultId, &'static str), Watch>,
    truth: Vec<(Instant, Pose)>,
    pairs: Vec<PosePair>,
    history: History,
    /// Bytes on the wires, without a robot.
    wire_log: Option<Shared<WireLog>>,
    contacts: Contacts,
    /// Steps of the mission that wait for a condition, and steps added during the run.
    steps: Steps,
    /// The observer of a node program under test.
    #[cfg(feature = "programs")]
    goes_on: Option<check::GoesOn>,
    /// Watches of conditions on bytes, once there are any.
    line_watches: Option<LineWatches>,
    looks: u32,
    next_look: Instant,
    is_over: bool,
    /// The further robots.
    team: Vec<Member>,
}

/// Runs the scenario `toml` in this process to its end and judges it.
///
/// # Errors
/// If the scenario is invalid.
pub fn judge(toml: &str) -> Result<Outcome, ScenarioError> {
    let (scenario, source) = Scenario::from_text(toml)?;
    Ok(Run::new(scenario, &source, None)?.finish())
}

impl Run {
    /// Wires `scenario` for a run in this process; `seed` replaces the scenario's seed if given.
    pub fn new(
        scenario: Scenario,
        source: &Source,
        seed: Option<u64>,
    ) -> Result<Self, ScenarioError> {
        let mut scenario = scenario;
        scenario.seed = seed.unwrap_or(scenario.seed);
        let wired = robots::wire_first(&scenario, source, Dut::Internal, PcEnd::Scripted)?;
        Self::with_team(scenario, source, (wired.rig, wired.instruments))
    }

    /// A run of `scenario` in a rig that was wired for it.
    pub fn with_rig(
        mut scenario: Scenario,
        mut rig: Rig,
        instruments: Box<dyn Instruments>,
    ) -> Self {
        let asked = Arc::new(scenario.clone());
        let mut pushes = scenario.world.push.clone();
        pushes.sort_by_key(|push| push.at);
        let instruments: Arc<dyn Instruments> = Arc::from(instruments);
        let watchers = Watchers::of(&scenario, &mut rig, &instruments);
        let wire_log = Logging::begin(&mut rig, &*instruments);
        #[cfg(feature = "programs")]
        let goes_on = check::GoesOn::of(&rig);
        let mut run = Self {
            rig,
            instruments,
            asked,
            seed: scenario.seed,
            watchers,
            progress: Progress::new(&scenario.mission, &scenario.expect),
            pushes,
            agenda: Agenda::default(),
            deeds: Deeds::of(&scenario.mission),
            waiting: Vec::new(),
            triggers: Vec::new(),
            fault_watches: BTreeMap::new(),
            truth: Vec::new(),
            pairs: Vec::new(),
            history: History::new(scenario.duration.0),
            wire_log,
            contacts: Contacts::default(),
            steps: Steps::take_from(&mut scenario.mission),
            #[cfg(feature = "programs")]
            goes_on,
            line_watches: None,
            looks: 0,
            next_look: Instant::ZERO + LOOK_EVERY,
            is_over: false,
            team: Vec::new(),
            scenario,
        };
        run.plan_agenda();
        run.watch_faults();
        run
    }

    /// The scenario being run.
    pub const fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Progress of the mission.
    pub const fn progress(&self) -> &Progress {
        &self.progress
    }

    /// The interface of the robot.
    pub fn instruments(&self) -> &dyn Instruments {
        &*self.instruments
    }

    /// Estimated pose of the robot; see [`Instruments::estimate`].
    pub fn estimate(&self) -> Option<(Instant, Pose)> {
        self.instruments.estimate(&self.rig)
    }

    /// Whether the station has the complete map; `None` if the robot does not send it.
    fn map_received(&self) -> Option<bool> {
        self.instruments.station(&self.rig)?.has_whole_map()
    }

    /// Adds your own checker.
    pub fn add_checker(&mut self, checker: Box<dyn Checker>) {
        self.watchers.add(checker);
    }

    /// Contacts since the last call, the latest thousand.
    pub fn take_contacts(&mut self) -> Vec<Contact> {
        self.contacts.take()
    }

    /// Contacts so far.
    pub const fn contacts(&self) -> &Contacts {
        &self.contacts
    }

    /// Whether the mission or the time was over at the last update of the checkers.
    pub const fn is_over(&self) -> bool {
        self.is_over
    }

    fn next_look(&self) -> Instant {
        self.next_look.min(self.scenario.duration.instant())
    }

    /// Time of the next update of the checkers, or of the next action on robot and devices if that
    /// is earlier. Until then, only the rig determines the run, unless bytes come from outside.
    pub fn undisturbed_until(&self) -> Instant {
        let push = self.pushes.first().map(|push| push.at.instant());
        let due = push.into_iter().chain(self.agenda.due());
        let due = due.chain(self.deeds.due());
        let due = due.chain(self.next_meeting());
        due.fold(self.next_look(), Instant::min)
    }

    /// Runs until the next update of the checkers.
    pub fn step(&mut self) {
        self.advance(self.next_look());
        self.look();
        let is_done = !self.scenario.mission.to_the_end && self.is_done() && self.is_team_done();
        let mut rigs = core::iter::once(&self.rig).chain(self.team.iter().map(|it| &it.run.rig));
        let lost = rigs.any(Rig::has_lost_node);
        self.is_over = self.rig.now() >= self.scenario.duration.instant() || is_done || lost;
    }

    /// Whether the robot has done its task.
    fn is_done(&self) -> bool {
        let now = self.rig.now();
        let received = match self.scenario.expect.map_received {
            Some(true) => self.map_received().unwrap_or(true),
            _ => true,
        };
        let phases = self.scenario.phases;
        let judged = phases.is_none_or(|phases| now >= phases.windows()[3].until);
        let came = self.progress.is_over(now) || self.has_come_home(now);
        judged && received && !self.is_waiting() && came
    }

    /// Whether a step of the mission or a rule waits for an event.
    fn is_waiting(&self) -> bool {
        self.steps.is_waiting() || self.watchers.awaits(self.rig.now())
    }

    /// Whether the robot has finished its own search and rests, and no later order can move it.
    fn has_come_home(&self, now: Instant) -> bool {
        let is_wanted = self.scenario.expect.home_within_mm.is_some();
        let orders = self.scenario.mission.step.iter();
        let last = orders.filter_map(|step| step.at).max();
        is_wanted
            && last.is_none_or(|at| now >= at.instant() + ORDER_ARRIVES)
            && self.instruments.is_done(&self.rig) == Some(true)
            && self.progress.has_settled(now)
    }

    /// Runs until `deadline`, even if the mission ends before.
    pub fn go_on_until(&mut self, deadline: Instant) {
        while self.next_look <= deadline {
            self.advance(self.next_look);
            self.look();
        }
        self.advance(deadline);
    }

    /// Runs until `deadline`, together with the further robots.
    fn advance(&mut self, deadline: Instant) {
        match self.team.is_empty() {
            true => self.advance_alone(deadline),
            false => self.advance_team(deadline),
        }
    }

    /// Runs the rig until `deadline`, and performs the due actions on robot and devices.
    fn advance_alone(&mut self, deadline: Instant) {
        loop {
            let push = self.pushes.first().map(|push| push.at.instant());
            let next = push.into_iter().chain(self.agenda.due());
            let next = next.chain(self.deeds.due()).min();
            let Some(at) = next.filter(|&at| at <= deadline) else {
                break;
            };
            self.rig.run_until(at);
            self.agenda.perform(&mut self.rig);
            self.do_deeds();
            if push.is_some_and(|push| push <= at) {
                let push = self.pushes.remove(0);
                let turn = push.turn_deg.to_radians();
                self.rig
                    .world
                    .push(push.by_m[0], push.by_m[1], turn, push.over.0);
            }
        }
        self.rig.run_until(deadline);
    }

    fn look(&mut self) {
        self.team.iter_mut().for_each(|member| member.run.look());
        self.next_look = self.rig.now() + LOOK_EVERY;
        self.begin_what_waited();
        self.do_what_waited();
        self.see_triggers();
        let contacts = self.rig.world.take_contacts();
        self.watchers.look(&self.rig, &*self.instruments, &contacts);
        self.contacts.extend(contacts);
        self.history.observe(&self.rig, &*self.instruments);
        #[cfg(feature = "programs")]
        if let Some(goes_on) = &mut self.goes_on {
            goes_on.observe(&self.rig);
        }
        let (now, pose) = (self.rig.now(), self.rig.world.pose());
        self.progress.observe(now, pose, self.rig.world.is_moving());
        self.looks += 1;
        // The time after the scenario's end is not judged, and the run may continue for days.
        if now > self.scenario.duration.instant() {
            return;
        }
        if (self.looks - 1).is_multiple_of(WAY_EVERY) {
            self.truth.push((now, pose));
        }
        if let Some((at, estimate)) = self.instruments.estimate(&self.rig)
            && self.pairs.last().is_none_or(|pair| pair.at < at)
        {
            let truth = self.nearest_truth(at, estimate);
            self.pairs.push(PosePair {
                at,
                truth,
                estimate,
            });
        }
    }

    /// The true pose for the comparison with an estimate of the time `at`.
    fn nearest_truth(&self, at: Instant, estimate: Pose) -> Pose {
        let age = self.instruments.estimate_age(&self.rig);
        let ago = (0..=u64::from(age.subsec_millis()))
            .step_by(10)
            .map(Duration::from_millis);
        let since = at - Instant::ZERO;
        let truths = ago.map(|ago| {
            let at = Instant::ZERO + since.saturating_sub(ago);
            self.rig.world.pose_at(at)
        });
        let apart = |pose: &Pose| pose.point().distance(estimate.point());
        let nearest = truths.min_by(|a, b| apart(a).total_cmp(&apart(b)));
        nearest.unwrap_or_else(|| self.rig.world.pose_at(at))
    }

    /// Runs to the end.
    pub fn finish(mut self) -> Outcome {
        while !self.is_over() {
            self.step();
        }
        self.judge()
    }

    /// Ends the run here and judges it.
    pub fn judge(self) -> Outcome {
        self.end(Self::wall_overlap)
    }

    /// Ends the run and judges it, for callers that read only the verdicts. Map and world are
    /// compared only if the scenario expects it, because the comparison takes as long as a second
    /// of the run.
    pub fn judge_what_is_expected(self) -> Outcome {
        self.end(Self::expected_overlap)
    }

    fn end(mut self, overlap: fn(&Self) -> Option<WallOverlap>) -> Outcome {
        let team = self.end_team(|run| run.end(overlap));
        let wall_overlap = overlap(&self);
        let mut outcome = self.outcome(wall_overlap);
        outcome.join(team);
        outcome
    }

    /// The verdicts as they would be if the run ended now.
    pub fn checks(&self) -> Vec<Check> {
        let pose_error = score::pose_error(&self.pairs);
        let mut checks = self.checks_with(pose_error, self.expected_overlap());
        checks.extend(self.team_checks());
        checks
    }

    fn checks_with(
        &self,
        pose_error: Option<PoseError>,
        wall_overlap: Option<WallOverlap>,
    ) -> Vec<Check> {
        let now = self.rig.now();
        let is_over = self.is_over || now >= self.scenario.duration.instant();
        let mut checks = self.watchers.verdicts(now, is_over);
        #[cfg(feature = "programs")]
        checks.extend(check::node_programs(&self.rig));
        #[cfg(feature = "described")]
        checks.extend(check::requests_answered(&self.rig, &self.scenario));
        checks.extend(check::fired(self.rig.events()));
        checks.extend(self.steps.checks(is_over));
        checks.extend(self.misnamed_faults());
        checks.extend(self.expectations(pose_error, wall_overlap, is_over));
        #[cfg(feature = "programs")]
        if let Some(goes_on) = &self.goes_on {
            let masters = check::unanswered(&self.rig, &self.scenario);
            let own = masters
                .iter()
                .filter(|master| goes_on.is_at(&self.rig, master));
            check::must_answer(&mut checks, own, &self.scenario.fault);
        }
        #[cfg(feature = "programs")]
        checks.extend(self.goes_on.as_ref().map(|goes_on| {
            let broken = own_breaks(&self.rig, &self.scenario.fault);
            let rest = check::Rest {
                is_over,
                checks: &checks,
                misunderstood: check::misunderstood(&broken),
                astray: check::astray(&broken, now),
            };
            goes_on.verdict(&self.rig, &rest)
        }));
        if let Some(safety) = &self.scenario.expect.safety {
            checks.iter_mut().for_each(|check| safety.excuse(check));
        }
        checks
    }
}

impl Paced for Run {
    fn rig(&mut self) -> &mut Rig {
        &mut self.rig
    }

    fn rig_of_mut(&mut self, robot: usize) -> &mut Rig {
        let member = robot.checked_sub(1).and_then(|it| self.team.get_mut(it));
        match member {
            Some(member) => &mut member.run.rig,
            None => &mut self.rig,
        }
    }

    /// Stops at the update at which the run is over, so that it ends in the same state at any pace.
    fn run_until(&mut self, deadline: Instant) {
        while !self.is_over && self.next_look() <= deadline {
            self.step();
        }
        if !self.is_over {
            self.advance(deadline);
        }
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::Command;

    use super::check::safety::puppet::scenario;
    use super::*;

    fn run(more: &str) -> Run {
        let (scenario, source) = scenario(more);
        Run::new(scenario, &source, None).expect("can be wired")
    }

    /// The path is kept each 50 ms from the first look at 10 ms on, and not after the end.
    #[test]
    fn the_path_is_kept_until_the_end() {
        let mut run = run("");
        run.scenario.duration = crate::scenario::Span::from_millis(260);
        run.go_on_until(Instant::from_millis(400));
        let times: Vec<u64> = run.truth.iter().map(|(at, _)| at.as_millis()).collect();
        assert_eq!(times, [10, 60, 110, 160, 210, 260]);
        assert_eq!((run.looks, run.next_look), (40, Instant::from_millis(410)));
    }

    /// The next look, or an earlier push, fault or step of the rig.
    #[test]
    fn nothing_disturbs_a_run_until_its_next_action() {
        let until = |more: &str| run(more).undisturbed_until().as_nanos() / 1_000;
        assert_eq!(until(""), 10_000);
        let push =
            |at: &str| format!("[[world.push]]\nat = \"{at}\"\nby_m = [0.1, 0]\nover = \"1ms\"\n");
        assert_eq!(until(&(push("11ms") + &push("7ms"))), 7_000);
        let off = "[[fault]]\nkind = \"off\"\ndevice = \"lidar\"\nfrom = \"4ms\"\n";
        assert_eq!(until(&(push("7ms") + off)), 4_000);
        let inject = "[mission]\nstep = [{ at = \"3ms\", do = { inject = { link = \"base\", \
                      direction = \"to-master\", hex = \"55\" } } }]\n";
        assert_eq!(until(inject), 3_000);
    }

    /// A push along x at 15 ms, which turns the robot to the left, and one along y at 35 ms, which
    /// the file names first.
    #[test]
    fn pushes_come_at_their_times() {
        let push = |at: u32, by_m: &str, turn: u32| {
            format!(
                "[[world.push]]\nat = \"{at}ms\"\nby_m = {by_m}\nturn_deg = {turn}\n\
                 over = \"100ms\"\n"
            )
        };
        let pose = |more: &str, millis: u64| {
            let mut run = run(more);
            run.go_on_until(Instant::from_millis(millis));
            run.rig.world.pose()
        };
        let first = push(15, "[0.1, 0]", 90);
        let both = push(35, "[0, 0.2]", 0) + &first;
        assert_eq!(pose(&both, 14), pose("", 14));
        let (alone, pushed) = (pose("", 17), pose(&both, 17));
        assert!(
            pushed.x > alone.x && pushed.theta > alone.theta,
            "{pushed:?}"
        );
        assert_eq!(pose(&both, 34), pose(&first, 34));
        assert!(pose(&both, 37).y > pose(&first, 37).y);
    }

    /// A robot whose estimate is the pose of so many milliseconds ago.
    struct Late {
        by_ms: u64,
        age_ms: u64,
    }

    impl Instruments for Late {
        fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
            let ago = Duration::from_millis(self.by_ms);
            let at = Instant::ZERO + (rig.now() - Instant::ZERO).saturating_sub(ago);
            Some((rig.now(), rig.world.pose_at(at)))
        }

        fn estimate_age(&self, _: &Rig) -> Duration {
            Duration::from_millis(self.age_ms)
        }
    }

    /// 0.2 m/s: a pose of 100 ms ago is 20 mm off. If the estimate may be as old as that, it is
    /// compared with the true pose of its own time, in steps of 10 ms.
    #[test]
    fn an_estimate_is_compared_with_the_nearest_pose_of_its_age() {
        let error = |by_ms: u64, age_ms: u64| {
            let (scenario, _) = scenario("");
            let rig = check::safety::tests::rig();
            let robot = Box::new(Late { by_ms, age_ms });
            let mut run = Run::with_rig(scenario, rig, robot);
            for wheel in ["left", "right"] {
                let speed = Command::Speed(0.2);
                run.rig.world.actuate(wheel, speed).expect("a wheel");
            }
            run.go_on_until(Instant::from_millis(800));
            assert_eq!(run.pairs.len(), 80);
            let last = run.pairs.last().expect("many");
            assert_eq!(last.at, Instant::from_millis(800));
            last.error_mm().round()
        };
        assert_eq!(
            [error(0, 0), error(100, 0), error(200, 0)],
            [0.0, 20.0, 40.0]
        );
        assert_eq!(
            [error(100, 100), error(100, 200), error(100, 50)],
            [0.0, 0.0, 10.0]
        );
        assert_eq!(error(200, 100), 20.0);
    }

    /// The last look is at the end of the run, even if it would be due later.
    #[test]
    fn a_run_ends_at_its_duration() {
        let mut run = run("");
        run.scenario.duration = crate::scenario::Span::from_millis(25);
        for (millis, is_over) in [(10, false), (20, false), (25, true)] {
            run.step();
            assert_eq!(
                (run.rig.now().as_millis(), run.is_over()),
                (millis, is_over)
            );
        }
        run.run_until(Instant::from_secs(9));
        assert_eq!(run.rig.now().as_millis(), 25);
        assert_eq!(run.finish().ran, Duration::from_millis(25));
    }

    /// A robot without a program that says whether its search has ended.
    struct Searcher {
        is_done: Option<bool>,
    }

    impl Instruments for Searcher {
        fn is_done(&self, _: &Rig) -> Option<bool> {
            self.is_done
        }
    }

    /// Milliseconds after which the run of a robot at rest is over, within its 300 ms; a rest is
    /// over after 50 ms.
    fn over_at(is_done: Option<bool>, expect: &str, mission: &str) -> u64 {
        let text = format!("[expect]\nsettle = \"50ms\"\n{expect}[mission]\n{mission}");
        let (mut scenario, _) = scenario(&text);
        scenario.duration = crate::scenario::Span::from_millis(300);
        let robot = Box::new(Searcher { is_done });
        let mut run = Run::with_rig(scenario, check::safety::tests::rig(), robot);
        while !run.is_over() {
            run.step();
        }
        run.rig.now().as_millis()
    }

    /// A search ends when the robot says so and has rested since the first look, if it has to come
    /// home. A waypoint at its start ends the mission as well. The run ends at the look at 60 ms,
    /// or at 300 ms.
    #[test]
    fn a_run_is_over_when_its_task_is_done() {
        let home = "home_within_mm = 100\n";
        assert_eq!(over_at(Some(true), home, ""), 60);
        assert_eq!(over_at(Some(false), home, ""), 300);
        assert_eq!(over_at(None, home, ""), 300);
        assert_eq!(over_at(Some(true), "", ""), 300);
        assert_eq!(over_at(Some(true), home, "to_the_end = true\n"), 300);
        let here = "waypoints_m = [[0.0, 0.0]]\n";
        assert_eq!(over_at(None, "", here), 60);
        assert_eq!(over_at(None, "", "waypoints_m = [[5.0, 0.0]]\n"), 300);
        // A map that the robot cannot send is not waited for.
        assert_eq!(over_at(None, "map_received = true\n", here), 60);
        assert_eq!(over_at(None, "map_received = false\n", here), 60);
        // A rule that must hold once, and holds never.
        let rule = "[[expect.rule]]\nname = \"far\"\n\
                    eventually = { robot = { of = \"x-m\", op = \">\", value = 5 } }\n";
        assert_eq!(over_at(None, "", &format!("{here}{rule}")), 300);
        // A step that waits for an event.
        let waits = "step = [{ when = { visited = 2 }, do = { mode = \"stop\" } }]\n";
        let two = "waypoints_m = [[0.0, 0.0], [5.0, 0.0]]\n";
        assert_eq!(over_at(Some(true), home, &format!("{two}{waits}")), 300);
    }

    /// The last order is given 5 s to arrive.
    #[test]
    fn a_robot_at_home_may_get_another_order() {
        let (mut scenario, _) = scenario("[expect]\nhome_within_mm = 9\nsettle = \"1ms\"\n");
        let step = |at_ms: u64| {
            let text = format!("step = [{{ at = \"{at_ms}ms\", do = {{ mode = \"stop\" }} }}]");
            let mission: crate::scenario::Mission = toml::from_str(&text).expect("a step");
            mission.step
        };
        scenario.mission.step = step(100);
        scenario.mission.step.extend(step(40));
        let robot = Box::new(Searcher {
            is_done: Some(true),
        });
        let mut run = Run::with_rig(scenario.clone(), check::safety::tests::rig(), robot);
        run.scenario.mission.step = scenario.mission.step;
        run.progress.observe(Instant::ZERO, Pose::default(), false);
        let nanos = Duration::from_nanos(1);
        let home = Instant::from_millis(5_100);
        assert!(run.has_come_home(home) && run.has_come_home(home + nanos));
        assert!(!run.has_come_home(Instant::from_millis(5_099)));
    }

    /// A run in pieces looks each 10 ms, also at the end of a piece.
    #[test]
    fn a_run_may_be_advanced_in_pieces() {
        let mut run = run("");
        for (until, looks) in [(25, 2), (29, 2), (30, 3), (31, 3), (60, 6)] {
            run.run_until(Instant::from_millis(until));
            assert_eq!((run.rig.now().as_millis(), run.looks), (until, looks));
        }
        assert!(!run.is_over());
    }

    /// A value may still come until the duration is over.
    #[test]
    fn a_missing_value_fails_at_the_end() {
        use super::check::Status;
        let (mut scenario, _) = scenario("[expect]\npose_rms_mm_max = 50\n");
        scenario.duration = crate::scenario::Span::from_millis(30);
        let robot = Box::new(Searcher { is_done: None });
        let mut run = Run::with_rig(scenario, check::safety::tests::rig(), robot);
        let statuses = [20, 30, 40].map(|millis| {
            run.go_on_until(Instant::from_millis(millis));
            let checks = run.checks();
            let own = checks.iter().find(|check| check.name == "pose-rms");
            own.map(|check| check.status)
        });
        let expected = [Status::NotObserved, Status::Fail, Status::Fail];
        assert_eq!(statuses, expected.map(Some));
    }

    /// A robot that estimated its pose once.
    struct Once;

    impl Instruments for Once {
        fn estimate(&self, _: &Rig) -> Option<(Instant, Pose)> {
            Some((Instant::from_millis(5), Pose::default()))
        }
    }

    #[test]
    fn an_estimate_is_compared_once() {
        let (scenario, _) = scenario("");
        let mut run = Run::with_rig(scenario, check::safety::tests::rig(), Box::new(Once));
        run.go_on_until(Instant::from_millis(50));
        assert_eq!(run.pairs.len(), 1);
    }
}
