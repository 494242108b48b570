//! Maximum durations of faults.

use super::profile::Time;
use engine::scenario::{FaultKind, FaultSpec, Span};

/// Whether the fault stops all useful traffic instead of reducing it.
fn silences(kind: FaultKind) -> bool {
    use FaultKind as K;
    matches!(
        kind,
        K::Cut
            | K::Unplugged
            | K::Break
            | K::Stall
            | K::Overrun
            | K::WrongBaud
            | K::Swizzle
            | K::PowerDip
            | K::Off
    )
}

/// Whether the fault hides an object or its motion: the robot cannot detect this, and without
/// steering it hits the object.
pub(super) fn is_deceived(fault: &FaultSpec) -> bool {
    let name = fault.fault.as_deref().unwrap_or_default();
    fault.kind == FaultKind::Stuck || ["blind", "servo"].contains(&name)
}

/// Whether the fault is intermittent by nature.
pub(super) fn comes_in_spells(kind: FaultKind) -> bool {
    matches!(kind, FaultKind::Clog | FaultKind::Intermittent)
}

/// The maximum duration of `fault`.
pub(super) fn limit(time: &Time, fault: &FaultSpec) -> Option<Span> {
    match fault.kind {
        _ if is_deceived(fault) => time.stuck_max,
        kind if silences(kind) => time.silence_max,
        _ => time.other_max,
    }
}
