//! Expressions of Kaitai Struct in the words of descriptions.

/// The names that an expression of a type may use.
#[derive(Clone, Debug, Default)]
pub(super) struct Names {
    /// Earlier fields of each type, the outermost type first.
    pub(super) levels: Vec<Vec<String>>,
}

/// Words that no field can have as its name.
const RESERVED: [&str; 8] = [
    "and", "or", "not", "true", "false", "state", "request", "self",
];

/// The name of a field.
pub(super) fn word(id: &str) -> String {
    let plain: String = id
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect();
    let starts_well = plain.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    match starts_well && !RESERVED.contains(&&*plain) {
        true => plain,
        false => format!("r_{plain}"),
    }
}

impl Names {
    /// The name of a field that is reached through `chain`, such as `_parent.len`.
    fn of(&self, chain: &str) -> Result<String, String> {
        let mut parts: Vec<&str> = chain.split('.').collect();
        let deepest = self.levels.len().saturating_sub(1);
        let level = match parts[0] {
            "_root" => 0,
            "_parent" => deepest.checked_sub(1).ok_or("there is no _parent")?,
            _ => deepest,
        };
        if matches!(parts[0], "_root" | "_parent") {
            parts.remove(0);
        }
        let name = parts.first().map(|part| word(part)).unwrap_or_default();
        let has = |level: &Vec<String>| level.contains(&name);
        if name.starts_with('_') || !self.levels.get(level).is_some_and(has) {
            return Err(format!("\"{chain}\" is no earlier field"));
        }
        if self.levels[level + 1..].iter().any(has) {
            return Err(format!(
                "\"{chain}\" has the same name as a field of an inner type"
            ));
        }
        let mut text = name;
        for part in &parts[1..] {
            match *part {
                "length" | "size" => text = format!("len({text})"),
                "to_i" => {}
                part if part.starts_with('_') => {
                    return Err(format!("\"{chain}\" is no field"));
                }
                part => text = format!("{text}.{}", word(part)),
            }
        }
        Ok(text)
    }
}

/// Translates an expression; `member` gives the value `enum::member` of a path.
pub(super) fn translated(
    text: &str,
    names: &Names,
    member: &dyn Fn(&str) -> Option<String>,
) -> Result<String, String> {
    let mut out = String::new();
    let mut rest = text.trim();
    while let Some(c) = rest.chars().next() {
        let is_word = |c: char| c.is_ascii_alphanumeric() || "_.:".contains(c);
        let len = match c {
            '0'..='9' => rest
                .find(|c: char| !c.is_ascii_alphanumeric() && c != '_' && c != '.')
                .unwrap_or(rest.len()),
            'a'..='z' | 'A'..='Z' | '_' => word_len(rest, is_word),
            '"' | '\'' => {
                let end = rest[1..].find(c).ok_or("a text does not end")?;
                end + 2
            }
            c => c.len_utf8(),
        };
        let (token, behind) = rest.split_at(len);
        match c {
            '0'..='9' => out += &number(token)?,
            'a'..='z' | 'A'..='Z' | '_' => {
                if behind.starts_with(['(', '<']) && token.contains('.') {
                    return Err(format!("\"{token}\" has no counterpart"));
                }
                out += &match token {
                    "and" | "or" | "not" | "true" | "false" => token.to_owned(),
                    token if token.contains("::") => {
                        member(token).ok_or_else(|| format!("there is no \"{token}\""))?
                    }
                    token => names.of(token)?,
                };
            }
            '/' => out += "//",
            '"' | '\'' => out += token,
            c if " +-*%<>=!&|^~()[]?:,".contains(c) => out += token,
            c => return Err(format!("\"{c}\" has no counterpart")),
        }
        rest = behind;
    }
    Ok(out)
}

/// The length of a name with its attributes or its enum. A colon ends it unless it is doubled.
fn word_len(text: &str, is_word: impl Fn(char) -> bool) -> usize {
    let bytes = text.as_bytes();
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        if !is_word(char::from(byte)) {
            break;
        }
        match (byte, bytes.get(at + 1)) {
            (b':', Some(b':')) => at += 2,
            (b':', _) => break,
            _ => at += 1,
        }
    }
    at
}

fn number(token: &str) -> Result<String, String> {
    let plain = token.replace('_', "");
    match plain.strip_prefix("0o") {
        None => Ok(plain),
        Some(digits) => {
            let value = i128::from_str_radix(digits, 8);
            value
                .map(|value| value.to_string())
                .map_err(|_| format!("\"{token}\" is no number"))
        }
    }
}

/// The expression with `b0`, `b1`, .. in place of the names of numbers; `None` if it uses other
/// names. `place` gives the bytes of a name as an expression.
pub(super) fn over_bytes(text: &str, place: &dyn Fn(&str) -> Option<String>) -> Option<String> {
    let mut out = String::new();
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let is_name = |c: char| c.is_ascii_alphanumeric() || "_.".contains(c);
        let len = match c {
            '0'..='9' | 'a'..='z' | 'A'..='Z' | '_' => {
                rest.find(|c| !is_name(c)).unwrap_or(rest.len())
            }
            c => c.len_utf8(),
        };
        let (token, behind) = rest.split_at(len);
        match c {
            '"' | '\'' => return None,
            'a'..='z' | 'A'..='Z' | '_' if behind.starts_with("::") => return None,
            'a'..='z' | 'A'..='Z' | '_' if matches!(token, "and" | "or" | "not") => out += token,
            'a'..='z' | 'A'..='Z' | '_' => out += &place(token)?,
            _ => out += token,
        }
        rest = behind;
    }
    Some(out)
}
