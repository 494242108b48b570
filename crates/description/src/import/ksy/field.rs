//! Fields of a draft.

use super::bits::{Bits, bits_of};
use super::constant::constant;
use super::expression::{translated, word};
use super::typed::sized_by_of;
use super::yaml::{Data, Node};
use super::{Level, Reader};

/// A field of a draft.
#[derive(Clone, Debug)]
pub(super) struct Made {
    pub(super) name: String,
    /// Its keys and values as TOML.
    pub(super) keys: Vec<String>,
    pub(super) len: Len,
    /// Its bytes, if they are constant and have no name.
    pub(super) sync: Option<Vec<u8>>,
    /// The byte order, if the field is an integer without sign.
    pub(super) is_little: Option<bool>,
    /// The earlier field that holds the number of bytes of a field with a type, and a constant that
    /// is added.
    pub(super) sized_by: Option<(String, i64)>,
    /// The same for a text, bytes or a list.
    pub(super) counted_by: Option<(String, i64)>,
}

/// The number of bytes of a field.
#[derive(Clone, Debug)]
pub(super) enum Len {
    Fixed(usize),
    /// An expression over earlier fields.
    Computed(String),
    /// The rest of the frame, or unknown.
    Open,
}

/// The reason why a field cannot be carried over: its place and the key.
pub(super) type Refused<'a> = (&'a Node, String, String);

/// Keys of a field that the draft has.
const CARRIED: [&str; 16] = [
    "id",
    "type",
    "size",
    "size-eos",
    "contents",
    "enum",
    "if",
    "repeat",
    "repeat-expr",
    "doc",
    "encoding",
    "terminator",
    "valid",
    "repeat-until",
    "process",
    "pos",
];
/// Keys without which a field cannot be read.
const NEEDED: [(&str, &str); 4] = [
    ("process", "changes the bytes"),
    ("repeat-until", "ends at a value"),
    ("pos", "is at another position"),
    ("io", "is in another stream"),
];

impl Made {
    /// The rest of a frame as bytes.
    pub(super) fn bytes(name: &str) -> Self {
        let keys = ["type = \"bytes\"", "size = \"rest\""].map(str::to_owned);
        Self::new(name, keys.to_vec(), Len::Open)
    }

    pub(super) fn new(name: &str, keys: Vec<String>, len: Len) -> Self {
        Self {
            name: name.to_owned(),
            keys,
            len,
            sync: None,
            is_little: None,
            sized_by: None,
            counted_by: None,
        }
    }

    /// The field with its name.
    pub(super) fn named(mut self) -> Self {
        if !self.name.is_empty() {
            self.keys.insert(0, format!("name = \"{}\"", self.name));
        }
        self
    }

    /// The field as an inline table.
    pub(super) fn inline(&self) -> String {
        format!("{{ {} }}", self.keys.join(", "))
    }
}

pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(super::one_line(text)).to_string()
}

