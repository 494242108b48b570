//! A slave with a simple text protocol, described by data: lines in, lines out.
//!
//! ```text
//! request  "SPEED {left} {right}"   words and fields; a field is a whole number and sets the
//!                                   variable of its name
//! reply    "OK {left}"              a field shows the variable of its name
//! ```
//!
//! A line that fits no request, a value out of range and a line without end are reported; the first
//! two are answered with a line of their own if the description has one.

use std::collections::VecDeque;

use core::time::Duration;

use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::board::{Board, BoardConfig, PIN_LINE, RESET_PIN};
use crate::device::{BrokenRules, Device, Event, EventKind, earliest, take};
use crate::event_log::EventLog;
use crate::quantity::{Variable, VariableError, Variables, Wanted, Watchdog};
use crate::world::{Chassis, World};

/// Configuration of a text slave.
#[derive(Clone, Debug, PartialEq)]
pub struct TextConfig {
    /// Coding of its line.
    pub line: LineConfig,
    /// End of every line, in both directions.
    pub terminator: Vec<u8>,
    /// From the end of a request to the beginning of the reply.
    pub latency: Duration,
    /// Silence of the master after which values become safe; `None`: never.
    pub watchdog: Option<Duration>,
    /// Its values.
    pub variables: Vec<Variable>,
    /// Its commands; the first match is taken.
    pub commands: Vec<Command>,
    /// Reply to everything else, if any.
    pub unknown: Option<String>,
    /// Reply to a value out of range, if any.
    pub refused: Option<String>,
    /// Line that it sends by itself, if any.
    pub periodic: Option<Periodic>,
    /// The board that it sits on.
    pub board: BoardConfig,
    /// Text sent after a restart of the board, if any.
    pub greeting: Option<String>,
}

/// A request and its reply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Command {
    /// Pattern of the master's line.
    pub request: String,
    /// Pattern of the slave's answer, if any.
    pub reply: Option<String>,
}

/// A line that is sent without a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Periodic {
    /// The line.
    pub line: String,
    /// Time between two of them.
    pub period: Duration,
}

/// A piece of a pattern.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Piece {
    Text(String),
    /// Number of a variable.
    Field(usize),
}

/// Maximum length of a line in bytes; a longer one is ignored.
const LINE_MAX: usize = 256;
/// Replies that wait at most.
const QUEUE_MAX: usize = 16;
/// Bytes that wait for the line at most.
const OUTPUT_MAX: usize = 4_096;

/// The slave.
#[derive(Clone, Debug)]
pub struct Text {
    config: TextConfig,
    variables: Variables,
    commands: Vec<(Vec<Piece>, Option<Vec<Piece>>)>,
    unknown: Option<Vec<Piece>>,
    refused: Option<Vec<Piece>>,
    periodic: Option<(Vec<Piece>, Duration)>,
    greeting: Option<Vec<Piece>>,
    board: Board,
    next_period: Option<Instant>,
    line: Vec<u8>,
    is_too_long: bool,
    watchdog: Watchdog,
    /// Replies and when they are due.
    pending: VecDeque<(Instant, Vec<Piece>)>,
    output: VecDeque<u8>,
    log: EventLog,
}

