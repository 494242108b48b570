//! Figures of a port for the user.

use core::fmt;

use super::Traffic;
use crate::transport::Counters;

/// Name and figures of a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortReport {
    /// The port's name.
    pub name: String,
    /// Bytes that passed.
    pub traffic: Traffic,
    /// Bytes that were lost.
    pub lost: Counters,
}

impl fmt::Display for PortReport {
    /// One line for the user.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Traffic {
            from_client,
            to_client,
        } = self.traffic;
        write!(
            f,
            "{}: {to_client} B to the client, {from_client} B from it",
            self.name
        )?;
        let Counters { unheard, overrun } = self.lost;
        if unheard > 0 {
            write!(f, ", {unheard} B while no client had it open")?;
        }
        if overrun > 0 {
            write!(f, ", {overrun} B lost because the client did not read")?;
        }
        Ok(())
    }
}
