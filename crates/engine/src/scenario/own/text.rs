//! A slave with a text protocol that is defined in a scenario.

use emulators::quantity::{Variable, VariableError};
use emulators::text::{Command, Periodic, Text, TextConfig, TextError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::{EXPIRES, SourceSpec, check_times, default_latency, driven, line, sink};
use crate::scenario::board::{BoardKeys, RaisesSpec, ResetSpec};
use crate::scenario::device::{Drives, PortInfo};
use crate::scenario::drives::DrivesSpec;
use crate::scenario::{ScenarioError, Source, Span};

/// A slave with a text protocol, line by line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TextSpec {
    /// Rate of its line, 8N1, bit/s, 300 to 4000000.
    #[schemars(with = "u32", range(min = 300, max = 4_000_000))]
    pub baud: Spanned<u32>,
    /// Ends each line, both ways.
    #[serde(default = "default_terminator")]
    pub terminator: String,
    /// Time from a request to its reply.
    #[serde(default = "default_latency")]
    pub latency: Span,
    /// Silence of the master after which values become safe; never if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watchdog: Option<Span>,
    /// Reply to an unknown request; no reply if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unknown: Option<String>,
    /// Reply to a value out of range; no reply if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    /// A line that the slave sends periodically.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub periodic: Option<PeriodicSpec>,
    /// A line that the slave sends after a reset; none if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub greeting: Option<String>,
    /// Event that resets its board: `dtr` as with an Arduino, `rts` or `break`; none if not given.
    /// The reset restores all initial values; the board receives nothing until it has started.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resets_on: Option<ResetSpec>,
    /// Boot time after a reset; 1.6 s if not given, as an Arduino Uno.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub boot: Option<Span>,
    /// Modem lines that it sets, each with the variable that it follows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raises: Option<RaisesSpec>,
    /// Values that requests and replies can name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<VariableSpec>")]
    pub variable: Vec<Spanned<VariableSpec>>,
    /// Requests of the slave; the first match is used. A slave that only sends has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<CommandSpec>")]
    pub command: Vec<Spanned<CommandSpec>>,
}

/// A value of a text slave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VariableSpec {
    /// Name, as in requests and replies.
    pub name: String,
    /// Initial value; also the start of a counter or an encoder.
    #[serde(default)]
    pub initial: i64,
    /// Minimum and maximum; the range of a signed 32-bit number if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[i64; 2]>,
    /// Value after the watchdog time; unchanged if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub safe: Option<i64>,
    /// Source of the value.
    #[serde(default)]
    pub source: SourceSpec,
    /// Actuator of the robot's chassis that follows the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drives: Option<DrivesSpec>,
}

/// A request and its reply.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CommandSpec {
    /// Request of the master; `{name}` is a number that sets a variable.
    pub request: String,
    /// Reply of the slave; `{name}` prints a variable.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply: Option<String>,
}

/// A line that the slave sends periodically.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PeriodicSpec {
    /// The line; `{name}` prints a variable.
    pub line: String,
    /// Period of the line.
    pub period: Span,
}

fn default_terminator() -> String {
    "\r\n".to_owned()
}

impl TextSpec {
    /// The device; `key` is its path in the scenario.
    pub fn device(&self, key: &str, source: &Source) -> Result<Text, ScenarioError> {
        check_times(&[("watchdog", self.watchdog, EXPIRES)], key, source)?;
        let names = self.variable.iter().map(|spec| &*spec.get_ref().name);
        let names: Vec<&str> = names.collect();
        let variables = self.variable.iter().enumerate();
        let variables = variables.map(|(index, spec)| {
            let variable = spec.get_ref().variable();
            variable.map_err(|message| {
                let key = format!("{key}.variable[{index}].drives");
                source.invalid(Some(spec.span()), key, message)
            })
        });
        let commands = self.command.iter().map(|spec| Command {
            request: spec.get_ref().request.clone(),
            reply: spec.get_ref().reply.clone(),
        });
        let config = TextConfig {
            line: line(&self.baud, key, source)?,
            terminator: self.terminator.clone().into_bytes(),
            latency: self.latency.0,
            watchdog: self.watchdog.map(|watchdog| watchdog.0),
            variables: variables.collect::<Result<_, _>>()?,
            commands: commands.collect(),
            unknown: self.unknown.clone(),
            refused: self.refused.clone(),
            periodic: self.periodic.as_ref().map(|periodic| Periodic {
                line: periodic.line.clone(),
                period: periodic.period.0,
            }),
            board: self.board().config(&names, key, source)?,
            greeting: self.greeting.clone(),
        };
        Text::new(config).map_err(|error| match error {
            TextError::Variable(error) => self.variable_error(key, source, error),
            TextError::Command(index, part, message) => {
                let span = self.command.get(index).map(Spanned::span);
                source.invalid(span, format!("{key}.command[{index}].{part}"), message)
            }
            TextError::Key(part, message) => {
                source.invalid(Some(self.baud.span()), format!("{key}.{part}"), message)
            }
        })
    }
}

impl TextSpec {
    /// Its actuators and its watchdog.
    pub(in crate::scenario) fn driven(&self) -> Option<Drives> {
        let variables = self.variable.iter().map(Spanned::get_ref);
        driven(
            self.watchdog,
            "variable",
            variables.map(|spec| (spec.drives.as_ref(), spec.limits)),
        )
    }

    /// Its pins, without the serial line.
    pub(in crate::scenario) fn pins(&self) -> Vec<PortInfo> {
        self.board().ports()
    }

    const fn board(&self) -> BoardKeys<'_> {
        BoardKeys {
            resets_on: self.resets_on,
            boot: self.boot,
            raises: self.raises.as_ref(),
        }
    }

    /// The first error in the variables.
    pub(in crate::scenario) fn variable_error(
        &self,
        key: &str,
        source: &Source,
        error: VariableError,
    ) -> ScenarioError {
        let span = self.variable.get(error.index).map(Spanned::span);
        let list = format!("{key}.variable");
        source.invalid_entry((&list, error.index), span, &error.message)
    }
}

impl VariableSpec {
    fn variable(&self) -> Result<Variable, String> {
        Ok(Variable {
            name: self.name.clone(),
            initial: self.initial,
            limits: self.limits.unwrap_or([i32::MIN.into(), i32::MAX.into()]),
            safe: self.safe,
            source: self.source.clone().into(),
            drives: sink(self.drives.as_ref())?,
        })
    }
}
