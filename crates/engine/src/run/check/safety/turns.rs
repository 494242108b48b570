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

#[cfg(test)]
mod tests {
    use emulators::world::{Command, Contact, Point};

    use super::super::puppet::{copied, cut, puppet, scenario};
    use super::super::tests::linked;
    use super::*;
    use crate::Shared;
    use crate::robots::Axis;
    use crate::robots::checker::Status;

    /// A robot that drives to a goal in the mode "go", with this bearing of the goal.
    struct Robot(Shared<Option<f64>>);

    impl Instruments for Robot {
        fn goal_modes(&self) -> &'static [&'static str] {
            &["go"]
        }

        fn goal_bearing(&self, _: &Rig) -> Option<f64> {
            *self.0.lock()
        }

        fn orders_link(&self) -> Option<&'static str> {
            Some("orders")
        }
    }

    struct Drive {
        rig: Rig,
        bearing: Shared<Option<f64>>,
        checker: TurnsShort,
        station: usize,
    }

    fn drive() -> Drive {
        let (mut rig, [station, _]) = linked("orders");
        rig.world = super::super::tests::rig().world;
        puppet(&mut rig).mode = "go";
        let bearing = Shared::new(None);
        let quiet = Undisturbed::of(&scenario("").0, &rig, &Robot(bearing.clone()));
        let checker = TurnsShort::new(Arc::new(Robot(bearing.clone())), quiet);
        let mut drive = Drive {
            rig,
            bearing,
            checker,
            station,
        };
        drive.look(&[], &[]);
        drive
    }

    impl Drive {
        /// Turns the wheels for so many tenths of a second; they are 0.26 m apart.
        fn wheels(&mut self, tenths: u64, speeds: [f64; 2]) {
            for _ in 0..tenths {
                for (wheel, speed) in ["left", "right"].into_iter().zip(speeds) {
                    let speed = Command::Speed(speed);
                    self.rig.world.actuate(wheel, speed).expect("a wheel");
                }
                self.rig.run_for(Duration::from_millis(100));
                self.look(&[], &[]);
            }
        }

        fn look(&mut self, axes: &[Axis], contacts: &[Contact]) {
            self.checker.observe(&Look {
                rig: &self.rig,
                axes,
                contacts,
            });
        }

        /// Number of turns, and the longest one to a tenth of a radian.
        fn turns(&self) -> (u64, f64) {
            (
                self.checker.turns,
                (self.checker.longest * 10.0).round() / 10.0,
            )
        }
    }

    /// 0.05 m/s of both wheels in opposite directions are 0.1 / 0.26 = 0.385 rad/s; 6 s of it are
    /// 2.3 rad, but for the 60 ms in which the wheels speed up.
    const LEFT: [f64; 2] = [-0.05, 0.05];
    const RIGHT: [f64; 2] = [0.05, -0.05];

    #[test]
    fn a_turn_on_the_spot_ends_with_its_direction() {
        let mut one = drive();
        one.wheels(60, LEFT);
        assert_eq!(one.turns(), (1, 2.3));
        one.wheels(30, RIGHT);
        assert_eq!(one.turns(), (2, 2.3));
        one.wheels(5, [0.0; 2]);
        one.wheels(20, RIGHT);
        assert_eq!(one.turns(), (3, 2.3));
        one.wheels(80, RIGHT);
        // 10 s of the third one.
        assert_eq!(one.turns(), (3, 3.8));
        let check = one.checker.verdict();
        assert_eq!(check.status, Status::Pass);
        assert!(
            check
                .detail
                .starts_with("3 turns on the spot, the longest by 2"),
            "{check}"
        );
        one.wheels(10, RIGHT);
        assert_eq!(one.checker.verdict().status, Status::Fail);
        assert!(copied(&one.checker, &one.rig).starts_with("FAIL turns-short"));
    }

    /// Another mode, a drive ahead, a slow turn, an order, a contact, or a fault.
    #[test]
    fn other_turns_are_not_judged() {
        let turned = |change: fn(&mut Drive), speeds: [f64; 2]| {
            let mut one = drive();
            change(&mut one);
            one.wheels(20, speeds);
            one.turns().0
        };
        assert_eq!(turned(|_| {}, LEFT), 1);
        assert_eq!(turned(|one| puppet(&mut one.rig).mode = "search", LEFT), 0);
        // 0.02 m/s ahead are on the spot, 0.04 m/s are not; backwards as well.
        assert_eq!(turned(|_| {}, [-0.03, 0.07]), 1);
        assert_eq!(turned(|_| {}, [-0.01, 0.09]), 0);
        assert_eq!(turned(|_| {}, [0.01, -0.09]), 0);
        // 0.16 and 0.14 rad/s.
        assert_eq!(turned(|_| {}, [-0.0208, 0.0208]), 1);
        assert_eq!(turned(|_| {}, [-0.0182, 0.0182]), 0);
        let contact = Contact {
            at: Instant::ZERO,
            speed_m_s: 0.0,
            own_m_s: 0.0,
            place: Point::default(),
        };
        let mut hit = drive();
        hit.look(&[], &[contact]);
        hit.wheels(20, LEFT);
        assert_eq!(hit.turns(), (0, 0.0));
        let mut faulted = drive();
        faulted
            .checker
            .faults_changed(&[cut("orders", 0, 1)], &faulted.rig);
        faulted.wheels(20, LEFT);
        assert_eq!(faulted.turns().0, 0);
        assert_eq!(
            faulted.checker.verdict().detail,
            "no turn on the spot towards a goal"
        );
        assert_eq!(faulted.checker.verdict().status, Status::NotObserved);
    }

    /// An order that arrives within a turn begins another one.
    #[test]
    fn an_order_begins_another_turn() {
        let mut one = drive();
        one.wheels(60, LEFT);
        one.rig.inject(one.station, &[1]);
        one.wheels(60, LEFT);
        assert_eq!(one.turns(), (2, 2.3));
    }

    /// 230 degrees are 4 rad.
    #[test]
    fn a_turn_may_be_somewhat_longer_than_half_a_turn() {
        let of = |longest: f64| {
            let mut checker = drive().checker;
            (checker.longest, checker.turns) = (longest, 1);
            checker.verdict().status
        };
        assert_eq!([of(LONG), of(4.01)], [Status::Pass, Status::Fail]);
    }

    /// Drives ahead with these set-points for so many milliseconds; returns the time of the error.
    fn ahead(bearing: Option<f64>, set_points: [f64; 2], millis: u64) -> Option<u64> {
        let mut one = drive();
        *one.bearing.lock() = bearing;
        let axis = |unit: &'static str, set_point| Axis {
            name: unit.into(),
            unit,
            set_point,
            limit: None,
            actual: None,
        };
        let [left, right] = set_points.map(|set_point| axis("m/s", set_point));
        let axes = [left, axis("rad", 9.0), right];
        for at in (1_000..=1_000 + millis).step_by(10) {
            one.rig.run_until(Instant::from_millis(at));
            one.look(&axes, &[]);
        }
        one.checker.away.map(Instant::as_millis)
    }

    /// 0.15 m/s ahead on average for 150 ms, with a goal at more than a right angle.
    #[test]
    fn a_drive_away_from_the_goal_is_told() {
        let behind = Some(1.6);
        assert_eq!(ahead(behind, [0.15, 0.15], 900), Some(1_150));
        assert_eq!(ahead(Some(-1.6), [0.15, 0.15], 150), Some(1_150));
        assert_eq!(ahead(behind, [0.4, 0.0], 150), Some(1_150));
        assert_eq!(ahead(behind, [0.15, 0.15], 140), None);
        assert_eq!(ahead(behind, [0.29, 0.0], 900), None);
        assert_eq!(ahead(Some(1.57), [0.5, 0.5], 900), None);
        assert_eq!(ahead(None, [0.5, 0.5], 900), None);
        let mut one = drive();
        one.checker.away = Some(Instant::from_secs(3));
        let check = one.checker.verdict();
        let told = "at 3.000000 s it drives ahead although its goal is behind it";
        assert_eq!((check.status, &*check.detail), (Status::Fail, told));
    }

    /// The goal comes into sight again, or the mode changes, for a moment.
    #[test]
    fn a_drive_away_has_to_last() {
        let axis = |set_point| Axis {
            name: "drive".into(),
            unit: "m/s",
            set_point,
            limit: None,
            actual: None,
        };
        let told = |change: fn(&mut Drive, bool)| {
            let mut one = drive();
            *one.bearing.lock() = Some(3.0);
            for at in (1_000..=1_200).step_by(10) {
                change(&mut one, at == 1_100);
                one.rig.run_until(Instant::from_millis(at));
                one.look(&[axis(0.2)], &[]);
            }
            one.checker.away.is_some()
        };
        assert!(told(|_, _| {}));
        assert!(!told(
            |one, now| *one.bearing.lock() = Some(if now { 0.0 } else { 3.0 })
        ));
        assert!(!told(
            |one, now| puppet(&mut one.rig).mode = if now { "" } else { "go" }
        ));
    }
}
