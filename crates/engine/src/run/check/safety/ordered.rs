//! Checks that the robot does what its operator orders: to rest, and to drive by hand.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use super::rests::moves_itself;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::scenario::{Action, FaultSpec, Scenario, Step};

/// Time to brake after the order to rest was obeyed: the wheels of the built-in robots stand after
/// 0.3 s.
const BRAKES: Duration = Duration::from_millis(300);
/// Minimum duration of a motion that counts as not resting.
const MOTION: Duration = Duration::from_millis(100);
/// Time from an order to drive until the set-points must follow.
const FOLLOWS: Duration = Duration::from_secs(1);
/// Minimum number of observations of an order to drive: half a second.
const LOOKS: u32 = 50;
/// Minimum share of observations in which the set-points have the ordered signs, per cent.
const SHARE: u32 = 70;

/// An order of the scenario, and the time until the next one.
#[derive(Clone, Debug)]
struct Window {
    at: Instant,
    until: Instant,
    /// Signs of the ordered set-points; empty for an order to rest.
    signs: Vec<f64>,
    /// Number of bytes on the link of the orders that were sent before this order, and the arrival
    /// time of the first later byte.
    before: Option<u64>,
    arrived: Option<Instant>,
    moving_since: Option<Instant>,
    looks: u32,
    obeyed: u32,
    was_judged: bool,
    /// Whether a fault has disturbed this order, so that it is not judged.
    is_void: bool,
}

/// The robot rests after an order to rest, and its set-points follow an order to drive by hand.
#[derive(Clone, Debug)]
pub struct DoesAsOrdered {
    link: String,
    within: Duration,
    calm: Calm,
    windows: Vec<Window>,
    broken: Option<(Instant, String)>,
}

impl DoesAsOrdered {
    /// Judges the timed orders of `scenario`, which arrive on `link`, unless a fault acts on this
    /// link or the drive: only while they are `calm`.
    pub fn of(scenario: &Scenario, link: Option<&str>, within: Duration, calm: Calm) -> Self {
        let link = link.unwrap_or_default().to_owned();
        let windows = windows(scenario);
        Self {
            link,
            within,
            calm,
            windows,
            broken: None,
        }
    }
}

/// The signs of the set-points that `action` orders; empty for an order to rest, `None` for another
/// order.
fn signs(action: &Action) -> Option<Vec<f64>> {
    let sign = |value: f64| if value == 0.0 { 0.0 } else { value.signum() };
    match action {
        Action::Mode(mode) => (mode == "stop").then(Vec::new),
        Action::WaypointsM(places) => places.is_empty().then(Vec::new),
        Action::Drive(axes) => {
            let signs: Vec<f64> = axes.iter().map(|axis| sign(axis.0)).collect();
            let rests = signs.iter().all(|sign| *sign == 0.0);
            Some(if rests { Vec::new() } else { signs })
        }
        _ => None,
    }
}

fn windows(scenario: &Scenario) -> Vec<Window> {
    let steps = &scenario.mission.step;
    let is_order = |step: &&Step| !matches!(step.action, Action::Set(_));
    let orders: Vec<&Step> = steps.iter().filter(is_order).collect();
    // A step that waits for a condition may come at any time; see `ordered`.
    let is_mode = |step: &&Step| matches!(step.action, Action::Mode(_));
    let may_have_mode = orders.iter().any(|step| step.at.is_none() && is_mode(step));
    let orders: Vec<&Step> = orders
        .into_iter()
        .filter(|step| step.at.is_some())
        .collect();
    let time = |step: &Step| step.at.unwrap_or_default().instant();
    let mut is_connected = true;
    // Whether the robot drives to the places of lists. In another mode, or driven by hand, an empty
    // list may mean nothing.
    let (mut has_mode, mut by_hand) = (may_have_mode, false);
    let mut windows = Vec::new();
    for (index, step) in orders.iter().enumerate() {
        match &step.action {
            Action::Connect => is_connected = true,
            Action::Disconnect => {
                is_connected = false;
                // The station may repeat its order when it is back, behind the newer lists.
                has_mode |= by_hand;
            }
            Action::Mode(mode) if mode != "stop" => has_mode = true,
            Action::WaypointsM(places) if places.is_empty() && (has_mode || by_hand) => continue,
            // The station may repeat the drive behind the list, too.
            Action::WaypointsM(_) => has_mode |= by_hand,
            Action::Drive(_) => by_hand = true,
            _ => {}
        }
        let next = orders.get(index + 1).map(|next| time(next));
        let at = time(step);
        let until = next.unwrap_or(scenario.duration.instant());
        let Some(signs) = signs(&step.action).filter(|_| is_connected) else {
            continue;
        };
        if at < scenario.mission.connect.instant() {
            continue;
        }
        windows.push(Window {
            at,
            until,
            signs,
            before: None,
            arrived: None,
            moving_since: None,
            looks: 0,
            obeyed: 0,
            was_judged: false,
            is_void: false,
        });
    }
    windows
}

