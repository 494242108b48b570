//! Tables of registers: values at addresses, also read and written in parts.

use core::borrow::Borrow;

use crate::field::put_number;
use crate::number::{Number, NumberKind};
use crate::value::Value;

/// Tolerance for a value beyond its limits, as a fraction of one count.
const SLACK: f64 = 1e-6;

/// Tables of registers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Registers {
    pub(crate) coils: Table,
    pub(crate) discrete: Table,
    pub(crate) input: Table,
    pub(crate) holding: Table,
    pub(crate) bytes: Table,
    /// Function codes that the device knows; empty: all codes.
    pub(crate) functions: Vec<u8>,
}

/// One table.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    /// Registers in order of addresses, without overlaps.
    pub(crate) cells: Vec<Cell>,
    /// Number of bytes per address.
    pub(crate) unit: usize,
    /// Whether addresses without a register read as 0 and accept writes.
    pub(crate) has_gaps: bool,
}

impl Default for Table {
    fn default() -> Self {
        Self {
            cells: Vec::new(),
            unit: 2,
            has_gaps: false,
        }
    }
}

/// A register.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    pub(crate) at: u32,
    /// Number of addresses of the register.
    pub(crate) len: u32,
    pub(crate) variable: usize,
    pub(crate) kind: CellKind,
    pub(crate) is_writable: bool,
    pub(crate) scale: Option<[f64; 2]>,
    pub(crate) limits: Option<[f64; 2]>,
}

/// The type of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CellKind {
    Bit,
    Number(Number),
    /// Text with this number of bytes.
    Text(usize),
}

/// The reason why a register is not read or written.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Refusal {
    /// No register at this address.
    Unknown(u32),
    /// Only the device changes this variable.
    ReadOnly(usize),
    /// The value is beyond the limits of this variable.
    OutOfRange(usize, Value, [f64; 2]),
}

type Values<'a> = &'a dyn Fn(usize) -> Value;

impl Cell {
    /// Whether the register ends before `place`.
    const fn is_before(&self, place: u32) -> bool {
        self.at <= place && place - self.at >= self.len
    }

