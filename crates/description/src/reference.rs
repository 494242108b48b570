//! The reference page of a described device: its line, frames, messages, registers and behaviour.
//!
//! ```text
//! Description -> Page (headings, paragraphs, tables, frame diagrams) -> Markdown or HTML
//! ```

mod behaviour;
mod layout;
mod render;

use crate::description::{Description, Protocol};
use crate::expr::Expr;
use crate::field::{Field, Kind, Size};
use crate::message::{Layout, Message};
use crate::number::{Number, NumberKind};
use crate::registers::{Cell, CellKind, Table};
use crate::schema::message::From;
use crate::schema::wire::Endian;
use crate::state::Source;
use render::{Block, Page};

impl Description {
    /// The reference page in Markdown.
    pub fn markdown(&self) -> String {
        page(self).markdown()
    }

    /// The reference page as one HTML file that needs no other file.
    pub fn html(&self) -> String {
        page(self).html()
    }
}

fn page(of: &Description) -> Page {
    let mut page = Page::new(&of.name, &of.about);
    page.add(facts(of));
    for document in &of.documents {
        page.text(format!("Source: {document}."));
    }
    page.heading("Frames");
    layout::frames(of, &mut page);
    if !of.messages.is_empty() {
        page.heading("Messages");
        for message in &of.messages {
            self::message(of, message, &mut page);
        }
    }
    registers(of, &mut page);
    variables(of, &mut page);
    behaviour::tell(of, &mut page);
    page
}

/// A table of two columns with the properties of the whole device.
fn facts(of: &Description) -> Block {
    let mut rows = vec![(
        "Line",
        format!("{} baud, {}", of.line.baud, format_of(of.line)),
    )];
    if of.is_half_duplex {
        rows.push(("Direction", "half duplex".to_owned()));
    }
    if let Some(protocol) = of.protocol {
        let name = match protocol {
            Protocol::ModbusRtu => "Modbus RTU",
            Protocol::ModbusAscii => "Modbus ASCII",
        };
        rows.push(("Protocol", name.to_owned()));
    }
    if let Some(address) = of.address {
        rows.push(("Address", address.to_string()));
    }
    let time = |time: core::time::Duration| span::Span(time).to_string();
    let jitter = of.jitter.map_or_else(String::new, |most| {
        format!(" to {}", time(of.latency + most))
    });
    rows.push(("Latency of a reply", time(of.latency) + &jitter));
    if let Some(watchdog) = of.watchdog {
        rows.push(("Watchdog", time(watchdog)));
    }
    if let Some(boot) = of.boot {
        rows.push(("Start", format!("deaf for {}", time(boot))));
    }
    if of.echoes {
        rows.push(("Echo", "sends back each byte that it receives".to_owned()));
    }
    let rows = rows
        .into_iter()
        .map(|(key, value)| vec![key.to_owned(), value]);
    Block::table(&["Property", "Value"], rows.collect())
}

fn format_of(line: protocols::LineConfig) -> String {
    let parity = match line.parity {
        protocols::Parity::None => 'N',
        protocols::Parity::Even => 'E',
        protocols::Parity::Odd => 'O',
    };
    format!("{}{parity}{}", line.data_bits, line.stop_bits)
}

fn message(of: &Description, message: &Message, page: &mut Page) {
    let direction = match message.from {
        From::Host => "driver to device",
        From::Device => "device to driver",
        From::Both => "both directions",
    };
    page.heading_below(&format!("{} ({direction})", message.name));
    if !message.about.is_empty() {
        page.text(sentence(&message.about));
    }
    let frame = &of.frames.0[message.frame].name;
    if of.frames.0.len() > 1 {
        page.text(format!("Carried by frames of the format {frame}."));
    }
    match &message.layout {
        Layout::Fields(fields) => {
            page.add(Block::Diagram(layout::body(fields)));
            let mut rows = Vec::new();
            let mut at = Some(0);
            field_rows(fields, "", &mut at, &mut rows);
            page.add(field_table(rows));
        }
        Layout::Text { fields, .. } => {
            page.add(Block::Code(message.text().unwrap_or_default()));
            let mut rows = Vec::new();
            field_rows(fields, "", &mut None, &mut rows);
            for row in &mut rows {
                row[2].clear();
            }
            if !rows.is_empty() {
                page.add(field_table(rows));
            }
        }
    }
}

fn field_table(rows: Vec<Vec<String>>) -> Block {
    Block::table(&["Byte", "Field", "Type", "Value", "Meaning"], rows)
}

