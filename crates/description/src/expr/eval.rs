//! Evaluation of a tree.

use core::cmp::Ordering;
use std::borrow::Cow;

use super::{Binary, ExprError, Function, Node, Scope, Unary};
use crate::value::Value;

fn error(message: impl Into<String>) -> ExprError {
    let message = message.into();
    ExprError { column: 0, message }
}

impl Node {
    /// Evaluates the node.
    pub(super) fn eval<'a>(&'a self, scope: &'a dyn Scope) -> Result<Cow<'a, Value>, ExprError> {
        let value = match self {
            Self::Const(value) => return Ok(Cow::Borrowed(value)),
            Self::Name(name) => {
                let value = scope.find(name);
                return value.ok_or_else(|| error(format!("there is no value \"{name}\"")));
            }
            Self::Choice(parts) => {
                let [condition, yes, no] = &**parts;
                return match condition.eval(scope)?.is_true() {
                    true => yes.eval(scope),
                    false => no.eval(scope),
                };
            }
            Self::Unary(operator, of) => unary(*operator, &*of.eval(scope)?),
            Self::Binary(operator, left, right) => {
                binary(*operator, &*left.eval(scope)?, &*right.eval(scope)?)
            }
            Self::And(left, right) => {
                let both = left.eval(scope)?.is_true() && right.eval(scope)?.is_true();
                Ok(Value::Bool(both))
            }
            Self::Or(left, right) => {
                let either = left.eval(scope)?.is_true() || right.eval(scope)?.is_true();
                Ok(Value::Bool(either))
            }
            Self::Index(of, index) => element(&*of.eval(scope)?, &*index.eval(scope)?),
            Self::Call(function, arguments) => match &arguments[..] {
                [one] => call(*function, &[one.eval(scope)?], scope),
                [one, other] => call(*function, &[one.eval(scope)?, other.eval(scope)?], scope),
                all => {
                    let all = all.iter().map(|argument| argument.eval(scope));
                    call(*function, &all.collect::<Result<Vec<_>, _>>()?, scope)
                }
            },
        };
        value.map(Cow::Owned)
    }
}

fn unary(operator: Unary, of: &Value) -> Result<Value, ExprError> {
    match (operator, of) {
        (Unary::Not, of) => Ok(Value::Bool(!of.is_true())),
        (Unary::Minus, Value::Float(float)) => Ok(Value::Float(-float)),
        (Unary::Minus, Value::Int(int)) => int
            .checked_neg()
            .map(Value::Int)
            .ok_or_else(|| error("the number is too large")),
        (Unary::Invert, Value::Int(int)) => Ok(Value::Int(!int)),
        (_, of) => Err(error(format!("expected a number, found {}", of.kind()))),
    }
}

impl Binary {
    const fn symbol(self) -> &'static str {
        match self {
            Self::Add => "+",
            Self::Subtract => "-",
            Self::Multiply => "*",
            Self::Divide => "/",
            Self::DivideDown => "//",
            Self::Remainder => "%",
            Self::ShiftLeft => "<<",
            Self::ShiftRight => ">>",
            Self::BitAnd => "&",
            Self::BitOr => "|",
            Self::BitXor => "^",
            Self::Equal => "==",
            Self::Unequal => "!=",
            Self::Less => "<",
            Self::LessOrEqual => "<=",
            Self::Greater => ">",
            Self::GreaterOrEqual => ">=",
        }
    }
}

fn binary(operator: Binary, left: &Value, right: &Value) -> Result<Value, ExprError> {
    let is = |orderings: &[Ordering]| {
        let found = compare(left, right).map(|found| orderings.contains(&found));
        found.ok_or_else(|| misfit(operator, left, right))
    };
    match operator {
        Binary::Equal => Ok(Value::Bool(equals(left, right))),
        Binary::Unequal => Ok(Value::Bool(!equals(left, right))),
        Binary::Less => is(&[Ordering::Less]).map(Value::Bool),
        Binary::LessOrEqual => is(&[Ordering::Less, Ordering::Equal]).map(Value::Bool),
        Binary::Greater => is(&[Ordering::Greater]).map(Value::Bool),
        Binary::GreaterOrEqual => is(&[Ordering::Greater, Ordering::Equal]).map(Value::Bool),
        _ => match (left, right) {
            (Value::Text(a), Value::Text(b)) if operator == Binary::Add => {
                Ok(Value::Text(format!("{a}{b}")))
            }
            (Value::Bytes(a), Value::Bytes(b)) if operator == Binary::Add => {
                Ok(Value::Bytes([&a[..], &b[..]].concat()))
            }
            (Value::Float(_), _) | (_, Value::Float(_)) => floats(operator, left, right),
            _ => ints(operator, left, right),
        },
    }
}

fn misfit(operator: Binary, left: &Value, right: &Value) -> ExprError {
    error(format!(
        "expected numbers for \"{}\", found {} and {}",
        operator.symbol(),
        left.kind(),
        right.kind()
    ))
}

