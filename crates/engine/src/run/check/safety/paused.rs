//! The faults of a delivery: pauses of the line, a slower line, and damage.

use core::time::Duration;

use crate::rig::fault::Damage;
use crate::rig::line::Delivery;

/// Time after bytes that the line took with pauses in which the next ones are not judged: they
/// waited for the line.
pub(super) const PAUSED: Duration = Duration::from_millis(200);

/// Whether a fault paused the sender within these bytes, or made it slower than it assumes.
pub(super) fn has_paused(delivery: &Delivery) -> bool {
    let bauds = delivery.original.as_ref().and_then(|it| it.bauds);
    let is_slower = bauds.is_some_and(|[sender, receiver]| sender < receiver);
    is_slower || damages(delivery).any(|damage| matches!(damage, Damage::Idle { .. }))
}

/// Whether a fault changed these bytes.
pub(super) fn is_damaged(delivery: &Delivery) -> bool {
    damages(delivery).any(|damage| !matches!(damage, Damage::Idle { .. }))
}

fn damages(delivery: &Delivery) -> impl Iterator<Item = &Damage> {
    let originals = delivery.original.iter();
    let strikes = originals.flat_map(|original| &original.strikes);
    strikes.map(|strike| &strike.damage)
}
