//! Checks that the robot does not drive into anything.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

use super::{Check, Checker, Look};
use crate::Shared;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::rig::trace::{Side, Tap};
use crate::robots::{Axis, Dialect};

/// Name of the check [`NoCollisionAtSpeed`].
pub(crate) const COLLISION: &str = "no-collision-at-speed";

/// Maximum speed of a harmless touch, m/s.
pub(crate) const HARMLESS_M_S: f64 = 0.05;

/// Maximum age of a command that the drive may still apply: lines delay it, and a drive takes it in
/// its next cycle.
const CURRENT: Duration = Duration::from_millis(200);
/// Time to brake after the drive did not follow the program: the wheels of the built-in robots
/// stand after 0.3 s. The drive is checked at steps of this time.
const STEP: Duration = Duration::from_millis(50);
const STEPS: u32 = 6;
const BRAKES: Duration = Duration::from_millis(300);

/// The robot does not collide. A person who walks into the robot does not count: only the robot's
/// own motion towards the obstacle does. A contact also does not count while the drive has a
/// set-point that the program did not send in the last 0.2 s, or while the robot brakes afterwards:
/// the program cannot stop the robot then.
#[derive(Clone, Default)]
pub struct NoCollisionAtSpeed {
    /// Time from which a sensor deceives the robot: later contacts are counted, but not judged.
    until: Option<Instant>,
    sent: Option<Shared<Sent>>,
    has_moved: bool,
    contacts: u64,
    first: Option<Instant>,
    worst_m_s: f64,
}

/// The bytes that the program recently sent to its drive, and the changes of the drive's
/// set-points.
#[derive(Clone)]
struct Sent {
    link: usize,
    dialect: Dialect,
    chunks: VecDeque<(Instant, Vec<u8>)>,
    set_points: VecDeque<(Instant, Vec<f64>)>,
}

impl Sent {
    /// Adds the bytes, and drops those that cannot belong to a current frame.
    fn take(&mut self, at: Instant, bytes: &[u8]) {
        self.chunks.push_back((at, bytes.to_vec()));
        let is_old = |(sent, _): &(Instant, _)| at - *sent > BRAKES + CURRENT * 2;
        while self.chunks.front().is_some_and(is_old) {
            self.chunks.pop_front();
        }
    }

    /// Stores the set-points at `now`, if they have changed.
    fn see(&mut self, now: Instant, axes: &[Axis]) {
        let seen = || axes.iter().map(|axis| axis.set_point);
        let last = self.set_points.back();
        if last.is_none_or(|(_, last)| !last.iter().copied().eq(seen())) {
            self.set_points.push_back((now, seen().collect()));
        }
        // The set-points before the oldest change are active until that change.
        let next = |all: &VecDeque<(Instant, _)>| all.get(1).map(|(at, _)| *at);
        while next(&self.set_points).is_some_and(|at| now - at > BRAKES + STEP) {
            self.set_points.pop_front();
        }
    }

    /// Whether the drive followed the program at `now`, and during the time to brake before `now`.
    fn follows(&self, now: Instant) -> bool {
        (0..=STEPS).all(|step| {
            let at = Instant::ZERO + (now - Instant::ZERO).saturating_sub(STEP * step);
            let mut seen = self.set_points.iter().rev();
            let seen = seen.find(|(seen, _)| *seen <= at);
            seen.is_none_or(|(_, set_points)| self.leads(at, set_points))
        })
    }

    /// Whether each axis has a set-point that was sent shortly before `now`. An axis that got no
    /// command, or its first one only now, also counts.
    fn leads(&self, now: Instant, set_points: &[f64]) -> bool {
        let mut bytes = Vec::new();
        let mut commands = Vec::new();
        for (at, chunk) in self.chunks.iter().take_while(|(at, _)| *at <= now) {
            for byte in chunk {
                bytes.push(*byte);
                let begin = bytes.len().saturating_sub(self.dialect.frame_max);
                let command = (self.dialect.command)(&bytes[begin..]);
                let command = command.filter(|_| now - *at <= CURRENT);
                commands.extend(command.map(|command| (*at, command)));
            }
        }
        let mut axes = set_points.iter().enumerate();
        axes.all(|(index, set_point)| {
            let mut told = commands.iter().filter_map(|(at, command)| {
                let told = command.get(index).copied().flatten();
                told.map(|told| (*at, told))
            });
            let first = told.clone().next();
            let is_new = first.is_none_or(|(at, _)| now - at < CURRENT / 2);
            is_new || told.any(|(_, told)| told == *set_point)
        })
    }
}

struct Ear {
    link: usize,
    sent: Shared<Sent>,
}

