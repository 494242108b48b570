//! Settings of links, and what goes wrong on them.

use emulators::rng::Rng;
use protocols::Instant;
use serde::{Deserialize, Serialize};

use super::Span;
use crate::fault::{Damage, DamageKind, FaultId, LineFaults, Strike, Window};
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
    pub link: String,
    /// Which way.
    pub direction: DirectionSpec,
    /// What happens.
    pub kind: FaultKind,
    /// Chance per byte, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
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
        Self {
            link: link.to_owned(),
            direction,
            kind,
            rate: None,
            byte: Some(strike.byte),
            bit,
            value,
            from: None,
            until: None,
        }
    }

    /// When it is active.
    pub fn window(&self) -> Window {
        Window {
            from: self.from.map_or(Instant::ZERO, Span::instant),
            until: self.until.map_or(Window::ALWAYS.until, Span::instant),
        }
    }

    /// What it does to the one byte that it names, if it names one.
    pub fn strike(&self) -> Result<Option<Strike>, Flaw> {
        let Some(byte) = self.byte else {
            return Ok(None);
        };
        let damage = match (self.kind, self.bit, self.value) {
            (FaultKind::Flip, Some(bit @ 0..8), None) => Damage::Flip { bit },
            (FaultKind::Flip, ..) => {
                return Err(Flaw::new("bit", "a flip of one byte needs its bit, 0 to 7"));
            }
            (FaultKind::Insert, None, Some(value)) => Damage::Insert { value },
            (FaultKind::Insert, ..) => {
                return Err(Flaw::new(
                    "value",
                    "an insertion at one byte needs its value",
                ));
            }
            (FaultKind::Duplicate, ..) => Damage::Duplicate,
            (FaultKind::Drop, ..) => Damage::Drop,
            (FaultKind::Cut, ..) => {
                return Err(Flaw::new("byte", "a cut has a time, expected no byte"));
            }
        };
        Ok(Some(Strike { byte, damage }))
    }

    /// Plans the fault on `line`; `seed` and its place in the list, `id`, choose its dice.
    ///
    /// # Errors
    /// If its keys do not go together.
    pub fn plan(&self, id: FaultId, line: &mut LineFaults, seed: u64) -> Result<(), Flaw> {
        let window = self.window();
        if window.until <= window.from {
            return Err(Flaw::new(
                "until",
                "is not after its begin, expected a later time",
            ));
        }
        let Some(kind) = self.kind.damage() else {
            self.strike()?;
            line.add_cut(id, window);
            return Ok(());
        };
        match (self.rate, self.strike()?) {
            (Some(chance), None) if (0.0..=1.0).contains(&chance) => {
                let stream = format!("fault.{id}");
                line.add_rate(id, kind, window, chance, Rng::stream(seed, &stream));
            }
            (Some(_), None) => {
                return Err(Flaw::new("rate", "expected a chance per byte from 0 to 1"));
            }
            (None, Some(strike)) => line.add_strike(strike),
            _ => {
                let message = "expected either a rate or the number of a byte";
                return Err(Flaw::new("rate", message));
            }
        }
        Ok(())
    }
}

/// What is wrong with a fault that somebody asked for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Flaw {
    /// The key in question.
    pub key: &'static str,
    /// What is wrong and what was expected.
    pub message: String,
}

impl Flaw {
    /// The flaw `message` of `key`.
    pub fn new(key: &'static str, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { key, message }
    }
}

impl core::fmt::Display for Flaw {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}: {}", self.key, self.message)
    }
}

impl core::error::Error for Flaw {}

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
    /// Name as in a file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Flip => "flip",
            Self::Drop => "drop",
            Self::Insert => "insert",
            Self::Duplicate => "duplicate",
            Self::Cut => "cut",
        }
    }

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
