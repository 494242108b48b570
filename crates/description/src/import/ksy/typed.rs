//! Fields whose type is a name or depends on another field.

use super::constant::number;
use super::expression::word;
use super::field::{Len, Made, Refused, quoted};
use super::yaml::Node;
use super::{DEPTH_MAX, Level, Reader};

impl<'a> Reader<'a> {
    /// A field with a type by name.
    pub(super) fn typed(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        (kind, id): (&'a Node, &str),
        path: &str,
        (depth, _): (usize, bool),
    ) -> Result<Made, Refused<'a>> {
        let name = kind.text().unwrap_or_default();
        let refused = |why: &str| Err((kind, format!("{path}.type"), why.to_owned()));
        match number(name) {
            Some((ours, bytes, order)) => {
                let is_little = order.or(level.orders.is_little);
                if is_little.is_none() && bytes > 1 {
                    return refused("has no order of bytes");
                }
                let suffix = match is_little {
                    _ if bytes == 1 => "",
                    is_little if is_little == self.is_little => "",
                    Some(true) => "le",
                    _ => "be",
                };
                let keys = vec![format!("type = \"{ours}{suffix}\"")];
                let mut made = Made::new(id, keys, Len::Fixed(bytes));
                let is_unsigned = ours.starts_with('u');
                made.is_little = is_unsigned.then_some(is_little.unwrap_or(false));
                return Ok(made);
            }
            None if matches!(name, "str" | "strz") => return self.text(level, node, id, path),
            None => {}
        }
        if name.contains('(') {
            return refused("has parameters");
        }
        let Some((types, found)) = self.find(level, "types", name) else {
            return refused(&format!("there is no type \"{name}\" in the file"));
        };
        if depth >= DEPTH_MAX {
            return refused("is nested too deep, or in itself");
        }
        if let Some(params) = found.get("params") {
            return Err((params, format!("{path}.type"), "has parameters".to_owned()));
        }
        self.group(level, node, (types, found, id), path, depth)
    }

