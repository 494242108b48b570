//! Checks of a program's life and end.

use protocols::Instant;

use crate::process::{Ended, Farewell, Left};
use engine::run::check::Check;

/// The verdict on a program's end and its time; `is_over`: whether the run was over.
pub fn alive(
    ended: Option<(Ended, Instant)>,
    is_over: bool,
    may_end: bool,
    farewell: &Farewell,
) -> Check {
    let stubborn = match farewell.was_killed {
        true => "; did not end within 2 s of SIGTERM, so it was killed",
        false => "",
    };
    let (pass, detail) = match ended {
        None => (true, format!("to the end{stubborn}")),
        Some((ended, at)) => {
            let is_fine = ended == Ended::Code(0) && (is_over || may_end);
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
