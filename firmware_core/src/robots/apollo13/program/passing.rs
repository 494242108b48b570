//! Drives through gates, one after the other.

use core::time::Duration;

use protocols::Instant;

use super::Apollo13;
use super::search::Search;
use crate::ackermann::{CarPose, wrapped};
use crate::robots::apollo13::floor::FloorPlan;
use crate::robots::apollo13::gates::Passage;
use crate::robots::apollo13::pilot::GoalState;

/// Tolerance at the pose before a gate, metres and radians: half a heading step of the lattice, and
/// the error of following.
const BEFORE_GATE: [f64; 2] = [0.15, 0.30];
/// Shift and turn of a gate's markers after which the car aims again, metres and radians: several
/// times the camera's noise.
const AIM_OFF: [f64; 2] = [0.10, 0.15];
/// Room before the gate's middle up to which the car aims again, metres: nearer, the side from
/// which the car comes is not clear.
const AIMS_UNTIL_M: f64 = 0.25;
/// Time without a gate after which the car searches elsewhere.
const SEARCHES_AFTER: Duration = Duration::from_secs(2);
/// Interval of the looks for an obstacle in a gate.
const BLOCK_LOOK_EVERY: Duration = Duration::from_millis(200);
/// Interval of the checks for a gate in sight.
const LOOKS_EVERY: Duration = Duration::from_secs(1);
/// Lookouts, as shares of the map's width and height, with several headings each.
const LOOKOUTS: [[f64; 2]; 3] = [[0.5, 0.5], [0.25, 0.5], [0.75, 0.5]];
const HEADINGS: u32 = 4;
/// Maximum number of lookouts without a gate.
const LOOKOUTS_MAX: u32 = 3 * HEADINGS;

impl Apollo13 {
    /// Continues with the next part of a passage, or with the next gate.
    pub(super) fn choose_gate(&mut self, pose: CarPose) {
        self.look_for_blocked(pose);
        self.aim_again(pose);
        let is_done = match self.pilot.state() {
            GoalState::None | GoalState::Reached => true,
            GoalState::GivenUp => {
                self.passage = None;
                true
            }
            _ => false,
        };
        // A gate takes precedence over a lookout.
        let is_search = self.passage.is_none() && self.search.places > 0;
        let is_old = |looked: Instant| self.now - looked >= LOOKS_EVERY;
        let is_due = is_search && self.search.looked.is_none_or(is_old);
        if !is_done && !is_due {
            return;
        }
        let at = self.pilot.goal();
        match self.passage {
            Some(passage) if at == Some(passage.before) => self.pilot.follow(through(passage)),
            _ => {
                let costs = self.floor.costs(self.now);
                let is_free = |pose| costs.is_none_or(|costs| self.pilot.is_free(costs, pose));
                self.passage = self.gates.next(pose, is_free);
                match self.passage {
                    Some(passage) => {
                        self.search = Search {
                            is_asked: self.search.is_asked,
                            looked_for_blocked: self.search.looked_for_blocked,
                            ..Search::default()
                        };
                        let before = Some(passage.before);
                        self.pilot.set_exact_goal(before, BEFORE_GATE);
                    }
                    None => self.look_elsewhere(is_done),
                }
            }
        }
    }

    /// Aims again at the gate that the car drives through, if its markers are seen at other places
    /// than before: the pose drifts under a wrong gyroscope, and the gate must be passed where it
    /// is seen.
    fn aim_again(&mut self, pose: CarPose) {
        let is_through = |passage: &Passage| self.pilot.goal() == Some(passage.behind);
        let Some(passage) = self.passage.filter(is_through) else {
            return;
        };
        if self.config.defects.gates_as_fielded {
            return;
        }
        let is_ahead = |seen: &Passage| pose.motion_to(seen.middle).ahead_m > AIMS_UNTIL_M;
        let seen = self.gates.again(pose, passage.gate).filter(is_ahead);
        let Some(seen) = seen else {
            return;
        };
        let turn_rad = wrapped(seen.middle.heading_rad - passage.middle.heading_rad);
        let is_far = seen.middle.distance_m(passage.middle) > AIM_OFF[0];
        if is_far || turn_rad.abs() > AIM_OFF[1] {
            self.pilot.follow(through(seen));
            self.passage = Some(seen);
        }
    }