impl Ear {
    fn of(sent: &Shared<Sent>) -> Self {
        Self {
            link: sent.lock().link,
            sent: sent.clone(),
        }
    }
}

impl Tap for Ear {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if to == Direction::ToDevice && side == Side::Sent && link == self.link {
            self.sent.lock().take(at, bytes);
        }
    }
}

impl NoCollisionAtSpeed {
    /// Judges contacts until this time.
    pub fn judging_until(until: Option<Instant>) -> Self {
        Self {
            until,
            ..Self::default()
        }
    }

    /// Does not judge contacts while the drive does not follow the commands of `dialect` on `rig`.
    #[must_use]
    pub fn commanded_in(mut self, rig: &mut Rig, dialect: Option<Dialect>) -> Self {
        let mut links = rig.links().iter();
        let link = dialect.and_then(|dialect| links.position(|link| link.name == dialect.link));
        self.sent = dialect.zip(link).map(|(dialect, link)| {
            let sent = Shared::new(Sent {
                link,
                dialect,
                chunks: VecDeque::new(),
                set_points: VecDeque::new(),
            });
            rig.add_tap(Box::new(Ear::of(&sent)));
            sent
        });
        self
    }
}

impl Checker for NoCollisionAtSpeed {
    fn observe(&mut self, look: &Look<'_>) {
        self.has_moved |= look.rig.world.is_moving();
        if let Some(sent) = &self.sent {
            sent.lock().see(look.rig.now(), look.axes);
        }
        for contact in look.contacts {
            self.contacts += 1;
            self.worst_m_s = self.worst_m_s.max(contact.own_m_s);
            let is_early = self.until.is_none_or(|until| contact.at < until);
            let is_judged = contact.own_m_s > HARMLESS_M_S && self.first.is_none() && is_early;
            let sent = self.sent.as_ref().filter(|_| is_judged);
            let follows = sent.is_none_or(|sent| sent.lock().follows(look.rig.now()));
            if is_judged && follows {
                self.first = Some(contact.at);
            }
        }
    }

