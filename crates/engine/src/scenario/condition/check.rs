//! Checks of a condition's figures, independent of the robot.

use super::{BytesCondition, Condition, Flaw, FrameCondition, Op, Operand, RegisterCondition};

/// Longest pattern of bytes.
const PATTERN_MAX: usize = 256;
/// Deepest nesting of `all`, `any` and `not`.
const DEPTH_MAX: usize = 8;
/// Largest number of conditions in one.
const PARTS_MAX: usize = 64;

impl BytesCondition {
    /// The bytes of `hex`, if it is given.
    ///
    /// # Errors
    /// If `hex` is not a hexadecimal text of 1 to 256 bytes.
    pub fn pattern(&self) -> Result<Option<Vec<u8>>, Flaw> {
        let Some(hex) = &self.hex else {
            return Ok(None);
        };
        let digits: Option<Vec<u8>> = hex
            .chars()
            .filter(|c| !c.is_whitespace())
            .map(|c| c.to_digit(16).and_then(|digit| u8::try_from(digit).ok()))
            .collect();
        let pairs = digits.filter(|digits| digits.len().is_multiple_of(2));
        let bytes = pairs.map(|digits| digits.chunks(2).map(|two| two[0] << 4 | two[1]).collect());
        let bytes = bytes.filter(|bytes: &Vec<u8>| (1..=PATTERN_MAX).contains(&bytes.len()));
        let expected = "expected 1 to 256 bytes as pairs of hexadecimal digits such as \"fa a0\"";
        let flaw = || Flaw::new("hex", format!("is {hex:?}, {expected}"));
        bytes.map(Some).ok_or_else(flaw)
    }

    fn check(&self) -> Result<(), Flaw> {
        self.pattern()?;
        match (&self.hex, self.count) {
            (Some(_), None) | (None, Some(1..)) => Ok(()),
            _ => Err(Flaw::new("count", "expected hex, or a count of at least 1")),
        }
    }
}

impl FrameCondition {
    fn check(&self) -> Result<(), Flaw> {
        match (&self.field, &self.value) {
            (Some(_), None) => Err(Flaw::new("value", "is missing, field needs it")),
            (None, Some(_)) => Err(Flaw::new("field", "is missing, value needs it")),
            (None, None) if self.op.is_of_order() || self.op == Op::Unequal => {
                Err(Flaw::new("field", "is missing; op requires it"))
            }
            (Some(_), Some(value)) => check_operand(self.op, value),
            (None, None) => Ok(()),
        }
    }
}

impl RegisterCondition {
    fn check(&self) -> Result<(), Flaw> {
        if self.address.is_some() == self.name.is_some() {
            let message = "expected address or name of the register, and not both";
            return Err(Flaw::new("address", message));
        }
        check_operand(self.op, &self.value)
    }
}

/// Whether `op` can compare with `value`.
fn check_operand(op: Op, value: &Operand) -> Result<(), Flaw> {
    match value {
        Operand::Number(number) => check_number("value", *number),
        Operand::Flag(_) | Operand::Text(_) if op.is_of_order() => {
            let message = format!("is \"{op}\", expected \"==\" or \"!=\": {value} is no number");
            Err(Flaw::new("op", message))
        }
        Operand::Flag(_) | Operand::Text(_) => Ok(()),
    }
}

fn check_number(key: &'static str, number: f64) -> Result<(), Flaw> {
    match number.is_finite() {
        true => Ok(()),
        false => Err(Flaw::new(key, format!("is {number}, expected a number"))),
    }
}

