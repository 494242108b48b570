//! Settings of links, and what goes wrong on them.

use emulators::rng::Rng;
use protocols::Instant;
use serde::{Deserialize, Serialize};

use super::{ScenarioError, Source, Span};
use crate::fault::{Damage, DamageKind, LineFaults, Strike, Window};
use crate::line::Direction;

/// Settings of a link.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkSpec {
    /// Time between the last bit on the wire and the receiver seeing the byte, both ways.
    #[serde(default)]
    pub latency: Span,
}

/// Something that goes wrong on a link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultSpec {
    /// Which link.
    pub link: toml::Spanned<String>,
    /// Which way.
    pub direction: DirectionSpec,
    /// What happens.
    pub kind: FaultKind,
    /// Chance per byte, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<toml::Spanned<f64>>,
    /// Number of the one byte that is hit, counted from 0 as sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub byte: Option<u64>,
    /// For `flip`: which bit, 0 to 7.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bit: Option<u8>,
    /// For `insert`: which value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<u8>,
    /// Begins here instead of at the start of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Span>,
    /// Ends here instead of at the end of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<Span>,
}

impl FaultSpec {
    /// The fault that does once more what `strike` did.
    pub fn of_strike(link: &str, direction: DirectionSpec, strike: Strike) -> Self {
        let (kind, bit, value) = match strike.damage {
            Damage::Flip { bit } => (FaultKind::Flip, Some(bit), None),
            Damage::Drop => (FaultKind::Drop, None, None),
            Damage::Insert { value } => (FaultKind::Insert, None, Some(value)),
            Damage::Duplicate => (FaultKind::Duplicate, None, None),
        };
        let link = toml::Spanned::new(0..0, link.to_owned());
        let byte = Some(strike.byte);
        Self {
            link,
            direction,
            kind,
            rate: None,
            byte,
            bit,
            value,
            from: None,
            until: None,
        }
    }

    /// Plans the fault on `line`; `index` is its place in the scenario's list.
    pub fn plan(
        &self,
        index: usize,
        line: &mut LineFaults,
        seed: u64,
        source: &Source,
    ) -> Result<(), ScenarioError> {
        let invalid = |key: &str, message: &str| {
            let key = format!("fault[{index}].{key}");
            Err(source.invalid(Some(self.link.span()), key, message))
        };
        let window = Window {
            from: self.from.map_or(Instant::ZERO, Span::instant),
            until: self.until.map_or(Window::ALWAYS.until, Span::instant),
        };
        let Some(kind) = self.kind.damage() else {
            line.add_cut(window);
            return Ok(());
        };
        match (&self.rate, self.byte) {
            (Some(rate), None) if (0.0..=1.0).contains(rate.get_ref()) => {
                let stream = format!("fault.{index}");
                line.add_rate(kind, window, *rate.get_ref(), Rng::stream(seed, &stream));
                Ok(())
            }
            (Some(_), None) => invalid("rate", "expected a chance per byte from 0 to 1"),
            (None, Some(byte)) => {
                let damage = match (self.kind, self.bit, self.value) {
                    (FaultKind::Flip, Some(bit @ 0..8), None) => Damage::Flip { bit },
                    (FaultKind::Flip, ..) => {
                        return invalid("bit", "a flip of one byte needs its bit, 0 to 7");
                    }
                    (FaultKind::Insert, None, Some(value)) => Damage::Insert { value },
                    (FaultKind::Insert, ..) => {
                        return invalid("value", "an insertion at one byte needs its value");
                    }
                    (FaultKind::Duplicate, ..) => Damage::Duplicate,
                    (FaultKind::Drop | FaultKind::Cut, ..) => Damage::Drop,
                };
                line.add_strike(Strike { byte, damage });
                Ok(())
            }
            _ => invalid("rate", "expected either a rate or the number of a byte"),
        }
    }
}

/// Directions as in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectionSpec {
    /// From the device to the robot's program.
    ToMaster,
    /// From the robot's program to the device.
    ToDevice,
}

impl From<DirectionSpec> for Direction {
    fn from(spec: DirectionSpec) -> Self {
        match spec {
            DirectionSpec::ToMaster => Self::ToMaster,
            DirectionSpec::ToDevice => Self::ToDevice,
        }
    }
}

/// Kinds of faults as in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// A bit is inverted.
    Flip,
    /// A byte is lost.
    Drop,
    /// A byte is inserted before another.
    Insert,
    /// A byte comes twice.
    Duplicate,
    /// Nothing gets through.
    Cut,
}

impl FaultKind {
    /// What it does to a byte; `None` for a cut.
    pub const fn damage(self) -> Option<DamageKind> {
        match self {
            Self::Flip => Some(DamageKind::Flip),
            Self::Drop => Some(DamageKind::Drop),
            Self::Insert => Some(DamageKind::Insert),
            Self::Duplicate => Some(DamageKind::Duplicate),
            Self::Cut => None,
        }
    }
}
