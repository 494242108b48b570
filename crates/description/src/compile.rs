//! Compiles a parsed file into a description: resolves names, adds up sizes, and rejects errors
//! with their reasons.

mod behave;
mod checks;
mod dead;
mod fields;
mod frames;
mod kinds;
mod sound;
mod values;

use std::collections::BTreeMap;
use std::sync::Arc;

use protocols::{LineConfig, Parity};

use crate::description::{Description, Protocol};
use crate::error::Places;
use crate::expr::{Expr, ExprError};
use crate::field::Names;
use crate::framing::Frames;
use crate::schema::{ProtocolSpec, Schema};
use crate::state::Variable;
use crate::value::Value;

/// Reads files beside the description by the names that the description uses.
pub type Files<'a> = &'a dyn Fn(&str) -> Result<String, String>;

/// Allowed baud rates.
const BAUD: core::ops::RangeInclusive<u32> = 300..=4_000_000;

/// The state of the compilation of one description.
pub(crate) struct Compiler<'a> {
    pub(crate) places: Places<'a>,
    pub(crate) schema: &'a Schema,
    pub(crate) enums: BTreeMap<String, Names>,
    pub(crate) variables: Vec<Variable>,
    pub(crate) files: Files<'a>,
}

impl<'a> Compiler<'a> {
    /// A compiler before its first step.
    pub(crate) fn new(places: Places<'a>, schema: &'a Schema, files: Files<'a>) -> Self {
        let (enums, variables) = (BTreeMap::new(), Vec::new());
        Self {
            places,
            schema,
            enums,
            variables,
            files,
        }
    }

    /// Returns the description, or all errors.
    pub(crate) fn compile(mut self, file: &str) -> Result<Description, crate::DescriptionError> {
        let schema = self.schema;
        self.check_name("name", &schema.name);
        let line = self.line();
        self.enums();
        let protocol = schema.protocol.map(|protocol| match protocol {
            ProtocolSpec::ModbusRtu => Protocol::ModbusRtu,
            ProtocolSpec::ModbusAscii => Protocol::ModbusAscii,
        });
        if let (Some(_), Some(address)) = (protocol, schema.line.address)
            && let Err(message) = crate::modbus::check_address(address)
        {
            self.wrong("line.address", message);
        }
        if schema.watchdog.is_some_and(|span| span.0.is_zero()) {
            self.wrong(
                "watchdog",
                "is 0s and would expire at once, expected a time, or leave it out",
            );
        }
        self.variables();
        let registers = self.registers(protocol);
        self.computed();
        let frames = Arc::new(self.frames(line, protocol));
        let messages = self.messages(&frames);
        let latency = schema
            .latency
            .map_or(core::time::Duration::from_millis(1), |span| span.0);
        let on = self.on(&messages, latency);
        let every = self.every(&messages);
        let after = self.after(&messages);
        let faults = self.faults(&messages);
        let description = Description {
            text: self.places.text().into(),
            name: schema.name.clone(),
            about: schema.about.clone(),
            documents: schema.documents.clone(),
            line,
            is_half_duplex: schema.line.half_duplex || protocol.is_some(),
            turnaround: schema
                .line
                .turnaround
                .map_or(core::time::Duration::ZERO, |span| span.0),
            echoes: schema.line.echo,
            address: schema.line.address,
            latency,
            jitter: schema.jitter.map(|span| span.0),
            watchdog: schema.watchdog.map(|span| span.0),
            boot: schema.boot.map(|span| span.0),
            protocol,
            frames: Frames::of(frames),
            messages,
            variables: Arc::new(self.variables.clone()),
            registers,
            on,
            every,
            after,
            fault_names: fault_names(&faults),
            faults,
            program: schema.program.as_ref().map(|program| program.exec.clone()),
        };
        if self.places.is_sound() {
            self.check(&description);
            self.check_effects(&description);
        }
        match self.places.is_sound() {
            true => Ok(description),
            false => Err(self.places.into_error(file)),
        }
    }

    /// Records an error in the value of `key`.
    pub(crate) fn wrong(&mut self, key: impl Into<String>, message: impl Into<String>) {
        self.places.wrong(key, message);
    }

    /// Records an error if `name` cannot be used in expressions.
    pub(crate) fn check_word(&mut self, key: &str, name: &str) {
        let is_sound = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let is_word = [
            "and", "or", "not", "true", "false", "state", "request", "self",
        ];
        if !is_sound {
            self.wrong(
                key,
                format!("\"{name}\" is no name, expected letters, digits and _, no digit first"),
            );
        } else if is_word.contains(&name) {
            self.wrong(
                key,
                format!("\"{name}\" is a word of expressions, choose another name"),
            );
        }
    }

    fn check_name(&mut self, key: &str, name: &str) {
        let sound = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if name.is_empty() || !name.chars().all(sound) || name.len() > 64 {
            self.wrong(
                key,
                format!("\"{name}\" is no name, expected up to 64 letters, digits, - and _"),
            );
        }
    }