impl Window {
    fn observe(&mut self, look: &Look<'_>, link: &str, within: Duration) -> Option<String> {
        let (rig, now) = (look.rig, look.rig.now());
        if now >= self.until {
            return None;
        }
        let traffic = rig.link(link)?.line(Direction::ToMaster).traffic();
        if now < self.at || self.before.is_none() {
            // Bytes that were sent before the order are not part of it.
            let gone = traffic.delivered + traffic.lost + traffic.framing_errors;
            let on_the_way = (traffic.sent + traffic.added).saturating_sub(gone);
            self.before = Some(traffic.delivered + on_the_way);
            if now < self.at {
                return None;
            }
        }
        let before = self.before?;
        if self.arrived.is_none() && traffic.delivered > before {
            self.arrived = Some(now);
        }
        let arrived = self.arrived?;
        if !self.signs.is_empty() {
            return self.follows(look, arrived);
        }
        if now <= arrived + within + BRAKES {
            return None;
        }
        self.was_judged = true;
        if !moves_itself(look) {
            self.moving_since = None;
            return None;
        }
        let since = *self.moving_since.get_or_insert(now);
        let told = (now - arrived).as_secs_f64();
        (now - since >= MOTION)
            .then(|| format!("the robot moves {told:.1} s after the order to rest"))
    }

    fn follows(&mut self, look: &Look<'_>, arrived: Instant) -> Option<String> {
        if look.rig.now() <= arrived + FOLLOWS {
            return None;
        }
        self.looks += 1;
        let mut pairs = look.axes.iter().zip(&self.signs);
        let is_obeyed = pairs.all(|(axis, sign)| *sign == 0.0 || axis.set_point * sign > 0.0);
        self.obeyed += u32::from(is_obeyed);
        self.was_judged |= self.looks >= LOOKS;
        let share = self.obeyed * 100 / self.looks;
        (self.looks >= LOOKS && share < SHARE).then(|| {
            format!("the set-points follow the order to drive in {share} % of the time only")
        })
    }
}

impl Checker for DoesAsOrdered {
    fn observe(&mut self, look: &Look<'_>) {
        if self.broken.is_some() {
            return;
        }
        let now = look.rig.now();
        if !self.calm.is(now) {
            let disturbed = self.windows.iter_mut();
            let disturbed = disturbed.filter(|window| (window.at..window.until).contains(&now));
            disturbed.for_each(|window| window.is_void = true);
        }
        let windows = self.windows.iter_mut().filter(|window| !window.is_void);
        let found = windows.filter_map(|window| window.observe(look, &self.link, self.within));
        self.broken = found.last().map(|detail| (now, detail));
    }

    fn verdict(&self) -> Check {
        let name = "does-as-ordered";
        let judged = self.windows.iter().filter(|window| window.was_judged);
        let judged = judged.count();
        let detail = match &self.broken {
            Some((at, detail)) => format!("at {at} s {detail}"),
            None => format!("{judged} orders to rest or to drive by hand"),
        };
        Check::new(name, self.broken.is_none(), detail).if_observed(judged > 0)
    }

