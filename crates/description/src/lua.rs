//! A description in Lua, for Wireshark's dissector: tables that `described.lua` interprets as the
//! tool interprets the description.

use core::fmt::Write as _;
use std::collections::BTreeMap;

use crate::description::Description;
use crate::field::{Field, Kind, Size};
use crate::framing::{Check, Cut, Framing};
use crate::message::{Layout, Message};
use crate::number::{Number, NumberKind};
use crate::pattern::{Form, Hole, Piece};
use crate::schema::message::From;
use crate::schema::wire::Stuffing;
use crate::value::Value;

/// The interpreter of the tables; it uses the table `f` of fields and defines the local table `D`.
pub const RUNTIME: &str = include_str!("lua/described.lua");

/// The parts of a dissector for one description.
#[derive(Clone, Debug)]
pub struct LuaPart {
    /// Fields that display filters can use.
    pub fields: Vec<LuaField>,
    /// An expression that gives the row of this description in the table of formats.
    pub row: String,
}

/// A field of the dissector.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LuaField {
    /// Name in the table `f`.
    pub key: String,
    /// Type of the field: `double`, `int64`, `uint64` or `string`.
    pub kind: &'static str,
    /// Name in display filters.
    pub filter: String,
    /// Label in the packet tree.
    pub label: String,
}

const TAKES_ALL: &str = "a string takes everything";

/// Bytes as a Lua string.
pub(crate) fn quoted(bytes: &[u8]) -> String {
    let mut out = String::from("\"");
    for &byte in bytes {
        match byte {
            b'"' | b'\\' => out.extend(['\\', char::from(byte)]),
            b' '..=b'~' => out.push(char::from(byte)),
            byte => write!(out, "\\{byte:03}").expect(TAKES_ALL),
        }
    }
    out + "\""
}

/// A plain value as Lua.
pub(crate) fn literal(value: &Value) -> String {
    match value {
        Value::Bool(yes) => u8::from(*yes).to_string(),
        Value::Int(int) if int.unsigned_abs() < 1 << 53 => int.to_string(),
        Value::Int(int) => format!("{{ v = {int}.0, text = \"{int}\", hi = 0, lo = 0 }}"),
        Value::Float(float) => format!("{float:?}"),
        Value::Text(text) => {
            let byte = |c: char| u8::try_from(u32::from(c)).unwrap_or(b'?');
            quoted(&text.chars().map(byte).collect::<Vec<_>>())
        }
        Value::Bytes(bytes) => format!("{{ bytes = {} }}", quoted(bytes)),
        Value::List(list) => {
            let all: Vec<_> = list.iter().map(literal).collect();
            format!("{{ list = {{ {} }} }}", all.join(", "))
        }
        Value::Record(_) => "{ record = {} }".to_owned(),
    }
}

impl Description {
    /// The end that sends frames of this format, as Lua; `nil` if both ends do.
    fn sender(&self, format: usize) -> &'static str {
        let sent = |from| self.frames_of(from).looks_for(format);
        match (sent(From::Host), sent(From::Device)) {
            (true, false) => "\"host\"",
            (false, true) => "\"device\"",
            _ => "nil",
        }
    }

    /// The dissector part of this description; `name` must be unique within one file.
    pub fn lua(&self, name: &str) -> LuaPart {
        let plain = |c: char| match c {
            'a'..='z' | '0'..='9' | '_' => c,
            'A'..='Z' => c.to_ascii_lowercase(),
            _ => '_',
        };
        let own: String = name.chars().map(plain).collect();
        let mut writer = Writer {
            own,
            label: name,
            fields: BTreeMap::new(),
        };
        for message in &self.messages {
            writer.collect(message);
        }
        let frames: String = self
            .frames
            .0
            .iter()
            .enumerate()
            .map(|(index, framing)| frame(framing, self.sender(index)))
            .collect();
        let messages: String = self
            .messages
            .iter()
            .map(|one| writer.message(one))
            .collect();
        let is_modbus = self.protocol.is_some();
        let idle = self.idle().as_secs_f64();
        let row = format!(
            "D.row({{ name = {}, idle = {idle:?}, share = 50, is_modbus = {is_modbus},\n\
             frames = {{\n{frames}}},\nmessages = {{\n{messages}}} }})",
            quoted(name.as_bytes()),
        );
        LuaPart {
            fields: writer.fields.into_values().collect(),
            row,
        }
    }
}