/// The part of a description that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TextError {
    /// A variable.
    Variable(VariableError),
    /// A command; the key is `request` or `reply`.
    Command(usize, &'static str, String),
    /// A key of the device itself.
    Key(&'static str, String),
}

impl Text {
    /// The line.
    pub const UART: Port = Port(0);

    /// A slave that is up as the run begins.
    ///
    /// # Errors
    /// If the description contradicts itself.
    pub fn new(config: TextConfig) -> Result<Self, TextError> {
        let variables = Variables::new(config.variables.clone()).map_err(TextError::Variable)?;
        if config.terminator.is_empty() {
            let message = "it is empty, expected the end of a line";
            return Err(TextError::Key("terminator", message.to_owned()));
        }
        let mut commands = Vec::new();
        for (index, command) in config.commands.iter().enumerate() {
            let wrong = |key| move |message| TextError::Command(index, key, message);
            let request = request(&command.request, &variables).map_err(wrong("request"))?;
            let reply = command.reply.as_ref().map(|text| pieces(text, &variables));
            commands.push((request, reply.transpose().map_err(wrong("reply"))?));
        }
        let line = |key: &'static str, text: &Option<String>| {
            let line = text.as_ref().map(|text| pieces(text, &variables));
            line.transpose()
                .map_err(|message| TextError::Key(key, message))
        };
        let unknown = line("unknown", &config.unknown)?;
        let refused = line("refused", &config.refused)?;
        let greeting = line("greeting", &config.greeting)?;
        let board = Board::new(&config.board, &variables);
        let board = board
            .map_err(|name| TextError::Key("raises", format!("there is no variable \"{name}\"")))?;
        let text = config
            .periodic
            .as_ref()
            .map(|periodic| periodic.line.clone());
        let period = config.periodic.as_ref().map(|periodic| periodic.period);
        if period.is_some_and(|period| period.is_zero()) {
            let message = "its period is 0, expected a time".to_owned();
            return Err(TextError::Key("periodic", message));
        }
        Ok(Self {
            periodic: line("periodic", &text)?.zip(period),
            next_period: period.map(|period| Instant::ZERO + period),
            variables,
            commands,
            unknown,
            refused,
            greeting,
            board,
            line: Vec::new(),
            is_too_long: false,
            watchdog: Watchdog::new(config.watchdog),
            pending: VecDeque::new(),
            output: VecDeque::new(),
            log: EventLog::default(),
            config,
        })
    }

    /// Sets the value called `name` at `now`, as a master would.
    ///
    /// # Errors
    /// If there is no such value, it has a source of its own, or the number is beyond its limits.
    pub fn set(&mut self, now: Instant, name: &str, value: i64) -> Result<(), String> {
        self.variables.set(now, name, value)
    }

    /// The current values of all variables, in the order of the description.
    pub fn values(&self, now: Instant, world: &World) -> Vec<i64> {
        let variables = 0..self.config.variables.len();
        let read = |index| self.variables.read(index, now, world);
        variables.map(read).collect()
    }

    /// Encoders and actuators of its values; without them, it reads 0 and drives nothing.
    pub fn wanted(&self) -> impl Iterator<Item = Wanted<'_>> {
        self.variables.wanted().map(|(_, wanted)| wanted)
    }

    /// Checks that `chassis` has all [wanted](Self::wanted) encoders and actuators.
    ///
    /// # Errors
    /// The first variable that lacks its source, and the sources that exist.
    pub fn check_chassis(&self, chassis: &dyn Chassis) -> Result<(), VariableError> {
        self.variables.check_chassis(chassis)
    }

    fn tell(&mut self, at: Instant, rule: &'static str, detail: impl FnOnce() -> String) {
        self.log.repeated(at, EventKind::Violation, rule, detail);
    }

    fn end_of_line(&mut self, at: Instant) {
        let bytes = core::mem::take(&mut self.line);
        if core::mem::take(&mut self.is_too_long) {
            return;
        }
        let line = String::from_utf8_lossy(&bytes).into_owned();
        self.watchdog.heard(at);
        let found = self.commands.iter().find_map(|(request, reply)| {
            fields(request, &line).map(|fields| (fields, reply.clone()))
        });
        let reply = match found {
            Some((fields, reply)) => match self.take_fields(at, &fields) {
                true => reply,
                false => self.refused.clone(),
            },
            None => {
                self.tell(at, "unknown-request", || {
                    format!("\"{line}\" fits no request")
                });
                self.unknown.clone()
            }
        };
        let Some(reply) = reply else {
            return;
        };
        if self.pending.len() == QUEUE_MAX {
            return self.tell(at, "queue-full", || {
                format!("{QUEUE_MAX} replies wait already")
            });
        }
        self.pending.push_back((at + self.config.latency, reply));
    }

    /// Sets the variables if all values are allowed; returns whether they were.
    fn take_fields(&mut self, at: Instant, fields: &[(usize, i64)]) -> bool {
        for &(index, value) in fields {
            let variable = self.variables.get(index);
            let [least, greatest] = variable.limits;
            if !(least..=greatest).contains(&value) {
                let name = variable.name.clone();
                self.tell(at, "out-of-range", || {
                    format!("{name} = {value}, expected {least} to {greatest}")
                });
                return false;
            }
        }
        for &(index, value) in fields {
            self.variables.write(at, index, value);
        }
        true
    }

    /// The board restarts at `at`.
    fn restart(&mut self, at: Instant, why: &str) {
        self.line.clear();
        self.is_too_long = false;
        self.pending.clear();
        self.output.clear();
        self.watchdog = Watchdog::new(self.config.watchdog);
        self.variables.restart(at);
        let up = self.board.boots_until().unwrap_or(at);
        let period = self.periodic.as_ref().map(|(_, period)| *period);
        self.next_period = period.map(|period| up + period);
        self.board.tell_reset(at, why, &mut self.log);
    }

    fn say(&mut self, line: &[Piece], now: Instant, world: &World) {
        let mut text = String::new();
        for piece in line {
            match piece {
                Piece::Text(words) => text += words,
                Piece::Field(index) => {
                    text += &self.variables.read(*index, now, world).to_string();
                }
            }
        }
        let bytes = text.into_bytes();
        if self.output.len() + bytes.len() <= OUTPUT_MAX {
            self.output.extend(bytes);
            self.output.extend(&self.config.terminator);
        }
    }
}

