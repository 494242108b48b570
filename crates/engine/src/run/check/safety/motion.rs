//! Compares the motion that the robot's dead reckoning measures with its true motion.

use core::time::Duration;
use std::sync::Arc;

use emulators::world::{Pose, wrap_angle};
use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use crate::rig::Rig;
use crate::robots::Instruments;
use crate::scenario::{FaultSpec, Scenario};

/// Length of a section of the motion.
const SECTION: Duration = Duration::from_millis(500);
/// Time after a contact or the start of a push in which wheels may slip.
const SLIPS: Duration = Duration::from_secs(3);
/// Minimum motion of a section that counts, metres and radians; a shorter one is rest or noise.
const LEAST: [f64; 2] = [0.03, 0.05];
/// Minimum motion of a run for an exact verdict: 1.2 m of path, a turn of 200 degrees.
const ENOUGH: [f64; 2] = [1.2, 3.5];
/// Minimum motion for a rough verdict, metres and radians, and its permitted error as a share: only
/// a wrong unit or sign exceeds it.
const SOME: [f64; 2] = [0.3, 0.3];
const ROUGH: f64 = 0.5;
/// Maximum motion measured at rest, metres and radians: 300 mm and 45 degrees, and 0.3 degrees more
/// for each second of rest, because a gyroscope's bias drifts.
const AT_REST: [f64; 2] = [0.3, 0.8];
const AT_REST_PER_S: [f64; 2] = [0.0, 0.005];
/// Permitted measured motion to one side in curves: a share of the distance between the curves and
/// their tangents, but at least `DRIFT_M` metres. A pose that leaves each curve on the wrong side
/// drifts by twice this distance.
const DRIFT: f64 = 0.5;
const DRIFT_M: f64 = 0.1;
/// Names and units of path and turn.
const NAMES: [(&str, &str); 2] = [("path", "m"), ("turns", "rad")];

/// The robot's dead reckoning measures its true path and turns, while no fault acts on its sensors
/// and no contact makes its wheels slip.
#[derive(Clone)]
pub struct MotionTrue {
    instruments: Arc<dyn Instruments>,
    calm: Calm,
    pushes: Vec<Instant>,
    /// Permitted error, a share of the motion.
    within: f64,
    /// Start of the current section: time, measured pose, true pose.
    begin: Option<(Instant, Pose, Pose)>,
    /// Number of poses that another source has set.
    anew: u64,
    touched_at: Option<Instant>,
    sums: [Sums; 2],
    /// Distance between the curves and their tangents, and the measured motion to the inner side of
    /// the curve beyond the true one, metres.
    curved: f64,
    drift: f64,
}

/// Sums over the sections for path or turn.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Measured times true motion, and the square of the true one.
    products: f64,
    squares: f64,
    /// True motion, and the motion measured at rest.
    travel: f64,
    at_rest: f64,
    /// Number of sections at rest.
    rests: f64,
}

impl Sums {
    fn take(&mut self, measured: f64, truth: f64, least: f64) {
        if truth.abs() < least {
            let is_rest = truth.abs() < least / 20.0;
            if is_rest {
                self.at_rest += measured.abs();
                self.rests += 1.0;
            }
            return;
        }
        self.products += measured * truth;
        self.squares += truth * truth;
        self.travel += truth.abs();
    }

    /// The measured share of the true motion.
    fn gain(&self) -> f64 {
        self.products / self.squares
    }
}

impl MotionTrue {
    /// Observes a robot while the links of its sensors are `calm`; its dead reckoning may be wrong
    /// by `percent`.
    pub fn new(
        scenario: &Scenario,
        instruments: Arc<dyn Instruments>,
        percent: f64,
        calm: Calm,
    ) -> Self {
        let pushes = scenario.world.push.iter().map(|push| push.at.instant());
        Self {
            instruments,
            calm,
            pushes: pushes.collect(),
            within: percent / 100.0,
            begin: None,
            anew: 0,
            touched_at: None,
            sums: [Sums::default(); 2],
            curved: 0.0,
            drift: 0.0,
        }
    }

    /// Adds a section in a curve: a pose in a curve moves along its chord, and not beside it.
    fn curve(&mut self, [path, turn, _]: [f64; 3], measured: f64, truth: f64) {
        if path.abs() < LEAST[0] || turn.abs() < LEAST[1] {
            return;
        }
        self.curved += (path * turn / 2.0).abs();
        self.drift += (measured - truth) * (path * turn).signum();
    }

