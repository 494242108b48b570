//! Compares the program's own counts of frames with the frames that arrived on its lines.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use super::paused::has_paused;
use crate::Shared;
use crate::codec::{Codec, Count, Counter};
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::{Instruments, Intake};
use crate::scenario::{FaultSpec, Scenario};

/// Interval between two comparisons.
const EVERY: Duration = Duration::from_millis(500);
/// Number of comparisons until a frame that arrived must be counted: 1 s. The program may compute
/// before it reads its queue.
const LATE: usize = 2;
/// The program may count this number of frames more than the rig.
const AHEAD: u64 = 2;
/// The same after a fault.
const SLACK: u64 = 12;
/// The program may also count one more frame for each of this number of valid frames: late bytes
/// may split a frame in the rig's decoder only.
const DISTURBED: u64 = 40;
/// Number of frames that the program may reject without damage: candidates inside of valid frames,
/// and bytes before its port is ready.
const REJECTED: u64 = 40;
/// Time of a restart of a device after the effects of a fault: an RPLIDAR that waits for the rest
/// of a damaged request answers again after 5 s, and its program then starts it again.
const RESTART: Duration = Duration::from_secs(2);
/// The program may miss one of this number of frames while it starts a device again.
const SHARE: u64 = 8;
/// Number of frames from which this share applies: a fast stream. Of a slower one, such as orders,
/// the program may miss only one of 50 frames.
const FAST: u64 = 1_000;

/// The program accepts each valid frame that arrives on its lines, and no other.
pub struct CountsTrue {
    watched: Vec<Watched>,
    next: Instant,
}

struct Watched {
    intake: Intake,
    ear: Shared<Ear>,
    /// Valid frames at the last comparisons, oldest first.
    sound: VecDeque<u64>,
    accepted: u64,
    /// Times without a fault on the link, and whether one has acted.
    calm: Calm,
    was_disturbed: bool,
    /// Number of frames that the program may have given up during faults: late frames, and those of
    /// a device whose answer to its last request was damaged, until the program starts it again.
    given_up: u64,
    broken: Option<(Instant, String)>,
}

/// The frames of a line.
#[derive(Clone)]
struct Ear {
    link: usize,
    direction: Direction,
    codec: &'static Codec,
    counter: Counter,
    /// Another decoder, which does not give up a frame in a pause: a fault may delay single bytes.
    patient: Counter,
    heard_at: Instant,
    /// Valid frames of the first decoder, and of the patient one.
    sound: u64,
    patient_sound: u64,
    damaged: u64,
}

impl CountsTrue {
    /// Observes the lines of `rig` whose frames the program counts; the faults are those of
    /// `scenario`.
    pub fn listening(scenario: &Scenario, rig: &mut Rig, instruments: &dyn Instruments) -> Self {
        let watched = instruments.intakes().iter().filter_map(|&intake| {
            let Intake {
                link, direction, ..
            } = intake;
            let index = rig.links().iter().position(|known| known.name == link)?;
            let codec = instruments.codec_towards(rig, link, direction)?;
            let ear = Ear::new(index, direction, codec);
            Some(Watched {
                intake,
                ear: ear.listening(rig),
                sound: VecDeque::new(),
                accepted: 0,
                calm: Calm::of(scenario, rig, &|other| other == link).longer_by(RESTART),
                was_disturbed: false,
                given_up: 0,
                broken: None,
            })
        });
        Self {
            watched: watched.collect(),
            next: Instant::ZERO + EVERY,
        }
    }
}

impl Ear {
    fn new(link: usize, direction: Direction, codec: &'static Codec) -> Self {
        Self {
            link,
            direction,
            codec,
            counter: Counter::towards(codec, direction),
            patient: Counter::towards(codec, direction),
            heard_at: Instant::ZERO,
            sound: 0,
            patient_sound: 0,
            damaged: 0,
        }
    }

    fn listening(self, rig: &mut Rig) -> Shared<Self> {
        let ear = Shared::new(self);
        rig.add_tap(Box::new(Listener::of(&ear)));
        ear
    }

    fn take(&mut self, at: Instant, bytes: &[u8]) {
        if at - self.heard_at > self.codec.idle() {
            let count = self.counter.idle();
            self.add(count);
        }
        self.heard_at = at;
        let count = self.counter.push(bytes);
        self.add(count);
        self.patient_sound += self.patient.push(bytes).frames;
    }

    /// Handles a pause between bytes: the program and the rig may find different frames in them.
    const fn disturb(&mut self) {
        self.damaged += 1;
    }

