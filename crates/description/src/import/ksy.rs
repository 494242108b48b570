//! Descriptions from files of Kaitai Struct (`.ksy`): types, fields, enums and expressions.
//!
//! A `.ksy` describes the bytes of one structure. It has no frames on a line, checksum algorithms,
//! directions or behaviour. The draft has one message that the device sends periodically. A field
//! that cannot be carried over ends the known fields: it and those behind it become plain bytes.
//!
//! Facts: the user guide of Kaitai Struct, <https://doc.kaitai.io/user_guide.html>.

mod bits;
mod constant;
mod expression;
mod field;
mod frame;
mod typed;
mod yaml;

#[cfg(test)]
mod tests;

use core::fmt::Write as _;
use std::collections::BTreeMap;

use super::Draft;
use super::words::one_line;
use crate::Description;
use expression::{Names, word};
use field::Made;
use frame::Frame;
use yaml::{Data, Node};

/// Maximum depth of nested types.
const DEPTH_MAX: usize = 7;
/// Keys of a file or type that the draft uses or that are reported key by key.
const READ: [&str; 6] = ["meta", "doc", "seq", "types", "enums", "instances"];

/// Byte order of numbers, and of bits within a byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Orders {
    is_little: Option<bool>,
    is_low_first: bool,
}

/// The type whose fields are read.
#[derive(Clone)]
struct Level<'a> {
    /// The file and the types around the type, and the type itself.
    types: Vec<&'a Node>,
    names: Names,
    orders: Orders,
    /// Position of the type in the file, for reports.
    path: String,
}

/// The parts of a file that have been read.
struct Reader<'a> {
    /// Byte order of numbers in the draft.
    is_little: Option<bool>,
    /// The tables of names, and their names in the draft.
    enums: Vec<(&'a Node, String)>,
    left_out: Vec<String>,
    notes: Vec<String>,
    fields: usize,
}

/// Makes a description called `name` of the file `file` with this text.
pub(super) fn import(name: &str, file: &str, text: &str) -> Result<Draft, String> {
    let root = yaml::read(text).map_err(|error| format!("{file}: {error}"))?;
    if !matches!(root.data, Data::Table(_)) || root.get("seq").is_none() {
        return Err(format!(
            "{file}: line {}: has no key \"seq\", expected a .ksy of Kaitai Struct with fields",
            root.line
        ));
    }
    let mut reader = Reader {
        is_little: None,
        enums: Vec::new(),
        left_out: Vec::new(),
        notes: Vec::new(),
        fields: 0,
    };
    let orders = reader.meta(&root);
    reader.is_little = orders.is_little;
    reader.find_enums(&root, 0);
    reader.report_types(&root, "");
    let mut level = Level {
        types: vec![&root],
        names: Names {
            levels: vec![Vec::new()],
        },
        orders,
        path: "seq".to_owned(),
    };
    let made = reader.root_fields(&mut level, &root);
    reader.draft([name, file], &root, &made)
}

impl<'a> Reader<'a> {
    fn leave_out(&mut self, node: &Node, path: &str, why: &str) {
        let line = node.line;
        let part = one_line(&format!("line {line}: {path}: {why}"));
        // The cases of a switch share the keys of their field.
        if !self.left_out.contains(&part) {
            self.left_out.push(part);
        }
    }

    /// Reads the byte orders of a file or type.
    fn orders(&mut self, of: &Node, path: &str, outer: Orders) -> Orders {
        let mut orders = outer;
        let Some(meta) = of.get("meta") else {
            return orders;
        };
        let order = |key: &str| meta.text_of(key).map(|text| (text == "le", text));
        match order("endian") {
            Some((is_little, "le" | "be")) => orders.is_little = Some(is_little),
            _ => {
                if let Some(node) = meta.get("endian") {
                    orders.is_little = None;
                    self.leave_out(node, &format!("{path}meta.endian"), "depends on the bytes");
                }
            }
        }
        if let Some((is_little, _)) = order("bit-endian") {
            orders.is_low_first = is_little;
        }
        orders
    }