fn number(number: Number) -> String {
    let bytes: Vec<u8> = (1..=number.bytes).collect();
    let order = number.bits(&bytes).to_be_bytes();
    let order = &order[8 - usize::from(number.bytes)..];
    let order: Vec<_> = order.iter().map(u8::to_string).collect();
    let kind = match number.kind {
        NumberKind::Unsigned => "u",
        NumberKind::Signed => "i",
        NumberKind::Float => "f",
    };
    let (bytes, order) = (number.bytes, order.join(", "));
    format!("{{ bytes = {bytes}, order = {{ {order} }}, kind = \"{kind}\" }}")
}

fn frame(framing: &Framing, sender: &str) -> String {
    let holes = framing
        .holes
        .iter()
        .map(|(at, len)| format!("{{ {at}, {len} }}, "));
    let checks: String = framing.checks.iter().map(check).collect();
    let (least, max, trailer) = (framing.least(), framing.max, framing.trailer);
    format!(
        "{{ {}, least = {least}, max = {max}, trailer = {trailer}, sync = {}, last = {}, \
         is_hex = {}, is_modbus = {}, has_blank = {}, from = {sender},\n\
         holes = {{ {}}}, checks = {{ {checks}}} }},\n",
        cut(&framing.cut) + &framing.shared_in_lua(),
        quoted(&framing.sync),
        quoted(&framing.end),
        framing.is_hex,
        matches!(framing.cut, Cut::Silence { lengths: Some(_) }),
        framing.has_blank,
        holes.collect::<String>(),
    )
}

fn cut(cut: &Cut) -> String {
    match cut {
        Cut::Marked {
            start,
            end,
            stuffing,
            tail,
        } => {
            let stuffing = match stuffing {
                Stuffing::None => "none",
                Stuffing::Slip => "slip",
                Stuffing::Hdlc => "hdlc",
                Stuffing::Cobs => "cobs",
                Stuffing::Dle => "dle",
            };
            let (start, end) = (quoted(start), quoted(end));
            format!(
                "cut = \"marked\", start = {start}, finish = {end}, stuffing = \"{stuffing}\", \
                 tail = {tail}"
            )
        }
        Cut::Length(length) => {
            let (at, bytes) = (length.at, length.number.bytes);
            let field = format!("s:sub({}, {})", at + 1, at + usize::from(bytes));
            let shift = 1_u64 << length.mask.trailing_zeros();
            let (unit, base) = (length.unit, length.base);
            let again = length
                .again
                .map_or_else(|| "nil".to_owned(), |at| at.to_string());
            let all = u64::MAX >> (64 - 8 * u32::from(bytes));
            let number = number(length.number);
            let value = match length.mask {
                mask if mask == all => "v".to_owned(),
                mask => format!("D.op.band(v, {mask}) / {shift}"),
            };
            format!(
                "cut = \"length\", length = {{ at = {at}, again = {again}, number = {number}, of = \
                 function(s)\n\
                 local v = D.number({number}, {field})\nreturn {value} * {unit} + ({base}) end }}"
            )
        }
        Cut::Fixed(size) => format!("cut = \"fixed\", size = {size}"),
        Cut::Sized { head, size } => format!(
            "cut = \"sized\", head = {head}, of = function(head)\nlocal s = {{ {{}} }}\n\
             for i = 1, #head do s[1][i] = {{ \"b\" .. (i - 1), head:byte(i) }} end\n\
             return {} end",
            size.expr().lua()
        ),
        Cut::Table { at, sizes } => {
            let sizes = sizes.iter().enumerate().filter(|(_, size)| **size > 0);
            let sizes: String = sizes
                .map(|(byte, size)| format!("[{byte}] = {size}, "))
                .collect();
            format!("cut = \"table\", at = {at}, sizes = {{ {sizes}}}")
        }
        Cut::Silence { .. } => "cut = \"silence\"".to_owned(),
    }
}

fn check(check: &Check) -> String {
    let to = check
        .to
        .map_or_else(|| "nil".to_owned(), |to| to.to_string());
    format!(
        "{{ at = {}, from = {}, to = {to}, width = {}, len = {}, is_little = {}, is_hex = {}, \
         separator = {}, before = {}, extra = {}, sum = {} }}, ",
        check.at,
        check.from,
        check.width,
        check.value_len(),
        check.is_little,
        check.is_hex,
        quoted(&check.separator),
        quoted(&check.before),
        quoted(&check.extra),
        check.algorithm.lua(),
    )
}

