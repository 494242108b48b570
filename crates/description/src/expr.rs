//! Expressions over fields and variables: arithmetic, comparisons, conditions, a few functions.
//!
//! ```text
//! voltage * 0.1 + 2          mode == "run" and speed > 0
//! high << 8 | low            level > 90 ? "full" : "ok"
//! unit::volt                 min(x, 100), len(data), bit(flags, 3)
//! ```
//!
//! Operators and their precedence are those of Kaitai Struct's expressions, except that `/` divides
//! exactly, as in Python 3, and `//` rounds down. An expression reads no clock, uses no random
//! numbers and always terminates: the same values give the same result.
//!
//! No crate is used: `evalexpr` is AGPL since version 12, `exmex` has no text, `cel` has no bit
//! operators and no mixed numbers. Compiling them takes 23 s (`exmex`), 54 s (`cel`) and 69 s
//! (`rhai`) on a busy machine with two cores.

mod eval;
mod lua;
mod parse;

use core::fmt;
use std::borrow::Cow;

use crate::value::{Record, Value};

/// A parsed expression.
#[derive(Clone, Debug)]
pub struct Expr {
    source: String,
    root: Node,
}

/// The reason why an expression cannot be parsed or evaluated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExprError {
    /// Column in the expression, from 1; 0 if there is none.
    pub column: usize,
    /// The error and the expected input.
    pub message: String,
}

impl fmt::Display for ExprError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.column {
            0 => f.write_str(&self.message),
            column => write!(f, "column {column}: {}", self.message),
        }
    }
}

impl core::error::Error for ExprError {}

/// The source of values for an expression.
pub trait Scope {
    /// The value called `name`.
    fn value(&self, name: &str) -> Option<Value>;

    /// Like [`value`](Self::value), without a copy if the scope holds the value.
    fn find(&self, name: &str) -> Option<Cow<'_, Value>> {
        self.value(name).map(Cow::Owned)
    }

    /// Bytes of the register table from `address` on, if there is a table.
    fn registers(&self, _address: i128, _count: i128) -> Option<Vec<u8>> {
        None
    }
}

/// An empty scope.
#[derive(Clone, Copy, Debug)]
pub struct Nothing;

impl Scope for Nothing {
    fn value(&self, _: &str) -> Option<Value> {
        None
    }
}

impl Scope for Record {
    fn value(&self, name: &str) -> Option<Value> {
        self.get(name).cloned()
    }

    fn find(&self, name: &str) -> Option<Cow<'_, Value>> {
        self.get(name).map(Cow::Borrowed)
    }
}