    /// Reads the head of the file.
    fn meta(&mut self, root: &Node) -> Orders {
        let orders = self.orders(root, "", Orders::default());
        for (key, node) in root.get("meta").map_or(&[][..], Node::pairs) {
            let is_used = ["id", "title", "endian", "bit-endian", "encoding"];
            if !is_used.contains(&key.as_str()) {
                let why = match key.as_str() {
                    "imports" => "types of other files",
                    _ => "has no counterpart",
                };
                self.leave_out(node, &format!("meta.{key}"), why);
            }
        }
        orders
    }

    /// Gives each table of names a name of its own.
    fn find_enums(&mut self, of: &'a Node, depth: usize) {
        if depth > DEPTH_MAX {
            return;
        }
        for (id, node) in of.get("enums").map_or(&[][..], Node::pairs) {
            let base = word(id);
            let more = (2..).map(|number| format!("{base}_{number}"));
            let mut names = core::iter::once(base.clone()).chain(more);
            let is_free = |name: &String| self.enums.iter().all(|(_, known)| known != name);
            let name = names.find(is_free).unwrap_or(base);
            self.enums.push((node, name));
        }
        for (_, inner) in of.get("types").map_or(&[][..], Node::pairs) {
            self.find_enums(inner, depth + 1);
        }
    }

    /// Reports the keys of a file and its types that have no counterpart.
    fn report_types(&mut self, of: &Node, path: &str) {
        for (key, node) in of.pairs() {
            let path = format!("{path}{key}");
            match key.as_str() {
                "instances" => {
                    for (name, node) in node.pairs() {
                        let path = format!("{path}.{name}");
                        self.leave_out(node, &path, "is computed or at another position");
                    }
                }
                "types" => {
                    for (name, inner) in node.pairs() {
                        self.report_types(inner, &format!("{path}.{name}."));
                    }
                }
                key if READ.contains(&key) => {}
                _ => self.leave_out(node, &path, "has no counterpart"),
            }
        }
    }

    /// The type or the table of names that `name` means, with the types around it.
    fn find(
        &self,
        level: &Level<'a>,
        section: &str,
        name: &str,
    ) -> Option<(Vec<&'a Node>, &'a Node)> {
        let parts: Vec<&str> = name.split("::").collect();
        let (last, outer) = parts.split_last()?;
        for depth in (1..=level.types.len()).rev() {
            let mut types = level.types[..depth].to_vec();
            let is_found = outer.iter().all(|part| {
                let inner = types.last().and_then(|node| node.get("types")?.get(part));
                types.extend(inner);
                inner.is_some()
            });
            let found = types.last().and_then(|node| node.get(section)?.get(last));
            if let Some(found) = found.filter(|_| is_found) {
                return Some((types, found));
            }
        }
        None
    }

    /// The name in the draft of the table of names `name`.
    fn enum_name(&self, level: &Level<'a>, name: &str) -> Option<String> {
        let (_, found) = self.find(level, "enums", name)?;
        let known = self
            .enums
            .iter()
            .find(|(node, _)| core::ptr::eq(*node, found));
        known.map(|(_, name)| name.clone())
    }

    /// The value `enum::member` of a path.
    fn member(&self, level: &Level<'a>, path: &str) -> Option<String> {
        let (of, member) = path.rsplit_once("::")?;
        Some(format!("{}::{member}", self.enum_name(level, of)?))
    }

    /// The fields of the file. From the first one that cannot be carried over, they are bytes.
    fn root_fields(&mut self, level: &mut Level<'a>, root: &'a Node) -> Vec<Made> {
        let mut made = Vec::new();
        let all = root.get("seq").map_or(&[][..], Node::elements);
        let whole = self.seq(level, all, 0, &mut made);
        if let Err((node, path, why)) = whole {
            self.leave_out(node, &path, &why);
            let name = match level.names.levels[0].iter().any(|name| name == "rest") {
                true => "rest_of_frame",
                false => "rest",
            };
            self.notes.push(format!(
                "from {path} on, the message has plain bytes with the name \"{name}\""
            ));
            made.push(Made::bytes(name).named());
        }
        made
    }

