//! Checks that the robot works again after adversity and recovery.

use core::time::Duration;

use protocols::Instant;

use super::{Check, Checker, Look};
use crate::rig::Rig;
use crate::rig::fault::Window;
use crate::rig::line::Direction;

/// After adversity and recovery the robot works as before: the lines that were busy throughout the
/// second half of the warm-up carry bytes again, and a program in this process continues to
/// estimate its pose.
#[derive(Clone, Debug)]
pub struct AtWorkAgain {
    /// The phases: warm-up, adversity, recovery, judgement.
    phases: [Window; 4],
    /// Bytes delivered per line: at the four quarters of the second half of the warm-up, at its
    /// end, at the start of the judgement, and now.
    delivered: [Vec<u64>; 7],
    /// Time of the last estimate at the start of the judgement, and now.
    estimated: [Option<Instant>; 2],
    names: Vec<String>,
    /// Links that may be silent.
    sporadic: &'static [&'static str],
    was_judged: bool,
}

/// Minimum rate of a busy line, bytes per second.
const BUSY: u64 = 10;

impl AtWorkAgain {
    /// Observes a run with these phases; the links with these names may be silent.
    pub const fn new(phases: [Window; 4], sporadic: &'static [&'static str]) -> Self {
        Self {
            phases,
            delivered: [const { Vec::new() }; 7],
            estimated: [None; 2],
            names: Vec::new(),
            sporadic,
            was_judged: false,
        }
    }

    /// A quarter of the second half of the warm-up.
    fn quarter(&self) -> Duration {
        (self.phases[0].until - Instant::ZERO) / 8
    }
}