    fn verdict(&self) -> Check {
        let contacts = self.contacts;
        let detail = match self.first {
            None if self.worst_m_s > HARMLESS_M_S => format!(
                "{contacts} contacts, harmful only while a sensor deceives the robot or its drive \
                 does not follow"
            ),
            None => format!("{contacts} contacts, none at more than {HARMLESS_M_S} m/s"),
            Some(at) => format!(
                "{contacts} contacts, the first harmful one at {at} s, the fastest at {:.3} m/s",
                self.worst_m_s
            ),
        };
        let check = Check::new(COLLISION, self.first.is_none(), detail);
        check.if_observed(self.has_moved || self.contacts > 0)
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let sent = self.sent.as_ref().map(|sent| {
            let sent = Shared::new(sent.lock().clone());
            rig.add_tap(Box::new(Ear::of(&sent)));
            sent
        });
        Some(Box::new(Self {
            sent,
            ..self.clone()
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of two bytes, A5 and a set-point of the first axis. The drive keeps 10 although 0 is
    /// sent from 300 ms on: for 0.2 s it may be the delay of the line. It takes 0 at 1,000 ms and
    /// has until 1,300 ms to brake. Without recent commands, the program is responsible.
    #[test]
    fn a_drive_that_keeps_an_old_set_point_does_not_follow() {
        let command = |bytes: &[u8]| match bytes {
            [.., 0xA5, value] => Some(vec![Some(f64::from(*value)), None]),
            _ => None,
        };
        let mut sent = Sent {
            link: 0,
            dialect: Dialect {
                link: "base",
                frame_max: 2,
                command,
            },
            chunks: VecDeque::new(),
            set_points: VecDeque::new(),
        };
        let axis = |set_point| Axis {
            name: "drive".into(),
            unit: "",
            set_point,
            limit: None,
            actual: None,
        };
        let mut led = Vec::new();
        for ms in (0..2_500).step_by(10) {
            let now = Instant::from_millis(ms);
            match ms {
                100..300 if ms % 20 == 0 => sent.take(now, &[0xA5, 10]),
                300..1_500 if ms % 20 == 0 => {
                    sent.take(now, &[0xA5]);
                    sent.take(now, &[0]);
                }
                _ => {}
            }
            let kept = match ms {
                110..1_000 => 10.0,
                1_800.. => 7.0,
                _ => 0.0,
            };
            sent.see(now, &[axis(kept), axis(3.0)]);
            led.push((ms, sent.follows(now)));
        }
        let lost: Vec<u64> = led.iter().filter(|one| !one.1).map(|one| one.0).collect();
        // The last command of 10 is that of 280 ms.
        assert_eq!(lost, (490..=1_290).step_by(10).collect::<Vec<_>>());
    }

    use emulators::world::{Contact, Point};

    use super::super::Status;
    use crate::rig::bare::linked;

    fn axis(set_point: f64) -> Axis {
        Axis {
            name: "drive".into(),
            unit: "",
            set_point,
            limit: None,
            actual: None,
        }
    }

    /// A byte is a command of its value.
    const BYTE: Dialect = Dialect {
        link: "base",
        frame_max: 1,
        command: |bytes| Some(vec![Some(f64::from(*bytes.first()?))]),
    };

    /// Looks at a contact at 1 s; the drive has the set-point 5 then and since 0.5 s, and the
    /// program has sent `sent` each 100 ms. Other lines carry 5.
    fn judged(dialect: Option<Dialect>, sent: u8, until: Option<Instant>) -> (Status, String) {
        let (mut rig, [base, other]) = linked(["base", "other"], 1_000_000);
        let checker = NoCollisionAtSpeed::judging_until(until);
        let mut checker = checker.commanded_in(&mut rig, dialect);
        for tenth in 1..=10 {
            rig.inject(base[1].node, &[sent]);
            rig.inject(base[0].node, &[5]);
            rig.inject(other[1].node, &[5]);
            rig.run_until(Instant::from_millis(100 * tenth));
            let contact = Contact {
                at: rig.now(),
                speed_m_s: 0.9,
                own_m_s: 0.3,
                place: Point::default(),
            };
            let contacts = if tenth == 10 {
                vec![contact]
            } else {
                Vec::new()
            };
            checker.observe(&Look {
                rig: &rig,
                axes: &[axis(if tenth >= 5 { 5.0 } else { 0.0 })],
                contacts: &contacts,
            });
        }
        let mut copy = rig.fork().expect("plain");
        let copied = checker.fork(&mut copy).map(|copy| copy.verdict());
        let check = checker.verdict();
        assert_eq!(copied, Some(check.clone()));
        (check.status, check.detail)
    }

    /// A drive that follows the program is to blame, and so is one whose commands are not known.
    #[test]
    fn a_contact_is_judged_if_the_drive_follows() {
        let told = "1 contacts, the first harmful one at 1.000000 s, the fastest at 0.300 m/s";
        let fails = (Status::Fail, told.to_owned());
        assert_eq!(judged(Some(BYTE), 5, None), fails);
        assert_eq!(judged(None, 7, None), fails);
        let other = Dialect {
            link: "gone",
            ..BYTE
        };
        assert_eq!(judged(Some(other), 7, None), fails);
        let excused = "1 contacts, harmful only while a sensor deceives the robot or its drive \
                       does not follow";
        let passes = (Status::Pass, excused.to_owned());
        assert_eq!(judged(Some(BYTE), 7, None), passes);
        let at = Instant::from_millis;
        assert_eq!(judged(None, 7, Some(at(1_000))), passes);
        assert_eq!(judged(None, 7, Some(at(1_001))), fails);
    }

    /// Bytes are kept for 0.7 s; of set-points the one that held 0.35 s ago, too.
    #[test]
    fn what_can_matter_is_kept() {
        let mut sent = Sent {
            link: 0,
            dialect: BYTE,
            chunks: VecDeque::new(),
            set_points: VecDeque::new(),
        };
        let at = Instant::from_millis;
        for millis in [0, 700, 701] {
            sent.take(at(millis), &[1]);
            assert_eq!(
                sent.chunks.len(),
                if millis == 700 {
                    2
                } else {
                    1 + usize::from(millis > 700)
                }
            );
        }
        assert_eq!(sent.chunks[0].0, at(700));
        for (millis, set_point, kept) in [
            (0, 1.0, 1),
            (10, 1.0, 1),
            (100, 2.0, 2),
            (450, 3.0, 3),
            (451, 3.0, 2),
            (800, 3.0, 2),
            (801, 3.0, 1),
        ] {
            sent.see(at(millis), &[axis(set_point)]);
            assert_eq!(sent.set_points.len(), kept, "{millis}");
        }
    }

    /// A first command that is younger than 100 ms may not be in the drive yet; one of 200 ms ago
    /// still may be.
    #[test]
    fn commands_are_current_for_200_ms() {
        let leads = |millis: u64, set_point: f64| {
            let mut sent = Sent {
                link: 0,
                dialect: BYTE,
                chunks: VecDeque::new(),
                set_points: VecDeque::new(),
            };
            sent.take(Instant::from_millis(1_000), &[5]);
            sent.leads(Instant::from_millis(millis), &[set_point])
        };
        assert!(leads(999, 9.0) && leads(1_099, 9.0) && !leads(1_100, 9.0));
        assert!(leads(1_200, 5.0) && !leads(1_200, 9.0) && leads(1_201, 9.0));
    }
}
