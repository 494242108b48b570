//! A foreign, unmodified program in virtual time: in any language. Its threads and processes run
//! one at a time under supervision, and see only the rig's clock. Time advances only when all of
//! them wait.
//!
//! ```text
//!  threads of the program        supervisor                     stage
//!  call --stop-------------->    answers, lets the kernel     ports, run, rig
//!       <-answer, or go on---    do it, or lets it wait  <---  bytes, time
//!                                all wait: time moves    --->
//! ```
//!
//! Under ptrace and a seccomp filter, the program stops at system calls about time, waiting, other
//! threads or ports; all other calls run at full speed. Each stopped call costs a fixed virtual
//! time, computing costs none. So each repetition of a run gives the same bytes, also on a loaded
//! machine. `docs/virtual-time.md` describes the requirements and the limits.
//!
//! Supervision needs Linux on x86-64. On other systems each program is refused with a message.

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod call;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod clock_page;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod computing;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod debugger;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod detour;
mod error;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod high_signals;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod inject;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod launch;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod lent;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod lines;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod links;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod memory;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod news;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod open_file;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod pending;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod place;
mod programs;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod settings;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod stage;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod supervisor;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod task;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod trace;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod trial;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod watchdog;

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
mod elsewhere;

use std::path::PathBuf;

use crate::exec::{self, ExecError, Foreign};
use engine::run::Outcome;
use engine::scenario::{Scenario, Source};

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub use debugger::{DebugSettings, Debugged, Surroundings, debug};
#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
pub use elsewhere::{DebugSettings, Debugged, Surroundings, debug};
#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
pub(crate) use elsewhere::{
    LINES_VERB, Played, Trial, TrialMoment, VERB, become_guest, become_guest_with_lines,
    become_shell_with_lines, run_with_lines,
};
pub use error::GuestError;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub use launch::{LINES_VERB, VERB, become_guest, become_guest_with_lines};
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub use lines::{become_shell_with_lines, run_with_lines};
pub use programs::files_named;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub use trial::{Played, Trial, TrialMoment};

/// Whether programs can have modem lines here.
pub const HAS_LINES: bool = cfg!(all(target_os = "linux", target_arch = "x86_64"));

/// Runs `scenario` with the program from beginning to end, with its ports in the first of `places`
/// and its output in the second, in virtual time or in real time as the program requires. For
/// callers that only need the verdict. `None` if `goes_on` returned false.
///
/// # Errors
/// If the program cannot be run.
pub fn judge(
    scenario: &Scenario,
    source: &Source,
    foreign: &Foreign,
    places: [&PathBuf; 2],
    goes_on: &dyn Fn() -> bool,
) -> Result<Option<Outcome>, ExecError> {
    if foreign.supervision.is_none() {
        let judged = exec::judge(scenario, source, foreign, places, goes_on)?;
        return Ok(judged.map(|judged| judged.outcome));
    }
    let refused = |error: GuestError| match error {
        GuestError::Exec(error) => error,
        error => ExecError::Virtual(error.to_string()),
    };
    let [dir, log] = places;
    let (run, seats, dir) = exec::stage(scenario, source, dir)?;
    let trial = Trial::start(run, seats, dir, foreign.clone(), None, log);
    let mut trial = trial.map_err(refused)?;
    let mut turned = Ok(());
    while !trial.is_over() && turned.is_ok() {
        if !goes_on() {
            trial.end();
            return Ok(None);
        }
        turned = trial.turn();
    }
    let played = trial.end();
    turned.map_err(refused)?;
    Ok(Some(played.outcome))
}

#[cfg(test)]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod tests;
