//! Checks of a program's life and end.

use core::time::Duration;

use protocols::Instant;

use crate::process::{Ended, Farewell, Left};
use engine::run::check::Check;

/// A program that counts the run's duration itself ends before the run, by the time between its
/// start and the opening of its ports: at most this, and at most a tenth of the run.
const EARLY_MAX: Duration = Duration::from_millis(500);

/// Words of a crash in the program's own end.
pub(super) const CRASHED: &str = "crashed after SIGTERM:";

/// The verdict on a program's end and its time; `over`: the end of the run, if the run reached it;
/// `last`: its end after SIGTERM, if it still ran then. A crash after SIGTERM is an error of the
/// program; an exit code is its own choice.
pub fn alive(
    ended: Option<(Ended, Instant)>,
    over: Option<Instant>,
    may_end: bool,
    farewell: &Farewell,
    last: Option<Ended>,
) -> Check {
    let after = match last {
        _ if farewell.was_killed => {
            "; did not end within 2 s of SIGTERM, so it was killed".to_owned()
        }
        Some(last @ Ended::Code(1..)) => format!("; {last} after SIGTERM"),
        Some(last) if last.is_crash() => format!("; {CRASHED} {last}"),
        Some(_) | None => String::new(),
    };
    let (pass, detail) = match ended {
        None => {
            let has_crashed = last.is_some_and(Ended::is_crash);
            (!has_crashed, format!("to the end{after}"))
        }
        Some((ended, at)) => {
            let is_last = over.is_some_and(|over| {
                let early = EARLY_MAX.min((over - Instant::ZERO) / 10);
                at + early >= over
            });
            let is_fine = ended == Ended::Code(0) && (is_last || may_end);
            (is_fine, format!("ended with {ended} at {at} s"))
        }
    };
    Check::new("program-alive", pass, detail)
}

/// The verdict on the processes that a program left behind.
pub fn childless(left: &[Left]) -> Check {
    let names = |left: &mut dyn Iterator<Item = &Left>| {
        let names: Vec<String> = left.map(Left::to_string).collect();
        names.join(", ")
    };
    let killed = names(&mut left.iter().filter(|one| one.was_killed));
    let ended = names(&mut left.iter().filter(|one| !one.was_killed));
    let detail = match (killed.is_empty(), ended.is_empty()) {
        (true, true) => "none".to_owned(),
        (true, false) => format!("left running, ended by SIGTERM: {ended}"),
        (false, _) => format!("left running, had to be killed: {killed}"),
    };
    Check::new("no-children-left", killed.is_empty(), detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::run::check::Status;

    /// A program that leaves in the last seconds of a run has left too early.
    #[test]
    fn only_the_very_end_of_a_run_is_no_early_end() {
        let judged = |run_ms, end_ms, may_end| {
            let ended = Some((Ended::Code(0), Instant::from_millis(end_ms)));
            let over = Some(Instant::from_millis(run_ms));
            let farewell = Farewell::default();
            alive(ended, over, may_end, &farewell, None).status == Status::Pass
        };
        assert!(judged(20_000, 19_500, false) && !judged(20_000, 19_499, false));
        assert!(judged(2_000, 1_800, false) && !judged(2_000, 1_799, false));
        assert!(!judged(2_000, 10, false) && judged(2_000, 10, true));
    }
}
