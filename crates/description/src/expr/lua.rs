//! An expression in Lua, for the dissector.

use super::{Binary, Expr, Function, Node, Unary};
use crate::lua::{literal, quoted};

impl Expr {
    /// Translates the expression to Lua; names are looked up in `s`.
    pub(crate) fn lua(&self) -> String {
        self.root.lua()
    }
}

impl Node {
    fn lua(&self) -> String {
        match self {
            Self::Const(value) => literal(value),
            Self::Name(name) => format!("D.value(s, {})", quoted(name.as_bytes())),
            Self::Unary(operator, of) => {
                let name = match operator {
                    Unary::Minus => "minus",
                    Unary::Invert => "invert",
                    Unary::Not => "not",
                };
                format!("D.op[\"{name}\"]({})", of.lua())
            }
            Self::Binary(operator, a, b) => {
                format!("D.op.{}({}, {})", operator.lua(), a.lua(), b.lua())
            }
            Self::And(a, b) => {
                format!(
                    "((D.truth({}) and D.truth({})) and 1 or 0)",
                    a.lua(),
                    b.lua()
                )
            }
            Self::Or(a, b) => {
                format!(
                    "((D.truth({}) or D.truth({})) and 1 or 0)",
                    a.lua(),
                    b.lua()
                )
            }
            Self::Choice(parts) => {
                let [condition, yes, no] = &**parts;
                // A function, because `and .. or` takes the other branch if the value is false.
                format!(
                    "(function() if D.truth({}) then return {} end return {} end)()",
                    condition.lua(),
                    yes.lua(),
                    no.lua()
                )
            }
            Self::Index(of, at) => format!("D.op.at({}, {})", of.lua(), at.lua()),
            Self::Call(function, arguments) => {
                let known = Function::ALL.iter().find(|(known, ..)| known == function);
                let name = known.map_or("", |(_, name, ..)| name);
                let arguments: Vec<_> = arguments.iter().map(Self::lua).collect();
                format!("D.call.{name}({})", arguments.join(", "))
            }
        }
    }
}

impl Binary {
    const fn lua(self) -> &'static str {
        match self {
            Self::Add => "add",
            Self::Subtract => "sub",
            Self::Multiply => "mul",
            Self::Divide => "div",
            Self::DivideDown => "down",
            Self::Remainder => "rest",
            Self::ShiftLeft => "left",
            Self::ShiftRight => "right",
            Self::BitAnd => "band",
            Self::BitOr => "bor",
            Self::BitXor => "bxor",
            Self::Equal => "eq",
            Self::Unequal => "ne",
            Self::Less => "lt",
            Self::LessOrEqual => "le",
            Self::Greater => "gt",
            Self::GreaterOrEqual => "ge",
        }
    }
}