#[derive(Clone, Debug)]
enum Node {
    Const(Value),
    Name(String),
    Unary(Unary, Box<Self>),
    Binary(Binary, Box<Self>, Box<Self>),
    And(Box<Self>, Box<Self>),
    Or(Box<Self>, Box<Self>),
    Choice(Box<[Self; 3]>),
    Index(Box<Self>, Box<Self>),
    Call(Function, Vec<Self>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unary {
    Minus,
    Invert,
    Not,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    DivideDown,
    Remainder,
    ShiftLeft,
    ShiftRight,
    BitAnd,
    BitOr,
    BitXor,
    Equal,
    Unequal,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

/// Declares the functions with the number of their arguments.
macro_rules! functions {
    ($($function:ident $name:literal $least:literal $most:literal,)+) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        enum Function {
            $($function,)+
        }

        impl Function {
            const ALL: &[(Self, &'static str, usize, usize)] =
                &[$((Self::$function, $name, $least, $most),)+];
        }
    };
}

functions! {
    Abs "abs" 1 1,
    Bit "bit" 2 2,
    Bytes "bytes" 1 16,
    Ceil "ceil" 1 1,
    Clamp "clamp" 3 3,
    Float "float" 1 1,
    Floor "floor" 1 1,
    Int "int" 1 1,
    Len "len" 1 1,
    Lower "lower" 1 1,
    Max "max" 2 8,
    Min "min" 2 8,
    Registers "registers" 2 2,
    Round "round" 1 2,
    Sqrt "sqrt" 1 1,
    Text "text" 1 2,
    Upper "upper" 1 1,
}

impl Expr {
    /// Parses an expression; `constant` gives the values of `enum::member`.
    ///
    /// # Errors
    /// If the text is not an expression; with the column.
    pub fn parse(
        source: &str,
        constant: &dyn Fn(&str, &str) -> Option<Value>,
    ) -> Result<Self, ExprError> {
        let root = parse::parse(source, constant)?;
        Ok(Self {
            source: source.to_owned(),
            root,
        })
    }

    /// An expression with the constant value `value`.
    pub fn constant(value: Value) -> Self {
        Self {
            source: value.to_string(),
            root: Node::Const(value),
        }
    }

    /// The source text.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The names that the expression reads.
    pub fn names(&self) -> Vec<&str> {
        let mut names = Vec::new();
        self.root.names(&mut names);
        names
    }

    /// The name, if the expression is a single name.
    pub fn single_name(&self) -> Option<&str> {
        match &self.root {
            Node::Name(name) => Some(name),
            _ => None,
        }
    }

    /// Whether the expression reads the register table.
    pub fn uses_registers(&self) -> bool {
        self.root.uses_registers()
    }

    /// Evaluates the expression in `scope`.
    ///
    /// # Errors
    /// If a name is unknown in `scope`, or a value does not fit an operator.
    pub fn eval(&self, scope: &dyn Scope) -> Result<Value, ExprError> {
        self.root.eval(scope).map(Cow::into_owned)
    }

    /// Like [`eval`](Self::eval), for an integer; `None` if there is none.
    pub(crate) fn int(&self, scope: &dyn Scope) -> Option<i128> {
        self.root.eval(scope).ok()?.as_int()
    }

    /// The name, if the expression is a single name.
    pub(crate) fn name(&self) -> Option<&str> {
        self.root.name()
    }

    /// Pairs from comparisons: names that `scope` lacks, with values that `scope` can compute.
    pub(crate) fn compared(&self, scope: &dyn Scope) -> Vec<(String, Value)> {
        let mut found = Vec::new();
        self.root.compared(scope, &mut found);
        found
    }

    /// The two names in `registers(ADDRESS, COUNT)`, if both arguments are names.
    pub(crate) fn registers_read(&self) -> Option<(&str, &str)> {
        self.root.registers_read()
    }
}

impl Node {
    fn name(&self) -> Option<&str> {
        match self {
            Self::Name(name) => Some(name.strip_prefix("request.").unwrap_or(name)),
            _ => None,
        }
    }

    fn compared(&self, scope: &dyn Scope, found: &mut Vec<(String, Value)>) {
        if let Self::Binary(_, first, second) = self {
            for (name, value) in [(first, second), (second, first)] {
                let unknown = name.name().filter(|name| scope.value(name).is_none());
                if let (Some(name), Ok(value)) = (unknown, value.eval(scope)) {
                    found.push((name.to_owned(), value.into_owned()));
                }
            }
        }
        for child in self.children() {
            child.compared(scope, found);
        }
    }

    fn registers_read(&self) -> Option<(&str, &str)> {
        if let Self::Call(Function::Registers, arguments) = self
            && let [at, count] = &arguments[..]
            && let (Some(at), Some(count)) = (at.name(), count.name())
        {
            return Some((at, count));
        }
        self.children().into_iter().find_map(Self::registers_read)
    }

    fn children(&self) -> Vec<&Self> {
        match self {
            Self::Const(_) | Self::Name(_) => Vec::new(),
            Self::Unary(_, one) => vec![one],
            Self::Binary(_, a, b) | Self::And(a, b) | Self::Or(a, b) | Self::Index(a, b) => {
                vec![a, b]
            }
            Self::Choice(all) => all.iter().collect(),
            Self::Call(_, all) => all.iter().collect(),
        }
    }

    fn names<'a>(&'a self, names: &mut Vec<&'a str>) {
        if let Self::Name(name) = self {
            names.push(name);
        }
        for child in self.children() {
            child.names(names);
        }
    }

    fn uses_registers(&self) -> bool {
        let uses = matches!(self, Self::Call(Function::Registers, _));
        uses || self.children().into_iter().any(Self::uses_registers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(source: &str) -> Result<Value, String> {
        let mut scope = Record::default();
        scope.set("x", Value::Int(7));
        scope.set("f", Value::Float(2.5));
        scope.set("mode", Value::Text("run".to_owned()));
        scope.set("data", Value::Bytes(vec![1, 2, 250]));
        let constant =
            |of: &str, member: &str| ((of, member) == ("unit", "volt")).then_some(Value::Int(3));
        let expr = Expr::parse(source, &constant).map_err(|error| error.to_string())?;
        expr.eval(&scope).map_err(|error| error.to_string())
    }

    fn int(source: &str) -> i128 {
        match value(source) {
            Ok(Value::Int(int)) => int,
            other => panic!("{source}: {other:?}"),
        }
    }

    /// Expected values are worked out by hand with Python's operator precedence.
    #[test]
    fn expressions_are_computed_as_in_python() {
        for (source, expected) in [
            ("1 + 2 * 3", 7),
            ("(1 + 2) * 3", 9),
            ("-7 // 2", -4),
            ("-7 % 3", 2),
            ("1 << 4 | 0x0F & 0b101", 21),
            ("6 & 3 == 2 ? 10 : 20", 10),
            ("~0 & 0xff", 255),
            ("6 ^ 3", 5),
            ("10 / 5", 2),
            ("x > 3 and not x == 8 ? 1 : 0", 1),
            ("x < 3 or mode == 'run' ? 1 : 0", 1),
            ("unit::volt + 1", 4),
            ("data[2] - data[0]", 249),
            ("len(data) + len(mode)", 6),
            ("clamp(x, 0, 5) + min(1, 2) + max(3, 4, 5)", 11),
            ("bit(x, 2) + bit(x, 3)", 1),
            ("int('42') + int(2.5)", 44),
            ("round(2.4) + floor(2.9) + ceil(2.1)", 7),
            ("18446744073709551615 + 1", 18_446_744_073_709_551_616),
        ] {
            assert_eq!(int(source), expected, "{source}");
        }
        assert_eq!(value("x / 2"), Ok(Value::Float(3.5)));
        assert_eq!(value("f * 2"), Ok(Value::Float(5.0)));
        assert_eq!(value("mode + '!'"), Ok(Value::Text("run!".to_owned())));
        assert_eq!(value("f == 2.5 and 1 == 1.0"), Ok(Value::Bool(true)));
        assert_eq!(value("text(f, 2)"), Ok(Value::Text("2.50".to_owned())));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_column() {
        for (source, expected) in [
            ("", "column 1: expected a value"),
            ("1 +", "column 4: expected a value"),
            ("(1", "column 3: expected \")\""),
            (
                "1 2",
                "column 3: expected an operator or the end, found \"2\"",
            ),
            ("x $ 2", "column 3: \"$\" is no part of an expression"),
            ("x ? 1", "column 6: expected \":\""),
            (
                "pow(2)",
                "column 1: there is no function \"pow\", expected one of abs, bit,",
            ),
            ("abs(1, 2)", "column 1: abs has 2 arguments, expected 1"),
            ("unit::ampere", "column 1: there is no unit::ampere"),
            ("'open", "column 1: the text does not end"),
            ("y + 1", "there is no value \"y\""),
            ("1 / 0", "division by 0"),
            (
                "mode * 2",
                "expected numbers for \"*\", found text and a whole number",
            ),
            ("1 << 200", "shift by 200, expected 0 to 127"),
            ("data[3]", "there is no element 3, expected 0 to 2"),
            ("99999999999999999999999999999999999999999", "column 1: "),
        ] {
            let error = value(source).expect_err(source);
            assert!(error.starts_with(expected), "{source}: {error}");
        }
    }

    /// No input exhausts the stack.
    #[test]
    fn deep_nesting_is_refused() {
        for (open, close) in [("(", ")"), ("-", ""), ("not ", "")] {
            let source = format!("{}1{}", open.repeat(200), close.repeat(200));
            assert!(value(&source).expect_err("too deep").contains("too deep"));
        }
        assert_eq!(int(&format!("{}1", "1 + ".repeat(30))), 31);
        let chain = format!("{}1", "1 + ".repeat(10_000));
        assert!(value(&chain).expect_err("too long").contains("too long"));
    }
}
