//! Checks that damaged frames do not move the robot.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use super::rests::is_pushed;
use crate::Shared;
use crate::codec::{Codec, Stream};
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::{Axis, Instruments, Need};
use crate::scenario::FaultSpec;

/// Time from a valid frame until the set-points have followed it.
const FOLLOWS: Duration = Duration::from_millis(1_500);
/// Duration of wrong set-points that fails.
const LASTING: Duration = Duration::from_millis(200);
/// A set-point may exceed its greatest value after the last valid frame by this factor, and by this
/// share of the axis's limit: the control of the wheels corrects it.
const FACTOR: f64 = 1.5;
const SHARE: f64 = 0.1;

/// The robot does not move before a frame with a valid checksum has arrived on the link of its
/// orders. While it is driven by hand, damaged frames do not increase or reverse its set-points.
pub struct MovesOnSoundOrders {
    ear: Option<Shared<Ear>>,
    needs: Vec<Need>,
    /// Times without a fault on other links: the set-points may follow an order later when their
    /// device works again.
    calm: Calm,
    steering: Steering,
    /// Whether the program starts in a mode that needs no order.
    starts_alone: bool,
    moved_first: Option<Instant>,
    has_moved: bool,
}

/// The set-points since the last valid frame.
#[derive(Clone, Debug, Default)]
struct Steering {
    /// Number of valid frames so far.
    sound: u64,
    /// For each axis its least and its greatest set-point.
    allowed: Vec<[f64; 2]>,
    wrong_since: Option<Instant>,
    broken: Option<(Instant, String)>,
}

impl Steering {
    /// Takes the set-points at `now`. `is_fresh`: they may follow the last valid frame.
    /// `is_judged`: damaged bytes have arrived since, and only orders move the robot.
    fn take(&mut self, now: Instant, axes: &[Axis], sound: u64, is_fresh: bool, is_judged: bool) {
        if sound != self.sound || self.allowed.len() != axes.len() {
            self.sound = sound;
            self.allowed = vec![[0.0; 2]; axes.len()];
        }
        let pairs = self.allowed.iter_mut().zip(axes);
        if is_fresh {
            for ([least, most], axis) in pairs {
                (*least, *most) = (least.min(axis.set_point), most.max(axis.set_point));
            }
            self.wrong_since = None;
            return;
        }
        let wrong = pairs.into_iter().find(|([least, most], axis)| {
            let margin = SHARE * axis.limit.unwrap_or(1.0);
            let allowed = *least * FACTOR - margin..=*most * FACTOR + margin;
            !allowed.contains(&axis.set_point)
        });
        let wrong = wrong.map(|(_, axis)| format!("{} = {}", axis.name, axis.set_point));
        let Some(wrong) = wrong.filter(|_| is_judged) else {
            self.wrong_since = None;
            return;
        };
        let since = *self.wrong_since.get_or_insert(now);
        if now - since >= LASTING && self.broken.is_none() {
            self.broken = Some((since, wrong));
        }
    }
}

#[derive(Clone)]
struct Ear {
    link: usize,
    name: String,
    codec: &'static Codec,
    stream: Stream,
    heard_at: Instant,
    sound: u64,
    damaged: u64,
    /// Times of the last valid frame, and of the last damaged bytes.
    sound_at: Option<Instant>,
    damaged_at: Option<Instant>,
}