    /// The fields of a type as a group.
    fn group(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        (mut types, found, id): (Vec<&'a Node>, &'a Node, &str),
        path: &str,
        depth: usize,
    ) -> Result<Made, Refused<'a>> {
        let orders = self.orders(found, &format!("{path}.type."), level.orders);
        types.push(found);
        let mut names = level.names.clone();
        names.levels.push(Vec::new());
        let mut inner = Level {
            types,
            names,
            orders,
            path: path.to_owned(),
        };
        let mut fields = Vec::new();
        let all = found.get("seq").map_or(&[][..], Node::elements);
        self.seq(&mut inner, all, depth + 1, &mut fields)?;
        if fields.is_empty() {
            return Err((found, format!("{path}.type"), "has no field".to_owned()));
        }
        let fixed = fields.iter().try_fold(0, |sum, field| match field.len {
            Len::Fixed(len) => Some(sum + len),
            _ => None,
        });
        let mut len = fixed.map_or(Len::Open, Len::Fixed);
        let mut sized_by = None;
        if let Some(size) = node.get("size") {
            let (_, of_size) = self.size(level, node, path)?;
            if let (Len::Fixed(size), Some(pad)) = (
                &of_size,
                fixed.and_then(|fixed| size_of(&of_size)?.checked_sub(fixed)),
            ) {
                if pad > 0 {
                    let keys = vec!["type = \"pad\"".to_owned(), format!("size = {pad}")];
                    fields.push(Made::new("", keys, Len::Fixed(pad)));
                }
                len = Len::Fixed(*size);
            } else {
                (len, sized_by) = (Len::Open, sized_by_of(&of_size));
                let why = "the fields of the type must fill it";
                self.leave_out(size, &format!("{path}.size"), why);
            }
        } else if let Some(eos) = node.get("size-eos") {
            let why = "the fields of the type must fill the rest";
            self.leave_out(eos, &format!("{path}.size-eos"), why);
        }
        let list: Vec<String> = fields.iter().map(Made::inline).collect();
        let keys = vec![
            "type = \"group\"".to_owned(),
            format!("fields = [{}]", list.join(", ")),
        ];
        Ok(Made {
            sized_by,
            ..Made::new(id, keys, len)
        })
    }

    /// A field whose type depends on another one.
    pub(super) fn switch(
        &mut self,
        level: &Level<'a>,
        node: &'a Node,
        kind: &'a Node,
        path: &str,
        (depth, is_last): (usize, bool),
    ) -> Result<Made, Refused<'a>> {
        let refused = |why: &str| (kind, format!("{path}.type"), why.to_owned());
        if let Some(repeat) = node.get("repeat") {
            let why = "of a type that depends on a field".to_owned();
            return Err((repeat, format!("{path}.repeat"), why));
        }
        let on = kind.get("switch-on").ok_or_else(|| refused("is no type"))?;
        let on = self.expression(level, on, &format!("{path}.type.switch-on"))?;
        let id = word(node.text_of("id").unwrap_or_default());
        let sized_by = match node.get("size") {
            Some(_) => sized_by_of(&self.size(level, node, path)?.1),
            None => None,
        };
        let mut cases = Vec::new();
        let mut has_other = false;
        for (case, kind) in kind.get("cases").map_or(&[][..], Node::pairs) {
            let key = match case.as_str() {
                "_" => "_".to_owned(),
                case if case.contains("::") => self
                    .member(level, case)
                    .ok_or_else(|| refused(&format!("there is no \"{case}\"")))?,
                case => case.trim_matches(['"', '\'']).to_owned(),
            };
            has_other |= key == "_";
            let path = format!("{path}.{case}");
            // The size of the field is that of its bytes without a type.
            let made = self.typed(level, node, (kind, &id), &path, (depth, is_last));
            let made = match made {
                Err((at, key, why)) if is_last && depth == 0 => {
                    self.leave_out(at, &key, &why);
                    Made::bytes(&id)
                }
                made => made?,
            };
            cases.push(format!("{} = [{}]", quoted(&key), made.named().inline()));
        }
        if cases.is_empty() {
            return Err(refused("has no cases"));
        }
        if !has_other {
            let is_sized = node.get("size").is_some() || node.get("size-eos").is_some();
            let fixed = match is_sized {
                true => size_of(&self.size(level, node, path)?.1),
                false => Some(0),
            };
            // In Kaitai Struct, a field with another value has its bytes without a type, or none.
            let other = match fixed {
                Some(0) => String::new(),
                Some(_) => self
                    .sized(level, node, ("bytes", &id), path)?
                    .named()
                    .inline(),
                None if is_last => Made::bytes(&id).named().inline(),
                None => {
                    let why = "a frame with another value and a size above 0 is an unknown message";
                    self.leave_out(kind, &format!("{path}.type"), why);
                    String::new()
                }
            };
            cases.push(format!("_ = [{other}]"));
        }
        let keys = vec![
            "type = \"switch\"".to_owned(),
            format!("on = {}", quoted(&on)),
            format!("cases = {{ {} }}", cases.join(", ")),
        ];
        Ok(Made {
            sized_by,
            ..Made::new("", keys, Len::Open)
        })
    }
}

const fn size_of(len: &Len) -> Option<usize> {
    match len {
        Len::Fixed(len) => Some(*len),
        _ => None,
    }
}

/// The field and the constant of a size such as `len` or `len - 2`.
pub(super) fn sized_by_of(len: &Len) -> Option<(String, i64)> {
    let Len::Computed(text) = len else {
        return None;
    };
    let words: Vec<&str> = text.split_whitespace().collect();
    let is_name = |name: &str| {
        name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            && !name.starts_with(|c: char| c.is_ascii_digit())
    };
    let (name, more) = match words[..] {
        [name] => (name, 0),
        [name, "+", more] => (name, more.parse().ok()?),
        [name, "-", less] => (name, -less.parse::<i64>().ok()?),
        _ => return None,
    };
    is_name(name).then(|| (name.to_owned(), more))
}