    const fn add(&mut self, count: Count) {
        self.sound += count.frames;
        self.damaged += count.errors;
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
        if link != self.link {
            return;
        }
        let mut ear = self.ear.lock();
        if direction == ear.direction && !delivery.bytes.is_empty() {
            if has_paused(delivery) {
                ear.disturb();
            }
            ear.take(delivery.at, &delivery.bytes);
        }
    }
}

impl Watched {
    /// Compares the counts; returns the contradiction. `is_calm`: no fault acts.
    fn compare(&mut self, [accepted, rejected]: [u64; 2], is_calm: bool) -> Option<String> {
        let (sound, patient, damaged) = {
            let ear = self.ear.lock();
            (ear.sound, ear.patient_sound, ear.damaged)
        };
        self.accepted = accepted;
        self.sound.push_back(sound);
        // Frames whose bytes came with pauses.
        let sound = match self.was_disturbed {
            true => sound.max(patient),
            false => sound,
        };
        let name = self.intake.link;
        // After damage, program and rig may find other frames, because they discard a partial frame
        // at different times. Without damage, a decoder may need the next byte to end a frame.
        let is_clean = damaged == 0 && !self.was_disturbed;
        let more = match is_clean {
            true => AHEAD,
            false => SLACK + damaged / 5 + sound / DISTURBED,
        };
        if accepted > sound + more {
            return Some(format!(
                "the program accepted {accepted} frames of {name}, {sound} valid ones arrived"
            ));
        }
        if is_clean && rejected > REJECTED {
            return Some(format!(
                "the program rejected {rejected} frames of {name}, no damaged one arrived"
            ));
        }
        let earlier = (self.sound.len() > LATE).then(|| self.sound.pop_front())??;
        let share = if earlier >= FAST {
            // A device that was disturbed is started again more often.
            earlier / if is_clean { SHARE } else { SHARE / 2 }
        } else {
            earlier / 50
        };
        let slack = if is_clean { 0 } else { AHEAD };
        let known = accepted + slack + damaged / 4 + share;
        if !is_calm {
            self.given_up = self.given_up.max(earlier.saturating_sub(known));
        }
        let is_deaf = known + self.given_up < earlier;
        (is_deaf && !self.intake.may_ignore).then(|| {
            format!(
                "the program accepted {accepted} frames of {name}, {earlier} valid ones arrived at \
                 least 1 s earlier"
            )
        })
    }
}

impl Checker for CountsTrue {
    fn observe(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        if now < self.next {
            return;
        }
        self.next = now + EVERY;
        for one in self.watched.iter_mut().filter(|one| one.broken.is_none()) {
            let is_calm = one.calm.is(now);
            one.was_disturbed |= !is_calm;
            if let Some(counts) = (one.intake.counts)(look.rig) {
                one.broken = one.compare(counts, is_calm).map(|detail| (now, detail));
            }
        }
    }

