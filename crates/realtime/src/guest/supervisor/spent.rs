//! The time of a program's calls, to find out why it is slow.

use protocols::Instant;

use super::Supervisor;
use crate::exec::Cpu;
use crate::guest::call;

/// Maximum number of kinds of calls in the summary.
const NAMED: usize = 3;
/// Number of stopped calls per simulated second above which a hint is given: a processor handles
/// some 30,000 stops per second.
const MANY: u64 = 3_000;

impl Supervisor {
    /// Summary of calls, looks at clocks, and time of busy waiting.
    pub(in crate::guest) fn spent_on(&self) -> String {
        let stops: u64 = self.spent.values().sum();
        let mut kinds: Vec<(u64, i64)> = self
            .spent
            .iter()
            .map(|(&number, &count)| (count, number))
            .collect();
        kinds.sort_unstable_by(|one, other| other.cmp(one));
        let names: Vec<String> = kinds
            .iter()
            .take(NAMED)
            .map(|&(count, number)| format!("{} {count}", call::name(number)))
            .collect();
        let mut text = format!("{stops} stopped calls");
        if !names.is_empty() {
            text += &format!(" ({})", names.join(", "));
        }
        if self.looks > 0 {
            text += &format!(", {} looks at clocks without a stop", self.looks);
        }
        if self.served > 0 {
            text += &format!(", {} reads and selects without a stop", self.served);
        }
        if !self.idled.is_zero() {
            let seconds = self.idled.as_secs_f64();
            text += &format!(", {seconds:.3} s passed while it asked for the same over and over");
        }
        if let Some(computing) = &self.computing {
            let charged = computing.charged.as_secs_f64();
            text += &match self.settings.supervision.cpu.and_then(Cpu::scale) {
                Some(scale) => {
                    let used = computing.used.as_secs_f64();
                    format!(", {used:.3} s of computing took {charged:.3} s (--cpu {scale})")
                }
                None => format!(", computing took {charged:.3} s as in the case"),
            };
        }
        let each = stops / (self.stage.now() - Instant::ZERO).as_secs().max(1);
        if each > MANY {
            text += &format!("; {each} stops a second: try --call-cost 100us if no byte is lost");
        }
        text
    }
}
