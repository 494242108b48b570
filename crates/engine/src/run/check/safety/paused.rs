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

/// Whether a fault changed these bytes. Bytes that arrive in pieces are unchanged.
pub(super) fn is_damaged(delivery: &Delivery) -> bool {
    let mut originals = delivery.original.iter();
    originals.any(|original| !original.bytes.starts_with(&delivery.bytes))
        || damages(delivery).any(|damage| !matches!(damage, Damage::Idle { .. }))
}

fn damages(delivery: &Delivery) -> impl Iterator<Item = &Damage> {
    let originals = delivery.original.iter();
    let strikes = originals.flat_map(|original| &original.strikes);
    strikes.map(|strike| &strike.damage)
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::*;
    use crate::rig::fault::Strike;
    use crate::rig::line::Original;

    fn delivery(bytes: &[u8], damage: Option<Damage>, bauds: Option<[u32; 2]>) -> Delivery {
        Delivery {
            at: Instant::ZERO,
            bytes: bytes.to_vec(),
            event: None,
            framing_errors: 0,
            marks: Vec::new(),
            original: Some(Box::new(Original {
                at: Instant::ZERO,
                bytes: vec![1, 2, 3, 4],
                strikes: damage
                    .map(|damage| Strike { byte: 3, damage })
                    .into_iter()
                    .collect(),
                effects: Vec::new(),
                bauds,
            })),
        }
    }

    const IDLE: Damage = Damage::Idle {
        by: Duration::from_millis(5),
    };

    /// Undamaged: four late bytes, also with a pause among them, and the first two of them in a
    /// separate piece. Damaged: a host drops one byte, or a strike removes or changes the last one.
    #[test]
    fn bytes_are_damaged_by_the_host_and_by_strikes() {
        let cases: [(&[u8], _, _); 7] = [
            (&[1, 2, 3, 4], None, false),
            (&[1, 2], None, false),
            (&[1, 3, 4], None, true),
            (&[1, 2, 3], Some(Damage::Drop), true),
            (&[1, 2, 3, 4], Some(Damage::Flip { bit: 0 }), true),
            (&[1, 2, 3, 4], Some(IDLE), false),
            (&[], None, false),
        ];
        for (bytes, damage, expected) in cases {
            let delivery = delivery(bytes, damage, None);
            assert_eq!(is_damaged(&delivery), expected, "{bytes:?}");
        }
        let mut untouched = delivery(&[9], None, None);
        untouched.original = None;
        assert!(!is_damaged(&untouched) && !has_paused(&untouched));
    }

    /// The line takes bytes more slowly than the sender assumes if a pause is among them, or if
    /// the sender has the lower rate.
    #[test]
    fn a_line_pauses_by_pauses_and_by_its_rate() {
        let cases = [
            (None, None, false),
            (Some(IDLE), None, true),
            (Some(Damage::Drop), None, false),
            (None, Some([9_600, 19_200]), true),
            (None, Some([19_200, 9_600]), false),
            (None, Some([9_600, 9_600]), false),
        ];
        for (damage, bauds, expected) in cases {
            let delivery = delivery(&[1, 2, 3, 4], damage, bauds);
            assert_eq!(has_paused(&delivery), expected, "{damage:?} {bauds:?}");
        }
    }
}
