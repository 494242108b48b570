//! Checks that the robot works again after its links were healed.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use crate::rig::Rig;
use crate::rig::line::Direction;

/// Minimum rate of a busy line from and to a device, bytes per second. A program that starts a
/// device again and again sends few bytes.
const BUSY: [u64; 2] = [10, 60];
/// Seconds in a row that make a line busy.
const SECONDS: u32 = 4;
/// A busy line sends within this time.
const JUDGED_MIN: Duration = Duration::from_secs(1);

/// In the last part of the run each line that was busy before carries bytes, and the program finds
/// its pose.
#[derive(Clone, Debug)]
pub struct AliveAtTheEnd {
    from: Instant,
    /// The earliest end of a run that can be judged.
    enough: Instant,
    exempt: Vec<String>,
    asks_for_pose: bool,
    lines: Vec<Watched>,
    second: Instant,
    estimated: [Option<Instant>; 2],
    /// The time up to which the run was observed.
    until: Instant,
}

#[derive(Clone, Debug)]
struct Watched {
    name: String,
    /// Minimum rate of a busy line.
    least: u64,
    /// Bytes that the sender itself had sent at the last full second, without those of an echo.
    sent: u64,
    /// Bytes that had arrived when the last part began, and now.
    delivered: [u64; 2],
    seconds: u32,
    is_busy: bool,
}

impl AliveAtTheEnd {
    /// Judges the time after `from`, which must last for `last`; links in `exempt` may be silent.
    pub fn new(from: Instant, last: Duration, exempt: Vec<String>, asks_for_pose: bool) -> Self {
        Self {
            from,
            enough: from + JUDGED_MIN.min(last / 2),
            exempt,
            asks_for_pose,
            lines: Vec::new(),
            second: Instant::ZERO,
            estimated: [None; 2],
            until: Instant::ZERO,
        }
    }

    fn begin(&mut self, rig: &Rig) {
        let both = [Direction::ToMaster, Direction::ToDevice];
        let links = rig.links().iter();
        let links = links.filter(|link| !self.exempt.contains(&link.name));
        let lines = links.flat_map(|link| {
            both.map(|direction| Watched {
                name: format!("{} {}", link.name, direction.name()),
                least: BUSY[usize::from(direction == Direction::ToDevice)],
                sent: 0,
                delivered: [0; 2],
                seconds: 0,
                is_busy: false,
            })
        });
        self.lines = lines.collect();
    }
}

