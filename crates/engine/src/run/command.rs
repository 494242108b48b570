//! Orders to a running run. They become part of the scenario, so that the run can be repeated.

use protocols::Instant;

use super::Run;
use super::check::Status;
use crate::robots;
use crate::scenario::{Action, Expect, Scenario, Span, Step, TapSpec};

impl Run {
    /// Lets the PC execute `action`, within a millisecond to which the run advances. The action
    /// becomes a step of the scenario's mission, so that [`case`](Self::case) repeats it.
    ///
    /// # Errors
    /// If the rig has no PC, or the action exceeds the limits of its protocol.
    pub fn command(&mut self, action: Action) -> Result<(), CommandError> {
        let number = self.scenario.mission.step.len() + self.steps.by_hand.len() + 1;
        let at = self.order(number, action.clone())?;
        self.steps
            .by_hand
            .push(Step::at(Span(at - Instant::ZERO), action));
        self.go_on_until(at);
        Ok(())
    }

    /// Adds `action` to the PC's script for the next whole millisecond, and to the scenario's
    /// mission; returns this time.
    pub(super) fn order(&mut self, number: usize, action: Action) -> Result<Instant, CommandError> {
        if action.is_of_the_rig() {
            let possible = self.try_deed(&action);
            possible.map_err(|flaw| CommandError::Script(flaw.to_string()))?;
            let at = Span::from_millis(self.rig.now().as_millis() + 1).instant();
            self.deeds.add(at, number, action);
            return Ok(at);
        }
        if let Action::WaypointsM(places) = &action
            && let Some(message) = robots::beyond_map(&self.scenario.robot, places)
        {
            return Err(CommandError::Script(message));
        }
        let at = Span::from_millis(self.rig.now().as_millis() + 1);
        let step = Step::at(at, action);
        let steps = &mut self.scenario.mission.step;
        steps.sort_by_key(|step| step.at);
        let index = steps.partition_point(|other| other.at <= step.at);
        let station = self.instruments.station_mut(&mut self.rig);
        let station = station.ok_or(CommandError::NoStation)?;
        let inserted = station.insert_step(steps.len(), index, &step);
        inserted.map_err(CommandError::Script)?;
        steps.insert(index, step);
        self.watchers.ordered(at.instant());
        Ok(at.instant())
    }

    /// Taps on the robot's display at `place`, column and row, within a millisecond to which the
    /// run advances. The tap becomes part of the scenario, so that [`case`](Self::case) repeats it.
    ///
    /// # Errors
    /// If the robot has no display, or `place` is outside of it.
    pub fn tap(&mut self, place: [u16; 2]) -> Result<(), CommandError> {
        let display = self.instruments.display(&self.rig);
        let display = display.ok_or(CommandError::NoDisplay)?;
        let size = [display.width, display.height()];
        if place
            .map(usize::from)
            .iter()
            .zip(size)
            .any(|(&at, size)| at >= size)
        {
            return Err(CommandError::BesideDisplay { place, size });
        }
        let at = Span::from_millis(self.rig.now().as_millis() + 1);
        if !self.instruments.tap(&mut self.rig, at.instant(), place) {
            return Err(CommandError::NoDisplay);
        }
        let tap = TapSpec { at, place };
        self.scenario
            .device
            .values_mut()
            .for_each(|spec| spec.tap(tap));
        self.go_on_until(at.instant());
        Ok(())
    }

    /// The run until now as a scenario that repeats it. Results of the mission are expected only if
    /// the mission was over, because a shortened run cannot reach them.
    pub fn case_so_far(&self) -> Scenario {
        let mut case = self.case();
        case.duration = Span(self.rig.now() - Instant::ZERO);
        case.mission.to_the_end = true;
        // A rule that must hold once may hold only later.
        let checks = self.checks();
        let is_met = |name: &str| {
            let mut met = checks.iter().filter(|check| check.status == Status::Pass);
            met.any(|check| check.name == name)
        };
        case.expect.rule.retain(|rule| {
            let rule = rule.get_ref();
            !rule.is_of_the_end() || is_met(&rule.check_name())
        });
        let [done, wanted] = [self.progress.visits().len(), self.progress.waypoints()];
        if done < wanted || self.instruments.is_done(&self.rig) == Some(false) {
            case.expect = Expect {
                visit_within_mm: None,
                return_within_mm: None,
                home_within_mm: None,
                explored_min: None,
                victims_within_mm: None,
                settle: None,
                wall_overlap_min: None,
                map_received: None,
                ..case.expect
            };
        }
        case
    }
}

