//! Parser with operator precedence.

use super::{Binary, ExprError, Function, Node, Unary};
use crate::value::Value;

/// Maximum nesting: recursive parsing and evaluation must fit the stack.
const DEPTH_MAX: usize = 48;
/// Maximum number of characters, for the same reason: a chain of operators is a deep tree.
const LEN_MAX: usize = 1_000;

type Constant<'a> = &'a dyn Fn(&str, &str) -> Option<Value>;

/// The tree of `source`.
pub(super) fn parse(source: &str, constant: Constant<'_>) -> Result<Node, ExprError> {
    if source.len() > LEN_MAX {
        let message = format!("the expression is too long, expected {LEN_MAX} characters at most");
        return Err(ExprError { column: 0, message });
    }
    let mut parser = Parser {
        text: source,
        at: 0,
        depth: 0,
        constant,
    };
    let root = parser.choice()?;
    parser.space();
    match parser.rest().chars().next() {
        None => Ok(root),
        Some(found) => {
            let known = "()[]?:,.\"'".contains(found) || found.is_alphanumeric();
            Err(parser.error(if known {
                format!("expected an operator or the end, found \"{found}\"")
            } else {
                format!("\"{found}\" is no part of an expression")
            }))
        }
    }
}

/// Binary operators by precedence, lowest first; a longer operator precedes its own prefix.
const LEVELS: [&[(&str, Binary)]; 7] = [
    &[
        ("==", Binary::Equal),
        ("!=", Binary::Unequal),
        ("<=", Binary::LessOrEqual),
        (">=", Binary::GreaterOrEqual),
        ("<", Binary::Less),
        (">", Binary::Greater),
    ],
    &[("|", Binary::BitOr)],
    &[("^", Binary::BitXor)],
    &[("&", Binary::BitAnd)],
    &[("<<", Binary::ShiftLeft), (">>", Binary::ShiftRight)],
    &[("+", Binary::Add), ("-", Binary::Subtract)],
    &[
        ("//", Binary::DivideDown),
        ("*", Binary::Multiply),
        ("/", Binary::Divide),
        ("%", Binary::Remainder),
    ],
];

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
    constant: Constant<'a>,
}