/// Table rows of fields; `at` is the bit offset of the next field while it is known.
fn field_rows(fields: &[Field], outer: &str, at: &mut Option<usize>, rows: &mut Vec<Vec<String>>) {
    for field in fields {
        let place = match *at {
            Some(bits) if bits % 8 == 0 => (bits / 8).to_string(),
            Some(bits) => format!("{}.{}", bits / 8, bits % 8),
            None => String::new(),
        };
        let name = format!("{outer}{}", field.name);
        let mut about = vec![field.about.clone()];
        if let Some(condition) = &field.condition {
            about.push(format!("only if {}", condition.source()));
        }
        if field.is_optional {
            about.push("may be missing".to_owned());
        }
        if let Some(counted) = &field.counts {
            about.push(format!("size or count of {counted}"));
        }
        rows.push(vec![
            place,
            name.clone(),
            type_of(field),
            value_of(field),
            joined(about),
        ]);
        match &field.kind {
            Kind::Group(inner) => {
                let inner_at = if field.repeat.is_none() { *at } else { None };
                field_rows(inner, &format!("{name}."), &mut inner_at.clone(), rows);
            }
            Kind::Switch { cases, other, .. } => {
                for (value, inner) in cases {
                    rows.push(note(format!("case {value}")));
                    field_rows(inner, outer, &mut at.clone(), rows);
                }
                if let Some(inner) = other {
                    rows.push(note("any other case".to_owned()));
                    field_rows(inner, outer, &mut at.clone(), rows);
                }
            }
            _ => {}
        }
        *at = match (*at, layout::bits(field)) {
            (Some(at), Some(bits)) if field.condition.is_none() => Some(at + bits),
            _ => None,
        };
    }
}

fn note(text: String) -> Vec<String> {
    vec![
        String::new(),
        text,
        String::new(),
        String::new(),
        String::new(),
    ]
}

/// Joins the non-empty parts with separators.
fn joined(parts: Vec<String>) -> String {
    let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    parts.join("; ")
}

/// A text as a sentence.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters
        .next()
        .map(|first| first.to_uppercase().collect::<String>());
    let end = if text.ends_with('.') { "" } else { "." };
    format!("{}{}{end}", first.unwrap_or_default(), letters.as_str())
}

pub(crate) fn number_name(number: Number) -> String {
    let letter = match number.kind {
        NumberKind::Unsigned => 'u',
        NumberKind::Signed => 'i',
        NumberKind::Float => 'f',
    };
    let bits = 8 * u32::from(number.bytes);
    let order = match (number.bytes, number.endian) {
        (1, _) => "",
        (_, Endian::Little) => "le",
        (_, Endian::Big) => "be",
    };
    let words = match number.words == number.endian || number.bytes < 3 {
        true => "",
        false if number.words == Endian::Little => ", low word first",
        false => ", high word first",
    };
    format!("{letter}{bits}{order}{words}")
}

fn size_of(size: &Size) -> String {
    match size {
        Size::Fixed(1) => "1 byte".to_owned(),
        Size::Fixed(size) => format!("{size} bytes"),
        Size::Computed(expr) => format!("{} bytes", expr.source()),
        Size::Rest => "all the rest".to_owned(),
    }
}

fn type_of(field: &Field) -> String {
    let kind = match &field.kind {
        Kind::Number(number) => number_name(*number),
        Kind::Bits { bits: 1, .. } => "1 bit".to_owned(),
        Kind::Bits { bits, is_low_first } => {
            let order = if *is_low_first { ", lowest first" } else { "" };
            format!("{bits} bits{order}")
        }
        Kind::Bcd { size, is_low_first } => {
            let order = if *is_low_first { ", lowest first" } else { "" };
            format!("BCD, {}{order}", size_of(size))
        }
        Kind::Decimal(size) => format!("decimal digits, {}", size_of(size)),
        Kind::Hex(size) => format!("hexadecimal digits, {}", size_of(size)),
        Kind::Str(size) => format!("text, {}", size_of(size)),
        Kind::StrZ => "text that ends with a 0".to_owned(),
        Kind::Bytes(size) => format!("bytes, {}", size_of(size)),
        Kind::Prefixed { prefix, is_text } => {
            let what = if *is_text { "text" } else { "bytes" };
            format!("{what} behind its length ({})", number_name(*prefix))
        }
        Kind::Pad(size) => format!("padding, {}", size_of(size)),
        Kind::Group(_) => "group".to_owned(),
        Kind::Switch { on, .. } => format!("by {}", on.source()),
    };
    match &field.repeat {
        None => kind,
        Some(Size::Fixed(count)) => format!("{count} times {kind}"),
        Some(Size::Computed(expr)) => format!("{} times {kind}", expr.source()),
        Some(Size::Rest) => format!("{kind}, until the end"),
    }
}

fn value_of(field: &Field) -> String {
    let mut parts = Vec::new();
    if let Some(constant) = &field.constant {
        parts.push(match (&field.kind, constant.as_int()) {
            (Kind::Number(_), Some(int)) if field.scale.is_none() && field.names.is_none() => {
                format!("always {int} ({int:#04x})")
            }
            _ => format!("always {}", field.words(constant)),
        });
    }
    if let Some(calc) = &field.calc {
        parts.push(format!("= {}", calc.source()));
    }
    parts.extend(scale_of(field.scale, &field.unit));
    parts.extend(
        field
            .limits
            .map(|[least, most]| format!("{least} to {most}")),
    );
    if let Some(names) = &field.names {
        let names: Vec<_> = names
            .iter()
            .map(|(at, name)| format!("{at} {name}"))
            .collect();
        parts.push(names.join(", "));
    }
    let flags = field
        .flags
        .iter()
        .enumerate()
        .filter(|(_, name)| !name.is_empty());
    let flags: Vec<_> = flags
        .map(|(bit, name)| format!("bit {bit} {name}"))
        .collect();
    parts.push(flags.join(", "));
    joined(parts)
}