    /// Looks for obstacles in the gates ahead.
    fn look_for_blocked(&mut self, pose: CarPose) {
        let last = self.search.looked_for_blocked;
        if self.config.defects.gates_as_fielded
            || last.is_some_and(|last| self.now - last < BLOCK_LOOK_EVERY)
        {
            return;
        }
        self.search.looked_for_blocked = Some(self.now);
        if let Some(costs) = self.floor.costs(self.now) {
            let pilot = &self.pilot;
            self.gates.look(pose, |pose| pilot.is_free(costs, pose));
        }
    }

    /// Handles the case of no gate in sight; `is_there`: the car has also reached its lookout.
    fn look_elsewhere(&mut self, is_there: bool) {
        let now = self.now;
        self.search.looked = Some(now);
        let since = *self.search.since.get_or_insert(now);
        if !is_there {
            return;
        }
        self.pilot.set_goal(None);
        // A blocked gate may be the one that the operator misses: the car rests, and reports it.
        let is_explained = self.gates.blocked() > 0;
        if !self.search.is_asked || is_explained || now - since < SEARCHES_AFTER {
            return;
        }
        while self.search.places < LOOKOUTS_MAX {
            let place = lookout(self.floor.plan(), self.search.places);
            self.search.places += 1;
            let costs = self.floor.costs(now);
            if costs.is_some_and(|costs| self.pilot.is_free(costs, place)) {
                return self.pilot.set_goal(Some(place));
            }
        }
    }
}

/// The lookout with this number.
fn lookout(plan: &FloorPlan, number: u32) -> CarPose {
    let index = usize::try_from(number / HEADINGS).unwrap_or_default();
    let [across, along] = LOOKOUTS[index % LOOKOUTS.len()];
    let height = plan.obstacles.len() / plan.width.max(1);
    let [x0, y0] = plan.origin_m;
    CarPose {
        x_m: x0 + across * plan.width as f64 * plan.cell_m,
        y_m: y0 + along * height as f64 * plan.cell_m,
        heading_rad: wrapped(f64::from(number % HEADINGS) * core::f64::consts::FRAC_PI_2),
    }
}