impl Checker for AliveAtTheEnd {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        if self.lines.is_empty() {
            self.begin(rig);
        }
        let links = rig.links().iter();
        let links = links.filter(|link| !self.exempt.contains(&link.name));
        let counts = links.flat_map(|link| &link.lines);
        let counts = counts.map(|line| line.traffic());
        let is_second = now - self.second >= Duration::from_secs(1);
        let is_before = now <= self.from;
        for (line, count) in self.lines.iter_mut().zip(counts) {
            line.delivered[1] = count.delivered;
            if is_before {
                line.delivered[0] = count.delivered;
            }
            if is_second {
                let is_busy = count.sent >= line.sent + line.least;
                line.sent = count.sent;
                line.seconds = if is_busy { line.seconds + 1 } else { 0 };
                line.is_busy |= line.seconds >= SECONDS && is_before;
            }
        }
        if is_second {
            self.second = now;
        }
        let estimated = rig.program().and_then(|program| program.estimate());
        self.estimated[1] = estimated.map(|(at, _)| at);
        if is_before {
            self.estimated[0] = self.estimated[1];
        }
        self.until = now;
    }

    fn verdict(&self) -> Check {
        let name = "alive-at-the-end";
        if self.until < self.enough {
            let (until, from) = (self.until, self.from);
            let detail = format!(
                "the run ended at {until} s, and its last part begins at {from} s: with \
                 mission.to_the_end = true it does not end before its duration"
            );
            return Check::not_observed(name, detail);
        }
        let busy = self.lines.iter().filter(|line| line.is_busy);
        let silent = busy
            .clone()
            .filter(|line| line.delivered[0] == line.delivered[1]);
        let silent: Vec<&str> = silent.map(|line| line.name.as_str()).collect();
        let has_pose = self.estimated[0].is_some();
        let is_lost = self.asks_for_pose && has_pose && self.estimated[0] == self.estimated[1];
        let detail = match (silent.is_empty(), is_lost) {
            (false, _) => format!("silent since {} s: {}", self.from, silent.join(", ")),
            (true, true) => format!("no new pose since {} s", self.from),
            (true, false) => format!(
                "all of {} lines that were busy before",
                busy.clone().count()
            ),
        };
        let check = Check::new(name, silent.is_empty() && !is_lost, detail);
        check.if_observed(busy.count() > 0)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use firmware_core::pose::Pose;

    use super::super::puppet::{copied, puppet};
    use super::super::tests::{linked, look_at};
    use super::*;
    use crate::robots::checker::Status;

    fn alive(last: Duration) -> AliveAtTheEnd {
        AliveAtTheEnd::new(Instant::from_secs(10), last, Vec::new(), true)
    }

    /// Sends bytes to the master each second from the first one to this one.
    fn busy(rig: &mut Rig, alive: &mut AliveAtTheEnd, device: usize, until_s: u64, bytes: usize) {
        look_at(alive, rig, 0, 0.0);
        for second in 1..=until_s {
            rig.inject(device, &vec![7; bytes]);
            look_at(alive, rig, 1_000 * second, 0.0);
        }
    }

    /// Ten bytes a second from a device, in four seconds in a row.
    #[test]
    fn a_device_that_sends_ten_bytes_a_second_is_busy() {
        let judged = |bytes: usize, until_s: u64| {
            let (mut rig, [device, _]) = linked("base");
            let mut alive = alive(Duration::from_secs(4));
            busy(&mut rig, &mut alive, device, until_s, bytes);
            look_at(&mut alive, &mut rig, 11_000, 0.0);
            let check = alive.verdict();
            (check.status, check.detail)
        };
        let silent = "silent since 10.000000 s: base to-master".to_owned();
        assert_eq!(judged(10, 4), (Status::Fail, silent));
        let none = "all of 0 lines that were busy before".to_owned();
        assert_eq!(judged(10, 3), (Status::NotObserved, none));
        assert_eq!(judged(9, 10).0, Status::NotObserved);
        let all = "all of 1 lines that were busy before".to_owned();
        assert_eq!(judged(10, 11), (Status::Pass, all));
    }

    /// A second without enough bytes ends the row. The bytes of each second are judged by
    /// themselves, however often the run is looked at.
    #[test]
    fn four_busy_seconds_are_in_a_row() {
        let judged = |gap_s: u64, until_s: u64| {
            let (mut rig, [device, _]) = linked("base");
            let mut alive = alive(Duration::from_secs(4));
            look_at(&mut alive, &mut rig, 0, 0.0);
            for tenth in 1..=110 {
                if tenth % 10 == 5 && tenth < 10 * until_s && tenth / 10 != gap_s {
                    rig.inject(device, &[7; 10]);
                }
                look_at(&mut alive, &mut rig, 100 * tenth, 0.0);
            }
            alive.verdict().status
        };
        assert_eq!(judged(99, 4), Status::Fail);
        assert_eq!(
            [3, 4].map(|gap| judged(gap, 7)),
            [Status::NotObserved, Status::Fail]
        );
    }

    /// A second of the last part is enough, or half of a shorter one.
    #[test]
    fn a_part_of_the_end_is_enough() {
        let judged = |last_ms: u64, until_ms: u64| {
            let (mut rig, [device, _]) = linked("base");
            let mut alive = alive(Duration::from_millis(last_ms));
            busy(&mut rig, &mut alive, device, 9, 10);
            look_at(&mut alive, &mut rig, until_ms, 0.0);
            let check = alive.verdict();
            (check.status, check.detail)
        };
        let (status, detail) = judged(4_000, 10_999);
        assert_eq!(status, Status::NotObserved);
        let words = "the run ended at 10.999000 s, and its last part begins at 10.000000 s: with \
                     mission.to_the_end = true it does not end before its duration";
        assert_eq!(detail, words);
        assert_eq!(judged(4_000, 11_000).0, Status::Fail);
        assert_eq!(judged(1_000, 10_499).0, Status::NotObserved);
        assert_eq!(judged(1_000, 10_500).0, Status::Fail);
    }

    /// The line stays busy, and the program had estimates until 9 s, or until 10.5 s.
    #[test]
    fn a_program_that_had_a_pose_finds_a_new_one() {
        let judged = |last: Option<u64>, asks: bool| {
            let (mut rig, [device, _]) = linked("base");
            let mut alive = alive(Duration::from_secs(4));
            alive.asks_for_pose = asks;
            puppet(&mut rig);
            for half in 0..=24 {
                let at = Instant::from_millis(500 * half);
                if half % 2 == 0 {
                    rig.inject(device, &[7; 10]);
                }
                if last.is_some_and(|last| at <= Instant::from_millis(last)) {
                    puppet(&mut rig).estimate = Some((at, Pose::default()));
                }
                look_at(&mut alive, &mut rig, 500 * half, 0.0);
            }
            let text = alive.verdict().to_string();
            assert_eq!(copied(&alive, &rig), text);
            let check = alive.verdict();
            (check.status, check.detail)
        };
        let lost = "no new pose since 10.000000 s".to_owned();
        assert_eq!(judged(Some(10_000), true), (Status::Fail, lost));
        assert_eq!(judged(Some(10_500), true).0, Status::Pass);
        assert_eq!(judged(Some(9_000), false).0, Status::Pass);
        assert_eq!(judged(None, true).0, Status::Pass);
    }
}
