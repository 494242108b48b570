//! Checks that a robot turns to its goal by the shorter way.

use super::super::{Check, Checker, Look};
use super::Undisturbed;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::scenario::FaultSpec;

/// Angle of a turn on the spot that is longer than half a turn with its corrections, radians: 230
/// degrees.
const LONG: f64 = 4.0;
/// Maximum speed of a turn on the spot, m/s.
const SPOT_M_S: f64 = 0.03;
/// Minimum turn rate, rad/s: noise of the drive train.
const REST_RAD_S: f64 = 0.15;

/// While the robot drives to a goal, no turn on the spot exceeds half a turn, as long as no fault,
/// push or contact disturbs its sensors.
#[derive(Clone, Debug, Default)]
pub struct TurnsShort {
    modes: Vec<&'static str>,
    /// The link of the orders, and the bytes that arrived on it.
    orders: Option<&'static str>,
    ordered: u64,
    quiet: Undisturbed,
    /// Angle of the current turn, and the number of turns.
    turned: f64,
    turns: u64,
    last: Option<f64>,
    longest: f64,
}

impl TurnsShort {
    /// Judges the turns in these modes of the robot's program, while it is undisturbed. An order on
    /// the link `orders` may begin another turn.
    pub fn new(modes: &[&'static str], orders: Option<&'static str>, quiet: Undisturbed) -> Self {
        Self {
            modes: modes.to_vec(),
            orders,
            quiet,
            ..Self::default()
        }
    }
}

impl Checker for TurnsShort {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, world) = (look.rig, &look.rig.world);
        if !look.contacts.is_empty() {
            self.quiet.hit_at(rig.now());
        }
        let heading = world.pose().theta;
        let step = self
            .last
            .map_or(0.0, |last| emulators::world::wrap_angle(heading - last));
        self.last = Some(heading);
        let mode = rig.program().map(|program| program.mode());
        let is_over = self.quiet.is_over(rig.now());
        let is_led = !is_over && mode.is_some_and(|mode| self.modes.contains(&mode));
        let rate = world.turn_rate();
        let is_turn = world.speed().abs() < SPOT_M_S && rate.abs() > REST_RAD_S;
        let orders = self.orders.and_then(|link| rig.link(link));
        let ordered = orders.map_or(0, |link| link.line(Direction::ToMaster).traffic().delivered);
        let is_ordered = core::mem::replace(&mut self.ordered, ordered) != ordered;
        let goes_on = self.turned == 0.0 || (self.turned > 0.0) == (rate > 0.0);
        if !(is_led && is_turn && goes_on) || is_ordered {
            self.turned = 0.0;
            return;
        }
        self.turns += u64::from(self.turned == 0.0);
        self.turned += step;
        self.longest = self.longest.max(self.turned.abs());
    }

    fn verdict(&self) -> Check {
        let name = "turns-short";
        let degrees = self.longest.to_degrees();
        let detail = match self.turns {
            0 => "no turn on the spot towards a goal".to_owned(),
            turns => format!("{turns} turns on the spot, the longest by {degrees:.0} degrees"),
        };
        Check::new(name, self.longest <= LONG, detail).if_observed(self.turns > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.quiet.renew(faults, rig);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