/// The straight path through a gate, a pose each 5 cm.
fn through(passage: Passage) -> alloc::vec::Vec<CarPose> {
    let length = passage.before.distance_m(passage.behind);
    let steps = libm::ceil(length / 0.05).clamp(1.0, 1_000.0);
    let mut path = alloc::vec::Vec::new();
    let mut step = 0.0;
    while step <= steps {
        path.push(passage.before.shifted(length * step / steps));
        step += 1.0;
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plan of 6 m by 4 m with its corner at (-1, 2): the middle is (2, 4), the other lookouts
    /// lie a quarter of the width to its sides; four headings from each. After the twelfth the
    /// sequence restarts.
    #[test]
    fn lookouts_lie_in_the_middle_and_to_its_sides() {
        let plan = FloorPlan {
            width: 12,
            cell_m: 0.5,
            origin_m: [-1.0, 2.0],
            obstacles: alloc::vec![false; 12 * 8],
        };
        let quarter = core::f64::consts::FRAC_PI_2;
        let cases = [
            (0, 2.0, 0.0),
            (1, 2.0, quarter),
            (3, 2.0, -quarter),
            (4, 0.5, 0.0),
            (9, 3.5, quarter),
            (10, 3.5, 2.0 * quarter),
            (12, 2.0, 0.0),
        ];
        for (number, x_m, heading) in cases {
            let found = lookout(&plan, number);
            assert_eq!((found.x_m, found.y_m), (x_m, 4.0), "{number}");
            assert!((found.heading_rad - heading).abs() < 1e-9, "{number}");
        }
        let none = lookout(&FloorPlan { width: 0, ..plan }, 0);
        assert_eq!((none.x_m, none.y_m), (-1.0, 26.0));
    }

    /// A passage of 1.5 m in steps of 5 cm has 31 poses, both ends included.
    #[test]
    fn the_way_through_a_gate_is_straight_and_fine() {
        let before = CarPose {
            x_m: 1.0,
            y_m: 2.0,
            heading_rad: 0.0,
        };
        let passage = Passage {
            gate: [1, 2],
            before,
            middle: before.shifted(0.9),
            behind: before.shifted(1.5),
        };
        let path = through(passage);
        assert_eq!(path.len(), 31);
        for (step, pose) in (0_u32..).zip(&path) {
            assert!(
                (pose.x_m - 1.0 - 0.05 * f64::from(step)).abs() < 1e-9,
                "{pose:?}"
            );
            assert_eq!((pose.y_m, pose.heading_rad), (2.0, 0.0));
        }
        // Poses that coincide give two poses.
        let on_the_spot = Passage {
            behind: before,
            ..passage
        };
        assert_eq!(through(on_the_spot), [before, before]);
    }

    fn car() -> Apollo13 {
        let floor = FloorPlan {
            width: 120,
            cell_m: 0.05,
            origin_m: [0.0; 2],
            obstacles: alloc::vec![false; 120 * 80],
        };
        Apollo13::new(super::super::Config {
            floor,
            start: HERE,
            ..super::super::Config::default()
        })
    }

    const HERE: CarPose = CarPose {
        x_m: 1.5,
        y_m: 2.0,
        heading_rad: 0.0,
    };

    fn passage() -> Passage {
        Passage {
            gate: [1, 2],
            before: HERE.shifted(2.0),
            middle: HERE.shifted(2.9),
            behind: HERE.shifted(3.5),
        }
    }

    /// There is no path to the pose before the gate: the car gives up the gate.
    #[test]
    fn a_gate_that_cannot_be_reached_is_given_up() {
        let mut car = car();
        car.passage = Some(passage());
        car.pilot.set_goal(Some(passage().before));
        car.choose_gate(HERE);
        assert!(car.passage.is_some() && car.pilot.state() == GoalState::Planning);
        car.pilot.drive(car.now, HERE, || None);
        assert_eq!(car.pilot.state(), GoalState::GivenUp);
        car.choose_gate(HERE);
        assert!(car.passage.is_none());
        assert_eq!(car.pilot.state(), GoalState::None);
    }

    /// On a drive to a gate, or to any other goal, no gate is searched; on a drive to a lookout,
    /// once a second.
    #[test]
    fn gates_are_looked_for_on_the_way_to_a_place_to_look_from() {
        let looked = |passage, places, since_ms: Option<u64>| {
            let mut car = car();
            car.now = Instant::from_millis(5_000);
            car.passage = passage;
            car.search.places = places;
            car.search.looked = since_ms.map(|ms| Instant::from_millis(5_000 - ms));
            car.pilot.set_goal(Some(HERE.shifted(3.0)));
            car.choose_gate(HERE);
            assert_eq!(car.pilot.goal(), Some(HERE.shifted(3.0)));
            car.search.looked == Some(car.now)
        };
        assert!(!looked(None, 0, None) && !looked(Some(passage()), 3, None));
        assert!(looked(None, 3, None) && looked(None, 3, Some(1_000)));
        assert!(!looked(None, 3, Some(999)));
    }

    /// A gate of 0.8 m that comes into sight ends the search, but not the gate mode.
    #[test]
    fn a_gate_in_sight_ends_the_search() {
        let mut car = car();
        car.search = Search {
            is_asked: true,
            since: Some(Instant::ZERO),
            places: 3,
            ..Search::default()
        };
        car.gates.see(10, [3.5, 2.4]);
        car.gates.see(11, [3.5, 1.6]);
        car.choose_gate(HERE);
        let passage = car.passage.expect("a gate ahead");
        assert_eq!(car.pilot.goal(), Some(passage.before));
        let search = car.search;
        assert!(search.is_asked && search.since.is_none() && search.places == 0);
        // The car is at the pose before the gate: straight through.
        car.choose_gate(HERE);
        assert_eq!(car.pilot.goal(), Some(passage.before));
        car.pilot.drive(car.now, passage.before, || None);
        assert_eq!(car.pilot.state(), GoalState::Reached);
        car.choose_gate(passage.before);
        assert_eq!(car.pilot.path(), through(passage));
    }

    /// On its way through the gate the car sees the markers 8 cm beside their places, which changes
    /// nothing, then 20 cm: it aims again. Behind the markers it keeps its path, and so it does on
    /// its way to the gate.
    #[test]
    fn a_gate_that_is_seen_elsewhere_is_aimed_at_again() {
        let see = |car: &mut Apollo13, y_m: f64| {
            for _ in 0..200 {
                car.gates.see(10, [3.5, y_m + 0.4]);
                car.gates.see(11, [3.5, y_m - 0.4]);
            }
        };
        let mut car = car();
        see(&mut car, 2.0);
        car.choose_gate(HERE);
        let first = car.passage.expect("a gate ahead");
        let mut far = car.clone();
        see(&mut far, 2.2);
        far.choose_gate(HERE);
        assert_eq!(far.passage, Some(first));
        car.pilot.drive(car.now, first.before, || None);
        car.choose_gate(first.before);
        assert_eq!(car.pilot.goal(), Some(first.behind));
        see(&mut car, 2.08);
        car.choose_gate(first.before);
        assert_eq!(car.passage, Some(first));
        see(&mut car, 2.2);
        let mut late = car.clone();
        late.choose_gate(first.middle.shifted(-0.2));
        assert_eq!(late.passage, Some(first));
        car.choose_gate(first.before);
        let again = car.passage.expect("the same gate");
        assert!((again.middle.y_m - 2.2).abs() < 0.01, "{again:?}");
        assert_eq!(car.pilot.path(), through(again));
    }

    /// The gate of 0.8 m is seen turned by 0.1 rad, then by 0.2.
    #[test]
    fn a_gate_that_is_seen_turned_is_aimed_at_again() {
        for (turn_rad, aims) in [(0.1, false), (0.2, true), (-0.2, true)] {
            let mut car = car();
            car.gates.see(10, [3.5, 2.4]);
            car.gates.see(11, [3.5, 1.6]);
            car.choose_gate(HERE);
            let first = car.passage.expect("a gate ahead");
            car.pilot.drive(car.now, first.before, || None);
            car.choose_gate(first.before);
            let (sin, cos) = libm::sincos(turn_rad);
            for _ in 0..300 {
                car.gates.see(10, [3.5 - 0.4 * sin, 2.0 + 0.4 * cos]);
                car.gates.see(11, [3.5 + 0.4 * sin, 2.0 - 0.4 * cos]);
            }
            car.choose_gate(first.before);
            assert_eq!(car.passage != Some(first), aims, "{turn_rad}");
        }
    }

    /// A board stands in the middle of the only gate, 2 m ahead: after ten looks in 2 s the gate is
    /// reported as blocked. The car does not search elsewhere, though the operator asks for more
    /// gates.
    #[test]
    fn a_blocked_gate_is_reported_and_ends_the_search() {
        let mut obstacles = alloc::vec![false; 120 * 80];
        obstacles[40 * 120 + 70] = true;
        let mut car = Apollo13::new(super::super::Config {
            floor: FloorPlan {
                width: 120,
                cell_m: 0.05,
                origin_m: [0.0; 2],
                obstacles,
            },
            start: HERE,
            ..super::super::Config::default()
        });
        car.gates.see(10, [3.5, 2.4]);
        car.gates.see(11, [3.5, 1.6]);
        car.search.is_asked = true;
        for (ms, blocked) in [(0, 0), (1_000, 0), (1_799, 0), (1_800, 1), (9_000, 1)] {
            while car.now < Instant::from_millis(ms) {
                car.now += Duration::from_millis(1);
                car.choose_gate(HERE);
            }
            car.choose_gate(HERE);
            assert_eq!(car.gates.blocked(), blocked, "{ms}");
        }
        assert!(car.passage.is_none() && car.pilot.goal().is_none());
    }

    /// After two seconds without a gate the car searches elsewhere if the operator asked for more
    /// gates: in the middle of the map, 3 m by 2 m, at the first of four headings.
    #[test]
    fn after_two_seconds_a_gate_is_looked_for_elsewhere() {
        let goes = |is_asked: bool, after_ms: u64| {
            let mut car = car();
            car.search.is_asked = is_asked;
            car.choose_gate(HERE);
            assert_eq!(
                (car.pilot.goal(), car.search.since),
                (None, Some(Instant::ZERO))
            );
            car.now = Instant::from_millis(after_ms);
            car.choose_gate(HERE);
            assert_eq!(car.search.looked, Some(car.now));
            car.pilot
                .goal()
                .map(|goal| (goal.x_m, goal.y_m, car.search.places))
        };
        assert_eq!(goes(true, 1_999), None);
        assert_eq!(goes(false, 5_000), None);
        assert_eq!(goes(true, 2_000), Some((3.0, 2.0, 1)));
        // After the twelfth lookout there is none.
        let mut car = car();
        car.search = Search {
            is_asked: true,
            since: Some(Instant::ZERO),
            places: 12,
            ..Search::default()
        };
        car.now = Instant::from_millis(9_000);
        car.choose_gate(HERE);
        assert_eq!((car.pilot.goal(), car.search.places), (None, 12));
    }
}
