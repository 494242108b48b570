//! The fault of the scenario after which a program failed.

use core::time::Duration;

use protocols::Instant;

use super::Evidence;
use engine::scenario::{DirectionSpec, FaultKind, FaultSpec};

/// Maximum time between a fault and its effect.
const SOON: Duration = Duration::from_secs(5);

/// Time within which a working program would have sent or read again.
const NEXT: Duration = Duration::from_secs(1);

/// A fault that was active shortly before a failure.
pub(super) struct Trigger<'a> {
    fault: &'a FaultSpec,
    at: Instant,
}

impl<'a> Trigger<'a> {
    /// The fault with the last begin before `at`, if it was still active shortly before `at`.
    pub(super) fn before(evidence: &'a Evidence<'_>, at: Instant) -> Option<Self> {
        Self::before_on(evidence, at, |_| true)
    }

    /// The same for a program that sent or read last at `at`: the fault may have begun shortly
    /// after that.
    pub(super) fn of_silence(evidence: &'a Evidence<'_>, at: Instant) -> Option<Self> {
        Self::before(evidence, at + NEXT)
    }

    /// The same, limited to faults that change the bytes of `device` or their times.
    pub(super) fn from_device(
        evidence: &'a Evidence<'_>,
        at: Instant,
        device: &str,
    ) -> Option<Self> {
        Self::before_on(evidence, at, |fault| {
            fault.place().starts_with(device) && fault.direction != Some(DirectionSpec::ToDevice)
        })
    }

    fn before_on(
        evidence: &'a Evidence<'_>,
        at: Instant,
        is_of_it: impl Fn(&FaultSpec) -> bool,
    ) -> Option<Self> {
        let faults = evidence.outcome.case.fault.iter();
        let begun = faults.filter(|fault| is_of_it(fault)).filter_map(|fault| {
            let begun = begin(evidence, fault)?;
            let ends = match fault.byte {
                Some(_) => begun,
                None => fault.window().until,
            };
            (begun <= at && at - ends.min(at) <= SOON).then_some(Self { fault, at: begun })
        });
        begun.max_by_key(|one| one.at)
    }

    /// The trigger as the end of a sentence about `then`: `, after flip on grip at 0.200000 s`.
    pub(super) fn words(&self, then: Instant) -> String {
        let (kind, place, at) = (self.fault.kind.name(), self.fault.place(), self.at);
        let order = match at <= then {
            true => "after",
            false => "then came",
        };
        let byte = self.fault.byte.map_or_else(String::new, |byte| {
            let way = match self.fault.direction {
                Some(DirectionSpec::ToDevice) => "to-device",
                _ => "to-master",
            };
            format!(" (byte {byte} {way})")
        });
        format!(", {order} {kind} on {place}{byte} at {at} s")
    }

    /// A fix in the program for such a fault.
    pub(super) const fn remedy(&self) -> Option<&'static str> {
        use FaultKind::{
            Burst, Clog, Delayed, Drop, Duplicate, Flip, Insert, Jitter, Latency, Stall, Swap,
            Truncate,
        };
        match self.fault.kind {
            Flip | Drop | Insert | Duplicate | Burst | Truncate | Swap => Some(
                "it takes a damaged frame for a sound one, or does not find the next frame: verify \
                 checksum and length, and search the next header from the byte behind the bad one",
            ),
            Delayed | Latency | Jitter | Stall | Clog => Some(
                "it takes a late reply for the reply to a later request: discard the received \
                 bytes before each request, or compare the reply with the request",
            ),
            _ => None,
        }
    }
}

/// The fault before `at`, as the end of a sentence.
pub(super) fn after(evidence: &Evidence<'_>, at: Instant) -> String {
    Trigger::before(evidence, at).map_or_else(String::new, |trigger| trigger.words(at))
}

/// Begin of `fault`; `None` if it has not begun, or if the begin is unknown.
fn begin(evidence: &Evidence<'_>, fault: &FaultSpec) -> Option<Instant> {
    let Some(byte) = fault.byte else {
        let is_unknown =
            fault.at_byte.is_some() || fault.at_frame.is_some() || fault.when.is_some();
        // A fault that is active from the start is no event.
        return fault
            .from
            .filter(|from| !is_unknown && !from.0.is_zero())
            .map(|from| Instant::ZERO + from.0);
    };
    let link = fault.link.as_deref()?;
    let port = evidence.ports.all.iter().find(|port| port.name == link)?;
    port.passed_at(fault.direction == Some(DirectionSpec::ToDevice), byte)
}