impl<'a> Reader<'a> {
    /// Reads a list of fields.
    pub(super) fn seq(
        &mut self,
        level: &mut Level<'a>,
        all: &'a [Node],
        depth: usize,
        out: &mut Vec<Made>,
    ) -> Result<(), Refused<'a>> {
        let mut bits = Bits::default();
        for (index, node) in all.iter().enumerate() {
            let path = match node.text_of("id") {
                Some(id) => format!("{}.{id}", level.path),
                None => format!("{}[{index}]", level.path),
            };
            let is_last = index + 1 == all.len();
            let kind = node.text_of("type").and_then(|kind| bits_of(kind, level));
            let made = match kind {
                Some((count, is_low_first)) => self
                    .bit_field(level, node, &path, (count, is_low_first))
                    .map(|mut made| {
                        made.len = bits.add(count, is_low_first);
                        made
                    }),
                None => {
                    bits.pad(out);
                    self.field(level, node, &path, (depth, is_last))
                }
            };
            let made = match made {
                Ok(made) => made,
                Err((at, key, why)) => {
                    bits.pad(out);
                    return Err((at, key, why));
                }
            };
            self.fields += 1;
            // The draft must write the number of bytes from the value.
            if let Some((name, more)) = made.counted_by.as_ref().filter(|(_, more)| *more != 0)
                && let Some(count) = out.iter_mut().find(|count| count.name == *name)
            {
                let (sign, more) = if *more < 0 {
                    ('+', -more)
                } else {
                    ('-', *more)
                };
                let calc = format!("calc = \"len({}) {sign} {more}\"", made.name);
                count.keys.push(calc);
            }
            if !made.name.is_empty()
                && let Some(names) = level.names.levels.last_mut()
            {
                names.push(made.name.clone());
            }
            out.push(made);
        }
        bits.pad(out);
        Ok(())
    }

    fn bit_field(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        path: &str,
        (count, is_low_first): (usize, bool),
    ) -> Result<Made, Refused<'a>> {
        for key in ["if", "repeat"] {
            if let Some(value) = node.get(key) {
                return Err((value, format!("{path}.{key}"), "is for bits".to_owned()));
            }
        }
        let name = word(node.text_of("id").unwrap_or_default());
        let order = if is_low_first { "le" } else { "" };
        let keys = vec![format!("type = \"b{count}{order}\"")];
        let mut made = Made::new(&name, keys, Len::Fixed(0));
        self.common(level, node, path, &mut made)?;
        Ok(made.named())
    }

    /// Reads a field.
    fn field(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        path: &str,
        place: (usize, bool),
    ) -> Result<Made, Refused<'a>> {
        for (key, why) in NEEDED {
            if let Some(value) = node.get(key) {
                return Err((value, format!("{path}.{key}"), why.to_owned()));
            }
        }
        if let Some(contents) = node.get("contents") {
            let name = match node.text_of("id") {
                Some(id) => word(id),
                None => format!("constant_{}", node.line),
            };
            return constant(contents, &name).ok_or_else(|| {
                (
                    contents,
                    format!("{path}.contents"),
                    "is not a list of bytes".to_owned(),
                )
            });
        }
        let id = node.text_of("id").map(word);
        let Some(id) = id else {
            return Err((node, path.to_owned(), "has no \"id\"".to_owned()));
        };
        let mut made = match node.get("type").map(|kind| (kind, &kind.data)) {
            Some((kind, Data::Table(_))) => self.switch(level, node, kind, path, place)?,
            Some((kind, _)) => self.typed(level, node, (kind, &id), path, place)?,
            None => self.sized(level, node, ("bytes", &id), path)?,
        };
        if !made.name.is_empty() {
            made = made.named();
        }
        self.common(level, node, path, &mut made)?;
        Ok(made)
    }

    /// The keys that every field can have.
    fn common(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        path: &str,
        made: &mut Made,
    ) -> Result<(), Refused<'a>> {
        if let Some(names) = node.get("enum") {
            let found = names.text().and_then(|name| self.enum_name(level, name));
            match found {
                Some(name) => made.keys.push(format!("enum = \"{name}\"")),
                None => self.leave_out(names, &format!("{path}.enum"), "is in no table \"enums\""),
            }
        }
        if let Some(repeat) = node.get("repeat") {
            self.repeat(level, node, repeat, path, made)?;
        }
        if let Some(condition) = node.get("if") {
            let text = self.expression(level, condition, &format!("{path}.if"))?;
            made.keys.push(format!("if = {}", quoted(&text)));
            made.len = match &made.len {
                Len::Fixed(len) => Len::Computed(format!("({text}) ? {len} : 0")),
                Len::Computed(len) => Len::Computed(format!("({text}) ? ({len}) : 0")),
                Len::Open => Len::Open,
            };
            made.is_little = None;
        }
        if let Some(valid) = node.get("valid") {
            self.valid(level, valid, path, made);
        }
        if let Some(doc) = node.text_of("doc") {
            made.keys.push(format!("about = {}", quoted(doc)));
        }
        let encoding = node.get("encoding").filter(|node| {
            let text = node.text().unwrap_or_default().to_ascii_lowercase();
            !matches!(text.as_str(), "ascii" | "iso8859-1" | "iso-8859-1")
        });
        if let Some(encoding) = encoding {
            let why = "each byte is one character of ISO 8859-1";
            self.leave_out(encoding, &format!("{path}.encoding"), why);
        }
        for (key, value) in node.pairs() {
            if !CARRIED.contains(&key.as_str()) {
                self.leave_out(value, &format!("{path}.{key}"), "has no counterpart");
            }
        }
        Ok(())
    }

    fn repeat(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        repeat: &'a Node,
        path: &str,
        made: &mut Made,
    ) -> Result<(), Refused<'a>> {
        match (repeat.text(), node.get("repeat-expr")) {
            (Some("eos"), _) => {
                made.keys.push("repeat = \"rest\"".to_owned());
                made.len = Len::Open;
            }
            (Some("expr"), Some(count)) => {
                let text = self.expression(level, count, &format!("{path}.repeat-expr"))?;
                let value = match count.int() {
                    Some(int) => int.to_string(),
                    None => quoted(&text),
                };
                made.keys.push(format!("repeat = {value}"));
                made.counted_by = sized_by_of(&Len::Computed(text.clone()));
                made.len = match (&made.len, count.int()) {
                    (Len::Fixed(len), Some(int)) => usize::try_from(int)
                        .ok()
                        .and_then(|count| len.checked_mul(count))
                        .map_or(Len::Open, Len::Fixed),
                    (Len::Fixed(len), None) => Len::Computed(format!("({text}) * {len}")),
                    _ => Len::Open,
                };
            }
            _ => {
                let why = "expected \"eos\", or \"expr\" with \"repeat-expr\"";
                return Err((repeat, format!("{path}.repeat"), why.to_owned()));
            }
        }
        made.is_little = None;
        Ok(())
    }

    /// A value that the field must have, or its limits.
    fn valid(&mut self, level: &Level<'a>, valid: &'a Node, path: &str, made: &mut Made) {
        let value = valid.get("eq").unwrap_or(valid);
        let member = value.text().filter(|text| text.contains("::"));
        let member = member.and_then(|text| self.member(level, text));
        let limits = [valid.get("min"), valid.get("max")].map(|node| node.and_then(Node::int));
        match (value.int(), member, limits) {
            (Some(int), ..) => made.keys.push(format!("value = {int}")),
            (_, Some(member), _) => {
                let name = member.rsplit("::").next().unwrap_or_default();
                made.keys.push(format!("value = {}", quoted(name)));
            }
            (.., [Some(least), Some(most)]) => {
                made.keys.push(format!("limits = [{least}, {most}]"));
            }
            _ => {
                let why = "expected an integer, or \"min\" and \"max\"";
                self.leave_out(valid, &format!("{path}.valid"), why);
            }
        }
    }

    /// An expression in the words of descriptions.
    pub(super) fn expression(
        &self,
        level: &Level<'a>,
        node: &'a Node,
        path: &str,
    ) -> Result<String, Refused<'a>> {
        let member = |path: &str| self.member(level, path);
        let text = node.text().ok_or("is no expression".to_owned());
        let text = text.and_then(|text| translated(text, &level.names, &member));
        text.map_err(|why| (node, path.to_owned(), why))
    }

    /// The value of the key `size`, and the number of bytes.
    pub(super) fn size(
        &self,
        level: &Level<'a>,
        node: &'a Node,
        path: &str,
    ) -> Result<(String, Len), Refused<'a>> {
        if node.text_of("size-eos") == Some("true") {
            return Ok(("\"rest\"".to_owned(), Len::Open));
        }
        let Some(size) = node.get("size") else {
            let why = "has no \"type\" and no \"size\"".to_owned();
            return Err((node, path.to_owned(), why));
        };
        if let Some(int) = size.int().and_then(|int| usize::try_from(int).ok()) {
            return Ok((int.to_string(), Len::Fixed(int)));
        }
        let text = self.expression(level, size, &format!("{path}.size"))?;
        Ok((quoted(&text), Len::Computed(text)))
    }

    pub(super) fn text(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        id: &str,
        path: &str,
    ) -> Result<Made, Refused<'a>> {
        let is_zero = node.text_of("type") == Some("strz");
        let ends = node.get("terminator").map(Node::int);
        if node.get("size").is_none() && node.text_of("size-eos") != Some("true") {
            return match (is_zero, ends) {
                (true, None) | (_, Some(Some(0))) => {
                    let keys = vec!["type = \"strz\"".to_owned()];
                    Ok(Made::new(id, keys, Len::Open))
                }
                _ => Err((node, path.to_owned(), "ends at a character".to_owned())),
            };
        }
        if let Some(end) = node.get("terminator").filter(|_| ends != Some(Some(0))) {
            self.leave_out(end, &format!("{path}.terminator"), "beside \"size\"");
        }
        self.sized(level, node, ("str", id), path)
    }

    /// A text or bytes with the size of the key.
    pub(super) fn sized(
        &self,
        level: &Level<'a>,
        node: &'a Node,
        (kind, id): (&str, &str),
        path: &str,
    ) -> Result<Made, Refused<'a>> {
        let (size, len) = self.size(level, node, path)?;
        let keys = vec![format!("type = \"{kind}\""), format!("size = {size}")];
        Ok(Made {
            counted_by: sized_by_of(&len),
            ..Made::new(id, keys, len)
        })
    }
}