    /// The bytes of the register on the wire.
    pub(crate) fn bytes(&self, value: &Value) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.put(value, &mut bytes);
        bytes
    }

    /// Appends the bytes of the register; returns whether they hold the value.
    fn put(&self, value: &Value, out: &mut Vec<u8>) -> bool {
        let scaled = self.scale.and_then(|[scale, offset]| {
            let value = value.as_f64()?;
            Some(Value::Float((value - offset) / scale))
        });
        let raw = scaled.as_ref().unwrap_or(value);
        match self.kind {
            CellKind::Bit => out.push(u8::from(raw.is_true())),
            CellKind::Number(number) => return put_number(number, raw, out),
            CellKind::Text(len) => {
                let text = match raw {
                    Value::Text(text) => text.clone(),
                    other => other.to_string(),
                };
                let end = out.len() + len;
                out.extend_from_slice(&text.as_bytes()[..text.len().min(len)]);
                out.resize(end, 0);
                return text.len() <= len;
            }
        }
        true
    }

    /// The bytes of the register for a value that a user orders.
    ///
    /// # Errors
    /// If the register cannot hold the value, or its limits exclude the value; with the allowed
    /// values.
    pub(crate) fn bytes_of_order(&self, value: &Value) -> Result<Vec<u8>, String> {
        let is_held = match self.kind {
            CellKind::Bit => matches!(value.as_f64(), Some(0.0 | 1.0)),
            CellKind::Text(len) => match value {
                Value::Text(text) => text.len() <= len,
                _ => false,
            },
            CellKind::Number(number) => value
                .as_f64()
                .is_some_and(|wanted| self.holds(number, value, wanted)),
        };
        match is_held {
            true => Ok(self.bytes(value)),
            false => Err(self.allowed()),
        }
    }

    /// The allowed values in words, if the register cannot hold `value`.
    pub(crate) fn beyond(&self, value: &Value) -> Option<String> {
        let CellKind::Number(number) = self.kind else {
            return None;
        };
        let wanted = value.as_f64()?;
        // A limit of -0.5 to 10.5 is that of 0 to 10.
        let rounded = Value::Float(wanted.round());
        let value = if self.scale.is_none() {
            &rounded
        } else {
            value
        };
        (!self.holds(number, value, wanted)).then(|| self.allowed())
    }

    /// Whether a number fits the type and the limits of the register.
    fn holds(&self, number: Number, value: &Value, wanted: f64) -> bool {
        let slack = self.scale.map_or(0.0, |[scale, _]| scale.abs() * SLACK);
        let is_within = self
            .limits
            .is_none_or(|[least, most]| (least - slack..=most + slack).contains(&wanted));
        let raw = match self.scale {
            Some([scale, offset]) => Value::Float((wanted - offset) / scale),
            None => value.clone(),
        };
        let fits = match (number.kind, &raw) {
            (NumberKind::Float, raw) => raw
                .as_f64()
                .is_some_and(|float| number.float(number.float_bits(float)).is_finite()),
            (_, Value::Float(float)) if self.scale.is_none() && float.fract() != 0.0 => false,
            (_, raw) => raw.as_int().is_some_and(|count| {
                let [least, greatest] = number.range();
                (least..=greatest).contains(&count)
            }),
        };
        is_within && fits
    }

    /// The values that the register accepts, in words.
    fn allowed(&self) -> String {
        let number = match self.kind {
            CellKind::Bit => return "expected 0 or 1 (off, on)".to_owned(),
            CellKind::Text(len) => return format!("expected text of at most {len} bytes"),
            CellKind::Number(number) => number,
        };
        let is_whole = number.kind != NumberKind::Float && self.scale.is_none();
        let noun = if is_whole {
            "a whole number"
        } else {
            "a number"
        };
        // The exact ends of an integer type.
        if let (true, None) = (is_whole, self.limits) {
            let [least, greatest] = number.range();
            return format!("expected {noun} from {least} to {greatest}");
        }
        let [mut least, mut most] = match (number.kind, number.bytes) {
            (NumberKind::Float, 4) => [f64::from(f32::MIN), f64::from(f32::MAX)],
            (NumberKind::Float, _) => [f64::MIN, f64::MAX],
            _ => number
                .range()
                .map(|end| Value::Int(end).as_f64().unwrap_or(0.0)),
        };
        if let Some([scale, offset]) = self.scale {
            let ends = [least, most].map(|count| count * scale + offset);
            [least, most] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        }
        if let Some(limits) = self.limits {
            [least, most] = [least.max(limits[0]), most.min(limits[1])];
        }
        let [least, most] = [least, most].map(Value::Float);
        format!("expected {noun} from {least} to {most}")
    }

    /// Decodes the bytes of the register.
    pub(crate) fn value(&self, bytes: &[u8]) -> Value {
        let raw = match self.kind {
            CellKind::Bit => return Value::Bool(bytes.first().is_some_and(|byte| *byte != 0)),
            CellKind::Number(number) => {
                let len = usize::from(number.bytes);
                crate::field::number_value(number, &bytes[..len])
            }
            CellKind::Text(_) => {
                let text: String = bytes.iter().map(|&byte| char::from(byte)).collect();
                return Value::Text(text.trim_end_matches('\0').to_owned());
            }
        };
        match self.scale.and_then(|scale| Some((scale, raw.as_f64()?))) {
            Some(([scale, offset], count)) => Value::Float(count * scale + offset),
            None => raw,
        }
    }
}

impl Registers {
    /// The registers of all tables.
    pub(crate) fn cells(&self) -> impl Iterator<Item = &Cell> {
        let tables = [
            &self.coils,
            &self.discrete,
            &self.input,
            &self.holding,
            &self.bytes,
        ];
        tables.into_iter().flat_map(|table| &table.cells)
    }

    /// The address of a variable.
    pub(crate) fn address_of(&self, variable: usize) -> Option<u32> {
        let found = self.cells().find(|cell| cell.variable == variable);
        found.map(|cell| cell.at)
    }
}

impl Table {
    /// Whether the table has no register.
    pub(crate) fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// The index of the last register that does not begin behind `at`, or 0.
    fn index_at(&self, at: u32) -> usize {
        let behind = self.cells.partition_point(|cell| cell.at <= at);
        behind.saturating_sub(1)
    }

