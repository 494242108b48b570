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
