//! A running node program: greeting, requests, and checks of its answers.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use protocols::Instant;
use serde_json::Value;

use crate::error::{Ending, NodeError};
use crate::message::{
    Answer, Form, Greeting, Hello, Input, Item, Output, PortText, Reply, Request,
};
use crate::process::Process;
use crate::processor::SameProcessor;
use crate::spec::{NUMBERS_MAX, NodeSpec, format_of, line_of};
use crate::typed::table_of;
use crate::{VERSION, binary, json};

/// Wall time within which a program must exit on request.
pub const END_MAX: Duration = Duration::from_secs(2);
/// Maximum number of bytes of a program that wait for the line of one port.
pub const BYTES_MAX: usize = 64 << 10;
/// Maximum number of log entries in one answer.
pub const NOTES_MAX: usize = 1_000;
/// Maximum number of exchanges in a row at whose end a program asks for the same moment, and the
/// time within which they count.
const RESTLESS: u32 = 10_000;
const RESTLESS_FOR: Duration = Duration::from_millis(1);

static JSON: AtomicBool = AtomicBool::new(false);

/// Selects the form of messages for node programs that are started later.
pub fn set_form(form: Form) {
    JSON.store(form == Form::Json, Ordering::Relaxed);
}

/// The form of messages for node programs that are started now.
pub fn form() -> Form {
    match JSON.load(Ordering::Relaxed) {
        true => Form::Json,
        false => Form::Binary,
    }
}

/// A running node program.
#[derive(Debug)]
pub struct Host {
    process: Process,
    form: Form,
    greeting: Greeting,
    limit: Duration,
    ports: usize,
    exchanges: u64,
    /// The time of the last exchange, and the number of exchanges around it.
    asked: (Instant, u32),
    buf: Vec<u8>,
    in_pieces: bool,
    /// Set from the first exchange to the program's end.
    together: Option<SameProcessor>,
    parts: bool,
}

impl Host {
    /// Starts the program and exchanges greetings.
    ///
    /// # Errors
    /// If the program does not answer, or uses another version; with its standard error output.
    pub fn start(spec: &NodeSpec) -> Result<Self, (NodeError, String)> {
        Self::start_as(spec, form(), VERSION)
    }

    /// Like [`start`](Self::start), with the given form and version.
    ///
    /// # Errors
    /// Those of [`start`](Self::start).
    pub fn start_as(
        spec: &NodeSpec,
        form: Form,
        version: u64,
    ) -> Result<Self, (NodeError, String)> {
        let folder = spec.folder.as_deref();
        let process = Process::start(&spec.command, folder, &spec.env, spec.patience);
        let process = process.map_err(|error| (error, String::new()))?;
        let mut host = Self {
            process,
            form,
            greeting: Greeting::default(),
            limit: spec.patience,
            ports: spec.ports.len(),
            exchanges: 0,
            asked: (Instant::ZERO, 0),
            buf: Vec::new(),
            in_pieces: false,
            together: None,
            parts: false,
        };
        match host.greet(spec, version) {
            Ok(()) => Ok(host),
            Err(error) => {
                let said = host.last_words();
                Err((error, said))
            }
        }
    }

    fn greet(&mut self, spec: &NodeSpec, version: u64) -> Result<(), NodeError> {
        let port = |port: &crate::NodePort| PortText {
            name: port.name.clone(),
            rate: port.line.baud,
            format: format_of(port.line),
        };
        let hello = Hello {
            hilrig_node: version,
            name: spec.name.clone(),
            role: spec.role.name().to_owned(),
            seed: spec.seed,
            ports: spec.ports.iter().map(port).collect(),
            quantities: spec.quantities.iter().map(|one| one.name.clone()).collect(),
            settings: spec.settings.clone(),
            messages: spec.description.as_deref().map(table_of).into(),
        };
        if self.form == Form::Binary {
            self.buf.extend_from_slice(&binary::MAGIC);
        }
        let answer = self.ask(&Request::Hello(hello), "hello")?;
        let Answer::Hello(text) = answer else {
            return Err(unexpected("hello", &answer));
        };
        self.greeting = greeting_of(text, spec)?;
        Ok(())
    }

    /// Allows the rig's thread and the program to run on different processors: in real time other
    /// threads wait for the rig.
    pub fn part(&mut self) {
        self.together = None;
        self.parts = true;
    }

    /// The greeting of the program.
    pub const fn greeting(&self) -> &Greeting {
        &self.greeting
    }

    /// Number of exchanges so far.
    pub const fn exchanges(&self) -> u64 {
        self.exchanges
    }

