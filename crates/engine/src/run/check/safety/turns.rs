//! Checks that a robot turns to its goal before it drives, and by the shorter way.

use core::f64::consts::FRAC_PI_2;
use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Undisturbed;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::Instruments;
use crate::scenario::FaultSpec;

/// Angle from which a turn on the spot is longer than half a turn with its corrections: 230
/// degrees, in radians.
const LONG: f64 = 4.0;
/// Maximum speed of a turn on the spot, m/s.
const SPOT_M_S: f64 = 0.03;
/// Minimum turn rate, rad/s: noise of the drive train.
const REST_RAD_S: f64 = 0.15;
/// Minimum set-point of a drive away from the goal, m/s, and its minimum duration.
const AWAY_M_S: f64 = 0.15;
const AWAY: Duration = Duration::from_millis(150);

/// While the robot drives to a goal, no turn on the spot exceeds half a turn, and it does not drive
/// away from a goal behind it, as long as no fault, push or contact disturbs its sensors.
#[derive(Clone)]
pub struct TurnsShort {
    instruments: Arc<dyn Instruments>,
    /// The link of the orders, and the bytes that arrived on it.
    orders: Option<&'static str>,
    ordered: u64,
    quiet: Undisturbed,
    /// Angle of the current turn, and the number of turns.
    turned: f64,
    turns: u64,
    last: Option<f64>,
    longest: f64,
    /// Start of the current drive away from the goal, and the first that was too long.
    away_since: Option<Instant>,
    away: Option<Instant>,
}

impl TurnsShort {
    /// Judges the drives to goals while the robot is undisturbed. An order may begin another turn.
    pub fn new(instruments: Arc<dyn Instruments>, quiet: Undisturbed) -> Self {
        let orders = instruments.orders_link();
        Self {
            instruments,
            orders,
            ordered: 0,
            quiet,
            turned: 0.0,
            turns: 0,
            last: None,
            longest: 0.0,
            away_since: None,
            away: None,
        }
    }

    /// Notes a drive ahead with the goal behind.
    fn note_away(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        let axes = look.axes.iter().filter(|axis| axis.unit == "m/s");
        let set_points: Vec<f64> = axes.map(|axis| axis.set_point).collect();
        let ahead = set_points.iter().sum::<f64>() / set_points.len().max(1) as f64;
        let is_behind = |bearing: f64| bearing.abs() > FRAC_PI_2;
        let bearing = self.instruments.goal_bearing(look.rig);
        if ahead < AWAY_M_S || !bearing.is_some_and(is_behind) {
            self.away_since = None;
            return;
        }
        let since = *self.away_since.get_or_insert(now);
        if now - since >= AWAY {
            self.away.get_or_insert(now);
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
        let modes = self.instruments.goal_modes();
        let is_led = !is_over && mode.is_some_and(|mode| modes.contains(&mode));
        if is_led {
            self.note_away(look);
        } else {
            self.away_since = None;
        }
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
        let detail = match (self.away, self.turns) {
            (Some(at), _) => format!("at {at} s it drives ahead although its goal is behind it"),
            (None, 0) => "no turn on the spot towards a goal".to_owned(),
            (None, turns) => {
                format!("{turns} turns on the spot, the longest by {degrees:.0} degrees")
            }
        };
        let is_sound = self.longest <= LONG && self.away.is_none();
        Check::new(name, is_sound, detail).if_observed(self.turns > 0 || !is_sound)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.quiet.renew(faults, rig);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