fn size(size: &Size) -> String {
    match size {
        Size::Fixed(size) => size.to_string(),
        Size::Computed(expr) => format!("function(s) return {} end", expr.lua()),
        Size::Rest => "\"rest\"".to_owned(),
    }
}

/// The best display type of a field.
fn shown(field: &Field) -> &'static str {
    if field.scale.is_some() {
        return "double";
    }
    match &field.kind {
        Kind::Number(number) => match number.kind {
            NumberKind::Float => "double",
            NumberKind::Unsigned if number.bytes == 8 => "uint64",
            _ => "int64",
        },
        Kind::Bits { bits: 64, .. } => "uint64",
        Kind::Bits { .. } => "int64",
        // These can have more digits than 64 bits can hold.
        Kind::Bcd {
            size: Size::Fixed(..9),
            ..
        }
        | Kind::Decimal(Size::Fixed(..16)) => "int64",
        Kind::Hex(Size::Fixed(..8)) => "int64",
        _ => "string",
    }
}

const fn hole_shown(hole: &Hole) -> &'static str {
    match hole.form {
        Form::Text => "string",
        _ => "double",
    }
}

/// The common display type of two fields.
fn either(a: &'static str, b: &'static str) -> &'static str {
    match (a, b) {
        (a, b) if a == b => a,
        ("string", _) | (_, "string") => "string",
        _ => "double",
    }
}

struct Writer<'a> {
    own: String,
    label: &'a str,
    /// Fields by path: messages share fields of the same name.
    fields: BTreeMap<String, LuaField>,
}

