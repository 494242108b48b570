//! The phases of a run, with and without faults.

use core::time::Duration;

use protocols::Instant;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FaultSpec, Span};
use crate::rig::fault::{Budget, Window};

/// Lengths of the phases of a run, in their order. Random faults, and faults without a time or a
/// condition, act only in the phase `adversity`. In the phase `judgement` the robot must work
/// again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhasesSpec {
    /// Length of the phase before any fault.
    pub warm_up: Span,
    /// Length of the phase with faults.
    pub adversity: Span,
    /// Time to recover after the faults.
    pub recovery: Span,
    /// Length of the phase in which the robot must work.
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

    /// Sets the window of `fault`, unless the fault has its own.
    pub(super) fn confine(&self, fault: &mut FaultSpec) {
        let [_, adversity, ..] = self.windows();
        let span = |at: Instant| Some(Span(at - Instant::ZERO));
        let waits = fault.byte.is_some()
            || fault.at_byte.is_some()
            || fault.at_frame.is_some()
            || fault.waits_for_condition();
        if waits || (fault.from.is_some() && fault.rate.is_none()) {
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

/// Limits of random faults, for all lines together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BudgetSpec {
    /// Maximum number of damaged bytes in the run; no limit if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total: Option<u64>,
    /// Maximum number of damaged bytes within 100 ms; no limit if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_once: Option<u32>,
}

impl From<BudgetSpec> for Budget {
    fn from(spec: BudgetSpec) -> Self {
        Self::new(spec.total, spec.at_once)
    }
}

#[cfg(test)]
mod tests {
    use crate::scenario::Scenario;

    /// From 2 s to 5 s random faults and faults without a time act. A fault with a condition begins
    /// at the condition, also if it is random. A fault with its own time keeps this time.
    #[test]
    fn faults_that_say_no_time_happen_in_the_adversity() {
        let text = |fault: &str| {
            format!(
                "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"9s\"\n\
                 [phases]\nwarm_up = \"2s\"\nadversity = \"3s\"\nrecovery = \"1s\"\n\
                 judgement = \"1s\"\n[[fault]]\nlink = \"base\"\n\
                 direction = \"to-device\"\nkind = \"drop\"\n{fault}\n\
                 [world]\nstart = {{ x_m = 1.0, y_m = 1.0, heading_deg = 0 }}\n"
            )
        };
        let window = |fault: &str| {
            let read = Scenario::from_text(&text(fault)).expect("sound");
            let fault = &read.0.fault[0];
            let times = [fault.from, fault.until, fault.lasting];
            times.map(|time| time.map(|time| time.0.as_millis()))
        };
        let all = [Some(2_000), Some(5_000), None];
        assert_eq!(window("rate = 0.5"), all);
        assert_eq!(window("rate = 0.5\nfrom = \"1s\"\nuntil = \"9s\""), all);
        let four = [Some(3_000), Some(4_000), None];
        assert_eq!(window("rate = 0.5\nfrom = \"3s\"\nlasting = \"1s\""), four);
        let waits = [None, None, Some(20)];
        for event in [
            "at_byte = 2000",
            "at_frame = 20",
            "when = { near_m = [1, 1], within_m = 1 }",
        ] {
            let found = window(&format!("rate = 0.5\nlasting = \"20ms\"\n{event}"));
            assert_eq!(found, waits, "{event}");
        }
    }
}
