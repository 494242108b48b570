//! Checks that the program sends its cyclic frames in time, and not too often.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use crate::Shared;
use crate::codec::{Codec, FrameBytes};
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::rig::trace::{Side, Tap};
use crate::robots::{Cycle, Instruments};
use crate::scenario::{FaultSpec, Scenario};

/// Time for the program's start.
const STARTS: Duration = Duration::from_secs(5);
/// Interval in which frames are counted.
const SECOND: Duration = Duration::from_secs(1);
/// Number of frames in time after which an optional cyclic frame is expected.
const ROWS: u32 = 8;

/// The program sends each of its cyclic frames in time, and not too often, while no fault acts on
/// the link.
pub struct SendsInTime {
    ears: Vec<Shared<Ear>>,
    watched: Vec<Watched>,
}

#[derive(Clone)]
struct Watched {
    cycle: Cycle,
    ear: usize,
    index: usize,
    calm: Calm,
    /// Number of frames so far, and time of the last one, or of the start of the calm.
    count: u64,
    since: Instant,
    in_a_row: u32,
    longest: Duration,
    /// Start of the current second, and the number of frames then.
    second: (Instant, u64),
    broken: Option<(Instant, String)>,
}

/// Whether a frame is of a kind.
type Is = fn(&[u8]) -> bool;

/// The frames that the program sends on a link.
#[derive(Clone)]
struct Ear {
    link: usize,
    name: &'static str,
    codec: &'static Codec,
    frames: FrameBytes,
    sent_at: Instant,
    kinds: Vec<Kind>,
}

/// Frames of a kind that were sent.
#[derive(Clone)]
struct Kind {
    is: Is,
    count: u64,
    /// The last frame, and the number of frames that were equal to their predecessor.
    last: Vec<u8>,
    repeated: u64,
}

impl SendsInTime {
    /// Observes the cyclic frames that `instruments` names; the faults are those of `scenario`.
    pub fn listening(scenario: &Scenario, rig: &mut Rig, instruments: &dyn Instruments) -> Self {
        let (mut ears, mut watched) = (Vec::<Ear>::new(), Vec::new());
        for cycle in instruments.cycles() {
            let known = ears.iter().position(|ear| ear.name == cycle.link);
            let ear = known.or_else(|| {
                ears.push(Ear::on(cycle.link, rig, instruments)?);
                Some(ears.len() - 1)
            });
            let Some(ear) = ear else { continue };
            watched.push(Watched {
                cycle: *cycle,
                ear,
                index: ears[ear].kinds.len(),
                calm: Calm::of(scenario, rig, &|other| other == cycle.link),
                count: 0,
                since: Instant::ZERO + STARTS,
                in_a_row: 0,
                longest: Duration::ZERO,
                second: (Instant::ZERO + STARTS, 0),
                broken: None,
            });
            ears[ear].kinds.push(Kind {
                is: cycle.is,
                count: 0,
                last: Vec::new(),
                repeated: 0,
            });
        }
        let ears = ears.into_iter().map(|ear| ear.listening(rig));
        Self {
            ears: ears.collect(),
            watched,
        }
    }
}

impl Ear {
    fn on(name: &'static str, rig: &Rig, instruments: &dyn Instruments) -> Option<Self> {
        let link = rig.links().iter().position(|known| known.name == name)?;
        let is_of_program = rig.program_links().contains(&link);
        let codec = instruments.codec_towards(rig, name, Direction::ToDevice)?;
        is_of_program.then(|| Self {
            link,
            name,
            codec,
            frames: FrameBytes::towards(codec, Direction::ToDevice),
            sent_at: Instant::ZERO,
            kinds: Vec::new(),
        })
    }

    fn listening(self, rig: &mut Rig) -> Shared<Self> {
        let ear = Shared::new(self);
        rig.add_tap(Box::new(Listener::of(&ear)));
        ear
    }

    fn take(&mut self, at: Instant, bytes: &[u8]) {
        let Self { frames, kinds, .. } = self;
        let mut count = |frame: &[u8]| {
            for kind in kinds.iter_mut().filter(|kind| (kind.is)(frame)) {
                kind.count += 1;
                kind.repeated += u64::from(kind.last == frame);
                kind.last.clear();
                kind.last.extend_from_slice(frame);
            }
        };
        if self.codec.is_ended_by(at - self.sent_at) {
            frames.idle(&mut count);
        }
        self.sent_at = at;
        frames.push(bytes, &mut count);
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
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if to == Direction::ToDevice && side == Side::Sent && link == self.link {
            self.ear.lock().take(at, bytes);
        }
    }
}

