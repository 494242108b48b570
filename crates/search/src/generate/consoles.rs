//! Devices whose console a fault may have opened, and their power cycle.

use engine::scenario::{DirectionSpec, FaultKind, FaultSpec, Span};

/// Whether the fault inserts bytes on the way to the device of `link`.
pub(super) fn reaches(fault: &FaultSpec, link: &str) -> bool {
    let is_to = |way| fault.direction == Some(way);
    let comes_back = fault.kind == FaultKind::Echo && is_to(DirectionSpec::ToMaster);
    let is_on = fault.link.as_deref() == Some(link) || fault.with.as_deref() == Some(link);
    is_on && (is_to(DirectionSpec::ToDevice) || comes_back)
}

/// A power cycle by an operator, for a device that does not recover by itself.
pub(super) fn switched_off_and_on(device: &str, at_ms: u64) -> FaultSpec {
    FaultSpec {
        device: Some(device.to_owned()),
        from: Some(Span::from_millis(at_ms)),
        until: Some(Span::from_millis(at_ms + 100)),
        ..FaultSpec::new(FaultKind::Restart)
    }
}
