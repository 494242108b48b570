//! Compares the pose that the robot believes with its true one.

use core::time::Duration;
use std::sync::Arc;

use emulators::world::wrap_angle;
use protocols::Instant;

use super::super::{Check, Checker, HARMLESS_M_S, Look};
use super::Undisturbed;
use crate::rig::Rig;
use crate::robots::Instruments;
use crate::scenario::FaultSpec;

/// Maximum error of the heading, degrees, if the robot names none.
const TURNED_MAX: f64 = 20.0;
/// Duration of an error that fails: a scan may be matched wrongly for a moment.
const LASTING: Duration = Duration::from_secs(3);

/// The robot believes a pose near its true one, as long as no fault, push or contact disturbs its
/// sensors.
#[derive(Clone)]
pub struct PoseBelieved {
    instruments: Arc<dyn Instruments>,
    within_m: f64,
    within_rad: f64,
    quiet: Undisturbed,
    /// Whether a person drives: after a gentle touch, the person may continue to push the robot.
    is_by_hand: bool,
    judged: u64,
    last: Option<Instant>,
    /// Start of the current error.
    wrong_since: Option<Instant>,
    worst_m: f64,
    broken: Option<(Instant, f64, f64)>,
}

impl PoseBelieved {
    /// Judges a robot while it is undisturbed; the error may be `within_mm`, or less if the robot
    /// is more accurate.
    pub fn new(instruments: Arc<dyn Instruments>, within_mm: f64, quiet: Undisturbed) -> Self {
        let [own_mm, own_deg] = instruments.accuracy().unwrap_or([within_mm, TURNED_MAX]);
        Self {
            instruments,
            within_m: own_mm.min(within_mm) / 1000.0,
            within_rad: own_deg.to_radians(),
            quiet,
            is_by_hand: false,
            judged: 0,
            last: None,
            wrong_since: None,
            worst_m: 0.0,
            broken: None,
        }
    }

    /// The same for a robot that a person may drive: each touch is a disturbance.
    pub const fn by_hand(mut self, is_by_hand: bool) -> Self {
        self.is_by_hand = is_by_hand;
        self
    }

    fn is_over(&self, now: Instant) -> bool {
        self.broken.is_some() || self.quiet.is_over(now)
    }
}

