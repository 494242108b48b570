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