impl MovesOnSoundOrders {
    /// Observes `link` of `rig`; without a link, or without its codec, nothing is observed. `calm`:
    /// the times without a fault on other links.
    pub fn listening(
        rig: &mut Rig,
        instruments: &dyn Instruments,
        link: Option<&str>,
        calm: Calm,
    ) -> Self {
        let name = link.unwrap_or_default();
        let index = rig.links().iter().position(|known| known.name == name);
        let codec = instruments.codec_towards(rig, name, Direction::ToMaster);
        let ear = index.zip(codec).map(|(link, codec)| Ear {
            link,
            name: name.to_owned(),
            codec,
            heard_at: Instant::ZERO,
            stream: Stream::towards(codec, Direction::ToMaster),
            sound: 0,
            damaged: 0,
            sound_at: None,
            damaged_at: None,
        });
        let ear = ear.map(Shared::new);
        if let Some(ear) = &ear {
            rig.add_tap(Box::new(Listener::of(ear)));
        }
        Self {
            ear,
            needs: instruments.needs(),
            calm,
            steering: Steering::default(),
            starts_alone: false,
            moved_first: None,
            has_moved: false,
        }
    }

    /// The program may move before the first order: it starts in a mode of its own.
    #[must_use]
    pub const fn starting_alone(mut self, starts_alone: bool) -> Self {
        self.starts_alone = starts_alone;
        self
    }

    /// Whether only orders on `link` move a robot in this mode.
    fn is_by_hand(&self, link: &str, mode: Option<&str>) -> bool {
        let mut needs = self.needs.iter().filter(|need| need.link == link);
        needs.any(|need| mode.is_some_and(|mode| need.only.contains(&mode)))
    }
}

struct Listener {
    /// Link of the ear, which is locked only for bytes of this link.
    link: usize,
    ear: Shared<Ear>,
}

impl Listener {
    fn of(ear: &Shared<Ear>) -> Self {
        Self {
            link: ear.lock().link,
            ear: ear.clone(),
        }
    }
}

impl Tap for Listener {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if direction == Direction::ToMaster && link == self.link {
            let mut ear = self.ear.lock();
            let at = delivery.at;
            let mut found = Vec::new();
            // A receiver discards a frame that a pause splits.
            if at - ear.heard_at > ear.codec.idle() {
                found = ear.stream.idle();
            }
            ear.heard_at = at;
            found.extend(ear.stream.push(&delivery.bytes));
            for stretch in found {
                match stretch.is_frame() {
                    true => (ear.sound, ear.sound_at) = (ear.sound + 1, Some(at)),
                    false => (ear.damaged, ear.damaged_at) = (ear.damaged + 1, Some(at)),
                }
            }
            // Bytes that wait for the end of a frame may be a damaged one.
            if ear.stream.pending() > 0 {
                ear.damaged_at = Some(at);
            }
        }
    }
}

impl Checker for MovesOnSoundOrders {
    fn observe(&mut self, look: &Look<'_>) {
        let Some(ear) = &self.ear else { return };
        let is_driven = look.rig.world.is_moving() && !is_pushed(look);
        self.has_moved |= is_driven;
        let now = look.rig.now();
        let (sound, sound_at, damaged_at, by_hand) = {
            let ear = ear.lock();
            let mode = look.rig.program().map(|program| program.mode());
            let by_hand = self.is_by_hand(&ear.name, mode);
            (ear.sound, ear.sound_at, ear.damaged_at, by_hand)
        };
        if is_driven && !self.starts_alone && self.moved_first.is_none() && sound == 0 {
            self.moved_first = Some(now);
        }
        let Some(sound_at) = sound_at else { return };
        let is_fresh = now - sound_at <= FOLLOWS;
        let is_damaged = damaged_at.is_some_and(|at| at > sound_at);
        let is_judged = by_hand && is_damaged;
        let steering = &mut self.steering;
        let may_change = is_fresh || !by_hand || !self.calm.is(now);
        steering.take(now, look.axes, sound, may_change, is_judged);
    }