    fn cell_at(&self, at: u32) -> Option<&Cell> {
        let cell = self.cells.get(self.index_at(at))?;
        (cell.at <= at && at - cell.at < cell.len).then_some(cell)
    }

    /// The bytes of `count` addresses from `at` on. `cut` gets the variables whose values do not
    /// fit their registers.
    pub(crate) fn read<V: Borrow<Value>>(
        &self,
        at: u32,
        count: u32,
        values: &dyn Fn(usize) -> V,
        cut: &mut Vec<usize>,
    ) -> Result<Vec<u8>, Refusal> {
        let mut out = Vec::with_capacity(count as usize * self.unit);
        let end = u64::from(at) + u64::from(count);
        let mut place = at;
        let mut index = self.index_at(at);
        while u64::from(place) < end {
            // The next register usually begins where the last one ends.
            while self
                .cells
                .get(index)
                .is_some_and(|cell| cell.is_before(place))
            {
                index += 1;
            }
            let Some(cell) = self.cells.get(index).filter(|cell| cell.at <= place) else {
                if !self.has_gaps {
                    return Err(Refusal::Unknown(place));
                }
                out.resize(out.len() + self.unit, 0);
                place += 1;
                continue;
            };
            let start = out.len();
            if !cell.put(values(cell.variable).borrow(), &mut out) {
                cut.push(cell.variable);
            }
            // Of a register that is read in part, only the requested bytes are returned.
            let first = (place - cell.at) as usize * self.unit;
            if first > 0 {
                out.drain(start..start + first);
            }
            let left = usize::try_from(end - u64::from(place)).unwrap_or(usize::MAX);
            out.truncate(start.saturating_add(left.saturating_mul(self.unit)));
            place = cell.at + cell.len;
        }
        Ok(out)
    }

    /// The variables that a write of `bytes` from `at` on changes, with their new values; all or
    /// nothing.
    pub(crate) fn write(
        &self,
        at: u32,
        bytes: &[u8],
        values: Values<'_>,
    ) -> Result<Vec<(usize, Value)>, Refusal> {
        let mut changes = Vec::new();
        let mut rest = bytes;
        let mut place = at;
        while !rest.is_empty() {
            let Some(cell) = self.cell_at(place) else {
                if !self.has_gaps {
                    return Err(Refusal::Unknown(place));
                }
                rest = &rest[self.unit.min(rest.len())..];
                place = place.wrapping_add(1);
                continue;
            };
            if !cell.is_writable {
                return Err(Refusal::ReadOnly(cell.variable));
            }
            let mut whole = cell.bytes(&values(cell.variable));
            let first = (place - cell.at) as usize * self.unit;
            let taken = rest.len().min(whole.len() - first);
            whole[first..first + taken].copy_from_slice(&rest[..taken]);
            let value = cell.value(&whole);
            // 3 counts of 0.1 exceed 0.3 through rounding alone.
            let slack = cell.scale.map_or(0.0, |[scale, _]| scale.abs() * SLACK);
            if let (Some(limits), Some(found)) = (cell.limits, value.as_f64())
                && !(limits[0] - slack..=limits[1] + slack).contains(&found)
            {
                return Err(Refusal::OutOfRange(cell.variable, value, limits));
            }
            changes.push((cell.variable, value));
            rest = &rest[taken..];
            place = cell.at + cell.len;
        }
        Ok(changes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::wire::Endian;

    /// In floating point, 3 counts of 0.1 are 0.30000000000000004; the limit is 0.3.
    #[test]
    fn the_count_at_a_limit_is_within_it() {
        let endian = Endian::Big;
        let number = Number {
            bytes: 2,
            kind: NumberKind::Unsigned,
            endian,
            words: endian,
        };
        let cell = Cell {
            at: 0,
            len: 1,
            variable: 0,
            kind: CellKind::Number(number),
            is_writable: true,
            scale: Some([0.1, 0.0]),
            limits: Some([0.1, 0.3]),
        };
        let table = Table {
            cells: vec![cell],
            ..Table::default()
        };
        let accepted = [0, 1, 3, 4].map(|count| {
            let values = |_: usize| Value::Int(0);
            table.write(0, &[0, count], &values).is_ok()
        });
        assert_eq!(accepted, [false, true, true, false]);
    }
}
