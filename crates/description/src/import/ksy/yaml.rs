//! YAML as a tree in which each value has its line.

use saphyr_parser::{Event, Parser, ScalarStyle, Span};

/// Maximum depth of a tree.
const DEPTH_MAX: usize = 64;

/// A value.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) line: usize,
    pub(super) data: Data,
}

/// The content of a value.
#[derive(Clone, Debug)]
pub(super) enum Data {
    /// A number, a word, a text in quotes, or nothing.
    Text {
        text: String,
        is_quoted: bool,
    },
    List(Vec<Node>),
    /// Keys with their values, in the order of the file.
    Table(Vec<(String, Node)>),
}

impl Node {
    /// The value of a key of a table.
    pub(super) fn get(&self, key: &str) -> Option<&Self> {
        let mut pairs = self.pairs().iter();
        pairs
            .find(|(known, _)| known == key)
            .map(|(_, value)| value)
    }

    /// The keys and values of a table; of any other value, nothing.
    pub(super) fn pairs(&self) -> &[(String, Self)] {
        match &self.data {
            Data::Table(pairs) => pairs,
            _ => &[],
        }
    }

    /// The elements of a list; any other value is its only element.
    pub(super) fn elements(&self) -> &[Self] {
        match &self.data {
            Data::List(list) => list,
            _ => core::slice::from_ref(self),
        }
    }

    /// The text of a number, a word or a text.
    pub(super) fn text(&self) -> Option<&str> {
        match &self.data {
            Data::Text { text, .. } => Some(text),
            _ => None,
        }
    }

    /// The text of a key of a table.
    pub(super) fn text_of(&self, key: &str) -> Option<&str> {
        self.get(key)?.text()
    }

    /// An integer, decimal or with the prefix 0x, 0o or 0b.
    pub(super) fn int(&self) -> Option<i128> {
        match &self.data {
            Data::Text {
                text,
                is_quoted: false,
            } => int(text),
            _ => None,
        }
    }
}

/// An integer, decimal or with the prefix 0x, 0o or 0b.
pub(super) fn int(text: &str) -> Option<i128> {
    let plain = text.replace('_', "");
    let of_radix = |prefix: &str, radix| {
        let digits = plain.strip_prefix(prefix)?;
        i128::from_str_radix(digits, radix).ok()
    };
    of_radix("0o", 8)
        .or_else(|| of_radix("0b", 2))
        .or_else(|| crate::compile::whole(&plain))
}

/// A list or table that is not complete.
struct Open {
    node: Node,
    /// The key whose value comes next, and its line.
    key: Option<(String, usize)>,
}

/// Reads a YAML document.
pub(super) fn read(text: &str) -> Result<Node, String> {
    let mut open: Vec<Open> = Vec::new();
    let mut root = None;
    for event in Parser::new_from_str(text) {
        let (event, span) = event.map_err(|error| {
            let line = error.marker().line();
            format!("line {line}: {}, expected YAML", error.info())
        })?;
        let line = line_of(span);
        let done = match event {
            Event::Scalar(text, style, ..) => Node {
                line,
                data: Data::Text {
                    text: text.into_owned(),
                    is_quoted: style != ScalarStyle::Plain,
                },
            },
            Event::SequenceStart(..) | Event::MappingStart(..) => {
                if open.len() >= DEPTH_MAX {
                    return Err(format!(
                        "line {line}: is nested too deep, expected {DEPTH_MAX} levels at most"
                    ));
                }
                let data = match event {
                    Event::SequenceStart(..) => Data::List(Vec::new()),
                    _ => Data::Table(Vec::new()),
                };
                open.push(Open {
                    node: Node { line, data },
                    key: None,
                });
                continue;
            }
            Event::SequenceEnd | Event::MappingEnd => match open.pop() {
                Some(done) => done.node,
                None => continue,
            },
            Event::Alias(_) => {
                return Err(format!(
                    "line {line}: has an alias (*), expected the value itself"
                ));
            }
            _ => continue,
        };
        match open.last_mut() {
            Some(outer) => outer.add(done)?,
            None if root.is_none() => root = Some(done),
            None => {
                return Err(format!(
                    "line {line}: begins a second document, expected one"
                ));
            }
        }
    }
    root.ok_or_else(|| "is empty, expected a table with the key \"seq\"".to_owned())
}

fn line_of(span: Span) -> usize {
    span.start.line()
}

impl Open {
    /// Adds an element, a key, or the value of a key.
    fn add(&mut self, node: Node) -> Result<(), String> {
        match (&mut self.node.data, self.key.take()) {
            (Data::List(list), _) => list.push(node),
            (Data::Table(pairs), Some((key, line))) => {
                let data = node.data;
                pairs.push((key, Node { line, data }));
            }
            (Data::Table(pairs), None) => {
                let line = node.line;
                let Data::Text { text, .. } = node.data else {
                    return Err(format!("line {line}: is no key, expected a word"));
                };
                if pairs.iter().any(|(known, _)| *known == text) {
                    return Err(format!("line {line}: has the key \"{text}\" a second time"));
                }
                self.key = Some((text, line));
            }
            (Data::Text { .. }, _) => {}
        }
        Ok(())
    }
}