    /// Parses an expression; `is_known` checks each name.
    pub(crate) fn expr(
        &mut self,
        key: &str,
        text: &str,
        is_known: &dyn Fn(&str) -> bool,
        known: &dyn Fn() -> String,
    ) -> Expr {
        let enums = &self.enums;
        let constant = |of: &str, member: &str| {
            let names = enums.get(of)?;
            let found = names.iter().find(|(_, name)| *name == member);
            found.map(|(number, _)| Value::Int(*number))
        };
        match Expr::parse(text, &constant) {
            Ok(expr) => {
                let unknown = expr.names().into_iter().find(|name| !is_known(name));
                if let Some(name) = unknown {
                    let known = known();
                    let known = if known.is_empty() {
                        "none here".to_owned()
                    } else {
                        known
                    };
                    let mut message = format!(
                        "\"{text}\": there is no value \"{name}\", expected one of: {known}"
                    );
                    if name == "own_address" {
                        message += match self.schema.line.address {
                            None => "; own_address needs an address in [line]",
                            Some(_) => {
                                "; own_address is allowed only in \"on\", \"after\" and \"every\": \
                                 use a variable of [state] with the address here"
                            }
                        };
                    }
                    self.wrong(key, message);
                }
                expr
            }
            Err(error) => {
                self.wrong_expr(key, text, &error);
                Expr::constant(Value::Int(0))
            }
        }
    }

    fn wrong_expr(&mut self, key: &str, text: &str, error: &ExprError) {
        self.wrong(key, format!("\"{text}\": {error}"));
    }

    /// The names of the variables, for error messages.
    pub(crate) fn variable_names(&self) -> String {
        let names: Vec<_> = self
            .variables
            .iter()
            .map(|variable| &*variable.name)
            .collect();
        names.join(", ")
    }

    /// The index of a variable.
    pub(crate) fn variable(&self, name: &str) -> Option<usize> {
        let name = name.strip_prefix("state.").unwrap_or(name);
        self.variables
            .iter()
            .position(|variable| &*variable.name == name)
    }

    /// Checks that the least value is below the greatest one.
    pub(crate) fn check_limits(&mut self, key: &str, limits: Option<[f64; 2]>) {
        if let Some([least, most]) = limits
            && (least > most || !least.is_finite() || !most.is_finite())
        {
            let key = format!("{key}.limits");
            self.wrong(
                key,
                format!("are {least} and {most}, expected two numbers, the lower one first"),
            );
        }
    }

    /// Scale and offset, if either is given.
    pub(crate) fn scale(
        &mut self,
        key: &str,
        scale: Option<f64>,
        offset: Option<f64>,
    ) -> Option<[f64; 2]> {
        if scale.is_none() && offset.is_none() {
            return None;
        }
        let (scale, offset) = (scale.unwrap_or(1.0), offset.unwrap_or(0.0));
        if scale == 0.0 || !scale.is_finite() {
            self.wrong(
                format!("{key}.scale"),
                format!("is {scale}, expected a number other than 0"),
            );
        }
        if !offset.is_finite() {
            self.wrong(
                format!("{key}.offset"),
                format!("is {offset}, expected a number"),
            );
        }
        Some([scale, offset])
    }

    /// The names table called `name`.
    pub(crate) fn names(&mut self, key: &str, name: Option<&str>) -> Option<Names> {
        let name = name?;
        let found = self.enums.get(name).cloned();
        if found.is_none() {
            let known: Vec<_> = self.enums.keys().map(String::as_str).collect();
            let known = if known.is_empty() {
                "none here".to_owned()
            } else {
                known.join(", ")
            };
            let message =
                format!("there is no table \"{name}\" of [enums], expected one of: {known}");
            self.wrong(format!("{key}.enum"), message);
        }
        found
    }

    fn line(&mut self) -> LineConfig {
        let line = &self.schema.line;
        if !BAUD.contains(&line.baud) {
            let (least, most) = (BAUD.start(), BAUD.end());
            self.wrong(
                "line.baud",
                format!("is {}, expected {least} to {most}", line.baud),
            );
        }
        let format = line.format.to_ascii_uppercase();
        let (data_bits, parity, stop_bits) = match format.as_bytes() {
            [
                data @ b'5'..=b'8',
                parity @ (b'N' | b'E' | b'O'),
                stop @ (b'1' | b'2'),
            ] => {
                let parity = match parity {
                    b'N' => Parity::None,
                    b'E' => Parity::Even,
                    _ => Parity::Odd,
                };
                (data - b'0', parity, stop - b'0')
            }
            _ => {
                let message = format!("is \"{}\", expected e.g. 8N1, 8E1 or 7O2", line.format);
                self.wrong("line.format", message);
                (8, Parity::None, 1)
            }
        };
        let baud = line.baud.max(1);
        LineConfig {
            baud,
            data_bits,
            parity,
            stop_bits,
        }
    }

    fn enums(&mut self) {
        let schema = self.schema;
        for (name, members) in &schema.enums {
            let mut numbers = BTreeMap::new();
            for (number, member) in members {
                let key = format!("enums.{name}.{number}");
                match whole(number) {
                    Some(number) => drop(numbers.insert(number, member.clone())),
                    None => self.wrong(key, format!("\"{number}\" is no whole number")),
                }
            }
            self.enums.insert(name.clone(), Arc::new(numbers));
        }
    }
}

/// A whole number as a table key: decimal, or hexadecimal with the prefix `0x`.
pub(crate) fn whole(text: &str) -> Option<i128> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => i128::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// Faults that every described device has.
pub(crate) const COMMON_FAULTS: [&str; 6] = ["off", "restart", "stuck", "garbage", "wrong", "slow"];

/// The names of all faults with a static lifetime, as a rig requires them. Each description leaks
/// some bytes.
fn fault_names(faults: &[crate::behaviour::Fault]) -> &'static [&'static str] {
    if faults.is_empty() {
        return &COMMON_FAULTS;
    }
    let own = faults.iter().map(|fault| fault.name);
    let names: Vec<&'static str> = COMMON_FAULTS.into_iter().chain(own).collect();
    Vec::leak(names)
}

/// Leaks `name` to get a static lifetime.
pub(crate) fn forever(name: &str) -> &'static str {
    Box::leak(name.to_owned().into_boxed_str())
}
