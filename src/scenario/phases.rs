//! The parts of a run in which faults may and may not happen.

use core::time::Duration;

use protocols::Instant;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FaultSpec, Span};
use crate::rig::fault::{Budget, Window};

/// Lengths of the parts of a run, one after the other. Faults at random, and those that name no
/// time, happen in the adversity only; in the judgement the robot must be at work again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhasesSpec {
    /// Length of the time in which nothing goes wrong yet.
    pub warm_up: Span,
    /// Length of the time in which faults happen.
    pub adversity: Span,
    /// Faults are over; the robot may take this long to recover.
    pub recovery: Span,
    /// Length of the time in which the robot must be at work.
    pub judgement: Span,
}

impl PhasesSpec {
    /// Warm-up, adversity, recovery, judgement.
    pub fn windows(&self) -> [Window; 4] {
        let mut from = Instant::ZERO;
        [self.warm_up, self.adversity, self.recovery, self.judgement].map(|span| {
            let until = from + span.0;
            let window = Window { from, until };
            from = until;
            window
        })
    }

    /// Length of all.
    pub fn length(&self) -> Duration {
        self.windows()[3].until - Instant::ZERO
    }

    /// Writes into `fault` when it may happen, unless it says so itself.
    pub(super) fn confine(&self, fault: &mut FaultSpec) {
        let [_, adversity, ..] = self.windows();
        let span = |at: Instant| Some(Span(at - Instant::ZERO));
        let says_when = fault.from.is_some()
            || fault.byte.is_some()
            || fault.at_byte.is_some()
            || fault.at_frame.is_some()
            || fault.when.is_some();
        if says_when && fault.rate.is_none() {
            return;
        }
        let from = fault.from.map_or(adversity.from, Span::instant);
        let until = match (fault.lasting, fault.every) {
            (Some(lasting), None) => from + lasting.0,
            _ => fault.until.map_or(adversity.until, Span::instant),
        };
        fault.from = span(from.max(adversity.from));
        fault.until = span(until.min(adversity.until));
        if fault.every.is_none() {
            fault.lasting = None;
        }
    }
}

/// How much may go wrong at random, on all lines together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BudgetSpec {
    /// Most strikes of the run; no limit if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total: Option<u64>,
    /// Most strikes within 100 ms; no limit if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_once: Option<u32>,
}

impl From<BudgetSpec> for Budget {
    fn from(spec: BudgetSpec) -> Self {
        Self::new(spec.total, spec.at_once)
    }
}