/// Reason why the PC cannot execute the order.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// The rig has no station of its own.
    #[error("the rig has no PC, because the PC's end is a port")]
    NoStation,
    /// The protocol does not allow the order.
    #[error("{0}")]
    Script(String),
    /// The robot has no display.
    #[error("the robot has no display")]
    NoDisplay,
    /// The position is outside of the display.
    #[error(
        "{}, {} is not on the display of {} x {} pixels",
        .place[0], .place[1], .size[0], .size[1]
    )]
    BesideDisplay {
        /// Column and row.
        place: [u16; 2],
        /// Columns and rows of the display.
        size: [usize; 2],
    },
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::run::check::Check;
    use crate::scenario::SetPoint;

    fn drive(wheels: [i8; 2]) -> Action {
        Action::Drive(SetPoint::list(wheels))
    }

    fn run(more: &str) -> Run {
        let text = format!(
            "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"60s\"\n{more}\n\
             [world]\nstart = {{ x_m = 1.5, y_m = 1.2, heading_deg = 90 }}\n[[world.wall]]\n\
             path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n"
        );
        let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("sound");
        Run::new(scenario, &source, None).expect("can be wired")
    }

    fn again(case: &Scenario) -> Run {
        let path = Path::new("<case>");
        let (case, source) = Scenario::parse(path, case.to_toml()).expect("a case is a scenario");
        Run::new(case, &source, None).expect("can be wired")
    }

    /// Manual actions at any time, between the steps of the scenario, are repeated at the same
    /// nanosecond: every byte of the run is the same.
    #[test]
    fn a_session_by_hand_can_be_repeated_byte_by_byte() {
        let mut run = run(
            "[mission]\nstep = [{ at = \"6s\", do = { mode = \"stop\" } }, \
                           { at = \"3s\", do = { mode = \"exploration\" } }]",
        );
        run.go_on_until(Instant::from_nanos(2_500_000_123));
        run.command(Action::WaypointsM(vec![[1.8, 1.8], [0.02, 0.5]]))
            .expect("has a PC");
        run.go_on_until(Instant::from_nanos(4_000_000_777));
        run.command(drive([10, -10])).expect("has a PC");
        run.command(drive([0, 0])).expect("has a PC");
        run.go_on_until(Instant::from_secs(8));
        run.command(Action::Disconnect).expect("has a PC");
        run.go_on_until(Instant::from_secs(10));

        let case = run.case_so_far();
        let times: Vec<u64> = case
            .mission
            .step
            .iter()
            .map(|s| s.at.expect("a time").instant().as_millis())
            .collect();
        // These steps follow those of the scenario, in their order.
        assert_eq!(times, [6_000, 3_000, 2_501, 4_001, 4_002, 8_001]);
        let outcome = again(&case).finish();
        assert_eq!(outcome.trace_hash, run.rig.trace_hash());
        assert_eq!(outcome.ran.as_nanos(), 10_000_000_000);
    }

    /// The robot rests at its goal, and 2 s of rest end a mission. But one step waits for an event
    /// at 2.5 s, and another step waits for the effect of the first.
    #[test]
    fn a_mission_that_waits_for_something_is_repeated_byte_by_byte() {
        let mut run = run("[mission]\nwaypoints_m = [[1.5, 1.2]]\nstep = [\
             { at = \"2500ms\", do = { mode = \"stop\" } }, \
             { when = { visited = 1 }, do = { drive = [10, 10] } }, \
             { when = { pose = { near_m = [1.5, 1.5], within_m = 0.1 } }, do = { drive = [0, 0] } }]");
        run.go_on_until(Instant::from_millis(1_500));
        run.command(Action::Connect).expect("has a PC");
        while !run.is_over() {
            run.step();
        }
        let (case, ran) = (run.case(), run.rig.now());
        assert!(ran > Instant::from_secs(4), "{ran}");
        assert_eq!(case.mission.step.len(), 4);
        let outcome = again(&case).finish();
        let checks = |checks: &[Check]| checks.iter().map(Check::to_string).collect::<Vec<_>>();
        assert_eq!(outcome.trace_hash, run.rig.trace_hash());
        assert_eq!(checks(&outcome.checks), checks(&run.checks()));
    }

    /// U11: a session saved two seconds after its start has reached no goal. A repetition must not
    /// fail for that reason; rules that hold at any time are still expected.
    #[test]
    fn u11_a_session_saved_early_does_not_fail_of_its_mission() {
        let mut run = run(
            "[mission]\nwaypoints_m = [[2.0, 2.0], [1.0, 2.0]]\n[expect]\nvisit_within_mm = 100\n\
             return_within_mm = 100\nsettle = \"1s\"\nwall_overlap_min = 0.9\n\
             map_received = true\nhome_within_mm = 100\nexplored_min = 0.9\n\
             victims_within_mm = 100\nviolations_max = 0",
        );
        run.go_on_until(Instant::from_secs(2));
        let case = run.case_so_far();
        let expect = &case.expect;
        assert_eq!(
            (expect.visit_within_mm, expect.return_within_mm),
            (None, None)
        );
        assert_eq!((expect.settle, expect.wall_overlap_min), (None, None));
        assert_eq!((expect.home_within_mm, expect.explored_min), (None, None));
        assert_eq!(expect.victims_within_mm, None);
        assert_eq!(
            (expect.map_received, expect.violations_max),
            (None, Some(0))
        );
        let outcome = again(&case).finish();
        let names = |status| {
            let of = outcome
                .checks
                .iter()
                .filter(move |check| check.status == status);
            of.map(|check| check.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(names(Status::Fail), [""; 0]);
        assert!(names(Status::Pass).contains(&"violations".to_owned()));
        // Without the change the run would fail.
        let failed =
            |check: &&Check| check.name == "waypoints-visited" && check.status == Status::Fail;
        assert!(run.judge().checks.iter().any(|check| failed(&check)));
    }

    /// Taps of the scenario and by hand, also faster than a finger, are repeated exactly.
    #[test]
    fn taps_by_hand_are_repeated_byte_by_byte() {
        let mut run = run("[[device.display.touch-panel.tap]]\nat = \"4s\"\nplace = [410, 50]");
        run.go_on_until(Instant::from_nanos(2_500_000_123));
        for place in [[410, 130], [60, 80], [150, 120], [280, 50]] {
            run.tap(place).expect("has a display");
        }
        run.go_on_until(Instant::from_nanos(3_999_500_000));
        run.tap([240, 256]).expect("has a display");
        assert!(run.tap([480, 0]).is_err());
        run.go_on_until(Instant::from_secs(6));
        let outcome = again(&run.case_so_far()).finish();
        assert_eq!(outcome.trace_hash, run.rig.trace_hash());
        assert_eq!(
            outcome.display,
            run.instruments
                .display(&run.rig)
                .map(|display| display.picture())
        );
    }

    /// A run gives the same result if it is observed, and if it is advanced in other steps.
    #[test]
    fn a_run_that_nobody_touches_is_the_one_without_a_hand() {
        let (mut alone, mut watched) = (run(""), run(""));
        alone.go_on_until(Instant::from_secs(5));
        for nanos in (0..5_000_000_000).step_by(3_700_001) {
            watched.go_on_until(Instant::from_nanos(nanos));
        }
        watched.go_on_until(Instant::from_secs(5));
        assert_eq!(watched.rig.trace_hash(), alone.rig.trace_hash());
    }

    #[test]
    fn a_list_that_fits_no_frame_is_refused_and_leaves_no_step() {
        let mut run = run("");
        let error = run
            .command(Action::WaypointsM(vec![[1.0, 1.0]; 101]))
            .expect_err("100 fit");
        assert!(error.to_string().contains("101 waypoints"), "{error}");
        assert_eq!(run.case_so_far().mission.step, []);
        assert!(run.command(Action::Mode("stop".to_owned())).is_ok());
    }

    /// Columns and rows count from 0.
    #[test]
    fn a_tap_is_on_the_display() {
        let tap = "[[device.display.touch-panel.tap]]\nat = \"40s\"\nplace = [410, 50]";
        let mut run = run(tap);
        run.go_on_until(Instant::from_secs(2));
        let display = run.instruments.display(&run.rig).expect("it has one");
        let [width, height] = [display.width, display.height()];
        let at = |size: usize| u16::try_from(size).expect("a small display");
        let refused = |run: &mut Run, place| run.tap(place).expect_err("beside it").to_string();
        let words = |place: [usize; 2]| {
            format!(
                "{}, {} is not on the display of {width} x {height} pixels",
                place[0], place[1]
            )
        };
        assert_eq!(refused(&mut run, [at(width), 0]), words([width, 0]));
        assert_eq!(refused(&mut run, [0, at(height)]), words([0, height]));
        assert_eq!(run.rig.now(), Instant::from_secs(2));
        run.tap([at(width) - 1, at(height) - 1])
            .expect("the last pixel");
        // A tap is at the next whole millisecond.
        assert_eq!(run.rig.now(), Instant::from_millis(2_001));
        assert!(run.tap([0, 0]).is_ok());
        assert_eq!(run.rig.now(), Instant::from_millis(2_002));
    }

    /// A robot without a PC and without a display.
    #[test]
    fn a_bench_takes_no_orders() {
        let text = "schema = 1\nname = \"t\"\nrobot = \"none\"\nduration = \"9s\"\n\
                    device.sonar.text.baud = 9600\ndevice.sonar.text.command = []\n";
        let (scenario, source) = Scenario::from_text(text).expect("sound");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        let refused = run.command(Action::Connect).expect_err("no PC").to_string();
        assert_eq!(refused, "the rig has no PC, because the PC's end is a port");
        let refused = run.tap([0, 0]).expect_err("no display").to_string();
        assert_eq!(refused, "the robot has no display");
    }
}