    /// The robot has another order from then on, until the next one of the scenario.
    fn ordered(&mut self, at: Instant) {
        let windows = self.windows.iter_mut();
        let hit = windows.filter(|window| (window.at..window.until).contains(&at));
        hit.for_each(|window| window.is_void = true);
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
    use super::*;

    /// Orders to rest, by their times in seconds.
    fn rests(steps: &str) -> Vec<u64> {
        let text = format!(
            "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
             [world]\nstart = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n\
             [mission]\nwaypoints_m = [[1, 2]]\nstep = [{steps}]\n"
        );
        let (scenario, _) = Scenario::from_text(&text).expect("sound");
        let windows = windows(&scenario).into_iter();
        let rests = windows.filter(|window| window.signs.is_empty());
        rests.map(|window| window.at.as_millis() / 1_000).collect()
    }

    /// An empty list orders rest if the robot drives to the places of lists. It may mean nothing in
    /// a mode of another kind, or after a drive by hand that a station repeats.
    #[test]
    fn an_empty_list_orders_rest_only_behind_lists() {
        let list = |at: u32| format!("{{ at = \"{at}s\", do = {{ waypoints-m = [[1, 2]] }} }},");
        let none = |at: u32| format!("{{ at = \"{at}s\", do = {{ waypoints-m = [] }} }},");
        let mode =
            |at: u32, name: &str| format!("{{ at = \"{at}s\", do = {{ mode = \"{name}\" }} }},");
        let drive = "{ at = \"4s\", do = { drive = [8, -8] } },";
        let gone = "{ at = \"5s\", do = \"disconnect\" },{ at = \"6s\", do = \"connect\" },";
        assert_eq!(rests(&none(5)), [5]);
        assert_eq!(rests(&(mode(3, "explore") + &none(5))), [0; 0]);
        assert_eq!(rests(&(mode(3, "explore") + &list(4) + &none(5))), [0; 0]);
        assert_eq!(rests(&(mode(3, "stop") + &none(5))), [3, 5]);
        let later = "{ when = { visited = 1 }, do = { mode = \"explore\" } },";
        let stop = mode(4, "stop");
        assert_eq!(rests(&(later.to_owned() + &stop + &none(5))), [4]);
        assert_eq!(rests(&(drive.to_owned() + &list(6) + &none(8))), [0; 0]);
        assert_eq!(rests(&(drive.to_owned() + &none(8))), [0; 0]);
        assert_eq!(
            rests(&(drive.to_owned() + gone + &list(7) + &none(8))),
            [0; 0]
        );
    }

    /// The signs of set-points count, not their sizes.
    #[test]
    fn orders_to_rest_have_no_signs() {
        use crate::scenario::SetPoint;
        let drive = |axes: [f64; 2]| signs(&Action::Drive(SetPoint::list(axes)));
        assert_eq!(drive([8.0, -0.5]), Some(vec![1.0, -1.0]));
        assert_eq!(drive([8.0, 0.0]), Some(vec![1.0, 0.0]));
        assert_eq!(drive([0.0, 0.0]), Some(Vec::new()));
        let mode = |name: &str| signs(&Action::Mode(name.to_owned()));
        assert_eq!([mode("stop"), mode("explore")], [Some(Vec::new()), None]);
        let list = |places: &[[f64; 2]]| signs(&Action::WaypointsM(places.to_vec()));
        assert_eq!([list(&[]), list(&[[1.0, 2.0]])], [Some(Vec::new()), None]);
        assert_eq!(signs(&Action::Connect), None);
    }

    fn scenario(steps: &str) -> Scenario {
        let mission = format!("[mission]\nconnect = \"1s\"\nstep = [{steps}]\n");
        super::super::puppet::scenario(&mission).0
    }

    fn step(at: &str, action: &str) -> String {
        format!("{{ at = \"{at}\", do = {action} }},")
    }

    const STOP: &str = "{ mode = \"stop\" }";

    /// An order lasts until the next one or the end, at 60 s. Before the connection at 1 s, and
    /// between two connections, none arrives; a value that the rig sets is no order.
    #[test]
    fn an_order_lasts_until_the_next_one() {
        let windows = |steps: &[(&str, &str)]| {
            let steps: String = steps.iter().map(|(at, what)| step(at, what)).collect();
            let windows = windows(&scenario(&steps)).into_iter();
            let millis = windows.map(|one| [one.at.as_millis(), one.until.as_millis()]);
            millis.collect::<Vec<_>>()
        };
        assert_eq!(windows(&[("5s", STOP)]), [[5_000, 60_000]]);
        let explore = "{ mode = \"explore\" }";
        assert_eq!(windows(&[("5s", STOP), ("7s", explore)]), [[5_000, 7_000]]);
        let drive = "{ drive = [8, 8] }";
        let two = [("5s", drive), ("7s", STOP)];
        assert_eq!(windows(&two), [[5_000, 7_000], [7_000, 60_000]]);
        assert_eq!(windows(&[("999ms", STOP)]), [[0; 2]; 0]);
        assert_eq!(windows(&[("1s", STOP)]), [[1_000, 60_000]]);
        let gone = [
            ("2s", "\"disconnect\""),
            ("5s", STOP),
            ("6s", "\"connect\""),
            ("8s", STOP),
        ];
        assert_eq!(windows(&gone), [[8_000, 60_000]]);
    }

    /// Looks at a robot each 10 ms from 4 s to this time. An order arrives at 5.1 s.
    struct Course {
        checker: DoesAsOrdered,
        rig: Rig,
        station: usize,
    }

    fn course(steps: &str) -> Course {
        let (rig, [station, _]) = super::super::tests::linked("radio");
        let scenario = scenario(steps);
        let calm = Calm::of(&scenario, &rig, &|_| true);
        let checker = DoesAsOrdered::of(&scenario, Some("radio"), Duration::from_secs(1), calm);
        Course {
            checker,
            rig,
            station,
        }
    }

    impl Course {
        /// Drives at this speed with these set-points until `until` milliseconds.
        fn go(&mut self, until: u64, speed: f64, set_points: impl Fn(u64) -> [f64; 2]) {
            use emulators::world::Command;
            let from = self.rig.now().as_millis();
            for millis in (from + 10..=until).step_by(10) {
                for wheel in ["left", "right"] {
                    let speed = Command::Speed(speed);
                    self.rig.world.actuate(wheel, speed).expect("a wheel");
                }
                if millis == 5_100 {
                    self.rig.inject(self.station, &[1]);
                }
                self.rig.run_until(Instant::from_millis(millis));
                let axes = set_points(millis).map(super::super::tests::drive);
                self.checker.observe(&Look {
                    rig: &self.rig,
                    axes: &axes,
                    contacts: &[],
                });
            }
        }

        fn told(&self) -> (crate::run::check::Status, String) {
            let check = self.checker.verdict();
            (check.status, check.detail)
        }
    }

    use crate::run::check::Status::{Fail, NotObserved, Pass};

    /// The order arrives at 5.1 s; the robot has 1 s to obey it and 0.3 s to brake, until 6.4 s. A
    /// motion of 0.1 s after that is no rest.
    #[test]
    fn a_robot_rests_after_an_order_to_rest() {
        let stops = |millis: u64| {
            let mut course = course(&step("5s", STOP));
            course.go(millis, 0.2, |_| [0.0; 2]);
            course.go(9_000, 0.0, |_| [0.0; 2]);
            course.told()
        };
        let rests = "1 orders to rest or to drive by hand".to_owned();
        assert_eq!(stops(6_300), (Pass, rests));
        let moves = "at 6.510000 s the robot moves 1.4 s after the order to rest".to_owned();
        assert_eq!(stops(6_600), (Fail, moves.clone()));
        let mut anew = course(&step("5s", STOP));
        anew.go(6_300, 0.2, |_| [0.0; 2]);
        for millis in [6_500, 6_700, 6_900] {
            anew.go(millis, 0.0, |_| [0.0; 2]);
            anew.go(millis + 20, 0.2, |_| [0.0; 2]);
        }
        assert_eq!(anew.told().0, Pass, "{:?}", anew.told());
        let mut first = course(&step("5s", STOP));
        first.go(9_000, 0.2, |_| [0.0; 2]);
        assert_eq!(first.told(), (Fail, moves));
        let text = first.checker.verdict().to_string();
        assert_eq!(
            super::super::puppet::copied(&first.checker, &first.rig),
            text
        );
    }

    /// Nothing is judged without the order's arrival, after the next order, or once it is void: by
    /// an order of another origin or a fault.
    #[test]
    fn an_order_is_judged_while_it_is_the_last_one() {
        let mut none = course(&step("5s", STOP));
        none.station = 1;
        none.go(9_000, 0.2, |_| [0.0; 2]);
        let nothing = "0 orders to rest or to drive by hand".to_owned();
        assert_eq!(none.told(), (NotObserved, nothing.clone()));
        let two = |at: &str| step("5s", STOP) + &step(at, "{ mode = \"explore\" }");
        let mut early = course(&two("6400ms"));
        early.go(9_000, 0.2, |_| [0.0; 2]);
        assert_eq!(early.told(), (NotObserved, nothing));
        let mut late = course(&two("6520ms"));
        late.go(9_000, 0.2, |_| [0.0; 2]);
        assert_eq!(late.told().0, Fail);
        let void = |at_ms: u64| {
            let mut course = course(&two("8s"));
            course.checker.ordered(Instant::from_millis(at_ms));
            course.go(9_000, 0.2, |_| [0.0; 2]);
            course.told().0
        };
        assert_eq!(
            [4_999, 5_000, 7_999, 8_000].map(void),
            [Fail, NotObserved, NotObserved, Fail]
        );
        let faulted = |from_s: u64| {
            let mut course = course(&two("8s"));
            let fault = super::super::puppet::cut("radio", from_s, from_s + 1);
            course.checker.faults_changed(&[fault], &course.rig);
            course.go(9_000, 0.2, |_| [0.0; 2]);
            course.told().0
        };
        assert_eq!([6, 8].map(faulted), [NotObserved, Fail]);
    }

    /// A byte that was sent before the order and arrives after it is not the order.
    #[test]
    fn bytes_on_the_way_are_no_order() {
        let judged = |also_later: bool| {
            let mut course = course(&step("5050ms", STOP));
            course.rig.line_mut(0, Direction::ToMaster).latency = Duration::from_millis(200);
            course.go(4_990, 0.2, |_| [0.0; 2]);
            course.rig.inject(course.station, &[7]);
            let station = course.station;
            if !also_later {
                course.station = 1;
            }
            course.go(9_000, 0.2, |_| [0.0; 2]);
            course.station = station;
            course.told()
        };
        assert_eq!(judged(false).0, NotObserved);
        // The order of 5.1 s arrives at 5.3 s.
        let moves = "at 6.710000 s the robot moves 1.4 s after the order to rest".to_owned();
        assert_eq!(judged(true), (Fail, moves));
    }

    /// From one second after the arrival on, 6.1 s, the signs of the set-points are judged; after
    /// half a second, 50 looks, seven of ten have to be right.
    #[test]
    fn set_points_follow_an_order_to_drive() {
        let judged = |until: u64, of_ten: u64, wrong: [f64; 2]| {
            let mut course = course(&step("5s", "{ drive = [8, -8] }"));
            course.go(6_100, 0.0, |_| [-1.0, 1.0]);
            let is_right = |millis: u64| (millis / 10 - 1) % 10 < of_ten;
            course.go(until, 0.0, |millis| {
                if is_right(millis) { [0.5, -2.0] } else { wrong }
            });
            course.told()
        };
        let one = "1 orders to rest or to drive by hand".to_owned();
        assert_eq!(judged(8_000, 7, [0.0, 0.0]), (Pass, one));
        let told =
            "at 6.600000 s the set-points follow the order to drive in 60 % of the time only";
        assert_eq!(judged(8_000, 6, [0.5, 0.0]), (Fail, told.to_owned()));
        assert_eq!(judged(8_000, 6, [0.5, 2.0]).0, Fail);
        assert_eq!(judged(8_000, 6, [-0.5, -2.0]).0, Fail);
        assert_eq!(judged(6_590, 6, [0.0, 0.0]).0, NotObserved);
        let mut one_axis = course(&step("5s", "{ drive = [8, 0] }"));
        one_axis.go(7_000, 0.0, |_| [0.5, -2.0]);
        assert_eq!(one_axis.told().0, Pass);
    }

    /// Two bytes were sent at 4 s: one was lost, one arrived. Neither is on the way any more.
    #[test]
    fn bytes_that_came_before_an_order_are_not_on_the_way() {
        use crate::rig::fault::{Damage, Strike};
        let mut course = course(&step("5s", STOP));
        let faults = &mut course.rig.line_mut(0, Direction::ToMaster).faults;
        let damage = Damage::Drop;
        faults.add_strike(Strike { byte: 0, damage });
        course.go(4_000, 0.2, |_| [0.0; 2]);
        course.rig.inject(course.station, &[7, 7]);
        course.go(9_000, 0.2, |_| [0.0; 2]);
        let moves = "at 6.510000 s the robot moves 1.4 s after the order to rest".to_owned();
        assert_eq!(course.told(), (Fail, moves));
    }
}