fn floats(operator: Binary, left: &Value, right: &Value) -> Result<Value, ExprError> {
    let numbers = left.as_f64().zip(right.as_f64());
    let (a, b) = numbers.ok_or_else(|| misfit(operator, left, right))?;
    let divided = |result: f64| match b == 0.0 {
        true => Err(error("division by 0")),
        false => Ok(Value::Float(result)),
    };
    match operator {
        Binary::Add => Ok(Value::Float(a + b)),
        Binary::Subtract => Ok(Value::Float(a - b)),
        Binary::Multiply => Ok(Value::Float(a * b)),
        Binary::Divide => divided(a / b),
        Binary::DivideDown => divided((a / b).floor()),
        Binary::Remainder => divided(a - b * (a / b).floor()),
        _ => Err(error(format!(
            "expected whole numbers for \"{}\"",
            operator.symbol()
        ))),
    }
}

fn ints(operator: Binary, left: &Value, right: &Value) -> Result<Value, ExprError> {
    let whole = |value: &Value| match value {
        Value::Int(int) => Some(*int),
        Value::Bool(yes) => Some(i128::from(*yes)),
        _ => None,
    };
    let (Some(a), Some(b)) = (whole(left), whole(right)) else {
        return Err(misfit(operator, left, right));
    };
    let shift = || {
        let places = u32::try_from(b).ok().filter(|places| *places < 128);
        places.ok_or_else(|| error(format!("shift by {b}, expected 0 to 127")))
    };
    let is_division = matches!(
        operator,
        Binary::Divide | Binary::DivideDown | Binary::Remainder
    );
    if is_division && b == 0 {
        return Err(error("division by 0"));
    }
    let result = match operator {
        Binary::Add => a.checked_add(b),
        Binary::Subtract => a.checked_sub(b),
        Binary::Multiply => a.checked_mul(b),
        Binary::Divide if a.checked_rem(b) == Some(0) => a.checked_div(b),
        Binary::Divide => return floats(operator, &float(a), &float(b)),
        // The remainder has the sign of the divisor.
        Binary::DivideDown => a.checked_div_euclid(b).map(|down| {
            if b < 0 && a.rem_euclid(b) != 0 {
                down - 1
            } else {
                down
            }
        }),
        Binary::Remainder => a
            .checked_rem_euclid(b)
            .map(|rest| match b < 0 && rest != 0 {
                true => rest + b,
                false => rest,
            }),
        Binary::ShiftLeft => a.checked_mul(1_i128.checked_shl(shift()?).unwrap_or(0)),
        Binary::ShiftRight => Some(a >> shift()?),
        Binary::BitAnd => Some(a & b),
        Binary::BitOr => Some(a | b),
        Binary::BitXor => Some(a ^ b),
        _ => return Err(misfit(operator, left, right)),
    };
    result
        .map(Value::Int)
        .ok_or_else(|| error("the number is too large"))
}

fn float(int: i128) -> Value {
    Value::Float(Value::Int(int).as_f64().unwrap_or(0.0))
}

fn compare(left: &Value, right: &Value) -> Option<Ordering> {
    match (left, right) {
        (Value::Text(a), Value::Text(b)) => Some(a.cmp(b)),
        (Value::Bytes(a), Value::Bytes(b)) => Some(a.cmp(b)),
        (Value::Int(a), Value::Int(b)) => Some(a.cmp(b)),
        _ => left.as_f64()?.partial_cmp(&right.as_f64()?),
    }
}

fn equals(left: &Value, right: &Value) -> bool {
    match (left, right) {
        (Value::Text(a), Value::Bytes(b)) | (Value::Bytes(b), Value::Text(a)) => a.as_bytes() == b,
        _ => compare(left, right).map_or(left == right, Ordering::is_eq),
    }
}

fn element(of: &Value, index: &Value) -> Result<Value, ExprError> {
    let Value::Int(at) = index else {
        return Err(error(format!(
            "expected a whole number in [], found {}",
            index.kind()
        )));
    };
    let place = usize::try_from(*at).ok();
    let (len, found) = match of {
        Value::Bytes(bytes) => {
            let found = place.and_then(|at| bytes.get(at)).copied();
            (bytes.len(), found.map(|byte| Value::Int(byte.into())))
        }
        Value::List(list) => (list.len(), place.and_then(|at| list.get(at)).cloned()),
        Value::Text(text) => {
            let found = place.and_then(|at| text.as_bytes().get(at)).copied();
            (
                text.len(),
                found.map(|byte| Value::Text(char::from(byte).to_string())),
            )
        }
        other => return Err(error(format!("{} has no elements", other.kind()))),
    };
    found.ok_or_else(|| match len {
        0 => error(format!("there is no element {at}, there are none")),
        _ => error(format!(
            "there is no element {at}, expected 0 to {}",
            len - 1
        )),
    })
}