impl Watched {
    fn count_second(&mut self, now: Instant, count: u64) {
        let (began, before) = self.second;
        if now - began < SECOND {
            return;
        }
        self.second = (now, count);
        let sent = count - before;
        if self.cycle.at_most > 0 && sent > self.cycle.at_most && self.broken.is_none() {
            let (name, most) = (self.cycle.name, self.cycle.at_most);
            let told = format!("{sent} times {name} in a second, expected at most {most}");
            self.broken = Some((now, told));
        }
    }

    fn observe(&mut self, now: Instant, count: u64, mode: Option<&str>) {
        let is_exempt = mode.is_some_and(|mode| self.cycle.except.contains(&mode));
        if !self.calm.is(now) || is_exempt || now < Instant::ZERO + STARTS {
            (self.count, self.since, self.second) = (count, now, (now, count));
            // An optional frame need not come again after a fault.
            self.in_a_row = 0;
            return;
        }
        self.count_second(now, count);
        let silence = now - self.since;
        let is_expected = self.cycle.is_always || self.in_a_row >= ROWS;
        if is_expected {
            self.longest = self.longest.max(silence);
            if silence > self.cycle.within && self.broken.is_none() {
                let told = format!("no {} for {} ms", self.cycle.name, silence.as_millis());
                self.broken = Some((now, told));
            }
        }
        if count != self.count {
            let is_in_time = silence <= self.cycle.within;
            self.in_a_row = if is_in_time { self.in_a_row + 1 } else { 0 };
            (self.count, self.since) = (count, now);
        }
    }
}

impl Checker for SendsInTime {
    fn observe(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        let mode = look.rig.program().map(|program| program.mode());
        for one in &mut self.watched {
            let (count, repeated) = {
                let ear = self.ears[one.ear].lock();
                let kind = &ear.kinds[one.index];
                (kind.count, kind.repeated)
            };
            one.observe(now, count, mode);
            if one.cycle.is_dated && repeated > 0 && one.broken.is_none() {
                let told = format!("{} was sent again without a change", one.cycle.name);
                one.broken = Some((now, told));
            }
        }
    }

