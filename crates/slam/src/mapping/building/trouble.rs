//! Troubles of a robot on its path: motion that the odometry misses, wheels in the air, people.

use emulators::rng::Rng;
use emulators::world::Pose;

use super::plan::Style;
use crate::mapping::motion::{between, moved};

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    /// The robot is turned or pushed.
    Unseen(Pose),
    /// The robot is carried this far along its route, metres, and turned.
    Carried(f64, f64),
    /// The wheels turn in the air.
    Air(Pose),
}

/// A motion that the odometry reports wrongly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Event {
    /// Length of the path before it, metres.
    pub(super) at_m: f64,
    what: What,
}

impl Event {
    /// The motion from `pose` that the odometry misses, and the one that it reports in excess;
    /// `target` is the next point of the route.
    pub(super) fn hidden(&self, pose: Pose, target: [f64; 2]) -> [Pose; 2] {
        match self.what {
            What::Unseen(by) => [by, Pose::default()],
            What::Air(by) => [Pose::default(), by],
            What::Carried(far_m, turn) => {
                let to = [target[0] - pose.x, target[1] - pose.y];
                let length = libm::hypot(to[0], to[1]).max(1e-9);
                let part = far_m.min((length - 2.0).max(0.0)) / length;
                let there = Pose::new(
                    pose.x + part * to[0],
                    pose.y + part * to[1],
                    pose.theta + turn,
                );
                [between(pose, there), Pose::default()]
            }
        }
    }
}

/// All troubles of a robot.
#[derive(Clone, Debug, Default)]
pub(super) struct Trouble {
    pub(super) events: Vec<Event>,
    /// Chance of a new person at each scan.
    people: f64,
    pub(super) words: Vec<&'static str>,
}

/// Shares of the buildings with each trouble.
const TURNED: f64 = 0.25;
const PUSHED: f64 = 0.25;
const CARRIED: f64 = 0.12;
const LIFTED: f64 = 0.2;
const CROWDED: f64 = 0.3;

impl Trouble {
    /// Draws the troubles of a path.
    pub(super) fn drawn(style: Style, rng: &mut Rng) -> Self {
        let mut all = Self::default();
        all.words.extend(style.is_plain.then_some("plain"));
        all.words.extend(style.alike.map(|_| "alike"));
        let pi = core::f64::consts::PI;
        all.add(rng, TURNED, "turned", 2, |rng| {
            What::Unseen(Pose::new(0.0, 0.0, rng.range(-pi, pi)))
        });
        all.add(rng, PUSHED, "pushed", 3, |rng| {
            let [ahead, left] = [1.5, 0.3].map(|most| rng.range(-most, most));
            What::Unseen(Pose::new(ahead, left, rng.range(-0.3, 0.3)))
        });
        all.add(rng, CARRIED, "carried", 1, |rng| {
            What::Carried(rng.range(3.0, 40.0), rng.range(-pi, pi))
        });
        all.add(rng, LIFTED, "lifted", 2, |rng| {
            What::Air(Pose::new(rng.range(0.3, 3.0), 0.0, rng.range(-0.5, 0.5)))
        });
        all.events.sort_by(|a, b| a.at_m.total_cmp(&b.at_m));
        if rng.chance(CROWDED) {
            all.people = rng.range(0.01, 0.1);
            all.words.push("people");
        }
        all
    }

    fn add(
        &mut self,
        rng: &mut Rng,
        share: f64,
        word: &'static str,
        most: u64,
        what: impl Fn(&mut Rng) -> What,
    ) {
        if !rng.chance(share) {
            return;
        }
        self.words.push(word);
        for _ in 0..=rng.below(most) {
            // The shortest path has 150 m.
            let at_m = rng.range(20.0, 140.0);
            let what = what(rng);
            self.events.push(Event { at_m, what });
        }
    }
}

/// Radius of a person, metres.
const PERSON_M: f64 = 0.25;

/// Distance of the nearest of these people along a beam, metres.
pub(super) fn met(people: &[[f64; 2]], at: Pose, bearing: f64) -> f64 {
    let (sin, cos) = libm::sincos(at.theta + bearing);
    let far = |[x, y]: &[f64; 2]| {
        let to = [x - at.x, y - at.y];
        let (along, across) = (cos * to[0] + sin * to[1], cos * to[1] - sin * to[0]);
        let half = PERSON_M * PERSON_M - across * across;
        if half > 0.0 && along > PERSON_M {
            along - libm::sqrt(half)
        } else {
            f64::MAX
        }
    };
    people.iter().map(far).fold(f64::MAX, f64::min)
}

/// A person who walks, or who follows the robot.
struct Person {
    at: Pose,
    step: [f64; 2],
    follows: bool,
    left: u64,
}

/// The people around the robot.
pub(super) struct People {
    rng: Rng,
    chance: f64,
    all: Vec<Person>,
    places: Vec<[f64; 2]>,
}

impl People {
    pub(super) fn new(seed: u64, trouble: &Trouble) -> Self {
        Self {
            rng: Rng::stream(seed, "building.people"),
            chance: trouble.people,
            all: Vec::new(),
            places: Vec::new(),
        }
    }

    /// The positions of all people at the next scan, which the robot takes at `truth`.
    pub(super) fn around(&mut self, truth: Pose) -> &[[f64; 2]] {
        if self.rng.chance(self.chance) {
            let side = self.rng.range(-0.7, 0.7);
            let ahead = self.rng.range(0.8, 6.0);
            let follows = self.rng.chance(0.4);
            let by = Pose::new(ahead, side, 0.0);
            let step = [0, 1].map(|_: u8| self.rng.range(-0.2, 0.2));
            self.all.push(Person {
                at: if follows { by } else { moved(truth, by) },
                step,
                follows,
                left: 10 + self.rng.below(60),
            });
        }
        self.all.retain(|person| person.left > 0);
        for person in &mut self.all {
            person.left -= 1;
            if !person.follows {
                person.at.x += person.step[0];
                person.at.y += person.step[1];
            }
        }
        let place = |person: &Person| {
            let at = if person.follows {
                moved(truth, person.at)
            } else {
                person.at
            };
            [at.x, at.y]
        };
        self.places = self.all.iter().map(place).collect();
        &self.places
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a person 3 m ahead meets the beam straight ahead at 2.75 m, and no beam at 90
    /// degrees.
    #[test]
    fn a_beam_ends_at_a_person() {
        let people = [[1.0, 5.0]];
        let at = Pose::new(1.0, 2.0, core::f64::consts::FRAC_PI_2);
        assert!((met(&people, at, 0.0) - 2.75).abs() < 1e-9);
        assert!(met(&people, at, 1.0) > 1e9);
    }

    /// The robot at (0, 0) facing +x is carried 3 m towards (10, 0) and turned by half a radian.
    #[test]
    fn an_event_hides_motion_or_invents_it() {
        let event = |what| Event { at_m: 0.0, what };
        let hidden = |what| event(what).hidden(Pose::default(), [10.0, 0.0]);
        let [unseen, air] = hidden(What::Carried(3.0, 0.5));
        assert!((unseen.x - 3.0).abs() < 1e-9 && (unseen.theta - 0.5).abs() < 1e-9);
        assert_eq!(air, Pose::default());
        let by = Pose::new(1.0, 0.0, 0.2);
        assert_eq!(hidden(What::Air(by)), [Pose::default(), by]);
        assert_eq!(hidden(What::Unseen(by)), [by, Pose::default()]);
    }
}
