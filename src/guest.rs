//! A foreign, unmodified program in virtual time: whatever its language, its threads and processes
//! run one at a time under supervision, see the rig's clock and no other, and time moves only when
//! all of them wait.
//!
//! ```text
//!  threads of the program        supervisor                     stage
//!  call --stop-------------->    answers, lets the kernel     ports, run, rig
//!       <-answer, or go on---    do it, or lets it wait  <---  bytes, time
//!                                all wait: time moves    --->
//! ```
//!
//! Under ptrace and a seccomp filter the program stops at the calls that have to do with time,
//! waiting, other threads or ports; all others run at full speed. Each stopped call costs a fixed
//! virtual time, computing costs none. So the same run gives the same bytes, as often as one likes
//! and on a loaded machine: `docs/virtual-time.md` says what that takes and where it ends.
//!
//! For Linux on x86-64; elsewhere a program is refused in words.

mod error;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod call;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod launch;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod memory;
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

use core::time::Duration;
use std::path::PathBuf;

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
pub(crate) use elsewhere::{Played, Trial, VERB, become_guest};
pub(crate) use error::GuestError;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub(crate) use launch::{VERB, become_guest};
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub(crate) use trial::{Played, Trial};

/// How a program is supervised.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Settings {
    /// Of all chance that the program asks the system for.
    pub(crate) seed: u64,
    /// Virtual time that each stopped call takes.
    pub(crate) call_cost: Duration,
    /// Wall time for which a thread may compute without a call.
    pub(crate) spin_max: Duration,
    /// File for what was decided, call by call.
    pub(crate) trace: Option<PathBuf>,
}