    /// Advances the program to `now`, with the inputs `items` since the last exchange.
    ///
    /// # Errors
    /// If the program fails, or its answer breaks the contract.
    pub fn exchange(&mut self, now: Instant, items: &[Item<Input>]) -> Result<Reply, NodeError> {
        if self.exchanges == 0 && !self.parts {
            self.together = SameProcessor::keep(self.process.pid());
        }
        match self.form {
            Form::Binary => {
                let written = binary::write_exchange(&mut self.buf, now, items);
                written.map_err(|what| untold("an exchange", what))?;
            }
            Form::Json => {
                let items = items.to_vec();
                json::write_request(&mut self.buf, &Request::Exchange { now, items });
            }
        }
        self.send("an exchange")?;
        let answer = self.answer("an exchange")?;
        let Answer::Exchange(reply) = answer else {
            return Err(unexpected("an exchange", &answer));
        };
        self.exchanges += 1;
        self.check(now, &reply)?;
        Ok(reply)
    }

    fn check(&mut self, now: Instant, reply: &Reply) -> Result<(), NodeError> {
        let backwards = |what, at| NodeError::Backwards { what, at, now };
        if let Some(next) = reply.next.filter(|next| *next < now) {
            return Err(backwards("the next moment", next));
        }
        let mut sent = vec![0; self.ports];
        let mut notes = 0;
        for (number, item) in reply.items.iter().enumerate() {
            if item.at < now {
                return Err(backwards("an item", item.at));
            }
            let port = usize::from(item.port);
            let known = match &item.what {
                Output::Note(_) => {
                    notes += 1;
                    continue;
                }
                Output::Quantity(_) => ("output", self.greeting.outputs.len()),
                Output::Message(_) if !self.greeting.messages => {
                    return Err(NodeError::Unreadable {
                        to: "an exchange",
                        what: format!(
                            "item {number} is a message, expected \"messages\": true in the \
                             answer to hello"
                        ),
                    });
                }
                Output::Message(_) => ("port of a description", self.ports.min(1)),
                Output::Bytes(_) | Output::Line(_) | Output::Coding(_) => ("port", self.ports),
            };
            if port >= known.1 {
                let (what, count) = known;
                return Err(NodeError::Unreadable {
                    to: "an exchange",
                    what: format!(
                        "item {number} is of {what} {port}, and there are {count}, counted from 0"
                    ),
                });
            }
            if let Output::Bytes(bytes) = &item.what {
                sent[port] += bytes.len();
            }
        }
        if let Some((port, len)) = sent.iter().enumerate().find(|(_, len)| **len > BYTES_MAX) {
            let what = format!("{len} bytes for port {port} in one exchange, at most {BYTES_MAX}");
            return Err(NodeError::Flood(what));
        }
        if notes > NOTES_MAX {
            let what = format!("{notes} notes in one exchange, at most {NOTES_MAX}");
            return Err(NodeError::Flood(what));
        }
        // The rig calls it again a nanosecond later.
        let (since, count) = &mut self.asked;
        if reply.next.is_none_or(|next| next > now) || now - *since > RESTLESS_FOR {
            self.asked = (now, 0);
            return Ok(());
        }
        *count += 1;
        match *count > RESTLESS {
            true => Err(NodeError::Restless { count: *count, now }),
            false => Ok(()),
        }
    }

    /// The complete state of the program as bytes.
    ///
    /// # Errors
    /// If the program cannot save its state, or fails.
    pub fn save(&mut self) -> Result<Vec<u8>, NodeError> {
        if !self.greeting.save {
            return Err(NodeError::NoSave);
        }
        match self.ask(&Request::Save, "save")? {
            Answer::Saved(state) => Ok(state),
            other => Err(unexpected("save", &other)),
        }
    }

    /// Loads a state that this program, or another instance of it, has saved.
    ///
    /// # Errors
    /// If the program cannot load a state, or fails.
    pub fn load(&mut self, state: &[u8]) -> Result<(), NodeError> {
        if !self.greeting.save {
            return Err(NodeError::NoSave);
        }
        match self.ask(&Request::Load(state.to_vec()), "load")? {
            Answer::Loaded => Ok(()),
            other => Err(unexpected("load", &other)),
        }
    }

    /// Requests the program's exit and waits for it; kills the program after a timeout.
    ///
    /// # Errors
    /// If the program did not exit, or its exit code is not 0.
    pub fn end(&mut self) -> Result<(), NodeError> {
        self.together = None;
        self.write(&Request::End, "end")?;
        self.send("end")?;
        let patience = END_MAX.min(self.limit);
        match self.process.end(patience) {
            None => Err(NodeError::NotEnded(patience)),
            Some(Ending::Code(0)) => Ok(()),
            Some(how) => Err(NodeError::EndedWith(how)),
        }
    }