impl Checker for AtWorkAgain {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        let [warm_up, _, _, judgement] = self.phases;
        let lines = rig.links().iter().flat_map(|link| &link.lines);
        let delivered: Vec<u64> = lines.map(|line| line.traffic().delivered).collect();
        let estimated = rig.program().and_then(|program| program.estimate());
        let estimated = estimated.map(|(at, _)| at);
        if now <= judgement.until {
            let quarter = |number| Instant::ZERO + self.quarter() * number;
            let [half, end] = [quarter(4), warm_up.until];
            let quarters = [half, quarter(5), quarter(6), quarter(7), end];
            let judged = [judgement.from, judgement.until];
            let until = quarters.into_iter().chain(judged);
            for (seen, until) in self.delivered.iter_mut().zip(until) {
                if now <= until {
                    seen.clone_from(&delivered);
                }
            }
            if now <= judgement.from {
                self.estimated[0] = estimated;
            }
            self.estimated[1] = estimated;
        }
        self.was_judged |= now >= judgement.until;
        if self.names.is_empty() {
            let directions = [Direction::ToMaster, Direction::ToDevice];
            let names = rig.links().iter().flat_map(|link| {
                directions.map(|direction| format!("{} {}", link.name, direction.name()))
            });
            self.names = names.collect();
        }
    }

    fn verdict(&self) -> Check {
        let name = "at-work-again";
        if !self.was_judged {
            return Check::new(name, false, "the run ended before the end of the judgement");
        }
        let least = BUSY * u64::try_from(self.quarter().as_millis()).unwrap_or(u64::MAX) / 1000;
        let (quarters, [before, after]) = self.delivered.split_last_chunk().expect("seven");
        let of = |seen: &Vec<u64>, line: usize| seen.get(line).copied().unwrap_or(0);
        // A busy line carries bytes in each quarter; a list that is sent once does not make a line
        // busy.
        let busy = |line| {
            let mut quarters = quarters.windows(2);
            quarters.all(|pair| of(&pair[1], line) >= of(&pair[0], line) + least.max(1))
        };
        let is_steady = |line: &usize| {
            let link = self.names[*line].split(' ').next().unwrap_or_default();
            !self.sporadic.contains(&link)
        };
        let lines = (0..self.names.len()).filter(is_steady);
        let lines: Vec<usize> = lines.filter(|&line| busy(line)).collect();
        if lines.is_empty() {
            let detail = "no line was busy in the warm-up, so none can be judged";
            return Check::not_observed(name, detail);
        }
        let silent = lines
            .iter()
            .filter(|&&line| of(before, line) == of(after, line));
        let silent: Vec<&str> = silent.map(|&line| self.names[line].as_str()).collect();
        let lost = self.estimated[0].is_some() && self.estimated[0] == self.estimated[1];
        let detail = match (silent.is_empty(), lost) {
            (false, _) => format!("silent in the judgement: {}", silent.join(", ")),
            (true, true) => "no new pose in the judgement".to_owned(),
            (true, false) => format!("all of {} lines that were busy before", lines.len()),
        };
        Check::new(name, silent.is_empty() && !lost, detail)
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::check::Status;

    const fn window(from_s: u64, until_s: u64) -> Window {
        Window {
            from: Instant::from_secs(from_s),
            until: Instant::from_secs(until_s),
        }
    }

    /// The verdict on the line of `link`: `quarters` bytes were delivered in the quarters of the
    /// second half of a warm-up of 8 s, and `more` in the judgement.
    fn verdict_on(link: &str, quarters: [u64; 4], more: u64) -> (Status, String) {
        let phases = [window(0, 8), window(8, 10), window(10, 12), window(12, 20)];
        let mut checker = AtWorkAgain::new(phases, &["markers"]);
        let mut sum = 100;
        checker.delivered[0] = vec![sum];
        for (seen, count) in checker.delivered[1..].iter_mut().zip(quarters) {
            sum += count;
            *seen = vec![sum];
        }
        checker.delivered[5] = vec![500];
        checker.delivered[6] = vec![500 + more];
        checker.names = vec![format!("{link} to-master")];
        checker.was_judged = true;
        let check = checker.verdict();
        (check.status, check.detail)
    }

    fn verdict(quarters: [u64; 4], more: u64) -> (Status, String) {
        verdict_on("base", quarters, more)
    }

    /// The line is not busy, so there is no verdict.
    #[test]
    fn a_link_that_speaks_now_and_then_may_be_silent() {
        let (_, detail) = verdict_on("markers", [10; 4], 0);
        assert!(detail.starts_with("no line was busy"), "{detail}");
    }

    /// T6: a quarter is 1 s, in which a busy line carries ten bytes. A line with nine in one
    /// quarter was not busy, so there is no verdict.
    #[test]
    fn t6_ten_bytes_a_second_all_the_time_are_busy() {
        assert_eq!(verdict([10; 4], 1).0, Status::Pass);
        assert_eq!(
            verdict([10; 4], 0),
            (
                Status::Fail,
                "silent in the judgement: base to-master".to_owned()
            )
        );
        for quarter in 0..4 {
            let mut quarters = [10; 4];
            quarters[quarter] = 9;
            let (status, detail) = verdict(quarters, 1);
            assert_eq!(status, Status::NotObserved);
            assert!(detail.starts_with("no line was busy"), "{detail}");
        }
    }

    use super::super::safety::puppet::{copied, puppet};
    use crate::robots::checker::Look;

    /// A line with ten bytes each half of a second, but for these halves; estimates of the pose end
    /// at `last`.
    fn observed(silent: core::ops::Range<u64>, last: u64, until: u64) -> (Status, String) {
        let (mut rig, [base]) = crate::rig::bare::linked(["base"], 1_000_000);
        let phases = [window(0, 8), window(8, 10), window(10, 12), window(12, 20)];
        let mut checker = AtWorkAgain::new(phases, &[]);
        puppet(&mut rig);
        for half in 1..=2 * until {
            let at = Instant::from_millis(500 * half);
            if !silent.contains(&half) {
                rig.inject(base[0].node, &[7; 10]);
            }
            if at <= Instant::from_secs(last) {
                let pose = firmware_core::pose::Pose::default();
                puppet(&mut rig).estimate = Some((at, pose));
            }
            rig.run_until(at);
            checker.observe(&Look {
                rig: &rig,
                axes: &[],
                contacts: &[],
            });
        }
        let check = checker.verdict();
        assert_eq!(copied(&checker, &rig), check.to_string());
        (check.status, check.detail)
    }

    /// The warm-up ends at 8 s, the judgement is from 12 to 20 s.
    #[test]
    fn a_line_that_was_busy_works_again_in_the_judgement() {
        let all = || "all of 1 lines that were busy before".to_owned();
        assert_eq!(observed(0..0, 20, 20), (Status::Pass, all()));
        assert_eq!(observed(18..36, 20, 20), (Status::Pass, all()));
        // The bytes of the time before half of the warm-up do not matter.
        assert_eq!(observed(0..8, 20, 20), (Status::Pass, all()));
        assert_eq!(observed(11..13, 20, 20).0, Status::NotObserved);
        let silent = "silent in the judgement: base to-master".to_owned();
        assert_eq!(observed(24..60, 20, 20), (Status::Fail, silent.clone()));
        // What comes after the judgement is too late.
        assert_eq!(observed(24..42, 30, 25), (Status::Fail, silent));
        let early = "the run ended before the end of the judgement".to_owned();
        assert_eq!(observed(0..0, 20, 19), (Status::Fail, early));
    }

    #[test]
    fn a_program_that_had_a_pose_finds_a_new_one() {
        let lost = "no new pose in the judgement".to_owned();
        assert_eq!(observed(0..0, 12, 20), (Status::Fail, lost.clone()));
        assert_eq!(observed(0..0, 13, 20).0, Status::Pass);
        assert_eq!(observed(0..0, 0, 20).0, Status::Pass);
        assert_eq!(observed(0..0, 5, 25), (Status::Fail, lost));
    }
}
