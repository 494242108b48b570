//! Checks that the robot stops when a link that it needs falls silent.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use super::eyes::Eyes;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::{Instruments, Need};
use crate::scenario::FaultSpec;

/// Time to brake: the wheels of the built-in robots stand after 0.3 s.
const BRAKES: Duration = Duration::from_millis(500);
/// Maximum speed of a resting robot, m/s and rad/s: noise of the drive train.
const REST_M_S: f64 = 0.03;
const REST_RAD_S: f64 = 0.15;
/// Time within which commands have reached the drive's device. Without them, while a fault acts on
/// the drive, the program cannot stop the robot; `motors-stop-after-silence` covers that case.
const COMMANDS: Duration = Duration::from_millis(300);

/// The robot rests after a link that it needs has been silent for too long.
pub struct RestsAfterSilence {
    watched: Vec<Watched>,
    /// Turns of the lidar that show a distance.
    eyes: Option<Eyes>,
    instruments: Option<Arc<dyn Instruments>>,
    drive: Vec<String>,
    /// Whether a fault acts on the drive.
    calm: Calm,
    within: Duration,
    commanded: Heard,
    /// Last time with a set-point other than 0.
    driven_at: Instant,
    has_moved: bool,
}

/// Time of the last bytes.
#[derive(Clone, Copy, Debug)]
struct Heard {
    delivered: u64,
    at: Instant,
}

impl Heard {
    const NEVER: Self = Self {
        delivered: 0,
        at: Instant::ZERO,
    };

    /// Updates the count at `now`; returns the time since the last bytes.
    fn take(&mut self, now: Instant, delivered: u64) -> Duration {
        if delivered != self.delivered {
            (self.delivered, self.at) = (delivered, now);
        }
        now - self.at
    }
}

#[derive(Clone, Debug)]
struct Watched {
    need: Need,
    heard: Heard,
    /// Time since which the robot moves although it must not, while commands reach its drive.
    moving_since: Option<Instant>,
    /// Whether the robot needed the link when its silence began: a robot may change its mode then.
    was_needed: bool,
    /// Time since which the robot is in a mode that needs the link.
    needed_since: Option<Instant>,
    /// Number of silences during which the robot had time to stop, and whether the current one
    /// counts.
    silences: u64,
    is_counted: bool,
    broken: Option<(Instant, Duration)>,
}

impl RestsAfterSilence {
    /// Observes a robot that must rest when a link in `needs` has been silent for the time
    /// `within`. `drive` are the links that carry the commands to its drive; `calm` knows the times
    /// in which no fault acts on them.
    pub fn new(needs: Vec<Need>, drive: Vec<String>, calm: Calm, within: Duration) -> Self {
        let watched = needs.into_iter().map(|need| Watched {
            need,
            heard: Heard::NEVER,
            moving_since: None,
            was_needed: false,
            needed_since: None,
            silences: 0,
            is_counted: false,
            broken: None,
        });
        Self {
            watched: watched.collect(),
            eyes: None,
            instruments: None,
            drive,
            calm,
            within,
            commanded: Heard::NEVER,
            driven_at: Instant::ZERO,
            has_moved: false,
        }
    }

    /// Also treats a lidar as silent if its turns show no distance.
    #[must_use]
    pub fn with_eyes(mut self, rig: &mut Rig, instruments: &Arc<dyn Instruments>) -> Self {
        self.eyes = Eyes::open(rig, &**instruments);
        self.instruments = Some(Arc::clone(instruments));
        self
    }

    /// Number of bytes that the robot received on `link`. For the link of its lidar, the number of
    /// turns with a distance, if such turns are known.
    fn heard_on(&self, rig: &Rig, link: &str) -> u64 {
        let eyes = self.eyes.as_ref().filter(|eyes| eyes.link() == link);
        let turns = eyes.map(Eyes::turns).filter(|turns| *turns > 0);
        let bytes = || delivered(rig, link, Direction::ToMaster);
        turns.map_or_else(bytes, |turns| match self.may_see_nothing(rig) {
            true => turns + bytes(),
            false => turns + eyes.map_or(0, Eyes::damaged),
        })
    }

    /// Whether the robot is nearer to an obstacle than its scanner measures.
    fn may_see_nothing(&self, rig: &Rig) -> bool {
        let instruments = self.instruments.as_ref();
        let below = instruments.and_then(|instruments| instruments.blind_below_m());
        below.is_some_and(|below| rig.world.clearance_up_to(below) < below)
    }
}

