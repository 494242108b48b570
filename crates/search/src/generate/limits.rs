//! Maximum durations of faults.

use super::profile::Time;
use engine::scenario::{FaultKind, FaultSpec, Span};

/// Whether the fault stops all useful traffic instead of reducing it.
pub(super) fn silences(kind: FaultKind) -> bool {
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

/// Largest error of a measurement that a robot must tolerate.
const ERROR_MAX: f64 = 0.1;
/// Faults of single devices that show obstacles elsewhere, or not at all.
const BLINDING: [&str; 9] = [
    "blind",
    "servo",
    "mirrored",
    "turned",
    "dense-starts",
    "front",
    "right",
    "left",
    "deaf",
];

/// Whether the fault makes a device measure so wrongly that no program can avoid obstacles by it.
/// `drives`: the device drives the robot, and does not see obstacles.
pub(super) fn blinds(fault: &FaultSpec, drives: bool) -> bool {
    let name = fault.fault.as_deref().unwrap_or_default();
    match fault.kind {
        FaultKind::Wrong => fault
            .factor
            .is_some_and(|factor| (factor - 1.0).abs() > ERROR_MAX + 1e-9),
        // A frozen picture; bytes with valid checksums and arbitrary contents.
        FaultKind::Stuck => !drives,
        FaultKind::Garbage => true,
        _ => BLINDING.contains(&name),
    }
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
