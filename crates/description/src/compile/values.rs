//! `[state]` and `[registers]`: variables, their sources, and their addresses.

use core::time::Duration;
use std::sync::Arc;

use super::Compiler;
use crate::description::Protocol;
use crate::expr::Expr;
use crate::number::{Number, NumberKind, Orders};
use crate::registers::{Cell, CellKind, Registers, Table};
use crate::schema::short::{Plain, Short};
use crate::schema::state::{Access, RegisterSpec, RegistersSpec, SourceSpec, StateSpec};
use crate::schema::wire::Endian;
use crate::state::{Recording, RecordingError, Source, Variable};
use crate::value::Value;
use span::Span;

/// Time for which a noise value stays if the file does not set it.
const NOISE: Duration = Duration::from_millis(100);

impl Compiler<'_> {
    /// The variables of `[state]`.
    pub(super) fn variables(&mut self) {
        let schema = self.schema;
        for (name, Short(spec)) in &schema.state {
            let key = format!("state.{name}");
            self.check_word(&key, name);
            let variable = self.state_variable(&key, name, spec);
            self.variables.push(variable);
        }
    }

    fn state_variable(&mut self, key: &str, name: &str, spec: &StateSpec) -> Variable {
        self.check_limits(key, spec.limits);
        let initial = spec.initial.clone().map_or(Value::Int(0), |plain| plain.0);
        self.check_within(&format!("{key}.initial"), &initial, spec.limits);
        if let Some(Plain(safe)) = &spec.safe {
            self.check_within(&format!("{key}.safe"), safe, spec.limits);
        }
        let source = self.source(key, spec.source.as_ref(), spec.value.as_deref());
        let names = self.names(key, spec.names.as_deref());
        if let (Some(names), Some(Plain(initial))) = (&names, &spec.initial)
            && initial.as_int().is_none_or(|int| !names.contains_key(&int))
        {
            let known: Vec<String> = names
                .iter()
                .map(|(int, name)| format!("{int} ({name})"))
                .collect();
            let message = format!("is {initial}, expected one of {}", known.join(", "));
            self.wrong(format!("{key}.initial"), message);
        }
        Variable {
            name: Arc::from(name),
            initial,
            unit: spec.unit.clone(),
            limits: spec.limits,
            names,
            source,
            safe: spec.safe.clone().map(|plain| plain.0),
            keeps: spec.keeps,
            about: spec.about.clone(),
        }
    }

    fn check_within(&mut self, key: &str, value: &Value, limits: Option<[f64; 2]>) {
        if let (Some([least, most]), Some(found)) = (limits, value.as_f64())
            && !(least..=most).contains(&found)
        {
            self.wrong(key, format!("is {value}, expected {least} to {most}"));
        }
    }

    fn source(&mut self, key: &str, spec: Option<&SourceSpec>, value: Option<&str>) -> Source {
        if spec.is_some() && value.is_some() {
            self.wrong(key, "has \"source\" and \"value\", expected one of them");
        }
        let key = format!("{key}.source");
        let Some(spec) = spec else {
            return Source::Stored;
        };
        let period = |compiler: &mut Self, span: Span| {
            if span.0.is_zero() {
                compiler.wrong(&key, "its period is 0, expected a time");
            }
            span.0
        };
        match spec {
            SourceSpec::Stored => Source::Stored,
            SourceSpec::Counter(span) => Source::Counter(period(self, *span)),
            SourceSpec::Ramp {
                from,
                to,
                period: span,
            } => Source::Ramp {
                from: *from,
                to: *to,
                period: period(self, *span),
            },
            SourceSpec::Sine {
                mean,
                amplitude,
                period: span,
            } => Source::Sine {
                mean: *mean,
                amplitude: *amplitude,
                period: period(self, *span),
            },
            SourceSpec::Noise {
                mean,
                deviation,
                period: span,
            } => {
                let period = period(self, span.unwrap_or(Span(NOISE)));
                Source::Noise {
                    mean: *mean,
                    deviation: *deviation,
                    period,
                }
            }
            SourceSpec::Csv {
                file,
                column,
                repeats,
            } => {
                let text = match (self.files)(file) {
                    Ok(text) => text,
                    Err(message) => {
                        let message =
                            format!("{message}; expected a CSV file beside the description");
                        self.wrong(format!("{key}.csv.file"), message);
                        return Source::Stored;
                    }
                };
                let (key, message) = match Recording::parse(&text, column) {
                    Ok(recording) => {
                        return Source::Recorded {
                            recording: Arc::new(recording),
                            repeats: *repeats,
                        };
                    }
                    Err(RecordingError::Column(message)) => (format!("{key}.csv.column"), message),
                    Err(RecordingError::Contents(message)) => (format!("{key}.csv.file"), message),
                };
                self.wrong(key, format!("{file}: {message}"));
                Source::Stored
            }
            SourceSpec::World(quantity) => Source::World(*quantity),
        }
    }

    /// The tables of registers, whose values become variables as well.
    pub(super) fn registers(&mut self, protocol: Option<Protocol>) -> Option<Registers> {
        let spec = self.schema.registers.as_ref();
        let Some(spec) = spec else {
            if protocol.is_some() {
                let message = "Modbus needs registers, expected the table [registers]";
                self.wrong("protocol", message);
            }
            return None;
        };
        let mut registers = Registers {
            functions: spec.functions.clone(),
            ..Registers::default()
        };
        registers.coils = self.table("coils", &spec.coils, spec, Of::Bits(Access::Write));
        registers.discrete = self.table("discrete", &spec.discrete, spec, Of::Bits(Access::Read));
        registers.input = self.table("input", &spec.input, spec, Of::Words(Access::Read));
        registers.holding = self.table("holding", &spec.holding, spec, Of::Words(Access::Write));
        registers.bytes = self.table("bytes", &spec.bytes, spec, Of::Bytes);
        let modbus = [
            &registers.coils,
            &registers.discrete,
            &registers.input,
            &registers.holding,
        ];
        let has_modbus = modbus.into_iter().any(|table| !table.is_empty());
        match protocol {
            Some(_) if !has_modbus => {
                self.wrong(
                    "registers",
                    "is empty, expected coils, discrete, input or holding",
                );
            }
            Some(_) if !registers.bytes.is_empty() => {
                let message = "Modbus has no table of bytes, expected holding or input";
                self.wrong("registers.bytes", message);
            }
            None if has_modbus => {
                let message = "these tables are Modbus', expected protocol = \"modbus-rtu\", or the \
                    table \"bytes\"";
                self.wrong("registers", message);
            }
            _ => {}
        }
        const KNOWN: [u8; 10] = [1, 2, 3, 4, 5, 6, 15, 16, 22, 23];
        for (index, function) in spec.functions.iter().enumerate() {
            if !KNOWN.contains(function) {
                let key = format!("registers.functions[{index}]");
                self.wrong(key, format!("is {function}, expected one of {KNOWN:?}"));
            }
        }
        Some(registers)
    }

    fn table(&mut self, name: &str, specs: &[RegisterSpec], all: &RegistersSpec, of: Of) -> Table {
        let unit = if matches!(of, Of::Words(_)) { 2 } else { 1 };
        let mut cells: Vec<(usize, Cell)> = Vec::new();
        for (index, spec) in specs.iter().enumerate() {
            let key = format!("registers.{name}[{index}]");
            let cell = self.cell(&key, spec, all, of);
            cells.push((index, cell));
        }
        cells.sort_by_key(|(_, cell)| cell.at);
        for pair in cells.windows(2) {
            let [(_, first), (index, second)] = pair else {
                continue;
            };
            if first.at.saturating_add(first.len) > second.at {
                let names = [first, second].map(|cell| self.variables[cell.variable].name.clone());
                let [first_name, second_name] = names;
                let last = first.at + first.len - 1;
                let message = format!(
                    "{} is taken: {first_name} has {} to {last}, expected another address for \
                     {second_name}",
                    second.at, first.at
                );
                self.wrong(format!("registers.{name}[{index}].at"), message);
            }
        }
        let cells = cells.into_iter().map(|(_, cell)| cell).collect();
        Table {
            cells,
            unit,
            has_gaps: all.gaps,
        }
    }

    fn cell(&mut self, key: &str, spec: &RegisterSpec, all: &RegistersSpec, of: Of) -> Cell {
        self.check_word(&format!("{key}.name"), &spec.name);
        if self.variable(&spec.name).is_some() {
            let message = format!("\"{}\" is taken, expected a name for each", spec.name);
            self.wrong(format!("{key}.name"), message);
        }
        let kind = self.cell_kind(key, spec, all, of);
        let len = match (of, kind) {
            (Of::Words(_), CellKind::Number(number)) => u32::from(number.bytes).div_ceil(2),
            (Of::Words(_), CellKind::Text(len)) => u32::try_from(len).unwrap_or(1).div_ceil(2),
            (_, CellKind::Number(number)) => number.bytes.into(),
            (_, CellKind::Text(len)) => u32::try_from(len).unwrap_or(1),
            (_, CellKind::Bit) => 1,
        };
        if !matches!(of, Of::Bytes) && u64::from(spec.at) + u64::from(len) > 0x1_0000 {
            let message = format!("is {}, expected 0 to {}", spec.at, 0x1_0000 - len);
            self.wrong(format!("{key}.at"), message);
        }
        let measured = spec.source.is_some() || spec.value.is_some();
        let usual = match of {
            Of::Bits(access) | Of::Words(access) => access,
            Of::Bytes => Access::Read,
        };
        let access = spec
            .access
            .unwrap_or(if measured { Access::Read } else { usual });
        if access == Access::Write && measured {
            let message = "can be written and has a source, expected one of them";
            self.wrong(format!("{key}.access"), message);
        }
        if access == Access::Write && usual == Access::Read && !matches!(of, Of::Bytes) {
            let message = "no function of Modbus writes this table, expected holding or coils";
            self.wrong(format!("{key}.access"), message);
        }
        let state = StateSpec {
            initial: spec.initial.clone(),
            unit: spec.unit.clone(),
            names: spec.names.clone(),
            limits: spec.limits,
            source: spec.source.clone(),
            value: spec.value.clone(),
            safe: spec.safe.clone(),
            keeps: spec.keeps,
            about: spec.about.clone(),
        };
        let mut variable = self.state_variable(key, &spec.name, &state);
        let is_text = matches!(kind, CellKind::Text(_));
        let initial_is_text = matches!(variable.initial, Value::Text(_));
        if is_text != initial_is_text && spec.initial.is_some() {
            let message = "does not fit the type, expected text for str and a number otherwise";
            self.wrong(format!("{key}.initial"), message);
        }
        if is_text && spec.initial.is_none() {
            variable.initial = Value::Text(String::new());
        }
        let scale = self.scale(key, spec.scale, spec.offset);
        let initial = variable.initial.clone();
        self.variables.push(variable);
        let cell = Cell {
            at: spec.at,
            len,
            variable: self.variables.len() - 1,
            kind,
            is_writable: access == Access::Write,
            scale,
            limits: None,
        };
        // A value that does not fit the type would be cut on the wire.
        let limits = spec.limits.iter().flatten();
        let limits = limits.map(|limit| ("limits", Value::Float(*limit)));
        let initial = spec.initial.is_some().then_some(("initial", initial));
        for (what, value) in limits.chain(initial) {
            if let Some(allowed) = cell.beyond(&value) {
                self.wrong(format!("{key}.{what}"), format!("is {value}, {allowed}"));
            }
        }
        Cell {
            limits: spec.limits,
            ..cell
        }
    }

    fn cell_kind(
        &mut self,
        key: &str,
        spec: &RegisterSpec,
        all: &RegistersSpec,
        of: Of,
    ) -> CellKind {
        if matches!(of, Of::Bits(_)) {
            if spec
                .kind
                .as_deref()
                .is_some_and(|kind| kind != "bool" && kind != "b1")
            {
                self.wrong(
                    format!("{key}.type"),
                    "the table holds bits, leave the type out",
                );
            }
            return CellKind::Bit;
        }
        let usual = if matches!(of, Of::Words(_)) {
            Endian::Big
        } else {
            Endian::Little
        };
        let endian = spec
            .endian
            .or(all.endian)
            .or(self.schema.endian)
            .unwrap_or(usual);
        let words = spec.words.or(all.words);
        let orders = Orders {
            endian: Some(endian),
            words,
        };
        let plain = if matches!(of, Of::Words(_)) {
            "u16"
        } else {
            "u8"
        };
        let name = spec.kind.as_deref().unwrap_or(plain);
        if name == "str" {
            let len = usize::from(spec.size.unwrap_or(0));
            if len == 0 || (matches!(of, Of::Words(_)) && len % 2 == 1) {
                let message = "expected the bytes of the text, an even number in registers";
                self.wrong(format!("{key}.size"), message);
            }
            return CellKind::Text(len.max(2));
        }
        match Number::named(name, orders) {
            Some(Ok(number)) => {
                if matches!(of, Of::Words(_)) && number.bytes % 2 == 1 {
                    let message =
                        format!("\"{name}\" fills no register, expected 16, 32 or 64 bits");
                    self.wrong(format!("{key}.type"), message);
                    return CellKind::Text(2);
                }
                CellKind::Number(number)
            }
            _ => {
                let message =
                    format!("there is no type \"{name}\", expected u16, i16, u32, f32, str ..");
                self.wrong(format!("{key}.type"), message);
                let (kind, bytes) = (NumberKind::Unsigned, 2);
                CellKind::Number(Number {
                    bytes,
                    kind,
                    endian,
                    words: endian,
                })
            }
        }
    }

    /// Compiles the expressions of computed variables, after all names are known.
    pub(super) fn computed(&mut self) {
        let schema = self.schema;
        let mut found: Vec<(String, &str, &str)> = Vec::new();
        for (name, Short(spec)) in &schema.state {
            if let Some(text) = &spec.value {
                found.push((format!("state.{name}.value"), name, text));
            }
        }
        if let Some(registers) = &schema.registers {
            let tables = [
                ("coils", &registers.coils),
                ("discrete", &registers.discrete),
                ("input", &registers.input),
                ("holding", &registers.holding),
                ("bytes", &registers.bytes),
            ];
            for (table, specs) in tables {
                for (index, spec) in specs.iter().enumerate() {
                    if let Some(text) = &spec.value {
                        let key = format!("registers.{table}[{index}].value");
                        found.push((key, &spec.name, text));
                    }
                }
            }
        }
        for (key, name, text) in &found {
            let expr = self.state_expr(key, text);
            if let Some(index) = self.variable(name) {
                self.variables[index].source = Source::Computed(expr);
            }
        }
        for (key, name, _) in &found {
            if self.is_circular(name) {
                self.wrong(
                    key,
                    format!("{name} is computed from itself, expected other variables"),
                );
            }
        }
    }

    /// An expression over the state.
    pub(super) fn state_expr(&mut self, key: &str, text: &str) -> Expr {
        let names: Vec<Arc<str>> = self
            .variables
            .iter()
            .map(|known| known.name.clone())
            .collect();
        let is_known = |name: &str| {
            let name = name.strip_prefix("state.").unwrap_or(name);
            names.iter().any(|known| **known == *name)
        };
        let listed = self.variable_names();
        self.expr(key, text, &is_known, &|| listed.clone())
    }

    fn is_circular(&self, name: &str) -> bool {
        let mut waiting = vec![name];
        let mut seen = vec![false; self.variables.len()];
        while let Some(next) = waiting.pop() {
            let Some(index) = self.variable(next) else {
                continue;
            };
            if let Source::Computed(expr) = &self.variables[index].source {
                for read in expr.names() {
                    let read = read.strip_prefix("state.").unwrap_or(read);
                    if read == name {
                        return true;
                    }
                    if let Some(place) = self.variable(read)
                        && !core::mem::replace(&mut seen[place], true)
                    {
                        waiting.push(read);
                    }
                }
            }
        }
        false
    }
}

/// The cells of a table, and their access by default.
#[derive(Clone, Copy)]
enum Of {
    Bits(Access),
    Words(Access),
    Bytes,
}
