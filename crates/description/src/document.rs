//! The reference page of a described device, in Markdown.

use core::fmt::Write as _;

use crate::description::{Description, Protocol};
use crate::field::{Field, Kind, Size};
use crate::framing::Cut;
use crate::message::{Layout, Message};
use crate::number::{Number, NumberKind};
use crate::pattern::Piece;
use crate::registers::{CellKind, Table};
use crate::schema::message::From;
use crate::schema::wire::{Endian, Stuffing};

impl Description {
    /// The reference page: line, frames, messages with all their fields, registers, variables,
    /// faults.
    pub fn reference(&self) -> String {
        let mut page = format!("# {}\n\n{}.\n", self.name, self.about.trim_end_matches('.'));
        let line = self.line;
        let parity = match line.parity {
            protocols::Parity::None => 'N',
            protocols::Parity::Even => 'E',
            protocols::Parity::Odd => 'O',
        };
        let _ = write!(
            page,
            "\nLine: {} bit/s, {}{parity}{}{}.\n",
            line.baud,
            line.data_bits,
            line.stop_bits,
            if self.is_half_duplex {
                ", half duplex"
            } else {
                ""
            }
        );
        if !self.documents.is_empty() {
            let _ = write!(page, "\nWritten from: {}.\n", self.documents.join("; "));
        }
        self.frames_page(&mut page);
        for message in &self.messages {
            message_page(message, &mut page);
        }
        self.registers_page(&mut page);
        self.state_page(&mut page);
        page += "\n## Faults\n\n| fault | is |\n|---|---|\n";
        for (name, about) in self.faults() {
            let _ = writeln!(page, "| `{name}` | {} |", cell(about));
        }
        page
    }

    fn frames_page(&self, page: &mut String) {
        *page += "\n## Frames\n\n";
        match self.protocol {
            Some(Protocol::ModbusRtu) => *page += "Modbus RTU: a silence ends a frame; CRC-16.\n",
            Some(Protocol::ModbusAscii) => *page += "Modbus ASCII: `:`, digits, LRC, CR LF.\n",
            None => {
                for framing in self.frames.0.iter() {
                    let name = match framing.name.as_str() {
                        "" => "All".to_owned(),
                        name => format!("`{name}`"),
                    };
                    let how = match &framing.cut {
                        Cut::Marked {
                            start,
                            end,
                            stuffing,
                            ..
                        } => match stuffing {
                            Stuffing::None if start.is_empty() => format!("ends with {end:02X?}"),
                            Stuffing::None => format!("from {start:02X?} to {end:02X?}"),
                            stuffing => format!("{stuffing:?}, ends with {end:02X?}"),
                        },
                        Cut::Length(length) => format!(
                            "begins with {:02X?}, length at byte {}",
                            framing.sync, length.at
                        ),
                        Cut::Fixed(size) => format!("{size} bytes"),
                        Cut::Sized { size, .. } => format!("`{}` bytes", size.source()),
                        Cut::Table { at, .. } => format!("length by byte {at}"),
                        Cut::Silence { .. } => "ends with a silence".to_owned(),
                    };
                    let sums = framing.checks.len();
                    let _ = writeln!(page, "- {name}: {how}; checksums: {sums}");
                }
            }
        }
    }