/// Time in which a robot whose set-points are 0 may roll out: a board without supply does not
/// brake.
const ROLLS_OUT: Duration = Duration::from_secs(2);

/// Whether the robot moves by itself: a person who touches it may push it while its set-points are
/// 0.
pub(super) fn moves_itself(look: &Look<'_>) -> bool {
    let world = &look.rig.world;
    let is_moving = world.speed().abs() > REST_M_S || world.turn_rate().abs() > REST_RAD_S;
    is_moving && !is_pushed(look)
}

/// Whether something touches the robot while its set-points are 0.
pub(super) fn is_pushed(look: &Look<'_>) -> bool {
    look.rig.world.is_touching() && !look.is_driven()
}

fn delivered(rig: &Rig, link: &str, direction: Direction) -> u64 {
    let link = rig.link(link);
    link.map_or(0, |link| link.line(direction).traffic().delivered)
}

impl Checker for RestsAfterSilence {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        let sent = self.drive.iter();
        let sent = sent.map(|link| delivered(rig, link, Direction::ToDevice));
        let unreached = self.commanded.take(now, sent.sum());
        let is_reached = self.drive.is_empty() || unreached < COMMANDS || self.calm.is(now);
        let is_moving = moves_itself(look);
        self.has_moved |= is_moving;
        let is_driven = look.axes.is_empty() || look.is_driven();
        if is_driven {
            self.driven_at = now;
        }
        let is_moving = is_moving && (is_driven || now - self.driven_at > ROLLS_OUT);
        let mode = rig.program().map(|program| program.mode());
        let heard = self.watched.iter();
        let heard: Vec<u64> = heard
            .map(|one| self.heard_on(rig, &one.need.link))
            .collect();
        for (one, count) in self.watched.iter_mut().zip(heard) {
            let silence = one.heard.take(now, count);
            let limit = self.within.max(one.need.stops_after) + BRAKES;
            let is_silent = silence > limit;
            let is_needed = one.need.is_needed(mode);
            if silence <= BRAKES {
                one.was_needed = is_needed;
            }
            let is_judged = is_silent && is_reached && (is_needed || one.was_needed);
            let is_observed = is_judged && self.has_moved;
            one.silences += u64::from(is_observed && !one.is_counted);
            one.is_counted = is_silent && (one.is_counted || is_observed);
            // A robot that begins to need a silent link has the same time to stop.
            let needed_since = one.needed_since.filter(|_| is_needed);
            let needed_since = *one.needed_since.insert(needed_since.unwrap_or(now));
            let has_had_time = now - needed_since > limit;
            let is_wrong = is_silent && has_had_time && is_moving && is_reached && is_needed;
            if !is_wrong {
                one.moving_since = None;
                continue;
            }
            let since = *one.moving_since.get_or_insert(now);
            if now - since >= COMMANDS && one.broken.is_none() {
                one.broken = Some((now, silence));
            }
        }
    }

    fn verdict(&self) -> Check {
        let name = "rests-after-silence";
        if self.watched.is_empty() {
            let detail = "the robot names no link that it needs; set rests_without";
            return Check::not_observed(name, detail);
        }
        let broken = self.watched.iter().find_map(|one| Some((one, one.broken?)));
        let silences: u64 = self.watched.iter().map(|one| one.silences).sum();
        let observed = self.watched.iter().filter(|one| one.silences > 0);
        let links: Vec<&str> = observed.map(|one| &*one.need.link).collect();
        let detail = match broken {
            Some((one, (at, silence))) => format!(
                "still moving at {at} s, {:.1} s after the last byte of {}",
                silence.as_secs_f64(),
                one.need.link
            ),
            None if silences == 0 => "no silence of a link that the moving robot needs".to_owned(),
            None => format!(
                "at rest in each of {silences} silences of {}",
                links.join(", ")
            ),
        };
        let check = Check::new(name, broken.is_none(), detail);
        check.if_observed(silences > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let eyes = self.eyes.as_ref().zip(self.instruments.as_ref());
        Some(Box::new(Self {
            watched: self.watched.clone(),
            eyes: eyes.and_then(|(eyes, instruments)| eyes.fork(rig, &**instruments)),
            instruments: self.instruments.clone(),
            drive: self.drive.clone(),
            calm: self.calm.clone(),
            ..*self
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silence_begins_with_the_last_bytes() {
        let at = Instant::from_millis;
        let mut heard = Heard::NEVER;
        let silences = [(100, 0), (200, 5), (300, 5), (400, 6), (900, 6)];
        let silences = silences.map(|(millis, count)| heard.take(at(millis), count).as_millis());
        assert_eq!(silences, [100, 0, 100, 0, 500]);
    }

    use emulators::world::{BodyConfig, Command, Point, Pose, Scene, Shape, World};

    use super::super::puppet::{copied, cut, puppet, scenario};
    use super::super::tests::{drive, linked, rig};
    use crate::robots::checker::Status;

    /// A robot at these speeds of its wheels; they are 0.26 m apart.
    fn moves(wheels: [f64; 2], set_point: f64) -> [bool; 2] {
        let mut rig = rig();
        for (wheel, speed) in ["left", "right"].into_iter().zip(wheels) {
            let speed = Command::Speed(speed);
            rig.world.actuate(wheel, speed).expect("a wheel");
        }
        rig.run_until(Instant::from_secs(1));
        let look = Look {
            rig: &rig,
            axes: &[drive(set_point)],
            contacts: &[],
        };
        [moves_itself(&look), is_pushed(&look)]
    }

    /// 0.03 m/s and 0.15 rad/s are noise: 0.039 m/s of difference between the wheels.
    #[test]
    fn a_robot_moves_by_its_speed_or_its_turn() {
        for (wheels, expected) in [
            ([0.031, 0.031], true),
            ([0.029, 0.029], false),
            ([-0.031, -0.031], true),
            ([-0.02, 0.02], true),
            ([0.02, -0.02], true),
            ([-0.019, 0.019], false),
        ] {
            assert_eq!(moves(wheels, 0.0), [expected, false], "{wheels:?}");
        }
    }

    /// A robot that touches a wall while its set-points are 0 is pushed.
    #[test]
    fn a_touched_robot_without_set_points_is_pushed() {
        let wall = Shape::Wall {
            from: Point::new(0.3, -1.0),
            to: Point::new(0.3, 1.0),
        };
        let scene = Scene::new([wall], Vec::new()).expect("one wall");
        let body = BodyConfig::default().ideal();
        let world = World::new(scene, body, Pose::default(), 1).expect("free");
        let mut rig = Rig::new(world);
        let look = |rig: &mut Rig, until: u64, wheels: f64, set_point: f64| {
            for wheel in ["left", "right"] {
                let speed = Command::Speed(wheels);
                rig.world.actuate(wheel, speed).expect("a wheel");
            }
            rig.run_until(Instant::from_millis(until));
            let look = Look {
                rig,
                axes: &[drive(set_point)],
                contacts: &[],
            };
            [is_pushed(&look), moves_itself(&look)]
        };
        assert_eq!(look(&mut rig, 100, 0.1, 0.0), [false, true]);
        // The disc of 160 mm has 140 mm to the wall.
        look(&mut rig, 3_000, 0.1, 0.0);
        assert!(look(&mut rig, 3_010, 0.1, 0.0)[0]);
        assert!(!look(&mut rig, 3_020, 0.1, 0.5)[0]);
        assert_eq!(look(&mut rig, 3_030, 0.1, 0.0), [true, false]);
    }

    struct Course {
        rig: Rig,
        rests: RestsAfterSilence,
        lidar: usize,
        base: usize,
    }

    /// A robot that needs its lidar, and gets its commands over the base's line.
    fn course(need: Need) -> Course {
        let (mut rig, [lidar, base]) = crate::rig::bare::linked(["lidar", "base"], 1_000_000);
        let calm = Calm::of(&scenario("").0, &rig, &|link| link == "base");
        let drive = vec!["base".to_owned()];
        puppet(&mut rig).mode = "go";
        Course {
            rests: RestsAfterSilence::new(vec![need], drive, calm, Duration::from_secs(1)),
            rig,
            lidar: lidar[0].node,
            base: base[1].node,
        }
    }

    impl Course {
        /// Drives at this speed until `until`, looked at each 100 ms.
        fn go(&mut self, until: u64, lidar: bool, commands: bool, speed: f64, set_point: f64) {
            let from = self.rig.now().as_millis();
            for millis in (from + 100..=until).step_by(100) {
                for (node, is_sent) in [(self.lidar, lidar), (self.base, commands)] {
                    if is_sent {
                        self.rig.inject(node, &[1]);
                    }
                }
                for wheel in ["left", "right"] {
                    let speed = Command::Speed(speed);
                    self.rig.world.actuate(wheel, speed).expect("a wheel");
                }
                self.rig.run_until(Instant::from_millis(millis));
                self.rests.observe(&Look {
                    rig: &self.rig,
                    axes: &[drive(set_point)],
                    contacts: &[],
                });
            }
        }

        fn told(&self) -> (Status, String) {
            let check = self.rests.verdict();
            (check.status, check.detail)
        }
    }

    use Status::{Fail, NotObserved, Pass};

    /// The lidar falls silent at 2 s. From 3.5 s on the robot must not move; 0.3 s of it fail.
    #[test]
    fn a_robot_that_drives_on_is_told() {
        let mut on = course(Need::always("lidar"));
        on.go(2_000, true, true, 0.2, 1.0);
        on.go(3_800, false, true, 0.2, 1.0);
        assert_eq!(on.told().0, Pass);
        on.go(9_000, false, true, 0.2, 1.0);
        let words = "still moving at 3.900000 s, 1.9 s after the last byte of lidar".to_owned();
        assert_eq!(on.told(), (Fail, words));
        assert!(copied(&on.rests, &on.rig).starts_with("FAIL"));
        // A documented time of its own is longer.
        let mut late = course(Need {
            stops_after: Duration::from_secs(3),
            ..Need::always("lidar")
        });
        late.go(2_000, true, true, 0.2, 1.0);
        late.go(5_800, false, true, 0.2, 1.0);
        assert_eq!(late.told().0, Pass);
        late.go(5_900, false, true, 0.2, 1.0);
        assert_eq!(late.told().0, Fail);
    }

    /// Each silence counts once, and only for a robot that has moved.
    #[test]
    fn silences_are_counted() {
        let mut two = course(Need::always("lidar"));
        two.go(2_000, true, true, 0.2, 1.0);
        let none = "no silence of a link that the moving robot needs".to_owned();
        assert_eq!(two.told(), (NotObserved, none));
        two.go(3_500, false, true, 0.0, 0.0);
        assert_eq!(two.told().0, NotObserved);
        for (until, count) in [(3_600, 1), (6_000, 1)] {
            two.go(until, false, true, 0.0, 0.0);
            let words = format!("at rest in each of {count} silences of lidar");
            assert_eq!(two.told(), (Pass, words));
        }
        two.go(7_000, true, true, 0.2, 1.0);
        two.go(9_000, false, true, 0.0, 0.0);
        assert_eq!(two.told().1, "at rest in each of 2 silences of lidar");
        let mut resting = course(Need::always("lidar"));
        resting.go(2_000, true, true, 0.0, 0.0);
        resting.go(9_000, false, true, 0.0, 0.0);
        assert_eq!(resting.told().0, NotObserved);
    }

    /// Without commands for 0.3 s while a fault acts on the drive, the program cannot stop it.
    #[test]
    fn a_drive_that_no_command_reaches_is_not_judged() {
        let judged = |fault: bool, commands: bool| {
            let mut course = course(Need::always("lidar"));
            if fault {
                let fault = cut("base", 0, 50);
                course.rests.faults_changed(&[fault], &course.rig);
            }
            course.go(2_000, true, commands, 0.2, 1.0);
            course.go(9_000, false, commands, 0.2, 1.0);
            course.told().0
        };
        assert_eq!(
            [
                judged(false, true),
                judged(false, false),
                judged(true, true)
            ],
            [Fail; 3]
        );
        assert_eq!(judged(true, false), NotObserved);
        // Every 0.3 s is too seldom, every 0.2 s is not.
        let every = |tenths: u64| {
            let mut course = course(Need::always("lidar"));
            let fault = cut("base", 0, 50);
            course.rests.faults_changed(&[fault], &course.rig);
            course.go(2_000, true, true, 0.2, 1.0);
            for tenth in 21..=60 {
                course.go(100 * tenth, false, tenth % tenths == 0, 0.2, 1.0);
            }
            course.told().0
        };
        assert_eq!([every(3), every(4)], [Fail, Pass]);
    }

    /// With set-points of 0 the robot may roll out for 2 s: until 5 s after a drive to 3 s.
    #[test]
    fn a_robot_may_roll_out() {
        let judged = |until: u64| {
            let mut course = course(Need::always("lidar"));
            course.go(2_000, true, true, 0.2, 1.0);
            course.go(3_000, false, true, 0.2, 1.0);
            course.go(until, false, true, 0.2, 0.0);
            course.told()
        };
        assert_eq!(judged(5_300).0, Pass);
        let (status, words) = judged(5_400);
        assert_eq!(status, Fail);
        assert!(words.starts_with("still moving at 5.400000 s"), "{words}");
    }

    /// A mode without the need, and one that begins to need the silent link at 5 s: it has 1.5 s to
    /// stop, too.
    #[test]
    fn a_mode_may_need_no_lidar() {
        let need = || Need::always("lidar").only(&["go"]);
        let mut other = course(need());
        puppet(&mut other.rig).mode = "search";
        other.go(2_000, true, true, 0.2, 1.0);
        other.go(5_000, false, true, 0.2, 1.0);
        assert_eq!(other.told().0, NotObserved);
        puppet(&mut other.rig).mode = "go";
        other.go(6_800, false, true, 0.2, 1.0);
        assert_eq!(other.told().0, Pass);
        other.go(6_900, false, true, 0.2, 1.0);
        assert!(
            other
                .told()
                .1
                .starts_with("still moving at 6.900000 s, 4.9 s after")
        );
        // A robot that gives up its mode in the silence has stopped by it.
        let mut gives_up = course(need());
        gives_up.go(2_000, true, true, 0.2, 1.0);
        gives_up.go(2_600, false, true, 0.2, 1.0);
        puppet(&mut gives_up.rig).mode = "stop";
        gives_up.go(9_000, false, true, 0.0, 0.0);
        assert_eq!(gives_up.told().0, Pass);
        // One that gave it up before, or within half a second, needed it no more.
        let mut before = course(need());
        before.go(2_000, true, true, 0.2, 1.0);
        puppet(&mut before.rig).mode = "stop";
        before.go(9_000, false, true, 0.0, 0.0);
        assert_eq!(before.told().0, NotObserved);
    }

    /// Turns with a distance; the first byte of a turn is its number of beams and one more.
    struct Blind(Option<f64>);

    impl Instruments for Blind {
        fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn crate::robots::ScanDecoder>)> {
            struct Numbers;
            impl crate::robots::ScanDecoder for Numbers {
                fn push(&mut self, bytes: &[u8]) -> Option<Vec<crate::robots::Beam>> {
                    let beam = crate::robots::Beam {
                        bearing: 0.0,
                        distance_m: 1.0,
                    };
                    let count = bytes.first()?.checked_sub(1)?;
                    Some(vec![beam; usize::from(count)])
                }
            }
            Some(("lidar".to_owned(), Box::new(Numbers)))
        }

        fn blind_below_m(&self) -> Option<f64> {
            self.0
        }
    }

    /// Bytes count until the first turn with a distance, then turns; near an obstacle bytes count
    /// again, as a scanner may measure nothing there.
    #[test]
    fn a_lidar_is_heard_by_its_turns() {
        let heard = |blind: Option<f64>, wall_m: f64| {
            let wall = Shape::Wall {
                from: Point::new(wall_m, -1.0),
                to: Point::new(wall_m, 1.0),
            };
            let scene = Scene::new([wall], Vec::new()).expect("one wall");
            let body = BodyConfig::default().ideal();
            let (mut rig, [lidar, base]) = crate::rig::bare::linked(["lidar", "base"], 1_000_000);
            rig.world = World::new(scene, body, Pose::default(), 1).expect("free");
            let robot: Arc<dyn Instruments> = Arc::new(Blind(blind));
            let mut rests =
                RestsAfterSilence::new(Vec::new(), Vec::new(), Calm::default(), Duration::ZERO);
            rests = rests.with_eyes(&mut rig, &robot);
            rig.inject(base[0].node, &[5, 5]);
            [0, 1, 2, 1, 1, 3].map(|byte| {
                rig.inject(lidar[0].node, &[byte]);
                rig.run_for(Duration::from_millis(1));
                assert_eq!(rests.heard_on(&rig, "base"), 2);
                rests.heard_on(&rig, "lidar")
            })
        };
        assert_eq!(heard(None, 0.3), [1, 2, 1, 1, 1, 2]);
        // The body's 160 mm leave 140 mm to the wall.
        assert_eq!(heard(Some(0.15), 0.3), [1, 2, 1 + 3, 1 + 4, 1 + 5, 2 + 6]);
        assert_eq!(heard(Some(0.13), 0.3), [1, 2, 1, 1, 1, 2]);
        let (rig, _) = linked("base");
        let rests = course(Need::always("base")).rests;
        assert_eq!(rests.heard_on(&rig, "other"), 0);
    }
}