    /// The drift to one side, if it is too large.
    fn drifts(&self) -> Option<String> {
        let is_wrong = self.drift.abs() > (self.curved * DRIFT).max(DRIFT_M);
        is_wrong.then(|| {
            let side = if self.drift > 0.0 { "inner" } else { "outer" };
            let mm = self.drift.abs() * 1000.0;
            format!("{mm:.0} mm of motion to the {side} side of curves are measured, not true")
        })
    }

    fn is_disturbed(&self, now: Instant) -> bool {
        let is_recent = |at: Instant| now >= at && now - at < SLIPS;
        !self.calm.is(now)
            || self.touched_at.is_some_and(is_recent)
            || self.pushes.iter().any(|&at| is_recent(at))
    }

    /// The first contradiction.
    fn wrong(&self) -> Option<String> {
        let all = self.sums.iter().zip(NAMES).zip(0..);
        let mut all = all.filter_map(|((sums, (name, unit)), index): (_, usize)| {
            let gain = sums.gain();
            let within = match sums.travel {
                travel if travel >= ENOUGH[index] => self.within,
                travel if travel >= SOME[index] => self.within.max(ROUGH),
                _ => f64::INFINITY,
            };
            let rested_s = sums.rests * SECTION.as_secs_f64();
            let at_rest = AT_REST[index] + AT_REST_PER_S[index] * rested_s;
            if (gain - 1.0).abs() > within {
                let (share, travel) = (gain * 100.0, sums.travel);
                let told =
                    format!("{share:.0} % of the {name} are measured, of {travel:.1} {unit}");
                return Some(told);
            }
            let moved = sums.at_rest;
            (moved > at_rest).then(|| format!("{moved:.1} {unit} of {name} are measured at rest"))
        });
        all.next().or_else(|| self.drifts())
    }
}

/// Path ahead, turn, and motion to the left from one pose to another.
fn motion(from: Pose, to: Pose) -> [f64; 3] {
    let turn = wrap_angle(to.theta - from.theta);
    // The chord of an arc lies at half of its turn.
    let chord = from.theta + turn / 2.0;
    let (sin, cos) = (libm::sin(chord), libm::cos(chord));
    let (x, y) = (to.x - from.x, to.y - from.y);
    [x * cos + y * sin, turn, y * cos - x * sin]
}