    fn verdict(&self) -> Check {
        let name = "sends-in-time";
        let mut watched = self.watched.iter();
        let broken = watched.find_map(|one| Some((one.cycle.link, one.broken.as_ref()?)));
        let judged = self.watched.iter();
        let judged = judged.filter(|one| one.longest > Duration::ZERO);
        let longest = judged.clone().map(|one| {
            let millis = one.longest.as_millis();
            format!("{} {millis} ms", one.cycle.name)
        });
        let longest: Vec<String> = longest.collect();
        let detail = match broken {
            Some((link, (at, told))) => {
                format!("at {at} s on {link}: {told}, without a fault on this link")
            }
            None if longest.is_empty() => "no cyclic frames that the robot names".to_owned(),
            None => format!("longest times between frames: {}", longest.join(", ")),
        };
        Check::new(name, broken.is_none(), detail).if_observed(!longest.is_empty())
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        for one in &mut self.watched {
            one.calm.renew(faults, rig);
        }
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let ears = self.ears.iter().map(|ear| {
            let ear = ear.lock().clone();
            ear.listening(rig)
        });
        Some(Box::new(Self {
            ears: ears.collect(),
            watched: self.watched.clone(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::BUS_HIGH_FIRST;

    /// A row each 100 ms, twelve in a second at most, not in the mode "rest".
    fn watched(is_always: bool) -> Watched {
        let row = Cycle::new("pc", "row", Duration::from_millis(100), |_| true);
        Watched {
            cycle: Cycle {
                at_most: 12,
                is_always,
                except: &["rest"],
                ..row
            },
            ear: 0,
            index: 0,
            calm: Calm::default(),
            count: 0,
            since: Instant::ZERO + STARTS,
            in_a_row: 0,
            longest: Duration::ZERO,
            second: (Instant::ZERO + STARTS, 0),
            broken: None,
        }
    }

    /// Observes counts at these milliseconds; returns the failure.
    fn observed(one: &mut Watched, looks: &[(u64, u64)]) -> Option<(u64, String)> {
        for &(millis, count) in looks {
            one.observe(Instant::from_millis(millis), count, Some("drive"));
        }
        let (at, told) = one.broken.clone()?;
        Some((at.as_millis(), told))
    }

    /// Nothing is judged in the first five seconds. Then a row may be 100 ms late.
    #[test]
    fn a_frame_that_is_late_is_told() {
        let mut one = watched(true);
        assert_eq!(observed(&mut one, &[(4_900, 0), (5_000, 0)]), None);
        assert_eq!(
            observed(&mut one, &[(5_001, 0)]),
            Some((5_001, "no row for 101 ms".into()))
        );
        let mut one = watched(true);
        let steady: Vec<(u64, u64)> = (49..80).map(|n| (n * 100, n)).collect();
        assert_eq!(observed(&mut one, &steady), None);
        assert_eq!(one.longest, Duration::from_millis(100));
        assert_eq!(
            observed(&mut one, &[(8_050, 79)]),
            Some((8_050, "no row for 150 ms".into()))
        );
        // The first failure stays.
        assert_eq!(
            observed(&mut one, &[(9_000, 79)]),
            Some((8_050, "no row for 150 ms".into()))
        );
    }

    /// An optional frame is expected after eight in time.
    #[test]
    fn an_optional_frame_is_expected_after_some_in_a_row() {
        let after = |in_time: u64| {
            let mut one = watched(false);
            let looks: Vec<(u64, u64)> = (0..=in_time).map(|n| (5_000 + n * 100, n)).collect();
            observed(&mut one, &looks);
            observed(&mut one, &[(7_000, in_time)])
        };
        assert_eq!((after(7), after(8).is_some()), (None, true));
        // A late frame restarts the count of frames in time.
        let mut one = watched(false);
        let looks: Vec<(u64, u64)> = (0..=6).map(|n| (5_000 + n * 100, n)).collect();
        observed(&mut one, &looks);
        let late: Vec<(u64, u64)> = (7..=14).map(|n| (5_101 + n * 100, n)).collect();
        assert_eq!(observed(&mut one, &late), None);
        assert_eq!(observed(&mut one, &[(9_000, 14)]), None);
    }

    #[test]
    fn frames_of_each_second_are_limited() {
        let of = |sent: u64| {
            let mut one = watched(true);
            let looks: Vec<(u64, u64)> =
                (0..=10).map(|n| (5_000 + n * 100, n * sent / 10)).collect();
            observed(&mut one, &looks)
        };
        assert_eq!(of(12), None);
        let words = "13 times row in a second, expected at most 12";
        assert_eq!(of(13), Some((6_000, words.into())));
        let mut any = watched(true);
        any.cycle.at_most = 0;
        any.count_second(Instant::from_secs(6), 99);
        assert_eq!(any.broken, None);
    }

    /// In a mode without such frames nothing is judged, and the time begins with its end.
    #[test]
    fn a_mode_without_these_frames_is_left_out() {
        let mut one = watched(true);
        for millis in [5_000, 5_900] {
            one.observe(Instant::from_millis(millis), 3, Some("rest"));
        }
        assert_eq!(observed(&mut one, &[(6_000, 3)]), None);
        assert_eq!(
            observed(&mut one, &[(6_001, 3)]),
            Some((6_001, "no row for 101 ms".into()))
        );
    }

    /// Frames are counted by kind. A frame that equals the last one of its kind was repeated.
    #[test]
    fn frames_of_each_kind_are_counted() {
        let codec = &BUS_HIGH_FIRST;
        let kind = |is: Is| Kind {
            is,
            count: 0,
            last: Vec::new(),
            repeated: 0,
        };
        let mut ear = Ear {
            link: 0,
            name: "base",
            codec,
            frames: FrameBytes::towards(codec, Direction::ToDevice),
            sent_at: Instant::ZERO,
            kinds: vec![
                kind(|frame| frame[1] == 0x24),
                kind(|frame| frame[1] != 0x24),
            ],
        };
        let frame = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
        for millis in [10, 20, 30] {
            ear.take(Instant::from_millis(millis), &frame);
        }
        let counts: Vec<_> = ear
            .kinds
            .iter()
            .map(|kind| (kind.count, kind.repeated))
            .collect();
        assert_eq!(counts, [(3, 2), (0, 0)]);
    }

    use super::super::puppet::{copied, cut, puppet, scenario};
    use super::super::tests::look_at;
    use crate::robots::checker::Status;

    const FRAME: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];

    /// A checker of dated rows, each 100 ms, and of commands that are optional.
    fn rows(rig: &mut Rig, is_dated: bool) -> SendsInTime {
        let codec = &BUS_HIGH_FIRST;
        let ear = Ear {
            link: 0,
            name: "base",
            codec,
            frames: FrameBytes::towards(codec, Direction::ToDevice),
            sent_at: Instant::ZERO,
            kinds: [
                |frame: &[u8]| frame[1] == 0x24,
                |frame: &[u8]| frame[1] != 0x24,
            ]
            .map(|is| Kind {
                is,
                count: 0,
                last: Vec::new(),
                repeated: 0,
            })
            .to_vec(),
        };
        let mut row = watched(true);
        row.cycle.is_dated = is_dated;
        let (scenario, _) = scenario("");
        row.calm = Calm::of(&scenario, rig, &|_| true);
        let mut command = watched(false);
        (command.index, command.cycle.name) = (1, "command");
        SendsInTime {
            ears: vec![ear.listening(rig)],
            watched: vec![row, command],
        }
    }

    fn told(checker: &SendsInTime) -> (Status, String) {
        let check = checker.verdict();
        (check.status, check.detail)
    }

    /// A row each 100 ms until 6 s, from the program to the device; the way back does not count.
    #[test]
    fn rows_are_those_that_the_program_sends() {
        let (mut rig, [base, other]) = crate::rig::bare::linked(["base", "other"], 1_000_000);
        let mut checker = rows(&mut rig, false);
        puppet(&mut rig).mode = "drive";
        let none = "no cyclic frames that the robot names".to_owned();
        assert_eq!(told(&checker), (Status::NotObserved, none));
        let drive = |rig: &mut Rig,
                     checker: &mut SendsInTime,
                     tenths: core::ops::Range<u64>,
                     node: usize| {
            for tenth in tenths {
                rig.inject(node, &FRAME);
                look_at(checker, rig, 100 * tenth, 0.0);
            }
        };
        drive(&mut rig, &mut checker, 1..61, base[1].node);
        let longest = "longest times between frames: row 100 ms".to_owned();
        assert_eq!(told(&checker), (Status::Pass, longest));
        puppet(&mut rig).mode = "rest";
        drive(&mut rig, &mut checker, 61..71, other[1].node);
        puppet(&mut rig).mode = "drive";
        assert_eq!(told(&checker).0, Status::Pass);
        drive(&mut rig, &mut checker, 71..73, base[0].node);
        let words = "at 7.200000 s on pc: no row for 200 ms, without a fault on this link";
        assert_eq!(told(&checker), (Status::Fail, words.to_owned()));
        assert!(copied(&checker, &rig).ends_with(words));
    }

    /// Equal rows, and rows of 0 to 9 registers.
    #[test]
    fn a_dated_row_is_not_sent_twice() {
        let after = |is_dated: bool, is_equal: bool| {
            let (mut rig, [base]) = crate::rig::bare::linked(["base"], 1_000_000);
            let mut checker = rows(&mut rig, is_dated);
            for tenth in 1..=60_u64 {
                let count = if is_equal {
                    10
                } else {
                    u8::try_from(tenth % 9).expect("small")
                };
                // The sum of the bytes before, high byte first.
                let sum = 0xAB + 0x24 + u16::from(count);
                let [high, low] = sum.to_be_bytes();
                rig.inject(base[1].node, &[0xAB, 0x24, count, high, low]);
                look_at(&mut checker, &mut rig, 100 * tenth, 0.0);
            }
            checker.verdict().detail
        };
        let again = "at 0.200000 s on pc: row was sent again without a change, without a fault on \
                     this link";
        assert_eq!(after(true, true), again);
        let sound = "longest times between frames: row 100 ms";
        assert_eq!([after(true, false), after(false, true)], [sound, sound]);
    }

    /// A fault that begins at 5 s: with its effects to 11 s.
    #[test]
    fn no_rows_are_expected_during_a_fault() {
        let (mut rig, _) = crate::rig::bare::linked(["base"], 1_000_000);
        let mut checker = rows(&mut rig, false);
        checker.faults_changed(&[cut("base", 5, 6)], &rig);
        for tenth in 40..=109 {
            look_at(&mut checker, &mut rig, 100 * tenth, 0.0);
        }
        assert_eq!(told(&checker).0, Status::NotObserved);
        look_at(&mut checker, &mut rig, 11_000, 0.0);
        assert_eq!(told(&checker).0, Status::Pass);
        look_at(&mut checker, &mut rig, 11_100, 0.0);
        assert!(
            told(&checker)
                .1
                .starts_with("at 11.100000 s on pc: no row for 200 ms")
        );
    }
}