    /// A draft with as many of the fields as a description can have.
    fn draft(&self, names: [&str; 2], root: &Node, made: &[Made]) -> Result<Draft, String> {
        let mut first = None;
        for count in (0..=made.len()).rev() {
            let mut kept = made[..count].to_vec();
            let mut notes = self.notes.clone();
            if count < made.len() {
                let (name, why) = (&made[count].name, first.clone().unwrap_or_default());
                notes.push(format!(
                    "from the field \"{name}\" on, the message has plain bytes: {why}"
                ));
                kept.push(Made::bytes("rest_of_frame").named());
            }
            let text = self.written(names, root, &kept, &mut notes);
            match Description::parse(names[0], &text, &|_| Err("no file".to_owned())) {
                Ok(_) => {
                    return Ok(Draft {
                        text,
                        registers: 0,
                        fields: self.fields,
                        left_out: self.left_out.clone(),
                        notes,
                    });
                }
                Err(error) => {
                    let problem = error.problems.first();
                    let words =
                        |problem: &crate::Problem| format!("{}: {}", problem.key, problem.message);
                    first.get_or_insert(problem.map(words).unwrap_or_default());
                }
            }
        }
        let why = first.unwrap_or_default();
        Err(format!("{}: cannot be carried over: {why}", names[1]))
    }

    /// The text of the description.
    fn written(
        &self,
        [name, file]: [&str; 2],
        root: &Node,
        made: &[Made],
        notes: &mut Vec<String>,
    ) -> String {
        let frame = frame::frame(made);
        if !frame.is_known {
            notes.push(
                "the end of a frame does not follow from the file: expected a silence of 3.5 \
                 characters, change it under [frame]"
                    .to_owned(),
            );
        }
        let is_sum = |name: &str| {
            let words = ["crc", "checksum", "chksum", "fcs", "lrc", "bcc", "cs"];
            name.split('_').any(|part| words.contains(&part))
        };
        if let Some(sum) = made.iter().find(|made| is_sum(&made.name)) {
            let name = &sum.name;
            notes.push(format!(
                "\"{name}\" is a plain field: if it is a checksum, set \"checksum\" in [frame] and \
                 remove the field"
            ));
        }
        notes.push(
            "a .ksy has no line settings, directions or replies: the device sends the message each \
             second at 115200 Bd"
                .to_owned(),
        );
        self.toml([name, file], root, (made, &frame), notes)
    }

    /// The keys and tables of the description.
    fn toml(
        &self,
        [name, file]: [&str; 2],
        root: &Node,
        (made, frame): (&[Made], &Frame),
        notes: &[String],
    ) -> String {
        let quoted = |text: &str| toml::Value::String(one_line(text)).to_string();
        let mut text = format!("# The structure in {}.\n", one_line(file));
        for part in &self.left_out {
            let _ = writeln!(text, "# Left out: {}.", one_line(part));
        }
        for note in notes {
            let _ = writeln!(text, "# Note: {}.", one_line(note));
        }
        let meta = |key: &str| root.get("meta").and_then(|meta| meta.text_of(key));
        let about = meta("title").or_else(|| root.text_of("doc"));
        let about = about.map_or_else(|| format!("The structure in {file}"), one_line);
        let message = meta("id").map_or_else(|| "message".to_owned(), word);
        let _ = writeln!(text, "name = {}\nabout = {}", quoted(name), quoted(&about));
        if let Some(is_little) = self.is_little {
            let order = if is_little { "little" } else { "big" };
            let _ = writeln!(text, "endian = \"{order}\"");
        }
        let _ = write!(
            text,
            "line = {{ baud = 115200 }}\nevery = [{{ period = \"1s\", send = \"{message}\" \
             }}]\n\n[frame]\n{}",
            frame.text
        );
        for (node, name) in &self.enums {
            let _ = writeln!(text, "\n[enums.{name}]");
            for (value, member) in members(node) {
                let _ = writeln!(text, "{value} = {}", quoted(&member));
            }
        }
        let _ = writeln!(
            text,
            "\n[[message]]\nname = \"{message}\"\nfrom = \"device\"\nfields = ["
        );
        for (index, field) in made.iter().enumerate().skip(frame.first) {
            if frame.length == Some(index) {
                continue;
            }
            let _ = writeln!(text, "  {{ {} }},", field.keys.join(", "));
        }
        text + "]\n"
    }
}

/// The members of a table of names by value.
fn members(of: &Node) -> BTreeMap<i128, String> {
    let pairs = of.pairs().iter().filter_map(|(key, node)| {
        let value = yaml::int(key)?;
        let name = node.text().or_else(|| node.text_of("id"))?;
        Some((value, name.to_owned()))
    });
    pairs.collect()
}