impl Writer<'_> {
    fn collect(&mut self, message: &Message) {
        match &message.layout {
            Layout::Fields(fields) => self.collect_fields("", fields),
            Layout::Text { pieces, .. } => {
                for piece in pieces {
                    if let Piece::Hole(hole) = piece {
                        self.note(&hole.name, hole_shown(hole));
                    }
                }
            }
        }
    }

    fn collect_fields(&mut self, outer: &str, fields: &[Field]) {
        for field in fields {
            let path = path(outer, &field.name);
            match &field.kind {
                Kind::Group(inner) => self.collect_fields(&path, inner),
                Kind::Switch { cases, other, .. } => {
                    for (_, inner) in cases {
                        self.collect_fields(outer, inner);
                    }
                    self.collect_fields(outer, other.as_deref().unwrap_or_default());
                }
                Kind::Pad(_) => {}
                _ if field.name.is_empty() => {}
                _ => self.note(&path, shown(field)),
            }
        }
    }

    fn note(&mut self, path: &str, kind: &'static str) {
        let (own, label) = (&self.own, self.label);
        let plain = path.to_ascii_lowercase();
        let entry = self
            .fields
            .entry(path.to_owned())
            .or_insert_with(|| LuaField {
                key: format!("d_{own}_{}", path.replace('.', "__")),
                kind,
                filter: format!("hilrig.{own}.{plain}"),
                label: format!("{label} {path}"),
            });
        entry.kind = either(entry.kind, kind);
    }

    fn message(&self, message: &Message) -> String {
        let what = match &message.layout {
            Layout::Fields(fields) => format!("fields = {}", self.fields("", fields)),
            Layout::Text { pieces, fields } => {
                let pieces = pieces.iter().map(|piece| match piece {
                    Piece::Words(words) => format!("{}, ", literal(&Value::Text(words.clone()))),
                    Piece::Hole(hole) => {
                        let field = fields.iter().find(|field| *field.name == hole.name);
                        self.hole(hole, field)
                    }
                });
                format!("pieces = {{ {}}}", pieces.collect::<String>())
            }
        };
        let (name, frame) = (quoted(message.name.as_bytes()), message.frame + 1);
        let from = match message.from {
            From::Host => "\"host\"",
            From::Device => "\"device\"",
            From::Both => "nil",
        };
        format!("{{ name = {name}, frame = {frame}, from = {from}, {what} }},\n")
    }

    fn hole(&self, hole: &Hole, field: Option<&Field>) -> String {
        let form = match hole.form {
            Form::Plain => "plain",
            Form::Decimal => "decimal",
            Form::Fixed => "fixed",
            Form::Hex | Form::SmallHex => "hex",
            Form::Text => "text",
        };
        let fixed = hole
            .fixed_width()
            .map_or_else(|| "nil".to_owned(), |width| width.to_string());
        let common = field.map(common).unwrap_or_default();
        format!(
            "\n{{ name = {}, form = \"{form}\", width = {}, fixed = {fixed}, is_optional = {}, \
             {common}{}}}, ",
            quoted(hole.name.as_bytes()),
            hole.width,
            hole.is_optional,
            self.shown(&hole.name),
        )
    }

    fn shown(&self, path: &str) -> String {
        let field = self.fields.get(path);
        field.map_or_else(String::new, |field| {
            format!("show = \"{}\", key = \"{}\" ", field.kind, field.key)
        })
    }

    fn fields(&self, outer: &str, fields: &[Field]) -> String {
        let all: String = fields
            .iter()
            .map(|field| self.field(outer, field))
            .collect();
        format!("{{ {all}}}")
    }

    fn field(&self, outer: &str, field: &Field) -> String {
        let path = path(outer, &field.name);
        let sized = |kind: &str, of: &Size| format!("type = \"{kind}\", size = {}", size(of));
        let kind = match &field.kind {
            Kind::Number(of) => format!("type = \"number\", number = {}", number(*of)),
            Kind::Bits { bits, is_low_first } => {
                format!("type = \"bits\", bits = {bits}, is_low_first = {is_low_first}")
            }
            Kind::Bcd { size, is_low_first } => {
                format!("{}, is_low_first = {is_low_first}", sized("bcd", size))
            }
            Kind::Decimal(of) => sized("decimal", of),
            Kind::Hex(of) => sized("hex", of),
            Kind::Str(of) => {
                let is_padded = matches!(of, Size::Fixed(_));
                format!("{}, is_padded = {is_padded}", sized("str", of))
            }
            Kind::StrZ => "type = \"strz\"".to_owned(),
            Kind::Bytes(of) => sized("bytes", of),
            Kind::Pad(of) => sized("pad", of),
            Kind::Prefixed { prefix, is_text } => format!(
                "type = \"prefixed\", number = {}, is_text = {is_text}",
                number(*prefix)
            ),
            Kind::Group(inner) => {
                format!("type = \"group\", fields = {}", self.fields(&path, inner))
            }
            Kind::Switch { on, cases, other } => {
                let cases = cases.iter().map(|(value, inner)| {
                    format!("{{ {}, {} }}, ", literal(value), self.fields(outer, inner))
                });
                let cases: String = cases.collect();
                let other = other.as_ref();
                let other = other.map_or_else(|| "nil".to_owned(), |of| self.fields(outer, of));
                format!(
                    "type = \"switch\", on = function(s) return {} end, cases = {{ {cases}}}, \
                     other = {other}",
                    on.lua()
                )
            }
        };
        let name = match field.name.is_empty() {
            true => "nil".to_owned(),
            false => quoted(field.name.as_bytes()),
        };
        let times = field.repeat.as_ref().map_or_else(|| "nil".to_owned(), size);
        let condition = field.condition.as_ref();
        let condition = condition.map_or_else(
            || "nil".to_owned(),
            |condition| format!("function(s) return {} end", condition.lua()),
        );
        format!(
            "\n{{ name = {name}, {kind}, times = {times}, condition = {condition}, is_optional = {}, \
             {}{}}}, ",
            field.is_optional,
            common(field),
            self.shown(&path),
        )
    }
}

/// The properties that binary and text fields share.
fn common(field: &Field) -> String {
    let mut out = String::new();
    if let Some(constant) = &field.constant {
        write!(out, "constant = {}, ", literal(constant)).expect(TAKES_ALL);
    }
    if let Some([scale, offset]) = field.scale {
        write!(out, "scale = {{ {scale:?}, {offset:?} }}, ").expect(TAKES_ALL);
    }
    if !field.unit.is_empty() {
        write!(out, "unit = {}, ", quoted(field.unit.as_bytes())).expect(TAKES_ALL);
    }
    if let Some(names) = &field.names {
        let names = names
            .iter()
            .map(|(at, name)| format!("[{at}] = {}, ", quoted(name.as_bytes())));
        write!(out, "names = {{ {}}}, ", names.collect::<String>()).expect(TAKES_ALL);
    }
    if !field.flags.is_empty() {
        let flags = field
            .flags
            .iter()
            .map(|name| format!("{}, ", quoted(name.as_bytes())));
        write!(out, "flags = {{ {}}}, ", flags.collect::<String>()).expect(TAKES_ALL);
    }
    out
}

fn path(outer: &str, name: &str) -> String {
    match outer {
        "" => name.to_owned(),
        outer => format!("{outer}.{name}"),
    }
}
