//! Conditions in words, for verdicts.

use core::fmt;

use super::{Condition, Figure, Quantity};
use crate::rig::direction::Direction;
use crate::scenario::DirectionSpec;

impl Figure {
    /// The figure in words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SetPoint => "set-point",
            Self::Actual => "actual value",
        }
    }
}

impl Quantity {
    /// The figure in words, with its unit.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SpeedMS => "speed in m/s",
            Self::TurnRateDegS => "turn rate in degrees/s",
            Self::XM => "x in m",
            Self::YM => "y in m",
            Self::HeadingDeg => "heading in degrees",
            Self::Contacts => "number of contacts",
            Self::ClearanceM => "clearance in m",
        }
    }
}

fn direction(spec: DirectionSpec) -> &'static str {
    Direction::from(spec).name()
}

fn list(f: &mut fmt::Formatter<'_>, parts: &[Condition], word: &str) -> fmt::Result {
    for (index, part) in parts.iter().enumerate() {
        if index > 0 {
            write!(f, " {word} ")?;
        }
        match part {
            Condition::All(_) | Condition::Any(_) => write!(f, "({part})")?,
            _ => write!(f, "{part}")?,
        }
    }
    Ok(())
}

impl fmt::Display for Condition {
    /// `axis left, set-point <= 0.3`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bytes(one) => {
                let (link, to) = (&one.link, direction(one.direction));
                match (&one.hex, one.count) {
                    (Some(hex), _) => write!(f, "bytes {hex} on {link} {to}"),
                    (None, count) => write!(f, "{} bytes on {link} {to}", count.unwrap_or(1)),
                }
            }
            Self::Frame(one) => {
                let (link, to) = (&one.link, direction(one.direction));
                write!(f, "frame on {link} {to}")?;
                if !one.contains.is_empty() {
                    write!(f, " with \"{}\"", one.contains)?;
                }
                match (&one.field, &one.value) {
                    (Some(field), Some(value)) => write!(f, ", {field} {} {value}", one.op),
                    _ => Ok(()),
                }
            }
            Self::Register(one) => {
                write!(f, "{} ", one.device)?;
                match (&one.name, one.address) {
                    (Some(name), _) => write!(f, "{name}")?,
                    (None, address) => write!(f, "register {}", address.unwrap_or_default())?,
                }
                write!(f, " {} {}", one.op, one.value)
            }
            Self::Pose(one) => {
                let [x, y] = one.near_m;
                write!(f, "robot within {} m of {x}, {y}", one.within_m)
            }
            Self::Event(one) => match &one.source {
                Some(source) => write!(f, "event {} of {source}", one.rule),
                None => write!(f, "event {}", one.rule),
            },
            Self::Map(one) => write!(f, "known share of the map >= {}", one.known_min),
            Self::Visited(count) => write!(f, "visited waypoints >= {count}"),
            Self::Axis(one) => {
                let (name, of) = (&one.name, one.of.name());
                write!(f, "axis {name}, {of} {} {}", one.op, one.value)
            }
            Self::Robot(one) => write!(f, "{} {} {}", one.of.name(), one.op, one.value),
            Self::Contact(one) => match one.faster_than_m_s {
                Some(speed) => write!(f, "contact faster than {speed} m/s"),
                None => write!(f, "contact"),
            },
            Self::All(parts) => list(f, parts, "and"),
            Self::Any(parts) => list(f, parts, "or"),
            Self::Not(inner) => write!(f, "not ({inner})"),
        }
    }
}