impl<'a> Parser<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn space(&mut self) {
        let rest = self.rest();
        self.at += rest.len() - rest.trim_start().len();
    }

    fn error(&self, message: impl Into<String>) -> ExprError {
        self.error_at(self.at, message)
    }

    fn error_at(&self, at: usize, message: impl Into<String>) -> ExprError {
        let column = self.text[..at].chars().count() + 1;
        let message = message.into();
        ExprError { column, message }
    }

    /// Consumes `symbol` if it is next.
    fn take(&mut self, symbol: &str) -> bool {
        self.space();
        let is_next = self.rest().starts_with(symbol);
        if is_next {
            self.at += symbol.len();
        }
        is_next
    }

    fn expect(&mut self, symbol: &str) -> Result<(), ExprError> {
        match self.take(symbol) {
            true => Ok(()),
            false => Err(self.error(format!("expected \"{symbol}\""))),
        }
    }

    /// Consumes the word `word` if it is next.
    fn take_word(&mut self, word: &str) -> bool {
        self.space();
        let is_next = self.word() == word;
        if is_next {
            self.at += word.len();
        }
        is_next
    }

    /// The next name; empty if there is none.
    fn word(&self) -> &'a str {
        let rest = self.rest();
        let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        &rest[..end]
    }

    fn deeper<T>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<T, ExprError>,
    ) -> Result<T, ExprError> {
        if self.depth == DEPTH_MAX {
            return Err(self.error(format!("nested too deep, expected {DEPTH_MAX} at most")));
        }
        self.depth += 1;
        let found = read(self);
        self.depth -= 1;
        found
    }

    fn choice(&mut self) -> Result<Node, ExprError> {
        self.deeper(|parser| {
            let condition = parser.or()?;
            if !parser.take("?") {
                return Ok(condition);
            }
            let yes = parser.choice()?;
            parser.expect(":")?;
            let no = parser.choice()?;
            Ok(Node::Choice(Box::new([condition, yes, no])))
        })
    }

    fn or(&mut self) -> Result<Node, ExprError> {
        let mut left = self.and()?;
        while self.take_word("or") || self.take("||") {
            left = Node::Or(Box::new(left), Box::new(self.and()?));
        }
        Ok(left)
    }

    fn and(&mut self) -> Result<Node, ExprError> {
        let mut left = self.not()?;
        while self.take_word("and") || self.take("&&") {
            left = Node::And(Box::new(left), Box::new(self.not()?));
        }
        Ok(left)
    }

    fn not(&mut self) -> Result<Node, ExprError> {
        if self.take_word("not") {
            let of = self.deeper(Self::not)?;
            return Ok(Node::Unary(Unary::Not, Box::new(of)));
        }
        self.binary(0)
    }

    fn binary(&mut self, level: usize) -> Result<Node, ExprError> {
        let Some(operators) = LEVELS.get(level) else {
            return self.unary();
        };
        let mut left = self.binary(level + 1)?;
        let mut compared = false;
        while let Some(operator) = self.operator(operators) {
            if compared {
                let message = "compares twice, expected \"and\" between, as in 0 < x and x < 9";
                return Err(self.error(message.to_owned()));
            }
            // The lowest level compares.
            compared = level == 0;
            let right = self.binary(level + 1)?;
            left = Node::Binary(operator, Box::new(left), Box::new(right));
        }
        Ok(left)
    }

    fn operator(&mut self, operators: &[(&str, Binary)]) -> Option<Binary> {
        self.space();
        let rest = self.rest();
        let fits = |symbol: &str| {
            let Some(behind) = rest.strip_prefix(symbol) else {
                return false;
            };
            // `||` and `&&` are separate operators; `<` is not the beginning of `<<`.
            let is_doubled = symbol.len() == 1 && behind.starts_with(symbol);
            !(is_doubled && "|&<>".contains(symbol))
        };
        let known = operators.iter().copied();
        let (symbol, operator) = known.into_iter().find(|(symbol, _)| fits(symbol))?;
        self.at += symbol.len();
        Some(operator)
    }

    fn unary(&mut self) -> Result<Node, ExprError> {
        let operator = if self.take("-") {
            Unary::Minus
        } else if self.take("~") {
            Unary::Invert
        } else if !self.rest().starts_with("!=") && self.take("!") {
            Unary::Not
        } else {
            return self.postfix();
        };
        let of = self.deeper(Self::unary)?;
        Ok(Node::Unary(operator, Box::new(of)))
    }

    fn postfix(&mut self) -> Result<Node, ExprError> {
        let mut node = self.atom()?;
        while self.take("[") {
            let index = self.choice()?;
            self.expect("]")?;
            node = Node::Index(Box::new(node), Box::new(index));
        }
        Ok(node)
    }

    fn atom(&mut self) -> Result<Node, ExprError> {
        self.space();
        let start = self.at;
        match self.rest().chars().next() {
            Some('(') => {
                self.at += 1;
                let inner = self.choice()?;
                self.expect(")")?;
                Ok(inner)
            }
            Some(quote @ ('\'' | '"')) => self.text_literal(quote),
            Some(first) if first.is_ascii_digit() => self.number(),
            Some(first) if first.is_ascii_alphabetic() || first == '_' => self.name(start),
            _ => Err(self.error("expected a value")),
        }
    }

    fn text_literal(&mut self, quote: char) -> Result<Node, ExprError> {
        let rest = &self.rest()[1..];
        let Some(end) = rest.find(quote) else {
            return Err(self.error("the text does not end"));
        };
        self.at += 1 + end + 1;
        let text = rest[..end].replace("\\r", "\r").replace("\\n", "\n");
        Ok(Node::Const(Value::Text(text)))
    }

    fn number(&mut self) -> Result<Node, ExprError> {
        let start = self.at;
        let rest = self.rest();
        let radix = match rest.get(..2) {
            Some("0x" | "0X") => 16,
            Some("0b" | "0B") => 2,
            _ => 10,
        };
        let mut end = self.word().len();
        if radix == 10 {
            let bytes = rest.as_bytes();
            let digits = |from: usize| {
                let tail = bytes.get(from..).unwrap_or_default();
                tail.iter().take_while(|byte| byte.is_ascii_digit()).count()
            };
            end = digits(0);
            if bytes.get(end) == Some(&b'.') && digits(end + 1) > 0 {
                end += 1 + digits(end + 1);
            }
            if matches!(bytes.get(end), Some(b'e' | b'E')) {
                let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
                let exponent = digits(end + 1 + sign);
                end += if exponent > 0 { 1 + sign + exponent } else { 0 };
            }
        }
        let text = &rest[..end];
        self.at += end;
        let value = match radix {
            10 => text.parse().map(Value::Int).ok().or_else(|| {
                let float = text
                    .contains(['.', 'e', 'E'])
                    .then(|| text.parse::<f64>().ok());
                float
                    .flatten()
                    .filter(|float| float.is_finite())
                    .map(Value::Float)
            }),
            _ => i128::from_str_radix(&text[2..], radix).ok().map(Value::Int),
        };
        let value = value.map(Node::Const);
        value.ok_or_else(|| self.error_at(start, format!("\"{text}\" is no number")))
    }

    fn name(&mut self, start: usize) -> Result<Node, ExprError> {
        let word = self.word();
        self.at += word.len();
        match word {
            "true" => return Ok(Node::Const(Value::Bool(true))),
            "false" => return Ok(Node::Const(Value::Bool(false))),
            "and" | "or" | "not" => return Err(self.error_at(start, "expected a value")),
            _ => {}
        }
        if self.rest().starts_with("::") {
            self.at += 2;
            let member = self.word();
            self.at += member.len();
            let value = (self.constant)(word, member).map(Node::Const);
            return value
                .ok_or_else(|| self.error_at(start, format!("there is no {word}::{member}")));
        }
        if self.rest().starts_with('(') {
            return self.call(word, start);
        }
        let mut name = word.to_owned();
        while self.rest().starts_with('.') {
            self.at += 1;
            let part = self.word();
            if part.is_empty() {
                return Err(self.error("expected a name"));
            }
            self.at += part.len();
            name = format!("{name}.{part}");
        }
        Ok(Node::Name(name))
    }

    fn call(&mut self, name: &str, start: usize) -> Result<Node, ExprError> {
        let known = Function::ALL.iter().find(|(_, known, ..)| *known == name);
        let Some(&(function, _, least, most)) = known else {
            let known: Vec<_> = Function::ALL.iter().map(|(_, name, ..)| *name).collect();
            let known = known.join(", ");
            let message = format!("there is no function \"{name}\", expected one of {known}");
            return Err(self.error_at(start, message));
        };
        self.at += 1;
        let mut arguments = Vec::new();
        if !self.take(")") {
            loop {
                arguments.push(self.choice()?);
                if !self.take(",") {
                    break;
                }
            }
            self.expect(")")?;
        }
        let found = arguments.len();
        if (least..=most).contains(&found) {
            return Ok(Node::Call(function, arguments));
        }
        let wanted = match least == most {
            true => least.to_string(),
            false => format!("{least} to {most}"),
        };
        let message = format!("{name} has {found} arguments, expected {wanted}");
        Err(self.error_at(start, message))
    }
}
