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
}
