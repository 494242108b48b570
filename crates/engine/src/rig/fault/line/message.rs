//! Faults of whole messages.

use core::time::Duration;

use protocols::Instant;

use super::{COPIES_MAX, LineFaults};
use crate::rig::fault::{Budget, Damage, Effect};

/// Fate of a message.
#[derive(Debug)]
pub(crate) struct PassedMessage {
    /// Number of copies that arrive.
    pub(crate) copies: usize,
    /// Whether the next message arrives before it.
    pub(crate) is_overtaken: bool,
    /// Delay of the message.
    pub(crate) late: Duration,
    /// The active faults.
    pub(crate) effects: Vec<&'static str>,
}

impl LineFaults {
    /// Fate of message `number`, sent at `start`. Effects on single bytes do nothing.
    pub(crate) fn pass_message(
        &mut self,
        number: u64,
        start: Instant,
        budget: &mut Budget,
    ) -> PassedMessage {
        self.fire(number + 1, number, start);
        let mut passed = PassedMessage {
            copies: 1,
            is_overtaken: false,
            late: Duration::ZERO,
            effects: Vec::new(),
        };
        let mut is_cut = false;
        self.look(start);
        for &index in &self.order.others {
            let entry = &mut self.entries[index];
            if !entry.activity.is_active(start) {
                continue;
            }
            match &mut entry.effect {
                Effect::Cut => is_cut = true,
                Effect::Latency { by } => passed.late += *by,
                Effect::Jitter { by, rng } => {
                    let most = u64::try_from(by.as_nanos()).unwrap_or(u64::MAX - 1);
                    passed.late += Duration::from_nanos(rng.below(most + 1));
                }
                _ => continue,
            }
            passed.effects.push(entry.effect.words());
        }
        for damage in self.damages(number, start, budget) {
            match damage {
                Damage::Drop => passed.copies = 0,
                Damage::Duplicate => passed.copies = (passed.copies * 2).min(COPIES_MAX),
                Damage::Swap => passed.is_overtaken = true,
                _ => {}
            }
        }
        if is_cut {
            passed.copies = 0;
        }
        passed
    }
}