fn call(
    function: Function,
    arguments: &[Cow<'_, Value>],
    scope: &dyn Scope,
) -> Result<Value, ExprError> {
    let first = &*arguments[0];
    let number = |value: &Value| {
        let number = value.as_f64().filter(|number| !number.is_nan());
        number.ok_or_else(|| error(format!("expected a number, found {}", value.kind())))
    };
    let whole = |value: &Value| {
        let whole = value.as_int();
        whole.ok_or_else(|| error(format!("expected a whole number, found {}", value.kind())))
    };
    let rounded = |round: fn(f64) -> f64| match first {
        Value::Int(_) => Ok(first.clone()),
        other => {
            let float = Value::Float(round(number(other)?));
            whole(&float).map(Value::Int)
        }
    };
    match function {
        Function::Abs => match first {
            Value::Int(int) => Ok(Value::Int(int.saturating_abs())),
            other => Ok(Value::Float(number(other)?.abs())),
        },
        Function::Bit => {
            let place = u32::try_from(whole(&arguments[1])?)
                .ok()
                .filter(|at| *at < 127);
            let place = place.ok_or_else(|| error("expected a bit from 0 to 126"))?;
            Ok(Value::Int((whole(first)? >> place) & 1))
        }
        Function::Bytes => {
            let bytes = arguments.iter().map(|value| match &**value {
                Value::Bytes(bytes) => Ok(bytes.clone()),
                Value::Text(text) => Ok(text.clone().into_bytes()),
                other => u8::try_from(whole(other)?)
                    .map(|byte| vec![byte])
                    .map_err(|_| error(format!("{other} is no byte, expected 0 to 255"))),
            });
            let bytes: Vec<Vec<u8>> = bytes.collect::<Result<_, _>>()?;
            Ok(Value::Bytes(bytes.concat()))
        }
        Function::Ceil => rounded(f64::ceil),
        Function::Floor => rounded(f64::floor),
        Function::Clamp => {
            let least = pick(first, &arguments[1], Ordering::Greater)?;
            pick(&least, &arguments[2], Ordering::Less)
        }
        Function::Float => match first {
            Value::Text(text) => {
                let float = text
                    .trim()
                    .parse::<f64>()
                    .ok()
                    .filter(|float| float.is_finite());
                float
                    .map(Value::Float)
                    .ok_or_else(|| error(format!("\"{text}\" is no number")))
            }
            other => number(other).map(Value::Float),
        },
        Function::Int => match first {
            Value::Text(text) => {
                let int = text.trim().parse().map(Value::Int);
                int.map_err(|_| error(format!("\"{text}\" is no whole number")))
            }
            other => Ok(Value::Int(whole(&Value::Float(number(other)?.trunc()))?)),
        },
        Function::Len => {
            let len = match first {
                Value::Text(text) => text.len(),
                Value::Bytes(bytes) => bytes.len(),
                Value::List(list) => list.len(),
                other => return Err(error(format!("{} has no length", other.kind()))),
            };
            Ok(Value::Int(i128::try_from(len).unwrap_or(i128::MAX)))
        }
        Function::Lower => Ok(Value::Text(text_of(first).to_lowercase())),
        Function::Upper => Ok(Value::Text(text_of(first).to_uppercase())),
        Function::Max => arguments[1..].iter().try_fold(first.clone(), |best, next| {
            pick(&best, next, Ordering::Greater)
        }),
        Function::Min => arguments[1..].iter().try_fold(first.clone(), |best, next| {
            pick(&best, next, Ordering::Less)
        }),
        Function::Registers => {
            let (address, count) = (whole(first)?, whole(&arguments[1])?);
            let bytes = scope.registers(address, count).map(Value::Bytes);
            bytes.ok_or_else(|| {
                error(format!(
                    "there are no {count} bytes of registers at {address}"
                ))
            })
        }
        Function::Round => match arguments.get(1) {
            None => rounded(f64::round),
            Some(digits) => {
                let digits = i32::try_from(whole(digits)?.clamp(0, 15)).unwrap_or(0);
                let scale = 10_f64.powi(digits);
                Ok(Value::Float((number(first)? * scale).round() / scale))
            }
        },
        Function::Sqrt => match number(first)? {
            of if of >= 0.0 => Ok(Value::Float(of.sqrt())),
            of => Err(error(format!("the root of {of} is no number"))),
        },
        Function::Text => match arguments.get(1) {
            None => Ok(Value::Text(text_of(first))),
            Some(digits) => {
                let digits = usize::try_from(whole(digits)?.clamp(0, 15)).unwrap_or(0);
                Ok(Value::Text(format!("{:.digits$}", number(first)?)))
            }
        },
    }
}

/// The greater or the lesser of two values.
fn pick(left: &Value, right: &Value, wanted: Ordering) -> Result<Value, ExprError> {
    let found = compare(left, right);
    let found = found.ok_or_else(|| {
        error(format!(
            "{} and {} cannot be compared",
            left.kind(),
            right.kind()
        ))
    })?;
    Ok(if found == wanted || found.is_eq() {
        left
    } else {
        right
    }
    .clone())
}

/// The value as text without quotes.
fn text_of(value: &Value) -> String {
    match value {
        Value::Text(text) => text.clone(),
        Value::Bytes(bytes) => String::from_utf8_lossy(bytes).into_owned(),
        other => other.to_string(),
    }
}