impl Checker for PoseBelieved {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        let least_m_s = if self.is_by_hand { 0.0 } else { HARMLESS_M_S };
        let is_hit = |contact: &emulators::world::Contact| contact.own_m_s > least_m_s;
        if look.contacts.iter().any(is_hit) {
            self.quiet.hit_at(now);
        }
        if self.is_over(now) {
            return;
        }
        let Some((at, believed)) = self.instruments.estimate(rig) else {
            return;
        };
        if self.last.replace(at) == Some(at) {
            return;
        }
        self.judged += 1;
        let truth = rig.world.pose_at(at);
        let apart_m = believed.point().distance(truth.point());
        let turned = wrap_angle(believed.theta - truth.theta).abs();
        self.worst_m = self.worst_m.max(apart_m);
        if apart_m <= self.within_m && turned <= self.within_rad {
            self.wrong_since = None;
            return;
        }
        let since = *self.wrong_since.get_or_insert(at);
        if at - since >= LASTING {
            self.broken = Some((since, apart_m, turned.to_degrees()));
        }
    }

    fn verdict(&self) -> Check {
        let name = "pose-believed";
        let detail = match self.broken {
            Some((since, apart_m, turned)) => format!(
                "since {since} s the believed pose is wrong, by {:.0} mm and {turned:.0} degrees",
                apart_m * 1000.0
            ),
            None if self.judged == 0 => "no pose before the first disturbance".to_owned(),
            None => format!(
                "{} poses, at most {:.0} mm from the true ones",
                self.judged,
                self.worst_m * 1000.0
            ),
        };
        Check::new(name, self.broken.is_none(), detail).if_observed(self.judged > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.quiet.renew(faults, rig);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::{Contact, Point};

    use super::super::puppet::{copied, cut, scenario};
    use super::super::tests::rig;
    use super::*;
    use crate::Shared;
    use crate::robots::checker::Status;

    /// A robot at the origin with this pose, at this time or at the time of the call.
    #[derive(Clone)]
    struct Robot {
        believed: Shared<(Option<Instant>, Pose)>,
        accuracy: Option<[f64; 2]>,
    }

    type Pose = emulators::world::Pose;

    impl Instruments for Robot {
        fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
            let (at, pose) = *self.believed.lock();
            Some((at.unwrap_or(rig.now()), pose))
        }

        fn accuracy(&self) -> Option<[f64; 2]> {
            self.accuracy
        }
    }

    fn robot(x_m: f64, degrees: f64) -> Robot {
        let pose = Pose::new(x_m, 0.0, degrees.to_radians());
        Robot {
            believed: Shared::new((None, pose)),
            accuracy: None,
        }
    }

    fn pose(robot: &Robot) -> PoseBelieved {
        PoseBelieved::new(Arc::new(robot.clone()), 300.0, Undisturbed::default())
    }

    fn look(checker: &mut PoseBelieved, rig: &mut Rig, millis: u64, own_m_s: Option<f64>) {
        rig.run_until(Instant::from_millis(millis));
        let contact = |own_m_s| Contact {
            at: rig.now(),
            speed_m_s: 0.5,
            own_m_s,
            place: Point::default(),
        };
        let contacts: Vec<_> = own_m_s.map(contact).into_iter().collect();
        checker.observe(&Look {
            rig,
            axes: &[],
            contacts: &contacts,
        });
    }

    fn told(checker: &PoseBelieved) -> (Status, String) {
        let check = checker.verdict();
        (check.status, check.detail)
    }

    /// Three poses at most 200 mm off; a pose that is reported twice counts once.
    #[test]
    fn each_pose_is_judged_once() {
        let (robot, mut rig) = (robot(0.1, 0.0), rig());
        let mut checker = pose(&robot);
        let none = "no pose before the first disturbance".to_owned();
        assert_eq!(told(&checker), (Status::NotObserved, none));
        for (millis, x_m) in [(100, 0.1), (200, 0.2), (300, 0.15), (400, 0.15)] {
            let at = Instant::from_millis(millis.min(300));
            *robot.believed.lock() = (Some(at), Pose::new(x_m, 0.0, 0.0));
            look(&mut checker, &mut rig, millis, None);
        }
        let words = "3 poses, at most 200 mm from the true ones".to_owned();
        assert_eq!(told(&checker), (Status::Pass, words));
        let text = checker.verdict().to_string();
        assert_eq!(copied(&checker, &rig), text);
    }

    /// A right pose in between begins the three seconds anew. A pose a second old is judged by its
    /// own time.
    #[test]
    fn an_error_has_to_last() {
        let (robot, mut rig) = (robot(0.5, 0.0), rig());
        let mut checker = pose(&robot);
        let mut at = |checker: &mut PoseBelieved, millis: u64, x_m: f64| {
            *robot.believed.lock() = (None, Pose::new(x_m, 0.0, 0.0));
            look(checker, &mut rig, millis, None);
        };
        at(&mut checker, 1_000, 0.5);
        at(&mut checker, 3_900, 0.1);
        at(&mut checker, 4_000, 0.5);
        at(&mut checker, 6_999, 0.5);
        assert_eq!(checker.verdict().status, Status::Pass);
        at(&mut checker, 7_000, 0.4);
        let words = "since 4.000000 s the believed pose is wrong, by 400 mm and 0 degrees";
        assert_eq!(told(&checker), (Status::Fail, words.to_owned()));
        at(&mut checker, 7_100, 0.9);
        assert_eq!(told(&checker), (Status::Fail, words.to_owned()));
    }

    /// The robot itself may be more accurate than the scenario asks for, and names its own angle.
    #[test]
    fn the_smaller_of_both_limits_counts() {
        let judged = |accuracy: Option<[f64; 2]>, x_m: f64, degrees: f64| {
            let mut robot = robot(x_m, degrees);
            robot.accuracy = accuracy;
            let (mut checker, mut rig) = (pose(&robot), rig());
            for millis in [1_000, 4_000] {
                look(&mut checker, &mut rig, millis, None);
            }
            checker.verdict().status
        };
        use Status::{Fail, Pass};
        let own = Some([100.0, 5.0]);
        assert_eq!([0.09, 0.11].map(|x_m| judged(own, x_m, 0.0)), [Pass, Fail]);
        assert_eq!([4.9, 5.1].map(|deg| judged(own, 0.0, deg)), [Pass, Fail]);
        let wide = Some([900.0, 60.0]);
        assert_eq!([0.29, 0.31].map(|x_m| judged(wide, x_m, 0.0)), [Pass, Fail]);
        assert_eq!([59.0, 61.0].map(|deg| judged(wide, 0.0, deg)), [Pass, Fail]);
        assert_eq!([19.0, 21.0].map(|deg| judged(None, 0.0, deg)), [Pass, Fail]);
        // 355 degrees are 5 to the other side.
        assert_eq!(judged(None, 0.0, 355.0), Pass);
    }

    /// A touch of up to 0.05 m/s moves no robot; of a robot that a person pushes, each may.
    #[test]
    fn a_hit_ends_the_judgement() {
        let judged = |is_by_hand: bool, own_m_s: f64| {
            let (robot, mut rig) = (robot(0.5, 0.0), rig());
            let mut checker = pose(&robot).by_hand(is_by_hand);
            for (millis, contact) in [(1_000, Some(own_m_s)), (2_000, None), (9_000, None)] {
                look(&mut checker, &mut rig, millis, contact);
            }
            checker.verdict().status
        };
        assert_eq!(
            [0.05, 0.06].map(|own| judged(false, own)),
            [Status::Fail, Status::NotObserved]
        );
        assert_eq!(
            [0.0, 0.01].map(|own| judged(true, own)),
            [Status::Fail, Status::NotObserved]
        );
    }

    /// A fault that is added at 1 s ends it as well.
    #[test]
    fn a_later_fault_ends_the_judgement() {
        struct Nothing;
        impl Instruments for Nothing {
            fn station_links(&self) -> &'static [&'static str] {
                &["radio"]
            }
        }
        let judged = |link: &str| {
            let (rig, _) = crate::rig::bare::linked(["lidar", "radio"], 1_000_000);
            let quiet = Undisturbed::of(&scenario("").0, &rig, &Nothing);
            let mut checker = PoseBelieved::new(Arc::new(robot(0.5, 0.0)), 300.0, quiet);
            checker.faults_changed(&[cut(link, 1, 2)], &rig);
            let mut rig = rig;
            for millis in [500, 1_000, 9_000] {
                look(&mut checker, &mut rig, millis, None);
            }
            checker.verdict().status
        };
        assert_eq!(
            [judged("lidar"), judged("radio")],
            [Status::Pass, Status::Fail]
        );
    }
}