impl Checker for MotionTrue {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        if !look.contacts.is_empty() || rig.world.is_touching() {
            self.touched_at = Some(now);
        }
        let anew = self.instruments.reckoned_anew(rig);
        let is_set = core::mem::replace(&mut self.anew, anew) != anew;
        if is_set || self.is_disturbed(now) {
            self.begin = None;
            return;
        }
        let is_within = |(at, ..): &(Instant, Pose, Pose)| now - *at < SECTION;
        if self.begin.as_ref().is_some_and(is_within) {
            return;
        }
        let Some((at, measured)) = self.instruments.reckoned(rig) else {
            return;
        };
        let truth = rig.world.pose_at(at);
        let before = self.begin.replace((at, measured, truth));
        let Some((_, measured_before, truth_before)) = before.filter(|before| before.0 < at) else {
            return;
        };
        let measured = motion(measured_before, measured);
        let truth = motion(truth_before, truth);
        self.curve(truth, measured[2], truth[2]);
        let pairs = measured.into_iter().zip(truth);
        for ((sums, (measured, truth)), least) in self.sums.iter_mut().zip(pairs).zip(LEAST) {
            sums.take(measured, truth, least);
        }
    }

    fn verdict(&self) -> Check {
        let wrong = self.wrong();
        let is_judged = self.sums.iter().zip(SOME);
        let is_judged = is_judged.filter(|(sums, enough)| sums.travel >= *enough);
        let is_judged = is_judged.count() > 0;
        let is_right = wrong.is_none();
        let detail = wrong.unwrap_or_else(|| match is_judged {
            false => "too little motion without faults and contacts".to_owned(),
            true => {
                let [path, turns] = self.sums.map(|sums| sums.gain() * 100.0);
                let [m, rad] = self.sums.map(|sums| sums.travel);
                format!("{path:.1} % of {m:.1} m, {turns:.1} % of {rad:.1} rad are measured")
            }
        });
        Check::new("motion-true", is_right, detail).if_observed(is_judged)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, SQRT_2};

    use super::*;

    /// A quarter of a circle of radius 1 has the chord of a right angle; backwards is negative.
    #[test]
    fn a_motion_is_a_path_ahead_and_a_turn() {
        let origin = Pose::new(0.0, 0.0, 0.0);
        let near = |found: [f64; 3], expected: [f64; 3]| {
            let mut pairs = found.iter().zip(expected);
            assert!(
                pairs.all(|(one, other)| (one - other).abs() < 1e-9),
                "{found:?}"
            );
        };
        near(
            motion(origin, Pose::new(1.0, 1.0, FRAC_PI_2)),
            [SQRT_2, FRAC_PI_2, 0.0],
        );
        near(motion(origin, Pose::new(-0.1, 0.0, 0.0)), [-0.1, 0.0, 0.0]);
        let tilted = Pose::new(2.0, 3.0, FRAC_PI_2);
        near(
            motion(tilted, Pose::new(2.0, 3.5, FRAC_PI_2)),
            [0.5, 0.0, 0.0],
        );
        near(
            motion(tilted, Pose::new(1.9, 3.0, FRAC_PI_2)),
            [0.0, 0.0, 0.1],
        );
    }

    /// Nine tenths, the wrong sign, and motion at rest; a motion between rest and the least one
    /// does not count.
    #[test]
    fn a_gain_is_the_measured_share_of_the_motion() {
        let gain = |share: f64| {
            let mut sums = Sums::default();
            for truth in [1.0, -0.5, 0.2] {
                sums.take(share * truth, truth, 0.03);
            }
            sums.take(5.0, 0.02, 0.03);
            assert!((sums.travel - 1.7).abs() < 1e-9 && sums.at_rest == 0.0);
            sums.gain()
        };
        assert!((gain(0.9) - 0.9).abs() < 1e-9 && (gain(-1.0) + 1.0).abs() < 1e-9);
        let mut resting = Sums::default();
        for measured in [0.4, -0.4] {
            resting.take(measured, 0.0, 0.03);
        }
        assert!((resting.at_rest - 0.8).abs() < 1e-9 && resting.travel == 0.0);
    }

    /// Twenty sections of a curve, 0.1 m and 0.2 rad each: the curve leaves its tangents by 0.2 m
    /// in all. A pose that goes to the wrong side drifts by 0.4 m, a straight one by 0.2 m. An
    /// error of 2 mm in each section is no drift.
    #[test]
    fn a_pose_that_leaves_curves_to_the_wrong_side_drifts() {
        let unknown: Arc<dyn Instruments> = Arc::new(crate::robots::instruments::Unknown);
        let (scenario, _) = Scenario::from_text(
            "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
             [world]\nstart = { x_m = 1, y_m = 1, heading_deg = 0 }\n",
        )
        .expect("sound");
        let drifts = |measured: f64| {
            let calm = Calm::default();
            let mut motion = MotionTrue::new(&scenario, Arc::clone(&unknown), 5.0, calm);
            for turn in [0.2, -0.2].repeat(10) {
                motion.curve([0.1, turn, 0.0], measured * turn.signum(), 0.0);
            }
            motion.drifts()
        };
        let wrong = drifts(-0.02).expect("a wrong side");
        assert!(
            wrong.starts_with("400 mm of motion to the outer side"),
            "{wrong}"
        );
        assert!(drifts(-0.01).is_some());
        assert_eq!([drifts(0.002), drifts(0.0)], [None, None]);
    }

    fn unmoved() -> MotionTrue {
        let (scenario, _) = super::super::puppet::scenario("");
        let unknown: Arc<dyn Instruments> = Arc::new(crate::robots::instruments::Unknown);
        MotionTrue::new(&scenario, unknown, 5.0, Calm::default())
    }

    /// The error of a motion of this length, of which a share is measured: path or turns.
    fn wrong(index: usize, travel: f64, gain: f64) -> Option<String> {
        let mut motion = unmoved();
        motion.sums[index] = Sums {
            products: gain * 2.0,
            squares: 2.0,
            travel,
            ..Sums::default()
        };
        motion.wrong()
    }

    /// 5 % of 1.2 m or 3.5 rad; half of 0.3 m or 0.3 rad; nothing is known of less.
    #[test]
    fn the_longer_a_motion_the_smaller_its_error() {
        let told = |index, travel, gain| wrong(index, travel, gain).is_some();
        for (index, enough) in [(0, 1.2), (1, 3.5)] {
            assert_eq!(
                [0.94, 0.96, 1.04, 1.06].map(|gain| told(index, enough, gain)),
                [true, false, false, true]
            );
            let less = enough - 0.01;
            assert_eq!(
                [0.49, 0.51, 1.49, 1.51].map(|gain| told(index, less, gain)),
                [true, false, false, true]
            );
            assert_eq!(
                [0.51, 1.51].map(|gain| told(index, 0.3, gain)),
                [false, true]
            );
            assert_eq!([0.0, 9.0].map(|gain| told(index, 0.29, gain)), [false; 2]);
        }
        let path = "106 % of the path are measured, of 1.2 m";
        assert_eq!(wrong(0, 1.2, 1.06).as_deref(), Some(path));
        let turns = "94 % of the turns are measured, of 3.5 rad";
        assert_eq!(wrong(1, 3.5, 0.94).as_deref(), Some(turns));
        let mut rough = unmoved();
        rough.within = 0.6;
        rough.sums[0] = Sums {
            products: 1.55,
            squares: 1.0,
            travel: 0.5,
            ..Sums::default()
        };
        assert_eq!(rough.wrong(), None);
    }

    /// At rest 300 mm and 0.8 rad may be measured, and 0.005 rad for each second: 0.25 rad in 100
    /// sections of half a second.
    #[test]
    fn little_is_measured_at_rest() {
        let told = |index: usize, at_rest: f64, rests: f64| {
            let mut motion = unmoved();
            (motion.sums[index].at_rest, motion.sums[index].rests) = (at_rest, rests);
            motion.wrong()
        };
        assert_eq!([told(0, 0.3, 0.0), told(1, 0.8, 0.0)], [None, None]);
        let path = "0.4 m of path are measured at rest";
        assert_eq!(told(0, 0.36, 100.0).as_deref(), Some(path));
        assert_eq!(told(1, 1.04, 100.0), None);
        let turns = "1.1 rad of turns are measured at rest";
        assert_eq!(told(1, 1.06, 100.0).as_deref(), Some(turns));
    }

    /// Below a twentieth of the least motion is rest: 1.5 mm of 30 mm.
    #[test]
    fn a_section_is_motion_rest_or_neither() {
        let taken = |truth: f64| {
            let mut sums = Sums::default();
            sums.take(0.5, truth, 0.03);
            (sums.travel > 0.0, sums.rests, sums.at_rest)
        };
        assert_eq!([taken(0.03), taken(-0.03)], [(true, 0.0, 0.0); 2]);
        assert_eq!([taken(0.029), taken(0.0016)], [(false, 0.0, 0.0); 2]);
        assert_eq!([taken(0.0014), taken(-0.0014)], [(false, 1.0, 0.5); 2]);
        let mut sums = Sums::default();
        sums.take(0.1, 0.2, 0.03);
        sums.take(-0.3, -0.5, 0.03);
        assert!((sums.products - 0.17).abs() < 1e-12 && (sums.squares - 0.29).abs() < 1e-12);
        assert!((sums.travel - 0.7).abs() < 1e-12);
    }

    /// A section of 30 mm and 0.05 rad is a curve: half of their product lies between it and its
    /// tangent. Motion to the left is inside of a curve to the left.
    #[test]
    fn curves_have_an_inner_side() {
        let curve = |path: f64, turn: f64| {
            let mut motion = unmoved();
            motion.curve([path, turn, 0.0], 0.02, 0.005);
            (motion.curved, motion.drift)
        };
        assert_eq!(curve(0.03, 0.05), (0.03 * 0.05 / 2.0, 0.015));
        assert_eq!([curve(0.029, 0.05), curve(0.03, 0.049)], [(0.0, 0.0); 2]);
        assert_eq!(curve(-0.1, 0.2), (0.1 * 0.2 / 2.0, -0.015));
        assert_eq!(curve(-0.1, -0.2).1, 0.015);
        let drifts = |drift: f64, curved: f64| {
            let mut motion = unmoved();
            (motion.drift, motion.curved) = (drift, curved);
            motion.drifts()
        };
        assert_eq!([drifts(0.1, 0.0), drifts(0.5, 1.0)], [None, None]);
        let inner = "110 mm of motion to the inner side of curves are measured, not true";
        assert_eq!(drifts(0.11, 0.0).as_deref(), Some(inner));
        let outer = "510 mm of motion to the outer side of curves are measured, not true";
        assert_eq!(drifts(-0.51, 1.0).as_deref(), Some(outer));
        let mut motion = unmoved();
        motion.drift = 1.0;
        assert!(
            motion
                .wrong()
                .is_some_and(|told| told.starts_with("1000 mm"))
        );
    }

    /// Wheels may slip in the 3 s after a contact or the start of a push.
    #[test]
    fn a_contact_and_a_push_disturb_for_three_seconds() {
        let at = Instant::from_millis;
        let disturbed = |motion: &MotionTrue| {
            [9_999, 10_000, 12_999, 13_000].map(|millis| motion.is_disturbed(at(millis)))
        };
        let mut touched = unmoved();
        touched.touched_at = Some(at(10_000));
        assert_eq!(disturbed(&touched), [false, true, true, false]);
        let mut pushed = unmoved();
        pushed.pushes = vec![at(90_000), at(10_000)];
        assert_eq!(disturbed(&pushed), [false, true, true, false]);
        let push = "[[world.push]]\nat = \"10s\"\nby_m = [0.1, 0]\nover = \"100ms\"\n";
        let (scenario, _) = super::super::puppet::scenario(push);
        let unknown: Arc<dyn Instruments> = Arc::new(crate::robots::instruments::Unknown);
        let calm = Calm::default();
        let planned = MotionTrue::new(&scenario, unknown, 5.0, calm);
        assert_eq!(disturbed(&planned), [false, true, true, false]);
        assert_eq!(disturbed(&unmoved()), [false; 4]);
    }

    /// A robot whose dead reckoning measures this share of its path, and is set this many times.
    #[derive(Clone)]
    struct Reckoning(f64, crate::Shared<u64>);

    impl Instruments for Reckoning {
        fn reckoned(&self, rig: &Rig) -> Option<(Instant, Pose)> {
            let pose = rig.world.pose();
            Some((rig.now(), Pose::new(self.0 * pose.x, pose.y, pose.theta)))
        }

        fn reckoned_anew(&self, _: &Rig) -> u64 {
            *self.1.lock()
        }
    }

    /// 0.2 m/s for 10 s are 2 m; `each` is called before each look, 100 ms apart.
    fn driven(share: f64, mut each: impl FnMut(&mut MotionTrue, &Reckoning, &Rig)) -> MotionTrue {
        use emulators::world::Command;
        let (mut rig, _) = super::super::tests::linked("base");
        rig.world = super::super::tests::rig().world;
        let (scenario, _) = super::super::puppet::scenario("");
        let calm = Calm::of(&scenario, &rig, &|_| true);
        let robot = Reckoning(share, crate::Shared::new(0));
        let mut motion = MotionTrue::new(&scenario, Arc::new(robot.clone()), 5.0, calm);
        for tenth in 1..=101 {
            for wheel in ["left", "right"] {
                let speed = Command::Speed(0.2);
                rig.world.actuate(wheel, speed).expect("a wheel");
            }
            each(&mut motion, &robot, &rig);
            super::super::tests::look_at(&mut motion, &mut rig, 100 * tenth, 0.0);
        }
        motion
    }

    #[test]
    fn a_path_that_is_measured_too_short_is_told() {
        use crate::robots::checker::Status;
        let told = |share| {
            let check = driven(share, |_, _, _| {}).verdict();
            (check.status, check.detail)
        };
        let (status, detail) = told(1.0);
        assert_eq!(status, Status::Pass);
        assert!(detail.starts_with("100.0 % of 2.0 m, "), "{detail}");
        let words = "90 % of the path are measured, of 2.0 m".to_owned();
        assert_eq!(told(0.9), (Status::Fail, words));
        // Sections of half a second: 20 of them in ten seconds, 100 mm each.
        let motion = driven(1.0, |_, _, _| {});
        assert!(
            (motion.sums[0].squares - 20.0 * 0.01).abs() < 0.005,
            "{:?}",
            motion.sums
        );
    }

    /// A pose that is set again and again, or a fault to the end.
    #[test]
    fn motion_is_not_judged_while_it_is_disturbed() {
        use super::super::puppet::cut;
        use crate::robots::checker::Status;
        let little = "too little motion without faults and contacts";
        let set = driven(0.5, |_, robot, _| *robot.1.lock() += 1);
        let faulted = driven(0.5, |motion, _, rig| {
            motion.faults_changed(&[cut("base", 0, 50)], rig)
        });
        for motion in [set, faulted] {
            let check = motion.verdict();
            assert_eq!(
                (check.status, &*check.detail),
                (Status::NotObserved, little)
            );
        }
        // Once, at 5.1 s, costs the section until then, and a part of the last one: 18 remain.
        let mut calls = 0;
        let once = driven(1.0, |_, robot, _| {
            calls += 1;
            *robot.1.lock() = u64::from(calls > 50);
        });
        assert!(
            (1.75..1.85).contains(&once.sums[0].travel),
            "{:?}",
            once.sums[0]
        );
    }
}
