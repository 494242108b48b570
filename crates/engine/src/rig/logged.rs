//! Events of a rig, with their device or link.

use emulators::{Event, EventKind};

/// A device's event with the device's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Logged {
    /// Name of the device, or of the link.
    pub source: String,
    /// The event.
    pub event: Event,
}

impl Logged {
    /// Whether a master broke a rule.
    pub fn is_violation(&self) -> bool {
        self.event.kind == EventKind::Violation
    }
}

impl core::fmt::Display for Logged {
    /// `12.345678 base unknown-register: ..`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Event {
            at, rule, detail, ..
        } = &self.event;
        write!(f, "{at} {} {rule}: {detail}", self.source)
    }
}