    fn verdict(&self) -> Check {
        let name = "counts-true";
        let broken = self.watched.iter().find_map(|one| one.broken.as_ref());
        let accepted: u64 = self.watched.iter().map(|one| one.accepted).sum();
        let arrived: u64 = self.watched.iter().map(|one| one.ear.lock().sound).sum();
        let detail = match broken {
            Some((at, detail)) => format!("at {at} s {detail}"),
            None if self.watched.is_empty() => "the robot names no counters of frames".to_owned(),
            None => format!("{accepted} frames accepted, {arrived} valid ones arrived"),
        };
        Check::new(name, broken.is_none(), detail).if_observed(accepted > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        for one in &mut self.watched {
            one.calm.renew(faults, rig);
        }
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let watched = self.watched.iter().map(|one| {
            let ear = one.ear.lock().clone();
            Watched {
                intake: one.intake,
                ear: ear.listening(rig),
                sound: one.sound.clone(),
                accepted: one.accepted,
                calm: one.calm.clone(),
                was_disturbed: one.was_disturbed,
                given_up: one.given_up,
                broken: one.broken.clone(),
            }
        });
        Some(Box::new(Self {
            watched: watched.collect(),
            next: self.next,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::BUS_HIGH_FIRST;

    fn watched() -> Watched {
        Watched {
            intake: Intake::new("base", |_| None),
            ear: Shared::new(Ear::new(0, Direction::ToMaster, &BUS_HIGH_FIRST)),
            sound: VecDeque::new(),
            accepted: 0,
            calm: Calm::default(),
            was_disturbed: false,
            given_up: 0,
            broken: None,
        }
    }

    /// Valid frames and damaged ones on the line.
    fn arrived(one: &Watched, sound: u64, damaged: u64) {
        let mut ear = one.ear.lock();
        (ear.sound, ear.damaged) = (sound, damaged);
    }

    /// Without damage the program may count two frames more; with damage twelve, a fifth of the
    /// damaged ones and a fortieth of the valid ones.
    #[test]
    fn the_program_accepts_no_frame_that_did_not_arrive() {
        let told = |sound, damaged, accepted| {
            let mut one = watched();
            arrived(&one, sound, damaged);
            one.compare([accepted, 0], true)
        };
        assert_eq!(
            (told(10, 0, 12), told(10, 1, 22), told(80, 10, 96)),
            (None, None, None)
        );
        let words = "the program accepted 13 frames of base, 10 valid ones arrived";
        assert_eq!(told(10, 0, 13).as_deref(), Some(words));
        assert!(told(10, 1, 23).is_some() && told(80, 10, 97).is_some());
    }

    #[test]
    fn the_program_rejects_few_frames_without_damage() {
        let told = |damaged, rejected| {
            let mut one = watched();
            arrived(&one, 100, damaged);
            one.compare([100, rejected], true)
        };
        assert_eq!((told(0, 40), told(1, 9_999)), (None, None));
        let words = "the program rejected 41 frames of base, no damaged one arrived";
        assert_eq!(told(0, 41).as_deref(), Some(words));
    }

    /// At the third comparison, the program must have counted the frames that arrived up to the
    /// first one.
    fn third(mut one: Watched, [sound, damaged]: [u64; 2], accepted: u64) -> Option<String> {
        arrived(&one, sound, damaged);
        for _ in 0..2 {
            assert_eq!(one.compare([accepted, 0], true), None);
        }
        one.compare([accepted, 0], true)
    }

    /// It may miss one frame of 50; of a fast stream, from 1000 frames on, an eighth, and a quarter
    /// after a fault. After damage it may miss two more, and a quarter of the damaged ones.
    #[test]
    fn the_program_counts_what_arrived_a_second_before() {
        let told = |arrived, accepted| third(watched(), arrived, accepted);
        assert_eq!((told([100, 0], 98), told([1_000, 0], 875)), (None, None));
        let words = "the program accepted 97 frames of base, 100 valid ones arrived at least 1 s \
                     earlier";
        assert_eq!(told([100, 0], 97).as_deref(), Some(words));
        assert!(told([999, 0], 979).is_some() && told([1_000, 0], 874).is_some());
        assert_eq!((told([100, 8], 94), told([1_000, 8], 746)), (None, None));
        assert!(told([100, 8], 93).is_some() && told([1_000, 8], 745).is_some());
        let mut ignores = watched();
        ignores.intake.may_ignore = true;
        assert_eq!(third(ignores, [100, 0], 0), None);
    }

    /// During a fault frames may be given up; later ones may not.
    #[test]
    fn frames_are_given_up_during_a_fault() {
        let mut one = watched();
        (one.was_disturbed, one.given_up) = (true, 0);
        arrived(&one, 100, 0);
        for is_calm in [true, true, false] {
            assert_eq!(one.compare([50, 0], is_calm), None);
        }
        // 50 accepted, two more and two of 100: 46 were given up.
        assert_eq!(one.given_up, 46);
        assert_eq!(one.compare([50, 0], true), None);
        arrived(&one, 110, 0);
        assert_eq!(one.compare([50, 0], true), None);
        assert_eq!(one.compare([50, 0], true), None);
        assert!(one.compare([50, 0], true).is_some());
    }

    /// A frame whose bytes came with a pause is valid for the patient decoder only, which counts
    /// after a fault.
    #[test]
    fn a_pause_within_a_frame_costs_it() {
        let frame = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
        let one = watched();
        let mut ear = one.ear.lock();
        let at = Instant::from_millis;
        ear.take(at(10), &frame);
        ear.take(at(20), &frame[..2]);
        ear.take(at(21) + BUS_HIGH_FIRST.idle(), &frame[2..]);
        assert_eq!((ear.sound, ear.patient_sound), (1, 2));
        assert!(ear.damaged > 0);
        let damaged = ear.damaged;
        ear.disturb();
        assert_eq!(ear.damaged, damaged + 1);
    }

    use super::super::puppet::{copied, cut, puppet, scenario};
    use super::super::tests::look_at;
    use crate::rig::bare::linked;
    use crate::rig::fault::{Damage, Strike};
    use crate::robots::checker::Status;
    use crate::robots::instruments::counted;

    const FRAME: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];

    struct Robot;

    impl Instruments for Robot {
        fn intakes(&self) -> &'static [Intake] {
            const ALL: [Intake; 2] = [
                Intake::new("base", |rig| counted(rig, &["taken"], &["refused"])),
                Intake::new("gone", |_| None),
            ];
            &ALL
        }

        fn codec(&self, _: &Rig, _: &str) -> Option<&'static Codec> {
            Some(&BUS_HIGH_FIRST)
        }
    }

    /// 100 frames from the base until 1 s, of which the program counts so many; on other lines are
    /// frames as well.
    fn judged(accepted: u64, until: &[u64]) -> (Status, String) {
        let (mut rig, [base, other]) = linked(["base", "other"], 1_000_000);
        let mut checker = CountsTrue::listening(&scenario("").0, &mut rig, &Robot);
        for _ in 0..100 {
            rig.inject(base[0].node, &FRAME);
            rig.inject(base[1].node, &FRAME);
            rig.inject(other[0].node, &FRAME);
            rig.run_for(Duration::from_millis(1));
        }
        puppet(&mut rig).counters = vec![("taken", accepted), ("refused", 0), ("other", 999)];
        for &millis in until {
            look_at(&mut checker, &mut rig, millis, 0.0);
        }
        let check = checker.verdict();
        assert_eq!(copied(&checker, &rig), check.to_string());
        (check.status, check.detail)
    }

    /// Counts are compared each 500 ms, from 500 ms on; frames may be counted a second later.
    #[test]
    fn counts_are_compared_with_what_arrived() {
        let sound = "100 frames accepted, 100 valid ones arrived".to_owned();
        assert_eq!(
            judged(100, &[500, 1_000, 1_500, 2_000]),
            (Status::Pass, sound)
        );
        let none = "0 frames accepted, 100 valid ones arrived".to_owned();
        assert_eq!(judged(0, &[499]), (Status::NotObserved, none.clone()));
        assert_eq!(
            judged(0, &[500, 999, 1_000, 1_499]),
            (Status::NotObserved, none)
        );
        let deaf = "at 1.500000 s the program accepted 0 frames of base, 100 valid ones arrived at \
                    least 1 s earlier";
        assert_eq!(
            judged(0, &[500, 1_000, 1_500, 2_000]),
            (Status::Fail, deaf.to_owned())
        );
        let more = "at 0.500000 s the program accepted 103 frames of base, 100 valid ones arrived";
        assert_eq!(judged(103, &[500, 2_000]), (Status::Fail, more.to_owned()));
    }

    /// The counts of a robot with a fault are compared with more patience; effects last to 8 s and
    /// two seconds more for a restart.
    #[test]
    fn a_fault_disturbs_the_counts() {
        let (mut rig, _) = linked(["base"], 1_000_000);
        let mut checker = CountsTrue::listening(&scenario("").0, &mut rig, &Robot);
        checker.faults_changed(&[cut("base", 2, 3)], &rig);
        let calm = [1_999, 2_000, 9_999, 10_000]
            .map(|millis| checker.watched[0].calm.is(Instant::from_millis(millis)));
        assert_eq!(calm, [true, false, false, true]);
        look_at(&mut checker, &mut rig, 1_900, 0.0);
        assert!(!checker.watched[0].was_disturbed);
        for millis in [2_500, 20_000] {
            look_at(&mut checker, &mut rig, millis, 0.0);
            assert!(checker.watched[0].was_disturbed);
        }
        assert_eq!(checker.watched.len(), 1, "the other link does not exist");
        let unknown = crate::robots::instruments::Unknown;
        let none = CountsTrue::listening(&scenario("").0, &mut rig, &unknown).verdict();
        assert_eq!(none.detail, "the robot names no counters of frames");
    }

    /// A pause that a fault makes within bytes counts as damage, of this line alone.
    #[test]
    fn a_pause_of_the_line_is_damage() {
        let damaged = |to: Direction| {
            let (mut rig, [base]) = linked(["base"], 1_000_000);
            let damage = Damage::Idle {
                by: Duration::from_micros(50),
            };
            rig.line_mut(0, to)
                .faults
                .add_strike(Strike { byte: 2, damage });
            let checker = CountsTrue::listening(&scenario("").0, &mut rig, &Robot);
            base.iter().for_each(|end| rig.inject(end.node, &FRAME));
            rig.run_for(Duration::from_millis(20));
            let ear = checker.watched[0].ear.lock();
            (ear.sound, ear.damaged)
        };
        assert_eq!(damaged(Direction::ToMaster), (1, 1));
        assert_eq!(damaged(Direction::ToDevice), (1, 0));
    }
}