/// Text for scale and unit.
fn scale_of(scale: Option<[f64; 2]>, unit: &str) -> Option<String> {
    let unit = if unit.is_empty() { "" } else { unit };
    match scale {
        None => (!unit.is_empty()).then(|| unit.to_owned()),
        Some([scale, offset]) => {
            let offset = match offset {
                0.0 => String::new(),
                offset => format!(" {offset:+}"),
            };
            let space = if unit.is_empty() { "" } else { " " };
            Some(format!("count * {scale}{offset}{space}{unit}"))
        }
    }
}

fn registers(of: &Description, page: &mut Page) {
    let Some(all) = &of.registers else { return };
    let tables: [(&str, &Table); 5] = [
        ("Coils", &all.coils),
        ("Discrete inputs", &all.discrete),
        ("Input registers", &all.input),
        ("Holding registers", &all.holding),
        ("Registers", &all.bytes),
    ];
    for (title, table) in tables.into_iter().filter(|(_, table)| !table.is_empty()) {
        page.heading(title);
        let rows = table.cells.iter().map(|cell| register_row(of, cell));
        let heads = ["Address", "Name", "Type", "Access", "Value", "Meaning"];
        page.add(Block::table(&heads, rows.collect()));
        if table.has_gaps {
            page.text("Addresses without a register read 0 and ignore writes.");
        }
    }
}

fn register_row(of: &Description, cell: &Cell) -> Vec<String> {
    let variable = &of.variables[cell.variable];
    let last = cell.at + cell.len.max(1) - 1;
    let place = if last == cell.at {
        cell.at.to_string()
    } else {
        format!("{} to {last}", cell.at)
    };
    let kind = match cell.kind {
        CellKind::Bit => "bit".to_owned(),
        CellKind::Number(number) => number_name(number),
        CellKind::Text(len) => format!("text, {len} bytes"),
    };
    let access = if cell.is_writable {
        "read, write"
    } else {
        "read"
    };
    let mut value: Vec<String> = scale_of(cell.scale, &variable.unit).into_iter().collect();
    value.extend(
        cell.limits
            .map(|[least, most]| format!("{least} to {most}")),
    );
    if let Some(names) = &variable.names {
        value.extend(names.iter().map(|(at, name)| format!("{at} {name}")));
    }
    let meaning = joined(vec![variable.about.clone(), source_of(&variable.source)]);
    vec![
        place,
        variable.name.to_string(),
        kind,
        access.to_owned(),
        joined(value),
        meaning,
    ]
}

fn variables(of: &Description, page: &mut Page) {
    let in_table = |index: usize| {
        of.registers
            .as_ref()
            .is_some_and(|all| all.address_of(index).is_some())
    };
    let own = of
        .variables
        .iter()
        .enumerate()
        .filter(|(index, _)| !in_table(*index));
    let rows: Vec<_> = own
        .map(|(_, variable)| {
            let limits = variable
                .limits
                .map(|[least, most]| format!("{least} to {most}"));
            let safe = variable
                .safe
                .as_ref()
                .map(|safe| format!("{safe} after the watchdog time"));
            let keeps = if variable.keeps {
                "survives a restart"
            } else {
                ""
            };
            let meaning = [
                variable.about.clone(),
                source_of(&variable.source),
                safe.unwrap_or_default(),
                keeps.to_owned(),
            ];
            vec![
                variable.name.to_string(),
                variable.words(&variable.initial),
                limits.unwrap_or_default(),
                joined(meaning.into()),
            ]
        })
        .collect();
    if !rows.is_empty() {
        page.heading("State of the emulated device");
        page.add(Block::table(
            &["Variable", "Initial", "Limits", "Meaning"],
            rows,
        ));
    }
}

fn source_of(source: &Source) -> String {
    let time = |time: &core::time::Duration| span::Span(*time).to_string();
    match source {
        Source::Stored => String::new(),
        Source::Counter(period) => format!("counts one up each {}", time(period)),
        Source::Ramp { from, to, period } => {
            format!("ramp from {from} to {to} in {}", time(period))
        }
        Source::Sine {
            mean,
            amplitude,
            period,
        } => {
            format!("sine of {amplitude} around {mean}, period {}", time(period))
        }
        Source::Noise {
            mean, deviation, ..
        } => {
            format!("noise around {mean}, standard deviation {deviation}")
        }
        Source::Recorded { .. } => "from a recording".to_owned(),
        Source::World(quantity) => format!("of the simulated world: {quantity:?}"),
        Source::Computed(expr) => computed(expr),
    }
}

fn computed(expr: &Expr) -> String {
    format!("= {}", expr.source())
}
