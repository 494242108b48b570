//! Faults on a line as data: kind, time, rate.
//!
//! A fault is first a *rate* ("one byte in a hundred") and becomes a list of *strikes* ("byte 1234,
//! bit 3") during the run. A saved case holds the strikes: they mean the same in every later
//! version, a seed does not.
//!
//! | module | is |
//! |---|---|
//! | `damage` | damage to single bytes |
//! | `host` | effects of a host that treats bytes as text |
//! | `effect` | effects on a line while a fault is active |
//! | `activity` | times of activity: windows, spells, triggers |
//! | `budget` | limit of random damage |
//! | `line` | all faults on one direction of a link |

mod activity;
mod budget;
mod damage;
mod effect;
mod host;
mod line;

use serde::{Deserialize, Serialize};

pub use activity::{Activity, Spells, Trigger, Window};
pub use budget::{AT_ONCE, Budget};
pub use damage::{Damage, DamageKind, Strike};
pub(crate) use effect::Gate;
pub use effect::{BAUD_MAX, BAUD_MIN, Effect, Rate};
pub use host::HostDamage;
pub(crate) use line::Passed;
pub use line::{LineFaults, STRIKES_MAX};

/// Number of a fault in the schedule of a run: its place in the list, counted from zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FaultId(pub usize);

impl core::fmt::Display for FaultId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_reads_as_its_number() {
        assert_eq!(format!("fault {:>3}", FaultId(12)), "fault  12");
    }
}