    /// Closes the program's standard input, like a rig that is killed. Returns the end of the
    /// program, if it exits within [`END_MAX`].
    pub fn hang_up(&mut self) -> Option<Ending> {
        self.together = None;
        self.process.end(END_MAX)
    }

    /// Number of received bytes that belong to no answer.
    pub fn excess(&self) -> usize {
        self.process.excess()
    }

    /// Writes later requests byte by byte, as a slow pipe would deliver them.
    pub const fn write_in_pieces(&mut self) {
        self.in_pieces = true;
    }

    /// The end of the program's standard error output so far.
    pub fn said(&self) -> String {
        self.process.said()
    }

    /// Kills the program if it is running; returns the end of its standard error output.
    pub fn last_words(&mut self) -> String {
        self.together = None;
        self.process.end(Duration::ZERO);
        self.process.said_at_last()
    }

    fn ask(&mut self, request: &Request, to: &'static str) -> Result<Answer, NodeError> {
        self.write(request, to)?;
        self.send(to)?;
        self.answer(to)
    }

    fn write(&mut self, request: &Request, to: &'static str) -> Result<(), NodeError> {
        match self.form {
            Form::Binary => {
                binary::write_request(&mut self.buf, request).map_err(|what| untold(to, what))?
            }
            Form::Json => json::write_request(&mut self.buf, request),
        }
        Ok(())
    }

    fn send(&mut self, to: &'static str) -> Result<(), NodeError> {
        let piece = match self.in_pieces {
            true => 1,
            false => self.buf.len().max(1),
        };
        let mut pieces = self.buf.chunks(piece);
        let sent = pieces.try_for_each(|piece| self.process.write(piece, to));
        self.buf.clear();
        sent
    }

    fn answer(&mut self, to: &'static str) -> Result<Answer, NodeError> {
        let form = self.form;
        let answer = self.process.read(to, |bytes| match form {
            Form::Binary => {
                let Some(binary::Framed { kind, body, len }) = binary::split(bytes)? else {
                    return Ok(None);
                };
                Ok(Some((binary::read_answer(kind, body)?, len)))
            }
            Form::Json => {
                let Some((text, len)) = json::split(bytes)? else {
                    return Ok(None);
                };
                Ok(Some((json::read_answer(text)?, len)))
            }
        })?;
        Ok(answer)
    }
}

const fn untold(to: &'static str, what: String) -> NodeError {
    NodeError::Untold { to, what }
}

fn unexpected(to: &'static str, answer: &Answer) -> NodeError {
    let found = match answer {
        Answer::Hello(_) => "a greeting",
        Answer::Exchange(_) => "the answer to an exchange",
        Answer::Saved(_) => "a saved state",
        Answer::Loaded => "the answer to load",
    };
    let what = format!("it is {found}, expected one answer to each request, in order");
    NodeError::Unreadable { to, what }
}

/// Parses a greeting, if its version is supported.
fn greeting_of(text: Value, spec: &NodeSpec) -> Result<Greeting, NodeError> {
    if text["hilrig_node"].as_u64() != Some(VERSION) {
        let found = text["hilrig_node"].to_string();
        return Err(NodeError::Version { found });
    }
    let unreadable = |what| NodeError::Unreadable { to: "hello", what };
    let greeting: Greeting = serde_json::from_value(text)
        .map_err(|error| unreadable(format!("its greeting is wrong: {error}")))?;
    for port in &greeting.ports {
        if !spec.ports.iter().any(|known| known.name == port.name) {
            let known: Vec<_> = spec.ports.iter().map(|port| port.name.as_str()).collect();
            let known = known.join(", ");
            let what = format!(
                "it names the port \"{}\", expected one of {known}",
                port.name
            );
            return Err(unreadable(what));
        }
        if line_of(port.rate, &port.format).is_none() {
            let PortText { name, rate, format } = port;
            let what = format!("port {name} has the line {rate} {format}, expected e.g. 9600, 8N1");
            return Err(unreadable(what));
        }
    }
    for (what, len) in [
        ("faults", greeting.faults.len()),
        ("outputs", greeting.outputs.len()),
    ] {
        if len > NUMBERS_MAX {
            let what = format!("it names {len} {what}, expected at most {NUMBERS_MAX}");
            return Err(unreadable(what));
        }
    }
    if greeting.messages && spec.description.is_none() {
        let what = "it wants messages, and the scenario names no description".to_owned();
        return Err(unreadable(what));
    }
    for drive in &spec.drives {
        if !greeting.outputs.contains(&drive.output) {
            let known = greeting.outputs.join(", ");
            let what = format!(
                "it gives no output \"{}\", which the scenario uses; it gives: {known}",
                drive.output
            );
            return Err(unreadable(what));
        }
    }
    Ok(greeting)
}