    fn registers_page(&self, page: &mut String) {
        let Some(registers) = &self.registers else {
            return;
        };
        let tables: [(&str, &Table); 5] = [
            ("Coils", &registers.coils),
            ("Discrete inputs", &registers.discrete),
            ("Input registers", &registers.input),
            ("Holding registers", &registers.holding),
            ("Registers", &registers.bytes),
        ];
        for (name, table) in tables.iter().filter(|(_, table)| !table.is_empty()) {
            let _ = write!(
                page,
                "\n## {name}\n\n| address | name | type | access | unit | limits | is |\n\
                 |---|---|---|---|---|---|---|\n"
            );
            for register in &table.cells {
                let variable = &self.variables[register.variable];
                let kind = match register.kind {
                    CellKind::Bit => "bit".to_owned(),
                    CellKind::Number(number) => number_name(number),
                    CellKind::Text(len) => format!("text of {len}"),
                };
                let access = if register.is_writable {
                    "read, write"
                } else {
                    "read"
                };
                let _ = writeln!(
                    page,
                    "| {} | `{}` | {kind}{} | {access} | {} | {} | {} |",
                    register.at,
                    variable.name,
                    scale(register.scale),
                    cell(&variable.unit),
                    limits(register.limits),
                    cell(&variable.about),
                );
            }
        }
    }

    fn state_page(&self, page: &mut String) {
        let of_register = |index: usize| {
            let registers = self.registers.as_ref();
            registers.is_some_and(|all| all.address_of(index).is_some())
        };
        let own = self.variables.iter().enumerate();
        let own: Vec<_> = own.filter(|(index, _)| !of_register(*index)).collect();
        if own.is_empty() {
            return;
        }
        *page += "\n## Variables\n\n| name | at the start | unit | limits | is |\n|---|---|---|---|---|\n";
        for (_, variable) in own {
            let _ = writeln!(
                page,
                "| `{}` | {} | {} | {} | {} |",
                variable.name,
                cell(&variable.initial.to_string()),
                cell(&variable.unit),
                limits(variable.limits),
                cell(&variable.about),
            );
        }
    }
}

fn message_page(message: &Message, page: &mut String) {
    let from = match message.from() {
        From::Host => "from the host",
        From::Device => "from the device",
        From::Both => "from both ends",
    };
    let _ = write!(page, "\n## `{}`, {from}\n", message.name());
    if !message.about().is_empty() {
        let _ = write!(page, "\n{}.\n", message.about().trim_end_matches('.'));
    }
    if let Layout::Text { pieces, .. } = &message.layout {
        let text: String = pieces.iter().map(piece_text).collect();
        let _ = write!(page, "\n```text\n{text}\n```\n");
    }
    let fields = message.fields();
    if fields.is_empty() {
        return;
    }
    *page += "\n| byte | field | type | unit | limits | is |\n|---|---|---|---|---|---|\n";
    fields_page(fields, &mut Some(0), "", page);
}

fn piece_text(piece: &Piece) -> String {
    match piece {
        Piece::Words(words) => words.clone(),
        Piece::Hole(hole) => format!("{{{}}}", hole.name),
    }
}

/// Table rows of fields; `bit` is the offset of the next field while it is fixed.
fn fields_page(fields: &[Field], bit: &mut Option<usize>, outer: &str, page: &mut String) {
    for field in fields {
        let at = bit.map_or_else(
            || "..".to_owned(),
            |bit| match bit % 8 {
                0 => (bit / 8).to_string(),
                rest => format!("{}.{rest}", bit / 8),
            },
        );
        let name = match (&*field.name, &field.constant) {
            ("", Some(constant)) => format!("{constant}"),
            ("", None) => "-".to_owned(),
            (name, Some(constant)) => format!("`{outer}{name}` = {constant}"),
            (name, None) => format!("`{outer}{name}`"),
        };
        let times = match &field.repeat {
            None => String::new(),
            Some(size) => format!(", {} times", size_name(size)),
        };
        let optional = if field.is_optional {
            ", may be missing"
        } else {
            ""
        };
        let _ = writeln!(
            page,
            "| {at} | {name} | {}{}{times}{optional} | {} | {} | {} |",
            kind_name(&field.kind),
            scale(field.scale),
            cell(&field.unit),
            limits(field.limits),
            cell(&field.about),
        );
        let is_plain = field.condition.is_none() && !field.is_optional;
        *bit = bit
            .zip(bits_of(field).filter(|_| is_plain))
            .map(|(bit, len)| bit + len);
        match &field.kind {
            Kind::Group(inner) => {
                fields_page(inner, &mut None, &format!("{outer}{}.", field.name), page);
            }
            Kind::Switch { cases, other, .. } => {
                for (_, inner) in cases {
                    fields_page(inner, &mut None, outer, page);
                }
                fields_page(other.as_deref().unwrap_or_default(), &mut None, outer, page);
            }
            _ => {}
        }
    }
}