    fn verdict(&self) -> Check {
        let name = "moves-on-sound-orders";
        let Some(ear) = &self.ear else {
            let detail = "no link of orders whose frames are known; set orders_link";
            return Check::not_observed(name, detail);
        };
        let ear = ear.lock();
        let (link, damaged) = (&ear.name, ear.damaged);
        let detail = match (self.moved_first, &self.steering.broken) {
            (Some(at), _) => format!(
                "moved at {at} s, before any valid frame on {link}; {damaged} sections of damaged bytes"
            ),
            (None, Some((at, wrong))) => {
                format!("{wrong} at {at} s, which no valid frame on {link} ordered")
            }
            (None, None) => format!("no motion without a valid frame on {link}"),
        };
        let is_sound = self.moved_first.is_none() && self.steering.broken.is_none();
        let check = Check::new(name, is_sound, detail);
        check.if_observed(ear.damaged > 0 || (ear.sound > 0 && self.has_moved))
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let ear = self.ear.as_ref().map(|ear| {
            let ear = ear.lock().clone();
            Shared::new(ear)
        });
        if let Some(ear) = &ear {
            rig.add_tap(Box::new(Listener::of(ear)));
        }
        Some(Box::new(Self {
            ear,
            needs: self.needs.clone(),
            calm: self.calm.clone(),
            steering: self.steering.clone(),
            starts_alone: self.starts_alone,
            moved_first: self.moved_first,
            has_moved: self.has_moved,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drive with a limit of 2 m/s at a set-point.
    fn axes(set_point: f64) -> [Axis; 1] {
        [Axis {
            name: "drive".into(),
            unit: "m/s",
            set_point,
            limit: Some(2.0),
            actual: None,
        }]
    }

    /// A valid frame is followed by 1 m/s. After damaged bytes, the set-point may be 1.5 times as
    /// large plus a tenth of the limit: 1.7 m/s ahead, or 0.2 m/s back. More than that fails after
    /// 200 ms.
    #[test]
    fn set_points_stay_within_those_of_the_last_order() {
        let after = |set_point: f64, millis: u64, is_judged: bool| {
            let mut steering = Steering::default();
            let at = Instant::from_millis;
            steering.take(at(100), &axes(1.0), 1, true, false);
            steering.take(at(1_000), &axes(set_point), 1, false, is_judged);
            steering.take(at(1_000 + millis), &axes(set_point), 1, false, is_judged);
            steering.broken
        };
        assert_eq!(
            (after(1.7, 900, true), after(-0.2, 900, true)),
            (None, None)
        );
        assert_eq!(
            (after(1.71, 199, true), after(1.71, 900, false)),
            (None, None)
        );
        let told = (Instant::from_secs(1), "drive = 1.71".to_owned());
        assert_eq!(after(1.71, 200, true), Some(told));
        assert!(after(-0.21, 200, true).is_some());
    }

    /// A new order, or a moment in which the set-points may follow it, restarts the time of wrong
    /// set-points.
    #[test]
    fn wrong_set_points_have_to_last() {
        let at = Instant::from_millis;
        let mut steering = Steering::default();
        steering.take(at(0), &axes(1.0), 1, true, true);
        for millis in [100, 250] {
            steering.take(at(millis), &axes(2.0), 1, false, true);
        }
        steering.take(at(260), &axes(1.0), 1, false, true);
        steering.take(at(400), &axes(2.0), 1, false, true);
        assert_eq!(steering.broken, None);
        steering.take(at(500), &axes(2.0), 2, true, true);
        steering.take(at(600), &axes(3.0), 2, false, true);
        steering.take(at(900), &axes(3.2), 2, false, true);
        assert_eq!(steering.broken, None);
        steering.take(at(900), &axes(3.21), 2, false, true);
        steering.take(at(1_100), &axes(3.21), 2, false, true);
        assert_eq!(steering.broken.map(|(since, _)| since), Some(at(900)));
    }

    use super::super::puppet::{copied, cut, puppet, scenario};
    use crate::codec::BUS_HIGH_FIRST;
    use crate::robots::checker::Status;

    const FRAME: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];

    /// A robot that only the radio drives in the mode "hand".
    struct Robot;

    impl Instruments for Robot {
        fn codec(&self, _: &Rig, link: &str) -> Option<&'static Codec> {
            (link != "unknown").then_some(&BUS_HIGH_FIRST)
        }

        fn needs(&self) -> Vec<Need> {
            vec![Need::always("lidar"), Need::always("radio").only(&["hand"])]
        }
    }

    struct Course {
        rig: Rig,
        radio: usize,
        device: usize,
        other: usize,
        checker: MovesOnSoundOrders,
    }

    fn course() -> Course {
        let names = ["base", "radio"];
        let (mut rig, [base, radio]) = crate::rig::bare::linked(names, 1_000_000);
        puppet(&mut rig).mode = "hand";
        let calm = Calm::of(&scenario("").0, &rig, &|link| link == "base");
        Course {
            checker: MovesOnSoundOrders::listening(&mut rig, &Robot, Some("radio"), calm),
            radio: radio[0].node,
            device: radio[1].node,
            other: base[0].node,
            rig,
        }
    }

    impl Course {
        /// Drives at this speed and with this set-point until `until`, looked at each 100 ms.
        fn go(&mut self, until: u64, speed: f64, set_point: f64) {
            use emulators::world::Command;
            let from = self.rig.now().as_millis();
            for millis in (from + 100..=until).step_by(100) {
                for wheel in ["left", "right"] {
                    let speed = Command::Speed(speed);
                    self.rig.world.actuate(wheel, speed).expect("a wheel");
                }
                self.rig.run_until(Instant::from_millis(millis));
                self.checker.observe(&Look {
                    rig: &self.rig,
                    axes: &axes(set_point),
                    contacts: &[],
                });
            }
        }

        fn told(&self) -> (Status, String) {
            let check = self.checker.verdict();
            (check.status, check.detail)
        }
    }

    use Status::{Fail, NotObserved, Pass};

    /// A robot that moves without a frame, or behind garbage, or frames of other lines.
    #[test]
    fn a_robot_moves_after_a_valid_frame() {
        let sound = "no motion without a valid frame on radio".to_owned();
        let mut ordered = course();
        ordered.go(500, 0.0, 0.0);
        assert_eq!(ordered.told(), (NotObserved, sound.clone()));
        ordered.rig.inject(ordered.radio, &FRAME);
        ordered.go(900, 0.0, 0.0);
        assert_eq!(ordered.told().0, NotObserved);
        ordered.go(1_500, 0.2, 1.0);
        assert_eq!(ordered.told(), (Pass, sound.clone()));
        let mut alone = course();
        for (node, bytes, until) in [
            (alone.device, &FRAME[..], 100),
            (alone.other, &FRAME, 200),
            (alone.radio, &[0x55], 400),
            (alone.radio, &[0x55], 500),
        ] {
            alone.rig.inject(node, bytes);
            alone.go(until, 0.0, 0.0);
        }
        assert_eq!(alone.told(), (Pass, sound));
        alone.go(900, 0.2, 1.0);
        let told =
            "moved at 0.600000 s, before any valid frame on radio; 1 sections of damaged bytes";
        assert_eq!(alone.told(), (Fail, told.to_owned()));
        assert!(copied(&alone.checker, &alone.rig).ends_with(told));
        let mut started = course();
        started.checker = started.checker.starting_alone(true);
        started.go(900, 0.2, 1.0);
        assert_eq!(started.told().0, NotObserved);
    }

    /// An order at 0.1 s to drive at 0.5 m/s may be followed until 1.6 s. Behind damaged bytes a
    /// set-point of 1.5 m/s is none of it: half of it more and a tenth of the limit is 0.95 m/s.
    fn steered(change: impl FnOnce(&mut Course)) -> (Status, String) {
        let mut course = course();
        course.go(100, 0.0, 0.0);
        course.rig.inject(course.radio, &FRAME);
        course.go(1_600, 0.2, 0.5);
        course.rig.inject(course.radio, &FRAME[..2]);
        change(&mut course);
        course.go(2_500, 0.2, 1.5);
        course.told()
    }

    #[test]
    fn damaged_frames_do_not_speed_a_robot_up() {
        let told = "drive = 1.5 at 1.700000 s, which no valid frame on radio ordered";
        assert_eq!(steered(|_| {}), (Fail, told.to_owned()));
        assert_eq!(steered(|it| puppet(&mut it.rig).mode = "go").0, Pass);
        assert_eq!(steered(|it| it.rig.inject(it.radio, &FRAME[2..])).0, Pass);
        let fault = |link: &str| {
            let fault = cut(link, 1, 20);
            steered(|it| it.checker.faults_changed(&[fault], &it.rig)).0
        };
        assert_eq!([fault("base"), fault("radio")], [Pass, Fail]);
        // Without damaged bytes, it is the program's own matter.
        let mut own = course();
        own.rig.inject(own.radio, &FRAME);
        own.go(1_600, 0.2, 0.5);
        own.go(2_500, 0.2, 1.5);
        assert_eq!(own.told().0, Pass);
    }

    /// A part of a frame that nothing ends may be a damaged one, and a frame that a pause parts is.
    #[test]
    fn parts_of_frames_are_damaged() {
        let noted = |chunks: &[(u64, &[u8])]| {
            let mut course = course();
            for &(millis, bytes) in chunks {
                course.rig.run_until(Instant::from_millis(millis));
                course.rig.inject(course.radio, bytes);
            }
            course.rig.run_for(Duration::from_millis(1));
            let ear = course.checker.ear.as_ref().expect("a link").lock();
            let millis = |at: Option<Instant>| at.map(Instant::as_millis);
            (
                ear.sound,
                ear.damaged,
                millis(ear.sound_at),
                millis(ear.damaged_at),
            )
        };
        assert_eq!(noted(&[(10, &FRAME)]), (1, 0, Some(10), Some(10)));
        assert_eq!(noted(&[(10, &FRAME[..2])]), (0, 0, None, Some(10)));
        let idle = u64::try_from(BUS_HIGH_FIRST.idle().as_millis()).expect("short");
        let parted = noted(&[(10, &FRAME[..2]), (12 + idle, &FRAME)]);
        assert_eq!((parted.0, parted.1), (1, 1));
        let whole = noted(&[(10, &FRAME[..2]), (9 + idle, &FRAME[2..])]);
        assert_eq!((whole.0, whole.1), (1, 0));
    }

    #[test]
    fn a_link_without_known_frames_is_not_judged() {
        let (mut rig, _) = crate::rig::bare::linked(["unknown"], 1_000_000);
        for link in [None, Some("unknown"), Some("gone")] {
            let calm = Calm::default();
            let checker = MovesOnSoundOrders::listening(&mut rig, &Robot, link, calm);
            let check = checker.verdict();
            assert_eq!(check.status, NotObserved, "{link:?}");
            assert!(check.detail.ends_with("set orders_link"));
        }
    }

    /// Damaged bytes at the time of the last valid frame are not behind it.
    #[test]
    fn only_damage_behind_the_last_frame_is_judged() {
        let mut course = course();
        course.rig.inject(course.radio, &FRAME);
        course.go(1_600, 0.2, 0.5);
        {
            let mut ear = course.checker.ear.as_ref().expect("a link").lock();
            ear.damaged_at = ear.sound_at;
        }
        course.go(2_500, 0.2, 1.5);
        assert_eq!(course.told().0, Pass);
    }

    /// 3 m/s were ordered, then 1 m/s: up to 1.7 m/s are allowed from then on.
    #[test]
    fn another_order_has_its_own_limits() {
        let at = Instant::from_millis;
        let mut steering = Steering::default();
        steering.take(at(0), &axes(3.0), 1, true, true);
        steering.take(at(100), &axes(1.0), 2, true, true);
        for millis in [200, 400] {
            steering.take(at(millis), &axes(2.0), 2, false, true);
        }
        assert_eq!(steering.broken.map(|(since, _)| since), Some(at(200)));
    }
}