/// Splits `text` at its fields.
fn pieces(text: &str, variables: &Variables) -> Result<Vec<Piece>, String> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while let Some((words, behind)) = rest.split_once('{') {
        if !words.is_empty() {
            pieces.push(Piece::Text(words.to_owned()));
        }
        let (name, behind) = behind
            .split_once('}')
            .ok_or_else(|| format!("\"{text}\" has a {{ without }}"))?;
        let index = variables
            .find(name)
            .ok_or_else(|| format!("\"{text}\": there is no variable \"{name}\""))?;
        pieces.push(Piece::Field(index));
        rest = behind;
    }
    if !rest.is_empty() {
        pieces.push(Piece::Text(rest.to_owned()));
    }
    Ok(pieces)
}

/// The pieces of a request; an error if its fields cannot be distinguished or set.
fn request(text: &str, variables: &Variables) -> Result<Vec<Piece>, String> {
    let pieces = pieces(text, variables)?;
    let touching = |pair: &[Piece]| matches!(pair, [Piece::Field(_), Piece::Field(_)]);
    if pieces.is_empty() {
        return Err("it is empty, expected a request of the master".to_owned());
    }
    if pieces.windows(2).any(touching) {
        return Err(format!("\"{text}\": expected words between two fields"));
    }
    for piece in &pieces {
        if let Piece::Field(index) = piece
            && !variables.get(*index).is_stored()
        {
            let name = &variables.get(*index).name;
            return Err(format!("\"{text}\": {name} has a source and cannot be set"));
        }
    }
    Ok(pieces)
}

/// The values in `line` if it fits `request`.
fn fields(request: &[Piece], line: &str) -> Option<Vec<(usize, i64)>> {
    let mut found = Vec::new();
    let mut rest = line;
    for piece in request {
        match piece {
            Piece::Text(words) => rest = rest.strip_prefix(words.as_str())?,
            Piece::Field(index) => {
                let sign = usize::from(rest.starts_with('-'));
                let digits = rest[sign..].bytes().take_while(u8::is_ascii_digit).count();
                let (number, behind) = rest.split_at(sign + digits);
                found.push((*index, number.parse().ok()?));
                rest = behind;
            }
        }
    }
    rest.is_empty().then_some(found)
}

impl Device for Text {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port == RESET_PIN {
            if let Some(at) = self.board.pin(now, bytes) {
                self.restart(at, "the host raises its line");
            }
            return;
        }
        if self.board.is_deaf(now, &mut self.log) {
            return;
        }
        for &byte in bytes {
            self.line.push(byte);
            if self.line.ends_with(&self.config.terminator) {
                let len = self.line.len() - self.config.terminator.len();
                self.line.truncate(len);
                self.end_of_line(now);
            } else if self.line.len() > LINE_MAX {
                // The rest of a line that is too long is checked only for its end.
                let keep = self.config.terminator.len().min(LINE_MAX);
                self.line.drain(..self.line.len() - keep);
                if !core::mem::replace(&mut self.is_too_long, true) {
                    let detail = || format!("more than {LINE_MAX} bytes without end of line");
                    self.tell(now, "line-too-long", detail);
                }
            }
        }
    }

    /// A UART receives a break as a NUL without a stop bit; few programs check for this.
    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        if port != Self::UART || event != LineEvent::Break {
            return;
        }
        if self.board.is_reset_by_break(now) {
            return self.restart(now, "a break");
        }
        let detail = "a break: received as a NUL".to_owned();
        self.log.note(now, "break", detail);
        self.receive(port, now, &[0]);
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.log.poll(now);
        if self.board.poll(now, &self.variables, world)
            && let Some(greeting) = self.greeting.clone()
        {
            self.say(&greeting, now, world);
        }
        while let Some((due, reply)) = self.pending.pop_front() {
            if due > now {
                self.pending.push_front((due, reply));
                break;
            }
            self.say(&reply, now, world);
        }
        if let (Some(at), Some((line, period))) = (self.next_period, self.periodic.clone())
            && at <= now
        {
            self.say(&line, now, world);
            // A late poll does not send missed lines.
            self.next_period = Some((at + period).max(now));
        }
        self.watchdog.poll(now, &mut self.variables, &mut self.log);
        self.variables.drive(now, world, &mut self.log);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match port {
            Self::UART => take(&mut self.output, buf),
            pin => self.board.transmit(pin, buf),
        }
    }

    fn poll_at(&self) -> Option<Instant> {
        let due = self.pending.front().map(|(due, _)| *due);
        earliest([
            due,
            self.next_period,
            self.watchdog.silent_at(),
            self.variables.changed_at(),
            self.board.poll_at(),
            self.log.poll_at(),
        ])
    }

    fn line_config(&self, port: Port) -> LineConfig {
        match port {
            Self::UART => self.config.line,
            _ => PIN_LINE,
        }
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.log.broken())
    }
}

#[cfg(test)]
mod tests;