/// Bits of a field of fixed size.
fn bits_of(field: &Field) -> Option<usize> {
    let fixed = |size: &Size| match size {
        Size::Fixed(size) => Some(8 * size),
        _ => None,
    };
    let one = match &field.kind {
        Kind::Number(number) => 8 * usize::from(number.bytes),
        Kind::Bits { bits, .. } => usize::from(*bits),
        Kind::Bcd { size, .. } | Kind::Decimal(size) | Kind::Hex(size) => fixed(size)?,
        Kind::Str(size) | Kind::Bytes(size) | Kind::Pad(size) => fixed(size)?,
        Kind::Group(fields) => fields.iter().map(bits_of).sum::<Option<usize>>()?,
        Kind::StrZ | Kind::Prefixed { .. } | Kind::Switch { .. } => return None,
    };
    match &field.repeat {
        None => Some(one),
        Some(Size::Fixed(count)) => Some(one * count),
        Some(_) => None,
    }
}

fn number_name(number: Number) -> String {
    let kind = match number.kind {
        NumberKind::Unsigned => 'u',
        NumberKind::Signed => 'i',
        NumberKind::Float => 'f',
    };
    let order = match (number.bytes, number.endian) {
        (1, _) => "",
        (_, Endian::Little) => "le",
        (_, Endian::Big) => "be",
    };
    let words = match number.bytes > 2 && number.words != number.endian {
        true => ", other order of words",
        false => "",
    };
    format!("{kind}{}{order}{words}", 8 * u32::from(number.bytes))
}

fn size_name(size: &Size) -> String {
    match size {
        Size::Fixed(size) => size.to_string(),
        Size::Computed(expr) => format!("`{}`", cell(expr.source())),
        Size::Rest => "all the rest".to_owned(),
    }
}

fn kind_name(kind: &Kind) -> String {
    match kind {
        Kind::Number(number) => number_name(*number),
        Kind::Bits { bits: 1, .. } => "bit".to_owned(),
        Kind::Bits { bits, .. } => format!("{bits} bits"),
        Kind::Bcd { size, is_low_first } => {
            let order = if *is_low_first { ", lowest first" } else { "" };
            format!("BCD, bytes: {}{order}", size_name(size))
        }
        Kind::Decimal(size) => format!("decimal digits: {}", size_name(size)),
        Kind::Hex(size) => format!("hexadecimal digits: {}", size_name(size)),
        Kind::Str(size) => format!("text, bytes: {}", size_name(size)),
        Kind::StrZ => "text that ends with 0".to_owned(),
        Kind::Bytes(size) => format!("bytes: {}", size_name(size)),
        Kind::Prefixed { prefix, is_text } => {
            let what = if *is_text { "text" } else { "bytes" };
            format!("{what} behind their length, {}", number_name(*prefix))
        }
        Kind::Pad(size) => format!("padding, bytes: {}", size_name(size)),
        Kind::Group(_) => "group".to_owned(),
        Kind::Switch { on, .. } => format!("by `{}`", cell(on.source())),
    }
}

fn scale(scale: Option<[f64; 2]>) -> String {
    match scale {
        None => String::new(),
        Some([scale, 0.0]) => format!(" * {scale}"),
        Some([scale, offset]) => format!(" * {scale} + {offset}"),
    }
}

fn limits(limits: Option<[f64; 2]>) -> String {
    limits.map_or_else(String::new, |[least, most]| format!("{least} to {most}"))
}

/// Escapes text for a table cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}
