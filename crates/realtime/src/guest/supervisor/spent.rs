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

#[cfg(test)]
mod tests {
    use crate::guest::supervisor::tests::Bench;

    fn said(bench: &Bench) -> String {
        bench.supervisor.spent_on()
    }

    #[test]
    fn the_calls_of_a_program_are_told() {
        let mut bench = Bench::new();
        assert_eq!(said(&bench), "0 stopped calls");
        for (number, count) in [
            (nix::libc::SYS_read, 5),
            (nix::libc::SYS_write, 9),
            (nix::libc::SYS_poll, 7),
            (nix::libc::SYS_futex, 1),
        ] {
            bench.supervisor.spent.insert(number, count);
        }
        assert_eq!(said(&bench), "22 stopped calls (write 9, poll 7, read 5)");
        (bench.supervisor.looks, bench.supervisor.served) = (3, 4);
        bench.supervisor.idled = core::time::Duration::from_millis(1_250);
        assert_eq!(
            said(&bench),
            "22 stopped calls (write 9, poll 7, read 5), 3 looks at clocks without a stop, \
             4 reads and selects without a stop, 1.250 s passed while it asked for the same over \
             and over"
        );
    }

    /// A hint from more than 3,000 calls a simulated second on.
    #[test]
    fn many_calls_are_a_reason_for_a_hint() {
        let mut bench = Bench::new();
        bench.passes(2_500);
        let hint = "; 3001 stops a second: try --call-cost 100us if no byte is lost";
        for (count, expected) in [(6_001, ""), (6_002, hint)] {
            bench.supervisor.spent.insert(nix::libc::SYS_read, count);
            let text = format!("{count} stopped calls (read {count}){expected}");
            assert_eq!(said(&bench), text);
        }
    }
}