impl Condition {
    /// Checks the figures of the condition, independent of the robot.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        let mut parts = 0;
        self.check_at(0, &mut parts)
    }

    fn check_at(&self, depth: usize, parts: &mut usize) -> Result<(), Flaw> {
        *parts += 1;
        if depth > DEPTH_MAX || *parts > PARTS_MAX {
            let message = format!(
                "expected at most {PARTS_MAX} conditions, {DEPTH_MAX} levels of all, any and not"
            );
            return Err(Flaw::new("all", message));
        }
        match self {
            Self::Bytes(bytes) => bytes.check(),
            Self::Frame(frame) => frame.check(),
            Self::Register(register) => register.check(),
            Self::Pose(pose) => {
                let is_place = pose.near_m.iter().all(|metres| metres.is_finite());
                match is_place && pose.within_m > 0.0 && pose.within_m.is_finite() {
                    true => Ok(()),
                    false => Err(Flaw::new(
                        "within_m",
                        "expected a number of metres, more than 0",
                    )),
                }
            }
            Self::Map(map) if !(0.0..=1.0).contains(&map.known_min) => {
                let message = format!("is {}, expected a share from 0 to 1", map.known_min);
                Err(Flaw::new("known_min", message))
            }
            Self::Visited(0) => Err(Flaw::new("visited", "is 0, expected at least 1")),
            Self::Axis(axis) => check_number("value", axis.value),
            Self::Robot(robot) => check_number("value", robot.value),
            Self::Contact(contact) => match contact.faster_than_m_s {
                Some(speed) if !(0.0..=1e6).contains(&speed) => {
                    let message = format!("is {speed}, expected at least 0");
                    Err(Flaw::new("faster_than_m_s", message))
                }
                _ => Ok(()),
            },
            Self::All(parts_of) | Self::Any(parts_of) => {
                let key = match self {
                    Self::All(_) => "all",
                    _ => "any",
                };
                if parts_of.is_empty() {
                    return Err(Flaw::new(key, "is empty, expected a condition"));
                }
                let mut inner = parts_of.iter();
                inner.try_for_each(|one| one.check_at(depth + 1, parts))
            }
            Self::Not(inner) if inner.is_momentary() => {
                let message = "expected no bytes, frame, contact or event, which hold for a moment \
                               only; a rule `never` forbids them";
                Err(Flaw::new("not", message))
            }
            Self::Not(inner) => inner.check_at(depth + 1, parts),
            Self::Event(_) | Self::Map(_) | Self::Visited(_) => Ok(()),
        }
    }

    /// Whether `is` accepts the condition or a part of it.
    pub fn has(&self, is: &dyn Fn(&Self) -> bool) -> bool {
        match self {
            Self::All(parts) | Self::Any(parts) => parts.iter().any(|part| part.has(is)),
            Self::Not(inner) => inner.has(is),
            leaf => is(leaf),
        }
    }

    /// Whether the condition, or a part of it, holds only at the moment at which bytes, a frame, a
    /// contact or an entry of the log arrives.
    pub fn is_momentary(&self) -> bool {
        self.has(&|leaf| !leaf.is_leaf_of_state())
    }

    /// Whether the condition, or a part of it, refers to the log.
    pub fn is_of_log(&self) -> bool {
        self.has(&|leaf| matches!(leaf, Self::Event(_)))
    }

    /// Whether the condition, or a part of it, refers to the state, which is sampled periodically.
    pub fn is_of_state(&self) -> bool {
        self.has(&Self::is_leaf_of_state)
    }

    fn is_leaf_of_state(&self) -> bool {
        !matches!(
            self,
            Self::Bytes(_) | Self::Frame(_) | Self::Event(_) | Self::Contact(_)
        )
    }

    /// Whether the condition can be false at a moment. A condition on a frame's field can; one on
    /// an event can only be true.
    pub fn can_be_false(&self) -> bool {
        match self {
            Self::Bytes(_) | Self::Event(_) | Self::Contact(_) => false,
            Self::Frame(frame) => frame.field.is_some(),
            Self::All(parts) | Self::Any(parts) => parts.iter().any(Self::can_be_false),
            Self::Not(inner) => inner.can_be_false(),
            _ => true,
        }
    }
}
